//! A number about a tracker, with its interval and its method.

use crate::{record::Use, statistics::Estimate};
use serde::Serialize;

/// How the statistics of a number are to be read (ECSS-E-ST-60-20C, annex E).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Reading {
    /// Over attitudes or skies.
    Ensemble,
    /// Over time.
    Temporal,
    /// Over both.
    Mixed,
}

impl Reading {
    /// Returns its word.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Ensemble => "ensemble",
            Self::Temporal => "temporal",
            Self::Mixed => "mixed",
        }
    }
}

/// One number.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Metric {
    /// Its identifier: `bias.x`, `temporal_noise.directional`, ...
    pub id: String,
    /// The case that it is of; `None`: of all that are flown for it.
    pub case: Option<String>,
    /// The value.
    pub value: f64,
    /// Lower end of its interval.
    pub low: f64,
    /// Upper end of its interval; `None`: not bounded by so few values.
    pub high: Option<f64>,
    /// Unit of these.
    pub unit: &'static str,
    /// Degrees of freedom, or trials.
    pub count: f64,
    /// How its statistics are to be read.
    pub reading: Reading,
    /// How it was computed.
    pub how: &'static str,
    /// How its interval was computed.
    #[serde(skip)]
    pub interval: Interval,
    /// Plural of what `count` counts.
    #[serde(skip)]
    pub counted: &'static str,
}

/// Law of an interval, which decides how it shrinks with more data.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Interval {
    /// In proportion to the inverse root of the data: means, slopes, deviations.
    Root,
    /// A share of trials (Clopper and Pearson).
    Share,
    /// Order statistics at the report's probability.
    Quantile,
    /// Order statistics of the median.
    Median,
    /// The value is itself the confidence that a probability is reached.
    Confidence,
    /// From one value of a sweep to the next.
    Sweep,
    /// None: it was counted.
    Counted,
}

/// Common part of all metrics of one kind.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Kind {
    /// First part of the identifier.
    pub id: &'static str,
    /// Unit.
    pub unit: &'static str,
    /// How its statistics are to be read.
    pub reading: Reading,
    /// How it was computed.
    pub how: &'static str,
    /// Parts of the identifier after the point; empty: it has none.
    pub parts: &'static [&'static str],
    /// Uses of the cases that all together give the number of the whole plan.
    pub uses: &'static [Use],
    /// Uses of the cases that have a number each.
    pub case_uses: &'static [Use],
    /// How its interval was computed.
    pub interval: Interval,
    /// Plural of what `count` counts.
    pub counted: &'static str,
}

impl Kind {
    /// Fields that most kinds have in common.
    pub(crate) const USUAL: Self = Self {
        id: "",
        unit: "arcsec",
        reading: Reading::Mixed,
        how: "",
        parts: &[],
        uses: &[],
        case_uses: &[],
        interval: Interval::Root,
        counted: "degrees of freedom",
    };

    /// Returns a metric of this kind.
    pub fn of(&self, part: &str, case: Option<&str>, estimate: Estimate) -> Metric {
        let id = if part.is_empty() { self.id.to_owned() } else { format!("{}.{part}", self.id) };
        Metric {
            id,
            case: case.map(Into::into),
            value: estimate.value,
            low: estimate.low,
            high: estimate.high.is_finite().then_some(estimate.high),
            unit: self.unit,
            count: estimate.count,
            reading: self.reading,
            how: self.how,
            interval: self.interval,
            counted: self.counted,
        }
    }

    /// Returns all identifiers of this kind.
    pub(crate) fn names(&self) -> impl Iterator<Item = String> {
        let whole = self.parts.is_empty().then(|| self.id.to_owned());
        whole.into_iter().chain(self.parts.iter().map(|part| format!("{}.{part}", self.id)))
    }
}

/// Names of the axes in identifiers.
pub const AXES: [&str; 3] = ["x", "y", "rotational"];
/// The axes, and both across the boresight together.
pub(crate) const AXES_AND_DIRECTIONAL: &[&str] = &["x", "y", "rotational", "directional"];
