//! Features that are written by program: pixel formats, test patterns, temperature, user sets, events, the PTP clock.

use crate::network_camera::messages::{EVENTS, FRAME_ID_AT, TIMESTAMP_AT};
use crate::network_camera::ptp::{ACCURACIES, STATES};
use crate::network_camera::xml_nodes::{Access, Entry, Feature, Nodes, write_entries};
use crate::network_camera::{pixel_format::PixelFormat, registers::own, test_pattern::TestPattern, user_sets};
use base::bayer::BayerPattern;
use frames::camera_control::REGIONS_MAX;

/// The parts that are put into the template.
pub(super) struct MoreFeatures {
    /// Names of categories of their own.
    pub(super) categories: String,
    /// Nodes.
    pub(super) nodes: String,
}

/// Entries of PixelFormat.
pub(super) fn pixel_formats(colours: Option<BayerPattern>) -> String {
    let names: Vec<(String, PixelFormat)> = PixelFormat::named(colours).collect();
    let entries: Vec<Entry<'_>> =
        names.iter().map(|(name, format)| Entry::standard(name, format.code(colours))).collect();
    let mut text = String::new();
    let _ = write_entries(&mut text, &entries); // writing to a string cannot fail
    text.trim_end().to_owned()
}

/// Features beyond the template. Events are those of a camera that clients command.
pub(super) fn more_features(is_commanded: bool) -> MoreFeatures {
    let mut nodes = Nodes::default();
    let mut categories = vec!["UserSetControl", "PtpControl"];
    add_device_features(&mut nodes);
    add_regions(&mut nodes);
    add_user_sets(&mut nodes);
    add_ptp(&mut nodes);
    if is_commanded {
        categories.push("EventControl");
        add_events(&mut nodes);
    }
    let line = |name: &&str| format!("  <pFeature>{name}</pFeature>");
    let categories: Vec<String> = categories.iter().map(line).collect();
    MoreFeatures { categories: categories.join("\n"), nodes: nodes.text }
}

fn add_device_features(nodes: &mut Nodes) {
    let own_pattern = TestPattern::GreyDiagonalRampMoving.name();
    let patterns: Vec<Entry<'_>> = (0..)
        .zip(TestPattern::NAMED)
        .map(|(value, (name, _))| Entry { name, value, is_standard: name != own_pattern })
        .collect();
    let pattern = Feature::new("TestPattern", "Numbers in place of the image; each frame says so in its chunk data");
    nodes.enumeration(&pattern, Some(own::TEST_PATTERN), Access::Both, &patterns);
    let selector =
        Feature::new("DeviceTemperatureSelector", "Where the temperature is measured").selects(&["DeviceTemperature"]);
    nodes.enumeration(&selector, None, Access::Read, &[Entry::standard("Sensor", 0)]);
    let temperature = Feature::new("DeviceTemperature", "Temperature of the detector in the newest frame");
    nodes.float(&temperature, own::TEMPERATURE, "C");
    let reset = Feature::new("DeviceReset", "Ends acquisition and control, and loads the user set of UserSetDefault");
    nodes.command(&reset, own::DEVICE_RESET);
}

fn add_regions(nodes: &mut Nodes) {
    let names: Vec<String> = (0..REGIONS_MAX).map(|number| format!("Region{number}")).collect();
    let regions: Vec<Entry<'_>> = (0..).zip(&names).map(|(value, name)| Entry::standard(name, value)).collect();
    let selector = Feature::new(
        "RegionSelector",
        "The part of the image that size and offsets are about; those that are on are sent one below the other",
    )
    .selects(&["RegionMode", "Width", "Height", "OffsetX", "OffsetY"]);
    nodes.enumeration(&selector, Some(own::REGION_SELECTOR), Access::Both, &regions);
    let states = [Entry::standard("Off", 0), Entry::standard("On", 1)];
    let mode = Feature::new("RegionMode", "On: the region is sent; Region0 always is").locked_by("TLParamsLocked");
    nodes.enumeration(&mode, Some(own::REGION_MODE), Access::Both, &states);
}

fn add_user_sets(nodes: &mut Nodes) {
    let names = ["UserSetSelector", "UserSetLoad", "UserSetSave", "UserSetDefault"];
    nodes.category("UserSetControl", &names.map(String::from));
    let sets: Vec<Entry<'_>> = (0..).zip(user_sets::NAMES).map(|(value, name)| Entry::standard(name, value)).collect();
    let selector = Feature::new("UserSetSelector", "The user set that is loaded or saved; kept until the program ends")
        .selects(&["UserSetLoad", "UserSetSave"]);
    nodes.enumeration(&selector, Some(own::USER_SET_SELECTOR), Access::Both, &sets);
    let load = Feature::new("UserSetLoad", "Settings as they are in the selected set").locked_by("TLParamsLocked");
    nodes.command(&load, own::USER_SET_LOAD);
    nodes.raw(
        "<IntSwissKnife Name=\"UserSetIsFixed\">\n  <pVariable Name=\"S\">UserSetSelectorReg</pVariable>\n  \
         <Formula>S=0</Formula>\n</IntSwissKnife>\n",
    );
    let save = Feature::new("UserSetSave", "Keeps the settings in the selected set").locked_by("UserSetIsFixed");
    nodes.command(&save, own::USER_SET_SAVE);
    let default = Feature::new("UserSetDefault", "The user set that DeviceReset loads");
    nodes.enumeration(&default, Some(own::USER_SET_DEFAULT), Access::Both, &sets);
}

