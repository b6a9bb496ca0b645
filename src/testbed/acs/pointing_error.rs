//! Pointing error in the steady state on paper: tracker and gyro noise through estimator and control loop.
//!
//! One axis. The estimator is Farrenkopf's steady state as a continuous observer with `k1 = K / Tm`, `k2 = |Kb| / Tm`
//! (`Tm`: tracker period, `D = s^2 + k1 s + k2`). Its errors of attitude `e` and of rate `d`, per white noise of the
//! tracker (density `nea^2 Tm`), of the rate (`sigma_v^2`) and of the bias (`sigma_u^2`):
//!
//! | noise | e | d |
//! |---|---|---|
//! | tracker | `(k1 s + k2) / D` | `k2 s / D` |
//! | rate | `s / D` | `(s^2 + k1 s) / D` |
//! | bias | `1 / D` | `(s + k1) / D` |
//!
//! A measurement that comes `l` late, worked in where it holds, makes of them (`beta`: bias error, `m = exp(-s l)`)
//! `d = noise - m beta`, `e = m e + int_{t-l}^t d`: the time since then is bridged by the gyro alone.
//!
//! The loop makes `-P (A e + B d) / (1 + L)` of them: `A` angle gain, `B` rate gain, `P` plant ([`PointingLoop`]).
//! Variance: `(1 / pi) int |H|^2 density dw` by the trapezoidal rule over `ln w`.
//!
//! Assumptions: a tracker gain well below 1 and a tracker period short against the loop (else the updates are steps
//! and no continuous observer). Test: `linear_tests.rs`, a simulation within 5 %.

use super::{filter::Complex, linear::PointingLoop};
use crate::estimator::{Farrenkopf, GyroNoise};

/// Decades below the lowest and above the highest corner that are integrated, and points per decade.
const DECADES: f64 = 4.0;
const POINTS_PER_DECADE: f64 = 400.0;

/// Noise sources of the pointing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointingNoise {
    /// Noise-equivalent angle of the tracker about this axis, rad, one sigma per measurement.
    pub nea_rad: f64,
    /// Time between measurements, s.
    pub tracker_period_s: f64,
    /// From the instant for which a measurement holds to its arrival, s.
    pub latency_s: f64,
    /// Gyro about this axis.
    pub gyro: GyroNoise,
}

/// Sigmas of the true pointing error and of the attitude knowledge, rad.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PointingPrediction {
    /// All noise together: the true attitude about the target.
    pub pointing_sigma_rad: f64,
    /// The part of the tracker's noise.
    pub from_tracker_rad: f64,
    /// The part of the gyro's angle random walk.
    pub from_rate_noise_rad: f64,
    /// The part of the gyro's bias walk.
    pub from_bias_walk_rad: f64,
    /// The estimate about the true attitude.
    pub knowledge_sigma_rad: f64,
}

/// The estimator as a continuous observer.
struct Observer {
    k1: f64,
    k2: f64,
    latency_s: f64,
}

impl PointingLoop {
    /// Returns the pointing error to be expected from this loop with an estimator that is tuned to the same noise.
    pub fn pointing_error(&self, noise: &PointingNoise) -> PointingPrediction {
        let steady = Farrenkopf::new(noise.nea_rad, noise.tracker_period_s, &noise.gyro);
        let observer = Observer {
            k1: steady.attitude_gain / noise.tracker_period_s,
            k2: -steady.bias_gain_per_s / noise.tracker_period_s,
            latency_s: noise.latency_s,
        };
        let densities = [
            noise.nea_rad.powi(2) * noise.tracker_period_s,
            noise.gyro.arw_rad_sqrt_s.powi(2),
            noise.gyro.rrw_rad_s_sqrt_s.powi(2),
        ];
        let range = self.corners(&observer);
        let variance = |k: usize| {
            densities[k] * bandwidth_rad_s(range, |w| self.pointing_from(observer.errors(w)[k], w))
                / core::f64::consts::PI
        };
        let known =
            |k: usize| densities[k] * bandwidth_rad_s(range, |w| observer.errors(w)[k].0) / core::f64::consts::PI;
        let parts = [variance(0), variance(1), variance(2)];
        PointingPrediction {
            pointing_sigma_rad: parts.iter().sum::<f64>().sqrt(),
            from_tracker_rad: parts[0].sqrt(),
            from_rate_noise_rad: parts[1].sqrt(),
            from_bias_walk_rad: parts[2].sqrt(),
            knowledge_sigma_rad: (known(0) + known(1) + known(2)).sqrt(),
        }
    }

