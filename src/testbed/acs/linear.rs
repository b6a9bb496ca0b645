//! The pointing loop on paper: one axis, transfer functions.
//!
//! `L(s) = (wn^2 + 2 zeta wn s + wn^2 / (Ti s)) F(s) exp(-s T) H(s) / (r s^2)`, with the structural filter `F`, the
//! delay `T`, the hold `H = (1 - exp(-s Tc)) / (s Tc)` of the control period and the ratio `r` of the true inertia to
//! the assumed one (the inertia itself cancels against the gains). Sources: Franklin, Powell and Workman, "Digital
//! Control of Dynamic Systems"; Markley and Crassidis (2014), chapter 7.
//!
//! Assumptions: small angles, no saturation, attitude and rate equally late, no aliasing (frequencies well below half
//! the control frequency). Tests: `linear_tests.rs`, against a simulated double integrator with held, late torque.

use super::{filter::Complex, filter::StructuralFilter, laws::Gains};
use base::bisection::bisected;
use core::f64::consts::TAU;

/// Frequencies searched for the crossover, in units of the natural frequency, and steps per factor of ten.
const SEARCH: (f64, f64, u32) = (1e-3, 1e3, 100);
/// Halvings of the bracket of the crossover: to f64's end.
const HALVINGS: u32 = 60;

/// One axis of the pointing loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointingLoop {
    /// Gains.
    pub gains: Gains,
    /// Delay from the instant for which attitude and rate hold to the torque, s; without the hold's own half period.
    pub delay_s: f64,
    /// Control period, s: the torque is held for so long. Zero: continuous (then no filter).
    pub control_period_s: f64,
    /// Structural filter.
    pub filter: StructuralFilter,
    /// True inertia over the inertia the gains were made with.
    pub inertia_ratio: f64,
}

impl PointingLoop {
    /// Returns a loop without delay, hold and filter: the textbook's.
    pub fn ideal(gains: Gains) -> Self {
        Self { gains, delay_s: 0.0, control_period_s: 0.0, filter: StructuralFilter::None, inertia_ratio: 1.0 }
    }

    /// Returns the gain from angle to acceleration, without the rate's part: `wn^2 + wn^2 / (Ti s)`.
    pub fn angle_gain(&self, w_rad_s: f64) -> Complex {
        let stiffness = self.gains.natural_rad_s().powi(2);
        let integral = self.gains.integral_s.map_or(0.0, |ti| stiffness / (ti * w_rad_s));
        Complex { re: stiffness, im: -integral }
    }

    /// Returns the gain from rate to acceleration: `2 zeta wn`, 1/s.
    pub fn rate_gain(&self) -> f64 {
        2.0 * self.gains.damping * self.gains.natural_rad_s()
    }

    /// Returns the response from wanted acceleration to angle: filter, delay, hold and body, `F exp(-s T) H / (r s^2)`.
    pub fn plant(&self, w_rad_s: f64) -> Complex {
        let half = w_rad_s * self.control_period_s / 2.0;
        let held = if half == 0.0 { 1.0 } else { half.sin() / half };
        let late = Complex::unit(-w_rad_s * self.delay_s - half) * held;
        self.filtered(w_rad_s) * late * (-1.0 / (self.inertia_ratio * w_rad_s * w_rad_s))
    }

    /// Returns the open loop `L(i w)`.
    pub fn open_loop(&self, w_rad_s: f64) -> Complex {
        (self.angle_gain(w_rad_s) + Complex::imaginary(self.rate_gain() * w_rad_s)) * self.plant(w_rad_s)
    }

    /// Returns `S = 1 / (1 + L)`: the response to a disturbing angle.
    pub fn sensitivity(&self, w_rad_s: f64) -> Complex {
        Complex::ONE / (Complex::ONE + self.open_loop(w_rad_s))
    }

    /// Returns `T = L / (1 + L)`: the response to a moving target, or to an error of the measured angle with its rate.
    #[cfg(test)]
    pub fn complementary(&self, w_rad_s: f64) -> Complex {
        let open = self.open_loop(w_rad_s);
        open / (Complex::ONE + open)
    }

    /// Returns the angle per disturbing torque over inertia, `1 / (r s^2 (1 + L))`, s^2: jitter rejection of the loop.
    pub fn compliance(&self, w_rad_s: f64) -> Complex {
        self.sensitivity(w_rad_s) * (-1.0 / (self.inertia_ratio * w_rad_s * w_rad_s))
    }

    /// Returns the highest frequency at which `|L| = 1`, rad/s. `None` when there is none within a factor of 1000 of
    /// the natural frequency (or below half the control frequency).
    pub fn gain_crossover_rad_s(&self) -> Option<f64> {
        let wn = self.gains.natural_rad_s();
        let nyquist = if self.control_period_s > 0.0 { TAU / (2.0 * self.control_period_s) } else { f64::INFINITY };
        let (first, last, steps) = SEARCH;
        let excess = |w: f64| self.open_loop(w).modulus() - 1.0;
        let factor = 10_f64.powf(-1.0 / f64::from(steps));
        let mut above = (wn * last).min(nyquist);
        if excess(above) > 0.0 {
            return None;
        }
        while above > wn * first {
            let below = above * factor;
            if excess(below) > 0.0 {
                return Some(bisected([below, above], HALVINGS, |w_rad_s| excess(w_rad_s) > 0.0));
            }
            above = below;
        }
        None
    }

    /// Returns the phase margin at the gain crossover, rad; negative when the loop is unstable. The double integrator's
    /// -180 degrees are exact, delay and hold are straight lines, so nothing wraps.
    pub fn phase_margin_rad(&self) -> Option<f64> {
        let w = self.gain_crossover_rad_s()?;
        let lead = (self.angle_gain(w) + Complex::imaginary(self.rate_gain() * w)).argument_rad();
        Some(lead + self.filtered(w).argument_rad() - w * (self.delay_s + self.control_period_s / 2.0))
    }

    /// Returns the delay beyond the present one at which the loop becomes unstable, s: phase margin over crossover
    /// frequency.
    pub fn delay_margin_s(&self) -> Option<f64> {
        Some(self.phase_margin_rad()? / self.gain_crossover_rad_s()?)
    }

    fn filtered(&self, w_rad_s: f64) -> Complex {
        let section = if self.control_period_s > 0.0 { self.filter.section(self.control_period_s) } else { None };
        section.map_or(Complex::ONE, |section| section.response(w_rad_s / TAU))
    }
}
