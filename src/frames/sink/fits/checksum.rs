//! Checksums of a FITS file: `DATASUM` and `CHECKSUM`.
//!
//! Source: FITS standard 4.0, section 4.4.2.7 and appendix J (Seaman, Pence and Rots): the ones' complement sum of all
//! 32-bit words; the header's is written as 16 characters that make the sum of the whole file minus zero.

/// Characters of `CHECKSUM` while the sum is taken.
pub(super) const NO_CHECKSUM: &str = "0000000000000000";

/// A ones' complement sum of big-endian 32-bit words; every call but the last takes whole words.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Sum32(u64);

impl Sum32 {
    /// Adds bytes; missing bytes of the last word count as zero.
    pub(super) fn add(&mut self, bytes: &[u8]) {
        let (words, rest) = bytes.as_chunks::<4>();
        self.0 += words.iter().map(|word| u64::from(u32::from_be_bytes(*word))).sum::<u64>();
        let mut last = [0; 4];
        last[..rest.len()].copy_from_slice(rest);
        self.0 += u64::from(u32::from_be_bytes(last));
        self.0 = u64::from(self.value());
    }

    /// Returns the sum with its carries added.
    pub(super) fn value(self) -> u32 {
        let mut sum = self.0;
        while sum > u64::from(u32::MAX) {
            sum = (sum & u64::from(u32::MAX)) + (sum >> 32);
        }
        u32::try_from(sum).unwrap_or(u32::MAX)
    }
}

/// Returns the characters of the complement of `sum`: letters and digits, four for each byte, turned by one place, as
/// the value of a card begins in the last byte of a word.
pub(super) fn encoded(sum: u32) -> String {
    let mut text = [0_u8; 16];
    for (place, byte) in (!sum).to_be_bytes().into_iter().enumerate() {
        let mut four = [byte / 4 + b'0'; 4];
        four[0] += byte % 4;
        while four.iter().any(|c| !c.is_ascii_alphanumeric()) {
            for pair in [0, 2] {
                if !(four[pair].is_ascii_alphanumeric() && four[pair + 1].is_ascii_alphanumeric()) {
                    four[pair] += 1;
                    four[pair + 1] -= 1;
                }
            }
        }
        (0..4).for_each(|i| text[4 * i + place] = four[i]);
    }
    text.rotate_right(1);
    text.iter().map(|c| char::from(*c)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sums_carry_around() {
        let mut sum = Sum32::default();
        sum.add(&[0xFF, 0xFF, 0xFF, 0xFF, 0, 0, 0, 1]);
        assert_eq!(sum.value(), 1, "ones' complement: minus zero and one are one");
        sum.add(&[0x80]);
        assert_eq!(sum.value(), 0x8000_0001, "a part of a word counts from its high end");
    }

    #[test]
    fn the_standards_example_is_encoded_as_printed() {
        // FITS standard 4.0, appendix J: the checksum 868229149 is encoded as hcHjjc9ghcEghc9g.
        assert_eq!(encoded(868_229_149), "hcHjjc9ghcEghc9g");
        assert_eq!(encoded(u32::MAX), NO_CHECKSUM, "the sum minus zero");
    }
}
