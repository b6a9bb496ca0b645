//! The report: verdict, conditions, requirements, metrics, plots, provenance; as HTML, JSON and JUnit.
//!
//! Tour: `forms` (HTML with its plots, JUnit); numbers and verdicts in words below.

mod forms;

pub use forms::{to_html, to_junit};

use crate::assess::Assessment;
use crate::metric::{Interval, Metric, Settings};
use crate::provenance::{Paperwork, Provenance};
use crate::record::{Fate, JudgedCase, Use};
use crate::requirements::{By, Judgement, Outcome, Verdict};
use anyhow::Result;
use serde::Serialize;
use std::collections::BTreeMap;

/// Version of the form of the report as JSON.
pub const SCHEMA: &str = "starloop.report/1";
/// Largest report as HTML, bytes.
pub const MOST_HTML_BYTES: usize = 2_000_000;

/// Everything that a report says.
#[derive(Debug, Clone, Serialize)]
pub struct Report {
    /// Form of the file.
    pub schema: &'static str,
    /// Its title.
    pub title: String,
    /// The verdict in one line.
    pub verdict: String,
    /// Passed, not shown or failed.
    pub outcome: Outcome,
    /// All requirements are met.
    pub is_met: bool,
    /// Unit, author, date.
    pub document: Paperwork,
    /// With what numbers are said.
    pub settings: Settings,
    /// Conditions of the flight, by name.
    pub conditions: Vec<(String, String)>,
    /// Requirements with verdicts.
    pub requirements: Vec<Judgement>,
    /// All numbers.
    pub metrics: Vec<Metric>,
    /// The cases in short.
    pub cases: Vec<CaseRow>,
    /// Where all of it comes from.
    pub provenance: Provenance,
}

/// A case in short.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CaseRow {
    /// Its name.
    pub name: String,
    /// Purpose, which decides its metrics.
    pub purpose: Use,
    /// Numbers that describe it.
    pub conditions: BTreeMap<String, f64>,
    /// Frames.
    pub frames: usize,
    /// Right attitudes.
    pub right: usize,
    /// False ones.
    pub wrong: usize,
    /// Rows of the log that belong to no frame.
    pub stray_rows: usize,
    /// Numbers between the first and the last frame that no frame has: dropped, or not recorded.
    pub missing_frames: usize,
    /// From the start of the first exposure to the end of the last one.
    pub duration_s: f64,
}

impl CaseRow {
    fn of(case: &JudgedCase) -> Self {
        let count = |is_it: fn(&Fate) -> bool| case.frames.iter().filter(|frame| is_it(&frame.fate)).count();
        Self {
            name: case.name.clone(),
            purpose: case.purpose,
            conditions: case.conditions.clone(),
            frames: case.frames.len(),
            right: count(|fate| matches!(fate, Fate::Right(_))),
            wrong: count(|fate| matches!(fate, Fate::False(_))),
            stray_rows: case.stray_rows,
            missing_frames: missing_frames(case),
            duration_s: duration_s(case),
        }
    }
}

impl Report {
    /// Returns the report of an assessment.
    pub fn new(
        title: String,
        assessment: &Assessment,
        requirements: Vec<Judgement>,
        conditions: Vec<(String, String)>,
        (document, provenance): (Paperwork, Provenance),
    ) -> Self {
        let outcome = Outcome::of(&requirements);
        Self {
            schema: SCHEMA,
            verdict: verdict(&title, &requirements, assessment),
            title,
            outcome,
            is_met: outcome == Outcome::Passed,
            document,
            settings: assessment.settings,
            conditions,
            requirements,
            metrics: assessment.metrics.clone(),
            cases: assessment.cases.iter().map(CaseRow::of).collect(),
            provenance,
        }
    }

    /// Returns the report as JSON.
    ///
    /// # Errors
    /// When a number does not go into JSON.
    pub fn to_json(&self) -> Result<String> {
        Ok(serde_json::to_string_pretty(self)?)
    }
}

fn missing_frames(case: &JudgedCase) -> usize {
    let ends = case.frames.first().zip(case.frames.last());
    ends.map_or(0, |(first, last)| {
        let numbers = last.truth.frame.saturating_sub(first.truth.frame) as usize + 1;
        numbers.saturating_sub(case.frames.len())
    })
}

fn duration_s(case: &JudgedCase) -> f64 {
    case.frames.first().zip(case.frames.last()).map_or(0.0, |(first, last)| {
        (last.truth.mid_ns - first.truth.mid_ns) as f64 * 1e-9 + 0.5 * (first.truth.exposure_s + last.truth.exposure_s)
    })
}

fn verdict(title: &str, requirements: &[Judgement], assessment: &Assessment) -> String {
    let count = |verdict: Verdict| requirements.iter().filter(|judgement| judgement.verdict == verdict).count();
    let word = Outcome::of(requirements).name();
    let noun = if requirements.len() == 1 { "requirement" } else { "requirements" };
    let mut parts = vec![format!("{} of {} {noun} met", count(Verdict::Met), requirements.len())];
    for verdict in [Verdict::NotMet, Verdict::NotShown, Verdict::NotMeasured] {
        if count(verdict) > 0 {
            parts.push(format!("{} {}", count(verdict), verdict.name()));
        }
    }
    let by_value = requirements.iter().filter(|judgement| judgement.requirement.by == By::Value).count();
    if by_value > 0 {
        parts.push(format!("{by_value} compared by value, not by interval"));
    }
    let frames: usize = assessment.cases.iter().map(|case| case.frames.len()).sum();
    parts.push(format!("{}, {}", counted(assessment.cases.len(), "case"), counted(frames, "frame")));
    format!("{word}: {title}: {}", parts.join(", "))
}

