//! Image files -> [`Picture`]: TIFF, PNG and FITS, one grey channel.
//!
//! Of a FITS file the first image is read, in an extension or compressed too. Its first row is the top one, unless it says
//! otherwise; where it says nothing, the order is open: the stars decide.
//!
//! Files of more than [`MOST_BYTES`] and images of more than [`MOST_PIXELS`] are refused before their pixels are read.
//! A damaged file is a message, never a panic: tests cut files at every place and change each byte of their heads.

use crate::picture::Picture;
use base::{input_file::read_bytes, refused::Refused};
use frames::sink::{SinkError, fits::FitsImage};
use std::{io::Cursor, path::Path};
use tiff::ColorType;
use tiff::decoder::{Decoder, DecodingResult, Limits};

/// Largest file that is read.
pub const MOST_BYTES: u64 = 1 << 30;
/// Most pixels of an image.
pub const MOST_PIXELS: usize = 1 << 27;
/// Bits of a pixel of the files.
const FILE_BITS: u32 = 16;

/// An image and what its file says about it.
#[derive(Debug, Clone, PartialEq)]
pub struct ImageFile {
    /// The image, the file's first row at the top unless it says otherwise.
    pub picture: Picture,
    /// The file does not say whether its first row is the top one, and its format has no rule that cameras follow.
    pub is_row_order_open: bool,
}

/// Reads an image of a camera of `size_px` whose converter has `bits` bits; values in the upper bits of 16 are shifted
/// down.
///
/// # Errors
/// When the file cannot be read, is damaged, is not a grey image, or is not of such a camera.
pub fn read(path: &Path, size_px: [usize; 2], bits: u32) -> Result<ImageFile, Refused> {
    let raw = read_raw(path)?;
    let got = raw.picture.size_px;
    if got != size_px {
        return Err(Refused(format!(
            "{}: the image has {} x {} pixels, the camera file {} x {}: give the camera that took it, or change \
         detector.width_px and height_px",
            path.display(),
            got[0],
            got[1],
            size_px[0],
            size_px[1]
        )));
    }
    Ok(ImageFile { picture: justified(raw.picture, bits, path)?, ..raw })
}

/// Reads an image as it is in its file.
///
/// # Errors
/// When the file cannot be read, is damaged, or is not a grey image.
pub fn read_raw(path: &Path) -> Result<ImageFile, Refused> {
    let refuse =
        |what, wanted: &str, got: String| Refused::at(path, format_args!("{what}; wanted {wanted}, got {got}"));
    let unreadable = |error: std::io::Error| refuse("the file cannot be read", "an image file", error.to_string());
    let about = std::fs::metadata(path).map_err(unreadable)?;
    if !about.is_file() {
        return Err(refuse("this is not a file", "a TIFF, PNG or FITS file", "a folder, a pipe or a device".into()));
    }
    let bytes = read_bytes(path, MOST_BYTES).map_err(unreadable)?;
    let image = of_bytes(&bytes).map_err(|(what, wanted, got)| refuse(what, &wanted, got))?;
    if image.picture.dn.iter().any(|dn| !dn.is_finite()) {
        return Err(refuse("a pixel is not a number", "finite values", "NaN or infinity".into()));
    }
    Ok(image)
}

