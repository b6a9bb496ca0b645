//! Requirements: limits, verdicts, and how much data a verdict still needs.
//!
//! `requirements.toml`: identifiers with limits -> verdicts.
//!
//! A limit is met when all of the interval meets it, not met when none of it does, and not shown in between. With `by =
//! "value"` the value alone decides. [`Outcome`] is the verdict on all of them.

use crate::assess::{kinds_of, meant, metric_names};
use crate::metric::{Interval, Metric, Settings, refuse_all};
use crate::record::Use;
use crate::statistics::{confidence_of, share};
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

base::words! {
    /// Result for a requirement.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
    #[serde(rename_all = "snake_case")]
    pub enum Verdict {
        /// Met, with the report's confidence.
        Met = "met",
        /// Not met, with the same.
        NotMet = "NOT MET",
        /// The interval holds the limit: more frames are needed.
        NotShown = "not shown",
        /// The metric was not measured.
        NotMeasured = "not measured",
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

base::words! {
    /// Verdict on all requirements; reports begin with its word.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
    #[serde(rename_all = "snake_case")]
    pub enum Outcome {
        /// All are met.
        Passed = "PASSED",
        /// None is broken, but not all are shown: more data are needed.
        NotShown = "NOT SHOWN",
        /// One at least is not met.
        Failed = "FAILED",
    }
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

// How much data a requirement needs that is not shown yet, where that can be computed: if the tracker stays as it was
// measured, from how many trials or degrees of freedom on its interval meets the limit.

/// Data that a requirement needs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Needs {
    /// So many are needed.
    pub needed: u64,
    /// So many were measured.
    pub measured: u64,
    /// Plural of the things that are counted.
    pub of: &'static str,
}

/// More than anybody measures.
const MOST: u64 = 1 << 40;

/// Returns the data from which on a metric meets its limit; `None` where more of the same would not, or that is not
/// known. `is_met` says whether an interval from `low` to `high` does.
pub(crate) fn needs(
    (metric, all): (&Metric, &[Metric]),
    settings: &Settings,
    is_met: impl Fn(f64, f64) -> bool,
) -> Option<Needs> {
    let tail = 0.5 * (1.0 - settings.confidence);
    let needed = match metric.interval {
        Interval::Share => fewest(metric, |trials| {
            let right = (metric.value * trials as f64).round();
            let found = share(whole(right), trials, settings.confidence);
            found.is_some_and(|found| is_met(found.low, found.high))
        }),
        Interval::Root => fewest(metric, |count| {
            let narrower = (metric.count / count as f64).sqrt();
            let [low, high] = [metric.low, metric.high.unwrap_or(f64::INFINITY)]
                .map(|end| metric.value + (end - metric.value) * narrower);
            is_met(low, high)
        }),
        // An upper end exists from the first count at which all values may be below the quantile.
        Interval::Quantile if metric.high.is_none() => {
            fewest(metric, |count| power(settings.probability, count) <= tail)
        }
        Interval::Median if metric.high.is_none() => fewest(metric, |count| power(0.5, count) <= tail),
        Interval::Confidence => {
            let found = all.iter().find(|other| other.id == "acquisition_probability" && other.case == metric.case)?;
            fewest(metric, |trials| {
                let failures = whole(((1.0 - found.value) * trials as f64).round());
                let confidence = confidence_of(settings.probability, failures, trials);
                is_met(confidence, confidence)
            })
        }
        Interval::Quantile | Interval::Median | Interval::Sweep | Interval::Counted => None,
    }?;
    Some(Needs { needed, measured: whole(metric.count), of: metric.counted })
}

fn power(base: f64, count: u64) -> f64 {
    (base.ln() * count as f64).exp()
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "counts of data, not negative")]
fn whole(count: f64) -> u64 {
    count.max(0.0) as u64
}

/// Returns the fewest data, more than there are, from which on something is so; `None` when it never is.
fn fewest(metric: &Metric, is_so: impl Fn(u64) -> bool) -> Option<u64> {
    let mut low = whole(metric.count).max(1);
    let mut high = low;
    while !is_so(high) {
        low = high;
        high = high.checked_mul(2).filter(|high| *high < MOST)?;
    }
    while high - low > 1 {
        let middle = low + (high - low) / 2;
        if is_so(middle) { high = middle } else { low = middle }
    }
    Some(high)
}

#[cfg(test)]
mod requirements_tests {
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

#[cfg(test)]
mod evidence_tests {
    use super::*;
    use crate::availability::{ACQUISITION, ACQUISITION_CONFIDENCE};
    use crate::bias::OF_ATTITUDES;
    use crate::requirements::{Requirements, Verdict};
    use crate::statistics::{Estimate, mean};

    fn judged(metric: &str, limit: &str, metrics: &[Metric]) -> (Verdict, Option<Needs>) {
        let text = format!("[[requirement]]\nid = \"A\"\nmetric = \"{metric}\"\n{limit}\n");
        let judgement = Requirements::parse(&text, "r").unwrap().judge(metrics, &Settings::default()).remove(0);
        (judgement.verdict, judgement.needs)
    }

    #[test]
    fn a_share_needs_what_clopper_and_pearson_say() {
        let acquired = ACQUISITION.of("", None, share(1000, 1000, 0.95).unwrap());
        let (verdict, needs) = judged("acquisition_probability", "least = 0.997", &[acquired]);
        // By hand: 0.025^(1/n) >= 0.997 from n = ln 0.025 / ln 0.997 = 1227.8 on.
        let wanted = Needs { needed: 1228, measured: 1000, of: "attitudes" };
        assert_eq!((verdict, needs), (Verdict::NotShown, Some(wanted)));
        let enough = ACQUISITION.of("", None, share(1228, 1228, 0.95).unwrap());
        assert_eq!(judged("acquisition_probability", "least = 0.997", &[enough]), (Verdict::Met, None));
        // Where the share itself is below the limit, more of the same shows nothing.
        let failing = ACQUISITION.of("", None, share(996, 1000, 0.95).unwrap());
        assert_eq!(judged("acquisition_probability", "least = 0.997", &[failing]), (Verdict::NotShown, None));
    }

    #[test]
    fn a_confidence_that_is_not_reached_is_not_a_failure() {
        let of = |right: u64, trials: u64| {
            let value = confidence_of(0.997, trials - right, trials);
            let exact = Estimate { value, low: value, high: value, count: trials as f64 };
            let acquired = ACQUISITION.of("", None, share(right, trials, 0.95).unwrap());
            judged("acquisition_confidence", "least = 0.95", &[acquired, ACQUISITION_CONFIDENCE.of("", None, exact)])
        };
        let needs = Needs { needed: 997, measured: 500, of: "attitudes" };
        assert_eq!(of(500, 500), (Verdict::NotShown, Some(needs)));
        assert_eq!(of(997, 997).0, Verdict::Met);
        assert_eq!(of(960, 1000).0, Verdict::NotMet, "40 failures: below the probability with the same confidence");
    }

    #[test]
    fn a_mean_needs_more_with_the_square_of_its_width() {
        let values: Vec<f64> = (0..101).map(|i| 4.0 + f64::from(i % 2 * 2 - 1)).collect();
        let bias = OF_ATTITUDES.of("x", None, mean(&values, 0.95).unwrap());
        let half = bias.high.unwrap() - bias.value;
        let limit = bias.value + 0.25 * half;
        let (verdict, needs) = judged("bias.x", &format!("most = {limit}"), core::slice::from_ref(&bias));
        let needed = needs.unwrap().needed;
        assert!(verdict == Verdict::NotShown && (1600..=1601).contains(&needed), "16 times 100: {needed}");
        let beyond = format!("most = {}", bias.value - 0.25 * half);
        assert_eq!(judged("bias.x", &beyond, &[bias]), (Verdict::NotShown, None));
    }
}
