//! `starloop dataset`: a data set of drawn images with labels, from a description.

use crate::cli::{EXIT_DONE, EXIT_LOST, report_json::print_json, signals, terminal::ProgressLine, version};
use anyhow::{Context, Result, bail};
use base::clock::Stopwatch;
use clap::Args;
use core::{ops::Range, sync::atomic::Ordering};
use data_sets::{Order, Progress, Spec, Studio, Summary, make, spec::ImageForm};
use run::wiring::memory::RunMemory;
use serde::Serialize;
use std::path::{Path, PathBuf};

/// Time between two lines of progress where standard error is not a terminal, s.
const LINE_EVERY_S: f64 = 10.0;

/// Command line of `dataset`.
#[derive(Debug, Args)]
pub struct DataSetArgs {
    /// Description of the data set (TOML); src/guide/data_sets.md lists its keys
    #[arg(value_name = "SPEC.toml", required_unless_present = "verify")]
    spec: Option<PathBuf>,
    /// Number of items; a folder may get more of them later
    #[arg(long, value_name = "N", required_unless_present = "verify")]
    count: Option<u32>,
    /// Folder of the data set: a new one, or one to go on with
    #[arg(long, value_name = "FOLDER", required_unless_present = "verify")]
    out: Option<PathBuf>,
    /// Threads; each draws on one core [default: as many as the machine has]
    #[arg(long, value_name = "N")]
    workers: Option<usize>,
    /// Only these shards, the second excluded, such as 0..4: other programs may draw the others into the same folder
    #[arg(long, value_name = "A..B", value_parser = shards)]
    shards: Option<Range<u32>>,
    /// Form of the images in place of the description's: fits, png, webdataset or zarr
    #[arg(long, value_name = "FORM", value_parser = ImageForm::parse)]
    images: Option<ImageForm>,
    /// Check the bytes of every file of a finished data set
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["spec", "count", "out", "workers", "shards", "images"])]
    verify: Option<PathBuf>,
    /// Print no progress
    #[arg(long)]
    quiet: bool,
    /// Print what was made as one line of JSON
    #[arg(long)]
    json: bool,
}

/// Returns a range of shards.
fn shards(text: &str) -> Result<Range<u32>> {
    let wanted = || format!("got \"{text}\", wanted A..B, such as 0..4");
    let (first, end) = text.split_once("..").with_context(wanted)?;
    Ok(first.parse().with_context(wanted)?..end.parse().with_context(wanted)?)
}

/// Report of a command, for programs.
#[derive(Debug, Serialize)]
struct Made {
    folder: PathBuf,
    drawn: u32,
    found: u32,
    is_whole: bool,
    workers: usize,
    wall_s: f64,
    items_per_s: f64,
    /// Wall time of all workers together.
    prepare_s: f64,
    draw_s: f64,
    write_s: f64,
}

/// Runs the command; the exit status.
///
/// # Errors
/// With what could not be done.
pub fn run(arguments: &DataSetArgs) -> Result<u8> {
    if let Some(folder) = &arguments.verify {
        return verify(folder);
    }
    let (Some(path), Some(count), Some(folder)) = (&arguments.spec, arguments.count, &arguments.out) else {
        bail!("--count and --out are missing; wanted the number of items and a folder");
    };
    let mut spec = Spec::read(path)?;
    spec.output.images = arguments.images.unwrap_or(spec.output.images);
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let workers = arguments.workers.unwrap_or(cores);
    check_memory(&spec, workers)?;
    let program = version::SHORT;
    let order = Order { spec: &spec, count, folder, shards: arguments.shards.clone(), workers, program };
    let (stop, wall) = (signals::stop(), Stopwatch::start());
    let (line, mut printed_s) = (ProgressLine::new(), 0.0);
    let summary = make(&order, &stop, |progress| {
        let elapsed_s = wall.elapsed().s();
        if !arguments.quiet && progress.drawn > 0 {
            let is_due = elapsed_s - printed_s >= LINE_EVERY_S;
            line.show_or_print(&progress_text(progress, elapsed_s), is_due);
            printed_s = if is_due { elapsed_s } else { printed_s };
        }
    })?;
    line.clear();
    let wall_s = wall.elapsed().s();
    report(&made(folder, &summary, workers, wall_s), arguments.json)?;
    if stop.load(Ordering::SeqCst) && summary.is_stopped {
        eprintln!("starloop: stopped by {}; the same command goes on with it", signals::cause());
        return Ok(signals::exit_status());
    }
    Ok(EXIT_DONE)
}

/// Returns how far it is, and for how long it goes on.
fn progress_text(Progress { drawn, wanted }: Progress, elapsed_s: f64) -> String {
    let per_s = f64::from(drawn) / elapsed_s.max(1e-9);
    let left_s = f64::from(wanted - drawn) / per_s;
    let share = 100.0 * f64::from(drawn) / f64::from(wanted.max(1));
    format!("{drawn} of {wanted} items ({share:.0} %), {per_s:.1} items/s, {left_s:.0} s left")
}

/// Refuses workers whose cameras do not fit into memory together.
fn check_memory(spec: &Spec, workers: usize) -> Result<()> {
    Ok(RunMemory::of_images(&Studio::camera_of(spec, 0)?, workers).check()?)
}

fn made(folder: &Path, summary: &Summary, workers: usize, wall_s: f64) -> Made {
    let times = summary.times;
    Made {
        folder: folder.into(),
        drawn: summary.drawn,
        found: summary.found,
        is_whole: summary.is_whole,
        workers,
        wall_s,
        items_per_s: f64::from(summary.drawn) / wall_s.max(1e-9),
        prepare_s: times.prepare_s,
        draw_s: times.draw_s,
        write_s: times.write_s,
    }
}

fn report(made: &Made, as_json: bool) -> Result<()> {
    if as_json {
        return print_json("dataset", made);
    }
    let state = if made.is_whole { "whole" } else { "not whole yet: shards are missing" };
    println!("{}: {state}; {} items drawn, {} there before", made.folder.display(), made.drawn, made.found);
    if made.drawn > 0 {
        println!(
            "{:.1} items/s by {} workers in {:.1} s; of their time: cameras {:.1} s, drawing {:.1} s, files {:.1} s",
            made.items_per_s, made.workers, made.wall_s, made.prepare_s, made.draw_s, made.write_s
        );
    }
    Ok(())
}

fn verify(folder: &Path) -> Result<u8> {
    let damaged = data_sets::folder::damaged(folder)?;
    if damaged.is_empty() {
        println!("{}: every file has the bytes that were written", folder.display());
        return Ok(EXIT_DONE);
    }
    damaged.iter().for_each(|line| println!("{line}"));
    eprintln!(
        "starloop: {}: {} files are damaged; draw them again by the command that made them",
        folder.display(),
        damaged.len()
    );
    Ok(EXIT_LOST)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shards_are_a_range() {
        assert_eq!(shards("2..5").unwrap(), 2..5);
        for wrong in ["2", "a..3", "2..", "..4", "-1..2"] {
            assert!(shards(wrong).unwrap_err().to_string().contains("wanted A..B"), "{wrong}");
        }
    }
}
