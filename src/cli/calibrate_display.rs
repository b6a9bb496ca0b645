//! `starloop calibrate display`: a display in front of a tracker, from the plan to the file that benches name.
//!
//! `plan` writes the images and what to do with each; `show-pattern` draws one of them again; `fit` reads what the
//! tracker measured (CSV, or a folder with a FITS frame for each image) and writes the calibration; `check` says what a
//! file says, and whether it may be used; `beat` compares a shutter with a refresh rate; `simulate` does all of it on a
//! simulated bench.

use crate::cli::display::{CORNERS, row_share};
use crate::cli::display_measurements::{Measurements, date_of, earlier, measurements_of_folder, sights_of_table};
use crate::cli::named::{named_camera, one_of};
use anyhow::{Context, Result, bail};
use base::clock::{Clock, Monotonic};
use base::input_file::{DATA_BYTES, InputFile};
use base::time::{Span, Tai};
use clap::{Args, Subcommand};
use config::{Camera, Document};
use frames::sink::{png, write_file_atomically};
use glam::DVec2;
use outputs::display::calibration::spots::{FrameScale, sights_of_frame};
use outputs::display::calibration::{
    Calibration, DisplayIdentity, Fitted, Grid, Pattern, Plan, Sight, Tracker, TrackerIdentity, fit,
};
use outputs::display::{
    Corner, beat::BeatInput, calibration::fit::FitOptions, calibration::measurement::write_csv,
    calibration::report::reported, drive::Dither, latency::Latency,
};
use run::wiring::{camera_parts::camera_params, display_parts::SPOT_SIGMA_PX};
use sky::astrometry::CameraGeometry;
use std::path::{Path, PathBuf};
use testbed::display_bench::{BenchTruth, DisplayBench};

/// Command line of `calibrate display`.
#[derive(Debug, Args)]
#[command(
    after_help = "On the bench, in this order:\n  1. plan      writes images and plan.toml, and says what to measure of each\n  \
                  2. show      starloop display show --bits 8 FOLDER/*.png: full screen, Enter shows the next; store the \
                  tracker's frame of\n               each as FITS under the image's name (dots.png: dots.fits), one exposure \
                  for all levels, none saturated;\n               dark.fits with the display off\n  \
                  3. fit       makes display.toml from them and prints the residuals\n  \
                  4. check     before each use: may it be used, what can it show\n  \
                  5. [sink] kind = \"display\", calibration = \"display.toml\" in the bench; starloop check BENCH"
)]
pub(super) struct DisplayArgs {
    #[command(subcommand)]
    step: DisplayStep,
}

#[derive(Debug, Subcommand)]
enum DisplayStep {
    /// Write the images to show, and a plan that says what to measure of each
    Plan(PlanArgs),
    /// Draw one image of a plan again, as PNG
    ShowPattern(ShowArgs),
    /// Fit the measurements, print the residuals, write the calibration
    Fit(FitArgs),
    /// Print a calibration, and whether it may be used with a display and a tracker
    Check(CheckArgs),
    /// Check an exposure time against a refresh rate
    Beat(BeatArgs),
    /// Calibrate a simulated display, collimator and camera, and compare the result with the truth
    Simulate(SimulateArgs),
}

#[derive(Debug, Args)]
struct PlanArgs {
    /// Model and serial number of the display
    #[arg(long)]
    name: String,
    /// Columns of the display, px
    #[arg(long, value_name = "PX")]
    width: usize,
    /// Rows of the display, px
    #[arg(long, value_name = "PX")]
    height: usize,
    /// Bits of a grey, 8 or 10, as the bench's `bits` will be
    #[arg(long, default_value_t = 8)]
    bits: u32,
    /// Camera or bench file of the tracker that looks; without it: the built-in one's
    #[arg(long, value_name = "FILE")]
    camera: Option<PathBuf>,
    /// Dots in a row
    #[arg(long, default_value_t = 16)]
    columns: usize,
    /// Dots in a column
    #[arg(long, default_value_t = 12)]
    rows: usize,
    /// Side of a dot, px, odd
    #[arg(long, default_value_t = 5)]
    dot: usize,
    /// From the display's edge to the first dot's centre, px
    #[arg(long, default_value_t = 20)]
    margin: usize,
    /// Steps of the grey ramp
    #[arg(long, default_value_t = 24)]
    ramp: usize,
    /// Folder for the plan and its images
    #[arg(long, value_name = "FOLDER")]
    out: PathBuf,
}

