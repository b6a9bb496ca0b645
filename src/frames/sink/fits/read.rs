//! Reads the files of the writer: a primary image of two axes, 16-bit unsigned or IEEE floats.

use super::card::{CARD_BYTES, Card, Header, Value, end_card};
use super::image::BZERO_U16;
use super::{BLOCK_BYTES, Pixels};
use crate::sink::SinkError;
use std::io::Read;

/// Headers longer than this are taken for damage.
const MAX_HEADER_BLOCKS: usize = 64;

/// An image as read from a file.
#[derive(Debug, Clone, PartialEq)]
pub struct FitsImage {
    /// Columns.
    pub width: usize,
    /// Rows.
    pub height: usize,
    /// The pixels, in the order of the file.
    pub pixels: OwnedPixels,
    /// Every card but `END`.
    pub header: Header,
}

/// Pixels of an image that was read, row by row.
#[derive(Debug, Clone, PartialEq)]
pub enum OwnedPixels {
    /// Unsigned 16-bit.
    U16(Vec<u16>),
    /// Single precision.
    F32(Vec<f32>),
    /// Double precision.
    F64(Vec<f64>),
}

impl OwnedPixels {
    /// Returns the same pixels, borrowed.
    #[must_use]
    pub fn as_pixels(&self) -> Pixels<'_> {
        match self {
            Self::U16(p) => Pixels::U16(p),
            Self::F32(p) => Pixels::F32(p),
            Self::F64(p) => Pixels::F64(p),
        }
    }
}

impl FitsImage {
    /// Reads one image; see [`read_image`].
    ///
    /// # Errors
    /// [`SinkError::BadFits`] when the input ends early or is not an image of a kind listed above.
    pub fn read(input: impl Read) -> Result<Self, SinkError> {
        read_image(input)
    }

    /// Returns the pixels as numbers, the top row first: that is the first one of the file, unless it says
    /// `ROWORDER = 'BOTTOM-UP'`.
    #[must_use]
    pub fn top_row_first(&self) -> Vec<f64> {
        let pixels: Vec<f64> = match &self.pixels {
            OwnedPixels::U16(pixels) => pixels.iter().map(|value| f64::from(*value)).collect(),
            OwnedPixels::F32(pixels) => pixels.iter().map(|value| f64::from(*value)).collect(),
            OwnedPixels::F64(pixels) => pixels.clone(),
        };
        if self.header.text("ROWORDER").is_some_and(|order| order.trim() == "BOTTOM-UP") {
            return pixels.rchunks_exact(self.width.max(1)).flatten().copied().collect();
        }
        pixels
    }
}

/// Reads one image; never allocates more than the input holds.
///
/// # Errors
/// [`SinkError::BadFits`] when the input ends early or is not an image of a kind listed above.
pub fn read_image(mut input: impl Read) -> Result<FitsImage, SinkError> {
    let header = read_header(&mut input)?;
    if header.get("SIMPLE") != Some(true.into()) {
        return Err(bad("SIMPLE", "T", &header));
    }
    if header.integer("NAXIS") != Some(2) {
        return Err(bad("NAXIS", "2 axes", &header));
    }
    let (width, height) = (axis(&header, "NAXIS1")?, axis(&header, "NAXIS2")?);
    let pixels = match header.integer("BITPIX") {
        Some(16) => OwnedPixels::U16(read_unsigned(input, width, height, &header)?),
        Some(-32) => OwnedPixels::F32(read_pixels(input, width, height, f32::from_be_bytes)?),
        Some(-64) => OwnedPixels::F64(read_pixels(input, width, height, f64::from_be_bytes)?),
        _ => return Err(bad("BITPIX", "16, -32 or -64", &header)),
    };
    Ok(FitsImage { width, height, pixels, header })
}

fn bad(keyword: &'static str, wanted: &'static str, header: &Header) -> SinkError {
    SinkError::BadFits {
        what: keyword,
        wanted,
        got: header.get(keyword).map_or_else(|| "no such card".into(), value_text),
    }
}

fn ended(what: &'static str, source: &std::io::Error) -> SinkError {
    SinkError::BadFits { what, wanted: "more bytes", got: end_or(source) }
}

/// Returns a card's value as the file has it.
fn value_text(value: Value<'_>) -> String {
    match value {
        Value::Undefined => "no value".into(),
        Value::Logical(flag) => if flag { "T" } else { "F" }.into(),
        Value::Integer(number) => number.to_string(),
        Value::Real(number) => number.to_string(),
        Value::Text(text) => format!("'{text}'"),
    }
}

/// Returns what was found where bytes were wanted.
fn end_or(source: &std::io::Error) -> String {
    if source.kind() == std::io::ErrorKind::UnexpectedEof { "the end of the file".into() } else { source.to_string() }
}

fn axis(header: &Header, keyword: &'static str) -> Result<usize, SinkError> {
    let length = header.integer(keyword).and_then(|n| usize::try_from(n).ok());
    length.ok_or_else(|| bad(keyword, "a length in pixels", header))
}

