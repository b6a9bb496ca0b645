//! Theory of the pointing loop as implemented: [`PointingLoop`] with the effect of the gyro.
//!
//! The attitude estimate follows the true motion without lag (the gyro's angles are summed), but the rate is the mean
//! over the last control period: `G(s) = (1 - exp(-s Tc)) / (s Tc)`, half a period late. With angle gain `A`, rate gain
//! `B` and plant `P` (filter, delay, hold, body): `L = (A + s B G) P`. At rest the tracker has no effect on this: late
//! measurements with true time tags are applied at their own time.
//!
//! In: vehicle parameters, an added delay. Out: `L`, `S`, margins, and the error caused by noise. Test: `tests`, with
//! an independent simulation of the sampled loop; `tests/closed_loop/study.rs`, over pixels.

use base::bisection::bisected;
use testbed::acs::{filter::Complex, linear::PointingLoop, pointing_error::PointingNoise};
use testbed::estimator::{Farrenkopf, GyroNoise};
use testbed::vehicle::VehicleParams;

/// Largest factor by which the gyro moves the crossover.
const CROSSOVER_FACTOR: f64 = 1.5;
/// Number of halvings of the bracket of the crossover: to f64 resolution.
const HALVINGS: u32 = 60;

/// One axis of the loop in fine pointing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LoopOnPaper {
    /// The textbook's loop.
    pub textbook: PointingLoop,
    /// Averaging time of the gyro, s; zero for a gyro that measures the rate itself.
    pub gyro_period_s: f64,
}

impl LoopOnPaper {
    /// Returns the loop of a vehicle with its own delay.
    pub fn of(vehicle: &VehicleParams) -> Self {
        let period_s = vehicle.acs.control_period.s();
        let textbook = PointingLoop {
            gains: vehicle.acs.fine,
            delay_s: vehicle.actuation_delay.s(),
            control_period_s: period_s,
            filter: vehicle.acs.filter,
            inertia_ratio: 1.0,
        };
        Self { textbook, gyro_period_s: period_s }
    }

    /// Returns the same loop with another delay from control step to torque.
    pub fn with_delay(&self, delay_s: f64) -> Self {
        Self { textbook: PointingLoop { delay_s, ..self.textbook }, ..*self }
    }

    /// Returns the open loop `L(i w)`.
    pub fn open_loop(&self, w_rad_s: f64) -> Complex {
        let half = 0.5 * w_rad_s * self.gyro_period_s;
        let mean = if half == 0.0 { 1.0 } else { half.sin() / half };
        let rate = Complex::imaginary(self.textbook.rate_gain() * w_rad_s) * Complex::unit(-half) * mean;
        (self.textbook.angle_gain(w_rad_s) + rate) * self.textbook.plant(w_rad_s)
    }

    /// Returns `S = 1 / (1 + L)`: the factor on a disturbing angle.
    pub fn sensitivity(&self, w_rad_s: f64) -> Complex {
        Complex::ONE / (Complex::ONE + self.open_loop(w_rad_s))
    }

    /// Returns the frequency at which `|L| = 1`, rad/s; `None` if the textbook's loop has none.
    pub fn crossover_rad_s(&self) -> Option<f64> {
        let near = self.textbook.gain_crossover_rad_s()?;
        let about = [near / CROSSOVER_FACTOR, near * CROSSOVER_FACTOR];
        Some(bisected(about, HALVINGS, |w_rad_s| self.open_loop(w_rad_s).modulus() > 1.0))
    }

    /// Returns the phase margin, rad, in `-pi..=pi`; negative when the loop is unstable.
    pub fn phase_margin_rad(&self) -> Option<f64> {
        Some(phase_margin_rad(self.open_loop(self.crossover_rad_s()?)))
    }

    /// Returns the delay beyond the present one at which the loop becomes unstable, s.
    pub fn delay_margin_s(&self) -> Option<f64> {
        Some(self.phase_margin_rad()? / self.crossover_rad_s()?)
    }

    /// Returns the sigma of the pointing error about one axis, rad. The gyro's lateness counts as the delay with the
    /// same cost in delay margin.
    pub fn pointing_sigma_rad(&self, noise: &PointingNoise) -> f64 {
        let lag_s = self.textbook.delay_margin_s().zip(self.delay_margin_s()).map_or(0.0, |(all, left)| all - left);
        let late = PointingLoop { delay_s: self.textbook.delay_s + lag_s, ..self.textbook };
        late.pointing_error(noise).pointing_sigma_rad
    }
}

/// Returns the phase of `-L`: at the crossover the phase margin, rad.
pub fn phase_margin_rad(open_loop: Complex) -> f64 {
    (-open_loop).argument_rad()
}

/// Returns the noise of a vehicle whose tracker has this noise, period and latency (middle of the exposure to end of
/// readout).
pub fn noise_of(vehicle: &VehicleParams, nea_rad: f64, tracker_period_s: f64, latency_s: f64) -> PointingNoise {
    let gyro = GyroNoise {
        arw_rad_sqrt_s: vehicle.gyro.angle_random_walk_rad_sqrt_s,
        rrw_rad_s_sqrt_s: vehicle.gyro.rate_random_walk_rad_s_sqrt_s,
    };
    let delay_s = vehicle.heads.first().map_or(0.0, |head| head.delay.s());
    let heads = vehicle.heads.len().max(1) as f64;
    PointingNoise { nea_rad: nea_rad / heads.sqrt(), tracker_period_s, latency_s: latency_s + delay_s, gyro }
}

/// Returns the share of a constant error of the tracker that the steady estimator has adopted `after_s` after its
/// start: step response of `(k1 s + k2) / (s^2 + k1 s + k2)` with Farrenkopf's gains.
pub fn taken_over(noise: &PointingNoise, after_s: f64) -> f64 {
    let steady = Farrenkopf::new(noise.nea_rad, noise.tracker_period_s, &noise.gyro);
    let (k1, k2) = (steady.attitude_gain / noise.tracker_period_s, -steady.bias_gain_per_s / noise.tracker_period_s);
    // 1 - e, where e'' + k1 e' + k2 e = 0 from e = 1, e' = -k1.
    let half = 0.5 * k1;
    let root = half * half - k2;
    let (cosine, sine) = if root >= 0.0 {
        let r = root.sqrt();
        ((r * after_s).cosh(), if r == 0.0 { after_s } else { (r * after_s).sinh() / r })
    } else {
        let r = (-root).sqrt();
        ((r * after_s).cos(), (r * after_s).sin() / r)
    };
    1.0 - (-half * after_s).exp() * (cosine - half * sine)
}
