//! The stuff bits that a frame's own bits ask for: after five equal bits on the wire, one of the other kind.
//!
//! Source: ISO 11898-1:2015, 10.5 (stuffing) and 10.4.2.6 (CRC); the CRC-15 of classic frames is itself stuffed. Of FD
//! frames, the CRC field has stuff bits in fixed places, which `timing` adds. The tests below build the same frames as
//! text, bit by bit.

use firmware_protocol::can::{CanFrame, CanId};

/// Stuff bits of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Stuffing {
    /// The most that a frame of its length can have, as for a budget.
    #[default]
    Worst,
    /// The exact number for its bits.
    Exact,
}

/// x^15 + x^14 + x^10 + x^8 + x^7 + x^4 + x^3 + 1.
const CRC_15: u16 = 0x4599;
/// Equal bits before a stuff bit.
const RUN: u32 = 5;

/// Counts stuff bits as bits go by.
struct Stuffer {
    last: Option<bool>,
    run: u32,
    stuffed: u64,
    crc: u16,
}

impl Stuffer {
    fn new() -> Self {
        Self { last: None, run: 0, stuffed: 0, crc: 0 }
    }

    fn bit(&mut self, bit: bool) {
        let feedback = bit != (self.crc & 0x4000 != 0);
        self.crc = (self.crc << 1) & 0x7FFF;
        if feedback {
            self.crc ^= CRC_15;
        }
        // The stuff bit itself begins the next run.
        if self.run == RUN {
            self.stuffed += 1;
            self.run = 1;
            self.last = self.last.map(|last| !last);
        }
        self.run = if self.last == Some(bit) { self.run + 1 } else { 1 };
        self.last = Some(bit);
    }

    /// Adds the low `count` bits of `value`, the highest first.
    fn bits(&mut self, value: u32, count: u32) {
        (0..count).rev().for_each(|place| self.bit(value >> place & 1 != 0));
    }

    /// Adds an identifier: 11 bits; of one with 29 then SRR and IDE, both recessive, and the other 18.
    fn identifier(&mut self, id: CanId) {
        let (first, rest) = id.parts();
        self.bits(first.into(), 11);
        if id.is_extended() {
            self.bits(0b11, 2);
            self.bits(rest, 18);
        }
    }

    fn bytes(&mut self, bytes: &[u8]) {
        bytes.iter().for_each(|byte| self.bits(u32::from(*byte), 8));
    }
}

/// Returns the stuff bits of a classic frame.
pub(super) fn classic(frame: &CanFrame) -> u64 {
    let mut wire = Stuffer::new();
    // Start of frame, identifier; RTR, IDE and r0, or RTR, r1 and r0 after 29 bits; length, data.
    wire.bits(0, 1);
    wire.identifier(frame.id());
    wire.bits(0, 3);
    wire.bits(length_code(frame.data().len()), 4);
    wire.bytes(frame.data());
    let crc = wire.crc;
    wire.bits(crc.into(), 15);
    // Five equal bits at the very end are followed by a stuff bit too.
    wire.stuffed + u64::from(wire.run == RUN)
}

/// Returns the stuff bits of an FD frame with bit rate switching: up to the switch, and from there to the CRC field.
///
/// Five equal bits at the end of the data have no stuff bit of their own: the CRC field begins with a fixed one.
pub(super) fn fd(frame: &CanFrame) -> (u64, u64) {
    let mut wire = Stuffer::new();
    // Start of frame, identifier; RRS and IDE dominant, or RRS alone after 29 bits; FDF recessive, a reserved bit, BRS
    // recessive.
    wire.bits(0, 1);
    wire.identifier(frame.id());
    wire.bits(0b00101, if frame.id().is_extended() { 4 } else { 5 });
    let head = wire.stuffed;
    // ESI dominant: error active.
    wire.bits(0, 1);
    wire.bits(length_code(frame.data().len()), 4);
    wire.bytes(frame.data());
    (head, wire.stuffed - head)
}

/// Returns the 4 bits that say a length.
fn length_code(len: usize) -> u32 {
    match len {
        0..=8 => u32::try_from(len).unwrap_or(0),
        9..=12 => 9,
        13..=16 => 10,
        17..=20 => 11,
        21..=24 => 12,
        25..=32 => 13,
        33..=48 => 14,
        _ => 15,
    }
}

#[cfg(test)]
#[path = "stuffing_tests.rs"]
mod tests;