fn add_ptp(nodes: &mut Nodes) {
    let clocks = [
        ("PtpClockID", "Identity of the clock", own::PTP_CLOCK_ID),
        ("PtpParentClockID", "Identity of the clock that it follows", own::PTP_PARENT_ID),
        ("PtpGrandmasterClockID", "Identity of the clock that all follow", own::PTP_GRANDMASTER_ID),
    ];
    let times = [
        ("PtpOffsetFromMaster", "Time of the clock less that of its master", own::PTP_OFFSET),
        ("PtpMeanPropagationDelay", "Mean delay of the path to the master", own::PTP_DELAY),
    ];
    let mut names: Vec<String> =
        ["PtpEnable", "PtpStatus", "PtpServoStatus", "PtpDataSetLatch", "PtpClockAccuracy"].map(String::from).into();
    names.extend(clocks.iter().chain(&times).map(|(name, ..)| (*name).to_owned()));
    nodes.category("PtpControl", &names);
    let enable = Feature::new("PtpEnable", "Reads the state of the PTP clock of this machine (ptp4l)");
    nodes.boolean(&enable, own::PTP_ENABLE);
    let latch = Feature::new("PtpDataSetLatch", "Takes the newest numbers of the clock");
    nodes.command(&latch, own::PTP_LATCH);
    let states = STATES.map(|(name, value)| Entry::standard(name, value));
    nodes.enumeration(&Feature::new("PtpStatus", "State of the clock"), Some(own::PTP_STATUS), Access::Read, &states);
    let servo = [Entry::standard("Unknown", 0), Entry::standard("Locked", 1)];
    let feature = Feature::new("PtpServoStatus", "Locked: the clock follows its master");
    nodes.enumeration(&feature, Some(own::PTP_SERVO), Access::Read, &servo);
    let accuracies = ACCURACIES.map(|(name, value)| Entry::standard(name, value));
    let feature = Feature::new("PtpClockAccuracy", "Accuracy that the clock states");
    nodes.enumeration(&feature, Some(own::PTP_ACCURACY), Access::Read, &accuracies);
    for (name, about, address) in clocks {
        nodes.long(&Feature::new(name, about), address, ("", "HexNumber", false));
    }
    for (name, about, address) in times {
        nodes.long(&Feature::new(name, about), address, ("ns", "", true));
    }
}

fn add_events(nodes: &mut Nodes) {
    let mut names: Vec<String> = ["EventSelector", "EventNotification"].map(String::from).into();
    for event in &EVENTS {
        names.extend(["", "Timestamp", "FrameID"].map(|end| format!("Event{}{end}", event.name)));
    }
    nodes.category("EventControl", &names);
    let events: Vec<Entry<'_>> = (0..).zip(&EVENTS).map(|(value, event)| Entry::standard(event.name, value)).collect();
    let selector =
        Feature::new("EventSelector", "The event that EventNotification is about").selects(&["EventNotification"]);
    nodes.enumeration(&selector, Some(own::EVENT_SELECTOR), Access::Both, &events);
    let states = [Entry::standard("Off", 0), Entry::standard("On", 1)];
    let notification = Feature::new("EventNotification", "On: the event is sent to the message channel");
    nodes.enumeration(&notification, Some(own::EVENT_NOTIFICATION), Access::Both, &states);
    for event in &EVENTS {
        let name = event.name;
        let number = |what: &str, unit: &str, address: usize| {
            format!(
                "<IntReg Name=\"Event{name}{what}\" NameSpace=\"Standard\">\n  <Address>0x{address:X}</Address>\n  \
                 <Length>8</Length>\n  <AccessMode>RO</AccessMode>\n  <pPort>Event{name}Port</pPort>\n  \
                 <Cachable>NoCache</Cachable>\n  <Sign>Unsigned</Sign>\n  <Endianess>BigEndian</Endianess>\n{unit}</IntReg>\n"
            )
        };
        nodes.raw(&format!(
            "<Port Name=\"Event{name}Port\">\n  <EventID>{:04X}</EventID>\n</Port>\n\
             <Integer Name=\"Event{name}\" NameSpace=\"Standard\">\n  <Value>{}</Value>\n</Integer>\n",
            event.id, event.id
        ));
        nodes.raw(&number("Timestamp", "  <Unit>ns</Unit>\n", TIMESTAMP_AT));
        nodes.raw(&number("FrameID", "", FRAME_ID_AT));
    }
}
