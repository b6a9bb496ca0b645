//! Writes one frame as a compressed image: a binary table whose rows are the Rice codes of rows of pixels.
//!
//! In: digital numbers with the header of [`super::write_frame`]. Out: a FITS file with an empty primary array and one
//! table, from which any reader of the tiled image convention (CFITSIO, astropy, DS9) returns the same pixels and the same
//! header. Source: FITS standard 4.0, section 10. Tests: below, and with astropy in `hil_scripts/tests/test_data_sets.py`.

use super::card::{Header, NO_CHECKSUM, Sum32, encoded, end_card, format_card};
use super::image::{BZERO_U16, FitsImage, OwnedPixels, Scale, axis, bad, checksum_card, ended, fill_bytes};
use super::rice::{self, Coding, decode};
use super::{BLOCK_BYTES, keywords::frame_header};
use crate::sink::{SinkError, frame::SentFrame};
use std::io::{self, Read, Write};

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

// Reads a compressed image: a binary table whose rows are the Rice codes of tiles.
//
// In: the header of the table and its bytes. Out: the image as it was before. Files of this program and of `fpack`, `CFITSIO`,
// astropy with integers by `RICE_1`, tiles of any shape. Source: FITS standard 4.0, section 10. Tests: below; a file of
// astropy in `hil_scripts/tests/test_compare.py`.

/// Most pixels of an image.
const MOST_PIXELS: usize = 1 << 27;
/// Most columns of a table.
const MOST_COLUMNS: usize = 99;
/// Pixels of a block and bytes of a pixel where the header does not say.
const PLAIN_CODING: [usize; 2] = [32, 4];

/// Reads the image of a table whose header has `ZIMAGE`.
pub(super) fn read(input: impl Read, header: Header) -> Result<FitsImage, SinkError> {
    let layout = Layout::of(&header)?;
    let wanted = layout.row_bytes.saturating_mul(layout.rows).saturating_add(number(&header, "PCOUNT", 0));
    let mut bytes = Vec::new();
    input.take(wanted as u64).read_to_end(&mut bytes).map_err(|e| ended("compressed pixels", &e))?;
    if bytes.len() != wanted {
        return Err(damaged("all bytes of the table", format!("{} of {wanted}", bytes.len())));
    }
    let [width, height] = layout.size;
    let pixels = width.saturating_mul(height);
    if pixels == 0 || pixels > MOST_PIXELS || layout.coding.least_bits(pixels) / 8 > bytes.len() + MOST_COLUMNS {
        return Err(damaged("codes of all pixels", format!("{} bytes for {width} x {height} pixels", bytes.len())));
    }
    let mut stored = vec![0_i32; pixels];
    let across = width.div_ceil(layout.tile[0]);
    for tile in 0..across * height.div_ceil(layout.tile[1]) {
        let corner = [tile % across * layout.tile[0], tile / across * layout.tile[1]];
        let size = [0, 1].map(|i| layout.tile[i].min(layout.size[i] - corner[i]));
        let numbers = layout
            .code(&bytes, tile)
            .and_then(|code| decode(code, size[0] * size[1], &layout.coding))
            .ok_or_else(|| damaged("the codes of all tiles", format!("tile {} cut short", tile + 1)))?;
        for (row, values) in numbers.chunks_exact(size[0]).enumerate() {
            let from = (corner[1] + row) * width + corner[0];
            stored[from..from + size[0]].copy_from_slice(values);
        }
    }
    let scale = Scale::of(&header);
    Ok(FitsImage { width, height, pixels: pixels_of(stored, scale), header })
}

/// Returns unsigned 16-bit pixels where the file has such.
fn pixels_of(stored: Vec<i32>, scale: Scale) -> OwnedPixels {
    let unsigned = |value: &i32| u16::try_from(i64::from(*value) + 0x8000).ok();
    if scale.is_unsigned_16()
        && let Some(pixels) = stored.iter().map(unsigned).collect()
    {
        return OwnedPixels::U16(pixels);
    }
    scale.integers(stored)
}

fn damaged(wanted: &'static str, got: String) -> SinkError {
    SinkError::DamagedFits { what: "compressed pixels", wanted, got }
}

fn number(header: &Header, keyword: &str, without: usize) -> usize {
    header.integer(keyword).and_then(|value| usize::try_from(value).ok()).unwrap_or(without)
}

/// Where the codes of the tiles are, and how they were coded.
struct Layout {
    size: [usize; 2],
    tile: [usize; 2],
    coding: Coding,
    row_bytes: usize,
    rows: usize,
    /// First byte of the codes.
    heap: usize,
    /// Place of a code's length in a row, and whether length and place have 64 bits.
    column: usize,
    is_wide: bool,
}