    /// Returns the equivalent noise bandwidth of the closed loop for noise of the measured angle and its rate, Hz,
    /// two-sided: `(1 / 2 pi) int |T|^2 dw` over all frequencies.
    #[cfg(test)]
    pub fn noise_bandwidth_hz(&self) -> f64 {
        let wn = self.gains.natural_rad_s();
        bandwidth_rad_s((wn, wn), |w| self.complementary(w)) / core::f64::consts::PI
    }

    fn pointing_from(&self, (e, d): (Complex, Complex), w_rad_s: f64) -> Complex {
        -(self.plant(w_rad_s) * (self.angle_gain(w_rad_s) * e + d * self.rate_gain()) * self.sensitivity(w_rad_s))
    }

    fn corners(&self, observer: &Observer) -> (f64, f64) {
        let wn = self.gains.natural_rad_s();
        let corners = [wn, observer.k1, observer.k2.sqrt(), observer.k2 / observer.k1];
        let positive = corners.into_iter().filter(|corner| *corner > 0.0);
        positive.fold((wn, wn), |(low, high), corner| (low.min(corner), high.max(corner)))
    }
}

impl Observer {
    /// Returns the attitude and rate error per tracker, rate and bias noise.
    fn errors(&self, w_rad_s: f64) -> [(Complex, Complex); 3] {
        let s = Complex::imaginary(w_rad_s);
        let (k1, k2) = (self.k1, Complex::real(self.k2));
        let d = s * s + s * k1 + k2;
        let attitude = [(s * k1 + k2) / d, s / d, Complex::ONE / d];
        let bias = [-(s * self.k2 / d), k2 / d, -((s + Complex::real(k1)) / d)];
        let late = Complex::unit(-w_rad_s * self.latency_s);
        // Effect of the gyro's noises on rate and angle since the instant of the last measurement.
        let [once, twice] = self.since(s, late);
        let rate_since = [Complex::real(0.0), Complex::ONE, once];
        let angle_since = [Complex::real(0.0), once, twice];
        core::array::from_fn(|k| {
            let (attitude, bias) = (late * attitude[k], late * bias[k]);
            (attitude - bias * self.latency_s + angle_since[k], rate_since[k] - bias)
        })
    }

    /// Returns the white noise integrated once and twice over the latency: `(1 - m) / s` and `(l - (1 - m) / s) / s`.
    fn since(&self, s: Complex, late: Complex) -> [Complex; 2] {
        let l = self.latency_s;
        if s.im * l < 1e-4 {
            // The differences lose their digits; the next term is 1e-4 of these.
            return [Complex::real(l), Complex::real(l * l / 2.0)];
        }
        let once = (Complex::ONE - late) / s;
        [once, (Complex::real(l) - once) / s]
    }
}

/// Returns `int_0^inf |H|^2 dw`, four decades past the corners.
fn bandwidth_rad_s((low, high): (f64, f64), h: impl Fn(f64) -> Complex) -> f64 {
    let (first, last) = (low.log10() - DECADES, high.log10() + DECADES);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some thousands of points")]
    let points = ((last - first) * POINTS_PER_DECADE).ceil() as u32;
    let step = (last - first) / f64::from(points);
    let term = |k: u32| {
        let w = 10_f64.powf(first + step * f64::from(k));
        h(w).modulus_squared() * w
    };
    // The rectangle below the first point covers the lower frequencies: |H| is constant there or falls to zero.
    let before = term(0);
    let inner: f64 = (1..points).map(term).sum();
    before + (0.5 * (term(0) + term(points)) + inner) * step * core::f64::consts::LN_10
}
