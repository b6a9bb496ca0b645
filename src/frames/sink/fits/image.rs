//! Writes one image: mandatory cards, the caller's header, big-endian pixels, padded to whole blocks.

use super::BLOCK_BYTES;
use super::card::{CARD_BYTES, Card, Header, NO_CHECKSUM, Sum32, Value, encoded, end_card, format_card};
use crate::sink::SinkError;
use std::io::{self, Write};

/// Bytes converted at a time; whole blocks, and whole pixels of every kind.
const CHUNK_BYTES: usize = 8 * BLOCK_BYTES;
/// Number that is added to the stored signed value to give the unsigned one.
pub(super) const BZERO_U16: u16 = 0x8000;

/// Pixels of one image, row by row from the top.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Pixels<'a> {
    /// Unsigned 16-bit.
    U16(&'a [u16]),
    /// Single precision.
    F32(&'a [f32]),
    /// Double precision.
    F64(&'a [f64]),
}

impl Pixels<'_> {
    fn len(&self) -> usize {
        match self {
            Self::U16(p) => p.len(),
            Self::F32(p) => p.len(),
            Self::F64(p) => p.len(),
        }
    }

    /// Hands the bytes of the file to `take`, some at a time, whole words except the last.
    fn for_each_chunk(&self, take: impl FnMut(&[u8]) -> io::Result<()>) -> io::Result<()> {
        match self {
            Self::U16(p) => convert(p, |v| (v ^ BZERO_U16).to_be_bytes(), take),
            Self::F32(p) => convert(p, f32::to_be_bytes, take),
            Self::F64(p) => convert(p, f64::to_be_bytes, take),
        }
    }

    fn bitpix(&self) -> i64 {
        match self {
            Self::U16(_) => 16,
            Self::F32(_) => -32,
            Self::F64(_) => -64,
        }
    }
}

/// Writes a whole file.
///
/// # Errors
/// When the output fails, or the pixel count is not `width * height`.
pub fn write_image(
    mut out: impl Write,
    width: usize,
    height: usize,
    pixels: Pixels<'_>,
    header: &Header,
) -> io::Result<()> {
    if width.checked_mul(height) != Some(pixels.len()) {
        let text = format!("wanted {width} x {height} pixels, got {}", pixels.len());
        return Err(io::Error::new(io::ErrorKind::InvalidInput, text));
    }
    let mut data_sum = Sum32::default();
    pixels.for_each_chunk(|bytes| {
        data_sum.add(bytes);
        Ok(())
    })?;
    out.write_all(&header_bytes(width, height, pixels, header, data_sum))?;
    let mut written = 0;
    pixels.for_each_chunk(|bytes| {
        written += bytes.len();
        out.write_all(bytes)
    })?;
    out.write_all(&[0; BLOCK_BYTES][..fill_bytes(written)])?;
    out.flush()
}

/// Returns the whole header, with the checksums of the data and of the file.
fn header_bytes(width: usize, height: usize, pixels: Pixels<'_>, header: &Header, data_sum: Sum32) -> Vec<u8> {
    let mut bytes = Vec::with_capacity(8 * BLOCK_BYTES);
    for card in mandatory_cards(width, height, pixels).iter().chain(header.cards()) {
        bytes.extend_from_slice(card);
    }
    let data_text = data_sum.value().to_string();
    bytes.extend_from_slice(&format_card("DATASUM", &data_text.into(), "of the data, ones' complement"));
    let at = bytes.len();
    bytes.extend_from_slice(&checksum_card(NO_CHECKSUM));
    bytes.extend_from_slice(&end_card());
    bytes.resize(bytes.len() + fill_bytes(bytes.len()), b' ');
    debug_assert_eq!(bytes.len() % CARD_BYTES, 0, "whole cards");
    let mut sum = data_sum;
    sum.add(&bytes);
    bytes[at..at + CARD_BYTES].copy_from_slice(&checksum_card(&encoded(sum.value())));
    bytes
}

pub(super) fn checksum_card(text: &str) -> Card {
    format_card("CHECKSUM", &text.into(), "of header and data")
}

fn mandatory_cards(width: usize, height: usize, pixels: Pixels<'_>) -> Vec<Card> {
    let mut cards = vec![
        format_card("SIMPLE", &true.into(), "conforms to FITS 4.0"),
        format_card("BITPIX", &pixels.bitpix().into(), "bits per pixel; negative: IEEE float"),
        format_card("NAXIS", &2_u32.into(), "columns, rows"),
        format_card("NAXIS1", &width.into(), "[px] columns"),
        format_card("NAXIS2", &height.into(), "[px] rows; the first is the top one"),
    ];
    if let Pixels::U16(_) = pixels {
        cards.push(format_card("BZERO", &u32::from(BZERO_U16).into(), "unsigned = stored + BZERO"));
        cards.push(format_card("BSCALE", &1_u32.into(), ""));
    }
    cards
}

/// Converts pixels a chunk at a time and hands each chunk to `take`.
fn convert<T: Copy, const N: usize>(
    pixels: &[T],
    big_endian: impl Fn(T) -> [u8; N],
    mut take: impl FnMut(&[u8]) -> io::Result<()>,
) -> io::Result<()> {
    let mut chunk = vec![0; CHUNK_BYTES];
    for some in pixels.chunks(CHUNK_BYTES / N) {
        let bytes = &mut chunk[..some.len() * N];
        for (to, &pixel) in bytes.chunks_exact_mut(N).zip(some) {
            to.copy_from_slice(&big_endian(pixel));
        }
        take(bytes)?;
    }
    Ok(())
}

/// Returns bytes from `length` to the end of its block.
pub(super) fn fill_bytes(length: usize) -> usize {
    (BLOCK_BYTES - length % BLOCK_BYTES) % BLOCK_BYTES
}

// An image as it was read from a FITS file: pixels, header, order of rows; and the refusals of its readers.

/// Values of `ROWORDER`.
const ROW_ORDERS: [&str; 2] = ["TOP-DOWN", "BOTTOM-UP"];

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
    pub fn as_pixels(&self) -> Pixels<'_> {
        match self {
            Self::U16(p) => Pixels::U16(p),
            Self::F32(p) => Pixels::F32(p),
            Self::F64(p) => Pixels::F64(p),
        }
    }
}

