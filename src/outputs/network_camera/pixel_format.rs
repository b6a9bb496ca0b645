//! DN images -> bytes of a pixel format.
//!
//! Values are shifted from the detector's depth to the format's: a detector of `b` bits in a format of `f` bits gives
//! `dn << (f - b)` or `dn >> (b - f)`, so that full scale stays full scale and nothing is lost when `f >= b`. Unpacked
//! samples are right-aligned, little-endian. `Mono12Packed` puts two pixels into three bytes: high bytes of the first,
//! both low nibbles (the first in the low one), high byte of the second; an odd last pixel takes two bytes.
//! DN beyond the detector's depth are cut to its full scale. Codes: the pixel format naming convention (PFNC).

/// How pixels travel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelFormat {
    /// 8 bits.
    Mono8,
    /// 10 bits in 16.
    Mono10,
    /// 12 bits in 16.
    Mono12,
    /// 12 bits, two pixels in three bytes.
    Mono12Packed,
    /// 16 bits.
    Mono16,
}

impl PixelFormat {
    /// Every format, with its name.
    pub const NAMED: [(&'static str, Self); 5] = [
        ("Mono8", Self::Mono8),
        ("Mono10", Self::Mono10),
        ("Mono12", Self::Mono12),
        ("Mono12Packed", Self::Mono12Packed),
        ("Mono16", Self::Mono16),
    ];

    /// Its number in registers and packets.
    #[must_use]
    pub const fn code(self) -> u32 {
        match self {
            Self::Mono8 => 0x0108_0001,
            Self::Mono10 => 0x0110_0003,
            Self::Mono12 => 0x0110_0005,
            Self::Mono12Packed => 0x010C_0006,
            Self::Mono16 => 0x0110_0007,
        }
    }

    /// The format of a number.
    #[must_use]
    pub fn from_code(code: u32) -> Option<Self> {
        Self::NAMED.into_iter().map(|(_, format)| format).find(|format| format.code() == code)
    }

    /// The narrowest unpacked format that holds pixels of so many bits.
    #[must_use]
    pub const fn for_bits(bits: u32) -> Self {
        match bits {
            0..=8 => Self::Mono8,
            9..=10 => Self::Mono10,
            11..=12 => Self::Mono12,
            _ => Self::Mono16,
        }
    }

    /// Bits of one sample.
    #[must_use]
    pub const fn bits(self) -> u32 {
        match self {
            Self::Mono8 => 8,
            Self::Mono10 => 10,
            Self::Mono12 | Self::Mono12Packed => 12,
            Self::Mono16 => 16,
        }
    }

    /// Bytes of so many pixels.
    #[must_use]
    pub const fn bytes(self, pixels: usize) -> usize {
        match self {
            Self::Mono8 => pixels,
            Self::Mono12Packed => (pixels * 3).div_ceil(2),
            Self::Mono10 | Self::Mono12 | Self::Mono16 => pixels * 2,
        }
    }
}

/// A DN of `from` bits as a sample of `to` bits.
fn shifted(dn: u16, from: u32, to: u32) -> u16 {
    let dn = u32::from(dn).min((1 << from) - 1);
    let sample = if to >= from { dn << (to - from) } else { dn >> (from - to) };
    // At most 16 bits by construction.
    u16::try_from(sample).unwrap_or(u16::MAX)
}

/// Appends a region of an image. `region` is first column, first row, columns, rows, inside the image.
pub(super) fn append_region(
    format: PixelFormat,
    dn_bits: u32,
    pixels: &[u16],
    width_px: usize,
    region: [usize; 4],
    out: &mut Vec<u8>,
) {
    let [x, y, columns, rows] = region;
    let lines = pixels.chunks_exact(width_px.max(1)).skip(y).take(rows).filter_map(|line| line.get(x..x + columns));
    let sample = |dn: u16| shifted(dn, dn_bits, format.bits());
    match format {
        PixelFormat::Mono8 => {
            lines.for_each(|line| out.extend(line.iter().map(|dn| sample(*dn).to_le_bytes()[0])));
        }
        PixelFormat::Mono12Packed => append_packed(lines.flatten().map(|dn| sample(*dn)), out),
        PixelFormat::Mono10 | PixelFormat::Mono12 | PixelFormat::Mono16 => {
            lines.for_each(|line| append_words(line, sample, out))
        }
    }
}

/// In chunks of fixed length, which compile to wide moves.
fn append_words(line: &[u16], sample: impl Fn(u16) -> u16, out: &mut Vec<u8>) {
    let start = out.len();
    out.resize(start + 2 * line.len(), 0);
    for (bytes, dn) in out[start..].chunks_exact_mut(2).zip(line) {
        bytes.copy_from_slice(&sample(*dn).to_le_bytes());
    }
}

fn append_packed(mut samples: impl Iterator<Item = u16>, out: &mut Vec<u8>) {
    while let Some(first) = samples.next() {
        let [first_high, first_low] = [(first >> 4).to_le_bytes()[0], (first & 0xF).to_le_bytes()[0]];
        match samples.next() {
            Some(second) => {
                let [second_high, second_low] = [(second >> 4).to_le_bytes()[0], (second & 0xF).to_le_bytes()[0]];
                out.extend([first_high, second_low << 4 | first_low, second_high]);
            }
            None => out.extend([first_high, first_low]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn packed(format: PixelFormat, dn_bits: u32, pixels: &[u16]) -> Vec<u8> {
        let mut out = Vec::new();
        append_region(format, dn_bits, pixels, pixels.len(), [0, 0, pixels.len(), 1], &mut out);
        assert_eq!(out.len(), format.bytes(pixels.len()), "{format:?}");
        out
    }

    #[test]
    fn samples_by_hand() {
        assert_eq!(packed(PixelFormat::Mono8, 12, &[0xFFF, 0xABC, 0x00F]), [0xFF, 0xAB, 0x00]);
        assert_eq!(packed(PixelFormat::Mono10, 12, &[0xFFF, 0xABC]), [0xFF, 0x03, 0xAF, 0x02]);
        assert_eq!(packed(PixelFormat::Mono12, 12, &[0xABC]), [0xBC, 0x0A]);
        assert_eq!(packed(PixelFormat::Mono12Packed, 12, &[0xABC, 0x123]), [0xAB, 0x3C, 0x12]);
        assert_eq!(packed(PixelFormat::Mono12Packed, 12, &[0xABC, 0x123, 0x456]), [0xAB, 0x3C, 0x12, 0x45, 0x06]);
        assert_eq!(packed(PixelFormat::Mono16, 16, &[0xABCD]), [0xCD, 0xAB]);
        assert_eq!(packed(PixelFormat::Mono16, 12, &[0xABC]), [0xC0, 0xAB], "shifted up by four");
        assert_eq!(packed(PixelFormat::Mono12, 8, &[0xFFFF]), [0xF0, 0x0F], "beyond full scale is full scale");
    }

    /// Every unpacked format as the table of `firmware_protocol/FRAMES.md` has it.
    #[test]
    fn documented_samples_are_those_sent() {
        let document = include_str!("../../../firmware_protocol/FRAMES.md");
        for (name, format) in PixelFormat::NAMED {
            let start = format!("| {name} | DN");
            let rule = document.lines().find_map(|line| line.strip_prefix(&start)).unwrap();
            let rule = rule.split('|').next().unwrap().trim();
            let documented = match rule.trim_end_matches(", rounded down").trim_end_matches(" (left-aligned)") {
                "" => 0xABC,
                "/ 4" => 0xABC / 4,
                "/ 16" => 0xABC / 16,
                "* 16" => 0xABC * 16,
                other => panic!("{name}: `DN {other}`"),
            };
            assert_eq!(shifted(0xABC, 12, format.bits()), documented, "{name}");
        }
    }

    #[test]
    fn nothing_is_lost_when_the_format_is_as_deep_as_the_detector() {
        for (_, format) in PixelFormat::NAMED {
            for bits in 1..=format.bits() {
                for dn in (0..1_u32 << bits).step_by(7) {
                    let dn = u16::try_from(dn).unwrap();
                    assert_eq!(shifted(dn, bits, format.bits()) >> (format.bits() - bits), dn);
                }
            }
            assert_eq!(PixelFormat::from_code(format.code()), Some(format));
            assert_eq!(
                format.code() >> 16 & 0xFF,
                if format == PixelFormat::Mono12Packed { 12 } else { format.bits().next_multiple_of(8) },
                "PFNC: bits per pixel"
            );
        }
        assert_eq!(PixelFormat::from_code(0x0108_0002), None);
        for bits in 1..=16 {
            assert!(PixelFormat::for_bits(bits).bits() >= bits);
        }
    }

    #[test]
    fn a_region_is_cut_out() {
        let pixels: Vec<u16> = (0..5 * 4).collect();
        let mut out = Vec::new();
        append_region(PixelFormat::Mono8, 8, &pixels, 5, [1, 2, 3, 2], &mut out);
        assert_eq!(out, [11, 12, 13, 16, 17, 18]);
    }
}
