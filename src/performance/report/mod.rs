//! The report: verdict, conditions, requirements, metrics, plots, provenance; as HTML, JSON and JUnit.
//!
//! Tour: `html` -> `plots`; `junit`; `words` (numbers and verdicts in words).

mod html;
mod junit;
mod plots;
#[cfg(test)]
mod tests;
mod words;

pub use html::to_html;
pub use junit::to_junit;

use self::words::counted;
use crate::record::{Fate, JudgedCase, Use};
use crate::requirements::{By, Judgement, Outcome, Verdict};
use crate::{assess::Assessment, metric::Metric, paperwork::Paperwork, provenance::Provenance, settings::Settings};
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
    let word = Outcome::of(requirements).word();
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