impl FitsImage {
    /// Returns whether the file states which row is the top one (`ROWORDER`, a keyword of amateur astronomy's programs
    /// and of this one); by FITS's own convention the first row is drawn at the bottom, but cameras write it either way.
    pub fn states_row_order(&self) -> bool {
        self.header
            .text("ROWORDER")
            .is_some_and(|order| ROW_ORDERS.iter().any(|one| order.trim().eq_ignore_ascii_case(one)))
    }

    /// Returns the pixels as numbers, the top row first: that is the first one of the file, unless it says
    /// `ROWORDER = 'BOTTOM-UP'`.
    pub fn top_row_first(&self) -> Vec<f64> {
        let pixels: Vec<f64> = match &self.pixels {
            OwnedPixels::U16(pixels) => pixels.iter().map(|value| f64::from(*value)).collect(),
            OwnedPixels::F32(pixels) => pixels.iter().map(|value| f64::from(*value)).collect(),
            OwnedPixels::F64(pixels) => pixels.clone(),
        };
        if self.header.text("ROWORDER").is_some_and(|order| order.trim().eq_ignore_ascii_case(ROW_ORDERS[1])) {
            return pixels.rchunks_exact(self.width.max(1)).flatten().copied().collect();
        }
        pixels
    }
}

/// Factor and offset of stored numbers.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scale {
    factor: f64,
    offset: f64,
}

impl Scale {
    pub(super) fn of(header: &Header) -> Self {
        Self { factor: header.real("BSCALE").unwrap_or(1.0), offset: header.real("BZERO").unwrap_or(0.0) }
    }

    #[allow(clippy::float_cmp, reason = "numbers of the header, not of a computation")]
    pub(super) fn is_unsigned_16(self) -> bool {
        self.factor == 1.0 && self.offset == f64::from(BZERO_U16)
    }

