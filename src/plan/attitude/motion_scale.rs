//! Magnitudes of a motion, the input of the error bounds of [`AttitudeMethod`](super::AttitudeMethod).
//!
//! Input: the largest rate, acceleration and jerk of a smooth motion, and sinusoids on top of it, each a turn about an
//! axis fixed in the body. Output: the largest rate, acceleration and jerk of the whole, in body axes.
//!
//! *Coupling.* A sinusoid tilts the axes in which the rest of the motion is written. With `g_n = sum A w^n`, the n-th
//! derivative of that tilt is at most `B_n`: `B_1 = g_1`, `B_2 = g_2 + g_1^2` (complete Bell polynomials, which add
//! over a chain of turns), and Leibniz' rule gives its effect on the rest. *Limits.* Angles need not be small.
//! *Validation.* `tests/physics/attitude_methods.rs`, 600 random motions.

use core::f64::consts::TAU;

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
