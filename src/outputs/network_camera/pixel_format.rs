//! DN images -> bytes of a pixel format.
//!
//! Values are shifted from the detector's depth to the format's: a detector of `b` bits in a format of `f` bits gives
//! `dn << (f - b)` or `dn >> (b - f)`, so that full scale stays full scale and nothing is lost when `f >= b`. DN beyond
//! the detector's depth are cut to its full scale. Codes: the pixel format naming convention (PFNC).
//!
//! * Unpacked samples are right-aligned, little-endian.
//! * `...Packed` (GigE Vision) puts two pixels into three bytes: high bits of the first, the low bits of both (the first in
//!   the low half), high bits of the second; an odd last pixel takes two bytes.
//! * `...p` (PFNC) is one stream of bits, the lowest bit of a sample first, without gaps between samples or lines; the last
//!   byte is filled up with zeros.
//!
//! A sensor with a colour filter array sends the same bytes under another name and code: `BayerRG12` for `Mono12` of
//! red and green in the first row. The letters are the colours of the image's first two pixels.

use base::bayer::BayerPattern;
use core::iter::repeat_n;
use frames::camera_control::Region;

/// How pixels travel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PixelFormat {
    /// 8 bits.
    Mono8,
    /// 10 bits in 16.
    Mono10,
    /// 10 bits, two pixels in three bytes.
    Mono10Packed,
    /// 10 bits without gaps.
    Mono10p,
    /// 12 bits in 16.
    Mono12,
    /// 12 bits, two pixels in three bytes.
    Mono12Packed,
    /// 12 bits without gaps.
    Mono12p,
    /// 14 bits in 16.
    Mono14,
    /// 14 bits without gaps.
    Mono14p,
    /// 16 bits.
    Mono16,
}

/// How samples lie in memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Layout {
    Bytes,
    Words,
    PairsInThreeBytes,
    BitStream,
}

