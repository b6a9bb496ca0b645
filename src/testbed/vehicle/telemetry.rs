//! Telemetry: what the vehicle knows and what is true, row by row.
//!
//! Plain numbers; angles are rotation vectors in body axes. A row has one binary form ([`TelemetryRow::bytes`]) by
//! which runs are compared bit for bit.

use crate::acs::{Mode, ModeEvent};
use crate::tracker::Reason;
use base::time::Tai;
use glam::DVec3;

/// One row.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TelemetryRow {
    /// When.
    pub at: Tai,
    /// Mode of the control.
    pub mode: Mode,
    /// From the true attitude to the target's, rad; zero rows have no target.
    pub pointing_error_rad: DVec3,
    /// From the true attitude to the estimated one, rad; `None`: no estimate.
    pub knowledge_error_rad: Option<DVec3>,
    /// Sigma of the estimate, largest axis, rad.
    pub sigma_rad: f64,
    /// True rate, rad/s.
    pub rate_rad_s: DVec3,
    /// Estimated bias less the true one, rad/s.
    pub bias_error_rad_s: DVec3,
    /// Commanded torque, N m.
    pub torque_n_m: DVec3,
    /// Largest micro-vibration that went over the bus since the last row, rad.
    pub vibration_rad: f64,
    /// Largest wheel speed, rad/s.
    pub wheel_speed_rad_s: f64,
    /// Momentum of the wheels, N m s.
    pub wheel_momentum_n_m_s: f64,
    /// Heads whose last frame gave an attitude.
    pub heads_solved: u32,
    /// Why the first head's last frame gave no attitude; `None`: it gave one, or no frame has arrived.
    pub no_solution: Option<Reason>,
    /// Stars in the first head's last attitude.
    pub stars: u32,
    /// Sigma of the first head's last attitude as estimated by its tracker: across the boresight, per axis, rad.
    pub tracker_sigma_rad: Option<f64>,
    /// Angle between the kept boresight and the Sun, rad; `None` without a cone.
    pub sun_angle_rad: Option<f64>,
}

/// Bytes of one row.
pub const ROW_BYTES: usize = 8 * 25;

impl TelemetryRow {
    /// Returns the row as little-endian numbers of eight bytes.
    pub fn bytes(&self) -> [u8; ROW_BYTES] {
        let known = self.knowledge_error_rad.unwrap_or(DVec3::NAN);
        let numbers = [
            self.pointing_error_rad.to_array(),
            known.to_array(),
            self.rate_rad_s.to_array(),
            self.bias_error_rad_s.to_array(),
            self.torque_n_m.to_array(),
            [self.sigma_rad, self.wheel_speed_rad_s, self.wheel_momentum_n_m_s],
            [f64::from(self.heads_solved), f64::from(self.stars), self.sun_angle_rad.unwrap_or(f64::NAN)],
        ];
        let sigma = self.tracker_sigma_rad.unwrap_or(f64::NAN);
        let mut bytes = [0; ROW_BYTES];
        let words = [self.at.ns().cast_unsigned(), self.mode as u64].into_iter();
        let words = words.chain(numbers.into_iter().flatten().chain([sigma, self.vibration_rad]).map(f64::to_bits));
        for (place, word) in bytes.chunks_exact_mut(8).zip(words) {
            place.copy_from_slice(&word.to_le_bytes());
        }
        bytes
    }
}

/// Rows and mode changes not yet taken by their recorder.
#[derive(Debug, Default)]
pub struct Telemetry {
    /// Rows, oldest first.
    pub rows: Vec<TelemetryRow>,
    /// Mode changes, oldest first.
    pub mode_events: Vec<ModeEvent>,
}
