//! The features of the camera in one table, in the order of the XML: name, meaning, address, access, kind, range, unit.
//!
//! The XML follows from it (`xml`), and so does what clients may write to the camera's own registers
//! (`device`): the range, and whether frames must not be acquired meanwhile. A new feature takes an address
//! before [`own::END`] and a row; what a write does beyond keeping the value is in `device::camera`, a command to the
//! camera in `device::commander`.

#![allow(clippy::wildcard_enum_match_arm, reason = "a question about one kind of feature concerns no other kind")]

use crate::network_camera::feature::{
    Access::{Both, Read},
    Entries::{self, Made, Numbers, Words},
    Entry, Feature, Kind,
    Limit::{self, At, Given, Of},
    category, choice, command, difference, flag, number, numbered, only, other, reading, real, switch, text, whole,
    zero,
};
use crate::network_camera::messages::EVENTS;
use crate::network_camera::params::PACKET_BYTES_MIN;
use crate::network_camera::ptp::{ACCURACIES, STATES};
use crate::network_camera::{chunk, pixel_format::PixelFormat, test_pattern::TestPattern};
use base::bayer::BayerPattern;
use frames::camera_control::REGIONS_MAX;

/// Addresses of bootstrap registers.
pub(super) mod at {
    pub(in crate::network_camera) const VERSION: u32 = 0x0000;
    pub(in crate::network_camera) const DEVICE_MODE: u32 = 0x0004;
    pub(in crate::network_camera) const MAC_HIGH: u32 = 0x0008;
    pub(in crate::network_camera) const MAC_LOW: u32 = 0x000C;
    pub(in crate::network_camera) const IP_CONFIGURATIONS: u32 = 0x0010;
    pub(in crate::network_camera) const IP_CONFIGURATION: u32 = 0x0014;
    pub(in crate::network_camera) const ADDRESS: u32 = 0x0024;
    pub(in crate::network_camera) const SUBNET_MASK: u32 = 0x0034;
    pub(in crate::network_camera) const VENDOR: u32 = 0x0048;
    pub(in crate::network_camera) const MODEL: u32 = 0x0068;
    pub(in crate::network_camera) const DEVICE_VERSION: u32 = 0x0088;
    pub(in crate::network_camera) const INFO: u32 = 0x00A8;
    pub(in crate::network_camera) const SERIAL: u32 = 0x00D8;
    pub(in crate::network_camera) const USER_NAME: u32 = 0x00E8;
    pub(in crate::network_camera) const USER_NAME_LAST: u32 = 0x00F4;
    pub(in crate::network_camera) const FIRST_URL: u32 = 0x0200;
    pub(in crate::network_camera) const SECOND_URL: u32 = 0x0400;
    pub(in crate::network_camera) const INTERFACES: u32 = 0x0600;
    pub(in crate::network_camera) const MESSAGE_CHANNELS: u32 = 0x0900;
    pub(in crate::network_camera) const STREAM_CHANNELS: u32 = 0x0904;
    pub(in crate::network_camera) const ACTION_SIGNALS: u32 = 0x0908;
    pub(in crate::network_camera) const ACTION_DEVICE_KEY: u32 = 0x090C;
    pub(in crate::network_camera) const GVCP_CAPABILITY: u32 = 0x0934;
    pub(in crate::network_camera) const HEARTBEAT_MS: u32 = 0x0938;
    pub(in crate::network_camera) const TICK_FREQUENCY: u32 = 0x093C;
    pub(in crate::network_camera) const TIMESTAMP_CONTROL: u32 = 0x0944;
    pub(in crate::network_camera) const TIMESTAMP: u32 = 0x0948;
    pub(in crate::network_camera) const GVCP_CONFIGURATION: u32 = 0x0954;
    pub(in crate::network_camera) const PTP_STATUS: u32 = 0x096C;
    pub(in crate::network_camera) const ACTION_QUEUE: u32 = 0x0970;
    pub(in crate::network_camera) const CONTROL: u32 = 0x0A00;
    pub(in crate::network_camera) const CONTROLLER_PORT: u32 = 0x0A04;
    pub(in crate::network_camera) const CONTROLLER_ADDRESS: u32 = 0x0A14;
    pub(in crate::network_camera) const MESSAGE_PORT: u32 = 0x0B00;
    pub(in crate::network_camera) const MESSAGE_ADDRESS: u32 = 0x0B10;
    pub(in crate::network_camera) const MESSAGE_TIMEOUT: u32 = 0x0B14;
    pub(in crate::network_camera) const MESSAGE_RETRIES: u32 = 0x0B18;
    pub(in crate::network_camera) const MESSAGE_SOURCE_PORT: u32 = 0x0B1C;
    pub(in crate::network_camera) const STREAM_PORT: u32 = 0x0D00;
    pub(in crate::network_camera) const PACKET_SIZE: u32 = 0x0D04;
    pub(in crate::network_camera) const PACKET_DELAY: u32 = 0x0D08;
    pub(in crate::network_camera) const STREAM_ADDRESS: u32 = 0x0D18;
    pub(in crate::network_camera) const STREAM_SOURCE_PORT: u32 = 0x0D1C;
    pub(in crate::network_camera) const ACTION_GROUP_KEY: u32 = 0x9800;
    pub(in crate::network_camera) const ACTION_GROUP_MASK: u32 = 0x9804;
}

