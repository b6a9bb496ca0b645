//! Output files of `render`: FITS or PNG by the name's ending, the truth table, the timing line.

use anyhow::{Result, bail};
use base::image::Image;
use frames::sink::{FrameMeta, SentFrame, SinkError, fits, png, truth, write_file_atomically};
use image::gpu::Electrons;
use std::path::Path;

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
