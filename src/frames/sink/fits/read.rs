//! Reads one image of two axes: the first of the file, in its primary array, in an image extension, or compressed in a table
//! (`compressed`).
//!
//! Integers of 8, 16 and 32 bits with `BZERO` and `BSCALE`, IEEE floats of 32 and 64 bits. Parts without an image are
//! skipped. A file that ends early is [`SinkError::DamagedFits`], one of another kind [`SinkError::BadFits`].

use super::card::{CARD_BYTES, Card, Header, end_card};
use super::image::{BZERO_U16, FitsImage, OwnedPixels, Scale, axis, bad, ended, fill_bytes};
use super::{BLOCK_BYTES, compressed};
use crate::sink::SinkError;
use std::io::Read;

/// First bytes of a FITS file.
const FIRST: &[u8] = b"SIMPLE";

/// Headers longer than this are taken for damage.
const MAX_HEADER_BLOCKS: usize = 256;
/// Parts of a file among which an image is looked for.
const MAX_PARTS: usize = 64;
/// Axes that an array may have (FITS allows 999, programs write a few).
const MAX_AXES: i128 = 9;

impl FitsImage {
    /// Reads one image; see [`read_image`].
    ///
    /// # Errors
    /// As [`read_image`].
    pub fn read(input: impl Read) -> Result<Self, SinkError> {
        read_image(input)
    }
}

/// Reads one image; takes no more memory than the input's size allows for.
///
/// # Errors
/// [`SinkError::DamagedFits`] when the input ends early, [`SinkError::BadFits`] when it has no image of a kind listed above.
pub fn read_image(mut input: impl Read) -> Result<FitsImage, SinkError> {
    let mut first = Vec::new();
    input.by_ref().take(FIRST.len() as u64).read_to_end(&mut first).map_err(|e| ended("header", &e))?;
    if !first.is_empty() && !FIRST.starts_with(&first) {
        return Err(SinkError::BadFits { what: "SIMPLE", wanted: "T", got: "other bytes".into() });
    }
    let mut input = first.as_slice().chain(input);
    let mut header = read_header(&mut input)?;
    if header.get("SIMPLE") != Some(true.into()) {
        return Err(bad("SIMPLE", "T", &header));
    }
    for part in 1..=MAX_PARTS {
        if header.get("ZIMAGE") == Some(true.into()) {
            return compressed::read(input, header);
        }
        if is_image(&header) {
            return read_array(input, header);
        }
        skip_data(&mut input, &header)?;
        header = next_header(&mut input)?.ok_or_else(|| without_image(part))?;
    }
    Err(without_image(MAX_PARTS))
}

/// Returns the header of the next part; `None` at the end of the file.
fn next_header(input: &mut impl Read) -> Result<Option<Header>, SinkError> {
    let mut first = Vec::new();
    input.take(1).read_to_end(&mut first).map_err(|e| ended("header", &e))?;
    if first.is_empty() { Ok(None) } else { read_header(&mut first.as_slice().chain(input)).map(Some) }
}

fn without_image(parts: usize) -> SinkError {
    SinkError::BadFits { what: "the file", wanted: "an image of 2 axes", got: format!("{parts} parts without one") }
}

/// Returns true for an array with pixels, whatever its axes.
fn is_image(header: &Header) -> bool {
    let is_table = header.text("XTENSION").is_some_and(|kind| kind.trim() != "IMAGE");
    !is_table && header.integer("NAXIS") != Some(0)
}