/// Addresses of the camera's own features.
pub(super) mod own {
    pub(in crate::network_camera) const SENSOR_WIDTH: u32 = 0xA000;
    pub(in crate::network_camera) const SENSOR_HEIGHT: u32 = 0xA004;
    pub(in crate::network_camera) const WIDTH: u32 = 0xA008;
    pub(in crate::network_camera) const HEIGHT: u32 = 0xA00C;
    pub(in crate::network_camera) const OFFSET_X: u32 = 0xA010;
    pub(in crate::network_camera) const OFFSET_Y: u32 = 0xA014;
    pub(in crate::network_camera) const PIXEL_FORMAT: u32 = 0xA018;
    pub(in crate::network_camera) const PAYLOAD_SIZE: u32 = 0xA01C;
    pub(in crate::network_camera) const ACQUISITION_START: u32 = 0xA020;
    pub(in crate::network_camera) const ACQUISITION_STOP: u32 = 0xA024;
    pub(in crate::network_camera) const ACQUISITION_MODE: u32 = 0xA028;
    pub(in crate::network_camera) const FRAME_COUNT: u32 = 0xA02C;
    pub(in crate::network_camera) const TRIGGER_MODE: u32 = 0xA030;
    pub(in crate::network_camera) const TRIGGER_SOURCE: u32 = 0xA034;
    pub(in crate::network_camera) const TRIGGER_SOFTWARE: u32 = 0xA038;
    pub(in crate::network_camera) const PARAMETERS_LOCKED: u32 = 0xA03C;
    pub(in crate::network_camera) const CHUNK_MODE: u32 = 0xA040;
    pub(in crate::network_camera) const CHUNK_ENABLE: u32 = 0xA044;
    pub(in crate::network_camera) const FRAME_RATE: u32 = 0xA048;
    pub(in crate::network_camera) const FRAME_RATE_LOW: u32 = 0xA04C;
    pub(in crate::network_camera) const EXPOSURE_TIME: u32 = 0xA050;
    pub(in crate::network_camera) const GAIN: u32 = 0xA058;
    pub(in crate::network_camera) const DETECTOR_BITS: u32 = 0xA060;
    pub(in crate::network_camera) const CHUNK_SELECTOR: u32 = 0xA064;
    pub(in crate::network_camera) const FRAME_RATE_MOST: u32 = 0xA068;
    pub(in crate::network_camera) const FRAME_RATE_LEAST: u32 = 0xA070;
    pub(in crate::network_camera) const BLACK_LEVEL: u32 = 0xA078;
    pub(in crate::network_camera) const TRIGGER_DELAY: u32 = 0xA080;
    pub(in crate::network_camera) const FRAME_RATE_ENABLE: u32 = 0xA088;
    pub(in crate::network_camera) const TRIGGER_OVERLAP: u32 = 0xA08C;
    pub(in crate::network_camera) const BURST: u32 = 0xA090;
    pub(in crate::network_camera) const EXPOSURE_AUTO: u32 = 0xA094;
    pub(in crate::network_camera) const GAIN_AUTO: u32 = 0xA098;
    pub(in crate::network_camera) const EXPOSURE_MODE: u32 = 0xA09C;
    pub(in crate::network_camera) const TEST_PATTERN: u32 = 0xA0A0;
    pub(in crate::network_camera) const USER_SET_SELECTOR: u32 = 0xA0A4;
    pub(in crate::network_camera) const USER_SET_LOAD: u32 = 0xA0A8;
    pub(in crate::network_camera) const USER_SET_SAVE: u32 = 0xA0AC;
    pub(in crate::network_camera) const USER_SET_DEFAULT: u32 = 0xA0B0;
    pub(in crate::network_camera) const DEVICE_RESET: u32 = 0xA0B4;
    pub(in crate::network_camera) const TEMPERATURE: u32 = 0xA0B8;
    pub(in crate::network_camera) const EVENT_SELECTOR: u32 = 0xA0C0;
    pub(in crate::network_camera) const EVENT_NOTIFICATION: u32 = 0xA0C4;
    pub(in crate::network_camera) const PTP_ENABLE: u32 = 0xA0C8;
    pub(in crate::network_camera) const PTP_LATCH: u32 = 0xA0CC;
    pub(in crate::network_camera) const PTP_STATUS: u32 = 0xA0D0;
    pub(in crate::network_camera) const PTP_SERVO: u32 = 0xA0D4;
    pub(in crate::network_camera) const PTP_ACCURACY: u32 = 0xA0D8;
    pub(in crate::network_camera) const PTP_OFFSET: u32 = 0xA0E0;
    pub(in crate::network_camera) const PTP_DELAY: u32 = 0xA0E8;
    pub(in crate::network_camera) const PTP_CLOCK_ID: u32 = 0xA0F0;
    pub(in crate::network_camera) const PTP_PARENT_ID: u32 = 0xA0F8;
    pub(in crate::network_camera) const PTP_GRANDMASTER_ID: u32 = 0xA100;
    pub(in crate::network_camera) const REGION_SELECTOR: u32 = 0xA108;
    pub(in crate::network_camera) const REGION_MODE: u32 = 0xA10C;
    pub(in crate::network_camera) const STATUS_SELECTOR: u32 = 0xA110;
    pub(in crate::network_camera) const STATUS: u32 = 0xA114;
    /// The first address behind them.
    pub(in crate::network_camera) const END: u32 = 0xA118;
}

