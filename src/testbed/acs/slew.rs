//! Rest-to-rest turns about one axis with a smooth acceleration, and chains of them.
//!
//! Input: start and end attitude, limits. Output: attitude, rate and acceleration to follow, at any instant. The
//! eigen-axis is fixed in the body and in inertial space (Euler's theorem; Wie, "Space Vehicle Dynamics and Control",
//! section 7.3). Acceleration: `A (1 - cos(2 pi t / tr)) / 2` over the ramp `tr`, nothing, the same backwards: no
//! steps in acceleration or jerk. With `w = A tr / 2` the rate reached: angle `w (tr + tc)`, duration `2 tr + tc`
//! with coast `tc`. Tests: `slew_tests.rs`.

use base::axes::{Body, Icrf, Rotation};
use core::f64::consts::TAU;
use glam::DVec3;
use histories::AttitudeMotion;

/// Most turns one slew is made of.
pub const MOST_LEGS: usize = 3;

/// Limits of rate and acceleration of a slew.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlewLimits {
    /// Largest rate, rad/s.
    pub largest_rate_rad_s: f64,
    /// Largest acceleration, rad/s^2.
    pub largest_acceleration_rad_s2: f64,
}

/// One turn from rest to rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Leg {
    start: Rotation<Body, Icrf>,
    axis: DVec3,
    angle_rad: f64,
    acceleration_rad_s2: f64,
    ramp_s: f64,
    coast_s: f64,
}

/// One to [`MOST_LEGS`] turns, one after the other.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlewPath {
    legs: [Leg; MOST_LEGS],
    count: usize,
}

impl Leg {
    /// Returns the turn by a rotation vector (rad, body axes; at most pi or, for a turn the long way, 2 pi).
    pub fn turn(start: Rotation<Body, Icrf>, vector_rad: DVec3, limits: &SlewLimits) -> Self {
        let angle_rad = vector_rad.length();
        let (rate, acceleration) = (limits.largest_rate_rad_s, limits.largest_acceleration_rad_s2);
        let short_ramp_s = (2.0 * angle_rad / acceleration).sqrt();
        let ramp_s = short_ramp_s.min(2.0 * rate / acceleration);
        let coast_s = if short_ramp_s > ramp_s { angle_rad / rate - ramp_s } else { 0.0 };
        let axis = vector_rad.normalize_or_zero();
        Self { start, axis, angle_rad, acceleration_rad_s2: acceleration, ramp_s, coast_s }
    }

    /// Returns the shortest turn between two attitudes.
    pub fn between(start: Rotation<Body, Icrf>, end: &Rotation<Body, Icrf>, limits: &SlewLimits) -> Self {
        Self::turn(start, start.rotation_vector_to(end), limits)
    }

    /// Returns the attitude at the beginning.
    pub fn start(&self) -> Rotation<Body, Icrf> {
        self.start
    }

    /// Returns the attitude at the end.
    pub fn end(&self) -> Rotation<Body, Icrf> {
        self.start.rotated_by(self.axis * self.angle_rad)
    }

    /// Returns the axis of the turn, body axes; zero when the slew does not turn.
    pub fn axis_body(&self) -> DVec3 {
        self.axis
    }

    /// Returns the angle of the turn, rad.
    pub fn angle_rad(&self) -> f64 {
        self.angle_rad
    }

    /// Returns the time from rest to rest, s: `2 sqrt(2 angle / A)` for a small turn, `angle / w + 2 w / A` for a large
    /// one.
    pub fn duration_s(&self) -> f64 {
        2.0 * self.ramp_s + self.coast_s
    }

    /// Returns the target `t_s` after the start; at rest before and after the slew.
    pub fn reference(&self, t_s: f64) -> AttitudeMotion {
        let left_s = self.duration_s() - t_s;
        if t_s <= 0.0 || self.angle_rad == 0.0 {
            return AttitudeMotion::at_rest(self.start);
        }
        if left_s <= 0.0 {
            return AttitudeMotion::at_rest(self.end());
        }
        let [angle, rate, acceleration] = if t_s < self.ramp_s {
            self.ramp(t_s)
        } else if left_s < self.ramp_s {
            let [angle, rate, acceleration] = self.ramp(left_s);
            [self.angle_rad - angle, rate, -acceleration]
        } else {
            let rate = self.acceleration_rad_s2 * self.ramp_s / 2.0;
            [rate * (t_s - self.ramp_s / 2.0), rate, 0.0]
        };
        AttitudeMotion {
            body_from_icrf: self.start.rotated_by(self.axis * angle),
            rate_rad_s: self.axis * rate,
            acceleration_rad_s2: self.axis * acceleration,
        }
    }

    /// Returns angle, rate and acceleration `t_s` into the rising ramp.
    fn ramp(&self, t_s: f64) -> [f64; 3] {
        let (k, half) = (TAU / self.ramp_s, self.acceleration_rad_s2 / 2.0);
        let (sin, cos) = (k * t_s).sin_cos();
        [half * (t_s * t_s / 2.0 + (cos - 1.0) / (k * k)), half * (t_s - sin / k), half * (1.0 - cos)]
    }
}

impl SlewPath {
    /// Makes a path of one to [`MOST_LEGS`] legs; `None` when there are none or too many.
    pub fn new(legs: &[Leg]) -> Option<Self> {
        let first = *legs.first()?;
        let mut kept = [first; MOST_LEGS];
        kept.get_mut(..legs.len())?.copy_from_slice(legs);
        Some(Self { legs: kept, count: legs.len() })
    }

    /// Returns one turn.
    pub fn single(leg: Leg) -> Self {
        Self { legs: [leg; MOST_LEGS], count: 1 }
    }

    /// Returns the turns.
    pub fn legs(&self) -> &[Leg] {
        &self.legs[..self.count]
    }

    /// Returns the time of all turns, s.
    pub fn duration_s(&self) -> f64 {
        self.legs().iter().map(Leg::duration_s).sum()
    }

    /// Returns the attitude at the end.
    pub fn end(&self) -> Rotation<Body, Icrf> {
        self.legs[self.count - 1].end()
    }

    /// Returns the target `t_s` after the start; at rest before and after the slew.
    pub fn reference(&self, t_s: f64) -> AttitudeMotion {
        let mut left_s = t_s;
        for leg in &self.legs()[..self.count - 1] {
            if left_s < leg.duration_s() {
                return leg.reference(left_s);
            }
            left_s -= leg.duration_s();
        }
        self.legs[self.count - 1].reference(left_s)
    }
}
