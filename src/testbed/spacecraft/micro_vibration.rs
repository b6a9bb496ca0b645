//! Wheel speeds -> the small rotation of the body that the smooth motion leaves out, sampled every millisecond.
//!
//! Each harmonic `h` of a wheel at speed `W` is a torque `U W^2` turning at `n = h W` in the plane across the spin
//! axis. The response is linear: the rigid part `-J^-1 T / n^2` (its amplitude `U / h^2` does not depend on the speed),
//! and free modes as damped oscillators (`free_modes.rs`). While speeds are constant an oscillator is its steady
//! response to every harmonic plus a free decay, both exact; when speeds change, the decay takes up the difference. So
//! a wheel that runs through a resonance shows the true transient, and no sampling period is too long for a frequency.
//!
//! Output: rotation vector, rad, body axes, to be added with `Rotation::rotated_by`. Limits: small angles; the torque's
//! own derivative by the spin-up is left out (slow against `n`); speeds between calls enter as their mean.
//!
//! `tests/micro_vibration.rs`: frequency response against elimination by hand, transient against a Runge-Kutta
//! integration, the sweep's amplification, sampling-independence.

use super::check::{STEP_SMALLEST, check, within};
use super::vibration_lines::{Line, Oscillator, lines};
use super::{KEPT, entries_kept};
use super::{free_modes::free_modes, history::History, params::SpacecraftParams};
use base::refused::Refused;
use base::time::{Span, Tai};
use core::f64::consts::TAU;
use glam::DVec3;

/// Longest sampling period: ten samples are kept.
const PERIOD_LARGEST: Span = Span::from_ns(KEPT.ns() / 10);
/// Points of the interpolation between samples: a cubic.
const INTERPOLATION_POINTS: u64 = 4;

/// Micro-vibration of one spacecraft.
#[derive(Debug)]
pub struct MicroVibration {
    start: Tai,
    period: Span,
    wheels: Vec<Wheel>,
    pub(super) lines: Vec<Line>,
    oscillators: Vec<Oscillator>,
    samples: History<DVec3>,
}

#[derive(Debug)]
struct Wheel {
    /// Speed as last reported, rad/s.
    reported_rad_s: f64,
    /// Mean of the last two, rad/s: what the lines run at.
    speed_rad_s: f64,
}

impl MicroVibration {
    /// Simulates the spacecraft `params` from `start` on, sampled every `period`; wheels at their initial speeds for
    /// long. `seed` draws the phases.
    ///
    /// # Errors
    /// When the parameters are not physical, a mode has no damping (or is overdamped once free), or the period will not
    /// do.
    pub fn new(params: &SpacecraftParams, start: Tai, period: Span, seed: u64) -> Result<Self, Refused> {
        check(params)?;
        if period < STEP_SMALLEST || period > PERIOD_LARGEST {
            return Err(Refused(format!(
                "micro-vibration period: {} s, wanted at least {} s and at most {} s",
                period.s(),
                STEP_SMALLEST.s(),
                PERIOD_LARGEST.s()
            )));
        }
        let modes = free_modes(params);
        for (index, mode) in modes.iter().enumerate() {
            let is_oscillating = mode.damping > 0.0 && mode.damping < 1.0;
            let wanted = "more than 0 and below 1";
            within("free mode", index, "damping", mode.damping, wanted, is_oscillating)?;
        }
        let wheel = |speed| Wheel { reported_rad_s: speed, speed_rad_s: speed };
        let mut new = Self {
            start,
            period,
            wheels: params.wheels.iter().map(|params| wheel(params.initial_speed_rad_s)).collect(),
            lines: lines(params, seed),
            oscillators: modes.into_iter().map(|mode| Oscillator::new(mode, period.s())).collect(),
            samples: History::new(entries_kept(period)),
        };
        new.respond();
        new.samples.push(new.rotation());
        Ok(new)
    }

