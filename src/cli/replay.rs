//! `starloop replay`: a captured run drawn again and compared bit by bit, or a capture of a bus drawn as a run would.
//!
//! Input: the directory of `starloop run --capture`, or a candump log or pcapng file with `--bench`. Output: a verdict,
//! recorded frames with `--out`, and an exit status for scripts: 4 when an image differs, 1 for a capture that does not
//! hold what its end record states.

use crate::cli::junit::{self, Case, Outcome};
use crate::cli::{EXIT_DONE, EXIT_NOT_MET, report_json::print_json, terminal::plain_text};
use anyhow::{Result, bail};
use clap::Args;
use config::Scenario;
use core::ops::Range;
use frames::sink::{Recorder, RecorderOptions, Sink, SinkError};
use run::wiring::replay::{HeadOutcome, ReplayOptions, ReplayOutcome, replay_bus, replay_session};
use run::wiring::sinks::directory_of_head;
use std::path::PathBuf;

/// Command line of `replay`.
#[derive(Debug, Args)]
#[command(
    after_help = "Exit status: 0 every image that went out is bit-identical; 4 one is not, or could not be compared; 1 it could \
                        not be done.\n\n\
                        Bits repeat on the backend and vector level of the captured run. A capture without its session \
                        (a candump log, a pcapng file) is drawn with --bench, and there is nothing to compare."
)]
pub struct ReplayArgs {
    /// Directory of `starloop run --capture`, or a capture of a bus (candump log or pcapng)
    capture: PathBuf,
    /// Run file (bench or scenario) that a capture without a session is drawn with
    #[arg(long, value_name = "FILE")]
    bench: Option<PathBuf>,
    /// Draw for this many seconds instead of the run file's duration (with --bench)
    #[arg(long, value_name = "S", requires = "bench")]
    duration: Option<f64>,
    /// Record the frames into this directory (one without a recording); of several heads into head0, head1, ... below
    /// it
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Draw and compare these frames only, from A to before B
    #[arg(long, value_name = "A..B", value_parser = range)]
    frames: Option<Range<u32>>,
    /// Draw and compare this head only, counted from 0
    #[arg(long, value_name = "N")]
    head: Option<usize>,
    /// Write the comparison of each head as JUnit XML
    #[arg(long, value_name = "FILE.xml")]
    junit: Option<PathBuf>,
    /// Print the report as one line of JSON
    #[arg(long)]
    json: bool,
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
    let scenario = match (&arguments.bench, is_session) {
        (Some(_), true) => bail!("--bench: got the directory of a captured run, which holds its own bench"),
        (None, false) if !arguments.capture.exists() => {
            bail!(
                "{}: No such file or directory; wanted a folder that `starloop run --capture` wrote",
                arguments.capture.display()
            )
        }
        (None, false) => bail!(
            "{}: is not the folder of a captured run; wanted --bench FILE beside a capture of a bus",
            arguments.capture.display()
        ),
        (path, _) => path.as_ref().map(|path| Scenario::load(path)).transpose()?,
    };
    let options = ReplayOptions { frames: arguments.frames.clone(), head: arguments.head };
    let mut sink = |head: Option<usize>| recorder(arguments, head);
    let outcome = match scenario {
        None if !arguments.capture.join("session.json").exists() => bail!(
            "{}: has no session.json; wanted a folder that `starloop run --capture` wrote",
            arguments.capture.display()
        ),
        None => replay_session(&arguments.capture, &options, &mut sink)?,
        Some(mut scenario) => {
            let timing = &mut scenario.bench.timing;
            match arguments.duration {
                Some(s) if !(s.is_finite() && s > 0.0) => bail!("--duration: got {s}, wanted seconds above 0"),
                given => timing.duration_s = given.unwrap_or(timing.duration_s),
            }
            replay_bus(&arguments.capture, &scenario, &options, &mut sink)?
        }
    };
    announce_doubts(&outcome);
    if let Some(range) = arguments.frames.as_ref().filter(|_| is_session && outcome.compared() == 0) {
        eprintln!(
            "starloop: --frames {}..{}: no frame of the capture in this range; wanted numbers of its frames.csv",
            range.start, range.end
        );
    }
    if arguments.json {
        print_json("replay", facts(&outcome, is_session))?;
    } else {
        announce(&outcome, is_session);
    }
    arguments.junit.iter().try_for_each(|path| junit::save(path, &to_junit(&outcome, is_session)))?;
    let is_whole = outcome.compared() > 0 && outcome.uncompared() == 0 && outcome.differing() == 0;
    Ok(if is_session && !is_whole { EXIT_NOT_MET } else { EXIT_DONE })
}