impl Layout {
    fn of(header: &Header) -> Result<Self, SinkError> {
        if header.integer("ZNAXIS") != Some(2) {
            return Err(bad("ZNAXIS", "2 axes", header));
        }
        if header.text("ZCMPTYPE").is_none_or(|kind| !matches!(kind.trim(), "RICE_1" | "RICE_ONE")) {
            return Err(bad("ZCMPTYPE", "RICE_1 (unpack other files with funpack)", header));
        }
        if !matches!(header.integer("ZBITPIX"), Some(8 | 16 | 32)) {
            return Err(bad("ZBITPIX", "integers of 8, 16 or 32 bits (unpack floats with funpack)", header));
        }
        let size = [axis(header, "ZNAXIS1")?, axis(header, "ZNAXIS2")?];
        let tile = [number(header, "ZTILE1", size[0]), number(header, "ZTILE2", 1)];
        if tile.contains(&0) {
            return Err(bad("ZTILE1", "tiles with pixels", header));
        }
        let [block_px, pixel_bytes] = coding_of(header);
        let coding = Coding::of(block_px, pixel_bytes)
            .ok_or_else(|| bad("ZVAL1", "blocks of 1 to 32 pixels of 1, 2 or 4 bytes", header))?;
        let (row_bytes, rows) = (axis(header, "NAXIS1")?, axis(header, "NAXIS2")?);
        let (column, is_wide) =
            code_column(header).ok_or_else(|| bad("TTYPE1", "a column COMPRESSED_DATA of codes", header))?;
        let heap = number(header, "THEAP", row_bytes.saturating_mul(rows));
        Ok(Self { size, tile, coding, row_bytes, rows, heap, column, is_wide })
    }

    /// Returns the code of a tile.
    fn code<'b>(&self, bytes: &'b [u8], tile: usize) -> Option<&'b [u8]> {
        let from = tile.checked_mul(self.row_bytes)?.checked_add(self.column)?;
        let row = bytes.get(from..)?;
        let word = |at: usize| {
            if self.is_wide {
                row.get(8 * at..8 * at + 8).and_then(|b| b.try_into().ok()).map(u64::from_be_bytes)
            } else {
                row.get(4 * at..4 * at + 4).and_then(|b| b.try_into().ok()).map(u32::from_be_bytes).map(u64::from)
            }
        };
        let [length, place] = [usize::try_from(word(0)?).ok()?, usize::try_from(word(1)?).ok()?];
        let start = self.heap.checked_add(place)?;
        bytes.get(start..start.checked_add(length)?)
    }
}

/// Returns pixels of a block and bytes of a pixel.
fn coding_of(header: &Header) -> [usize; 2] {
    let value = |name: &str, without: usize| {
        let of = |i: usize| header.text(&format!("ZNAME{i}")).is_some_and(|text| text.trim() == name);
        (1..=9).find(|i| of(*i)).map_or(without, |i| number(header, &format!("ZVAL{i}"), without))
    };
    [value("BLOCKSIZE", PLAIN_CODING[0]), value("BYTEPIX", PLAIN_CODING[1])]
}

/// Returns the place of the codes' lengths in a row of the table, and whether they have 64 bits.
fn code_column(header: &Header) -> Option<(usize, bool)> {
    let mut place: usize = 0;
    for column in 1..=number(header, "TFIELDS", 0).min(MOST_COLUMNS) {
        let form = header.text(&format!("TFORM{column}"))?;
        let digits = form.find(|c: char| !c.is_ascii_digit())?;
        let count = if digits == 0 { 1 } else { form[..digits].parse().ok()? };
        let letter = form[digits..].chars().next()?;
        if header.text(&format!("TTYPE{column}")).is_some_and(|name| name.trim() == "COMPRESSED_DATA") {
            return matches!(letter, 'P' | 'Q').then_some((place, letter == 'Q'));
        }
        let bytes = match letter {
            'X' => usize::div_ceil(count, 8),
            'L' | 'B' | 'A' => count,
            'I' => count.checked_mul(2)?,
            'J' | 'E' => count.checked_mul(4)?,
            'K' | 'D' | 'C' | 'P' => count.checked_mul(8)?,
            'M' | 'Q' => count.checked_mul(16)?,
            _ => return None,
        };
        place = place.checked_add(bytes)?;
    }
    None
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

#[cfg(test)]
mod packed_tests {
    use super::{super::read::read_image, super::write_compressed_frame, *};
    use crate::sink::sample::sample_frame;

    fn written() -> (Vec<u8>, Vec<u16>) {
        let frame = sample_frame(3);
        let mut bytes = Vec::new();
        write_compressed_frame(&mut bytes, &frame).unwrap();
        (bytes, frame.image.pixels().to_vec())
    }

    #[test]
    fn own_compressed_frames_read_back_with_their_header() {
        let (bytes, pixels) = written();
        let image = read_image(bytes.as_slice()).unwrap();
        assert_eq!(image.pixels, OwnedPixels::U16(pixels));
        assert!(image.states_row_order() && image.header.integer("ZNAXIS1") == Some(image.width as i128));
    }

    #[test]
    fn compressed_frames_that_are_cut_or_changed_are_errors_not_panics() {
        let (bytes, pixels) = written();
        for cut in (0..bytes.len()).step_by(61) {
            if let Ok(image) = read_image(&bytes[..cut]) {
                assert_eq!(image.pixels, OwnedPixels::U16(pixels.clone()), "only fill is lost");
            }
        }
        for at in 0..bytes.len() {
            let mut changed = bytes.clone();
            changed[at] ^= 0x11;
            let _ = read_image(changed.as_slice()); // any result is right, but no panic
        }
        let message = read_image(&bytes[..2 * 2880 + 90]).unwrap_err().to_string();
        assert!(message.contains("damaged"), "{message}");
    }

    #[test]
    fn other_ways_of_compression_are_named_and_not_called_damaged() {
        let (bytes, _) = written();
        let place = bytes.windows(6).position(|w| w == b"RICE_1").unwrap();
        let mut gzip = bytes;
        gzip[place..place + 6].copy_from_slice(b"GZIP_1");
        let message = read_image(gzip.as_slice()).unwrap_err().to_string();
        assert!(message.contains("RICE_1") && message.contains("GZIP_1") && !message.contains("damaged"), "{message}");
    }
}
