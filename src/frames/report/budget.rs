//! The timing budget: limit, measurement and verdict, line by line.
//!
//! In: limits, stage histograms and the frame ring. Out: [`BudgetLine`]s and the whole [`BudgetReport`] as JSON. A line
//! compares the 99 % quantile (below 100 frames: the longest). A stage that did not run breaks no limit; that nothing
//! was delivered breaks those of delivery.

use crate::report::frame_ring::{FrameRing, Latency};
use crate::report::stages::{Stage, StageHistograms};
use crate::report::summary::AnswerRow;
use crate::report::{
    histogram::Quantiles, json_pretty, machine::Machine, summary::FrameCounts, table::joined, verdict::RunVerdict,
};
use base::refused::Refused;
use serde::Serialize;
use std::collections::BTreeMap;

/// Limits that a run must keep.
#[derive(Debug, Clone, PartialEq)]
pub struct BudgetLimits {
    /// 99 % quantile of each stage, ms; `None`: any.
    pub stage_p99_ms: [Option<f64>; Stage::COUNT],
    /// 99 % quantile from the epoch of the newest attitude in an image to its delivery, ms; `None`: any.
    pub latency_p99_ms: Option<f64>,
    /// Slots that may be missed.
    pub missed_frames: u64,
}

impl Default for BudgetLimits {
    /// Returns limits that allow no missed frame and any time.
    fn default() -> Self {
        Self { stage_p99_ms: [None; Stage::COUNT], latency_p99_ms: None, missed_frames: 0 }
    }
}

base::words! {
    /// Verdict of one line.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
    #[serde(rename_all = "snake_case")]
    pub enum LineVerdict {
        /// Inside the limit.
        Met = "met",
        /// Over the limit.
        Broken = "BROKEN",
        /// The line has no limit.
        NoLimit = "-",
        /// The line has a limit, but no measurement: the stage did not run on this backend.
        NotRun = "did not run",
    }
}

/// One line of the budget: times of a stage, or a count of slots.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BudgetLine {
    /// Stage or total that the line is about.
    pub name: &'static str,
    /// Limit of the 99 % quantile, ms, or of the count; `None`: any.
    pub limit: Option<f64>,
    /// Times measured; `None` for a count.
    pub times: Option<Quantiles>,
    /// Slots counted; `None` for times.
    pub slots: Option<u64>,
    /// Verdict.
    pub verdict: LineVerdict,
}

/// Name of the line of missed slots.
pub const MISSED: &str = "missed_frames";
/// Name of the line of a tracker's answers.
pub const ANSWER: &str = "answer";
/// Name of the line of latency.
pub const LATENCY: &str = "latency";

impl BudgetLine {
    fn of_times(name: &'static str, limit: Option<f64>, times: Quantiles, must_run: bool) -> Self {
        let verdict = match limit {
            None => LineVerdict::NoLimit,
            Some(_) if times.count == 0 && must_run => LineVerdict::Broken,
            Some(_) if times.count == 0 => LineVerdict::NotRun,
            Some(limit) if times.p99_ms <= limit => LineVerdict::Met,
            Some(_) => LineVerdict::Broken,
        };
        Self { name, limit, times: Some(times), slots: None, verdict }
    }

    /// Returns the fault of the line in one sentence; `None` unless its limit is broken.
    pub fn complaint(&self) -> Option<String> {
        if self.verdict != LineVerdict::Broken {
            return None;
        }
        let limit = self.limit.unwrap_or(0.0);
        Some(match (&self.times, self.slots) {
            (Some(times), _) if times.count == 0 => format!("{}: nothing was delivered", self.name),
            (Some(times), _) => {
                format!("{}: p99 {:.3} ms, allowed {limit:.3} ms (max {:.3} ms)", self.name, times.p99_ms, times.max_ms)
            }
            (None, slots) => format!("{}: {} slots, allowed {limit:.0}", self.name, slots.unwrap_or(0)),
        })
    }
}

/// Returns a line for each star tracker outside: from the middle of an exposure to its answer.
pub fn answer_lines(answers: &[AnswerRow]) -> impl Iterator<Item = BudgetLine> + '_ {
    answers.iter().map(|row| BudgetLine::of_times(ANSWER, Some(row.late_after_ms), row.latency, true))
}

