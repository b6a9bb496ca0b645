//! Metrics, and the settings that they are computed by.
//!
//! A number about a tracker, with its interval and its method.

use crate::record::{FalseLimit, Use};
use crate::statistics::Estimate;
use anyhow::{Result, bail};
use serde::Serialize;

base::words! {
    /// How the statistics of a number are to be read (ECSS-E-ST-60-20C, annex E).
    #[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
    #[serde(rename_all = "snake_case")]
    pub enum Reading {
        /// Over attitudes or skies.
        Ensemble = "ensemble",
        /// Over time.
        Temporal = "temporal",
        /// Over both.
        Mixed = "mixed",
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

// Confidence, probability and limit of a report.

/// Confidence, probability and limit that all numbers are stated with.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Settings {
    /// Of intervals, 0.95 usually.
    pub confidence: f64,
    /// Of performances, 0.997 usually.
    pub probability: f64,
    /// Beyond it a solution is false.
    pub false_limit: FalseLimit,
    /// Largest temporal noise per axis across the boresight at which the performance is met, arcsec; `None`: not asked for.
    pub exclusion_noise_arcsec: Option<f64>,
}

impl Default for Settings {
    /// The usual numbers; a false solution is off by more than 0.1 deg across the boresight or 1 deg about it.
    fn default() -> Self {
        let false_limit = FalseLimit { directional_arcsec: 360.0, rotational_arcsec: 3600.0 };
        Self { confidence: 0.95, probability: 0.997, false_limit, exclusion_noise_arcsec: None }
    }
}

/// Largest angle of a limit, arcsec: half a turn.
const MOST_ARCSEC: f64 = 648_000.0;

/// Refuses a number outside its range.
///
/// # Errors
/// With its name, the number and the range.
pub fn check_range(name: &str, got: f64, low: f64, high: f64) -> Result<()> {
    let is_good = (low..=high).contains(&got);
    if is_good { Ok(()) } else { bail!("{name}: got {got}, wanted {low} to {high}") }
}

/// Refuses a confidence or a probability that no interval can have.
///
/// # Errors
/// With its name, the number and the range.
pub fn check_share(name: &str, got: f64) -> Result<()> {
    check_range(name, got, 0.5, 0.999_999)
}

impl Settings {
    /// Returns what is wrong: each number that is out of its range.
    pub fn errors(&self) -> Vec<anyhow::Error> {
        let Self { confidence, probability, false_limit, exclusion_noise_arcsec } = *self;
        let checks = [
            check_share("confidence", confidence),
            check_share("probability", probability),
            check_range("false_directional_arcsec", false_limit.directional_arcsec, 1e-3, MOST_ARCSEC),
            check_range("false_rotational_arcsec", false_limit.rotational_arcsec, 1e-3, MOST_ARCSEC),
            exclusion_noise_arcsec
                .map_or(Ok(()), |arcsec| check_range("exclusion_noise_arcsec", arcsec, 1e-6, MOST_ARCSEC)),
        ];
        checks.into_iter().filter_map(Result::err).collect()
    }
}

/// Refuses what has errors: all of them as one, a line each.
///
/// # Errors
/// When there is one.
pub fn refuse_all(errors: &[anyhow::Error]) -> Result<()> {
    if errors.is_empty() {
        return Ok(());
    }
    bail!("{}", errors.iter().map(|error| format!("{error:#}")).collect::<Vec<_>>().join("\n  "))
}