#[derive(Debug, Args)]
struct ShowArgs {
    /// The plan
    plan: PathBuf,
    /// Name of the image, or its number in the plan, from 0
    pattern: String,
    /// PNG file
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
}

#[derive(Debug, Args)]
struct FitArgs {
    /// The plan
    plan: PathBuf,
    /// Folders with a FITS frame for each image, named like it (level_0.fits of level_0.png), or tables: CSV with the
    /// columns pattern, x_px, y_px, flux, luminance, dot, saturated
    #[arg(long, value_name = "PATH", required = true, num_args = 1..)]
    measurements: Vec<PathBuf>,
    /// When the measurements were made, UTC, such as 2026-03-01T12:00:00Z; without it: DATE-OBS of the first frame
    #[arg(long, value_name = "TIME")]
    measured: Option<String>,
    /// Camera or bench file of the tracker; without it: the built-in one's
    #[arg(long, value_name = "FILE")]
    camera: Option<PathBuf>,
    /// Submit and photodiode times of the marker (CSV: submit_s,edge_s)
    #[arg(long, value_name = "FILE", conflicts_with = "given_latency")]
    latency: Option<PathBuf>,
    /// Where the marker was when --latency was measured
    #[arg(long, value_parser = one_of(CORNERS), default_value = "top-left", requires = "latency")]
    marker_corner: Corner,
    /// From the first row's light to the last row's, milliseconds, of panels that light row by row: about a refresh
    #[arg(long, value_name = "MS", default_value_t = 0.0, requires = "latency")]
    scan_ms: f64,
    /// Latency measured elsewhere, milliseconds
    #[arg(long, value_name = "MS")]
    given_latency: Option<f64>,
    /// Days for which the calibration is valid, from its measurements on
    #[arg(long, value_name = "DAYS", default_value_t = 90)]
    valid_days: u32,
    /// The calibration
    #[arg(long, value_name = "FILE", default_value = "display.toml")]
    out: PathBuf,
}

#[derive(Debug, Args)]
struct CheckArgs {
    /// The calibration
    file: PathBuf,
    /// Plan of the display and the tracker in use; without it and without --camera only damage and age are looked at
    #[arg(long, value_name = "FILE")]
    plan: Option<PathBuf>,
    /// Camera or bench file of the tracker in use
    #[arg(long, value_name = "FILE")]
    camera: Option<PathBuf>,
}

#[derive(Debug, Args)]
struct BeatArgs {
    /// Exposure, seconds
    #[arg(long, value_name = "S")]
    exposure: f64,
    /// Frames per second of the tracker
    #[arg(long, value_name = "HZ")]
    frame_rate: f64,
    /// Refreshes per second of the display
    #[arg(long, value_name = "HZ")]
    refresh: f64,
    /// Share of a refresh during which the display shines: 1 holds its light, 0 is a flash
    #[arg(long, default_value_t = 0.0)]
    duty: f64,
    /// By how much the two clocks may drift apart, parts per million
    #[arg(long, value_name = "PPM", default_value_t = 0.0)]
    drift: f64,
}

/// Runs the command.
///
/// # Errors
/// When a file cannot be read or written, or nothing can be fitted.
pub(super) fn run(arguments: &DisplayArgs) -> Result<()> {
    match &arguments.step {
        DisplayStep::Plan(arguments) => plan(arguments),
        DisplayStep::ShowPattern(arguments) => show_pattern(arguments),
        DisplayStep::Fit(arguments) => fit_measurements(arguments),
        DisplayStep::Check(arguments) => check(arguments),
        DisplayStep::Beat(arguments) => beat(arguments),
        DisplayStep::Simulate(arguments) => simulate(arguments),
    }
}

