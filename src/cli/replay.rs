//! `starloop replay`: a captured run drawn again and compared bit by bit, or a capture of a bus drawn as a bench would.
//!
//! Input: the directory of `starloop run --capture`, or a candump log or pcapng file with `--bench`. Output: a verdict,
//! recorded frames with `--out`, and an exit status for scripts: 4 when an image differs, 1 for a capture that does not
//! hold what its end record states.

use crate::cli::plain_text::plain_text;
use crate::cli::{EXIT_DONE, EXIT_NOT_MET};
use anyhow::{Result, bail};
use clap::Args;
use config::Bench;
use core::ops::Range;
use frames::sink::{Recorder, RecorderOptions, Sink};
use run::wiring::replay::{ReplayOutcome, replay_bus, replay_session};
use std::path::PathBuf;

/// Command line of `replay`.
#[derive(Debug, Args)]
#[command(after_help = "Exit status: 0 every image that could be compared is bit-identical; 4 one is not; 1 it could \
                        not be done.\n\n\
                        Bits repeat on the backend and vector level of the captured run. A capture without its session \
                        (a candump log, a pcapng file) is drawn with --bench, and there is nothing to compare.")]
pub struct ReplayArgs {
    /// Directory of `starloop run --capture`, or a capture of a bus (candump log or pcapng)
    capture: PathBuf,
    /// Bench file that a capture without a session is drawn with
    #[arg(long, value_name = "FILE")]
    bench: Option<PathBuf>,
    /// Draw for this many seconds instead of the bench's duration (with --bench)
    #[arg(long, value_name = "S", requires = "bench")]
    duration: Option<f64>,
    /// Record the frames into this directory (one without a recording)
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Draw and compare these frames only, from A to before B
    #[arg(long, value_name = "A..B", value_parser = range)]
    frames: Option<Range<u32>>,
}

fn range(text: &str) -> Result<Range<u32>, String> {
    let ends = text.split_once("..").and_then(|(from, to)| Some(from.parse().ok()?..to.parse().ok()?));
    ends.filter(|range| !range.is_empty()).ok_or_else(|| "wanted two frame numbers such as 10..20".into())
}

/// Runs the command; the exit status.
///
/// # Errors
/// With what could not be done, and why.
pub fn run(arguments: &ReplayArgs) -> Result<u8> {
    let is_session = arguments.capture.is_dir();
    let bench = match (&arguments.bench, is_session) {
        (Some(_), true) => bail!("--bench: got the directory of a captured run, which holds its own bench"),
        (None, false) if !arguments.capture.exists() => {
            bail!("{}: does not exist; wanted the directory of a captured run", arguments.capture.display())
        }
        (None, false) => bail!(
            "{}: no directory of a captured run; wanted --bench FILE with a capture of a bus",
            arguments.capture.display()
        ),
        (path, _) => path.as_ref().map(|path| Bench::load(path)).transpose()?,
    };
    let mut recorder = match &arguments.out {
        Some(directory) => {
            Some(Recorder::create(directory, RecorderOptions { png_every: 10, ..RecorderOptions::default() })?)
        }
        None => None,
    };
    let sink = recorder.as_mut().map(|recorder| recorder as &mut dyn Sink);
    let outcome = match bench {
        None => replay_session(&arguments.capture, arguments.frames.clone(), sink)?,
        Some(mut bench) => {
            match arguments.duration {
                Some(s) if !(s.is_finite() && s > 0.0) => bail!("--duration: got {s}, wanted seconds above 0"),
                given => bench.timing.duration_s = given.unwrap_or(bench.timing.duration_s),
            }
            replay_bus(&arguments.capture, &bench, arguments.frames.clone(), sink)?
        }
    };
    Ok(tell(&outcome, is_session))
}

/// Prints the verdict; the exit status.
fn tell(outcome: &ReplayOutcome, is_session: bool) -> u8 {
    // Some are words of the capture's own files.
    outcome.doubts.iter().for_each(|doubt| eprintln!("starloop: {}", plain_text(doubt)));
    if outcome.skipped_packets > 0 {
        eprintln!("starloop: {} packets have no form here and were skipped", outcome.skipped_packets);
    }
    if !is_session {
        println!("{} frames drawn; nothing to compare them with", outcome.drawn);
        return EXIT_DONE;
    }
    let ReplayOutcome { compared, differing, .. } = outcome;
    if *compared == 0 {
        println!("no frame could be compared");
        return EXIT_NOT_MET;
    }
    println!("{} of {compared} frames bit-identical", compared - differing);
    match outcome.first {
        None => EXIT_DONE,
        Some(first) => {
            println!(
                "the first that is not: frame {}, CRC-32 {:08x} captured, {:08x} replayed",
                first.frame, first.wanted, first.got
            );
            EXIT_NOT_MET
        }
    }
}
