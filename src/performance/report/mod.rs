//! The report: verdict, conditions, requirements, metrics, plots, provenance; as HTML, JSON and JUnit.
//!
//! Tour: `html` -> `plots`; `junit`.

mod html;
mod junit;
mod plots;
#[cfg(test)]
mod tests;

pub use html::to_html;
pub use junit::to_junit;

use crate::assess::Assessment;
use crate::metric::Metric;
use crate::provenance::Provenance;
use crate::record::{Fate, JudgedCase, Use};
use crate::requirements::{Judgement, Verdict, all_met};
use crate::settings::Settings;
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
    /// All requirements are met.
    pub is_met: bool,
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
        }
    }
}

impl Report {
    /// Returns the report of an assessment.
    #[must_use]
    pub fn new(
        title: String,
        assessment: &Assessment,
        requirements: Vec<Judgement>,
        conditions: Vec<(String, String)>,
        provenance: Provenance,
    ) -> Self {
        let is_met = all_met(&requirements);
        Self {
            schema: SCHEMA,
            verdict: verdict(&title, &requirements, assessment),
            title,
            is_met,
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

fn verdict(title: &str, requirements: &[Judgement], assessment: &Assessment) -> String {
    let count = |verdict: Verdict| requirements.iter().filter(|judgement| judgement.verdict == verdict).count();
    let word = if all_met(requirements) { "PASSED" } else { "FAILED" };
    let mut parts = vec![format!("{} of {} requirements met", count(Verdict::Met), requirements.len())];
    for verdict in [Verdict::NotMet, Verdict::NotShown, Verdict::NotMeasured] {
        if count(verdict) > 0 {
            parts.push(format!("{} {}", count(verdict), verdict.name()));
        }
    }
    let frames: usize = assessment.cases.iter().map(|case| case.frames.len()).sum();
    parts.push(format!("{} cases, {frames} frames", assessment.cases.len()));
    format!("{word}: {title}: {}", parts.join(", "))
}
