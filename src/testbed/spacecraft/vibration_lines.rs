//! One harmonic of one wheel and its steady response; one free mode and its decay.
//!
//! A torque `U W^2 (e1 cos phi + e2 sin phi)` turning at `n` gives, with `F = -U W^2 (g . e1 - i g . e2)`,
//! ```text
//! p = Re(P e^(i phi))     P = F / (o^2 - n^2 + 2 i z o n)     theta = -U / h^2 J^-1 (e1 cos phi + e2 sin phi) - sum g p
//! ```

use super::free_modes::{FreeMode, free_inertia};
use super::params::{MODES_MAX, SpacecraftParams};
use core::f64::consts::TAU;
use glam::{DVec2, DVec3};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

/// One harmonic of one wheel.
#[derive(Debug)]
pub(super) struct Line {
    /// Index of the wheel.
    pub(super) wheel: usize,
    multiple: f64,
    torque_n_m_s2: f64,
    /// Two axes across the spin axis; the torque turns from the first to the second.
    across: [DVec3; 2],
    /// Rigid response to the cosine and to the sine, rad.
    rigid: [DVec3; 2],
    /// Cosine and sine of the torque's phase.
    phase: DVec2,
    /// Turn of the phase in one sample, as cosine and sine.
    turn: DVec2,
    frequency_rad_s: f64,
    /// Whole steady response of the body to the cosine and to the sine, rad.
    response: [DVec3; 2],
    /// `P` of every mode: real and imaginary part.
    modal: [DVec2; MODES_MAX],
}

/// One free mode and the transient part of its motion.
#[derive(Debug)]
pub(super) struct Oscillator {
    pub(super) mode: FreeMode,
    /// Modal coordinate and its rate, of the free decay.
    pub(super) decay: DVec2,
    /// Exact transition of the decay over one sample: rows.
    transition: [DVec2; 2],
}

/// Returns all harmonics of all wheels, phases drawn from `seed`.
pub(super) fn lines(params: &SpacecraftParams, seed: u64) -> Vec<Line> {
    let mut generator = StdRng::seed_from_u64(seed);
    let inverse = free_inertia(params).inverse();
    let mut lines = Vec::new();
    for (wheel, wheel_params) in params.wheels.iter().enumerate() {
        let axis = wheel_params.axis_body.normalize_or_zero();
        let first = axis.any_orthonormal_vector();
        let across = [first, axis.cross(first)];
        for harmonic in &wheel_params.imbalance {
            let turns: f64 = generator.random();
            let static_rad = harmonic.torque_n_m_s2 / (harmonic.multiple * harmonic.multiple);
            lines.push(Line {
                wheel,
                multiple: harmonic.multiple,
                torque_n_m_s2: harmonic.torque_n_m_s2,
                across,
                rigid: across.map(|e| inverse * e * -static_rad),
                phase: DVec2::from_angle(TAU * turns),
                turn: DVec2::X,
                frequency_rad_s: 0.0,
                response: [DVec3::ZERO; 2],
                modal: [DVec2::ZERO; MODES_MAX],
            });
        }
    }
    lines
}

impl Line {
    /// Computes the steady response at a wheel speed.
    pub(super) fn respond(&mut self, speed_rad_s: f64, period_s: f64, oscillators: &[Oscillator]) {
        self.frequency_rad_s = self.multiple * speed_rad_s;
        self.turn = DVec2::from_angle(self.frequency_rad_s * period_s);
        // Thousands of turns have left the length a few ulp off; one step of Newton's method.
        self.phase *= 1.5 - 0.5 * self.phase.length_squared();
        self.response = self.rigid;
        let torque_n_m = self.torque_n_m_s2 * speed_rad_s * speed_rad_s;
        for (modal, oscillator) in self.modal.iter_mut().zip(oscillators) {
            let mode = &oscillator.mode;
            let force = DVec2::new(-mode.shape.dot(self.across[0]), mode.shape.dot(self.across[1])) * torque_n_m;
            let (o, n) = (mode.frequency_rad_s, self.frequency_rad_s);
            let impedance = DVec2::new((o - n) * (o + n), 2.0 * mode.damping * o * n);
            // A complex quotient: times the conjugate, over the square.
            *modal = DVec2::new(impedance.x, -impedance.y).rotate(force) / impedance.length_squared();
            self.response[0] -= mode.shape * modal.x;
            self.response[1] += mode.shape * modal.y;
        }
    }

    pub(super) fn advance(&mut self) {
        self.phase = self.turn.rotate(self.phase);
    }

    /// Returns the steady rotation of the body, rad.
    pub(super) fn rotation(&self) -> DVec3 {
        self.response[0] * self.phase.x + self.response[1] * self.phase.y
    }

    /// Returns the unit vector of the torque now: for the oracle of the tests.
    #[cfg(test)]
    pub(super) fn torque_direction(&self) -> DVec3 {
        self.across[0] * self.phase.x + self.across[1] * self.phase.y
    }

    /// Returns the steady motion of mode `m`: coordinate and rate.
    pub(super) fn modal_motion(&self, m: usize) -> DVec2 {
        let now = self.phase.rotate(self.modal[m]);
        DVec2::new(now.x, -self.frequency_rad_s * now.y)
    }
}

impl Oscillator {
    /// Makes an oscillator at rest; the transition is the closed form of an underdamped oscillator.
    pub(super) fn new(mode: FreeMode, period_s: f64) -> Self {
        let decay_rad_s = mode.damping * mode.frequency_rad_s;
        let damped_rad_s = mode.frequency_rad_s * (1.0 - mode.damping * mode.damping).sqrt();
        let (sin, cos) = (damped_rad_s * period_s).sin_cos();
        let (left, share) = ((-decay_rad_s * period_s).exp(), decay_rad_s / damped_rad_s);
        let transition = [
            DVec2::new(cos + share * sin, sin / damped_rad_s) * left,
            DVec2::new(-mode.frequency_rad_s * mode.frequency_rad_s * sin / damped_rad_s, cos - share * sin) * left,
        ];
        Self { mode, decay: DVec2::ZERO, transition }
    }

    pub(super) fn advance(&mut self) {
        let [first, second] = self.transition;
        self.decay = DVec2::new(first.dot(self.decay), second.dot(self.decay));
    }

    /// Returns the rotation of the body by the decay, rad.
    pub(super) fn rotation(&self) -> DVec3 {
        self.mode.shape * -self.decay.x
    }
}
