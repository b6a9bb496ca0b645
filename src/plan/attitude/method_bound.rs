//! Error bounds of the attitude methods: [`MotionScale`] and a time -> rad.
//!
//! *Prediction.* The angle between two attitudes grows no faster than their body rates differ, and the angle between
//! products is at most the sum of the angles. So each part of a motion is bounded by itself: the smooth part by the
//! first derivative that the method leaves out; a sinusoid by its worst phase, in closed form ([`worst_phase`]: it
//! grows as `x^n / n!` first and much less once a period has passed, `x = w T`); what couples the parts by Leibniz'
//! rule (below), and the commutation of the prediction by [`PredictionErrors`].
//!
//! *Interpolation.* The cubic is that of the rotation vector `phi`. Hermite's remainder is `H^4 / 384` times the fourth
//! derivative, or `H^3 / 96` times the third where only that is bounded (Peano kernel). A sinusoid takes the first, at
//! most twice its amplitude and what its slopes add; all else takes the second. Third derivatives of `phi` follow
//! from those of the rate through Bortz's equation, by majorants (its coefficients replaced by their magnitudes), up
//! to a turn of 1 rad between samples.
//!
//! *Magnitudes of a motion*, the input of the bounds. Input: the largest rate, acceleration and jerk of a smooth
//! motion, and sinusoids on top of it, each a turn about an axis fixed in the body. Output: the largest rate,
//! acceleration and jerk of the whole, in body axes.
//!
//! *Coupling.* A sinusoid tilts the axes in which the rest of the motion is written. With `g_n = sum A w^n`, the n-th
//! derivative of that tilt is at most `B_n`: `B_1 = g_1`, `B_2 = g_2 + g_1^2` (complete Bell polynomials, which add
//! over a chain of turns), and Leibniz' rule gives its effect on the rest. *Limits.* Angles need not be small.
//! *Validation.* `tests/physics/attitude_methods.rs`, 600 random motions.

use crate::attitude::{interpolate::hermite_error_bound_rad, predict::PredictionErrors};
use core::f64::consts::TAU;
use glam::DVec3;

/// Phase below which the closed forms lose digits (`cos x - 1 + x^2 / 2` keeps `1e-16 / x^4`) and the leading term of
/// the series, which is never below them, is within 0.1 %.
const SERIES_BELOW_RAD: f64 = 0.1;

/// Returns the largest error of a Taylor polynomial of a sinusoid of amplitude 1, over all phases, `x` radians after
/// the point of expansion or less; `terms` of the polynomial are used (1 to 3).
pub(super) fn worst_phase(terms: u32, x: f64) -> f64 {
    if x < SERIES_BELOW_RAD {
        return [x, x * x / 2.0, x.powi(3) / 6.0][terms as usize - 1];
    }
    let (sin, cos) = x.sin_cos();
    match terms {
        // |sin(p + x) - sin p| is largest at half a period and stays there.
        1 if x >= core::f64::consts::PI => 2.0,
        1 => 2.0 * (0.5 * x).sin(),
        2 => (1.0 - cos).hypot(x - sin),
        _ => (cos - 1.0 + 0.5 * x * x).hypot(x - sin),
    }
}

fn sinusoids_rad(motion: &MotionScale, terms: u32, horizon_s: f64) -> f64 {
    let worst = |x: f64| worst_phase(terms, x);
    motion.sinusoids.iter().map(|s| s.amplitude_rad.abs() * worst(s.angular_rad_s() * horizon_s)).sum()
}

/// Returns the bound for holding the last attitude, `t` seconds old, rad.
pub(super) fn hold_rad(motion: &MotionScale, t: f64) -> f64 {
    motion.rate_rad_s * t + sinusoids_rad(motion, 1, t)
}

/// Returns the bound for the last rate, `t` seconds old, rad.
pub(super) fn constant_rate_rad(motion: &MotionScale, t: f64) -> f64 {
    let unused_acceleration_rad_s2 = motion.acceleration_rad_s2 + motion.coupled_acceleration();
    let errors = PredictionErrors { unused_acceleration_rad_s2, ..Default::default() };
    errors.bound_rad(DVec3::ZERO, DVec3::ZERO, t) + sinusoids_rad(motion, 2, t)
}

