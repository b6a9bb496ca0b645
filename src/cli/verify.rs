//! `starloop verify`: compares a camera's own frames with its file: photon transfer, and errors by brightness.

use crate::cli::named::{named_camera, one_of};
use crate::cli::{EXIT_DONE, EXIT_NOT_MET, report_json::print_json, run::args::BACKENDS};
use anyhow::{Context, Result, bail};
use base::image::{DnImage, ElectronImage, Image};
use base::{accuracy::AccuracyBudget, axes::Rotation, time::Tai};
use batch::verify::data_sheet::{Comparison, Stated};
use batch::verify::export::{About, DESCRIPTOR, export};
use batch::verify::fidelity::{Fidelity, Truth};
use batch::verify::{DataSheet, Flat, Procedure, StarField, characterise, fidelity, table};
use clap::Args;
use config::Backend;
use frames::{report::to_svg, sink::write_file_atomically};
use image::detector::{Detector, DetectorConditions, DetectorParams, Nonlinearity, Patterns, SpatialParams};
use plan::exposure::{MethodChoice, Planner};
use plan::{attitude::LosPath, optics::Illumination};
use run::{runtime::Imager, wiring::camera_parts::camera_params};
use scene::camera::CameraParams;
use std::path::{Path, PathBuf};

/// The camera of a command line without one.
const BUILT_IN: &str = "cameras/cubesat_tracker.toml";
/// Side of the flats, px.
const FLAT_PX: usize = 512;
/// Dark signal at the end of the dark series, e-.
const DARK_SIGNAL_E: f64 = 100.0;
/// Least signal-to-noise ratio of the stars.
const LEAST_SNR: f64 = 3.0;
/// Share of saturation that the brightest star's pixel reaches.
const MOST_WELL: f64 = 0.6;
/// Brightnesses.
const STEPS: i32 = 6;
/// Smallest detector on which stars of every brightness find a place, px.
const LEAST_SIDE_PX: usize = 160;

/// Command line of `verify`.
#[derive(Debug, Args)]
#[command(
    after_help = "Photon transfer, in the manner of EMVA 1288: pairs of flats at 50 levels of light, darks and stacks of both, \
                  from which gain, noise, dark current, patterns and saturation are found from digital numbers alone.\n\n\
                  Errors by brightness: stars at random parts of a pixel in many noisy frames, against analytic truth: \
                  signal-to-noise ratio, centroid and its scatter, energy in 7 x 7 px, background in places of 20 x 20 px. \
                  +-: one standard error, which more --frames make smaller.\n\n\
                  --export: pairs at 50 levels of light and stacks, with the effects off that the report names: some 100 MB for \
                  PyPI's emva1288 and programs like it.\n\n\
                  Exits with 4 when a property is more than 1 % (dark current: 2 %) off the file."
)]
pub struct VerifyArgs {
    /// Camera or bench file (TOML), or a built-in one such as cameras/cubesat_tracker.toml, which is taken without one
    camera: Option<PathBuf>,
    /// Frames of the star field
    #[arg(long, default_value_t = 300, value_parser = clap::value_parser!(u32).range(2..=65_536))]
    frames: u32,
    /// Backend that draws the star field; flats are read out by the CPU
    #[arg(long, value_parser = one_of(BACKENDS), default_value = "auto")]
    backend: Backend,
    /// Seed of patterns and noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Write the photon transfer curve
    #[arg(long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
    /// Write flats and darks as 16-bit PNG with a descriptor of EMVA 1288, into a new folder or an empty one
    #[arg(long, value_name = "DIR")]
    export: Option<PathBuf>,
    /// Print the report as one line of JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command; the exit status.
///
/// # Errors
/// With what is wrong with the camera file.
pub fn run(arguments: &VerifyArgs) -> Result<u8> {
    let named = arguments.camera.as_deref().unwrap_or(Path::new(BUILT_IN));
    let file = named_camera(Some(named))?;
    let mut camera = camera_params(&file)?;
    if let Some(folder) = &arguments.export {
        make_empty_folder(folder)?;
    }
    let mut off;
    (camera.detector, off) = plain(&camera.detector);
    if camera.patterns != Patterns::default() {
        off.push("maps (of the flats only)");
    }
    camera.illumination = Illumination::EVEN;
    let procedure = procedure(&camera);
    let sheet = characterise([FLAT_PX; 2], &procedure, &mut flats(&camera, arguments.seed));
    if let Some(folder) = &arguments.export {
        // Where the efficiency depends on wavelength, photons have no number: the light is in electrons.
        let electrons_per_photon = if file.band.is_some() { 1.0 } else { file.detector.quantum_efficiency };
        let about = About { name: &camera.name, bits: camera.detector.bits, electrons_per_photon };
        let images = export(folder, [FLAT_PX; 2], about, (&procedure, &sheet), &mut flats(&camera, arguments.seed))?;
        eprintln!("{images} images and their descriptor: {}", folder.join(DESCRIPTOR).display());
    }
    let lines = sheet.compare(&Stated::of(&camera.detector, camera.exposure_s));
    let (stars, backend) = stars(&camera, arguments)?;
    let verified = Verified { camera, sheet, lines, off, stars, backend };
    if arguments.json {
        print_json("verify", verified.facts())?;
    } else {
        verified.print();
    }
    if let Some(path) = &arguments.plot {
        let text = to_svg(&verified.sheet.chart(&verified.camera.name));
        write_file_atomically(path, |out| out.write_all(text.as_bytes()))?;
    }
    Ok(if verified.holds() { EXIT_DONE } else { EXIT_NOT_MET })
}

/// Everything that was found about a camera.
struct Verified {
    camera: CameraParams,
    sheet: DataSheet,
    lines: [Comparison; 8],
    off: Vec<&'static str>,
    stars: Fidelity,
    backend: &'static str,
}

impl Verified {
    fn holds(&self) -> bool {
        self.lines.iter().all(Comparison::holds)
    }