fn read_array(input: impl Read, header: Header) -> Result<FitsImage, SinkError> {
    let axes = header.integer("NAXIS").unwrap_or(0);
    let is_plane = (3..=axes).all(|axis| header.integer(&format!("NAXIS{axis}")) == Some(1));
    if !(2..=MAX_AXES).contains(&axes) || !is_plane {
        return Err(bad("NAXIS", "2 axes", &header));
    }
    let (width, height) = (axis(&header, "NAXIS1")?, axis(&header, "NAXIS2")?);
    let size = [width, height];
    let scale = Scale::of(&header);
    let pixels = match header.integer("BITPIX") {
        Some(8) => scale.integers(read_pixels(input, size, |[byte]: [u8; 1]| i32::from(byte))?),
        Some(16) if scale.is_unsigned_16() => {
            OwnedPixels::U16(read_pixels(input, size, |bytes| u16::from_be_bytes(bytes) ^ BZERO_U16)?)
        }
        Some(16) => scale.integers(read_pixels(input, size, |bytes| i32::from(i16::from_be_bytes(bytes)))?),
        Some(32) => scale.integers(read_pixels(input, size, i32::from_be_bytes)?),
        Some(-32) if scale.is_one() => OwnedPixels::F32(read_pixels(input, size, f32::from_be_bytes)?),
        Some(-32) => scale.reals(read_pixels(input, size, |bytes| f64::from(f32::from_be_bytes(bytes)))?),
        Some(-64) => scale.reals(read_pixels(input, size, f64::from_be_bytes)?),
        _ => return Err(bad("BITPIX", "8, 16, 32, -32 or -64", &header)),
    };
    Ok(FitsImage { width, height, pixels, header })
}

/// Passes over the data of a part.
fn skip_data(input: &mut impl Read, header: &Header) -> Result<(), SinkError> {
    let axes = header.integer("NAXIS").unwrap_or(0).clamp(0, MAX_AXES);
    let number = |keyword: &str, without: i128| header.integer(keyword).unwrap_or(without).max(0);
    let lengths = (1..=axes).map(|axis| number(&format!("NAXIS{axis}"), 0));
    let array = if axes == 0 { 0 } else { lengths.fold(1, i128::saturating_mul) };
    let cells = array.saturating_add(number("PCOUNT", 0)).saturating_mul(number("GCOUNT", 1));
    let bytes = cells.saturating_mul(header.integer("BITPIX").unwrap_or(8).saturating_abs() / 8);
    let bytes = usize::try_from(bytes).unwrap_or(usize::MAX / 2);
    let whole = (bytes + fill_bytes(bytes)) as u64;
    std::io::copy(&mut input.take(whole), &mut std::io::sink()).map_err(|e| ended("a part without an image", &e))?;
    Ok(())
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
    Err(SinkError::DamagedFits { what: "header", wanted: "an END card", got: format!("{MAX_HEADER_BLOCKS} blocks") })
}

