//! Confidence, probability and limit of a report.

use crate::record::FalseLimit;
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
