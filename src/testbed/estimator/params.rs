//! Parameters of the estimator: its gyro, its first guess and its measurements.

use base::{refused::Refused, time::Span};
use glam::DVec3;

/// Settings of the estimator.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MekfParams {
    /// Angle random walk of each gyro axis, rad/sqrt(s): `sigma_v` of Farrenkopf (1978).
    pub gyro_arw_rad_sqrt_s: DVec3,
    /// Rate random walk (drift of the bias) of each gyro axis, rad/s/sqrt(s): `sigma_u` of Farrenkopf (1978).
    pub gyro_rrw_rad_s_sqrt_s: DVec3,
    /// Standard deviation of the attitude before anything is known, rad per axis.
    pub initial_attitude_sigma_rad: f64,
    /// Standard deviation of the gyro bias at a start, rad/s per axis.
    pub initial_bias_sigma_rad_s: f64,
    /// Angular acceleration (one sigma, rad/s^2) the body may have while the gyro is silent: the attitude variance
    /// then grows as `(acceleration t^2 / 2)^2`.
    pub dropout_acceleration_rad_s2: f64,
    /// An attitude is refused when its innovation is further than this many sigmas (Mahalanobis distance, 3 axes).
    pub gate_sigma: f64,
    /// More than this many refused attitudes in a row: lost, and the next attitude restarts the filter.
    pub lost_after: u32,
    /// How old an attitude may be.
    pub history: Span,
    /// Gyro samples plus attitudes that the history can hold; allocated once.
    pub history_steps: usize,
    /// Converged when the largest attitude sigma is below this, rad.
    pub converged_sigma_rad: f64,
}

impl MekfParams {
    /// Checks every setting.
    ///
    /// # Errors
    /// The first setting out of range.
    pub fn check(&self) -> Result<(), Refused> {
        let not_negative = |v: DVec3| v.is_finite() && v.min_element() >= 0.0;
        let checks = [
            ("gyro_arw_rad_sqrt_s", not_negative(self.gyro_arw_rad_sqrt_s), self.gyro_arw_rad_sqrt_s.to_string()),
            ("gyro_rrw_rad_s_sqrt_s", not_negative(self.gyro_rrw_rad_s_sqrt_s), self.gyro_rrw_rad_s_sqrt_s.to_string()),
        ];
        for (name, good, got) in checks {
            refuse_unless(good, name, &got, "finite and not negative")?;
        }
        let positive = [
            ("initial_attitude_sigma_rad", self.initial_attitude_sigma_rad),
            ("initial_bias_sigma_rad_s", self.initial_bias_sigma_rad_s),
            ("gate_sigma", self.gate_sigma),
            ("converged_sigma_rad", self.converged_sigma_rad),
            ("history", self.history.s()),
        ];
        for (name, value) in positive {
            refuse_unless(value.is_finite() && value > 0.0, name, &value.to_string(), "finite and positive")?;
        }
        let silent = self.dropout_acceleration_rad_s2;
        let good = silent.is_finite() && silent >= 0.0;
        refuse_unless(good, "dropout_acceleration_rad_s2", &silent.to_string(), "finite and not negative")?;
        refuse_unless(self.history_steps >= 4, "history_steps", &self.history_steps.to_string(), "at least 4")
    }
}

fn refuse_unless(good: bool, name: &'static str, got: &str, wanted: &'static str) -> Result<(), Refused> {
    if good { Ok(()) } else { Err(Refused(format!("estimator: {name} is {got}, wanted {wanted}"))) }
}
