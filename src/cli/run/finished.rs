//! A finished run, and its verdict in one sentence.
//!
//! A run that has ended, and everything it ran with.

use crate::cli::run::{args::ClockKind, control::Client};
use config::{Bench, Scenario};
use frames::report::{FrameAccount, FrameEnd, RunSummary, RunVerdict, Stage};
use run::{runtime::FrameEngine, wiring::run_end::RunEnd};
use std::path::PathBuf;

/// A run that has ended, and everything it ran with.
pub(crate) struct Finished {
    pub(crate) scenario: Scenario,
    pub(crate) end: RunEnd,
    /// The client that steered it.
    pub(crate) client: Option<Client>,
    pub(crate) wall_s: f64,
    pub(crate) was_interrupted: bool,
    pub(crate) directory: Option<PathBuf>,
}

impl Finished {
    /// Returns the bench.
    pub(crate) fn bench(&self) -> &Bench {
        &self.scenario.bench
    }

    /// Returns what drew the frames of the first head.
    pub(crate) fn engine(&self) -> &FrameEngine {
        &self.end.heads[0].engine
    }

    /// Returns counts, times and events.
    pub(crate) fn summary(&self, clock: ClockKind) -> RunSummary {
        let mut summary = self.end.summary();
        summary.bench.clone_from(&self.scenario.name);
        summary.wall_s = self.wall_s;
        summary.clock = match clock {
            ClockKind::Real => "monotonic".into(),
            ClockKind::Virtual => "virtual".into(),
        };
        summary
    }
}

// The first line of a run's output: its verdict with every reason, in one sentence.

/// Returns the verdict: its word, frames on time, frames lost by sinks, the reasons, latency against its limit, and where
/// files are.
pub(crate) fn verdict_line(finished: &Finished, clock: ClockKind) -> String {
    let end = &finished.end;
    let (verdict, lost) = (end.verdict(), end.sink_lines.iter().map(|line| line.dropped + line.refused).sum());
    let mut line = counted(&verdict, &end.account(), lost, clock);
    match clock {
        ClockKind::Real => {
            let limit = release_limit_ms(finished).map(|ms| format!(" of {ms}")).unwrap_or_default();
            line += &format!("; p99 latency {:.1} ms{limit}", end.record.p99_ms());
        }
        ClockKind::Virtual => {
            line += &format!("; {:.1} s simulated in {:.1} s", end.simulated_s, finished.wall_s);
        }
    }
    if !verdict.limits_used.is_empty() {
        line += &format!("; allowed: {}", verdict.limits_used.join(", "));
    }
    if let Some(directory) = &finished.directory {
        line += &format!("; {}", directory.display());
    }
    line
}

/// Returns the word, the counts and the reasons.
fn counted(verdict: &RunVerdict, account: &FrameAccount, lost: u64, clock: ClockKind) -> String {
    let on_time = account.of(FrameEnd::OnTime).count;
    let word = verdict.word;
    let time = match clock {
        ClockKind::Real => " on time",
        ClockKind::Virtual => "",
    };
    let mut line = format!("{word}: {on_time} of {} frames{time}, {lost} lost", account.scheduled());
    let commanded = account.of(FrameEnd::Commanded).count;
    if commanded > 0 {
        line += &format!(", {commanded} {}", FrameEnd::Commanded.words());
    }
    if !verdict.reasons.is_empty() {
        line += &format!("; {}", verdict.reasons_line());
    }
    line
}

/// Returns the bench's limit from release to delivery, ms.
fn release_limit_ms(finished: &Finished) -> Option<f64> {
    let limits = &finished.bench().budget.stage_p99_ms;
    limits.iter().find(|(name, _)| Stage::named(name) == Some(Stage::ReleaseToDelivered)).map(|(_, ms)| *ms)
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::time::Tai;
    use frames::report::RunLimits;

    #[test]
    fn verdict_line_has_counts_that_add_up_and_the_reasons() {
        let mut account = FrameAccount::NONE;
        (0..7).for_each(|i| account.add(FrameEnd::OnTime, Tai::from_ns(i * 100_000_000)));
        account.add(FrameEnd::Commanded, Tai::from_ns(700_000_000));
        let judge = |account: &FrameAccount| {
            RunVerdict::of_frames(account, &RunLimits::default(), Tai::from_ns(0), &|_| "no attitude yet".into())
        };
        let line = |account: &FrameAccount| counted(&judge(account), account, 0, ClockKind::Real);
        assert_eq!(line(&account), "ok: 7 of 8 frames on time, 0 lost, 1 missing as commanded");
        account.add(FrameEnd::BlankAtStart, Tai::from_ns(0));
        let wanted = "INCOMPLETE: 7 of 9 frames on time, 0 lost, 1 missing as commanded; \
                      1 blank at the start: no attitude yet at 0.0 s";
        assert_eq!(line(&account), wanted);
    }
}
