//! CRC-16/IBM-3740 of the wire; CRC-32 of the DBC file.
//!
//! CRC-16/IBM-3740: polynomial 0x1021, start 0xFFFF, not reflected, no final inversion; check value 0x29B1.
//!
//! Every error of up to 3 bits in up to 4093 bytes is detected, and every burst of up to 16 bits in the order in which
//! the CRC takes them: the highest bit of a byte first, the CRC last, its high byte first. The wire has its low byte
//! first, and in ATT_FD before the values: there one in 700 000 of these bursts passes, all of them of 13 bits and
//! more.

const POLYNOMIAL: u16 = 0x1021;
const START: u16 = 0xFFFF;

const TABLE: [u16; 256] = table();

/// A CRC under way.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Crc16(u16);

/// Returns the CRC of one run of bytes.
pub fn crc16(bytes: &[u8]) -> u16 {
    Crc16::new().over(bytes).value()
}

impl Crc16 {
    /// Returns the state before the first byte.
    pub const fn new() -> Self {
        Self(START)
    }

    /// Returns the state after a run with this CRC.
    pub const fn from_value(value: u16) -> Self {
        Self(value)
    }

    /// Returns the state after further bytes.
    #[must_use]
    pub fn over(self, bytes: &[u8]) -> Self {
        Self(bytes.iter().fold(self.0, |crc, byte| {
            let [high, low] = crc.to_be_bytes();
            let remainder = TABLE.get(usize::from(high ^ byte)).copied().unwrap_or(0);
            (u16::from(low) << 8) ^ remainder
        }))
    }

    /// Returns the CRC.
    pub const fn value(self) -> u16 {
        self.0
    }
}

impl Default for Crc16 {
    fn default() -> Self {
        Self::new()
    }
}

/// Returns the CRC-32/ISO-HDLC of the DBC file, bit by bit, at compile time.
#[allow(clippy::indexing_slicing, reason = "evaluated at compile time, where an index out of bounds is an error")]
pub(crate) const fn crc32(bytes: &[u8]) -> u32 {
    let mut crc = u32::MAX;
    let mut at = 0;
    while at < bytes.len() {
        crc ^= bytes[at] as u32;
        let mut bit = 0;
        while bit < 8 {
            crc = if crc & 1 == 0 { crc >> 1 } else { (crc >> 1) ^ 0xEDB8_8320 };
            bit += 1;
        }
        at += 1;
    }
    !crc
}

const fn remainder(byte: u16) -> u16 {
    let mut crc = byte << 8;
    let mut bit = 0;
    while bit < 8 {
        crc = if crc & 0x8000 == 0 { crc << 1 } else { (crc << 1) ^ POLYNOMIAL };
        bit += 1;
    }
    crc
}

#[allow(clippy::indexing_slicing, reason = "evaluated at compile time, where an index out of bounds is an error")]
const fn table() -> [u16; 256] {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        table[byte as usize] = remainder(byte);
        byte += 1;
    }
    table
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn check_value() {
        assert_eq!(crc16(b"123456789"), 0x29B1);
        assert_eq!(Crc16::new().over(b"1234").over(b"56789").value(), 0x29B1, "in two runs");
        assert_ne!(crc16(b"123456798"), 0x29B1, "the order of bytes counts");
        assert_eq!(crc16(b""), 0xFFFF);
    }

    /// Returns the change of the remainder by each flipped bit of six bytes and of the CRC after them. More bytes add
    /// no kind of burst: one further from the end is detected as one of these, shifted.
    fn syndromes(is_high_byte_first: bool) -> [u16; 64] {
        let (zeros, undamaged) = ([0; 6], crc16(&[0; 6]));
        core::array::from_fn(|bit| {
            let (byte, mask) = (bit / 8, 0x80_u8 >> (bit % 8));
            let mut damaged = zeros;
            if let Some(slot) = damaged.get_mut(byte) {
                *slot = mask;
                return crc16(&damaged) ^ undamaged;
            }
            if (byte == 6) == is_high_byte_first { u16::from(mask) << 8 } else { u16::from(mask) }
        })
    }

    /// Bursts of up to 16 bits that leave the remainder as it is: each pattern that begins and ends with a flipped bit.
    fn undetected_bursts(syndromes: &[u16]) -> usize {
        let of_burst = |bits: &[u16], pattern: u16| {
            let is_flipped = |place: &usize| pattern >> place & 1 != 0;
            bits.iter().take(16).enumerate().filter(|(place, _)| is_flipped(place)).fold(0, |sum, (_, bit)| sum ^ bit)
        };
        // Without the bits of a burst that lie beyond the end; the lowest bit of a pattern is its first.
        let patterns_at =
            |begin: usize| (1..=u16::MAX).step_by(2).filter(move |p| 16 - p.leading_zeros() as usize <= 64 - begin);
        (0..syndromes.len())
            .map(|begin| patterns_at(begin).filter(|p| of_burst(&syndromes[begin..], *p) == 0).count())
            .sum()
    }

    #[test]
    fn every_burst_is_detected_in_the_order_of_the_crc() {
        assert_eq!(undetected_bursts(&syndromes(true)), 0);
        assert_eq!(undetected_bursts(&syndromes(false)), 12, "the wire has the low byte first");
    }

    #[test]
    fn check_value_of_the_crc_32() {
        assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
        assert_ne!(crc32(b"123456798"), 0xCBF4_3926, "the order of bytes counts");
        assert_eq!(crc32(b""), 0);
    }
}
