//! `starloop calibrate`: what frames cost on this machine, measured and kept for runs on the real clock and `check`.
//!
//! `starloop calibrate` alone means `starloop calibrate costs`; `starloop calibrate display` is a file of its own.

use crate::cli::calibrate_display::{self, DisplayArgs};
use crate::cli::{named::one_of, report_json::print_json, run::args::BACKENDS, terminal::ProgressLine};
use anyhow::{Context, Result};
use base::clock::{Clock, Monotonic, Stopwatch};
use clap::{Args, Subcommand};
use config::Backend;
use core::fmt::Write as _;
use plan::exposure::cost::CostModel;
use run::runtime::Imager;
use run::runtime::calibrate::{Calibration, Effort, calibrate};
use run::runtime::cost_cache::{self, CachedCost, CostOwner};
use std::path::PathBuf;

/// Command line of `calibrate`.
#[derive(Debug, Args)]
#[command(args_conflicts_with_subcommands = true)]
pub struct CalibrateArgs {
    #[command(subcommand)]
    what: Option<What>,
    #[command(flatten)]
    costs: CostArgs,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Measure what frames cost on this machine (also what `calibrate` alone does)
    Costs(CostArgs),
    /// Calibrate a display in front of a tracker: plan, patterns, fit, check; or try it on a simulated bench
    Display(DisplayArgs),
}

#[derive(Debug, Args)]
struct CostArgs {
    /// Backend to measure
    #[arg(long, value_parser = one_of(BACKENDS), default_value = "auto")]
    backend: Backend,
    /// Write the constants to this file and leave the cache alone
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Smaller scenes, fewer repeats: about a second, less exact
    #[arg(long)]
    quick: bool,
    /// Print the report as one line of JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command.
///
/// # Errors
/// When the backend is unavailable or the file cannot be written.
pub fn run(arguments: &CalibrateArgs) -> Result<()> {
    match &arguments.what {
        None => costs(&arguments.costs),
        Some(What::Costs(costs_arguments)) => costs(costs_arguments),
        Some(What::Display(display_arguments)) => calibrate_display::run(display_arguments),
    }
}

fn costs(arguments: &CostArgs) -> Result<()> {
    let choice = arguments.backend;
    let (watch, line) = (Stopwatch::start(), ProgressLine::new());
    let found = calibrate(choice, &Effort::of(choice, arguments.quick), &mut |scene, number, of| {
        line.show(&format!("measuring {number:>2} of {of}: {scene}"));
    })?;
    line.clear();
    let owner = CostOwner::here(found.backend, &found.adapter);
    if !arguments.json {
        print!("{}", table(&found, &owner));
    }
    let path = match (&arguments.out, cost_cache::folder()) {
        (Some(path), _) => path.clone(),
        (None, Some(folder)) => owner.file_in(&folder),
        (None, None) => {
            return Err(anyhow::anyhow!(
                "no folder for the cache: neither XDG_CACHE_HOME nor HOME is an absolute path"
            ))
            .context("wanted --out FILE");
        }
    };
    let cached = CachedCost { measured_utc: Monotonic::start().now().to_rfc3339(), owner, cost: found.cost };
    cost_cache::write(&path, &cached)?;
    let measured_s = watch.elapsed().s();
    if arguments.json {
        return print_json(
            "calibrate",
            serde_json::json!({
                "backend": found.backend, "adapter": found.adapter, "cpu": cached.owner.cpu, "threads": cached.owner.cores,
                "cost": cached.cost, "measured_s": measured_s, "file": path,
            }),
        );
    }
    println!("measured in {measured_s:.1} s, written to {}", path.display());
    Ok(())
}

/// Constants and scenes, for people.
fn table(found: &Calibration, owner: &CostOwner) -> String {
    let mut text = format!(
        "{} backend ({}) on {}, {} threads\n\n  scene                  pixels   stars  measured ms  predicted ms\n",
        found.backend, found.adapter, owner.cpu, owner.cores
    );
    let is_timed_whole = found.backend == "gpu";
    for scene in &found.scenes {
        let pixels = format!("{0} x {0}", scene.side_px);
        let predicted_ms = scene.predicted_ms(&found.cost, is_timed_whole);
        let _ = writeln!(
            text,
            "  {:<18} {pixels:>11} {:>7} {:>12.3} {predicted_ms:>13.3}",
            scene.name, scene.stars, scene.render_ms
        );
    }
    let CostModel { frame_ms, pixel_ns, far_pixel_ns, star_ns, motion_ms, path_step_ns, motion_star_ns, .. } =
        found.cost;
    let CostModel { splat_ns, table_pixel_ns, product_pixel_ns, base_pixel_ns, kernel_node_ns, .. } = found.cost;
    let CostModel { kernel_entry_ns, threads, readout_pixel_ns, .. } = found.cost;
    text.push('\n');
    for (name, value, meaning) in [
        ("frame_ms", frame_ms, "per frame"),
        ("pixel_ns", pixel_ns, "per pixel, cleared and written"),
        ("far_pixel_ns", far_pixel_ns, "per pixel beyond the first 2^20"),
        ("star_ns", star_ns, "per star, placed and sorted"),
        ("motion_ms", motion_ms, "per frame in which something moves"),
        ("path_step_ns", path_step_ns, "per step of following paths and weighing methods"),
        ("motion_star_ns", motion_star_ns, "per star when something moves"),
        ("splat_ns", splat_ns, "per star and node, Gaussian"),
        ("table_pixel_ns", table_pixel_ns, "per star and pixel of a kernel"),
        ("product_pixel_ns", product_pixel_ns, "for each of the products that a kernel is the sum of"),
        ("base_pixel_ns", base_pixel_ns, "per star, node and pixel of the PSF's own table"),
        ("kernel_node_ns", kernel_node_ns, "per node and grid point of an effective PSF"),
        ("kernel_entry_ns", kernel_entry_ns, "per entry of an effective PSF"),
        ("threads", threads, "kernels built side by side"),
        ("readout_pixel_ns", readout_pixel_ns, "per pixel, detector"),
    ] {
        let _ = writeln!(text, "  {name:<17} {value:>10.4}  {meaning}"); // writing to a string does not fail
    }
    text
}

/// Cost constants and where they come from.
#[derive(Debug, Clone, PartialEq)]
pub struct Costs {
    /// Constants measured on this machine; `None`: the backend's built-in ones.
    pub measured: Option<CostModel>,
    /// In words.
    pub origin: String,
}

/// Returns the constants measured for this backend on this machine, if there are any. A cache that cannot be used is
/// reported in one line on the error stream.
pub fn costs_here(imager: &Imager, only_built_in: bool) -> Costs {
    let built_in = |why: &str| Costs { measured: None, origin: format!("built in ({why})") };
    if only_built_in {
        return built_in("as asked for");
    }
    let Some(folder) = cost_cache::folder() else { return built_in("without a home folder to keep others in") };
    let owner = CostOwner::here(imager.name(), &imager.description());
    let path = owner.file_in(&folder);
    match cost_cache::read(&path, &owner) {
        Ok(Some(cached)) => Costs {
            measured: Some(cached.cost),
            origin: format!("measured here on {}, {}", cached.measured_utc, path.display()),
        },
        Ok(None) => built_in("`starloop calibrate` measures those of this machine"),
        Err(error) => {
            eprintln!("starloop: the cached costs are not used: {error}");
            built_in("the cache is not used")
        }
    }
}
