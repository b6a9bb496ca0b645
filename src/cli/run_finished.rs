//! A run that has ended, and everything it ran with.

use crate::cli::{run_args::ClockKind, run_control::Client};
use config::{Bench, Scenario};
use frames::report::RunSummary;
use run::{runtime::FrameEngine, wiring::run_end::RunEnd};
use std::path::PathBuf;

/// A run that has ended, and everything it ran with.
pub(super) struct Finished {
    pub(super) scenario: Scenario,
    pub(super) end: RunEnd,
    /// The client that steered it.
    pub(super) client: Option<Client>,
    pub(super) wall_s: f64,
    pub(super) was_interrupted: bool,
    pub(super) directory: Option<PathBuf>,
}

impl Finished {
    /// Returns the bench.
    pub(super) fn bench(&self) -> &Bench {
        &self.scenario.bench
    }

    /// Returns what drew the frames of the first head.
    pub(super) fn engine(&self) -> &FrameEngine {
        &self.end.heads[0].engine
    }

    /// Returns counts, times and events.
    pub(super) fn summary(&self, clock: ClockKind) -> RunSummary {
        let mut summary = self.end.summary();
        summary.bench.clone_from(&self.scenario.name);
        summary.wall_s = self.wall_s;
        summary.clock = clock.summary_name().into();
        summary
    }
}
