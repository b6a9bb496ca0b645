//! `starloop check`: is this bench sound, what does it mean, what will be drawn and at what error and cost.

use crate::base::time::Tai;
use crate::cli::calibrate::{Costs, costs_here};
use crate::cli::check_plan::{self, Planned};
use crate::cli::frame_plan::FramePlans;
use crate::config::{Bench, StartTime};
use crate::runtime::{Imager, RunParams};
use crate::sky::catalog::Catalog;
use crate::wiring::bench_parts;
use anyhow::Result;
use clap::Args;
use core::fmt::Write;
use std::path::PathBuf;

/// Command line of `check`.
#[derive(Debug, Args)]
pub struct CheckArgs {
    /// Bench file (TOML); without one: the built-in loopback bench
    bench: Option<PathBuf>,
    /// Predict with the built-in costs, whatever `starloop calibrate` has measured
    #[arg(long)]
    built_in_costs: bool,
}

/// Runs the command.
///
/// # Errors
/// With what is wrong with the bench.
pub fn run(arguments: &CheckArgs) -> Result<()> {
    let bench = match &arguments.bench {
        Some(path) => Bench::load(path)?,
        None => Bench::built_in()?,
    };
    print!("{}", report(&bench, arguments.built_in_costs)?);
    Ok(())
}

/// The conventions every number in files and on the wire follows.
const CONVENTIONS: &str = "\
conventions
  axes         ICRF; body; sensor: +Z boresight, +X image right (columns), +Y image down (rows)
  quaternion   Hamilton, scalar first (w x y z), passive: v_sensor = q v_icrf q*
  rate         of the sensor with respect to ICRF, in sensor axes; a later attitude is exp(-w dt / 2) q
  roll         position angle of the image's up direction, east of north; 0: north up, east left
  pixels       x right, y down; the centre of the first pixel is (0, 0); FITS row 0 is the top row
  time         frames carry mid-exposure; UTC in text, TAI inside; microseconds (32 bits) on the wire
  truth        x, y: mean place over the exposure; electrons: what lands on the detector
";

/// The whole report.
fn report(bench: &Bench, only_built_in: bool) -> Result<String> {
    let start = match bench.timing.start {
        StartTime::At(at) => at,
        StartTime::Now => Tai::from_rfc3339("2026-01-01T00:00:00Z")?,
    };
    let mut params = bench_parts::run_params(bench, start)?;
    let imager = bench_parts::imager(&params)?;
    let costs = costs_here(&imager, only_built_in);
    bench_parts::take_real_clock(&mut params, bench, costs.measured);
    let mut text = String::new();
    describe(&mut text, bench, &params, &imager, &costs)?;
    text.push('\n');
    text.push_str(CONVENTIONS);
    text.push('\n');
    crate::cli::check_attitude::write_attitude(&mut text, bench)?;
    plans(&mut text, bench, start, &params, &imager)?;
    Ok(text)
}

fn describe(text: &mut String, bench: &Bench, params: &RunParams, imager: &Imager, costs: &Costs) -> Result<()> {
    let camera = &bench.camera;
    let [fov_x, fov_y] = camera.fov_deg();
    writeln!(text, "bench \"{}\" is sound", bench.name)?;
    writeln!(
        text,
        "  camera       \"{}\": {} x {} px, {fov_x:.2} x {fov_y:.2} deg, {:.2} arcsec/px",
        camera.name,
        camera.detector.width_px,
        camera.detector.height_px,
        camera.ifov_arcsec()
    )?;
    writeln!(
        text,
        "  light        {:.3e} e-/s at magnitude 0, drawn down to G = {}",
        camera.zero_point_e_per_s(),
        camera.radiometry.limiting_mag
    )?;
    let faintest = Catalog::built_in()?.sources().iter().map(|star| star.mag_g).fold(f32::MIN, f32::max);
    if camera.radiometry.limiting_mag > f64::from(faintest) {
        writeln!(
            text,
            "  WARNING      the catalog ends at G = {faintest:.1}: fainter stars are missing from the frames"
        )?;
    }
    let exposure = &camera.exposure;
    writeln!(
        text,
        "  frames       {} at {} Hz, exposure {} s, due {} s after it ends, policy for late ones: {:?}",
        params.frames, bench.timing.frame_rate_hz, exposure.exposure_s, exposure.readout_s, params.deadline_policy
    )?;
    writeln!(text, "  backend      {} ({})", imager.name(), imager.description())?;
    if let Some(note) = imager.note() {
        writeln!(text, "               {note}")?;
    }
    writeln!(text, "  costs        {}", costs.origin)?;
    let budget = &params.budget;
    writeln!(
        text,
        "  budget       centroid {} px, flux {}, pixel {} sigma, line of sight {} arcsec",
        budget.centroid_px, budget.flux_rel, budget.pixel_sigma, budget.los_arcsec
    )?;
    for (what, list) in [("bench", &bench.defaulted), ("camera", &camera.defaulted)] {
        for default in list {
            writeln!(text, "  default      {what}: {} = {}", default.key, default.value)?;
        }
    }
    Ok(())
}

/// Plans of the first, a middle and the last frame, from the simulated flight computer's own truth.
fn plans(text: &mut String, bench: &Bench, start: Tai, params: &RunParams, imager: &Imager) -> Result<()> {
    let planned = Planned::new(bench, params, imager);
    check_plan::write_sampling(text, params)?;
    check_plan::write_ladder(text, &planned)?;
    let mut frames = FramePlans::new(bench, start, params)?;
    let last = params.frames.saturating_sub(1);
    let mut numbers = vec![0, last / 2, last];
    numbers.dedup();
    for number in numbers {
        let mut planner = frames.planner(planned.cost, planned.limit_ms);
        let plan = frames.plan(number, &mut planner)?;
        check_plan::write_plan(text, number, plan, &planned)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_built_in_bench_is_explained() {
        let text = report(&Bench::built_in().unwrap(), true).unwrap();
        for word in
            ["is sound", "passive", "plan of frame 0", "fits", "> ", "bright-stars-only", "supersampled:5", "rung"]
        {
            assert!(text.contains(word), "no \"{word}\" in:\n{text}");
        }
    }
}