/// Returns every line: the stages in order (except the wait), the latency, the missed slots.
pub fn budget_lines(limits: &BudgetLimits, stages: &StageHistograms, ring: &FrameRing) -> Vec<BudgetLine> {
    let of_stage = |stage: &Stage| {
        let limit = limits.stage_p99_ms[*stage as usize];
        BudgetLine::of_times(stage.name(), limit, stages.of(*stage), *stage == Stage::ReleaseToDelivered)
    };
    let mut lines: Vec<_> = Stage::ALL.iter().filter(|stage| **stage != Stage::Wait).map(of_stage).collect();
    let latency = ring.latency().epoch_to_delivered;
    lines.push(BudgetLine::of_times(LATENCY, limits.latency_p99_ms, latency, true));
    let missed = ring.missed();
    lines.push(BudgetLine {
        name: MISSED,
        limit: Some(limits.missed_frames as f64),
        times: None,
        slots: Some(missed),
        verdict: if missed <= limits.missed_frames { LineVerdict::Met } else { LineVerdict::Broken },
    });
    lines
}

/// A setting that makes a thread or its memory real-time, and whether the system granted it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct HygieneLine {
    /// Setting that was requested.
    pub what: String,
    /// Whether it was obtained.
    pub got: bool,
    /// How, or why not.
    pub detail: String,
}

/// Everything a run on the real clock says about its time.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct BudgetReport {
    /// The verdict on the run, whatever its times.
    #[serde(flatten)]
    pub verdict: RunVerdict,
    /// Version of starloop.
    pub starloop_version: String,
    /// Name of the bench.
    pub bench: String,
    /// Name of the camera.
    pub camera: String,
    /// Render backend.
    pub backend: String,
    /// Adapter and driver, or the processor, of the backend.
    pub adapter: String,
    /// The machine.
    pub machine: Machine,
    /// Length of the run, s.
    pub duration_s: f64,
    /// Busy threads beside the run.
    pub load_threads: usize,
    /// Frames by outcome.
    pub frames: FrameCounts,
    /// The lines.
    pub lines: Vec<BudgetLine>,
    /// Latency of delivered frames.
    pub latency: Latency,
    /// Slots missed, by cause.
    pub misses: BTreeMap<String, u64>,
    /// Frames degraded to keep their time, by degradation level.
    pub degraded: BTreeMap<String, u64>,
    /// Real-time scheduling and memory that were requested and obtained.
    pub hygiene: Vec<HygieneLine>,
    /// Changes by which the planner would bring a broken stage within its limit.
    pub advice: Vec<String>,
}

impl BudgetReport {
    /// Returns the lines that are broken.
    pub fn broken(&self) -> impl Iterator<Item = &BudgetLine> {
        self.lines.iter().filter(|line| line.verdict == LineVerdict::Broken)
    }

    /// Returns the cause of the broken budget: of the broken stages of work the one that is furthest over its limit;
    /// else the cause of most misses; else the longest stage, or the first broken line. `None` when the budget is met.
    pub fn culprit(&self) -> Option<String> {
        let first = self.broken().next()?;
        let is_work = |line: &&BudgetLine| Stage::OF_A_FRAME.iter().any(|stage| stage.name() == line.name);
        let over_ms = |line: &BudgetLine| line.times.map_or(0.0, |times| times.p99_ms) - line.limit.unwrap_or(0.0);
        let furthest = self.broken().filter(is_work).max_by(|a, b| over_ms(a).total_cmp(&over_ms(b)));
        let stage = furthest.map(|line| line.name.to_owned());
        let most_missed = self.misses.iter().max_by_key(|(_, count)| **count).map(|(cause, _)| cause.clone());
        Some(stage.or(most_missed).unwrap_or_else(|| self.longest_stage().unwrap_or(first.name).to_owned()))
    }

    /// Returns the stage of work with the largest 99 % quantile.
    fn longest_stage(&self) -> Option<&'static str> {
        let is_work = |line: &&BudgetLine| Stage::OF_A_FRAME.iter().any(|stage| stage.name() == line.name);
        let p99_ms = |line: &BudgetLine| line.times.map_or(0.0, |times| times.p99_ms);
        let is_delivery = self.broken().any(|line| line.name == Stage::ReleaseToDelivered.name());
        let longest = self.lines.iter().filter(is_work).max_by(|a, b| p99_ms(a).total_cmp(&p99_ms(b)));
        longest.filter(|line| is_delivery && p99_ms(line) > 0.0).map(|line| line.name)
    }

    /// Returns JSON that ends in a line break. Numbers that are not finite become `null`.
    ///
    /// # Errors
    /// When it cannot be expressed.
    pub fn to_json_pretty(&self) -> Result<String, Refused> {
        json_pretty(self)
    }
}