/// Returns the bound for the last rate and acceleration, `t` seconds old, rad.
pub(super) fn constant_acceleration_rad(motion: &MotionScale, t: f64) -> f64 {
    // A parabola as steep as the sinusoids reaches this rate.
    let tilt_rate = motion.sinusoid_sum(1) + motion.sinusoid_sum(2) * t;
    let smooth_rate = motion.rate_rad_s + motion.acceleration_rad_s2 * t;
    let jerk_rad_s3 = motion.jerk_rad_s3 + motion.coupled_jerk(tilt_rate, smooth_rate);
    let errors = PredictionErrors { jerk_rad_s3, ..Default::default() };
    let body = motion.body_extremes();
    // Rate and acceleration need not be parallel.
    let [rate, acceleration] = [DVec3::X * body.rate, DVec3::Y * body.acceleration];
    let next_term = body.rate * t / 4.0 + body.acceleration * t * t / 10.0;
    let commutation = body.rate * body.acceleration * t.powi(3) / 12.0;
    errors.bound_rad(rate, acceleration, t) + commutation * next_term + sinusoids_rad(motion, 3, t)
}

/// Returns the bound for the cubic between samples `h` seconds apart, with at most 1 rad of turn between them, rad.
pub(super) fn interpolation_rad(motion: &MotionScale, h: f64) -> f64 {
    let sinusoid = |amplitude_rad: f64, w: f64| {
        let uncorrelated_rad = amplitude_rad * (2.0 + w * h / 4.0);
        hermite_error_bound_rad(h, amplitude_rad * w.powi(4)).min(uncorrelated_rad)
    };
    let sinusoids: f64 = motion.sinusoids.iter().map(|s| sinusoid(s.amplitude_rad.abs(), s.angular_rad_s())).sum();
    sinusoids + rotation_vector_jerk(motion, h) * h.powi(3) / 96.0
}

/// Returns the largest third derivative of the rotation vector from the earlier sample, rad/s^3, without the sinusoids'
/// own.
fn rotation_vector_jerk(motion: &MotionScale, h: f64) -> f64 {
    let body = motion.body_extremes();
    // |Bernoulli numbers| / n! give 1 + x / 2 + x^2 / 12 + x^4 / 720 ..; below 1 rad x^2 / 10 covers the rest, and also
    // for the two derivatives.
    let x = body.rate * h;
    let [f, slope, curvature] = [1.0 + x / 2.0 + x * x / 10.0, 0.5 + x / 5.0, 0.2];
    let first = f * body.rate;
    let second = f * body.acceleration + slope * first * body.rate;
    let third = f * body.jerk
        + 2.0 * slope * first * body.acceleration
        + (curvature * first * first + slope * second) * body.rate;
    // The sinusoids' own third derivative was taken with constant axes: they tilt by g_1 h.
    let own = motion.sinusoid_sum(3);
    (third - own).max(0.0) + motion.sinusoid_sum(1) * h * own
}

/// An oscillation about an axis fixed in the body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sinusoid {
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Amplitude, rad.
    pub amplitude_rad: f64,
}

impl Sinusoid {
    /// Returns the angular frequency, rad/s.
    pub fn angular_rad_s(&self) -> f64 {
        TAU * self.frequency_hz.abs()
    }
}

/// The largest magnitudes of a motion over the time of interest; directions may be any.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MotionScale {
    /// Rate of the smooth motion, rad/s.
    pub rate_rad_s: f64,
    /// Acceleration of the smooth motion, rad/s^2.
    pub acceleration_rad_s2: f64,
    /// Jerk of the smooth motion, rad/s^3; it may step.
    pub jerk_rad_s3: f64,
    /// Sinusoids on top of it.
    pub sinusoids: Vec<Sinusoid>,
}

/// Largest rate, acceleration and jerk in body axes, rad/s, rad/s^2, rad/s^3.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct BodyExtremes {
    pub(super) rate: f64,
    pub(super) acceleration: f64,
    pub(super) jerk: f64,
}

impl MotionScale {
    /// Returns `sum A w^power` over the sinusoids.
    pub(super) fn sinusoid_sum(&self, power: i32) -> f64 {
        self.sinusoids.iter().map(|s| s.amplitude_rad.abs() * s.angular_rad_s().powi(power)).sum()
    }

    /// Returns the highest frequency of the sinusoids, Hz; 0 without any.
    pub fn highest_frequency_hz(&self) -> f64 {
        self.sinusoids.iter().fold(0.0, |highest, s| s.frequency_hz.abs().max(highest))
    }

    /// Returns the contribution of the axes' tilt to the acceleration, rad/s^2.
    pub(super) fn coupled_acceleration(&self) -> f64 {
        let tilt_rate = self.sinusoid_sum(1);
        tilt_rate * (self.rate_rad_s + tilt_rate)
    }

