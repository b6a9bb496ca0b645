//! Reads a compressed image: a binary table whose rows are the Rice codes of tiles.
//!
//! In: the header of the table and its bytes. Out: the image as it was before. Files of this program and of `fpack`, `CFITSIO`,
//! astropy with integers by `RICE_1`, tiles of any shape. Source: FITS standard 4.0, section 10. Tests: below; a file of
//! astropy in `hil_scripts/test_compare.py`.

use super::array::{FitsImage, OwnedPixels, Scale, axis, bad, ended};
use super::card::Header;
use super::rice::{Coding, decode};
use crate::sink::SinkError;
use std::io::Read;

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
