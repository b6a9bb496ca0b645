//! The first line of a run's output: whether it went well, in one sentence.

use crate::cli::run_args::ClockKind;
use crate::cli::run_finished::Finished;
use crate::cli::scenario_report::ScenarioReport;
use frames::report::{FrameCounts, Stage};
use run::runtime::DeadlinePolicy;

/// Returns the verdict: `ok`, `LOST` or `FAILED`, frames on time, frames lost, latency against its limit, and where
/// files are.
pub(super) fn verdict_line(finished: &Finished, report: Option<&ScenarioReport>, clock: ClockKind) -> String {
    let (end, record) = (&finished.end, &finished.end.record);
    let word = match (end.error.is_some() || !end.holds(), end.losses.is_empty()) {
        (true, _) => "FAILED",
        (false, false) => "LOST",
        (false, true) => "ok",
    };
    let lost: u64 = end.sink_lines.iter().map(|line| line.dropped + line.refused).sum();
    let on_time = frames_on_time(&record.frames, finished.engine().params().deadline_policy);
    let mut line = match clock {
        ClockKind::Real => {
            let p99_ms = record.p99_ms();
            let limit = release_limit_ms(finished).map(|ms| format!(" of {ms}")).unwrap_or_default();
            let frames = record.frames.scheduled;
            format!("{word}: {on_time} of {frames} frames on time, {lost} lost; p99 latency {p99_ms:.1} ms{limit}")
        }
        ClockKind::Virtual => {
            let (frames, simulated_s, wall_s) = (record.frames, end.simulated_s, finished.wall_s);
            format!(
                "{word}: {} of {} frames, {lost} lost; {simulated_s:.1} s simulated in {wall_s:.1} s",
                frames.delivered, frames.scheduled
            )
        }
    };
    if let Some(failure) = report.and_then(first_failure) {
        line.push_str("; ");
        line.push_str(&failure);
    }
    if let Some(directory) = &finished.directory {
        line.push_str(&format!("; {}", directory.display()));
    }
    line
}

/// Returns frames that went out when they were due. A late frame is dropped, or goes out late or is replaced, by
/// policy.
fn frames_on_time(frames: &FrameCounts, policy: DeadlinePolicy) -> u64 {
    let missed = match policy {
        DeadlinePolicy::Drop => frames.dropped.max(frames.late),
        DeadlinePolicy::Hold | DeadlinePolicy::Late => frames.dropped + frames.late,
    };
    frames.scheduled.saturating_sub(missed)
}

/// Returns the bench's limit from release to delivery, ms.
fn release_limit_ms(finished: &Finished) -> Option<f64> {
    let limits = &finished.bench().budget.stage_p99_ms;
    limits.iter().find(|(name, _)| Stage::named(name) == Some(Stage::ReleaseToDelivered)).map(|(_, ms)| *ms)
}

/// Returns the first expectation or invariant that does not hold, in words.
pub(super) fn first_failure(report: &ScenarioReport) -> Option<String> {
    let failed = report.verdicts.iter().find(|verdict| !verdict.passed);
    let failed = failed.map(|verdict| format!("{}: wanted {}, got {}", verdict.name, verdict.wanted, verdict.got));
    failed.or_else(|| report.violation_lines.first().cloned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_on_time_are_neither_late_nor_dropped_and_none_is_counted_twice() {
        let frames = FrameCounts { scheduled: 100, late: 3, dropped: 5, ..FrameCounts::default() };
        assert_eq!(frames_on_time(&frames, DeadlinePolicy::Drop), 95, "late frames are among the dropped ones");
        assert_eq!(frames_on_time(&frames, DeadlinePolicy::Hold), 92);
        assert_eq!(frames_on_time(&FrameCounts { scheduled: 7, ..FrameCounts::default() }, DeadlinePolicy::Late), 7);
    }
}