fn geometry_of(camera: &Camera) -> Result<CameraGeometry> {
    Ok(camera_params(camera)?.geometry)
}

fn plan(arguments: &PlanArgs) -> Result<()> {
    let camera = named_camera(arguments.camera.as_deref())?;
    let tracker = TrackerIdentity::of(&camera.name, &geometry_of(&camera)?);
    let PlanArgs { name, width, height, bits, columns, rows, dot, margin, .. } = arguments;
    let display = DisplayIdentity { name: name.clone(), width_px: *width, height_px: *height, bits: *bits };
    let grid = Grid { columns: *columns, rows: *rows, dot_px: *dot, margin_px: *margin };
    let plan = Plan::new(display, tracker, grid, arguments.ramp)?;
    write_plan(&plan, &arguments.out)?;
    for (number, step) in plan.pattern.iter().enumerate() {
        println!("{number:>3}  {:<12} {}", step.name, step.instruction);
    }
    let folder = arguments.out.display();
    println!("{} images and {PLAN} written to {folder}", plan.pattern.len() - 1);
    println!(
        "next: `starloop display show --bits {bits} {folder}/*.png` on the display, Enter shows the next; store the"
    );
    println!(
        "tracker's frame of each image under its name (dots.png: dots.fits), and dark.fits with the display off; then"
    );
    println!("`starloop calibrate display fit {folder}/{PLAN} --measurements FRAMES`, with the same --camera as here");
    Ok(())
}

fn show_pattern(arguments: &ShowArgs) -> Result<()> {
    let plan = Plan::read(&arguments.plan)?;
    let patterns = plan.patterns();
    let by_number = arguments.pattern.parse().ok().and_then(|number: usize| patterns.get(number).copied());
    let by_name = Pattern::of_name(&arguments.pattern).filter(|pattern| patterns.contains(pattern));
    let Some(pattern) = by_number.or(by_name) else {
        bail!("pattern: wanted a name of the plan or 0 to {}, got {}", patterns.len() - 1, arguments.pattern);
    };
    write_pattern(&plan, pattern, &arguments.out)?;
    println!("{}: {} ({})", pattern.name(), pattern.instruction(), arguments.out.display());
    Ok(())
}

fn fit_measurements(arguments: &FitArgs) -> Result<()> {
    let plan = Plan::read(&arguments.plan)?;
    let camera = named_camera(arguments.camera.as_deref())?;
    let params = camera_params(&camera)?;
    let Measurements { sights, first, missing } = measurements(arguments, &plan, &camera)?;
    let zero_point = camera.zero_point_e_per_s();
    let options = FitOptions {
        made: now(),
        measured: measured(arguments, first)?,
        valid_days: arguments.valid_days,
        zero_point_e_per_s: (zero_point > 0.0).then_some(zero_point),
        latency: latency(arguments)?,
        spot_sigma_px: SPOT_SIGMA_PX,
    };
    let illumination = |tangent| params.illumination.at(tangent);
    let tracker = Tracker { name: &camera.name, geometry: &params.geometry, illumination: &illumination };
    if !missing.is_empty() {
        println!("no frame of {}: fitted without", missing.join(", "));
    }
    let fitted = fit(&plan, &sights, &tracker, &options)?;
    announce(&fitted)?;
    if params.illumination.is_even() {
        println!(
            "  note             the camera's file states no vignetting: all that is seen is taken for the display's"
        );
    }
    fitted.calibration.write(&arguments.out)?;
    println!("written to {}", arguments.out.display());
    Ok(())
}

