//! What a tracker measured of a display's images -> sights: tables, or folders of FITS frames.

use crate::base::image::{DnImage, Image};
use crate::config::Camera;
use crate::display::calibration::measurement::read_csv;
use crate::display::calibration::spots::{FrameScale, sights_of_frame};
use crate::display::calibration::{Plan, Sight};
use crate::sink::fits::FitsImage;
use crate::sink::fits::read::OwnedPixels;
use anyhow::{Context, Result, bail};
use std::fs::File;
use std::path::Path;

/// The rows of a table.
pub(super) fn sights_of_table(path: &Path) -> Result<Vec<Sight>> {
    let file = File::open(path).with_context(|| path.display().to_string())?;
    Ok(read_csv(file, path)?)
}

/// What the frames of a folder show; images without a frame are left out.
pub(super) fn sights_of_folder(folder: &Path, plan: &Plan, camera: &Camera) -> Result<Vec<Sight>> {
    let mut sights = Vec::new();
    for pattern in plan.patterns() {
        let path = folder.join(format!("{}.fits", pattern.name()));
        if path.exists() {
            sights.extend(sights_of_frame(pattern, &frame_of(&path, camera)?));
        }
    }
    Ok(sights)
}

/// A frame in electrons per second: digital numbers by the camera's file, electrons (float images) as they are.
fn frame_of(path: &Path, camera: &Camera) -> Result<Image<f64>> {
    let file = File::open(path).with_context(|| path.display().to_string())?;
    let fits = FitsImage::read(std::io::BufReader::new(file)).with_context(|| path.display().to_string())?;
    let exposure_s = fits.header.real("EXPTIME").filter(|s| *s > 0.0).unwrap_or(camera.exposure.exposure_s);
    let wanted = [camera.detector.width_px as usize, camera.detector.height_px as usize];
    if [fits.width, fits.height] != wanted {
        let got = format!("{} x {}", fits.width, fits.height);
        bail!("{}: wanted the camera's {} x {} px, got {got}", path.display(), wanted[0], wanted[1]);
    }
    let of = |values: Vec<f64>| {
        let mut image = Image::new(wanted[0], wanted[1]);
        image.pixels_mut().copy_from_slice(&values);
        image
    };
    Ok(match fits.pixels {
        OwnedPixels::U16(values) => {
            let mut frame = DnImage::new(wanted[0], wanted[1]);
            frame.pixels_mut().copy_from_slice(&values);
            let (gain_e_per_dn, black_level_dn) = (camera.detector.gain_e_per_dn, camera.detector.black_level_dn);
            FrameScale { gain_e_per_dn, black_level_dn, exposure_s }.applied(&frame)
        }
        OwnedPixels::F32(values) => of(values.iter().map(|e| f64::from(*e) / exposure_s).collect()),
        OwnedPixels::F64(values) => of(values.iter().map(|e| e / exposure_s).collect()),
    })
}
