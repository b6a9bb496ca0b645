//! The filter: one gyro sample at a time forward, one attitude at a time back into the past.
//!
//! Error state: rotation vector from the estimate to the truth (body axes) and bias error, with `a' = -w x a - b -
//! noise`. An attitude measures `a` directly, so its matrix is (1 0) and the innovation is the exact rotation vector.
//! The attitude is corrected by multiplication and the error is zero again; the turning of the covariance by half of
//! that correction (second order) is left out, as is usual.

use super::covariance6::Covariance6;
use super::history::{Estimate, Fix, History, Step, propagated};
use super::params::MekfParams;
use base::axes::{Body, Icrf, Rotation};
use base::refused::Refused;
use base::time::{Span, Tai};
use glam::{DMat3, DVec3};

/// Result of a measured attitude.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Measured {
    /// Worked in. Squared Mahalanobis distance of the innovation: chi-square with 3 degrees of freedom.
    Used {
        /// `innovation' S^-1 innovation`.
        normalised_innovation: f64,
    },
    /// Further off than the gate: left out.
    Gated {
        /// `innovation' S^-1 innovation`.
        normalised_innovation: f64,
    },
    /// Valid before what the history still holds: left out.
    TooOld,
    /// Valid after the last gyro sample: left out; propagate first.
    Ahead,
    /// Not finite, or a covariance that is not positive: left out.
    Unusable,
    /// The filter was not started, or was lost, and started from this one.
    Started,
}

/// Counters of the filter.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct MekfCounts {
    /// Attitudes worked in.
    pub used: u64,
    /// Attitudes refused by the gate.
    pub gated: u64,
    /// Attitudes too old, ahead or unusable.
    pub refused: u64,
    /// Starts from an attitude, the first included.
    pub starts: u64,
    /// Gyro samples that were missing.
    pub gyro_dropouts: u64,
}

/// Multiplicative extended Kalman filter for attitude and gyro bias.
#[derive(Debug, Clone)]
pub struct Mekf {
    params: MekfParams,
    history: History,
    started: bool,
    gated_in_a_row: u32,
    /// Counters so far.
    pub counts: MekfCounts,
}

impl Mekf {
    /// Returns a filter that knows no attitude yet.
    ///
    /// # Errors
    /// Settings out of range.
    pub fn new(params: MekfParams, start: Tai) -> Result<Self, Refused> {
        params.check()?;
        let attitude = DMat3::IDENTITY * params.initial_attitude_sigma_rad.powi(2);
        let after = fresh(&params, Rotation::IDENTITY, attitude);
        let first = Step { at: start, rate_measured_rad_s: DVec3::ZERO, silent_for: None, fix: None, after };
        let history = History::new(first, params.history, params.history_steps);
        Ok(Self { params, history, started: false, gated_in_a_row: 0, counts: MekfCounts::default() })
    }

    /// Takes one gyro sample: the mean rate since the last one, up to `at`, rad/s in body axes. `None`: no sample came;
    /// the last rate goes on with noise for the acceleration that was not seen. A time that is not later is left out.
    pub fn propagate(&mut self, at: Tai, rate_measured_rad_s: Option<DVec3>) {
        let last = *self.history.last();
        let span = at - last.at;
        if span <= Span::ZERO {
            return;
        }
        let sample = rate_measured_rad_s.filter(|rate| rate.is_finite());
        self.counts.gyro_dropouts += u64::from(sample.is_none());
        let silent_for = sample.is_none().then(|| self.silence_at_end(&last));
        let rate = sample.unwrap_or(last.rate_measured_rad_s);
        let after = propagated(&last.after, &self.params, rate, silent_for, span);
        self.history.push(Step { at, rate_measured_rad_s: rate, silent_for, fix: None, after });
    }

    /// Begins from an attitude known at `at` (not after the last gyro sample); the bias is forgotten. Gyro samples
    /// since then are worked through again. `false` when `at` is out of reach or the numbers are not usable.
    #[cfg(test)]
    pub fn start_from(&mut self, at: Tai, body_from_icrf: &Rotation<Body, Icrf>, covariance_rad2: &DMat3) -> bool {
        let fix = Fix { attitude: *body_from_icrf, covariance_rad2: *covariance_rad2 };
        usable(&fix) && self.restart(at, &fix) == Ok(Measured::Started)
    }