/// Returns all that was measured, from folders and tables.
fn measurements(arguments: &FitArgs, plan: &Plan, camera: &Camera) -> Result<Measurements> {
    let mut all = Measurements::default();
    for path in &arguments.measurements {
        let found = match path.is_dir() {
            true => measurements_of_folder(path, plan, camera)?,
            false => Measurements { sights: sights_of_table(path)?, ..Measurements::default() },
        };
        all.sights.extend(found.sights);
        all.first = earlier(all.first, found.first);
        all.missing.extend(found.missing);
    }
    let is_missing = |name: &String| all.sights.iter().all(|sight| sight.pattern.name() != *name);
    all.missing.retain(is_missing);
    Ok(all)
}

/// Returns when the measurements were made: as given, or as the first frame says.
fn measured(arguments: &FitArgs, first: Option<Result<Tai>>) -> Result<Tai> {
    match (&arguments.measured, first) {
        (Some(text), _) => date_of(text).context("--measured"),
        (None, Some(first)) => {
            first.context("DATE-OBS: wanted a date, or --measured 2026-03-01T12:00:00Z in its place")
        }
        (None, None) => bail!(
            "when were the measurements made? wanted DATE-OBS in the frames' headers, or --measured 2026-03-01T12:00:00Z: \
             the calibration's age counts from there"
        ),
    }
}

fn latency(arguments: &FitArgs) -> Result<Option<Latency>> {
    match (&arguments.latency, arguments.given_latency) {
        (Some(path), _) => {
            let file = InputFile::open(path, DATA_BYTES).with_context(|| path.display().to_string())?;
            if !(0.0..=1000.0).contains(&arguments.scan_ms) {
                bail!("--scan-ms: wanted 0 to 1000, got {}", arguments.scan_ms);
            }
            let (row_share, scan) = (row_share(arguments.marker_corner), Span::from_s(1e-3 * arguments.scan_ms));
            Ok(Some(Latency::measured(file, row_share, scan).with_context(|| path.display().to_string())?))
        }
        (None, Some(ms)) if !(0.0..=10_000.0).contains(&ms) => bail!("--given-latency: wanted 0 to 10000 ms, got {ms}"),
        (None, ms) => Ok(ms.map(|ms| Latency::given(Span::from_s(1e-3 * ms), Span::ZERO))),
    }
}

fn check(arguments: &CheckArgs) -> Result<()> {
    let calibration = Calibration::read(&arguments.file)?;
    let plan = arguments.plan.as_deref().map(Plan::read).transpose()?;
    let display = plan.as_ref().map_or(&calibration.display, |plan| &plan.display);
    let tracker = match &arguments.camera {
        Some(path) => {
            let camera = named_camera(Some(path))?;
            Some(TrackerIdentity::of(&camera.name, &geometry_of(&camera)?))
        }
        None => plan.as_ref().map(|plan| plan.tracker.clone()),
    };
    print!("{}", reported(&calibration, &calibration.calibrated()?, Dither::over(REPORTED_CYCLE)?));
    calibration.admit(display, tracker.as_ref(), now())?;
    if let Some(plan) = &plan {
        calibration.admit_plan(plan)?;
    }
    let age_days = calibration.age_days(now())?;
    println!("  age              {age_days:.1} of {} days", calibration.valid_days);
    let of = match (&plan, &tracker) {
        (Some(_), _) => "of this plan's display and tracker",
        (None, Some(_)) => "of this tracker; --plan looks at the display too",
        (None, None) => "undamaged and not too old; --plan and --camera look at what it is of",
    };
    println!("may be used: {of}");
    Ok(())
}

fn beat(arguments: &BeatArgs) -> Result<()> {
    let input = BeatInput {
        exposure_s: arguments.exposure,
        frame_period_s: 1.0 / arguments.frame_rate,
        refresh_hz: arguments.refresh,
        duty: arguments.duty,
        drift_ppm: arguments.drift,
    };
    println!("{}", input.beat()?.advice());
    Ok(())
}

