//! `starloop camera export`: the geometry of a camera in the form that a star tracker's program reads.

use crate::cli::named::named_camera;
use anyhow::{Context, Result, bail};
use base::units::ARCSEC_PER_DEG;
use clap::{Args, Subcommand, ValueEnum};
use config::Camera;
use frames::sink::write_file_atomically;
use sky::astrometry::{BrownConrady, CameraGeometry, Distortion};
use std::path::PathBuf;

/// Command line of `camera`.
#[derive(Debug, Args)]
pub struct CameraArgs {
    #[command(subcommand)]
    action: Action,
}

#[derive(Debug, Subcommand)]
enum Action {
    /// Write a camera's geometry in the form that a star tracker's program reads
    Export(ExportArgs),
}

/// Command line of `camera export`.
#[derive(Debug, Args)]
struct ExportArgs {
    /// Camera or bench file (TOML), or the name of a built-in one
    camera: PathBuf,
    /// Program that reads the output
    #[arg(long = "for", value_name = "PROGRAM")]
    program: Program,
    /// Write into this file instead of standard output; one that exists is replaced
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Program {
    /// Options of LOST's command line
    Lost,
    /// Lines of calibration.txt for the image's size and scale
    Openstartracker,
    /// JSON that cv2.FileStorage reads: matrix and distortion
    Opencv,
    /// JSON with the words of `solve_from_centroids` of tetra3 and cedar-solve
    Tetra3,
    /// JSON of NASA's COTS star tracker (cam_config): matrix, distortion, resolution
    Cots,
}

/// Runs the command.
///
/// # Errors
/// When the camera is refused, the program cannot express it, or the file cannot be written.
pub fn run(arguments: &CameraArgs) -> Result<()> {
    let Action::Export(arguments) = &arguments.action;
    let camera = named_camera(Some(&arguments.camera))?;
    let [width_px, height_px] = camera.image_px();
    if [width_px, height_px] != [camera.detector.width_px, camera.detector.height_px] {
        bail!("{}: its images are binned or windowed; wanted a camera that delivers its whole detector", camera.name);
    }
    let geometry = camera.geometry()?;
    let text = exported(&camera, &geometry, arguments.program)?;
    eprintln!("{}", scales(&camera));
    let has_lens = matches!(arguments.program, Program::Opencv | Program::Cots);
    if geometry.is_distorted() && !has_lens {
        eprintln!("left out: the distortion of this camera; --for opencv writes it");
    }
    if is_off_centre(&geometry) && !has_lens {
        eprintln!("left out: the principal point, which is not the image's centre; --for opencv writes it");
    }
    let Some(path) = &arguments.out else {
        print!("{text}");
        return Ok(());
    };
    write_file_atomically(path, |out| std::io::Write::write_all(out, text.as_bytes()))
        .map(|_| ())
        .with_context(|| format!("--out {}", path.display()))
}

/// Returns the field over the width, arcsec per pixel.
///
/// It is less than the scale at the centre, because pixels far from the boresight see smaller angles.
fn mean_scale_arcsec(camera: &Camera) -> f64 {
    camera.fov_deg()[0] * ARCSEC_PER_DEG / f64::from(camera.detector.width_px)
}

fn scales(camera: &Camera) -> String {
    let (centre, mean) = (camera.ifov_arcsec(), mean_scale_arcsec(camera));
    format!("pixel scale without distortion: {centre:.4} arcsec at the centre, {mean:.4} arcsec as field over width")
}

fn is_off_centre(geometry: &CameraGeometry) -> bool {
    let parameters = geometry.parameters();
    let [x, y] = parameters.principal_point_px;
    let centre = |side_px: usize| 0.5 * (side_px as f64 - 1.0);
    (x - centre(parameters.width_px)).hypot(y - centre(parameters.height_px)) > 1e-6
}

fn exported(camera: &Camera, geometry: &CameraGeometry, program: Program) -> Result<String> {
    let [width_px, height_px] = [camera.detector.width_px, camera.detector.height_px];
    let (focal_mm, pitch_um) = (camera.optics.focal_length_mm, camera.detector.pixel_pitch_um);
    Ok(match program {
        Program::Lost => format!("--focal-length {focal_mm} --pixel-size {pitch_um}\n"),
        Program::Openstartracker => {
            format!("IMG_X={width_px}\nIMG_Y={height_px}\nPIXSCALE={:.6}\n", mean_scale_arcsec(camera))
        }
        Program::Opencv => opencv(geometry)?,
        Program::Cots => cots(geometry)?,
        Program::Tetra3 => {
            format!("{{\"size\": [{height_px}, {width_px}], \"fov_estimate\": {:.6}}}\n", camera.fov_deg()[0])
        }
    })
}

/// Returns the distortion as OpenCV orders it: k1, k2, p1, p2, k3.
fn coefficients(geometry: &CameraGeometry) -> Result<[f64; 5]> {
    let Distortion::BrownConrady(BrownConrady { k1, k2, k3, p1, p2 }) = *geometry.distortion() else {
        bail!("--for: the distortion is a polynomial, which OpenCV's coefficients cannot express");
    };
    Ok([k1, k2, p1, p2, k3])
}

fn opencv(geometry: &CameraGeometry) -> Result<String> {
    let [k1, k2, p1, p2, k3] = coefficients(geometry)?;
    let parameters = geometry.parameters();
    let ([fx, fy], [cx, cy]) = (parameters.focal_px, parameters.principal_point_px);
    let matrix = |rows: u8, cols: u8, data: &str| {
        format!(
            "{{\"type_id\": \"opencv-matrix\", \"rows\": {rows}, \"cols\": {cols}, \"dt\": \"d\", \"data\": [{data}]}}"
        )
    };
    let camera = matrix(3, 3, &format!("{fx:?}, 0.0, {cx:?}, 0.0, {fy:?}, {cy:?}, 0.0, 0.0, 1.0"));
    let lens = matrix(1, 5, &format!("{k1:?}, {k2:?}, {p1:?}, {p2:?}, {k3:?}"));
    Ok(format!(
        "{{\n\"image_width\": {},\n\"image_height\": {},\n\"camera_matrix\": {camera},\n\"distortion_coefficients\": {lens}\n}}\n",
        parameters.width_px, parameters.height_px
    ))
}

fn cots(geometry: &CameraGeometry) -> Result<String> {
    let lens = coefficients(geometry)?;
    let parameters = geometry.parameters();
    let ([fx, fy], [cx, cy]) = (parameters.focal_px, parameters.principal_point_px);
    let value = serde_json::json!({
        "camera_matrix": [[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]],
        "dist_coefs": [lens],
        "resolution": [parameters.width_px, parameters.height_px],
    });
    Ok(format!("{value:#}\n"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scale_of_openstartracker_is_field_over_width_not_that_of_the_centre() {
        let camera = named_camera(Some("cameras/star_tracker_20deg.toml".as_ref())).expect("a built-in camera");
        let (centre, mean) = (camera.ifov_arcsec(), mean_scale_arcsec(&camera));
        assert!((mean - 70.32).abs() < 0.005, "{mean}");
        assert!((centre - mean) > 0.5, "{centre}");
    }
}
