//! History + jitter + mounting -> the line of sight of one exposure.
//!
//! *Algorithm.* The attitude is estimated at the start, the middle and the end of the exposure; rate and acceleration
//! are those of the quadratic through the three (exact for constant acceleration; a jerk `j` is missed by at most
//! `j h^3 / (9 sqrt 3)`, `h` half the exposure, instead of `j h^3 / 6`). The remaining error is added to the track as
//! knots (see `residual.rs`). The mounting rotates all of it into sensor axes.

use crate::attitude::estimate::{Decision, EstimateLimits, EstimatedAttitude, decide, state_at};
use crate::attitude::jitter::{JitterCoverage, JitterHistory};
use crate::attitude::los::{self, LosPath};
use crate::attitude::{error::AttitudeError, history::AttitudeHistory};
use base::axes::{Body, Rotation, Sensor};
use base::time::{Span, Tai};
use glam::DVec3;

/// Exposure time below which the motion is described by its rate only: the quadratic of 1 rad/s^2 turns 0.03 arcsec in
/// half of it, and differences over shorter times lose digits.
const FIT_FROM_S: f64 = 1e-3;

/// Report on how the path was made; frame metadata contain it, and the ledger unusual values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PathReport {
    /// Mid-exposure minus the epoch of the newest sample used.
    pub horizon: Span,
    /// Exposure end minus the epoch of the newest sample used there.
    pub end_horizon: Span,
    /// Time between the samples around mid-exposure (zero when predicted).
    pub gap: Span,
    /// The longer part of the exposure before the oldest or after the newest sample.
    pub outside: Span,
    /// Shortest time between samples used in the exposure; zero when there was only one.
    pub interval: Span,
    /// Largest motion the quadratic missed, rad; above 0.01 arcsec it was added to the track.
    pub residual_rad: f64,
    /// Coverage of the exposure by received jitter.
    pub jitter: JitterCoverage,
}

impl PathReport {
    /// Returns true when two or more samples are missing at one end of the exposure: the motion there is extrapolated,
    /// though its middle may be interpolated. A single missing sample is normal: it is still on its way.
    pub fn is_partly_extrapolated(&self) -> bool {
        self.outside > self.interval + self.interval
    }
}

/// Result for an exposure. The path is filled in every case (truth for the ledger).
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum PathOutcome {
    /// Render the path; its `origin` says whether it was interpolated, predicted or held.
    Show(PathReport),
    /// By policy: render no stars.
    Blank {
        /// Age of the newest sample at mid-exposure.
        age: Span,
    },
    /// By policy: send no frame.
    Drop {
        /// Age of the newest sample at mid-exposure.
        age: Span,
    },
    /// By policy: end the run.
    Stop {
        /// Age of the newest sample at mid-exposure.
        age: Span,
    },
}

/// Fills `path` with the line of sight of the exposure. Does not allocate when `path.jitter` came from
/// [`JitterHistory::new_track`].
///
/// # Errors
/// When the history is empty, mid-exposure is before the history, or the exposure time is invalid; `path` is then
/// unchanged.
pub fn compose(
    history: &AttitudeHistory,
    jitter: &JitterHistory,
    sensor_from_body: Rotation<Sensor, Body>,
    exposure_start: Tai,
    exposure_s: f64,
    limits: &EstimateLimits,
    path: &mut LosPath,
) -> Result<PathOutcome, AttitudeError> {
    if !(exposure_s.is_finite() && exposure_s >= 0.0) {
        return Err(AttitudeError::ExposureTime { exposure_s });
    }
    let motion = Motion { history, limits, exposure_start, exposure_s };
    let middle = state_at(history, motion.mid(), limits)?;
    let [rate_rad_s, acceleration_rad_s2] = motion.quadratic(&middle);

    path.exposure_start = exposure_start;
    path.exposure_s = exposure_s;
    path.mid_sensor_from_icrf = sensor_from_body * middle.state.body_from_icrf;
    path.rate_rad_s = sensor_from_body.apply(rate_rad_s);
    path.acceleration_rad_s2 = sensor_from_body.apply(acceleration_rad_s2);
    path.origin = middle.origin;
    path.horizon = middle.horizon;
    let coverage = jitter.fill(exposure_start, motion.end(), &mut path.jitter);
    let residual_rad = motion.add_residual(&middle, [rate_rad_s, acceleration_rad_s2], sensor_from_body, path);

    let end = state_at(history, motion.end(), limits)?;
    let before = history.oldest().map_or(Span::ZERO, |oldest| oldest.at - exposure_start);
    let gaps = [exposure_start, motion.mid(), motion.end()].map(|at| interval_at(history, at));
    let report = PathReport {
        horizon: middle.horizon,
        end_horizon: end.horizon,
        gap: middle.gap,
        outside: end.horizon.max(before).max(Span::ZERO),
        interval: gaps.into_iter().flatten().min().unwrap_or(Span::ZERO),
        residual_rad,
        jitter: coverage,
    };
    Ok(match decide(&middle, limits.policy) {
        Decision::Show => PathOutcome::Show(report),
        Decision::Blank { age } => PathOutcome::Blank { age },
        Decision::Drop { age } => PathOutcome::Drop { age },
        Decision::Stop { age } => PathOutcome::Stop { age },
    })
}