    #[allow(clippy::float_cmp, reason = "numbers of the header, not of a computation")]
    pub(super) fn is_one(self) -> bool {
        self.factor == 1.0 && self.offset == 0.0
    }

    /// Returns stored integers as pixels.
    pub(super) fn integers(self, stored: Vec<i32>) -> OwnedPixels {
        OwnedPixels::F64(stored.into_iter().map(|value| self.offset + self.factor * f64::from(value)).collect())
    }

    pub(super) fn reals(self, stored: Vec<f64>) -> OwnedPixels {
        if self.is_one() {
            return OwnedPixels::F64(stored);
        }
        OwnedPixels::F64(stored.into_iter().map(|value| self.offset + self.factor * value).collect())
    }
}

pub(super) fn bad(keyword: &'static str, wanted: &'static str, header: &Header) -> SinkError {
    SinkError::BadFits {
        what: keyword,
        wanted,
        got: header.get(keyword).map_or_else(|| "no such card".into(), value_text),
    }
}

pub(super) fn ended(what: &'static str, source: &io::Error) -> SinkError {
    SinkError::DamagedFits { what, wanted: "more bytes", got: end_or(source) }
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
fn end_or(source: &io::Error) -> String {
    if source.kind() == io::ErrorKind::UnexpectedEof { "the end of the file".into() } else { source.to_string() }
}

pub(super) fn axis(header: &Header, keyword: &'static str) -> Result<usize, SinkError> {
    let length = header.integer(keyword).and_then(|n| usize::try_from(n).ok());
    length.ok_or_else(|| bad(keyword, "a length in pixels", header))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn file(width: usize, height: usize, pixels: Pixels<'_>) -> Vec<u8> {
        let mut bytes = Vec::new();
        write_image(&mut bytes, width, height, pixels, &Header::default()).unwrap();
        bytes
    }

    #[test]
    fn unsigned_words_are_offset_and_big_endian() {
        let bytes = file(2, 2, Pixels::U16(&[0, 1, 0x8000, 0xFFFF]));
        assert_eq!(bytes.len(), 2 * BLOCK_BYTES);
        assert_eq!(bytes[BLOCK_BYTES..BLOCK_BYTES + 8], [0x80, 0, 0x80, 1, 0, 0, 0x7F, 0xFF]);
    }

    #[test]
    fn every_file_is_whole_blocks() {
        for pixels in [0, 1, 1439, 1440, 1441, 100_000] {
            assert_eq!(file(pixels, 1, Pixels::U16(&vec![7; pixels])).len() % BLOCK_BYTES, 0, "{pixels} px");
            assert_eq!(file(1, pixels, Pixels::F64(&vec![7.0; pixels])).len() % BLOCK_BYTES, 0, "{pixels} px");
        }
    }

    #[test]
    fn the_words_of_every_file_sum_to_minus_zero() {
        for pixels in [1, 2, 3, 1441, 50_001] {
            let values: Vec<u16> = (0..pixels).map(|i| (i * 7919 % 65_521) as u16).collect();
            let mut bytes = file(pixels, 1, Pixels::U16(&values));
            let sum = |bytes: &[u8]| {
                let mut sum = Sum32::default();
                sum.add(bytes);
                sum.value()
            };
            assert_eq!(sum(&bytes), u32::MAX, "{pixels} px");
            assert_eq!(sum(&file(pixels, 1, Pixels::F32(&vec![0.1; pixels]))), u32::MAX, "{pixels} px");
            bytes[BLOCK_BYTES] ^= 1;
            assert_ne!(sum(&bytes), u32::MAX, "control: damage is seen");
        }
    }

    #[test]
    fn a_wrong_pixel_count_is_refused() {
        let error = write_image(Vec::new(), 3, 3, Pixels::F32(&[0.0; 8]), &Header::default()).unwrap_err();
        assert!(error.to_string().contains("3 x 3"), "{error}");
    }
}
