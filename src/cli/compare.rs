//! `starloop compare`: real frames of the night sky against the same fields as starloop draws them.

use crate::cli::named::{declination_deg, one_of, right_ascension_deg};
use crate::cli::{EXIT_DONE, EXIT_NOT_MET, named, render::input::three, report_json::print_json};
use anyhow::{Context, Result, bail};
use base::{axes::sensor_from_ra_dec_roll, time::Tai};
use clap::Args;
use config::{Document, is_camera};
use night_sky::{Compared, Comparer, Options, html, picture::Flip, report};
use std::path::{Path, PathBuf};

/// Command line of `compare`.
#[derive(Debug, Args)]
#[command(
    after_help = "The attitude is found from the stars alone. Then the camera is fitted (focal length, distortion, PSF, zero \
                  point and colour term, vignetting, background, noise), its file is written, and the field is drawn from that \
                  file. An image agrees when the stars above SNR 20, without outliers, are within 0.15 px and 0.15 mag rms beyond \
                  the noise of the drawn frame, at most one and 5 % of them are outliers, the noise of the background is \
                  within 10 %, and the light in 3 x 3 px within 3 %; exit status 4 when one does not.\n\n\
                  Examples:\n  starloop compare night.tiff --camera cameras/imx265_35mm.toml --ground --time 2019-07-29T20:47:26Z\n  \
                  starloop compare *.fits --camera my_camera.toml --out compared"
)]
pub struct CompareArgs {
    /// Images: grey TIFF, PNG or FITS files of the camera's size
    #[arg(value_name = "IMAGE", required = true)]
    images: Vec<PathBuf>,
    /// Camera file from which the fit starts, or the name of a built-in one, such as cameras/imx265_35mm.toml
    #[arg(long, value_name = "CAM")]
    camera: PathBuf,
    /// Middle of the exposures, UTC, for aberration and proper motion; without it, stars are where the catalog has them
    #[arg(long, value_name = "RFC3339", value_parser = Tai::from_rfc3339)]
    time: Option<Tai>,
    /// The images were taken from the ground: the stretch of the air's refraction is fitted too
    #[arg(long)]
    ground: bool,
    /// Attitude to draw with, in place of the fitted one: RA,DEC,ROLL in degrees; the images agree only where it is
    /// right
    #[arg(long, value_name = "RA,DEC,ROLL", allow_hyphen_values = true, value_parser = three)]
    attitude: Option<[f64; 3]>,
    /// Turn the images over before they are compared: rows where the first row is the bottom one, columns where left and right are
    /// exchanged; FITS files without ROWORDER are tried both ways
    #[arg(long, value_name = "WHAT", value_parser = one_of(FLIPS))]
    flip: Option<Flip>,
    /// Layer of stars in place of the built-in catalog, as `starloop catalog import` writes it; may be repeated
    #[arg(long = "layer", value_name = "FILE.starlayer")]
    layers: Vec<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Folder for report.html, the fitted camera files, pictures and tables
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

/// Parts of an image that may be in reverse order.
const FLIPS: &[(&str, &str, Flip)] = &[
    ("rows", "The first row is the bottom one", Flip::Rows),
    ("columns", "Left and right are exchanged", Flip::Columns),
];

/// Runs the command; the exit status.
///
/// # Errors
/// When a file cannot be read or written, or an image shows no stars that are recognised.
pub fn run(arguments: &CompareArgs) -> Result<u8> {
    let document = Document::open(&arguments.camera)?;
    if !is_camera(&document) {
        bail!("--camera {}: wanted a camera file, got a bench; give its camera's file", arguments.camera.display());
    }
    let comparer = Comparer::new(&document, &arguments.camera, options(arguments)?)?;
    let mut compared = Vec::with_capacity(arguments.images.len());
    for image in &arguments.images {
        compared.push(comparer.compare(image)?);
    }
    if arguments.json {
        let report: serde_json::Value = serde_json::from_str(&report::json(&compared)?)?;
        print_json("compare", report)?;
    } else {
        print!("{}", report::text(&compared));
    }
    if let Some(folder) = &arguments.out {
        write(folder, arguments, &compared)?;
    }
    Ok(if compared.iter().all(|one| one.result.agrees) { EXIT_DONE } else { EXIT_NOT_MET })
}

fn options(arguments: &CompareArgs) -> Result<Options> {
    let attitude = match arguments.attitude {
        None => None,
        Some([ra, dec, roll]) => {
            let checked = |word: &str, of: fn(&str) -> Result<f64, String>, value: f64| {
                of(&value.to_string()).map_err(|why| anyhow::anyhow!("--attitude, {word}: {why}"))
            };
            let ra = checked("right ascension", right_ascension_deg, ra)?;
            let dec = checked("declination", declination_deg, dec)?;
            Some(sensor_from_ra_dec_roll(ra.to_radians(), dec.to_radians(), roll.to_radians()))
        }
    };
    let CompareArgs { time, ground, flip, layers, .. } = arguments;
    Ok(Options { time: *time, is_ground: *ground, attitude, flip: *flip, layers: layers.clone() })
}

/// Writes report, pictures, camera files and tables.
fn write(folder: &Path, arguments: &CompareArgs, compared: &[Compared]) -> Result<()> {
    named::make_folder("--out", folder)?;
    let files = html::files(compared, &arguments.camera)?;
    for (name, bytes) in files {
        let path = folder.join(name);
        frames::sink::write_file_atomically(&path, |out| out.write_all(&bytes))
            .with_context(|| format!("--out {}", folder.display()))?;
    }
    if !arguments.json {
        println!("report in {}", folder.join("report.html").display());
    }
    Ok(())
}
