//! `requirements.toml`: identifiers with limits -> verdicts.
//!
//! A limit is met when all of the interval meets it, not met when none of it does, and not shown in between. With `by =
//! "value"` the value alone decides. [`Outcome`] is the verdict on all of them.

use crate::evidence::{Needs, needs};
use crate::metric::{Interval, Metric};
use crate::metric_list::{kinds_of, meant, metric_names};
use crate::record::Use;
use crate::settings::{Settings, refuse_all};
use anyhow::{Context, Result, anyhow, bail};
use config::{Document, FileKind, check_keys, nearest};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A file of requirements.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Requirements {
    /// In the order of the file.
    #[serde(default)]
    pub requirement: Vec<Requirement>,
}

/// One requirement.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(deny_unknown_fields)]
pub struct Requirement {
    /// Identifier, as in the customer's document.
    pub id: String,
    /// Its words.
    #[serde(default)]
    pub text: String,
    /// The metric's identifier, such as `temporal_noise.x`.
    pub metric: String,
    /// The case, for metrics of single cases.
    pub case: Option<String>,
    /// Largest magnitude that is met, in the metric's unit.
    pub most: Option<f64>,
    /// Least value that is met, in the metric's unit.
    pub least: Option<f64>,
    /// Compared with the limit: the end of the interval, or the value alone.
    #[serde(default)]
    pub by: By,
}

/// Part of an estimate that is compared with the limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum By {
    /// The end of the interval.
    #[default]
    Interval,
    /// The value.
    Value,
}

/// Result for a requirement.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Verdict {
    /// Met, with the report's confidence.
    Met,
    /// Not met, with the same.
    NotMet,
    /// The interval holds the limit: more frames are needed.
    NotShown,
    /// The metric was not measured.
    NotMeasured,
}

impl Verdict {
    /// Returns its words.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Met => "met",
            Self::NotMet => "NOT MET",
            Self::NotShown => "not shown",
            Self::NotMeasured => "not measured",
        }
    }
}

/// A requirement with its verdict.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Judgement {
    /// The requirement.
    #[serde(flatten)]
    pub requirement: Requirement,
    /// Its verdict.
    pub verdict: Verdict,
    /// The metric, if it was measured.
    pub measured: Option<Metric>,
    /// Data that are needed to show it, where that is known.
    pub needs: Option<Needs>,
}

/// Verdict on all requirements.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Outcome {
    /// All are met.
    Passed,
    /// None is broken, but not all are shown: more data are needed.
    NotShown,
    /// One at least is not met.
    Failed,
}

impl Outcome {
    /// Returns the verdict on requirements.
    pub fn of(judgements: &[Judgement]) -> Self {
        let has = |verdict: Verdict| judgements.iter().any(|judgement| judgement.verdict == verdict);
        if has(Verdict::NotMet) {
            Self::Failed
        } else if has(Verdict::NotShown) || has(Verdict::NotMeasured) {
            Self::NotShown
        } else {
            Self::Passed
        }
    }

    /// Returns its word, with which reports begin.
    pub const fn word(self) -> &'static str {
        match self {
            Self::Passed => "PASSED",
            Self::NotShown => "NOT SHOWN",
            Self::Failed => "FAILED",
        }
    }
}

impl Requirements {
    /// Reads a file's text; `file` is what errors call it.
    ///
    /// # Errors
    /// With everything that is wrong: the place in the text, or the requirement, and what was wanted.
    pub fn parse(text: &str, file: &str) -> Result<Self> {
        check_keys(FileKind::Requirements, &Document::from_text(text, Path::new(file)))?;
        let read: Self = toml::from_str(text).with_context(|| file.to_owned())?;
        let all = &read.requirement;
        let mut errors: Vec<anyhow::Error> = all.iter().flat_map(Requirement::errors).collect();
        let ids = || all.iter().map(|requirement| &requirement.id);
        if let Some(twice) = ids().enumerate().find(|(i, id)| ids().take(*i).any(|before| before == *id)) {
            errors.push(anyhow!("requirement \"{}\" is there twice; wanted identifiers that differ", twice.1));
        }
        if all.iter().any(|requirement| kinds_of(&requirement.metric).is_empty()) {
            errors.push(anyhow!("metrics are {}", metric_names().join(", ")));
        }
        refuse_all(&errors).with_context(|| file.to_owned())?;
        Ok(read)
    }

    /// Refuses requirements that no case of these names and uses can meet.
    ///
    /// # Errors
    /// With each of them, and the cases that there are.
    pub fn check_cases(&self, cases: &[(String, Use)]) -> Result<()> {
        let errors: Vec<anyhow::Error> =
            self.requirement.iter().filter_map(|one| one.check_cases(cases).err()).collect();
        refuse_all(&errors)
    }

    /// Returns those that hold for every tracker: no false solution, some attitude at all.
    pub fn usual() -> Self {
        let requirement = |id: &str, text: &str, metric: &str, most: Option<f64>, least: Option<f64>| Requirement {
            id: id.into(),
            text: text.into(),
            metric: metric.into(),
            case: None,
            most,
            least,
            by: By::Value,
        };
        Self {
            requirement: vec![
                requirement("STARLOOP-1", "No solution is false", "false_solutions", Some(0.0), None),
                requirement("STARLOOP-2", "Attitudes are acquired", "acquisition_probability", None, Some(0.5)),
            ],
        }
    }