/// Names of the user sets, by number.
pub(super) const USER_SETS: [&str; 4] = ["Default", "UserSet1", "UserSet2", "UserSet3"];

/// States that AcquisitionStatus may be about: a trigger would be taken at once; an acquisition is not over.
const STATUSES: [&str; 2] = ["FrameTriggerWait", "AcquisitionActive"];

/// Every feature. Names in braces are filled in by `xml`.
#[rustfmt::skip] // One feature, one line or two.
pub(super) const TABLE: &[Feature] = &[
    category("Root", &[
        "DeviceControl", "ImageFormatControl", "AcquisitionControl", "ActionControl", "ChunkDataControl",
        "UserSetControl", "PtpControl", "EventControl", "TransportLayerControl",
    ]),
    category("DeviceControl", &[
        "DeviceVendorName", "DeviceModelName", "DeviceVersion", "DeviceManufacturerInfo", "DeviceSerialNumber",
        "DeviceUserID", "DetectorBits", "Gain", "GainSelector", "GainAuto", "BlackLevelSelector", "BlackLevel",
        "DeviceTemperatureSelector", "DeviceTemperature", "DeviceReset", "TimestampLatch", "TimestampLatchValue",
        "TimestampTickFrequency",
    ]),
    category("ImageFormatControl", &[
        "SensorWidth", "SensorHeight", "WidthMax", "HeightMax", "RegionSelector", "RegionMode", "Width", "Height",
        "OffsetX", "OffsetY", "PixelFormat", "TestPattern",
    ]),
    category("AcquisitionControl", &[
        "AcquisitionMode", "AcquisitionFrameCount", "AcquisitionStart", "AcquisitionStop", "AcquisitionFrameRate",
        "ExposureTime", "ExposureMode", "ExposureAuto", "AcquisitionFrameRateEnable", "AcquisitionBurstFrameCount",
        "TriggerActivation", "TriggerDelay", "TriggerOverlap", "TriggerSelector", "TriggerMode", "TriggerSource",
        "TriggerSoftware", "AcquisitionStatusSelector", "AcquisitionStatus",
    ]),
    category("ActionControl", &[
        "ActionDeviceKey", "ActionGroupKey", "ActionGroupMask",
    ]),
    category("TransportLayerControl", &[
        "PayloadSize", "TLParamsLocked", "GevCurrentIPAddress", "GevCurrentSubnetMask", "GevMACAddress",
        "GevVersionMajor", "GevVersionMinor", "GevHeartbeatTimeout", "GevStreamChannelCount",
        "GevStreamChannelSelector", "GevSCPHostPort", "GevSCPSPacketSize", "GevSCPSFireTestPacket",
        "GevSCPSDoNotFragment", "GevSCPD", "GevSCDA", "GevSCSP", "GevCCP",
    ]),
    category("ChunkDataControl", &[
        "ChunkModeActive", "ChunkSelector", "ChunkEnable", "{CHUNK_FEATURES}",
    ]),
    text("DeviceVendorName", "Vendor", at::VENDOR, 32, Read),
    text("DeviceModelName", "Model", at::MODEL, 32, Read),
    text("DeviceVersion", "Version", at::DEVICE_VERSION, 32, Read),
    text("DeviceManufacturerInfo", "About the vendor", at::INFO, 48, Read),
    text("DeviceSerialNumber", "Serial number", at::SERIAL, 16, Read),
    text("DeviceUserID", "Name given by the user", at::USER_NAME, 16, Both),
    whole("DetectorBits", "Bits of the detector: pixels are shifted from these to the bits of the pixel format", own::DETECTOR_BITS, Read)
        .custom().seen_by("Beginner"),
    whole("SensorWidth", "Columns of the sensor", own::SENSOR_WIDTH, Read).seen_by("Beginner").unit("px"),
    whole("SensorHeight", "Rows of the sensor", own::SENSOR_HEIGHT, Read).seen_by("Beginner").unit("px"),
    difference("WidthMax", "Columns that a region may have", [("S", "SensorWidth"), ("X", "OffsetX")]),
    difference("HeightMax", "Rows that a region may have", [("S", "SensorHeight"), ("Y", "OffsetY")]),
    difference("OffsetXMax", "First column at most", [("S", "SensorWidth"), ("W", "Width")]),
    difference("OffsetYMax", "First row at most", [("S", "SensorHeight"), ("H", "Height")]),
    whole("Width", "Columns of the region", own::WIDTH, Both)
        .seen_by("Beginner").locked().between(At(1), Of("WidthMax")).step("1").unit("px"),
    whole("Height", "Rows of the region", own::HEIGHT, Both)
        .seen_by("Beginner").locked().between(At(1), Of("HeightMax")).step("1").unit("px"),
    whole("OffsetX", "First column of the region", own::OFFSET_X, Both)
        .seen_by("Beginner").locked().between(At(0), Of("OffsetXMax")).step("{OFFSET_STEP}").unit("px"),
    whole("OffsetY", "First row of the region", own::OFFSET_Y, Both)
        .seen_by("Beginner").locked().between(At(0), Of("OffsetYMax")).step("{OFFSET_STEP}").unit("px"),
    choice("PixelFormat", "How pixels travel", own::PIXEL_FORMAT, Both, Made(pixel_formats)).locked(),
    choice("AcquisitionMode", "Frames of one acquisition", own::ACQUISITION_MODE, Both, Words(&["Continuous", "SingleFrame", "MultiFrame"]))
        .locked(),
    whole("AcquisitionFrameCount", "Frames of an acquisition of several", own::FRAME_COUNT, Both)
        .seen_by("Beginner").locked().between(At(1), At(65_535)).step("1"),
    command("AcquisitionStart", "Begins an acquisition", own::ACQUISITION_START, 1),
    command("AcquisitionStop", "Ends the acquisition", own::ACQUISITION_STOP, 1),
    real("AcquisitionFrameRate", "Frames per second: those of the bench at most, or of each n-th of its frames; the nearest is taken", own::FRAME_RATE)
        .between(Of("AcquisitionFrameRateMinReg"), Of("AcquisitionFrameRateMaxReg")).unit("Hz").read_only(),
    real("AcquisitionFrameRate", "Exposures per second, when the rate is enabled", own::FRAME_RATE)
        .between(Of("AcquisitionFrameRateMinReg"), Of("AcquisitionFrameRateMaxReg")).unit("Hz").commanded(),
    number("AcquisitionFrameRateMaxReg", own::FRAME_RATE_MOST),
    number("AcquisitionFrameRateMinReg", own::FRAME_RATE_LEAST),
    reading("ExposureTime", "Integration time of the bench", own::EXPOSURE_TIME).unit("us").read_only(),
    reading("Gain", "Gain of the detector: digital numbers for an electron", own::GAIN).unit("DN/e-").read_only(),
    real("ExposureTime", "Integration time of the next exposure", own::EXPOSURE_TIME)
        .locked_by("ExposureAutoReg").between(Given("{EXPOSURE_MIN}"), Given("{EXPOSURE_MAX}")).unit("us").commanded(),
    real("Gain", "Gain beyond that of the camera file", own::GAIN)
        .locked_by("GainAutoReg").between(Given("{GAIN_MIN}"), Given("{GAIN_MAX}")).unit("dB").commanded(),
    real("BlackLevel", "Number of a pixel without light", own::BLACK_LEVEL)
        .between(Given("{BLACK_MIN}"), Given("{BLACK_MAX}")).unit("DN").commanded(),
    real("TriggerDelay", "From a trigger to the start of the exposure", own::TRIGGER_DELAY)
        .between(At(0), Given("{DELAY_MAX}")).unit("us").commanded(),
    switch("AcquisitionFrameRateEnable", "Off: exposures follow each other as fast as exposure and readout allow", own::FRAME_RATE_ENABLE)
        .commanded(),
    choice("TriggerOverlap", "When triggers are accepted while the frame before is not over", own::TRIGGER_OVERLAP, Both, Words(&["Off", "ReadOut", "PreviousFrame"]))
        .commanded(),
    whole("AcquisitionBurstFrameCount", "Exposures of one trigger", own::BURST, Both).between(At(1), At(65_535)).commanded(),
    choice("ExposureAuto", "What sets the integration time", own::EXPOSURE_AUTO, Both, AUTO).commanded(),
    choice("GainAuto", "What sets the gain", own::GAIN_AUTO, Both, AUTO).commanded(),
    choice("ExposureMode", "How the length of an exposure is determined", own::EXPOSURE_MODE, Both, Made(exposure_modes)).commanded(),
    other("<Integer Name=\"LineIsThere\">\n  <Value>{HAS_LINE}</Value>\n</Integer>\n").commanded(),
    only("GainSelector", "The only one", "All").selects(&["Gain"]).commanded(),
    only("BlackLevelSelector", "The only one", "All").selects(&["BlackLevel"]).commanded(),
    only("TriggerActivation", "The only one", "RisingEdge").commanded(),
    only("TriggerSelector", "What the trigger chooses", "FrameStart")
        .selects(&["TriggerMode", "TriggerSource", "TriggerSoftware"]).read_only(),
    only("TriggerSelector", "What the trigger starts", "FrameStart")
        .selects(&["TriggerMode", "TriggerSource", "TriggerSoftware", "TriggerActivation", "TriggerDelay", "TriggerOverlap"]).commanded(),
    choice("TriggerMode", "On: each frame waits for a trigger", own::TRIGGER_MODE, Both, OFF_ON).locked(),
    choice("TriggerSource", "Where triggers come from", own::TRIGGER_SOURCE, Both, Words(&["Software", "Action1"])).locked().read_only(),
    choice("TriggerSource", "Where triggers come from", own::TRIGGER_SOURCE, Both, Made(trigger_sources)).locked().commanded(),
    command("TriggerSoftware", "Sends the next frame of the bench", own::TRIGGER_SOFTWARE, 1).read_only(),
    command("TriggerSoftware", "Starts an exposure", own::TRIGGER_SOFTWARE, 1).commanded(),
    choice("AcquisitionStatusSelector", "The state that AcquisitionStatus is about", own::STATUS_SELECTOR, Both, Words(&STATUSES))
        .selects(&["AcquisitionStatus"]),
    flag("AcquisitionStatus", "The selected state holds now", own::STATUS),
    whole("ActionDeviceKey", "Key that an action command must have", at::ACTION_DEVICE_KEY, Both)
        .seen_by("Guru").between(At(0), At(u32::MAX)).form("HexNumber"),
    whole("ActionGroupKey", "Group key that an action command must have", at::ACTION_GROUP_KEY, Both)
        .seen_by("Guru").between(At(0), At(u32::MAX)).form("HexNumber"),
    whole("ActionGroupMask", "Groups of the camera: an action command must share one", at::ACTION_GROUP_MASK, Both)
        .seen_by("Guru").between(At(0), At(u32::MAX)).form("HexNumber"),
    command("TimestampLatch", "Notes the time of the bench", at::TIMESTAMP_CONTROL, 2),
    whole("TimestampLatchValue", "Time noted last, TAI since 1970", at::TIMESTAMP, Read).long().seen_by("Beginner").unit("ns"),
    whole("TimestampTickFrequency", "Ticks of time stamps", at::TICK_FREQUENCY, Read).long().seen_by("Beginner").unit("Hz"),
    switch("ChunkModeActive", "Truth of each frame behind its image", own::CHUNK_MODE).locked(),
    choice("ChunkSelector", "Which truth ChunkEnable is about", own::CHUNK_SELECTOR, Both, Made(chunks)).selects(&["ChunkEnable"]),
    switch("ChunkEnable", "The selected truth is wanted; all of it is sent when any is", own::CHUNK_ENABLE).locked(),
    other("<Port Name=\"TruthPort\" NameSpace=\"Standard\">\n  <ChunkID>{TRUTH_ID}</ChunkID>\n</Port>\n{CHUNKS}\n"),
    choice("TestPattern", "Numbers in place of the image; each frame says so in its chunk data", own::TEST_PATTERN, Both, Made(test_patterns)),
    only("DeviceTemperatureSelector", "Where the temperature is measured", "Sensor").selects(&["DeviceTemperature"]),
    reading("DeviceTemperature", "Temperature of the detector in the newest frame", own::TEMPERATURE).fresh().unit("C"),
    command("DeviceReset", "Ends acquisition and control, and loads the user set of UserSetDefault", own::DEVICE_RESET, 1),
    choice("RegionSelector", "The part of the image that size and offsets are about; those that are on are sent one below the other", own::REGION_SELECTOR, Both, Made(regions))
        .selects(&["RegionMode", "Width", "Height", "OffsetX", "OffsetY"]),
    choice("RegionMode", "On: the region is sent; Region0 always is", own::REGION_MODE, Both, OFF_ON).locked(),
    category("UserSetControl", &[
        "UserSetSelector", "UserSetLoad", "UserSetSave", "UserSetDefault",
    ]),
    choice("UserSetSelector", "The user set that is loaded or saved; kept until the program ends", own::USER_SET_SELECTOR, Both, Words(&USER_SETS))
        .selects(&["UserSetLoad", "UserSetSave"]),
    command("UserSetLoad", "Settings as they are in the selected set", own::USER_SET_LOAD, 1).locked(),
    other("<IntSwissKnife Name=\"UserSetIsFixed\">\n  <pVariable Name=\"S\">UserSetSelectorReg</pVariable>\n  <Formula>S=0</Formula>\n</IntSwissKnife>\n"),
    command("UserSetSave", "Keeps the settings in the selected set", own::USER_SET_SAVE, 1).locked_by("UserSetIsFixed"),
    choice("UserSetDefault", "The user set that DeviceReset loads", own::USER_SET_DEFAULT, Both, Words(&USER_SETS)),
    category("PtpControl", &[
        "PtpEnable", "PtpStatus", "PtpServoStatus", "PtpDataSetLatch", "PtpClockAccuracy", "PtpClockID",
        "PtpParentClockID", "PtpGrandmasterClockID", "PtpOffsetFromMaster", "PtpMeanPropagationDelay",
    ]),
    switch("PtpEnable", "Reads the state of the PTP clock of this machine (ptp4l)", own::PTP_ENABLE),
    command("PtpDataSetLatch", "Takes the newest numbers of the clock", own::PTP_LATCH, 1),
    choice("PtpStatus", "State of the clock", own::PTP_STATUS, Read, Numbers(&STATES)),
    choice("PtpServoStatus", "Locked: the clock follows its master", own::PTP_SERVO, Read, Words(&["Unknown", "Locked"])),
    choice("PtpClockAccuracy", "Accuracy that the clock states", own::PTP_ACCURACY, Read, Numbers(&ACCURACIES)),
    whole("PtpClockID", "Identity of the clock", own::PTP_CLOCK_ID, Read).long().form("HexNumber"),
    whole("PtpParentClockID", "Identity of the clock that it follows", own::PTP_PARENT_ID, Read).long().form("HexNumber"),
    whole("PtpGrandmasterClockID", "Identity of the clock that all follow", own::PTP_GRANDMASTER_ID, Read).long().form("HexNumber"),
    whole("PtpOffsetFromMaster", "Time of the clock less that of its master", own::PTP_OFFSET, Read).long().signed().unit("ns"),
    whole("PtpMeanPropagationDelay", "Mean delay of the path to the master", own::PTP_DELAY, Read).long().signed().unit("ns"),
    category("EventControl", &[
        "EventSelector", "EventNotification", "{EVENT_FEATURES}",
    ]).commanded(),
    choice("EventSelector", "The event that EventNotification is about", own::EVENT_SELECTOR, Both, Made(events))
        .selects(&["EventNotification"]).commanded(),
    choice("EventNotification", "On: the event is sent to the message channel", own::EVENT_NOTIFICATION, Both, OFF_ON).commanded(),
    other("{EVENTS}").commanded(),
    whole("PayloadSize", "Bytes of one frame, chunks included", own::PAYLOAD_SIZE, Read).seen_by("Expert").unit("B"),
    whole("TLParamsLocked", "1: what changes the payload is locked", own::PARAMETERS_LOCKED, Both)
        .seen_by("Invisible").between(At(0), At(1)),
    whole("GevCurrentIPAddress", "Address", at::ADDRESS, Read).seen_by("Expert").form("IPV4Address"),
    whole("GevCurrentSubnetMask", "Mask of the subnet", at::SUBNET_MASK, Read).seen_by("Expert").form("IPV4Address"),
    whole("GevMACAddress", "Hardware address", at::MAC_HIGH, Read).long().seen_by("Expert").form("MACAddress"),
    whole("GevVersionMajor", "Major version of the control protocol", at::VERSION, Read).bits(15, 0).seen_by("Expert"),
    whole("GevVersionMinor", "Minor version of the control protocol", at::VERSION, Read).bits(31, 16).seen_by("Expert"),
    whole("GevHeartbeatTimeout", "Silence after which control ends", at::HEARTBEAT_MS, Both)
        .seen_by("Guru").between(At(500), At(600_000)).unit("ms"),
    whole("GevStreamChannelCount", "Stream channels", at::STREAM_CHANNELS, Read).seen_by("Expert"),
    zero("GevStreamChannelSelector", "The only stream channel")
        .between(At(0), At(0)).selects(&["GevSCPHostPort", "GevSCPSPacketSize", "GevSCPD", "GevSCDA"]),
    whole("GevSCPHostPort", "Port that packets go to", at::STREAM_PORT, Both)
        .bits(31, 16).seen_by("Guru").locked().between(At(0), At(65_535)).step("1"),
    whole("GevSCPSPacketSize", "Packet size with IP and UDP headers", at::PACKET_SIZE, Both)
        .bits(31, 16).seen_by("Expert").locked().between(At(PACKET_BYTES_MIN), Given("{PACKET_MAX}")).step("4"),
    switch("GevSCPSFireTestPacket", "Sends a test packet", at::PACKET_SIZE).bits(0, 0),
    switch("GevSCPSDoNotFragment", "Packets are not fragmented", at::PACKET_SIZE).bits(1, 1),
    whole("GevSCPD", "Pause between packets on top of the rate", at::PACKET_DELAY, Both)
        .seen_by("Expert").between(At(0), At(10_000_000)).step("1").unit("ns"),
    whole("GevSCDA", "Address that packets go to", at::STREAM_ADDRESS, Both)
        .seen_by("Guru").between(At(0), At(u32::MAX)).form("IPV4Address"),
    whole("GevSCSP", "Port that packets come from", at::STREAM_SOURCE_PORT, Read).seen_by("Guru"),
    choice("GevCCP", "Who commands the camera", at::CONTROL, Both, Words(&["OpenAccess", "ExclusiveAccess", "ControlAccess"])),
];

