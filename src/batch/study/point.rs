//! One point of a study: measured value, theoretical value, and whether they agree.

use serde::Serialize;

/// Verdict on a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Agreement {
    /// Within the tolerance.
    Met,
    /// Outside it.
    NotMet,
    /// Beyond the range in which theory is checked: shown only.
    Reported,
}

/// One row of `study.csv`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StudyPoint {
    /// Measured quantity, with its unit.
    pub kind: &'static str,
    /// Varied quantity, with its unit.
    pub varied: &'static str,
    /// Value of the varied quantity.
    pub value: f64,
    /// Value measured on the true attitude; NaN when the loop did not stay in fine pointing.
    pub measured: f64,
    /// Theoretical value.
    pub predicted: f64,
    /// Measured over predicted.
    pub ratio: f64,
    /// Largest difference that is accepted.
    pub allowed: f64,
    /// Verdict.
    pub verdict: Agreement,
}

/// Phase margin, deg.
pub const PHASE_MARGIN: &str = "phase_margin_deg";
/// Frequency at which the open loop has gain one, Hz.
pub const CROSSOVER: &str = "crossover_hz";
/// Delay at which the phase margin is used up, ms.
pub const DELAY_MARGIN: &str = "delay_margin_ms";
/// Jitter that the loop leaves, relative to the motion of a free body.
pub const REJECTION: &str = "jitter_left";
/// Rms of the boresight's direction about its mean, arcsec.
pub const POINTING_ERROR: &str = "pointing_error_arcsec";
/// Error of the estimate in a turn by wrong time tags, arcsec.
pub const TAG_ERROR: &str = "estimate_behind_arcsec";
/// Largest pointing error beyond the delay margin, arcsec.
pub const LARGEST_ERROR: &str = "largest_error_arcsec";

/// Delay from control step to torque.
pub const ACTUATION_DELAY: &str = "actuation_delay_ms";
/// Delay from the last pixel to the attitude, known by its time tag.
pub const TRACKER_DELAY: &str = "tracker_delay_ms";
/// Error of the time tags.
pub const TAG: &str = "tag_error_ms";
/// Frequency of base jitter.
pub const JITTER: &str = "jitter_hz";

impl StudyPoint {
    /// Returns a point that passes when it is within `allowed` of the prediction.
    pub fn judged(kind: &'static str, (varied, value): (&'static str, f64), got: [f64; 2], allowed: f64) -> Self {
        let [measured, predicted] = got;
        let is_met = (measured - predicted).abs() <= allowed;
        let verdict = if is_met { Agreement::Met } else { Agreement::NotMet };
        Self { kind, varied, value, measured, predicted, ratio: measured / predicted, allowed, verdict }
    }

    /// Returns the point as shown but not judged.
    #[must_use]
    pub fn reported(self) -> Self {
        Self { verdict: Agreement::Reported, ..self }
    }
}
