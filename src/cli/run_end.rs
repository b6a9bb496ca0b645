//! How a run of a bench ends: its table, its `summary.json`, what it lost, its exit status.

use crate::cli::run::{ClockKind, RunArgs};
use crate::cli::run_heads::BenchHead;
use crate::cli::{EXIT_DONE, EXIT_LOST, signals};
use anyhow::{Context, Result};
use base::time::Tai;
use config::Bench;
use frames::report::{GatewayRow, HygieneLine, Losses, RunSummary, summary_table};
use frames::sink::replace_own_file;
use run::runtime::{FrameEngine, RunOutcome, sink_rows};
use std::path::PathBuf;

/// A run that has ended, and everything it ran with.
pub(super) struct Finished {
    pub(super) bench: Bench,
    pub(super) start: Tai,
    /// At least one.
    pub(super) heads: Vec<BenchHead>,
    pub(super) outcome: RunOutcome,
    pub(super) gateways: Vec<GatewayRow>,
    /// What is lost although the run reached its end.
    pub(super) losses: Losses,
    pub(super) hygiene: Vec<HygieneLine>,
    pub(super) wall_s: f64,
    pub(super) was_interrupted: bool,
    pub(super) directory: Option<PathBuf>,
}

impl Finished {
    /// Returns the exit status, and prints what was lost, also when the run is quiet.
    ///
    /// # Errors
    /// With why the run ended early, if it did.
    pub(super) fn status(self) -> Result<u8> {
        let was_lost = say_losses(&self.losses);
        if let Some(error) = self.outcome.error {
            return Err(error).context("the run ended early; everything finished before is kept");
        }
        if self.was_interrupted {
            eprintln!("starloop: stopped by {}; everything finished before is kept", signals::cause());
        }
        Ok(match (was_lost, self.was_interrupted) {
            (true, _) => EXIT_LOST,
            (false, true) => signals::exit_status(),
            (false, false) => EXIT_DONE,
        })
    }

    /// Returns what drew the frames of the first head.
    pub(super) fn engine(&self) -> &FrameEngine {
        &self.heads[0].engine
    }

    /// Returns counts, times and events.
    pub(super) fn summary(&self, clock: &str) -> RunSummary {
        let RunOutcome { record, ports, summaries, .. } = &self.outcome;
        let sink = summaries.first().and_then(Option::as_ref);
        let mut summary = record.summary(self.engine(), &self.heads[0].receiver, ports, sink);
        summary.bench.clone_from(&self.bench.name);
        summary.sinks = sink_rows(&self.outcome.sinks);
        summary.losses = self.losses.clone();
        summary.gateways.clone_from(&self.gateways);
        summary.wall_s = self.wall_s;
        summary.clock = clock.into();
        summary
    }

    /// Writes `summary.json`; a file that cannot be written is a loss.
    ///
    /// # Errors
    /// When the summary does not go into JSON.
    pub(super) fn write_summary(&mut self, arguments: &RunArgs) -> Result<()> {
        let summary = self.summary(clock_name(arguments));
        if let Some(directory) = &self.directory {
            let path = directory.join("summary.json");
            let json = summary.to_json_pretty()?;
            if let Err(error) = replace_own_file(&path, |out| out.write_all(json.as_bytes())) {
                self.losses.note_file("summary.json", error);
            }
        }
        Ok(())
    }

    /// Prints the table, unless the run is quiet.
    pub(super) fn print_table(&self, arguments: &RunArgs) {
        if !arguments.quiet {
            println!("{}", summary_table(&self.summary(clock_name(arguments))));
        }
    }
}

fn clock_name(arguments: &RunArgs) -> &'static str {
    match arguments.clock {
        ClockKind::Real => "monotonic",
        ClockKind::Virtual => "virtual",
    }
}

/// Prints what was lost on one line; false when nothing was.
pub(super) fn say_losses(losses: &Losses) -> bool {
    if !losses.is_empty() {
        eprintln!("starloop: {losses}");
    }
    !losses.is_empty()
}
