//! `starloop calibrate display`: a display in front of a tracker, from the plan to the file that benches name.
//!
//! `plan` writes the images and what to do with each; `show-pattern` draws one of them again; `fit` reads what the tracker
//! measured (CSV, or a folder with a FITS frame for each image) and writes the calibration; `check` says whether a
//! file may be used; `beat` holds a shutter against a refresh rate; `simulate` does all of it on a simulated bench.

use crate::astrometry::CameraGeometry;
use crate::base::clock::{Clock, Monotonic};
use crate::base::time::{Span, Tai};
use crate::cli::calibrate_display_simulate::{SimulateArgs, simulate};
use crate::cli::display_measurements::{sights_of_folder, sights_of_table};
use crate::cli::named_camera::named_camera;
use crate::config::Camera;
use crate::display::beat::BeatInput;
use crate::display::calibration::fit::FitOptions;
use crate::display::calibration::report::told;
use crate::display::calibration::{Calibration, DisplayIdentity, Fitted, Grid, Pattern, Plan, TrackerIdentity, fit};
use crate::display::dither::Dither;
use crate::display::latency::Latency;
use crate::sink::{png, write_file_atomically};
use crate::wiring::camera_parts::camera_params;
use anyhow::{Context, Result, bail};
use clap::{Args, Subcommand};
use std::fs::File;
use std::path::{Path, PathBuf};

/// Name of the plan in its folder.
const PLAN: &str = "plan.toml";
/// Refreshes of a dither cycle that magnitudes are told for.
const TOLD_CYCLE: u32 = 16;
/// Command line of `calibrate display`.
#[derive(Debug, Args)]
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
    /// Fit what was measured, tell the residuals, write the calibration
    Fit(FitArgs),
    /// Tell what a calibration says, and whether it may be used with a display and a tracker
    Check(CheckArgs),
    /// Hold an exposure against a refresh rate
    Beat(BeatArgs),
    /// Calibrate a simulated display, collimator and camera, and hold the result against the truth
    Simulate(SimulateArgs),
}

#[derive(Debug, Args)]
struct PlanArgs {
    /// What tells the display from others: model and serial number
    #[arg(long)]
    name: String,
    /// Columns of the display, px
    #[arg(long, value_name = "PX")]
    width: usize,
    /// Rows of the display, px
    #[arg(long, value_name = "PX")]
    height: usize,
    /// Bits of a grey
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
    /// Tables (CSV) or folders with a FITS frame for each image, named like it
    #[arg(long, value_name = "PATH", required = true, num_args = 1..)]
    measurements: Vec<PathBuf>,
    /// Camera or bench file of the tracker; without it: the built-in one's
    #[arg(long, value_name = "FILE")]
    camera: Option<PathBuf>,
    /// Submit and photodiode times of the marker (CSV: submit_s,edge_s)
    #[arg(long, value_name = "FILE", conflicts_with = "given_latency")]
    latency: Option<PathBuf>,
    /// Latency that somebody gives, milliseconds
    #[arg(long, value_name = "MS")]
    given_latency: Option<f64>,
    /// Days for which the calibration is valid
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
    /// Plan of the display and the tracker in use; without it only damage and age are looked at
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

pub(super) fn now() -> Tai {
    Monotonic::start().now()
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
    println!("{} images and {PLAN} written to {}", plan.pattern.len() - 1, arguments.out.display());
    Ok(())
}

/// The plan and all images save the one of a display that is off.
pub(super) fn write_plan(plan: &Plan, folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder).with_context(|| format!("the folder {}", folder.display()))?;
    let text = plan.to_toml()?;
    write_file_atomically(&folder.join(PLAN), |out| out.write_all(text.as_bytes()))?;
    for pattern in plan.patterns().into_iter().filter(|pattern| *pattern != Pattern::Dark) {
        write_pattern(plan, pattern, &folder.join(format!("{}.png", pattern.name())))?;
    }
    Ok(())
}

/// Greys as they are in 8 bits; deeper ones as the same numbers in 16 bits.
fn write_pattern(plan: &Plan, pattern: Pattern, path: &Path) -> Result<()> {
    let image = plan.draw(pattern);
    write_file_atomically(path, |out| {
        if plan.display.bits <= 8 { png::write_greys(out, &image) } else { png::write_dn_raw(out, &image) }
    })?;
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
    let geometry = geometry_of(&camera)?;
    let mut sights = Vec::new();
    for path in &arguments.measurements {
        sights.extend(if path.is_dir() { sights_of_folder(path, &plan, &camera)? } else { sights_of_table(path)? });
    }
    let zero_point = camera.zero_point_e_per_s();
    let options = FitOptions {
        made: now(),
        valid_days: arguments.valid_days,
        zero_point_e_per_s: (zero_point > 0.0).then_some(zero_point),
        latency: latency(arguments)?,
    };
    let fitted = fit(&plan, &sights, (&camera.name, &geometry), &options)?;
    tell(&fitted)?;
    fitted.calibration.write(&arguments.out)?;
    println!("written to {}", arguments.out.display());
    Ok(())
}

fn latency(arguments: &FitArgs) -> Result<Option<Latency>> {
    match (&arguments.latency, arguments.given_latency) {
        (Some(path), _) => {
            let file = File::open(path).with_context(|| path.display().to_string())?;
            Ok(Some(Latency::measured(file, 0.0, Span::ZERO).with_context(|| path.display().to_string())?))
        }
        (None, Some(ms)) if !(0.0..=10_000.0).contains(&ms) => bail!("--given-latency: wanted 0 to 10000 ms, got {ms}"),
        (None, ms) => Ok(ms.map(|ms| Latency::given(Span::from_s(1e-3 * ms), Span::ZERO))),
    }
}

pub(super) fn tell(fitted: &Fitted) -> Result<()> {
    print!("{}", told(&fitted.calibration, &fitted.calibration.calibrated()?, Dither::over(TOLD_CYCLE)));
    if !fitted.has_dark {
        println!("  note             no level of `dark` was measured: darkness was taken for nothing");
    }
    Ok(())
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
    print!("{}", told(&calibration, &calibration.calibrated()?, Dither::over(TOLD_CYCLE)));
    calibration.admit(display, tracker.as_ref(), now())?;
    println!("  age              {:.1} days: may be used", calibration.age_days(now())?);
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
