//! `starloop fly`: a test plan flown case by case, and one report of it.

use crate::cli::provenance;
use crate::cli::report::{Writing, parts_of_plan, write};
use anyhow::{Context, Result, bail};
use clap::Args;
use core::sync::atomic::{AtomicUsize, Ordering};
use performance::case_folder::{PLAN, PlanFile};
use performance::fly::{Flight, Flown};
use performance::plan::{Plan, PlanCase, Source};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// Command line of `fly`.
#[derive(Debug, Args)]
#[command(
    after_help = "One folder for each case (run.toml, case.json, frames.csv, tracker_log.csv), plan.json, requirements.toml \
                        and report.html, report.json, report.xml (JUnit). Exit status 4 where a requirement is not met."
)]
pub struct FlyArgs {
    /// Test plan (TOML), such as configs/test_plans/ecss_star_tracker.toml
    plan: PathBuf,
    /// Folder to write into: a new one
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Program under test in place of the plan's tracker, with its arguments: {frames}, {camera} and {log} are replaced
    /// by the paths
    #[arg(long, value_name = "WORD", num_args = 1.., allow_hyphen_values = true)]
    tracker_command: Vec<String>,
    /// Name of the tracker in the report
    #[arg(long, value_name = "NAME")]
    tracker_name: Option<String>,
    /// Only cases whose names begin so; may be repeated
    #[arg(long, value_name = "NAME")]
    case: Vec<String>,
    /// Keep the images that a program under test was given
    #[arg(long)]
    keep_images: bool,
    /// Write the report as PDF too, through Chromium
    #[arg(long)]
    pdf: bool,
    /// Print nothing but the verdict and errors
    #[arg(long)]
    quiet: bool,
}

/// Runs the command; the exit status.
///
/// # Errors
/// With what could not be done, and why.
pub fn run(arguments: &FlyArgs) -> Result<u8> {
    let mut plan = Plan::read(&arguments.plan)?;
    if !arguments.tracker_command.is_empty() {
        plan.tracker.source = Source::Program;
        plan.tracker.command.clone_from(&arguments.tracker_command);
        plan.tracker.model = None;
    }
    plan.tracker.name = arguments.tracker_name.clone().or(plan.tracker.name);
    if arguments.out.join(PLAN).exists() {
        bail!("--out: {} has a flown plan already; wanted another folder", arguments.out.display());
    }
    std::fs::create_dir_all(&arguments.out).with_context(|| arguments.out.display().to_string())?;
    let folder = arguments.plan.parent().map(Path::to_path_buf).unwrap_or_default();
    let mut flight = Flight::new(&plan, &folder, &arguments.out)?;
    flight.keeps_images = arguments.keep_images;
    let flown = fly_all(&plan, &flight, arguments)?;
    let file = plan_file(&plan, &flown);
    keep(&plan, &folder, &file, arguments)?;
    let mut parts = parts_of_plan(&arguments.out, &file)?;
    parts.provenance.seeds = vec![("plan".into(), plan.seed)];
    let names = [Some(arguments.plan.clone()), Some(folder.join(&plan.camera))];
    for path in names.into_iter().flatten().filter(|path| path.exists()) {
        parts.provenance.files.push(provenance::file(&path)?);
    }
    let json = serde_json::to_string_pretty(&parts.provenance)?;
    std::fs::write(arguments.out.join(provenance::FILE), json).context(provenance::FILE)?;
    let out = arguments.out.join("report.html");
    write(&parts, &Writing { out: &out, json: false, pdf: arguments.pdf })
}

/// Flies every case, several at a time.
fn fly_all(plan: &Plan, flight: &Flight<'_>, arguments: &FlyArgs) -> Result<Vec<Flown>> {
    let all: Vec<(&PlanCase, (String, Option<f64>))> =
        plan.cases.iter().flat_map(|case| case.each().into_iter().map(move |each| (case, each))).collect();
    let is_wanted =
        |name: &str| arguments.case.is_empty() || arguments.case.iter().any(|begin| name.starts_with(begin));
    // A case has its number whichever others are flown: its frames are the same.
    let wanted: Vec<_> = (1_u64..).zip(all).filter(|(_, (_, (name, _)))| is_wanted(name)).collect();
    if wanted.is_empty() {
        bail!("--case: no case of the plan begins so; wanted one of its names");
    }
    let done = AtomicUsize::new(0);
    let count = wanted.len();
    let fly = |(number, (case, (name, value))): &(u64, (&PlanCase, (String, Option<f64>)))| {
        let flown = flight.fly(case, (name, *value), *number).with_context(|| format!("case \"{name}\""))?;
        let done = done.fetch_add(1, Ordering::Relaxed) + 1;
        if !arguments.quiet {
            eprintln!("  {done}/{count} {name}: {} frames", flown.frames);
        }
        Ok(flown)
    };
    wanted.par_iter().map(fly).collect()
}

fn plan_file(plan: &Plan, flown: &[Flown]) -> PlanFile {
    let usual = match plan.tracker.source {
        Source::BuiltIn => "built-in tracker".to_owned(),
        Source::Program => plan.tracker.command.join(" "),
        Source::Model => "statistical tracker".to_owned(),
    };
    let settings = plan.settings();
    PlanFile {
        name: plan.name.clone(),
        tracker: plan.tracker.name.clone().unwrap_or(usual),
        camera: plan.camera.file_stem().map_or_else(String::new, |stem| stem.to_string_lossy().into_owned()),
        confidence: settings.confidence,
        probability: settings.probability,
        false_directional_arcsec: settings.false_limit.directional_arcsec,
        false_rotational_arcsec: settings.false_limit.rotational_arcsec,
        exclusion_noise_arcsec: settings.exclusion_noise_arcsec,
        cases: flown.iter().map(|flown| flown.folder.clone()).collect(),
    }
}

/// Writes `plan.json` and a copy of the requirements beside the cases.
fn keep(plan: &Plan, folder: &Path, file: &PlanFile, arguments: &FlyArgs) -> Result<()> {
    let path = arguments.out.join(PLAN);
    std::fs::write(&path, serde_json::to_string_pretty(file)?).with_context(|| path.display().to_string())?;
    if let Some(requirements) = &plan.requirements {
        let from = folder.join(requirements);
        std::fs::copy(&from, arguments.out.join("requirements.toml")).with_context(|| from.display().to_string())?;
    }
    Ok(())
}
