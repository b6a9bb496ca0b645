//! A sine torque from outside, by which a control loop is tested: time -> torque on the body, N m, body axes.
//!
//! `T(t) = r(t) a sin(2 pi f (t - t0))` from `t0` on, with `r` half a cosine from 0 to 1 over the ramp, so that slowly
//! decaying modes of the loop are hardly excited. As base jitter of amplitude `A` it is `a = J A w^2`: what a body left
//! alone would turn by `A`. Test: `tests/closed_forms.rs`.

use super::check::within;
use base::refused::Refused;
use core::f64::consts::{PI, TAU};
use glam::DVec3;

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