fn read_pixels<T, const N: usize>(
    input: impl Read,
    [width, height]: [usize; 2],
    native: impl Fn([u8; N]) -> T,
) -> Result<Vec<T>, SinkError> {
    let size = || SinkError::BadFits { what: "size", wanted: "an image in memory", got: format!("{width} x {height}") };
    let wanted = width.checked_mul(height).and_then(|n| n.checked_mul(N)).ok_or_else(size)?;
    let mut bytes = Vec::new();
    input.take(wanted as u64).read_to_end(&mut bytes).map_err(|e| ended("pixels", &e))?;
    if bytes.len() != wanted {
        let got = format!("{} of {wanted} bytes", bytes.len());
        return Err(SinkError::DamagedFits { what: "pixels", wanted: "all rows", got });
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
    use super::super::{Pixels, Value, write_image};
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

    /// Returns a part with this header and data.
    fn part(cards: &[(&str, Value<'_>)], data: &[u8]) -> Vec<u8> {
        let mut header = Header::default();
        cards.iter().for_each(|(keyword, value)| header.push(keyword, value.clone(), ""));
        let mut bytes: Vec<u8> = header.cards().concat();
        bytes.extend_from_slice(&end_card());
        bytes.resize(bytes.len().next_multiple_of(BLOCK_BYTES), b' ');
        bytes.extend_from_slice(data);
        bytes.resize(bytes.len().next_multiple_of(BLOCK_BYTES), 0);
        bytes
    }

    fn extension(bitpix: i64, more: &[(&str, Value<'_>)], data: &[u8]) -> Vec<u8> {
        let mut cards = vec![("XTENSION", "IMAGE".into()), ("BITPIX", bitpix.into()), ("NAXIS", 2_u32.into())];
        cards.extend([("NAXIS1", 2_u32.into()), ("NAXIS2", 1_u32.into())]);
        cards.extend_from_slice(more);
        let primary = part(&[("SIMPLE", true.into()), ("BITPIX", 8_u32.into()), ("NAXIS", 0_u32.into())], &[]);
        let table = [("XTENSION", "TABLE".into()), ("BITPIX", 8_u32.into()), ("NAXIS", 2_u32.into())];
        let sides = [("NAXIS1", 3_u32.into()), ("NAXIS2", 5_u32.into())];
        let table = part(&[table.as_slice(), &sides].concat(), &[b'x'; 15]);
        [primary, table, part(&cards, data)].concat()
    }

    #[test]
    fn the_first_image_of_extensions_is_read_whatever_its_numbers() {
        let scaled = [("BZERO", 10.0.into()), ("BSCALE", 0.5.into())];
        for (bitpix, more, data, wanted) in [
            (8, &[][..], &[7, 200][..], [7.0, 200.0]),
            (16, &[][..], &[0xFF, 0xFE, 1, 0][..], [-2.0, 256.0]),
            (16, &scaled[..], &[0, 4, 0, 6][..], [12.0, 13.0]),
            (32, &[][..], &[0, 1, 0, 0, 0xFF, 0xFF, 0xFF, 0xFF][..], [65_536.0, -1.0]),
            (-32, &scaled[..], &[0x40, 0, 0, 0, 0xC0, 0, 0, 0][..], [11.0, 9.0]),
        ] {
            let bytes = extension(bitpix, more, data);
            assert_eq!(read_image(bytes.as_slice()).unwrap().top_row_first(), wanted, "{bitpix}");
            let cut = read_image(&bytes[..bytes.len() - BLOCK_BYTES + 1]).unwrap_err().to_string();
            assert!(cut.contains("damaged"), "{cut}");
        }
        let unsigned = extension(16, &[("BZERO", 32_768_u32.into())], &[0x80, 1, 0, 0]);
        assert_eq!(read_image(unsigned.as_slice()).unwrap().pixels, OwnedPixels::U16(vec![1, 32_768]));
    }

    #[test]
    fn a_file_of_another_kind_is_not_called_damaged() {
        let primary = part(&[("SIMPLE", true.into()), ("BITPIX", 8_u32.into()), ("NAXIS", 0_u32.into())], &[]);
        let cube = [("SIMPLE", true.into()), ("BITPIX", 8_u32.into()), ("NAXIS", 3_u32.into())];
        let sides = [("NAXIS1", 2_u32.into()), ("NAXIS2", 1_u32.into()), ("NAXIS3", 3_u32.into())];
        for (bytes, words) in [
            (primary.clone(), "1 parts without one"),
            (part(&[cube.as_slice(), &sides].concat(), &[0; 6]), "NAXIS: wanted 2 axes, got 3"),
        ] {
            let message = read_image(bytes.as_slice()).unwrap_err().to_string();
            assert!(message.contains(words) && !message.contains("damaged"), "{message}");
        }
        let cut = read_image(&[primary.as_slice(), b"XTENSION"].concat()[..]).unwrap_err().to_string();
        assert!(cut.contains("damaged"), "control: {cut}");
    }

    #[test]
    fn a_header_that_lies_about_its_size_costs_no_memory() {
        let mut bytes = written(5, 5, Pixels::F64(&[9.0; 25]));
        bytes[3 * CARD_BYTES + 11..3 * CARD_BYTES + 30].copy_from_slice(b"     99999999999999");
        let error = read_image(bytes.as_slice()).unwrap_err().to_string();
        assert!(error.contains("all rows"), "{error}");
    }
}