    /// Returns an attitude from a star tracker that held at `at`, with its noise covariance in body axes (rad^2).
    ///
    /// The history is split at `at`, the attitude worked in there and everything later repeated, so that the result
    /// is that of a tracker without delay. Attitudes may come in any order.
    pub fn measure(&mut self, at: Tai, body_from_icrf: &Rotation<Body, Icrf>, covariance_rad2: &DMat3) -> Measured {
        let fix = Fix { attitude: *body_from_icrf, covariance_rad2: *covariance_rad2 };
        let result = if !usable(&fix) {
            Measured::Unusable
        } else if !self.started || self.is_lost() {
            self.restart(at, &fix).unwrap_or_else(|refused| refused)
        } else {
            self.work_in(at, fix).unwrap_or_else(|refused| refused)
        };
        match result {
            Measured::Used { .. } => self.counts.used += 1,
            Measured::Gated { .. } => self.counts.gated += 1,
            Measured::Started => {}
            Measured::TooOld | Measured::Ahead | Measured::Unusable => self.counts.refused += 1,
        }
        result
    }

    /// Returns the attitude at `at`: from the history, or past its end with the last rate. `None` before the first
    /// start and before what the history holds.
    pub fn attitude(&self, at: Tai) -> Option<Rotation<Body, Icrf>> {
        if !self.started {
            return None;
        }
        let index = self.history.at_or_before(at)?;
        let from = self.history.get(index);
        let over = self.history.get((index + 1).min(self.history.len() - 1));
        let rate = over.rate_measured_rad_s - from.after.bias_rad_s;
        Some(from.after.attitude.rotated_by(rate * (at - from.at).s()))
    }

    /// Returns the last rate less the bias, rad/s, body axes.
    pub fn rate_rad_s(&self) -> DVec3 {
        let last = self.history.last();
        last.rate_measured_rad_s - last.after.bias_rad_s
    }

    /// Returns the gyro bias, rad/s, body axes.
    pub fn bias_rad_s(&self) -> DVec3 {
        self.history.last().after.bias_rad_s
    }

    /// Returns the standard deviation of the attitude error about each body axis, rad.
    pub fn sigma_rad(&self) -> DVec3 {
        self.history.last().after.covariance.attitude_sigma_rad()
    }

    /// Returns the covariance at the last gyro sample.
    pub fn covariance(&self) -> &Covariance6 {
        &self.history.last().after.covariance
    }

    /// Returns the time of the last gyro sample.
    pub fn at(&self) -> Tai {
        self.history.last().at
    }

    /// Has an attitude, is not lost, and its largest sigma is below the stated one.
    #[cfg(test)]
    pub fn is_converged(&self) -> bool {
        self.started && !self.is_lost() && self.sigma_rad().max_element() < self.params.converged_sigma_rad
    }

    /// Returns whether more attitudes in a row were refused than allowed: the next one restarts the filter.
    pub fn is_lost(&self) -> bool {
        self.gated_in_a_row > self.params.lost_after
    }

    fn silence_at_end(&self, last: &Step) -> Span {
        let Some(silent) = last.silent_for else { return Span::ZERO };
        let index = self.history.len() - 1;
        let begun_at = index.checked_sub(1).map_or(last.at, |before| self.history.get(before).at);
        silent + (last.at - begun_at)
    }

    /// Returns the index of the step right before `at`, or why there is none.
    fn step_before(&self, at: Tai) -> Result<usize, Measured> {
        let now = self.history.last().at;
        if at > now {
            return Err(Measured::Ahead);
        }
        if at < now - self.params.history {
            return Err(Measured::TooOld);
        }
        self.history.at_or_before(at).ok_or(Measured::TooOld)
    }

