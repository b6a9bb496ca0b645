//! Writes one image: mandatory cards, the caller's header, big-endian pixels, padded to whole blocks.

use super::BLOCK_BYTES;
use super::card::{CARD_BYTES, Card, Header, end_card, format_card};
use std::io::{self, Write};

/// Bytes converted at a time; whole blocks, and whole pixels of every kind.
const CHUNK_BYTES: usize = 8 * BLOCK_BYTES;
/// What is added to the stored signed value to give the unsigned one.
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
    write_header(&mut out, width, height, pixels, header)?;
    let bytes = match pixels {
        Pixels::U16(p) => write_pixels(&mut out, p, |v| (v ^ BZERO_U16).to_be_bytes()),
        Pixels::F32(p) => write_pixels(&mut out, p, f32::to_be_bytes),
        Pixels::F64(p) => write_pixels(&mut out, p, f64::to_be_bytes),
    }?;
    out.write_all(&[0; BLOCK_BYTES][..fill_bytes(bytes)])?;
    out.flush()
}

fn write_header(
    out: &mut impl Write,
    width: usize,
    height: usize,
    pixels: Pixels<'_>,
    header: &Header,
) -> io::Result<()> {
    let mut bytes = Vec::with_capacity(4 * BLOCK_BYTES);
    let mandatory = mandatory_cards(width, height, pixels);
    for card in mandatory.iter().chain(header.cards()).chain([&end_card()]) {
        bytes.extend_from_slice(card);
    }
    bytes.resize(bytes.len() + fill_bytes(bytes.len()), b' ');
    debug_assert_eq!(bytes.len() % CARD_BYTES, 0, "whole cards");
    out.write_all(&bytes)
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

/// Converts and writes pixels, a chunk at a time; gives the number of bytes.
fn write_pixels<T: Copy, const N: usize>(
    out: &mut impl Write,
    pixels: &[T],
    big_endian: impl Fn(T) -> [u8; N],
) -> io::Result<usize> {
    let mut chunk = vec![0; CHUNK_BYTES];
    for some in pixels.chunks(CHUNK_BYTES / N) {
        let bytes = &mut chunk[..some.len() * N];
        for (to, &pixel) in bytes.chunks_exact_mut(N).zip(some) {
            to.copy_from_slice(&big_endian(pixel));
        }
        out.write_all(bytes)?;
    }
    Ok(pixels.len() * N)
}

/// Bytes from `length` to the end of its block.
pub(super) fn fill_bytes(length: usize) -> usize {
    (BLOCK_BYTES - length % BLOCK_BYTES) % BLOCK_BYTES
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
    fn a_wrong_pixel_count_is_refused() {
        let error = write_image(Vec::new(), 3, 3, Pixels::F32(&[0.0; 8]), &Header::default()).unwrap_err();
        assert!(error.to_string().contains("3 x 3"), "{error}");
    }
}
