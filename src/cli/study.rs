//! `starloop study`: latency and jitter injected into the closed loop, compared with linear theory: a table and charts.

use crate::cli::{EXIT_DONE, EXIT_NOT_MET, named, report_json::print_json};
use anyhow::Result;
use base::clock::Stopwatch;
use batch::study::{Effort, Study};
use clap::Args;
use config::{Document, Scenario};
use frames::sink::write_file_atomically;
use run::wiring::memory::RunMemory;
use std::path::PathBuf;

/// Width of a progress line.
const LINE_WIDTH: usize = 100;

/// Command line of `study`.
#[derive(Debug, Args)]
#[command(after_help = "Writes study.csv (one row per point: measured, predicted, ratio, verdict) and as SVG: \
                  phase_margin, jitter_rejection and pointing_error. Every point is a run of the closed loop over \
                  pixels on the virtual clock; the same scenario and seed give the same files.\n\n\
                  Exit status 4: a point below the bandwidth is further from linear theory than its tolerance. A whole \
                  study takes some minutes on two cores.")]
pub struct StudyArgs {
    /// Scenario file (TOML) whose camera, bus, spacecraft and control are studied; without one: the built-in study
    scenario: Option<PathBuf>,
    /// Under a minute: fewer points, shorter records
    #[arg(long)]
    quick: bool,
    /// Folder for the table and charts; made where it is missing
    #[arg(long, value_name = "DIR", default_value = "out/study")]
    out: PathBuf,
    /// Seed of patterns and noise instead of the scenario's
    #[arg(long)]
    seed: Option<u64>,
    /// Print the report as one line of JSON
    #[arg(long)]
    json: bool,
}

/// Runs the command; the exit status.
///
/// # Errors
/// When the scenario is refused, a run fails or a file cannot be written.
pub fn run(arguments: &StudyArgs) -> Result<u8> {
    let mut scenario = match &arguments.scenario {
        Some(path) => Scenario::load(path)?,
        None => Scenario::from_document(&Document::built_in("scenarios/study.toml")?)?,
    };
    scenario.bench.seed = arguments.seed.unwrap_or(scenario.bench.seed);
    RunMemory::of_loops(&scenario.bench, scenario.bench.head_count(), usize::MAX, rayon::current_num_threads())
        .check()?;
    // A folder that cannot be made is reported before minutes of measuring.
    named::make_folder("--out", &arguments.out)?;
    let effort = if arguments.quick { Effort::quick() } else { Effort::full() };
    let study = Study::new(&scenario, effort)?;
    let watch = Stopwatch::start();
    let studied = study.run(&|done, total, name| {
        let line = format!("{done}/{total} done in {:.0} s: {name}", watch.elapsed().s());
        eprintln!("{line:.LINE_WIDTH$}");
    })?;
    for file in &studied.files {
        write_file_atomically(&arguments.out.join(&file.name), |out| {
            std::io::Write::write_all(out, file.text.as_bytes())
        })?;
    }
    if arguments.json {
        let files: Vec<&str> = studied.files.iter().map(|file| file.name.as_str()).collect();
        print_json(
            "study",
            serde_json::json!({
                "scenario": scenario.name, "seed": scenario.bench.seed, "met": studied.is_met(),
                "points": studied.points, "folder": arguments.out, "files": files,
            }),
        )?;
    } else {
        print!("{}", studied.summary);
        println!("{} files in {}", studied.files.len(), arguments.out.display());
    }
    Ok(if studied.is_met() { EXIT_DONE } else { EXIT_NOT_MET })
}
