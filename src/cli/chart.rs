//! `starloop chart`: accuracy against speed, measured on this machine -> CSV tables and SVG charts in a folder.

use crate::cli::{named, named::one_of, report_json::print_json, terminal::ProgressLine};
use anyhow::Result;
use base::clock::Stopwatch;
use batch::chart::{self, Backends, Settings};
use clap::Args;
use frames::{report::step_line, sink::write_file_atomically};
use std::path::PathBuf;

/// Width of the progress line.
const LINE_WIDTH: usize = 79;
/// Without a terminal, a line every so many parts of the whole.
const REPORTED: usize = 10;

/// Command line of `chart`.
#[derive(Debug, Args)]
#[command(
    after_help = "Writes methods.csv, sampling.csv, poisson.csv, prediction.csv, footprint.csv, effects.csv and crowding.csv, and as SVG: \
                  speed_accuracy_SCENE, error_by_nodes_SCENE, sampling, poisson, prediction, footprint and crowding. At the end \
                  a table shows the planner's choice on every scene, its bound, the error found, and the time \
                  predicted and measured.\n\n\
                  Times are medians on this machine: leave it alone meanwhile. A whole run takes a few minutes on two \
                  cores."
)]
pub struct ChartArgs {
    /// Under a minute: fewer parameters and repetitions, a smaller S3
    #[arg(long)]
    quick: bool,
    /// Folder for the tables and charts; made where it is missing
    #[arg(long, value_name = "DIR", default_value = "out/chart")]
    out: PathBuf,
    /// Backends to measure: all is the CPU, and the GPU where there is one
    #[arg(long, value_parser = one_of(BACKENDS), default_value = "all")]
    backend: Backends,
    /// Random paths and star fields follow from it
    #[arg(long, default_value_t = 1)]
    seed: u32,
    /// Print the names of the files as one line of JSON instead of the table
    #[arg(long)]
    json: bool,
}

/// Backends by name.
const BACKENDS: &[(&str, &str, Backends)] =
    &[("cpu", "", Backends::Cpu), ("gpu", "", Backends::Gpu), ("all", "", Backends::All)];

/// Runs the command.
///
/// # Errors
/// When the GPU asked for is not there, a backend fails or a file cannot be written.
pub fn run(arguments: &ChartArgs) -> Result<()> {
    // A folder that cannot be made is reported before minutes of measuring.
    named::make_folder("--out", &arguments.out)?;
    let settings = Settings { quick: arguments.quick, backends: arguments.backend, seed: arguments.seed };
    let (watch, line, mut reported) = (Stopwatch::start(), ProgressLine::new(), 0);
    let charted = chart::run(&settings, &mut |step| {
        let text = step_line(step.done, step.total, watch.elapsed().s(), &step.next, LINE_WIDTH);
        let is_due = step.done == 0 || REPORTED * step.done >= (reported + 1) * step.total;
        reported = if is_due { REPORTED * step.done / step.total.max(1) } else { reported };
        line.show_or_print(&text, is_due);
    })?;
    line.clear();
    for file in &charted.files {
        write_file_atomically(&arguments.out.join(&file.name), |out| out.write_all(file.text.as_bytes()))?;
    }
    if arguments.json {
        let files: Vec<&str> = charted.files.iter().map(|file| file.name.as_str()).collect();
        return print_json(
            "chart",
            serde_json::json!({ "seed": settings.seed, "folder": arguments.out, "files": files }),
        );
    }
    print!("{}", charted.summary);
    println!("{} files in {}", charted.files.len(), arguments.out.display());
    Ok(())
}
