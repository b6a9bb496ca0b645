//! `--junit` of `run`, `campaign` and `replay`: test cases in JUnit XML, which CI servers read.

use anyhow::{Context, Result};
use base::xml::escaped;
use frames::report::junit;
use frames::sink::replace_own_file;
use run::wiring::{assessment::Verdict, invariants::InvariantLine};
use std::path::Path;

/// How a test case ended.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum Outcome {
    /// As wanted.
    Passed,
    /// Not as wanted, with what was wanted and got.
    Failed(String),
    /// It could not be judged, and why.
    Error(String),
    /// There was nothing to judge, and why.
    Skipped(String),
}

/// A test case.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Case {
    /// Group in which servers show it.
    pub(crate) class: String,
    /// Name.
    pub(crate) name: String,
    /// How it ended.
    pub(crate) outcome: Outcome,
}

impl Case {
    /// Returns a case that passed, or failed with these words.
    pub(crate) fn new(class: &str, name: impl Into<String>, failure: Option<String>) -> Self {
        let outcome = failure.map_or(Outcome::Passed, Outcome::Failed);
        Self { class: class.into(), name: name.into(), outcome }
    }

    /// Returns the case of an expectation of a run.
    pub(crate) fn of_expectation(class: &str, one: &Verdict) -> Self {
        let failure = (!one.passed).then(|| format!("wanted {}, got {}", one.wanted, one.got));
        Self::new(class, format!("expect: {}", one.name), failure)
    }

    /// Returns the case of an invariant of a run.
    pub(crate) fn of_invariant(class: &str, one: &InvariantLine) -> Self {
        let first = one.first.as_deref().unwrap_or_default();
        let broken =
            || Outcome::Failed(format!("broken in {} of {} checks; the first: {first}", one.violations, one.checks));
        let outcome = match (one.checks, one.violations) {
            (0, _) => Outcome::Skipped("the run has nothing to check here".into()),
            (_, 0) => Outcome::Passed,
            _ => broken(),
        };
        Self { class: class.into(), name: format!("invariant: {}", one.name), outcome }
    }

    /// Returns the attributes and the content of its element.
    fn element(&self) -> (String, String) {
        let body = |element: &str, words: &str| format!("<{element} message=\"{}\"/>", escaped(words));
        let body = match &self.outcome {
            Outcome::Passed => String::new(),
            Outcome::Failed(words) => body("failure", words),
            Outcome::Error(words) => body("error", words),
            Outcome::Skipped(words) => body("skipped", words),
        };
        (format!("classname=\"{}\" name=\"{}\"", escaped(&self.class), escaped(&self.name)), body)
    }
}

/// Returns the document of these cases.
pub(crate) fn document(suite: &str, wall_s: Option<f64>, cases: &[Case]) -> String {
    junit::document(suite, wall_s, &cases.iter().map(Case::element).collect::<Vec<_>>())
}

/// Writes the document.
///
/// # Errors
/// When the file cannot be written.
pub(crate) fn save(path: &Path, document: &str) -> Result<()> {
    replace_own_file(path, |out| out.write_all(document.as_bytes())).context("--junit")?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_met_is_a_failure_with_what_was_wanted() {
        let of = |passed| Verdict { name: "fine pointing", wanted: "< 9 s".into(), got: "12 s".into(), passed };
        let expectation = |passed| Case::of_expectation("run", &of(passed));
        let text =
            document("a & b", Some(1.0), &[Case::new("run", "verdict", None), expectation(false), expectation(true)]);
        assert!(text.contains("name=\"a &amp; b\" tests=\"3\" failures=\"1\""), "{text}");
        assert!(text.contains("<failure message=\"wanted &lt; 9 s, got 12 s\"/>"), "{text}");
        assert_eq!(text.matches("<testcase").count(), 3, "{text}");
    }

    #[test]
    fn an_invariant_holds_is_broken_or_has_nothing_to_check() {
        let of = |checks, violations, first: Option<&str>| {
            let line = InvariantLine { name: "hits", checks, violations, first: first.map(str::to_owned) };
            Case::of_invariant("run", &line).outcome
        };
        assert_eq!(of(3, 0, None), Outcome::Passed);
        assert_eq!(of(3, 2, Some("a")), Outcome::Failed("broken in 2 of 3 checks; the first: a".into()));
        assert!(matches!(of(0, 0, None), Outcome::Skipped(_)));
    }
}
