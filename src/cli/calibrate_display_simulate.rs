//! `starloop calibrate display simulate`: the whole procedure on a simulated display, collimator and camera, and the
//! result against the truth.

use crate::cli::calibrate_display_output::{announce, now, write_plan};
use anyhow::Result;
use base::time::Span;
use clap::Args;
use config::{Camera, Document};
use frames::sink::write_file_atomically;
use glam::DVec2;
use outputs::display::calibration::spots::{FrameScale, sights_of_frame};
use outputs::display::calibration::{
    DisplayIdentity, Fitted, Grid, Pattern, Plan, Sight, Tracker, TrackerIdentity, fit,
};
use outputs::display::{calibration::fit::FitOptions, calibration::measurement::write_csv, latency::Latency};
use run::wiring::{camera_parts::camera_params, display_parts::SPOT_SIGMA_PX};
use std::path::{Path, PathBuf};
use testbed::display_bench::{BenchTruth, DisplayBench};

/// Exposure of the simulated tracker, s.
const SIMULATED_EXPOSURE_S: f64 = 0.1;

/// Command line of `simulate`.
#[derive(Debug, Args)]
pub(super) struct SimulateArgs {
    /// Seed of the noise
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Folder for the plan, its images, the measurements and the calibration
    #[arg(long, value_name = "FOLDER")]
    out: Option<PathBuf>,
}

/// Returns the simulated tracker as a camera file. Its pixels are 10 um.
fn tracker_file(truth: &BenchTruth) -> String {
    let ([width, height], [x, y]) = (truth.tracker_px, truth.tracker_centre_px);
    format!(
        "# The tracker of the simulated bench.\nname = \"simulated tracker\"\n\n[detector]\nwidth_px = {width}\n\
         height_px = {height}\npixel_pitch_um = 10.0\n\n[optics]\nfocal_length_mm = {:?}\naperture_mm = 20.0\n\
         principal_point_px = [{x:?}, {y:?}]\n\n[distortion]\nk1 = {:?}\n\n[exposure]\n\
         exposure_s = {SIMULATED_EXPOSURE_S:?}\n",
        truth.tracker_focal_px * 0.01,
        truth.tracker_radial,
    )
}

/// Returns a bench that shows stars on the simulated display: in a window, since the monitor does not exist.
fn bench_file(display: &DisplayIdentity) -> String {
    let (width, height) = (display.width_px, display.height_px);
    format!(
        "# Stars on a calibrated display: one frame per refresh, drawn ahead of its light.\nname = \"on a display\"\n\
         camera = \"tracker.toml\"\n\n[timing]\nframe_rate_hz = 60.0   # the refresh rate\nduration_s = 10.0\n\
         deadline_policy = \"late\"\nstart_utc = \"2026-03-01T00:00:00Z\"\n\n[flight_computer]\nkind = \"simulated\"\n\
         attitude_hz = 100.0\nra_deg = 84.05           # the belt of Orion\ndec_deg = -1.2\n\n[sink]\nkind = \"display\"\n\
         calibration = \"display.toml\"\nname = \"{}\"\nwindow = [{width}, {height}]  # leave out for the whole monitor\n",
        display.name
    )
}

/// Runs the command.
///
/// # Errors
/// When the fit is refused or a file cannot be written.
pub(super) fn simulate(arguments: &SimulateArgs) -> Result<()> {
    let truth = BenchTruth { seed: arguments.seed, ..BenchTruth::crooked() };
    let text = tracker_file(&truth);
    let camera = Camera::from_document(&Document::from_text(&text, Path::new("tracker.toml")))?;
    let tracker = camera_params(&camera)?.geometry;
    let [width_px, height_px] = truth.display_px;
    let display = DisplayIdentity { name: "simulated display".into(), width_px, height_px, bits: truth.bits };
    let grid = Grid { columns: 16, rows: 12, dot_px: 5, margin_px: 14 };
    let plan = Plan::new(display, TrackerIdentity::of("simulated tracker", &tracker), grid, 24)?;
    let mut bench = DisplayBench::new(truth);
    let sights = simulated_sights(&mut bench, &plan);
    let flips = bench.flips_csv(200, 0.0285, 0.0004);
    let made = now();
    let options = FitOptions {
        made,
        measured: made,
        valid_days: 90,
        zero_point_e_per_s: Some(camera.zero_point_e_per_s()),
        latency: Some(Latency::measured(flips.as_bytes(), 0.0, Span::ZERO)?),
        spot_sigma_px: SPOT_SIGMA_PX,
    };
    // Its tracker vignettes nothing.
    let looking = Tracker { name: "simulated tracker", geometry: &tracker, illumination: &|_| 1.0 };
    let fitted = fit(&plan, &sights, &looking, &options)?;
    announce(&fitted)?;
    let error_px = worst_error_px(&bench.truth, &fitted);
    let error_arcsec = error_px * fitted.map.geometry.arcsec_per_px();
    println!("  against truth    {error_px:.4} display px = {error_arcsec:.3} arcsec at worst, between all dots");
    if let Some(folder) = &arguments.out {
        write_plan(&plan, folder)?;
        let mut table = Vec::new();
        write_csv(&mut table, &sights)?;
        write_file_atomically(&folder.join("measurements.csv"), |out| out.write_all(&table))?;
        write_file_atomically(&folder.join("latency.csv"), |out| out.write_all(flips.as_bytes()))?;
        fitted.calibration.write(&folder.join("display.toml"))?;
        for (name, text) in [("tracker.toml", text), ("bench.toml", bench_file(&plan.display))] {
            write_file_atomically(&folder.join(name), |out| out.write_all(text.as_bytes()))?;
        }
        println!("plan, images, measurements, calibration, tracker and a bench written to {}", folder.display());
    }
    Ok(())
}

fn simulated_sights(bench: &mut DisplayBench, plan: &Plan) -> Vec<Sight> {
    let BenchTruth { gain_e_per_dn, black_level_dn, .. } = bench.truth;
    let (largest_dn, full_well_e) = (u16::MAX, f64::INFINITY);
    let scale = FrameScale { gain_e_per_dn, black_level_dn, exposure_s: SIMULATED_EXPOSURE_S, largest_dn, full_well_e };
    let mut sights = Vec::new();
    for pattern in plan.patterns() {
        let frame = match pattern {
            Pattern::Dark => bench.frame(None),
            Pattern::Level(_) | Pattern::Dots | Pattern::DotsBit(_) | Pattern::Marker(_) => {
                bench.frame(Some(&plan.draw(pattern)))
            }
        };
        sights.extend(sights_of_frame(pattern, &scale.applied(&frame), scale.saturated_from()));
    }
    sights
}

/// Returns the largest error of the map over what its dots cover, display px.
fn worst_error_px(truth: &BenchTruth, fitted: &Fitted) -> f64 {
    const STEPS: u32 = 40;
    let [left, right, top, bottom] = fitted.map.geometry.covered().range_px();
    let along = |from: f64, to: f64, i: u32| from + (to - from) * f64::from(i) / f64::from(STEPS);
    let places = (0..=STEPS).flat_map(|i| (0..=STEPS).map(move |j| (i, j)));
    let error = |(i, j)| {
        let px = DVec2::new(along(left, right, i), along(top, bottom, j));
        let found = fitted.map.geometry.project(truth.direction(px));
        found.map_or(f64::INFINITY, |found| DVec2::from(found).distance(px))
    };
    places.map(error).fold(0.0, f64::max)
}