/// Returns the JUnit document: for each head a test case for the bits, and one for frames that could not be compared.
fn to_junit(outcome: &ReplayOutcome, is_session: bool) -> String {
    let cases = |head: &HeadOutcome| {
        let HeadOutcome { compared, uncompared, differing, .. } = head;
        let class = format!("head {}", head.head);
        let mut bits = Case::new(
            &class,
            "frames are bit-identical",
            (*differing > 0).then(|| {
                let first =
                    head.first.map_or_else(String::new, |first| format!("; the first is frame {}", first.frame));
                format!("{differing} of {compared} differ{first}")
            }),
        );
        let left = (*uncompared > 0).then(|| format!("{uncompared} could not be compared"));
        let mut all = Case::new(&class, "every frame is compared", left);
        let skipped = || Outcome::Skipped("a capture of a bus has no frames to compare with".into());
        if !is_session {
            (bits.outcome, all.outcome) = (skipped(), skipped());
        } else if *compared == 0 {
            all.outcome = Outcome::Error("no frame could be compared".into());
        }
        [bits, all]
    };
    junit::document("replay", None, &outcome.heads.iter().flat_map(cases).collect::<Vec<_>>())
}

/// Returns the recorder of a head's frames, when they are to be recorded.
fn recorder(arguments: &ReplayArgs, head: Option<usize>) -> Result<Option<Box<dyn Sink>>, SinkError> {
    let Some(directory) = &arguments.out else { return Ok(None) };
    let options = RecorderOptions { png_every: 10, ..RecorderOptions::default() };
    Ok(Some(Box::new(Recorder::create(directory_of_head(directory, head), options)?)))
}

/// Prints what makes the result doubtful.
fn announce_doubts(outcome: &ReplayOutcome) {
    // Some are words of the capture's own files.
    outcome.doubts.iter().for_each(|doubt| eprintln!("starloop: {}", plain_text(doubt)));
    if outcome.skipped_packets > 0 {
        eprintln!("starloop: {} packets have no form here and were skipped", outcome.skipped_packets);
    }
}

/// Returns the outcome as JSON.
fn facts(outcome: &ReplayOutcome, is_session: bool) -> serde_json::Value {
    let head = |head: &HeadOutcome| {
        let crc = |value: u32| format!("{value:08x}");
        let first = head.first.map(|first| {
            serde_json::json!({ "frame": first.frame, "captured_crc32": crc(first.wanted), "replayed_crc32": crc(first.got) })
        });
        serde_json::json!({
            "head": head.head, "drawn": head.drawn, "compared": head.compared, "differing": head.differing,
            "first_differing": first,
        })
    };
    serde_json::json!({
        "is_session": is_session,
        "drawn": outcome.drawn(),
        "compared": outcome.compared(),
        "uncompared": outcome.uncompared(),
        "differing": outcome.differing(),
        "skipped_packets": outcome.skipped_packets,
        "doubts": outcome.doubts,
        "heads": outcome.heads.iter().map(head).collect::<Vec<_>>(),
    })
}

/// Prints the verdict.
fn announce(outcome: &ReplayOutcome, is_session: bool) {
    // One head is not worth a word.
    let several = Some(outcome.heads.len()).filter(|heads| *heads > 1);
    let heads = several.map_or_else(String::new, |heads| format!("{heads} heads, "));
    if !is_session {
        println!("{heads}{} frames drawn; nothing to compare them with", outcome.drawn());
        return;
    }
    let (compared, differing) = (outcome.compared(), outcome.differing());
    if compared == 0 {
        println!("no frame could be compared");
        return;
    }
    let left = Some(outcome.uncompared()).filter(|left| *left > 0);
    let left = left.map_or_else(String::new, |left| format!("; {left} could not be compared"));
    println!("{heads}{} of {compared} frames bit-identical{left}", compared - differing);
    if let Some(first) = outcome.first() {
        println!(
            "the first that is not: {}frame {}, CRC-32 {:08x} captured, {:08x} replayed",
            several.map_or_else(String::new, |_| format!("head {}, ", first.head)),
            first.frame,
            first.wanted,
            first.got
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn junit_has_the_bits_of_each_head_and_what_was_not_compared() {
        let head = |head, compared, differing, uncompared| HeadOutcome {
            head,
            compared,
            differing,
            uncompared,
            ..HeadOutcome::default()
        };
        let text = |heads: Vec<HeadOutcome>, is_session| {
            to_junit(&ReplayOutcome { heads, ..ReplayOutcome::default() }, is_session)
        };
        let good = text(vec![head(0, 9, 0, 0), head(1, 9, 0, 0)], true);
        assert!(good.contains("tests=\"4\" failures=\"0\" errors=\"0\" skipped=\"0\""), "control: {good}");
        let bad = text(vec![head(0, 9, 2, 0), head(1, 9, 0, 3)], true);
        assert!(bad.contains("failures=\"2\"") && bad.contains("2 of 9 differ"), "{bad}");
        assert!(bad.contains("3 could not be compared"), "{bad}");
        assert!(text(vec![head(0, 0, 0, 0)], true).contains("errors=\"1\""), "nothing compared is an error");
        assert!(text(vec![head(0, 0, 0, 0)], false).contains("skipped=\"2\""), "a capture of a bus");
    }
}
