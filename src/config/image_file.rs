//! Images that a configuration names: FITS files, relative to the file that names them.

use crate::{check::Checker, error::ConfigError};
use base::input_file::{DATA_BYTES, InputFile};
use frames::sink::fits::FitsImage;
use std::io::BufReader;

/// Reads the FITS image that `key` names and holds it to the wanted size; row by row from the top, as floats.
#[allow(clippy::cast_possible_truncation, reason = "maps are used in single precision")]
pub(super) fn read(check: &Checker<'_>, key: &str, path: &str, size_px: [u32; 2]) -> Result<Vec<f32>, ConfigError> {
    let file = check.document.data_beside(path);
    let refuse = |why: String| ConfigError::Read {
        file: file.display().to_string(),
        why,
        named_by: format!(
            "; named by {key} in {}: paths are relative to the file that names them",
            check.document.name()
        ),
    };
    let input = InputFile::open(&file, DATA_BYTES).map_err(|error| refuse(error.to_string()))?;
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
    Ok(image.top_row_first().into_iter().map(|value| value as f32).collect())
}