    /// Returns the contribution of the axes' tilt to the jerk, rad/s^3: they tilt at `tilt_rate`, and the rest turns at
    /// `rate`.
    pub(super) fn coupled_jerk(&self, tilt_rate: f64, rate: f64) -> f64 {
        let tilt_acceleration = self.sinusoid_sum(2);
        2.0 * tilt_rate * (self.acceleration_rad_s2 + tilt_acceleration)
            + (tilt_acceleration + tilt_rate * tilt_rate) * (rate + tilt_rate)
    }

    /// Returns the extremes of the smooth motion, sinusoids and coupling together.
    pub(super) fn body_extremes(&self) -> BodyExtremes {
        let [g1, g2, g3] = [1, 2, 3].map(|power| self.sinusoid_sum(power));
        BodyExtremes {
            rate: self.rate_rad_s + g1,
            acceleration: self.acceleration_rad_s2 + g2 + self.coupled_acceleration(),
            jerk: self.jerk_rad_s3 + g3 + self.coupled_jerk(g1, self.rate_rad_s),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::TAU;

    /// Returns the largest error of `terms` of the Taylor polynomial over many phases.
    fn scanned(terms: u32, x: f64) -> f64 {
        let phases = (0..20_000).map(|i| f64::from(i) / 20_000.0 * TAU);
        let error = |p: f64| {
            let polynomial = [p.sin(), x * p.cos(), -0.5 * x * x * p.sin()];
            (p + x).sin() - polynomial[..terms as usize].iter().sum::<f64>()
        };
        phases.map(error).fold(0.0, |worst, e| worst.max(e.abs()))
    }

    #[test]
    fn the_closed_form_is_the_worst_phase() {
        for terms in 1..=3 {
            for x in [0.02, 0.09, 0.11, 0.5, 1.0, 3.0] {
                let (bound, found) = (worst_phase(terms, x), scanned(terms, x));
                assert!(found <= bound * (1.0 + 1e-9), "{terms} terms, {x}: {found} over {bound}");
                assert!(found >= 0.997 * bound, "{terms} terms, {x}: {found} idle under {bound}");
            }
        }
    }

    #[test]
    fn more_terms_help_only_well_within_a_period() {
        assert!(worst_phase(3, 0.3) < 0.2 * worst_phase(2, 0.3));
        assert!(worst_phase(2, 0.3) < 0.2 * worst_phase(1, 0.3));
        assert!(worst_phase(3, 6.0) > worst_phase(2, 6.0), "a parabola goes on");
        assert!(worst_phase(2, 6.0) > worst_phase(1, 6.0), "and so does a line");
        assert_eq!(worst_phase(1, 100.0), 2.0);
    }

    #[test]
    fn bounds_never_shrink_with_time() {
        for terms in 1..=3 {
            let bounds: Vec<f64> = (0..4000).map(|i| worst_phase(terms, f64::from(i) * 5e-3)).collect();
            assert!(bounds.windows(2).all(|pair| pair[0] <= pair[1] * (1.0 + 1e-3)), "{terms} terms");
        }
    }
}

#[cfg(test)]
mod motion_scale_tests {
    use super::*;

    fn wobbling(rate_rad_s: f64) -> MotionScale {
        let sinusoids = vec![Sinusoid { frequency_hz: 5.0, amplitude_rad: 1e-3 }];
        MotionScale { rate_rad_s, acceleration_rad_s2: 0.02, jerk_rad_s3: 0.03, sinusoids }
    }

    #[test]
    fn without_sinusoids_nothing_couples() {
        let smooth = MotionScale { sinusoids: Vec::new(), ..wobbling(0.1) };
        let wanted = BodyExtremes { rate: 0.1, acceleration: 0.02, jerk: 0.03 };
        assert_eq!(smooth.body_extremes(), wanted);
    }

    #[test]
    fn a_sinusoid_tilts_the_axis_of_a_spin() {
        let extremes = wobbling(0.1).body_extremes();
        let w = TAU * 5.0;
        assert!((extremes.rate - (0.1 + 1e-3 * w)).abs() < 1e-15);
        // The spin axis swings in the body by A sin(w t): its rate changes by 0.1 A w.
        assert!(extremes.acceleration >= 0.02 + 1e-3 * w * w + 0.1 * 1e-3 * w, "{extremes:?}");
        assert!(extremes.acceleration < 1.02 * (0.02 + 1e-3 * w * w + 0.1 * 1e-3 * w), "not idle: {extremes:?}");
        assert!(wobbling(0.0).body_extremes().acceleration < extremes.acceleration, "the coupling is there");
    }
}
