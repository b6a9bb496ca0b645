//! Images that a configuration names: FITS files, relative to the file that names them.

use crate::config::check::Checker;
use crate::config::error::ConfigError;
use crate::sink::fits::FitsImage;
use crate::sink::fits::read::OwnedPixels;
use std::fs::File;
use std::io::BufReader;

/// Reads the FITS image that `key` names and holds it to the wanted size; row by row from the top, as floats.
#[allow(clippy::cast_possible_truncation, reason = "maps are used in single precision")]
pub(super) fn read(check: &Checker<'_>, key: &str, path: &str, size_px: [u32; 2]) -> Result<Vec<f32>, ConfigError> {
    let file = check.document.file_beside(path);
    let refuse = |why: String| ConfigError::Read {
        file: file.display().to_string(),
        why,
        named_by: format!(
            "; named by {key} in {}: paths are relative to the file that names them",
            check.document.name()
        ),
    };
    let input = File::open(&file).map_err(|error| refuse(error.to_string()))?;
    let image = FitsImage::read(BufReader::new(input)).map_err(|error| refuse(error.to_string()))?;
    let [width, height] = size_px.map(|side| side as usize);
    if [image.width, image.height] != [width, height] {
        let got = format!("{path}, an image of {} x {} pixels", image.width, image.height);
        let wanted = format!("{width} x {height} pixels, as the detector has");
        return Err(check.invalid(
            key,
            got,
            wanted,
            "crop or bin the image, or change detector.width_px and height_px",
        ));
    }
    let is_upside_down = image.header.text("ROWORDER").is_some_and(|order| order.trim() == "BOTTOM-UP");
    let pixels: Vec<f32> = match image.pixels {
        OwnedPixels::U16(pixels) => pixels.into_iter().map(f32::from).collect(),
        OwnedPixels::F32(pixels) => pixels,
        OwnedPixels::F64(pixels) => pixels.into_iter().map(|value| value as f32).collect(),
    };
    let top_row_first = || pixels.rchunks_exact(width.max(1)).flatten().copied().collect();
    Ok(if is_upside_down { top_row_first() } else { pixels })
}
