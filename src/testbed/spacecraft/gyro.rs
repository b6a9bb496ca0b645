//! Attitude before and after -> what a rate-integrating gyro triad says about the turn between.
//!
//! Errors after Farrenkopf, "Analytic steady-state accuracy solutions for two common spacecraft attitude estimators",
//! J. Guidance and Control 1 (1978), in the discrete form of Crassidis and Junkins, "Optimal Estimation of Dynamic
//! Systems" (gyro simulation), exact in distribution at every interval:
//! ```text
//! b' = b + s_u sqrt(dt) n1      rate = M w + (b + b') / 2 + sqrt(s_v^2 / dt + s_u^2 dt / 12) n2
//! ```
//! `M` holds scale factors and misalignment; `w` is the rotation vector of the turn over `dt` (coning inside `dt`, of
//! second order in the change of axis, is not seen). Angles are quantised with the remainder carried over. The same
//! number of draws is taken at every measurement, so a fault does not change the noise that follows it.
//!
//! `tests/gyro.rs`: Allan variance slopes with bounds, scale, quantisation, limits, faults.

use super::check::within;
use crate::noise::Gaussian;
use base::axes::{Body, Icrf, Rotation};
use base::{refused::Refused, time::Span};
use glam::{DMat3, DVec3};

/// Errors of a gyro triad. `Default`: none, and no limit set, which [`Gyro::new`] refuses.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GyroParams {
    /// Angle random walk `s_v`, rad / sqrt(s).
    pub angle_random_walk_rad_sqrt_s: f64,
    /// Rate random walk `s_u`, rad / s^1.5: the drift of the bias.
    pub rate_random_walk_rad_s_sqrt_s: f64,
    /// Bias at the start, gyro axes, rad/s.
    pub initial_bias_rad_s: DVec3,
    /// Error of the scale factors, per axis: 1e-4 reads 100 ppm too much.
    pub scale_factor_error: DVec3,
    /// Turn of the gyro's axes away from the body's, rotation vector, rad.
    pub misalignment_rad: DVec3,
    /// Angle of one count, rad; 0 for none.
    pub quantum_rad: f64,
    /// Largest rate per axis, rad/s: beyond it the reading is clipped and not valid.
    pub largest_rate_rad_s: f64,
}

/// One measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GyroReading {
    /// Mean rate over the interval, gyro axes (nominally the body's), rad/s.
    pub rate_rad_s: DVec3,
    /// The unit says that it can be used.
    pub valid: bool,
}

/// Faults of a gyro.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum GyroFault {
    /// The last reading is repeated, valid, until cleared.
    Stuck,
    /// No reading, until cleared.
    Dropout,
    /// The bias jumps by this much (rad/s), at once and for good.
    BiasJump(DVec3),
    /// The next reading is wrong by this much (rad/s).
    Spike(DVec3),
}

/// A gyro triad.
#[derive(Debug)]
pub struct Gyro {
    params: GyroParams,
    /// `M`: body rate to gyro axes, scaled.
    sensitivity: DMat3,
    bias_rad_s: DVec3,
    /// Angle not yet counted, rad.
    remainder_rad: DVec3,
    noise: Gaussian,
    last: GyroReading,
    is_stuck: bool,
    is_silent: bool,
    spike_rad_s: DVec3,
}

impl Gyro {
    /// Returns a triad with its bias at the initial value.
    ///
    /// # Errors
    /// When a parameter is negative or not finite, or the largest rate is zero.
    pub fn new(params: &GyroParams, seed: u64) -> Result<Self, Refused> {
        check(params)?;
        let aligned = Rotation::<Body, Body>::from_rotation_vector(params.misalignment_rad).matrix();
        Ok(Self {
            params: *params,
            sensitivity: DMat3::from_diagonal(DVec3::ONE + params.scale_factor_error) * aligned,
            bias_rad_s: params.initial_bias_rad_s,
            remainder_rad: DVec3::ZERO,
            noise: Gaussian::new(seed),
            last: GyroReading { rate_rad_s: DVec3::ZERO, valid: false },
            is_stuck: false,
            is_silent: false,
            spike_rad_s: DVec3::ZERO,
        })
    }

