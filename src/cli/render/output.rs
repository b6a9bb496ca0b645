//! Output files of `render`: FITS or PNG by the name's ending, the truth table, the timing line.

use anyhow::{Result, bail};
use base::image::Image;
use frames::sink::{FrameMeta, SentFrame, SinkError, fits, png, truth, write_file_atomically};
use image::gpu::Electrons;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// A format.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// FITS.
    Fits,
    /// PNG, stretched for people.
    Png,
}

/// Returns the format of a file name.
///
/// # Errors
/// When the name ends in neither `.fits` nor `.png`.
pub fn format_of(path: &Path) -> Result<Format> {
    match path.extension().and_then(|ending| ending.to_str()) {
        Some("fits" | "fit") => Ok(Format::Fits),
        Some("png") => Ok(Format::Png),
        _ => bail!("--out {}: wanted a name that ends in .fits or .png", path.display()),
    }
}

/// Writes a read-out frame.
///
/// # Errors
/// When the file cannot be written.
pub fn write_dn(path: &Path, format: Format, frame: &SentFrame) -> Result<u64, SinkError> {
    write_file_atomically(path, |out| match format {
        Format::Fits => fits::write_frame(out, frame),
        Format::Png => png::write_dn_for_people(out, &frame.image),
    })
}

/// Writes a mean image: f32, or f64 from the reference.
///
/// # Errors
/// When the file cannot be written.
pub fn write_electrons(path: &Path, format: Format, mean: &Electrons<'_>, meta: &FrameMeta) -> Result<u64, SinkError> {
    write_file_atomically(path, |out| match (mean, format) {
        (Electrons::Host(image), Format::Fits) => {
            let pixels = fits::Pixels::F32(image.pixels());
            fits::write_electrons(out, image.width(), image.height(), pixels, meta)
        }
        (Electrons::Precise(image), Format::Fits) => {
            let pixels = fits::Pixels::F64(image.pixels());
            fits::write_electrons(out, image.width(), image.height(), pixels, meta)
        }
        (Electrons::Device(_), _) => Err(std::io::Error::other("the image is still on its device")),
        (Electrons::Host(image), Format::Png) => png::write_electrons_for_people(out, image),
        (Electrons::Precise(image), Format::Png) => {
            let mut single = Image::new(image.width(), image.height());
            for (to, from) in single.pixels_mut().iter_mut().zip(image.pixels()) {
                *to = *from as f32;
            }
            png::write_electrons_for_people(out, &single)
        }
    })
}

/// Writes the truth table.
///
/// # Errors
/// When the file cannot be written.
pub fn write_truth(path: &Path, frame: &SentFrame) -> Result<u64, SinkError> {
    write_file_atomically(path, |out| truth::write_truth(out, &frame.truth))
}

// The line that `render` prints about the files it wrote, for people and as JSON.

/// An image and the files that it went into.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub(crate) struct WrittenImage {
    pub(crate) image: PathBuf,
    /// The truth table, where one was asked for.
    pub(crate) truth: Option<PathBuf>,
    pub(crate) camera: String,
    pub(crate) width_px: usize,
    pub(crate) height_px: usize,
    pub(crate) fov_deg: [f64; 2],
    pub(crate) exposure_s: f64,
    /// Sources drawn: stars of the field, or those of `--sources`.
    pub(crate) stars: usize,
    pub(crate) method: String,
    pub(crate) backend: &'static str,
    /// Median times, ms, where they were asked for.
    pub(crate) timing: Option<serde_json::Value>,
}

impl WrittenImage {
    /// Returns the line for people.
    pub(crate) fn line(&self) -> String {
        let [fov_x, fov_y] = self.fov_deg;
        let truth = self.truth.as_ref().map(|path| format!("; truth in {}", path.display())).unwrap_or_default();
        format!(
            "{}: {} x {} px, {fov_x:.2} x {fov_y:.2} deg, {} stars, exposure {} s, camera \"{}\", {} backend{truth}",
            self.image.display(),
            self.width_px,
            self.height_px,
            self.stars,
            self.exposure_s,
            self.camera,
            self.backend
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_names_every_file_and_no_other() {
        let mut written = WrittenImage {
            image: "a.png".into(),
            truth: None,
            camera: "small".into(),
            width_px: 4,
            height_px: 3,
            fov_deg: [2.0, 1.5],
            exposure_s: 0.1,
            stars: 7,
            method: "static".into(),
            backend: "cpu",
            timing: None,
        };
        let line = "a.png: 4 x 3 px, 2.00 x 1.50 deg, 7 stars, exposure 0.1 s, camera \"small\", cpu backend";
        assert_eq!(written.line(), line);
        written.truth = Some("a.csv".into());
        assert_eq!(written.line(), format!("{line}; truth in a.csv"));
    }
}
