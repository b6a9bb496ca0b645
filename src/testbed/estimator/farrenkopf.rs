//! Steady state of a one-axis attitude-and-bias filter in closed form.
//!
//! Input: gyro noise, tracker noise, tracker period. Output: variances before and after an update and the gains.
//! Source: Farrenkopf, "Analytic steady-state accuracy solutions for two common spacecraft attitude estimators", J.
//! Guidance and Control 1 (1978); Markley and Crassidis (2014), section 6.3, without readout noise. Tests: the
//! equations of covariance hold at the solution (below); the filter of this module ends there (`tests.rs`).

/// Noise of one gyro axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GyroNoise {
    /// Angle random walk `sigma_v`, rad/sqrt(s).
    pub arw_rad_sqrt_s: f64,
    /// Rate random walk `sigma_u`, rad/s/sqrt(s).
    pub rrw_rad_s_sqrt_s: f64,
}

/// Steady state of one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Farrenkopf {
    /// Attitude sigma right before an update, rad.
    pub sigma_before_rad: f64,
    /// Attitude sigma right after an update, rad.
    pub sigma_after_rad: f64,
    /// Bias sigma right before an update, rad/s.
    pub bias_sigma_before_rad_s: f64,
    /// Bias sigma right after an update, rad/s.
    pub bias_sigma_after_rad_s: f64,
    /// Gain from the innovation to the attitude.
    pub attitude_gain: f64,
    /// Gain from the innovation to the bias, 1/s; negative.
    pub bias_gain_per_s: f64,
}

impl Farrenkopf {
    /// Returns the steady state for a tracker with noise `nea_rad` (one sigma) every `period_s`. With `Su = sigma_u
    /// T^1.5 / sigma_n` and `Sv = sigma_v T^0.5 / sigma_n`: `xi + 1 / xi = Su / 2 + 2 sqrt(1 + Sv^2 / 4 + Su^2 / 48)`.
    pub fn new(nea_rad: f64, period_s: f64, gyro: &GyroNoise) -> Self {
        let walk = gyro.rrw_rad_s_sqrt_s;
        let su = walk * period_s.powf(1.5) / nea_rad;
        let sv = gyro.arw_rad_sqrt_s * period_s.sqrt() / nea_rad;
        let gamma = (1.0 + sv * sv / 4.0 + su * su / 48.0).sqrt();
        let xi = gamma + su / 4.0 + 0.5 * (2.0 * gamma * su + sv * sv + su * su / 3.0).sqrt();
        let cross_before = -walk * period_s.sqrt() * nea_rad * xi;
        let before = nea_rad * nea_rad * (xi * xi - 1.0);
        let innovation = nea_rad * nea_rad * xi * xi;
        let attitude_gain = before / innovation;
        let bias_after = -cross_before * attitude_gain / period_s - walk * walk * period_s / 2.0;
        Self {
            sigma_before_rad: before.sqrt(),
            sigma_after_rad: nea_rad * attitude_gain.sqrt(),
            bias_sigma_before_rad_s: (bias_after + walk * walk * period_s).max(0.0).sqrt(),
            bias_sigma_after_rad_s: bias_after.max(0.0).sqrt(),
            attitude_gain,
            bias_gain_per_s: cross_before / innovation,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative rounding of a few dozen f64 operations, with cancellation of two digits.
    const ROUNDING: f64 = 1e-11;

    /// Takes one period of the two-state covariance equations, from before an update to before the next.
    fn next(p: [f64; 3], nea: f64, t: f64, gyro: &GyroNoise) -> [f64; 3] {
        let (v, u) = (gyro.arw_rad_sqrt_s.powi(2), gyro.rrw_rad_s_sqrt_s.powi(2));
        let s = p[0] + nea * nea;
        let (a, c, b) = (p[0] - p[0] * p[0] / s, p[1] - p[0] * p[1] / s, p[2] - p[1] * p[1] / s);
        [a - 2.0 * t * c + t * t * b + v * t + u * t.powi(3) / 3.0, c - t * b - u * t * t / 2.0, b + u * t]
    }

    #[test]
    fn the_covariance_equations_stay_constant_at_the_solution() {
        for (nea, t, arw, rrw) in [(1e-5, 0.1, 1e-6, 1e-9), (3e-5, 1.0, 5e-6, 1e-7), (1e-6, 2.0, 1e-6, 1e-6)] {
            let gyro = GyroNoise { arw_rad_sqrt_s: arw, rrw_rad_s_sqrt_s: rrw };
            let f = Farrenkopf::new(nea, t, &gyro);
            let cross = f.bias_gain_per_s * (f.sigma_before_rad.powi(2) + nea * nea);
            let p = [f.sigma_before_rad.powi(2), cross, f.bias_sigma_before_rad_s.powi(2)];
            let moved = next(p, nea, t, &gyro);
            for k in 0..3 {
                assert!((moved[k] / p[k] - 1.0).abs() < ROUNDING, "term {k}: {} becomes {}", p[k], moved[k]);
            }
            let wrong = next([p[0] * 1.001, p[1], p[2]], nea, t, &gyro);
            assert!((wrong[0] / p[0] - 1.0).abs() > ROUNDING, "off the solution it must move");
        }
    }
}