    /// Returns the step that ends at `at`, cut out of the one it falls into; not yet in the history.
    fn cut(&self, index: usize, at: Tai) -> Step {
        let from = *self.history.get(index);
        let (rate, silent) = if index + 1 < self.history.len() {
            let whole = self.history.get(index + 1);
            (whole.rate_measured_rad_s, whole.silent_for)
        } else {
            (from.rate_measured_rad_s, from.silent_for.map(|_| self.silence_at_end(&from)))
        };
        let after = propagated(&from.after, &self.params, rate, silent, at - from.at);
        Step { at, rate_measured_rad_s: rate, silent_for: silent, fix: None, after }
    }

    fn work_in(&mut self, at: Tai, fix: Fix) -> Result<Measured, Measured> {
        let index = self.step_before(at)?;
        let mut step = self.cut(index, at);
        let normalised_innovation = normalised_innovation(&step.after, &fix).ok_or(Measured::Unusable)?;
        if normalised_innovation > self.params.gate_sigma.powi(2) {
            self.gated_in_a_row += 1;
            return Ok(Measured::Gated { normalised_innovation });
        }
        self.gated_in_a_row = 0;
        step.after = corrected(&step.after, &fix);
        step.fix = Some(fix);
        let inserted = self.history.split_after(index, step);
        self.replay_after(inserted);
        self.history.forget();
        Ok(Measured::Used { normalised_innovation })
    }

    fn restart(&mut self, at: Tai, fix: &Fix) -> Result<Measured, Measured> {
        let index = self.step_before(at)?;
        let mut step = self.cut(index, at);
        step.after = fresh(&self.params, fix.attitude, fix.covariance_rad2);
        let inserted = self.history.split_after(index, step);
        self.history.forget_before(inserted);
        for later in 1..self.history.len() {
            self.history.get_mut(later).fix = None;
        }
        self.replay_after(0);
        self.history.forget();
        (self.started, self.gated_in_a_row) = (true, 0);
        self.counts.starts += 1;
        Ok(Measured::Started)
    }

    fn replay_after(&mut self, index: usize) {
        let mut before = *self.history.get(index);
        for later in index + 1..self.history.len() {
            let step = self.history.get_mut(later);
            let span = step.at - before.at;
            step.after = propagated(&before.after, &self.params, step.rate_measured_rad_s, step.silent_for, span);
            if let Some(fix) = &step.fix {
                step.after = corrected(&step.after, fix);
            }
            before = *step;
        }
    }
}

fn fresh(params: &MekfParams, attitude: Rotation<Body, Icrf>, covariance_rad2: DMat3) -> Estimate {
    let bias = DMat3::IDENTITY * params.initial_bias_sigma_rad_s.powi(2);
    Estimate { attitude, bias_rad_s: DVec3::ZERO, covariance: Covariance6::independent(covariance_rad2, bias) }
}

/// Returns whether a covariance is usable: symmetric enough to have positive leading minors (Sylvester's criterion).
fn usable(fix: &Fix) -> bool {
    let c = &fix.covariance_rad2;
    let second = c.x_axis.x * c.y_axis.y - c.x_axis.y * c.y_axis.x;
    fix.attitude.quat().is_finite() && c.is_finite() && c.x_axis.x > 0.0 && second > 0.0 && c.determinant() > 0.0
}

fn inverse_innovation(estimate: &Estimate, fix: &Fix) -> DMat3 {
    (estimate.covariance.attitude + fix.covariance_rad2).inverse()
}

/// Returns the squared Mahalanobis distance; `None` when the innovation's covariance cannot be inverted in f64.
fn normalised_innovation(estimate: &Estimate, fix: &Fix) -> Option<f64> {
    let innovation = estimate.attitude.rotation_vector_to(&fix.attitude);
    let normalised = innovation.dot(inverse_innovation(estimate, fix) * innovation);
    (normalised.is_finite() && normalised >= 0.0).then_some(normalised)
}

fn corrected(estimate: &Estimate, fix: &Fix) -> Estimate {
    let gain = estimate.covariance.gain(&inverse_innovation(estimate, fix));
    let innovation = estimate.attitude.rotation_vector_to(&fix.attitude);
    Estimate {
        attitude: estimate.attitude.rotated_by(gain.attitude * innovation),
        bias_rad_s: estimate.bias_rad_s + gain.bias * innovation,
        covariance: estimate.covariance.updated(&gain, &fix.covariance_rad2),
    }
}