    /// Returns the verdicts.
    pub fn judge(&self, metrics: &[Metric], settings: &Settings) -> Vec<Judgement> {
        let judge = |requirement: &Requirement| {
            let is_meant = |metric: &&Metric| metric.id == requirement.metric && metric.case == requirement.case;
            let measured = metrics.iter().find(is_meant);
            let verdict = measured.map_or(Verdict::NotMeasured, |metric| requirement.verdict(metric));
            let needs = measured.filter(|_| verdict == Verdict::NotShown).and_then(|metric| {
                needs((metric, metrics), settings, |low, high| requirement.is_met(metric, low, high))
            });
            Judgement { requirement: requirement.clone(), verdict, measured: measured.cloned(), needs }
        };
        self.requirement.iter().map(judge).collect()
    }
}

impl Requirement {
    fn errors(&self) -> Vec<anyhow::Error> {
        let Self { id, metric, most, least, case, .. } = self;
        let mut errors = Vec::new();
        match (most, least) {
            (Some(_), None) | (None, Some(_)) => {}
            (Some(_), Some(_)) => {
                errors.push(anyhow!("requirement \"{id}\": got both, wanted most or least, one of them"));
            }
            (None, None) => {
                errors.push(anyhow!("requirement \"{id}\": got neither, wanted most or least, one of them"));
            }
        }
        let kinds = kinds_of(metric);
        if kinds.is_empty() {
            errors.push(anyhow!("requirement \"{id}\": unknown metric \"{metric}\"{}", meant(metric)));
        } else if case.is_some() && kinds.iter().all(|kind| kind.case_uses.is_empty()) {
            errors.push(anyhow!("requirement \"{id}\": {metric} is measured of all cases together; leave case out"));
        } else if case.is_none() && kinds.iter().all(|kind| kind.uses.is_empty()) {
            errors.push(anyhow!("requirement \"{id}\": {metric} is measured of each case; wanted case = \"NAME\""));
        }
        errors
    }

    fn check_cases(&self, cases: &[(String, Use)]) -> Result<()> {
        let Self { id, metric, case, .. } = self;
        let kinds = kinds_of(metric);
        let words = |uses: Vec<&Use>| uses.into_iter().map(|of| of.name()).collect::<Vec<_>>().join(", ");
        let Some(case) = case else {
            let uses: Vec<&Use> = kinds.iter().flat_map(|kind| kind.uses).collect();
            if cases.iter().any(|(_, of)| uses.contains(&of)) {
                return Ok(());
            }
            bail!("requirement \"{id}\": no case measures {metric}; wanted one of use {}", words(uses));
        };
        let names = || cases.iter().map(|(name, _)| name.as_str());
        let Some((_, of)) = cases.iter().find(|(name, _)| name == case) else {
            let near = nearest(case, names()).map(|name| format!("; did you mean \"{name}\"?")).unwrap_or_default();
            bail!(
                "requirement \"{id}\": unknown case \"{case}\"{near}; cases are {}",
                names().collect::<Vec<_>>().join(", ")
            );
        };
        let uses: Vec<&Use> = kinds.iter().flat_map(|kind| kind.case_uses).collect();
        if uses.contains(&of) {
            return Ok(());
        }
        bail!("requirement \"{id}\": a case of use {} does not measure {metric}; wanted {}", of.name(), words(uses));
    }

    fn is_met(&self, metric: &Metric, low: f64, high: f64) -> bool {
        self.verdict(&Metric { low, high: Some(high), ..metric.clone() }) == Verdict::Met
    }

