//! The device's memory: bootstrap registers, its own features from A000 (`features`), the XML twice. Big-endian words.
//!
//! Reading goes through whole words inside one block of memory; addresses between the blocks are invalid. Reserved
//! words inside a block read as zero. The device writes: it knows the effect of a value.

use crate::network_camera::features::{at, own};
use crate::network_camera::params::{CommandParams, DeviceParams, Identity, SensorParams, XmlForm};
use crate::network_camera::{gvcp::Status, pixel_format::PixelFormat};
use frames::camera_control::{ExposureMode, TriggerOverlap, TriggerSource};

/// Trigger sources by their number in the register.
pub(super) const SOURCES: [TriggerSource; 5] =
    [TriggerSource::Software, TriggerSource::Action, TriggerSource::Line, TriggerSource::Bus, TriggerSource::Control];
/// Overlaps by their number in the register.
pub(super) const OVERLAPS: [TriggerOverlap; 3] =
    [TriggerOverlap::Off, TriggerOverlap::ReadOut, TriggerOverlap::PreviousFrame];

/// Where the XML of the first URL lies; the second one follows at [`SECOND_XML`].
pub(super) const FIRST_XML: u32 = 0x2_0000;
/// Where the XML of the second URL lies.
pub(super) const SECOND_XML: u32 = 0x8_0000;

/// Words that begin at an address.
struct Block {
    from: u32,
    bytes: Vec<u8>,
}

/// Everything that can be read.
pub(super) struct Memory {
    blocks: [Block; 5],
}

impl Memory {
    /// Returns zeros, and the two forms of the XML (whole words, and shorter than the space between their addresses).
    pub(super) fn new(first_xml: Vec<u8>, second_xml: Vec<u8>) -> Self {
        let zeros = |from, bytes| Block { from, bytes: vec![0; bytes] };
        let xml = |from, bytes| Block { from, bytes };
        let blocks = [
            zeros(0, 0x1000),
            zeros(at::ACTION_GROUP_KEY, 16),
            zeros(own::SENSOR_WIDTH, (own::END - own::SENSOR_WIDTH) as usize),
            xml(FIRST_XML, first_xml),
            xml(SECOND_XML, second_xml),
        ];
        Self { blocks }
    }

    /// Returns `bytes` of memory from a word's address. Here the XML is at its own place, not where clients see it.
    pub(super) fn read(&self, address: u32, bytes: usize) -> Result<&[u8], Status> {
        if !address.is_multiple_of(4) {
            return Err(Status::BadAlignment);
        }
        let inside = |block: &'_ Block| {
            let from = usize::try_from(address.checked_sub(block.from)?).ok()?;
            (from < block.bytes.len()).then_some(from)
        };
        let found = self.blocks.iter().find_map(|block| inside(block).map(|from| (block, from)));
        let (block, from) = found.ok_or(Status::InvalidAddress)?;
        block.bytes.get(from..from.saturating_add(bytes)).ok_or(Status::InvalidAddress)
    }

    /// Returns a word; zero where there is none.
    pub(super) fn word(&self, address: u32) -> u32 {
        self.read(address, 4).ok().and_then(|bytes| bytes.try_into().ok()).map_or(0, u32::from_be_bytes)
    }

    /// Returns a number of double precision; zero where there is none.
    pub(super) fn float(&self, address: u32) -> f64 {
        self.read(address, 8).ok().and_then(|bytes| bytes.try_into().ok()).map_or(0.0, f64::from_be_bytes)
    }

    /// Sets a word of the device's own; nothing where there is none.
    pub(super) fn set(&mut self, address: u32, value: u32) {
        self.set_bytes(address, &value.to_be_bytes());
    }

    /// Sets a number of eight bytes, integer or float by its bits.
    pub(super) fn set_long(&mut self, address: u32, bits: u64) {
        self.set_bytes(address, &bits.to_be_bytes());
    }

    /// Sets text, or anything else, as far as its block goes.
    pub(super) fn set_bytes(&mut self, address: u32, bytes: &[u8]) {
        for block in &mut self.blocks {
            let Some(from) = address.checked_sub(block.from).and_then(|from| usize::try_from(from).ok()) else {
                continue;
            };
            if let Some(place) = block.bytes.get_mut(from..from.saturating_add(bytes.len())) {
                place.copy_from_slice(bytes);
            }
        }
    }
}