impl Feature {
    /// Returns the feature whose register clients may write at an address.
    pub(super) fn written_at(address: u32, is_commanded: bool) -> Option<&'static Self> {
        let is_there = |row: &&Self| (row.address..row.address + row.bytes).contains(&address);
        TABLE.iter().filter(|row| row.is_of(is_commanded)).find(|row| row.access != Read && is_there(row))
    }

    /// Returns the feature of a name.
    pub(super) fn named(name: &str, is_commanded: bool) -> Option<&'static Self> {
        TABLE.iter().find(|row| row.name == name && row.is_of(is_commanded))
    }

    /// Returns true for a value in its range; `word` reads a register.
    pub(super) fn takes(&self, value: u32, colours: Option<BayerPattern>, word: impl Fn(u32) -> u32) -> bool {
        let number = |name: &str| Self::named(name, false).map_or(0, |row| word(row.address));
        let limit = |limit: Limit| match limit {
            At(number) => Some(number),
            Of(name) => match Self::named(name, false)?.kind {
                Kind::Difference([(_, from), (_, less)]) => Some(number(from).saturating_sub(number(less))),
                _ => None,
            },
            Limit::Nothing | Given(_) => None,
        };
        match self.kind {
            Kind::Switch => value <= 1,
            Kind::Choice(entries) => entries.list(colours).iter().any(|entry| entry.value == value),
            Kind::Whole => {
                let [least, most] = self.range.map(limit);
                least.is_none_or(|least| value >= least) && most.is_none_or(|most| value <= most)
            }
            _ => true,
        }
    }
}