    /// Takes all samples up to `at`, when the wheels have these speeds (rad/s; those not given keep theirs). From the
    /// last call to this one the speeds are taken at their mean, so the phase is their integral by the trapezoid rule.
    pub fn advance_to(&mut self, at: Tai, wheel_speeds_rad_s: &[f64]) {
        if self.time() + self.period > at {
            return;
        }
        for (wheel, reported) in self.wheels.iter_mut().zip(wheel_speeds_rad_s) {
            wheel.speed_rad_s = 0.5 * (wheel.reported_rad_s + reported);
            wheel.reported_rad_s = *reported;
        }
        self.take_up(1.0);
        self.respond();
        self.take_up(-1.0);
        while self.time() + self.period <= at {
            self.advance_one_sample();
        }
    }

    /// Returns when the last sample was taken.
    pub fn time(&self) -> Tai {
        self.instant(self.samples.next() - 1)
    }

    /// Returns the rotation vector, rad, body axes, at `at`: the sample of that instant, or a cubic through the four
    /// about it. The cubic errs by 0.4 % of a line at a tenth of the sampling frequency, and by the fourth power below.
    ///
    /// # Errors
    /// When `at` is not kept: about two seconds are.
    pub fn sample(&self, at: Tai) -> Result<DVec3, Refused> {
        let (oldest, next) = (self.samples.oldest(), self.samples.next());
        let outside = Refused(format!(
            "no truth kept for {at}: kept are {first} to {last}",
            first = self.instant(oldest),
            last = self.time()
        ));
        if at < self.instant(oldest) || at > self.time() {
            return Err(outside);
        }
        let since_ns = (at - self.start).ns();
        let number = since_ns.div_euclid(self.period.ns()).unsigned_abs();
        if self.instant(number) == at {
            return self.samples.get(number).copied().ok_or(outside);
        }
        let count = INTERPOLATION_POINTS.min(next - oldest);
        let first = number.saturating_sub(1).clamp(oldest, next - count);
        let place = (at - self.instant(first)).s() / self.period.s();
        let mut sum = DVec3::ZERO;
        for point in 0..count {
            let sample = self.samples.get(first + point).ok_or(outside.clone())?;
            sum += *sample * lagrange(point, count, place);
        }
        Ok(sum)
    }

    /// Frequencies of the modes of the body floating free, Hz: where a wheel's harmonic resonates.
    pub fn free_frequencies_hz(&self) -> impl Iterator<Item = f64> {
        self.oscillators.iter().map(|oscillator| oscillator.mode.frequency_rad_s / TAU)
    }

    #[allow(clippy::cast_possible_wrap, reason = "2^63 samples are not lived to see")]
    fn instant(&self, number: u64) -> Tai {
        self.start + Span::from_ns((number as i64).saturating_mul(self.period.ns()))
    }

    fn advance_one_sample(&mut self) {
        for line in &mut self.lines {
            line.advance();
        }
        for oscillator in &mut self.oscillators {
            oscillator.advance();
        }
        self.samples.push(self.rotation());
    }

    fn rotation(&self) -> DVec3 {
        let steady: DVec3 = self.lines.iter().map(Line::rotation).sum();
        let decay: DVec3 = self.oscillators.iter().map(Oscillator::rotation).sum();
        steady + decay
    }

    /// Adds `sign` times the present steady responses to the decays.
    fn take_up(&mut self, sign: f64) {
        for line in &self.lines {
            for (m, oscillator) in self.oscillators.iter_mut().enumerate() {
                oscillator.decay += line.modal_motion(m) * sign;
            }
        }
    }

    /// Computes the steady responses at the present speeds.
    fn respond(&mut self) {
        for line in &mut self.lines {
            line.respond(self.wheels[line.wheel].speed_rad_s, self.period.s(), &self.oscillators);
        }
    }
}

/// Returns the weight of `point` of `count` points at 0, 1, 2, ... for the value at `place`.
fn lagrange(point: u64, count: u64, place: f64) -> f64 {
    let others = (0..count).filter(|other| *other != point);
    others.map(|other| (place - other as f64) / (point as f64 - other as f64)).product()
}