    /// Returns the turn from `previous` to `now`, `dt` apart and less than half a turn. An interval that is not
    /// positive gives no valid reading and changes nothing.
    pub fn measure(&mut self, previous: &Rotation<Body, Icrf>, now: &Rotation<Body, Icrf>, dt: Span) -> GyroReading {
        let dt_s = dt.s();
        if dt_s <= 0.0 {
            return GyroReading { rate_rad_s: DVec3::ZERO, valid: false };
        }
        let true_rate = previous.rotation_vector_to(now) / dt_s;
        let sensed = self.sensitivity * true_rate + self.drift(dt_s) + core::mem::take(&mut self.spike_rad_s);
        let largest = DVec3::splat(self.params.largest_rate_rad_s);
        let clipped = sensed.clamp(-largest, largest);
        let reading = GyroReading { rate_rad_s: self.count(clipped * dt_s) / dt_s, valid: clipped == sensed };
        if self.is_silent {
            return GyroReading { rate_rad_s: DVec3::ZERO, valid: false };
        }
        if !self.is_stuck {
            self.last = reading;
        }
        self.last
    }

    /// Makes something go wrong from the next measurement on.
    pub fn inject(&mut self, fault: GyroFault) {
        match fault {
            GyroFault::Stuck => self.is_stuck = true,
            GyroFault::Dropout => self.is_silent = true,
            GyroFault::BiasJump(jump_rad_s) => self.bias_rad_s += jump_rad_s,
            GyroFault::Spike(spike_rad_s) => self.spike_rad_s = spike_rad_s,
        }
    }

    /// Ends `Stuck` and `Dropout`, and takes back a spike not yet read. A jump of the bias stays.
    pub fn clear_faults(&mut self) {
        (self.is_stuck, self.is_silent, self.spike_rad_s) = (false, false, DVec3::ZERO);
    }

    /// Returns the true bias, gyro axes, rad/s: for tests and truth tables.
    pub fn bias_rad_s(&self) -> DVec3 {
        self.bias_rad_s
    }

    /// Returns the mean bias and noise over `dt_s`, rad/s; the bias walks on.
    fn drift(&mut self, dt_s: f64) -> DVec3 {
        let (angle_walk, rate_walk) =
            (self.params.angle_random_walk_rad_sqrt_s, self.params.rate_random_walk_rad_s_sqrt_s);
        let walked = self.noise.vector(rate_walk * dt_s.sqrt());
        let white = self.noise.vector((angle_walk * angle_walk / dt_s + rate_walk * rate_walk * dt_s / 12.0).sqrt());
        let mean = self.bias_rad_s + 0.5 * walked;
        self.bias_rad_s += walked;
        mean + white
    }

    /// Returns the angle in whole counts; the rest waits for the next interval.
    fn count(&mut self, angle_rad: DVec3) -> DVec3 {
        let quantum_rad = self.params.quantum_rad;
        if quantum_rad == 0.0 {
            return angle_rad;
        }
        let waiting = self.remainder_rad + angle_rad;
        let counted = (waiting / quantum_rad).round() * quantum_rad;
        self.remainder_rad = waiting - counted;
        counted
    }
}

fn check(params: &GyroParams) -> Result<(), Refused> {
    for (field, got) in [
        ("angle_random_walk_rad_sqrt_s", params.angle_random_walk_rad_sqrt_s),
        ("rate_random_walk_rad_s_sqrt_s", params.rate_random_walk_rad_s_sqrt_s),
        ("quantum_rad", params.quantum_rad),
    ] {
        within("gyro", 0, field, got, "0 or more", got >= 0.0)?;
    }
    for (field, vector) in [
        ("length of initial_bias_rad_s", params.initial_bias_rad_s),
        ("length of scale_factor_error", params.scale_factor_error),
        ("length of misalignment_rad", params.misalignment_rad),
    ] {
        within("gyro", 0, field, vector.length(), "finite", true)?;
    }
    let largest = params.largest_rate_rad_s;
    within("gyro", 0, "largest_rate_rad_s", largest, "more than 0", largest > 0.0)
}