const OFF_ON: Entries = Words(&["Off", "On"]);
const AUTO: Entries = Words(&["Off", "Once", "Continuous"]);

fn pixel_formats(colours: Option<BayerPattern>) -> Vec<Entry> {
    PixelFormat::named(colours).map(|(name, format)| Entry::new(name, format.code(colours))).collect()
}

/// Sources of a camera that clients command: those of [`SOURCES`](super::registers::SOURCES).
fn trigger_sources(_: Option<BayerPattern>) -> Vec<Entry> {
    let mut sources = numbered(["Software", "Action1", "Line1", "Bus", "Control"].into_iter());
    sources[2..].iter_mut().for_each(|source| source.space = "");
    sources
}

fn exposure_modes(_: Option<BayerPattern>) -> Vec<Entry> {
    vec![Entry::new("Timed", 0), Entry { available: "LineIsThere", ..Entry::new("TriggerWidth", 1) }]
}

/// The truth without the word that all its names begin with.
fn chunks(_: Option<BayerPattern>) -> Vec<Entry> {
    let names = chunk::FIELDS.iter().map(|field| field.feature.name.trim_start_matches("Chunk"));
    numbered(names).into_iter().map(|entry| Entry { space: "Custom", ..entry }).collect()
}

fn test_patterns(_: Option<BayerPattern>) -> Vec<Entry> {
    let is_own = |entry: &Entry| entry.name == TestPattern::GreyDiagonalRampMoving.name();
    let mut patterns = numbered(TestPattern::NAMED.iter().map(|(name, _)| *name));
    patterns.iter_mut().filter(|entry| is_own(entry)).for_each(|entry| entry.space = "Custom");
    patterns
}

fn regions(_: Option<BayerPattern>) -> Vec<Entry> {
    numbered((0..REGIONS_MAX).map(|number| format!("Region{number}")))
}

fn events(_: Option<BayerPattern>) -> Vec<Entry> {
    numbered(EVENTS.iter().map(|event| event.name))
}