// The first contents of the device's memory: addresses of the XML, bootstrap registers, features.

/// Specification version reported to clients: 1.2, the first with all features in use here.
const VERSION: u32 = 0x0001_0002;
/// Big-endian, UTF-8.
const DEVICE_MODE: u32 = 0x8000_0001;
/// Names, serial number, PTP, actions, resend, memory writes, many registers in one command.
const GVCP_CAPABILITY: u32 = 0xC008_0047;
/// Beside these, of a camera that clients command: scheduled actions, events with data, events.
const COMMANDED_CAPABILITY: u32 = 0x0002_0018;
/// Scheduled actions that may wait.
const ACTIONS_MOST: u32 = 256;
/// Time stamps tick in nanoseconds.
const TICKS_PER_S: u64 = 1_000_000_000;
/// Heartbeat time of a client that asks for none, ms; the longest of a client that has not proven its address.
pub(super) const HEARTBEAT_MS: u32 = 3000;

/// Lowest frame rate of a commanded camera, Hz.
const FRAME_RATE_LEAST_HZ: f64 = 1e-3;

/// How one client sees the XML.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct XmlView {
    /// Part of the file name, different in each run.
    pub(super) run_number: u32,
    /// Added to the XML's place in memory.
    pub(super) shift: u32,
}

/// A client gets at least one frame in so many.
pub(super) const ONE_IN_MOST: u16 = u16::MAX;

/// Writes where one client sees the XML: two addresses, so that a client that cannot unzip reads the other.
pub(super) fn write_urls(memory: &mut Memory, form: XmlForm, [plain_bytes, zip_bytes]: [usize; 2], view: XmlView) {
    let XmlView { run_number, shift } = view;
    let url = |end, from: u32, bytes| format!("Local:starloop_{run_number:08x}.{end};{:08x};{bytes:x}", from + shift);
    let plain = |from| url("xml", from, plain_bytes);
    let zip = |from| url("zip", from, zip_bytes);
    let (first, second) = match form {
        XmlForm::Zip => (zip(FIRST_XML), plain(SECOND_XML)),
        XmlForm::Plain => (plain(FIRST_XML), zip(SECOND_XML)),
    };
    memory.set_bytes(at::FIRST_URL, first.as_bytes());
    memory.set_bytes(at::SECOND_URL, second.as_bytes());
}

/// Writes the registers that clients read first.
pub(super) fn write_bootstrap(memory: &mut Memory, identity: &Identity, place: &DeviceParams) {
    let [a, b, c, d, e, f] = place.mac;
    for (address, value) in [
        (at::VERSION, VERSION),
        (at::DEVICE_MODE, DEVICE_MODE),
        (at::MAC_HIGH, u32::from_be_bytes([0, 0, a, b])),
        (at::MAC_LOW, u32::from_be_bytes([c, d, e, f])),
        // The machine's address, whatever its source: reported as a persistent one.
        (at::IP_CONFIGURATIONS, 0x7),
        (at::IP_CONFIGURATION, 0x5),
        (at::ADDRESS, place.address.to_bits()),
        (at::SUBNET_MASK, place.mask.to_bits()),
        (at::INTERFACES, 1),
        (at::MESSAGE_CHANNELS, 1),
        (at::STREAM_CHANNELS, 1),
        (at::ACTION_SIGNALS, 1),
        (at::GVCP_CAPABILITY, GVCP_CAPABILITY),
        (at::HEARTBEAT_MS, HEARTBEAT_MS),
        (at::STREAM_SOURCE_PORT, place.stream_source_port.into()),
        (at::MESSAGE_SOURCE_PORT, place.message_source_port.into()),
    ] {
        memory.set(address, value);
    }
    memory.set_long(at::TICK_FREQUENCY, TICKS_PER_S);
    for (address, text) in [
        (at::VENDOR, &identity.vendor),
        (at::MODEL, &identity.model),
        (at::DEVICE_VERSION, &identity.version),
        (at::INFO, &identity.info),
        (at::SERIAL, &identity.serial),
        (at::USER_NAME, &identity.user_name),
    ] {
        memory.set_bytes(address, text.as_bytes());
    }
}