// Output of every calibration of a display: its date, its plan with the images, its result.

/// Name of the plan in its folder.
pub(super) const PLAN: &str = "plan.toml";
/// Refreshes of a dither cycle for which magnitudes are printed.
pub(super) const REPORTED_CYCLE: u32 = 16;

/// Returns the present time.
pub(super) fn now() -> Tai {
    Monotonic::start().now()
}

/// Writes the plan and all images, except for a display that is off.
pub(super) fn write_plan(plan: &Plan, folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("the folder {}", folder.display()))?;
    let text = plan.to_toml()?;
    write_file_atomically(&folder.join(PLAN), |out| out.write_all(text.as_bytes()))?;
    for pattern in plan.patterns().into_iter().filter(|pattern| *pattern != Pattern::Dark) {
        write_pattern(plan, pattern, &folder.join(format!("{}.png", pattern.name())))?;
    }
    Ok(())
}

/// Writes greys of 8 bits unchanged; deeper ones as luminances of 16 bits, from which `display show` makes these greys.
pub(super) fn write_pattern(plan: &Plan, pattern: Pattern, path: &Path) -> Result<()> {
    write_file_atomically(path, |out| match plan.display.bits {
        8 => png::write_greys(out, &plan.draw(pattern)),
        _ => png::write_dn_raw(out, &plan.luminances(pattern)),
    })?;
    Ok(())
}

/// Prints the result of a calibration.
pub(super) fn announce(fitted: &Fitted) -> Result<()> {
    print!("{}", reported(&fitted.calibration, &fitted.calibration.calibrated()?, Dither::over(REPORTED_CYCLE)?));
    if fitted.saturated_levels > 0 {
        println!("  note             {} measured levels were left out as saturated", fitted.saturated_levels);
    }
    if !fitted.has_dark {
        println!("  note             no level of `dark` was measured: darkness was taken for nothing");
    }
    Ok(())
}

// `starloop calibrate display simulate`: the whole procedure on a simulated display, collimator and camera, and the
// result against the truth.

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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::display;
    use frames::sink::{png, write_file_atomically};
    use outputs::display::GreyTable;

    fn plan(bits: u32) -> Plan {
        let display = DisplayIdentity { name: "d".into(), width_px: 320, height_px: 200, bits };
        let tracker = TrackerIdentity { name: "t".into(), width_px: 9, height_px: 9, geometry_crc32: "0".into() };
        Plan::new(display, tracker, Grid { columns: 8, rows: 5, dot_px: 5, margin_px: 12 }, 16).unwrap()
    }

    #[test]
    fn display_show_shows_the_very_greys_of_a_plan() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("level.png");
        for bits in [8, 10] {
            let plan = plan(bits);
            let table = GreyTable::by_gamma(bits, 1.0).unwrap();
            for grey in (0..=plan.display.full_grey()).step_by(if bits == 8 { 1 } else { 31 }).chain([1022, 1023]) {
                let grey = grey.min(plan.display.full_grey());
                write_pattern(&plan, Pattern::Level(grey), &path).unwrap();
                let read = display::read(&path).unwrap();
                assert!(read.pixels().iter().all(|luminance| table.nearest(*luminance) == grey), "{bits} bits, {grey}");
            }
            write_pattern(&plan, Pattern::Dots, &path).unwrap();
            let greys: Vec<u16> = display::read(&path).unwrap().pixels().iter().map(|l| table.nearest(*l)).collect();
            assert_eq!(greys, plan.draw(Pattern::Dots).pixels(), "{bits} bits");
        }
        // The negative control: greys as they are, which is what a 16-bit image must not hold.
        let raw = plan(10).draw(Pattern::Level(512));
        write_file_atomically(&path, |out| png::write_dn_raw(out, &raw)).unwrap();
        let shown = GreyTable::by_gamma(10, 1.0).unwrap().nearest(display::read(&path).unwrap().pixels()[0]);
        assert_eq!(shown, 8);
    }
}
