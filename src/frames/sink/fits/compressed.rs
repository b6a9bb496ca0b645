//! Writes one frame as a compressed image: a binary table whose rows are the Rice codes of rows of pixels.
//!
//! In: digital numbers with the header of [`super::write_frame`]. Out: a FITS file with an empty primary array and one
//! table, from which any reader of the tiled image convention (CFITSIO, astropy, DS9) returns the same pixels and the same
//! header. Source: FITS standard 4.0, section 10. Tests: below, and with astropy in `hil_scripts/test_data_sets.py`.

use super::card::{Header, end_card, format_card};
use super::checksum::{NO_CHECKSUM, Sum32, encoded};
use super::image::{BZERO_U16, checksum_card, fill_bytes};
use super::keywords::frame_header;
use super::{BLOCK_BYTES, rice};
use crate::sink::frame::SentFrame;
use std::io::{self, Write};

/// Bytes of a row of the table: length and place of its code.
const ROW_BYTES: usize = 8;

/// Writes the DN of a frame with its truth keywords, without loss.
///
/// # Errors
/// When the output fails, or the image has no pixels.
pub fn write_compressed_frame(mut out: impl Write, frame: &SentFrame) -> io::Result<()> {
    let (width, height) = (frame.image.width(), frame.image.height());
    if width == 0 || height == 0 {
        return Err(io::Error::new(io::ErrorKind::InvalidInput, "wanted an image with pixels"));
    }
    let (table, longest) = table_of(frame.image.pixels(), width)?;
    let mut sum = Sum32::default();
    sum.add(&table);
    out.write_all(&primary_header())?;
    let shape = Shape { width, height, heap_bytes: table.len() - ROW_BYTES * height, longest };
    out.write_all(&table_header(&shape, &frame_header(frame), sum))?;
    out.write_all(&table)?;
    out.write_all(&[0; BLOCK_BYTES][..fill_bytes(table.len())])?;
    out.flush()
}

/// Size of an image and of its table.
struct Shape {
    width: usize,
    height: usize,
    heap_bytes: usize,
    /// Bytes of the longest code.
    longest: usize,
}

/// Returns the table with its heap, and the length of the longest code.
fn table_of(pixels: &[u16], width: usize) -> io::Result<(Vec<u8>, usize)> {
    let rows = pixels.len() / width;
    let mut table = Vec::with_capacity(rows * (ROW_BYTES + rice::most_bytes(width)));
    table.resize(rows * ROW_BYTES, 0);
    let mut longest = 0;
    for (row, tile) in pixels.chunks_exact(width).enumerate() {
        let begin = table.len();
        rice::encode(tile, &mut table);
        let length = table.len() - begin;
        longest = longest.max(length);
        let word = |number: usize| {
            u32::try_from(number)
                .map_err(|error| io::Error::new(io::ErrorKind::InvalidInput, error))
                .map(u32::to_be_bytes)
        };
        let at = row * ROW_BYTES;
        table[at..at + 4].copy_from_slice(&word(length)?);
        table[at + 4..at + 8].copy_from_slice(&word(begin - rows * ROW_BYTES)?);
    }
    Ok((table, longest))
}

fn primary_header() -> Vec<u8> {
    let cards = [
        format_card("SIMPLE", &true.into(), "conforms to FITS 4.0"),
        format_card("BITPIX", &8_u32.into(), ""),
        format_card("NAXIS", &0_u32.into(), "the image is in the extension"),
        format_card("EXTEND", &true.into(), ""),
        end_card(),
    ];
    let mut bytes: Vec<u8> = cards.concat();
    bytes.resize(bytes.len() + fill_bytes(bytes.len()), b' ');
    bytes
}

fn table_header(shape: &Shape, header: &Header, data_sum: Sum32) -> Vec<u8> {
    let mut table = Header::default();
    table.push("XTENSION", "BINTABLE", "compressed image");
    table.push("BITPIX", 8_u32, "");
    table.push("NAXIS", 2_u32, "");
    table.push("NAXIS1", ROW_BYTES, "");
    table.push("NAXIS2", shape.height, "rows of pixels");
    table.push("PCOUNT", shape.heap_bytes, "bytes of all codes");
    table.push("GCOUNT", 1_u32, "");
    table.push("TFIELDS", 1_u32, "");
    table.push("TTYPE1", "COMPRESSED_DATA", "");
    table.push("TFORM1", format!("1PB({})", shape.longest), "");
    table.push("ZIMAGE", true, "a compressed image");
    table.push("ZSIMPLE", true, "");
    table.push("ZBITPIX", 16_u32, "of the image");
    table.push("ZNAXIS", 2_u32, "columns, rows");
    table.push("ZNAXIS1", shape.width, "[px] columns");
    table.push("ZNAXIS2", shape.height, "[px] rows; the first is the top one");
    table.push("ZTILE1", shape.width, "[px] a tile is a row");
    table.push("ZTILE2", 1_u32, "");
    table.push("ZCMPTYPE", "RICE_1", "without loss");
    table.push("ZNAME1", "BLOCKSIZE", "");
    table.push("ZVAL1", rice::BLOCK_PX, "[px]");
    table.push("ZNAME2", "BYTEPIX", "");
    table.push("ZVAL2", rice::PIXEL_BYTES, "");
    table.push("BZERO", u32::from(BZERO_U16), "unsigned = stored + BZERO");
    table.push("BSCALE", 1_u32, "");
    let mut bytes: Vec<u8> = table.cards().iter().chain(header.cards()).flatten().copied().collect();
    bytes.extend_from_slice(&format_card(
        "DATASUM",
        &data_sum.value().to_string().into(),
        "of the data, ones' complement",
    ));
    let at = bytes.len();
    let empty = checksum_card(NO_CHECKSUM);
    bytes.extend_from_slice(&empty);
    bytes.extend_from_slice(&end_card());
    bytes.resize(bytes.len() + fill_bytes(bytes.len()), b' ');
    let mut sum = data_sum;
    sum.add(&bytes);
    bytes[at..at + empty.len()].copy_from_slice(&checksum_card(&encoded(sum.value())));
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sink::sample::sample_frame;

    #[test]
    fn file_is_whole_blocks_whose_words_sum_to_minus_zero() {
        let mut bytes = Vec::new();
        write_compressed_frame(&mut bytes, &sample_frame(0)).unwrap();
        assert_eq!(bytes.len() % BLOCK_BYTES, 0);
        let mut sum = Sum32::default();
        sum.add(&bytes[BLOCK_BYTES..]);
        assert_eq!(sum.value(), u32::MAX);
        bytes[2 * BLOCK_BYTES] ^= 1;
        let mut sum = Sum32::default();
        sum.add(&bytes[BLOCK_BYTES..]);
        assert_ne!(sum.value(), u32::MAX, "control: damage is seen");
    }

    #[test]
    fn image_without_pixels_is_refused() {
        let mut frame = sample_frame(0);
        frame.image = base::image::DnImage::new(0, 4);
        assert!(write_compressed_frame(Vec::new(), &frame).is_err());
    }
}