/// Returns the time between the samples before and after an instant, also when a sample has exactly that instant.
fn interval_at(history: &AttitudeHistory, at: Tai) -> Option<Span> {
    let instants = [at - Span::from_ns(1), at];
    instants.into_iter().find_map(|at| match history.around(at) {
        (Some(earlier), Some(later)) => Some(later.at - earlier.at),
        _ => None,
    })
}

/// The smooth motion of the body over one exposure.
struct Motion<'a> {
    history: &'a AttitudeHistory,
    limits: &'a EstimateLimits,
    exposure_start: Tai,
    exposure_s: f64,
}

impl Motion<'_> {
    fn mid(&self) -> Tai {
        self.exposure_start + Span::from_s(0.5 * self.exposure_s)
    }

    fn end(&self) -> Tai {
        self.exposure_start + Span::from_s(self.exposure_s)
    }

    /// Returns the rotation vector (body axes, rad) from mid-exposure to `at`; before the start of the history, by the
    /// state at mid-exposure.
    fn turned_rad(&self, middle: &EstimatedAttitude, at: Tai) -> DVec3 {
        match state_at(self.history, at, self.limits) {
            Ok(there) => middle.state.body_from_icrf.rotation_vector_to(&there.state.body_from_icrf),
            Err(_before_history) => {
                let t_s = (at - middle.state.at).s();
                middle.state.rate_rad_s * t_s + middle.state.acceleration_rad_s2 * (0.5 * t_s * t_s)
            }
        }
    }

    /// Returns the rate and acceleration (body axes) of the quadratic through start, middle and end.
    fn quadratic(&self, middle: &EstimatedAttitude) -> [DVec3; 2] {
        if self.exposure_s < FIT_FROM_S {
            return [middle.state.rate_rad_s, middle.state.acceleration_rad_s2];
        }
        let [before, after] = [self.exposure_start, self.end()].map(|at| {
            let t_s = (at - middle.state.at).s();
            (t_s, self.turned_rad(middle, at) / t_s)
        });
        let half_acceleration = (after.1 - before.1) / (after.0 - before.0);
        [after.1 - half_acceleration * after.0, half_acceleration * 2.0]
    }

    /// Adds the error of the quadratic to the track, and returns its largest value, rad.
    fn add_residual(
        &self,
        middle: &EstimatedAttitude,
        [rate_rad_s, acceleration_rad_s2]: [DVec3; 2],
        sensor_from_body: Rotation<Sensor, Body>,
        path: &mut LosPath,
    ) -> f64 {
        if self.exposure_s < FIT_FROM_S {
            return 0.0;
        }
        let residual_at = |at: Tai| {
            let t_s = (at - middle.state.at).s();
            let smooth_rad = rate_rad_s * t_s + acceleration_rad_s2 * (0.5 * t_s * t_s);
            sensor_from_body.apply(self.turned_rad(middle, at) - smooth_rad)
        };
        let largest_rad = los::largest_rad(self.exposure_start, self.end(), residual_at);
        if largest_rad > los::RESIDUAL_TOLERANCE_RAD {
            los::add_knots(&mut path.jitter, self.exposure_start, self.end(), largest_rad, residual_at);
        }
        largest_rad
    }
}

#[cfg(test)]
#[path = "exposure_path_tests.rs"]
mod tests;