/// The problem, the wanted and the given value.
type Problem = (&'static str, String, String);

/// Reads the bytes of a file by their first ones.
fn of_bytes(bytes: &[u8]) -> Result<ImageFile, Problem> {
    let top_first = |picture| ImageFile { picture, is_row_order_open: false };
    match bytes {
        [b'I', b'I', 42, 0, ..] | [b'M', b'M', 0, 42, ..] | [b'I', b'I', 43, 0, ..] | [b'M', b'M', 0, 43, ..] => {
            of_tiff(bytes).map(top_first)
        }
        [0x89, b'P', b'N', b'G', ..] => of_png(bytes).map(top_first),
        [b'S', b'I', b'M', b'P', b'L', b'E', ..] => of_fits(bytes),
        _ => {
            let first: Vec<String> = bytes.iter().take(4).map(|byte| format!("{byte:02x}")).collect();
            let got = if first.is_empty() {
                "an empty file".into()
            } else {
                format!("a file that starts with {}", first.join(" "))
            };
            Err(("this is not an image of a known format", "TIFF, PNG or FITS".into(), got))
        }
    }
}

fn checked(size: [usize; 2], dn: Vec<f32>) -> Result<Picture, Problem> {
    if dn.len() != size[0] * size[1] || dn.is_empty() {
        let wanted = format!("{} x {} pixels of one channel", size[0], size[1]);
        return Err(("the image is not whole", wanted, format!("{} values", dn.len())));
    }
    Ok(Picture { size_px: size, dn })
}

/// Refuses a size before memory is taken for it.
fn bounded(width: u32, height: u32) -> Result<[usize; 2], Problem> {
    let size = [width as usize, height as usize];
    let pixels = size[0].saturating_mul(size[1]);
    if pixels == 0 || pixels > MOST_PIXELS {
        return Err(("the image's size", format!("1 to {MOST_PIXELS} pixels"), format!("{width} x {height}")));
    }
    Ok(size)
}

/// Returns a refusal that calls a file damaged only where it is.
#[allow(clippy::wildcard_enum_match_arm, reason = "the kinds of another crate")]
fn refused_tiff(error: tiff::TiffError) -> Problem {
    match error {
        tiff::TiffError::UnsupportedError(kind) => (
            "the TIFF file is of a kind that is not read",
            "uncompressed, LZW or deflate, one grey channel".into(),
            kind.to_string(),
        ),
        other => ("the TIFF file is damaged", "a whole TIFF file".into(), other.to_string()),
    }
}

fn of_tiff(bytes: &[u8]) -> Result<Picture, Problem> {
    let mut limits = Limits::default();
    limits.decoding_buffer_size = MOST_PIXELS * size_of::<f32>();
    limits.intermediate_buffer_size = MOST_PIXELS * size_of::<f32>();
    let mut decoder = Decoder::new(Cursor::new(bytes)).map_err(refused_tiff)?.with_limits(limits);
    let (width, height) = decoder.dimensions().map_err(refused_tiff)?;
    let size = bounded(width, height)?;
    let colours = decoder.colortype().map_err(refused_tiff)?;
    if !matches!(colours, ColorType::Gray(8 | 16 | 32)) {
        return Err(("the TIFF file's pixels", "one grey channel of 8, 16 or 32 bits".into(), format!("{colours:?}")));
    }
    #[allow(clippy::wildcard_enum_match_arm, reason = "the kinds of another crate")]
    let dn = match decoder.read_image().map_err(refused_tiff)? {
        DecodingResult::U8(values) => values.into_iter().map(f32::from).collect(),
        DecodingResult::U16(values) => values.into_iter().map(f32::from).collect(),
        DecodingResult::F32(values) => values,
        other => {
            let got = format!("{other:?}").chars().take_while(|c| c.is_alphanumeric()).collect();
            return Err(("the TIFF file's pixels", "unsigned of 8 or 16 bits, or floats of 32".into(), got));
        }
    };
    checked(size, dn)
}

fn of_png(bytes: &[u8]) -> Result<Picture, Problem> {
    let damaged =
        |error: png::DecodingError| ("the PNG file is damaged", "a whole PNG file".to_owned(), error.to_string());
    let limits = png::Limits { bytes: MOST_PIXELS * 2 };
    let decoder = png::Decoder::new_with_limits(Cursor::new(bytes), limits);
    let mut reader = decoder.read_info().map_err(damaged)?;
    let (width, height) = reader.info().size();
    let size = bounded(width, height)?;
    let (colour, depth) = reader.output_color_type();
    let is_grey = colour == png::ColorType::Grayscale;
    if !is_grey || !matches!(depth, png::BitDepth::Eight | png::BitDepth::Sixteen) {
        return Err((
            "the PNG file's pixels",
            "one grey channel of 8 or 16 bits".into(),
            format!("{colour:?}, {depth:?}"),
        ));
    }
    let mut values = vec![0; reader.output_buffer_size().unwrap_or(0)];
    reader.next_frame(&mut values).map_err(damaged)?;
    let dn = match depth {
        png::BitDepth::Sixteen => {
            values.chunks_exact(2).map(|pair| f32::from(u16::from_be_bytes([pair[0], pair[1]]))).collect()
        }
        png::BitDepth::One | png::BitDepth::Two | png::BitDepth::Four | png::BitDepth::Eight => {
            values.into_iter().map(f32::from).collect()
        }
    };
    checked(size, dn)
}

fn of_fits(bytes: &[u8]) -> Result<ImageFile, Problem> {
    #[allow(clippy::wildcard_enum_match_arm, reason = "other errors are of writers")]
    let image = FitsImage::read(bytes).map_err(|error| match error {
        SinkError::DamagedFits { what, wanted, got } => ("the FITS file is damaged", format!("{what}: {wanted}"), got),
        SinkError::BadFits { what, wanted, got } => {
            ("the FITS file is of a kind that is not read", format!("{what}: {wanted}"), got)
        }
        other => ("the FITS file cannot be read", "an image".to_owned(), other.to_string()),
    })?;
    if image.width.saturating_mul(image.height) > MOST_PIXELS {
        return Err((
            "the image's size",
            format!("1 to {MOST_PIXELS} pixels"),
            format!("{} x {}", image.width, image.height),
        ));
    }
    #[allow(clippy::cast_possible_truncation, reason = "digital numbers")]
    let dn = image.top_row_first().into_iter().map(|value| value as f32).collect();
    let picture = checked([image.width, image.height], dn)?;
    Ok(ImageFile { picture, is_row_order_open: !image.states_row_order() })
}

/// Brings values to the numbers of a converter of `bits` bits.
fn justified(raw: Picture, bits: u32, path: &Path) -> Result<Picture, Refused> {
    let most = f64::from((1_u32 << bits) - 1);
    let largest = raw.largest();
    if largest <= most {
        return Ok(raw);
    }
    let scale = f64::from(1_u32 << FILE_BITS.saturating_sub(bits));
    // Saturated pixels are all ones in some files.
    let is_step = |dn: &f32| {
        let dn = f64::from(*dn);
        (dn / scale).fract() == 0.0 || dn >= f64::from(u16::MAX)
    };
    if largest > f64::from(u16::MAX) || !raw.dn.iter().all(is_step) {
        return Err(Refused::at(
            path,
            format_args!(
                "the image has values up to {largest}, the camera file has {bits} bits: wanted values up to {most}, or those \
         values times {scale} (left-justified); correct detector.bits"
            ),
        ));
    }
    #[allow(clippy::cast_possible_truncation, reason = "digital numbers")]
    Ok(raw.map(|_, dn| (f64::from(dn) / scale).floor() as f32))
}