impl PixelFormat {
    /// Every format, with its name.
    pub const NAMED: [(&'static str, Self); 10] = [
        ("Mono8", Self::Mono8),
        ("Mono10", Self::Mono10),
        ("Mono10Packed", Self::Mono10Packed),
        ("Mono10p", Self::Mono10p),
        ("Mono12", Self::Mono12),
        ("Mono12Packed", Self::Mono12Packed),
        ("Mono12p", Self::Mono12p),
        ("Mono14", Self::Mono14),
        ("Mono14p", Self::Mono14p),
        ("Mono16", Self::Mono16),
    ];

    /// Returns code, bits of one sample, and layout.
    const fn row(self) -> (u32, u32, Layout) {
        match self {
            Self::Mono8 => (0x0108_0001, 8, Layout::Bytes),
            Self::Mono10 => (0x0110_0003, 10, Layout::Words),
            Self::Mono10Packed => (0x010C_0004, 10, Layout::PairsInThreeBytes),
            Self::Mono10p => (0x010A_0046, 10, Layout::BitStream),
            Self::Mono12 => (0x0110_0005, 12, Layout::Words),
            Self::Mono12Packed => (0x010C_0006, 12, Layout::PairsInThreeBytes),
            Self::Mono12p => (0x010C_0047, 12, Layout::BitStream),
            Self::Mono14 => (0x0110_0025, 14, Layout::Words),
            Self::Mono14p => (0x010E_0104, 14, Layout::BitStream),
            Self::Mono16 => (0x0110_0007, 16, Layout::Words),
        }
    }

    /// Returns its number in registers and packets, of a sensor with these colours or none.
    pub const fn code(self, colours: Option<BayerPattern>) -> u32 {
        match colours {
            None => self.row().0,
            Some(pattern) => self.coloured(pattern),
        }
    }

    const fn coloured(self, pattern: BayerPattern) -> u32 {
        // The codes follow each other, in one order where samples have gaps or pairs, in another for streams of bits.
        let (place, place_in_stream) = match pattern {
            BayerPattern::Grbg => (0, 4),
            BayerPattern::Rggb => (1, 6),
            BayerPattern::Gbrg => (2, 2),
            BayerPattern::Bggr => (3, 0),
        };
        match self {
            Self::Mono8 => 0x0108_0008 + place,
            Self::Mono10 => 0x0110_000C + place,
            Self::Mono10Packed => 0x010C_0026 + place,
            Self::Mono10p => 0x010A_0052 + place_in_stream,
            Self::Mono12 => 0x0110_0010 + place,
            Self::Mono12Packed => 0x010C_002A + place,
            Self::Mono12p => 0x010C_0053 + place_in_stream,
            Self::Mono14 => 0x0110_0109 + place,
            Self::Mono14p => 0x010E_0105 + place,
            Self::Mono16 => 0x0110_002E + place,
        }
    }

    /// Returns the format of a number, of a sensor with these colours or none.
    pub fn from_code(code: u32, colours: Option<BayerPattern>) -> Option<Self> {
        Self::NAMED.into_iter().map(|(_, format)| format).find(|format| format.code(colours) == code)
    }

    /// Returns every format with its name, of a sensor with these colours or none.
    pub(super) fn named(colours: Option<BayerPattern>) -> impl Iterator<Item = (String, Self)> {
        let name = move |(mono, format): (&str, Self)| {
            let letters = colours.map(|pattern| &pattern.name()[..2]);
            (
                letters.map_or_else(|| mono.to_owned(), |letters| mono.replace("Mono", &format!("Bayer{letters}"))),
                format,
            )
        };
        Self::NAMED.into_iter().map(name)
    }

    /// Returns the narrowest unpacked format that holds pixels of so many bits.
    pub const fn for_bits(bits: u32) -> Self {
        match bits {
            0..=8 => Self::Mono8,
            9..=10 => Self::Mono10,
            11..=12 => Self::Mono12,
            13..=14 => Self::Mono14,
            _ => Self::Mono16,
        }
    }

    /// Returns bits of one sample.
    pub const fn bits(self) -> u32 {
        self.row().1
    }

    /// Returns bytes of so many pixels.
    pub const fn bytes(self, pixels: usize) -> usize {
        match self.row().2 {
            Layout::Bytes => pixels,
            Layout::Words => pixels * 2,
            Layout::PairsInThreeBytes => (pixels * 3).div_ceil(2),
            Layout::BitStream => (pixels * self.bits() as usize).div_ceil(8),
        }
    }
}

/// Returns a DN of `from` bits as a sample of `to` bits.
fn shifted(dn: u16, from: u32, to: u32) -> u16 {
    let dn = u32::from(dn).min((1 << from) - 1);
    let sample = if to >= from { dn << (to - from) } else { dn >> (from - to) };
    // At most 16 bits by construction.
    u16::try_from(sample).unwrap_or(u16::MAX)
}

/// Appends regions of an image, one below the other; lines that are shorter than the longest end with zeros. The
/// regions lie inside the image.
pub(super) fn append_regions(
    format: PixelFormat,
    dn_bits: u32,
    pixels: &[u16],
    width_px: usize,
    regions: &[Region],
    out: &mut Vec<u8>,
) {
    let longest = regions.iter().map(|region| region.width_px).max().unwrap_or(0);
    // Each line with the zeros behind it.
    let lines = regions.iter().flat_map(|region| {
        let [x, y, columns, rows] =
            [region.left_px, region.top_px, region.width_px, region.height_px].map(|v| v as usize);
        let zeros = (longest - region.width_px) as usize;
        let rows = pixels.chunks_exact(width_px.max(1)).skip(y).take(rows);
        rows.filter_map(move |line| Some((line.get(x..x + columns)?, zeros)))
    });
    let (_, bits, layout) = format.row();
    let sample = |dn: u16| shifted(dn, dn_bits, bits);
    let samples = || {
        let lines = lines.clone();
        lines.flat_map(move |(line, zeros)| line.iter().map(move |dn| sample(*dn)).chain(repeat_n(0, zeros)))
    };
    match layout {
        Layout::Bytes => lines.for_each(|(line, zeros)| {
            out.extend(line.iter().map(|dn| sample(*dn).to_le_bytes()[0]));
            out.extend(repeat_n(0, zeros));
        }),
        Layout::Words => lines.for_each(|(line, zeros)| {
            append_words(line, sample, out);
            out.extend(repeat_n(0, 2 * zeros));
        }),
        Layout::PairsInThreeBytes => append_pairs(samples(), bits - 8, out),
        Layout::BitStream => append_bits(samples(), bits, out),
    }
}

/// Appends words in chunks of fixed length, which compile to wide moves.
fn append_words(line: &[u16], sample: impl Fn(u16) -> u16, out: &mut Vec<u8>) {
    let start = out.len();
    out.resize(start + 2 * line.len(), 0);
    for (bytes, dn) in out[start..].chunks_exact_mut(2).zip(line) {
        bytes.copy_from_slice(&sample(*dn).to_le_bytes());
    }
}

/// Pairs of samples with so many bits below their highest eight.
fn append_pairs(mut samples: impl Iterator<Item = u16>, low_bits: u32, out: &mut Vec<u8>) {
    let halves = |sample: u16| [sample >> low_bits, sample & ((1 << low_bits) - 1)].map(|half| half.to_le_bytes()[0]);
    while let Some(first) = samples.next() {
        let [first_high, first_low] = halves(first);
        match samples.next().map(halves) {
            Some([second_high, second_low]) => out.extend([first_high, second_low << 4 | first_low, second_high]),
            None => out.extend([first_high, first_low]),
        }
    }
}

/// Appends a stream of bits, the lowest first.
fn append_bits(samples: impl Iterator<Item = u16>, bits: u32, out: &mut Vec<u8>) {
    let (mut waiting, mut count) = (0_u32, 0);
    for sample in samples {
        waiting |= u32::from(sample) << count;
        count += bits;
        while count >= 8 {
            out.push(waiting.to_le_bytes()[0]);
            (waiting, count) = (waiting >> 8, count - 8);
        }
    }
    if count > 0 {
        out.push(waiting.to_le_bytes()[0]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn region([left_px, top_px, width_px, height_px]: [usize; 4]) -> Region {
        let [left_px, top_px, width_px, height_px] =
            [left_px, top_px, width_px, height_px].map(|v| u32::try_from(v).unwrap());
        Region { left_px, top_px, width_px, height_px }
    }

    fn packed(format: PixelFormat, dn_bits: u32, pixels: &[u16]) -> Vec<u8> {
        let mut out = Vec::new();
        append_regions(format, dn_bits, pixels, pixels.len(), &[region([0, 0, pixels.len(), 1])], &mut out);
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
        assert_eq!(packed(PixelFormat::Mono10Packed, 10, &[0x2AB, 0x155]), [0xAA, 0x13, 0x55]);
        assert_eq!(packed(PixelFormat::Mono10p, 10, &[0x2AB, 0x155, 0x3FF, 0x001]), [0xAB, 0x56, 0xF5, 0x7F, 0x00]);
        assert_eq!(packed(PixelFormat::Mono10p, 10, &[0x2AB]), [0xAB, 0x02]);
        assert_eq!(packed(PixelFormat::Mono12p, 12, &[0xABC, 0x123]), [0xBC, 0x3A, 0x12]);
        assert_eq!(packed(PixelFormat::Mono12p, 12, &[0xABC]), [0xBC, 0x0A]);
        assert_eq!(packed(PixelFormat::Mono14, 14, &[0x2ABC]), [0xBC, 0x2A]);
        assert_eq!(packed(PixelFormat::Mono14p, 14, &[0x2ABC, 0x1234]), [0xBC, 0x2A, 0x8D, 0x04]);
        assert_eq!(packed(PixelFormat::Mono16, 16, &[0xABCD]), [0xCD, 0xAB]);
        assert_eq!(packed(PixelFormat::Mono16, 12, &[0xABC]), [0xC0, 0xAB], "shifted up by four");
        assert_eq!(packed(PixelFormat::Mono12, 8, &[0xFFFF]), [0xF0, 0x0F], "beyond full scale is full scale");
    }

    /// Checks every unpacked format against the table of `firmware_protocol/FRAMES.md`.
    #[test]
    fn documented_samples_are_those_sent() {
        let document = include_str!("../../../firmware_protocol/FRAMES.md");
        for (name, format) in PixelFormat::NAMED {
            let start = format!("| {name} | DN");
            let rule = document.lines().find_map(|line| line.strip_prefix(&start)).unwrap();
            let rule = rule.split('|').next().unwrap().trim();
            let documented = match rule.trim_end_matches(", rounded down").trim_end_matches(" (left-aligned)") {
                "" => 0xABC,
                "* 4" => 0xABC * 4,
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
            for colours in [None].into_iter().chain(BayerPattern::NAMED.map(|(_, pattern)| Some(pattern))) {
                let code = format.code(colours);
                assert_eq!(PixelFormat::from_code(code, colours), Some(format));
                let bits = usize::try_from(code >> 16 & 0xFF).unwrap();
                assert_eq!(format.bytes(80), 10 * bits, "PFNC: bits per pixel");
            }
        }
        assert_eq!(PixelFormat::from_code(0x0108_0002, None), None);
        assert_eq!(PixelFormat::from_code(0x0108_0001, Some(BayerPattern::Rggb)), None, "a sensor with colours");
        for bits in 1..=16 {
            assert!(PixelFormat::for_bits(bits).bits() >= bits);
        }
    }

    /// Checks some codes of the pixel format naming convention.
    #[test]
    fn coloured_formats_have_their_names_and_codes() {
        let code = |wanted: &str| {
            let all = BayerPattern::NAMED.into_iter().flat_map(|(_, pattern)| {
                PixelFormat::named(Some(pattern)).map(move |(name, format)| (name, format.code(Some(pattern))))
            });
            all.into_iter().find(|(name, _)| name == wanted).unwrap().1
        };
        for (name, wanted) in [
            ("BayerRG8", 0x0108_0009),
            ("BayerBG8", 0x0108_000B),
            ("BayerGB10", 0x0110_000E),
            ("BayerRG12", 0x0110_0011),
            ("BayerRG12Packed", 0x010C_002B),
            ("BayerBG12p", 0x010C_0053),
            ("BayerGB10p", 0x010A_0054),
            ("BayerGR12p", 0x010C_0057),
            ("BayerRG10p", 0x010A_0058),
            ("BayerRG14p", 0x010E_0106),
            ("BayerRG16", 0x0110_002F),
        ] {
            assert_eq!(code(name), wanted, "{name}");
        }
    }

    #[test]
    fn a_region_is_cut_out() {
        let pixels: Vec<u16> = (0..5 * 4).collect();
        let mut out = Vec::new();
        append_regions(PixelFormat::Mono8, 8, &pixels, 5, &[region([1, 2, 3, 2])], &mut out);
        assert_eq!(out, [11, 12, 13, 16, 17, 18]);
        out.clear();
        append_regions(PixelFormat::Mono10p, 10, &pixels, 5, &[region([1, 2, 3, 2])], &mut out);
        assert_eq!(out.len(), PixelFormat::Mono10p.bytes(6), "lines follow each other without a gap");
        let two = [region([3, 1, 1, 2]), region([0, 0, 2, 1])];
        let wanted = [8, 0, 13, 0, 0, 1];
        for (_, format) in PixelFormat::NAMED {
            let [mut got, mut alone] = [Vec::new(), Vec::new()];
            append_regions(format, 8, &pixels, 5, &two, &mut got);
            append_regions(format, 8, &wanted, 2, &[region([0, 0, 2, 3])], &mut alone);
            assert_eq!(got, alone, "{format:?}: one below the other, filled up with zeros");
        }
    }
}