/// Writes the camera's own features as they are before a client changes them.
pub(super) fn write_features(memory: &mut Memory, sensor: &SensorParams, format: PixelFormat) {
    let [width, height] = sensor.size_px;
    for (address, value) in [
        (own::SENSOR_WIDTH, width),
        (own::SENSOR_HEIGHT, height),
        (own::WIDTH, width),
        (own::HEIGHT, height),
        (own::PIXEL_FORMAT, format.code(sensor.colours)),
        (own::FRAME_COUNT, 1),
        (own::CHUNK_ENABLE, 1),
        (own::DETECTOR_BITS, sensor.bits),
    ] {
        memory.set(address, value);
    }
    for (address, value) in [
        (own::FRAME_RATE, sensor.frame_rate_hz),
        (own::FRAME_RATE_MOST, sensor.frame_rate_hz),
        (own::FRAME_RATE_LEAST, sensor.frame_rate_hz / f64::from(ONE_IN_MOST)),
        (own::EXPOSURE_TIME, sensor.exposure_s * 1e6),
        (own::GAIN, sensor.gain_e_per_dn.recip()),
    ] {
        memory.set_long(address, value.to_bits());
    }
}

/// Writes the settings of a commanded camera as they are before a client changes them.
pub(super) fn write_settings(memory: &mut Memory, commands: &CommandParams) {
    let (settings, start, range) = (&commands.settings, &commands.start, &commands.range);
    let place = |found: Option<usize>| found.and_then(|place| u32::try_from(place).ok()).unwrap_or_default();
    // Of several sources one can be read: the line that a camera is wired to, when it waits for triggers.
    let is_line = start.is_triggered && commands.has_line && start.sources.has(TriggerSource::Line);
    let is_named = |source: &TriggerSource| start.sources.has(*source) && (!is_line || *source == TriggerSource::Line);
    let source = SOURCES.iter().position(is_named);
    let overlap = OVERLAPS.iter().position(|overlap| *overlap == start.overlap);
    for (address, value) in [
        (own::TRIGGER_MODE, start.is_triggered.into()),
        (own::TRIGGER_SOURCE, place(source)),
        (own::TRIGGER_OVERLAP, place(overlap)),
        (own::BURST, start.burst),
        (own::FRAME_RATE_ENABLE, start.period.is_some().into()),
        (at::GVCP_CAPABILITY, GVCP_CAPABILITY | COMMANDED_CAPABILITY),
        (at::ACTION_QUEUE, ACTIONS_MOST),
        (own::EXPOSURE_MODE, (start.mode == ExposureMode::TriggerWidth).into()),
    ] {
        memory.set(address, value);
    }
    let rate_hz = start.period.map_or(range.frame_rate_max_hz, |period| 1.0 / period.s());
    for (address, value) in [
        (own::EXPOSURE_TIME, settings.exposure.s() * 1e6),
        (own::GAIN, settings.gain_db),
        (own::BLACK_LEVEL, settings.black_level_dn),
        (own::TRIGGER_DELAY, start.delay.s() * 1e6),
        (own::FRAME_RATE, rate_hz),
        (own::FRAME_RATE_MOST, range.frame_rate_max_hz),
        (own::FRAME_RATE_LEAST, FRAME_RATE_LEAST_HZ),
    ] {
        memory.set_long(address, value.to_bits());
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reading_stops_at_the_ends_of_a_block() {
        let mut memory = Memory::new(vec![7; 8], vec![9; 4]);
        memory.set(own::END - 4, 0x0102_0304);
        assert_eq!(memory.read(own::END - 4, 4), Ok(&[1, 2, 3, 4][..]));
        assert_eq!(memory.read(own::END - 4, 8), Err(Status::InvalidAddress), "past the end");
        assert_eq!(memory.read(own::END, 4), Err(Status::InvalidAddress));
        assert_eq!(memory.read(FIRST_XML, 8), Ok(&[7; 8][..]));
        assert_eq!(memory.read(FIRST_XML, 12), Err(Status::InvalidAddress));
        assert_eq!(memory.read(2, 4), Err(Status::BadAlignment));
        assert_eq!(memory.read(0xFFFF_FFFC, 536), Err(Status::InvalidAddress));
        assert_eq!(memory.read(0xFFC, 4), Ok(&[0; 4][..]), "reserved words are zero");
        assert_eq!(memory.read(0x1000, 4), Err(Status::InvalidAddress));
    }
}
