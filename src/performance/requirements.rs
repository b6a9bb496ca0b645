//! `requirements.toml`: identifiers with limits -> verdicts.
//!
//! A limit is met when the end of the interval that is nearest to it meets it: what is not shown is not met.

use crate::metric::Metric;
use anyhow::{Context, Result, bail};
use serde::{Deserialize, Serialize};

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
    #[must_use]
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
}

impl Requirements {
    /// Reads a file's text; `file` is what errors call it.
    ///
    /// # Errors
    /// With the place in the text, and what was wanted.
    pub fn parse(text: &str, file: &str) -> Result<Self> {
        let read: Self = toml::from_str(text).with_context(|| file.to_owned())?;
        for requirement in &read.requirement {
            let Requirement { id, most, least, .. } = requirement;
            if most.is_none() == least.is_none() {
                bail!("{file}: requirement \"{id}\": got {}, wanted most or least, one of them", both(*most));
            }
            let limit = most.or(*least).unwrap_or_default();
            if !limit.is_finite() {
                bail!("{file}: requirement \"{id}\": got the limit {limit}, wanted a finite number");
            }
        }
        let ids = || read.requirement.iter().map(|requirement| &requirement.id);
        if let Some(twice) = ids().enumerate().find(|(i, id)| ids().take(*i).any(|before| before == *id)) {
            bail!("{file}: requirement \"{}\" is there twice; wanted identifiers that differ", twice.1);
        }
        Ok(read)
    }

    /// Returns those that hold for every tracker: no false solution, some attitude at all.
    #[must_use]
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
    #[must_use]
    pub fn judge(&self, metrics: &[Metric]) -> Vec<Judgement> {
        let judge = |requirement: &Requirement| {
            let is_meant = |metric: &&Metric| metric.id == requirement.metric && metric.case == requirement.case;
            let measured = metrics.iter().find(is_meant);
            let verdict = measured.map_or(Verdict::NotMeasured, |metric| requirement.verdict(metric));
            Judgement { requirement: requirement.clone(), verdict, measured: measured.cloned() }
        };
        self.requirement.iter().map(judge).collect()
    }
}

fn both(most: Option<f64>) -> &'static str {
    if most.is_some() { "both" } else { "neither" }
}

impl Requirement {
    fn verdict(&self, metric: &Metric) -> Verdict {
        let [low, high] = match self.by {
            By::Interval => [metric.low, metric.high.unwrap_or(f64::INFINITY)],
            By::Value => [metric.value; 2],
        };
        // Of a magnitude: zero is in the middle.
        let nearest_zero = if low <= 0.0 && high >= 0.0 { 0.0 } else { low.abs().min(high.abs()) };
        let [is_met, is_broken] = match (self.most, self.least) {
            (Some(most), _) => [low.abs().max(high.abs()) <= most, nearest_zero > most],
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

/// Returns true when all are met.
#[must_use]
pub fn all_met(judgements: &[Judgement]) -> bool {
    judgements.iter().all(|judgement| judgement.verdict == Verdict::Met)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metric::{Kind, Reading};
    use crate::statistics::Estimate;

    fn metric(value: f64, low: f64, high: f64) -> Metric {
        let kind = Kind { id: "bias", unit: "arcsec", reading: Reading::Ensemble, how: "" };
        kind.of("x", None, Estimate { value, low, high, count: 9.0 })
    }

    fn verdict(keys: &str, metric: &Metric) -> Verdict {
        let text = format!("[[requirement]]\nid = \"A\"\nmetric = \"bias.x\"\n{keys}");
        Requirements::parse(&text, "r.toml").unwrap().judge(std::slice::from_ref(metric))[0].verdict
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
        assert_eq!(verdict("most = 9\ncase = \"slew 1\"", &bias), Verdict::NotMeasured);
    }

    #[test]
    fn files_that_cannot_be_meant_are_refused() {
        let refused = |text: &str| format!("{:#}", Requirements::parse(text, "r.toml").unwrap_err());
        let one = "[[requirement]]\nid = \"A\"\nmetric = \"bias.x\"\n";
        assert!(refused(one).contains("got neither, wanted most or least"), "{}", refused(one));
        assert!(refused(&format!("{one}most = 1\nleast = 1")).contains("got both"));
        assert!(refused(&format!("{one}most = inf")).contains("finite"));
        assert!(refused(&format!("{one}most = 1\nmist = 2")).contains("mist"));
        assert!(refused(&format!("{one}most = 1\n{one}most = 2")).contains("twice"));
    }
}