// The budget as text for a terminal: a table of lines, misses by cause, unavailable settings, proposed changes.

/// Below this count the 99 % quantile is the longest time.
const ENOUGH_FOR_P99: u64 = 100;

/// Lays out a report; ends in a line break.
pub fn budget_table(report: &BudgetReport) -> String {
    let mut lines = vec![
        format!(
            "budget of \"{}\": {:.1} s on the real clock, {} backend ({})",
            report.bench, report.duration_s, report.backend, report.adapter
        ),
        format!(
            "machine: {}, {} hardware threads, {}; busy threads beside the run: {}",
            report.machine.cpu, report.machine.cores, report.machine.system, report.load_threads
        ),
        String::new(),
        row(["stage", "budget ms", "p50 ms", "p99 ms", "p99.9 ms", "max ms"].map(String::from), "verdict"),
    ];
    lines.extend(report.lines.iter().map(line));
    lines.push(String::new());
    push_counts(&mut lines, report);
    let (obtained, asked) = (report.hygiene.iter().filter(|h| h.got).count(), report.hygiene.len());
    lines.push(format!("real-time scheduling and memory: {obtained} of {asked} requested settings obtained"));
    lines.extend(report.hygiene.iter().filter(|h| !h.got).map(|h| format!("unavailable: {}: {}", h.what, h.detail)));
    let few = report.frames.delivered < ENOUGH_FOR_P99;
    lines.extend(few.then(|| format!("note: with fewer than {ENOUGH_FOR_P99} frames p99 is the longest time")));
    lines.push(String::new());
    match report.culprit() {
        None => lines.push("the budget is met".into()),
        Some(culprit) => {
            lines.push(format!("the budget is BROKEN: {culprit}"));
            lines.extend(report.broken().filter_map(BudgetLine::complaint).map(|complaint| format!("  {complaint}")));
        }
    }
    lines.extend(report.advice.iter().map(|advice| format!("  {advice}")));
    let trimmed: Vec<&str> = lines.iter().map(|line| line.trim_end()).collect();
    trimmed.join("\n") + "\n"
}

fn line(line: &BudgetLine) -> String {
    let number = |value: f64| format!("{value:.3}");
    let limit = line.limit.map_or_else(|| "-".to_owned(), |limit| limit_text(line, limit));
    let cells = match (&line.times, line.slots) {
        (Some(q), _) if q.count > 0 => [q.p50_ms, q.p99_ms, q.p999_ms, q.max_ms].map(number),
        (_, Some(slots)) => [slots.to_string(), String::new(), String::new(), "slots".to_owned()],
        _ => core::array::from_fn(|_| "-".to_owned()),
    };
    let [p50, p99, p999, max] = cells;
    row([line.name.to_owned(), limit, p50, p99, p999, max], line.verdict.name())
}

fn limit_text(line: &BudgetLine, limit: f64) -> String {
    if line.slots.is_some() { format!("{limit:.0}") } else { format!("{limit:.3}") }
}

fn row([name, limit, p50, p99, p999, max]: [String; 6], verdict: &str) -> String {
    format!("{name:<22}{limit:>11}{p50:>11}{p99:>11}{p999:>11}{max:>11}  {verdict}")
}

fn push_counts(lines: &mut Vec<String>, report: &BudgetReport) {
    let f = &report.frames;
    lines.push(format!(
        "slots {}, drawn {}, delivered {}; late {}, held {}, dropped {}",
        f.scheduled, f.rendered, f.delivered, f.late, f.held, f.dropped
    ));
    lines.push(format!("missed by cause: {}", joined(&report.misses)));
    lines.push(format!("degraded, frames: {}", joined(&report.degraded)));
    for (name, q) in report.latency.named().into_iter().filter(|(_, q)| q.count > 0) {
        let [p50, p99, p999, max] = [q.p50_ms, q.p99_ms, q.p999_ms, q.max_ms];
        lines.push(format!("{name:<26} p50 {p50:.3}  p99 {p99:.3}  p99.9 {p999:.3}  max {max:.3} ms"));
    }
}

#[cfg(test)]
#[path = "budget_tests.rs"]
pub(crate) mod tests;
