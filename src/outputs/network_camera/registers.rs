//! The device's memory: bootstrap registers, its own features from A000 (`features`), the XML twice. Big-endian words.
//!
//! Reading goes through whole words inside one block of memory; addresses between the blocks are invalid. Reserved
//! words inside a block read as zero. The device writes: it knows the effect of a value.

use crate::network_camera::features::{at, own};
use crate::network_camera::gvcp::Status;
use frames::camera_control::{TriggerOverlap, TriggerSource};

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