    /// Prints both tables for people.
    fn print(&self) {
        let Self { camera, sheet, lines, off, stars, backend } = self;
        println!("\"{}\": photon transfer from flats of {FLAT_PX} x {FLAT_PX} px", camera.name);
        print!("{}", table::data_sheet(lines));
        for what in off {
            println!("  switched off for the measurement: {what}");
        }
        println!(
            "  largest deviation from a straight line, 5 to 95 % of saturation: {:.3} %\n",
            100.0 * sheet.linearity_error
        );
        let mag_of =
            |electrons| camera.radiometry.mag_g_of_electrons(electrons, 0.0, camera.exposure_s).unwrap_or(f64::NAN);
        println!("errors by brightness, {} frames, {backend} backend", stars.frames);
        print!("{}", table::fidelity(stars, mag_of));
    }

    /// Returns both tables as JSON.
    fn facts(&self) -> serde_json::Value {
        let line = |line: &Comparison| {
            serde_json::json!({
                "name": line.name, "unit": line.unit, "file": line.file, "measured": line.measured, "error": line.error(),
                "most": line.most, "standard_error": line.se, "holds": line.holds(),
            })
        };
        serde_json::json!({
            "camera": self.camera.name.to_string(),
            "holds": self.holds(),
            "data_sheet": self.lines.iter().map(line).collect::<Vec<_>>(),
            "switched_off": self.off,
            "linearity_error": self.sheet.linearity_error,
            "frames": self.stars.frames,
            "backend": self.backend,
            "stars": self.stars.rows,
        })
    }
}

/// Makes a folder for exported images.
fn make_empty_folder(folder: &Path) -> Result<()> {
    let shown = || format!("--export {}", folder.display());
    std::fs::create_dir_all(folder).with_context(shown)?;
    if std::fs::read_dir(folder).with_context(shown)?.next().is_some() {
        bail!("--export: {} has files in it; wanted a new folder or an empty one", folder.display());
    }
    Ok(())
}

fn procedure(camera: &CameraParams) -> Procedure {
    Procedure::new(camera.exposure_s, DARK_SIGNAL_E / camera.detector.operating_dark_e_per_s().max(1e-6))
}

/// Returns the laboratory's camera in even light.
fn flats(camera: &CameraParams, seed: u64) -> impl FnMut(Flat, &mut DnImage) + use<> {
    let mut detector = Detector::new(camera.detector, FLAT_PX, FLAT_PX, seed);
    let mut light: ElectronImage = Image::new(FLAT_PX, FLAT_PX);
    move |flat, image| {
        #[allow(clippy::cast_possible_truncation, reason = "electron images are single precision")]
        light.pixels_mut().fill(flat.light_e as f32);
        detector.collect(&light, flat.frame, &DetectorConditions::dark(flat.exposure_s), image);
    }
}

/// Returns the detector without what a laboratory would switch off to measure the rest, and what that is.
fn plain(params: &DetectorParams) -> (DetectorParams, Vec<&'static str>) {
    // The layer that protons pass is not an effect.
    let spatial = SpatialParams { layer: params.spatial.layer, ..SpatialParams::OFF };
    let plain = DetectorParams { spatial, nonlinearity: Nonlinearity::OFF, ..*params };
    let off = [
        ("colour filter, effects of neighbours, defects, protons, window and binning", params.spatial != spatial),
        ("bent response", params.nonlinearity.is_on()),
    ];
    (plain, off.into_iter().filter(|(_, is_on)| *is_on).map(|(what, _)| what).collect())
}

/// Returns the errors by brightness, and the backend that drew the stars.
fn stars(camera: &CameraParams, arguments: &VerifyArgs) -> Result<(Fidelity, &'static str)> {
    let size_px = [camera.geometry.width_px(), camera.geometry.height_px()];
    if size_px.iter().any(|side| *side < LEAST_SIDE_PX) {
        bail!(
            "a detector of {} x {} px: wanted {LEAST_SIDE_PX} px or more on both sides, for stars that do not overlap",
            size_px[0],
            size_px[1]
        );
    }
    let detector = camera.make_detector(arguments.seed)?;
    let truth = Truth::of(&detector, camera.psf.clone(), camera.exposure_s);
    let field = StarField::new(size_px, brightnesses(camera, &truth), 21);
    let backend = arguments.backend;
    let mut imager = Imager::of_detector(backend, detector)?;
    let los = LosPath::commanded(Rotation::IDENTITY, Tai::from_ns(0), camera.exposure_s);
    let mut planner =
        Planner::new(camera.instrument(), AccuracyBudget::default(), imager.cost, MethodChoice::Auto, los);
    let plan = planner.plan(&field.sources());
    let conditions = DetectorConditions::dark(camera.exposure_s);
    let measured = fidelity::measure(&field, &truth, size_px, arguments.frames, |frame, image: &mut DnImage| {
        imager.image(plan, frame, &conditions, image).map(|_| ())
    })?;
    Ok((measured, imager.name()))
}

/// Returns the even steps of magnitude, from the least signal-to-noise ratio to well below saturation.
fn brightnesses(camera: &CameraParams, truth: &Truth) -> Vec<f64> {
    let least_e = truth.electrons_for_snr(LEAST_SNR);
    let most_e = MOST_WELL * Stated::of(&camera.detector, camera.exposure_s).saturation_e / camera.psf.peak();
    let step = (most_e / least_e).max(1.0).powf(1.0 / f64::from(STEPS - 1));
    (0..STEPS).map(|i| least_e * step.powi(i)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn flats_go_into_a_new_or_empty_folder_only() {
        let folder = tempfile::tempdir().unwrap();
        make_empty_folder(folder.path()).unwrap();
        make_empty_folder(&folder.path().join("new/one")).unwrap();
        let refused = make_empty_folder(folder.path()).unwrap_err().to_string();
        assert!(refused.contains("has files in it"), "{refused}");
    }
}
