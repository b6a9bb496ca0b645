//! Wheel motors: body torque demanded -> motor torques within their limits.
//!
//! Distribution by the pseudo-inverse of the healthy wheels' axes (Markley and Crassidis (2014), section 7.3.4:
//! smallest sum of squares). With fewer than three independent axes it is damped, so that what cannot be done is left
//! out. Limits are applied wheel by wheel, as in the hardware: a clipped wheel turns the direction of the torque, and
//! the caller gets back the torque that was possible. `tests/wheels.rs` tests limits and failures.
//!
//! A control loop is tested by a sine torque from outside ([`TestTorque`]), N m, body axes: `T(t) = r(t) a sin(2 pi f (t - t0))` from `t0` on, with `r` half a cosine from 0 to 1 over the ramp, so that slowly
//! decaying modes of the loop are hardly excited. As base jitter of amplitude `A` it is `a = J A w^2`: what a body left
//! alone would turn by `A`. Test: `tests/closed_forms.rs`.

use crate::spacecraft::check::within;
use crate::spacecraft::equations::{Equations, State, outer};
use crate::spacecraft::params::{SpacecraftParams, WHEELS_MAX};
use base::refused::Refused;
use core::f64::consts::{PI, TAU};
use glam::{DMat3, DVec3};

/// Determinant of `A A'` (unit axes) below which three independent axes are not there.
const DEGENERATE: f64 = 1e-6;
/// Damping of the pseudo-inverse then: torque along good axes is wrong by this share.
const DAMPING: f64 = 1e-8;

/// Motors and what is asked of them.
#[derive(Debug, Clone)]
pub(super) struct Motors {
    largest_torque: Vec<f64>,
    largest_speed: Vec<f64>,
    healthy: [bool; WHEELS_MAX],
    /// Rows of the pseudo-inverse: motor torque per body torque.
    distribution: [DVec3; WHEELS_MAX],
    /// Motor torques demanded, before limits, N m.
    demand: [f64; WHEELS_MAX],
}

impl Motors {
    pub(super) fn new(params: &SpacecraftParams, equations: &Equations) -> Self {
        let mut motors = Self {
            largest_torque: params.wheels.iter().map(|wheel| wheel.largest_torque_n_m).collect(),
            largest_speed: params.wheels.iter().map(|wheel| wheel.largest_speed_rad_s).collect(),
            healthy: [true; WHEELS_MAX],
            distribution: [DVec3::ZERO; WHEELS_MAX],
            demand: [0.0; WHEELS_MAX],
        };
        motors.distribute(equations);
        motors
    }

    /// Demands a torque on the body (body axes, N m): each rotor is driven the other way.
    pub(super) fn demand(&mut self, torque_body_n_m: DVec3) {
        for i in 0..WHEELS_MAX {
            self.demand[i] = -self.distribution[i].dot(torque_body_n_m);
        }
    }

    /// Demands a torque on each rotor about its axis, N m.
    pub(super) fn demand_of_each(&mut self, torques_n_m: &[f64; WHEELS_MAX]) {
        self.demand = *torques_n_m;
    }

    /// Lets the wheel coast from now on; the others share the next demand.
    pub(super) fn fail(&mut self, wheel: usize, equations: &Equations) {
        self.healthy[wheel] = false;
        self.demand[wheel] = 0.0;
        self.distribute(equations);
    }

    /// Returns the motor torques that are possible during the next `h_s`.
    pub(super) fn torques(&self, equations: &Equations, state: &State, h_s: f64) -> [f64; WHEELS_MAX] {
        let mut torques = [0.0; WHEELS_MAX];
        for (i, rotor) in equations.rotors.iter().enumerate() {
            if !self.healthy[i] {
                continue;
            }
            let (largest, speed) = (self.largest_torque[i], state.speeds[i]);
            // Torque that brings the rotor to its largest speed within the step, friction included.
            let friction = rotor.friction_n_m(speed);
            let up = friction + rotor.inertia_kg_m2 * (self.largest_speed[i] - speed) / h_s;
            let down = friction - rotor.inertia_kg_m2 * (self.largest_speed[i] + speed) / h_s;
            torques[i] = self.demand[i].min(up).max(down).clamp(-largest, largest);
        }
        torques
    }

    fn distribute(&mut self, equations: &Equations) {
        let healthy = |i: usize, axis: DVec3| if self.healthy[i] { axis } else { DVec3::ZERO };
        let axes = equations.rotors.iter().enumerate().map(|(i, rotor)| healthy(i, rotor.axis));
        let mut gram = DMat3::ZERO;
        for axis in axes.clone() {
            gram += outer(axis, axis);
        }
        if gram.determinant() < DEGENERATE {
            gram += DMat3::IDENTITY * DAMPING;
        }
        let inverse = gram.inverse();
        let mut distribution = [DVec3::ZERO; WHEELS_MAX];
        for (row, axis) in distribution.iter_mut().zip(axes) {
            *row = inverse * axis;
        }
        self.distribution = distribution;
    }
}

/// One sine.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TestTorque {
    /// Amplitude, body axes, N m.
    pub amplitude_n_m: DVec3,
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// When it begins, s after the spacecraft's start; its phase is zero then.
    pub begins_s: f64,
    /// Time until it has its full amplitude, s.
    pub ramp_s: f64,
}

impl TestTorque {
    /// Returns the torque `t_s` after the start.
    pub fn at_n_m(&self, t_s: f64) -> DVec3 {
        let since_s = t_s - self.begins_s;
        if since_s <= 0.0 {
            return DVec3::ZERO;
        }
        let ramp = if since_s < self.ramp_s { 0.5 - 0.5 * (PI * since_s / self.ramp_s).cos() } else { 1.0 };
        self.amplitude_n_m * (ramp * (TAU * self.frequency_hz * since_s).sin())
    }

    pub(super) fn check(&self, index: usize) -> Result<(), Refused> {
        let (of, wanted) = ("test torque", "finite and not negative");
        for (field, got) in [
            ("length of amplitude_n_m", self.amplitude_n_m.length()),
            ("frequency_hz", self.frequency_hz),
            ("begins_s", self.begins_s),
            ("ramp_s", self.ramp_s),
        ] {
            within(of, index, field, got, wanted, got.is_finite() && got >= 0.0)?;
        }
        Ok(())
    }
}