// Numbers and verdicts in words, the same in every form of a report.

/// Digits that count.
const DIGITS: i32 = 3;
/// Most digits after the point.
const MOST_DECIMALS: i32 = 12;

/// Returns a number with three digits that count.
pub(super) fn number(value: f64) -> String {
    rounded(value, DIGITS)
}

/// Returns a number with as many digits, three at least, as show on which side of the limit it is.
fn number_beside(value: f64, limit: f64) -> String {
    let is_clear = |text: &String| {
        text.parse::<f64>()
            .is_ok_and(|shown| shown.abs().partial_cmp(&limit.abs()) == value.abs().partial_cmp(&limit.abs()))
    };
    (DIGITS..=MOST_DECIMALS).map(|digits| rounded(value, digits)).find(is_clear).unwrap_or_else(|| number(value))
}

fn rounded(value: f64, digits: i32) -> String {
    if value == 0.0 || !value.is_finite() {
        return if value == 0.0 { "0".into() } else { "-".into() };
    }
    let magnitude = value.abs();
    if !(1e-3..1e5).contains(&magnitude) {
        let decimals = usize::try_from(digits - 1).unwrap_or(0);
        return format!("{value:.decimals$e}");
    }
    #[allow(clippy::cast_possible_truncation, reason = "between -3 and 5")]
    let decade = magnitude.log10().floor() as i32;
    let decimals = usize::try_from((digits - 1 - decade).clamp(0, MOST_DECIMALS)).unwrap_or(0);
    let text = format!("{value:.decimals$}");
    if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
}

/// Returns a share as a percentage, without zeros at its end.
pub(super) fn percent(share: f64) -> String {
    let text = format!("{:.4}", 100.0 * share);
    format!("{} %", text.trim_end_matches('0').trim_end_matches('.'))
}

/// Returns a count with its noun: one case, two cases.
pub(super) fn counted(count: usize, noun: &str) -> String {
    if count == 1 { format!("1 {noun}") } else { format!("{count} {noun}s") }
}

/// Returns the data that a metric is made from; nothing for a count.
pub(super) fn data_of(metric: &Metric) -> String {
    if metric.interval == Interval::Counted {
        return String::new();
    }
    let count = format!("{:.0}", metric.count);
    if count == "1" {
        return format!("1 {}", metric.counted.replacen("s ", " ", 1).trim_end_matches('s'));
    }
    format!("{count} {}", metric.counted)
}

/// Returns the rule by which a requirement was compared.
pub(super) fn rule(judgement: &Judgement) -> &'static str {
    let has_interval = judgement.measured.as_ref().is_none_or(|metric| metric.high != Some(metric.low));
    match (judgement.requirement.by, has_interval) {
        (By::Value, _) => "by value",
        (By::Interval, true) => "by interval",
        (By::Interval, false) => "by value: a count has no interval",
    }
}

/// Returns what a requirement wants and what was measured.
pub(super) fn measured(judgement: &Judgement) -> String {
    let requirement = &judgement.requirement;
    let (limit, words) = match (requirement.most, requirement.least) {
        (Some(most), _) => (most, format!("at most {most}")),
        (None, Some(least)) => (least, format!("at least {least}")),
        (None, None) => (0.0, String::new()),
    };
    let Some(metric) = &judgement.measured else {
        return format!("{}: wanted {words}, and nothing was measured", requirement.metric);
    };
    let [value, low] = [metric.value, metric.low].map(|number| number_beside(number, limit));
    let high = metric.high.map_or_else(|| "no upper end".to_owned(), |high| number_beside(high, limit));
    let interval = if metric.high == Some(metric.low) { String::new() } else { format!(" (interval {low} to {high})") };
    format!("{}: wanted {words}, got {value}{interval} {}; compared {}", metric.id, metric.unit, rule(judgement))
}

/// Returns what is missing to show a requirement; empty for one that is decided.
pub(super) fn missing(judgement: &Judgement) -> String {
    match (judgement.verdict, &judgement.needs) {
        (Verdict::Met | Verdict::NotMet, _) => String::new(),
        (_, Some(needs)) => {
            format!("more data needed: needs {} {}, has {}", needs.needed, needs.of, needs.measured)
        }
        (Verdict::NotMeasured, None) => "no data".into(),
        (Verdict::NotShown, None) => "more data needed; as many as were measured do not decide it".into(),
    }
}

#[cfg(test)]
mod tests;

#[cfg(test)]
mod words_tests {
    use super::*;

    #[test]
    fn numbers_have_three_digits_or_as_many_as_the_limit_needs() {
        assert_eq!(number(0.537_494), "0.537");
        assert_eq!((number(1204.3), number(0.1), number(-2.5e-7)), ("1204".into(), "0.1".into(), "-2.50e-7".into()));
        assert_eq!(number_beside(0.997_000_1, 0.997), "0.9970001");
        assert_eq!(number_beside(0.996_96, 0.997), "0.99696");
        assert_eq!(number_beside(0.997, 0.997), "0.997");
        assert_eq!((percent(0.95), percent(0.9973)), ("95 %".into(), "99.73 %".into()));
        assert_eq!((counted(1, "case"), counted(2, "case")), ("1 case".into(), "2 cases".into()));
    }
}