fn read_header(input: &mut impl Read) -> Result<Header, SinkError> {
    let mut header = Header::default();
    let mut block = [0; BLOCK_BYTES];
    for _ in 0..MAX_HEADER_BLOCKS {
        input.read_exact(&mut block).map_err(|e| ended("header", &e))?;
        for bytes in block.chunks_exact(CARD_BYTES) {
            let mut card: Card = [0; CARD_BYTES];
            card.copy_from_slice(bytes);
            if card == end_card() {
                return Ok(header);
            }
            header.push_card(card);
        }
    }
    Err(SinkError::BadFits { what: "header", wanted: "an END card", got: format!("{MAX_HEADER_BLOCKS} blocks") })
}

fn read_unsigned(input: impl Read, width: usize, height: usize, header: &Header) -> Result<Vec<u16>, SinkError> {
    if header.real("BZERO") != Some(f64::from(BZERO_U16)) {
        return Err(bad("BZERO", "32768 (unsigned pixels)", header));
    }
    read_pixels(input, width, height, |bytes| u16::from_be_bytes(bytes) ^ BZERO_U16)
}

fn read_pixels<T, const N: usize>(
    input: impl Read,
    width: usize,
    height: usize,
    native: impl Fn([u8; N]) -> T,
) -> Result<Vec<T>, SinkError> {
    let size = || SinkError::BadFits { what: "size", wanted: "an image in memory", got: format!("{width} x {height}") };
    let wanted = width.checked_mul(height).and_then(|n| n.checked_mul(N)).ok_or_else(size)?;
    let mut bytes = Vec::new();
    input.take(wanted as u64).read_to_end(&mut bytes).map_err(|e| ended("pixels", &e))?;
    if bytes.len() != wanted {
        let got = format!("{} of {wanted} bytes", bytes.len());
        return Err(SinkError::BadFits { what: "pixels", wanted: "all rows", got });
    }
    let mut word = [0; N];
    let pixel = |b: &[u8]| {
        word.copy_from_slice(b);
        native(word)
    };
    Ok(bytes.chunks_exact(N).map(pixel).collect())
}

#[cfg(test)]
mod tests {
    use super::super::write_image;
    use super::*;
    use proptest::prelude::*;

    fn written(width: usize, height: usize, pixels: Pixels<'_>) -> Vec<u8> {
        let mut header = Header::default();
        header.push("SEED", u64::MAX, "seed");
        let mut bytes = Vec::new();
        write_image(&mut bytes, width, height, pixels, &header).unwrap();
        bytes
    }

    proptest! {
        #[test]
        fn images_read_back_bit_by_bit(width in 1..40_usize, height in 1..40_usize, seed in any::<u32>()) {
            let word = |i: usize| (i as u32).wrapping_mul(2_654_435_761) ^ seed;
            let u: Vec<u16> = (0..width * height).map(|i| (word(i) >> 8) as u16).collect();
            let f: Vec<f32> = u.iter().map(|&v| f32::from(v) * 0.1 - 3.0).collect();
            let d: Vec<f64> = u.iter().map(|&v| f64::from(v) / 3.0).collect();
            for pixels in [Pixels::U16(&u), Pixels::F32(&f), Pixels::F64(&d)] {
                let image = read_image(written(width, height, pixels).as_slice()).unwrap();
                prop_assert_eq!(image.pixels.as_pixels(), pixels);
                prop_assert_eq!((image.width, image.height), (width, height));
                prop_assert_eq!(image.header.integer("SEED"), Some(u64::MAX.into()));
            }
        }

        #[test]
        fn damaged_files_are_errors_not_panics(at in 0..5760_usize, byte in any::<u8>(), cut in 0..5760_usize) {
            let mut bytes = written(5, 5, Pixels::U16(&[9; 25]));
            bytes[at] = byte;
            let _ = read_image(bytes.as_slice()); // any result is right, but no panic
            let short = read_image(&bytes[..cut.min(BLOCK_BYTES + 49)]);
            prop_assert!(short.is_err(), "a file cut short must be refused");
        }
    }

    #[test]
    fn the_top_row_comes_first_whatever_the_order_in_the_file() {
        for (order, wanted) in [
            (None, [1, 2, 3, 4, 5, 6]),
            (Some("TOP-DOWN"), [1, 2, 3, 4, 5, 6]),
            (Some("BOTTOM-UP"), [5, 6, 3, 4, 1, 2]),
        ] {
            let mut header = Header::default();
            order.iter().for_each(|order| header.push("ROWORDER", *order, "order of rows"));
            let (u, mut bytes) = ([1, 2, 3, 4, 5, 6], Vec::new());
            let (f, d) = (u.map(f32::from), u.map(f64::from));
            for pixels in [Pixels::U16(&u), Pixels::F32(&f), Pixels::F64(&d)] {
                bytes.clear();
                write_image(&mut bytes, 2, 3, pixels, &header).unwrap();
                let image = read_image(bytes.as_slice()).unwrap();
                assert_eq!(image.top_row_first(), wanted.map(f64::from), "{order:?}");
                assert_eq!(image.pixels.as_pixels(), pixels, "the file's own order stays");
            }
        }
    }

    #[test]
    fn a_header_that_lies_about_its_size_costs_no_memory() {
        let mut bytes = written(5, 5, Pixels::F64(&[9.0; 25]));
        bytes[3 * CARD_BYTES + 11..3 * CARD_BYTES + 30].copy_from_slice(b"     99999999999999");
        let error = read_image(bytes.as_slice()).unwrap_err().to_string();
        assert!(error.contains("all rows"), "{error}");
    }
}
