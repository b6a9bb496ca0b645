//! The device's memory: bootstrap registers, its own features from A000, the XML twice. Big-endian words.
//!
//! Reading goes through whole words inside one block of memory; addresses between the blocks are invalid. Reserved
//! words inside a block read as zero. The device writes: it knows the effect of a value.

use crate::network_camera::gvcp::Status;
use frames::camera_control::{TriggerOverlap, TriggerSource};

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
    /// The first address behind them.
    pub(in crate::network_camera) const END: u32 = 0xA110;
}

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
