//! Confidence, probability and limit of a report.

use crate::record::FalseLimit;
use anyhow::{Result, bail};
use serde::Serialize;

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