    fn verdict(&self, metric: &Metric) -> Verdict {
        let [low, high] = match self.by {
            By::Interval => [metric.low, metric.high.unwrap_or(f64::INFINITY)],
            By::Value => [metric.value; 2],
        };
        // Of a magnitude: zero is in the middle.
        let nearest_zero = if low <= 0.0 && high >= 0.0 { 0.0 } else { low.abs().min(high.abs()) };
        let [is_met, is_broken] = match (self.most, self.least) {
            (Some(most), _) => [low.abs().max(high.abs()) <= most, nearest_zero > most],
            // Of a confidence, too: little of it shows nothing, unless it is as sure of the contrary.
            (None, Some(least)) if metric.interval == Interval::Confidence => [low >= least, high <= 1.0 - least],
            (None, Some(least)) => [low >= least, high < least],
            (None, None) => [false, false],
        };
        match (is_met, is_broken) {
            (true, _) => Verdict::Met,
            (false, true) => Verdict::NotMet,
            (false, false) => Verdict::NotShown,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{metric::Kind, statistics::Estimate};

    fn metric(value: f64, low: f64, high: f64) -> Metric {
        let kind = Kind { id: "bias", ..Kind::USUAL };
        kind.of("x", None, Estimate { value, low, high, count: 9.0 })
    }

    fn verdict(keys: &str, metric: &Metric) -> Verdict {
        let text = format!("[[requirement]]\nid = \"A\"\nmetric = \"bias.x\"\n{keys}");
        Requirements::parse(&text, "r.toml").unwrap().judge(std::slice::from_ref(metric), &Settings::default())[0]
            .verdict
    }

    #[test]
    fn the_nearest_end_of_the_interval_decides() {
        let bias = metric(-3.0, -4.0, -2.0);
        assert_eq!(verdict("most = 4.5", &bias), Verdict::Met);
        assert_eq!(verdict("most = 3.5", &bias), Verdict::NotShown);
        assert_eq!(verdict("most = 3.5\nby = \"value\"", &bias), Verdict::Met);
        assert_eq!(verdict("most = 1.5", &bias), Verdict::NotMet);
        assert_eq!(verdict("least = -5", &bias), Verdict::Met);
        assert_eq!(verdict("least = -3", &bias), Verdict::NotShown);
        assert_eq!(verdict("least = 0", &bias), Verdict::NotMet);
        assert_eq!(verdict("most = 1", &metric(0.0, -2.0, 2.0)), Verdict::NotShown);
        assert_eq!(verdict("most = 9", &metric(1.0, 0.0, f64::INFINITY)), Verdict::NotShown, "no upper end");
        let other = Metric { id: "bias.y".into(), ..bias };
        assert_eq!(verdict("most = 9", &other), Verdict::NotMeasured);
    }

    #[test]
    fn nothing_that_was_not_broken_is_a_failure() {
        let outcome = |keys: &[&str], metric: &Metric| {
            let one =
                |(i, keys): (usize, &&str)| format!("[[requirement]]\nid = \"{i}\"\nmetric = \"bias.x\"\n{keys}\n");
            let text: String = keys.iter().enumerate().map(one).collect();
            let read = Requirements::parse(&text, "r.toml").unwrap();
            Outcome::of(&read.judge(std::slice::from_ref(metric), &Settings::default()))
        };
        let bias = metric(3.0, 2.0, 4.0);
        assert_eq!(outcome(&["most = 5"], &bias), Outcome::Passed);
        assert_eq!(outcome(&["most = 5", "most = 3.5"], &bias), Outcome::NotShown);
        assert_eq!(outcome(&["most = 5", "most = 3.5", "most = 1"], &bias), Outcome::Failed);
        assert_eq!(outcome(&["most = 5"], &Metric { id: "bias.y".into(), ..bias }), Outcome::NotShown, "not measured");
    }

    #[test]
    fn names_are_checked_against_the_cases_before_anything_flies() {
        let cases = [("slew 1".to_owned(), Use::Slew), ("grid".to_owned(), Use::FovGrid)];
        let check = |keys: &str| {
            let text = format!("[[requirement]]\nid = \"A\"\nmost = 1\n{keys}");
            let read = Requirements::parse(&text, "r.toml").map_err(|error| format!("{error:#}"))?;
            read.check_cases(&cases).map_err(|error| format!("{error:#}"))
        };
        assert_eq!(check("metric = \"losses\"\ncase = \"slew 1\""), Ok(()));
        assert_eq!(check("metric = \"bias.x\""), Ok(()));
        for (keys, wanted) in [
            ("metric = \"losses\"\ncase = \"slew\"", "did you mean \"slew 1\"?; cases are slew 1, grid"),
            ("metric = \"losses\"\ncase = \"grid\"", "a case of use fov_grid does not measure losses"),
            ("metric = \"losses\"", "wanted case = "),
            ("metric = \"bias.x\"\ncase = \"grid\"", "leave case out"),
            ("metric = \"drift.x\"", "no case measures drift.x; wanted one of use drift, run"),
            ("metric = \"temporal_nois.x\"", "did you mean \"temporal_noise.x\"?"),
            ("metric = \"acquisition_time\"", "did you mean \"acquisition_time.at_probability\""),
        ] {
            let refused = check(keys).unwrap_err();
            assert!(refused.contains(wanted), "{keys}: {refused}");
        }
    }

    #[test]
    fn files_that_cannot_be_meant_are_refused() {
        let refused = |text: &str| format!("{:#}", Requirements::parse(text, "r.toml").unwrap_err());
        let one = "[[requirement]]\nid = \"A\"\nmetric = \"bias.x\"\n";
        assert!(refused(one).contains("got neither, wanted most or least"), "{}", refused(one));
        assert!(refused("").contains("requirement is missing"));
        let two = refused(&format!("{one}\n{}most = 1\nleast = 1", one.replace("bias.x", "bias.z")));
        assert!(two.contains("neither") && two.contains("bias.z") && two.contains("got both"), "all at once: {two}");
        assert!(refused(&format!("{one}most = 1\nleast = 1")).contains("got both"));
        assert!(refused(&format!("{one}most = inf")).contains("most is inf"));
        assert!(refused(&format!("{one}most = 1\nmist = 2")).contains("mist"));
        assert!(refused(&format!("{one}most = 1\n{one}most = 2")).contains("twice"));
    }
}
