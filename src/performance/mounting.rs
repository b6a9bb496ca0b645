//! A mounting that drifts with the temperature of an orbit: the sensor turns away from the axes that it is aligned to.
//!
//! The drift is `d sin^2(pi t / P)` about the sensor's axes: nothing at the start, where the orbit leaves the shadow, `d`
//! half a period later. Frames are drawn at the sensor's own attitude; the truth that a tracker is compared with is
//! that of the axes it is aligned to. Tests: below; `thermo_elastic` recovers it.

use crate::attitude_error::turned;
use anyhow::{Result, bail};
use base::units::ARCSEC;
use core::f64::consts::PI;
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// A drift of the mounting.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MountingDrift {
    /// Largest turn of the sensor, about its axes, arcsec.
    pub arcsec: [f64; 3],
    /// From one start of the drift to the next, s: the period of the orbit.
    pub period_s: f64,
}

/// Largest drift of a mounting.
const MOST_DRIFT_ARCSEC: f64 = 3600.0;

impl MountingDrift {
    /// Refuses a drift that no mounting has.
    ///
    /// # Errors
    /// With the drift and its limits.
    pub fn check(&self) -> Result<()> {
        let is_good =
            self.arcsec.iter().all(|angle| angle.abs() <= MOST_DRIFT_ARCSEC) && (1.0..=1e9).contains(&self.period_s);
        if is_good {
            return Ok(());
        }
        bail!(
            "mounting_drift: got arcsec {:?} and period_s {}, wanted arcsec up to {MOST_DRIFT_ARCSEC} and period_s from 1 to 1e9",
            self.arcsec,
            self.period_s
        )
    }

    /// Returns the turn of the sensor a time after the first exposure, rad.
    pub fn turn_rad(&self, t_s: f64) -> DVec3 {
        let sine = (PI * t_s / self.period_s).sin();
        DVec3::from_array(self.arcsec) * (ARCSEC * sine * sine)
    }

    /// Returns the attitude of the sensor from that of the axes it is aligned to.
    pub fn sensor(&self, aligned: DQuat, t_s: f64) -> DQuat {
        turned(aligned, self.turn_rad(t_s))
    }

    /// Returns the attitude of the axes that the sensor is aligned to from its own.
    pub fn aligned(&self, sensor: DQuat, t_s: f64) -> DQuat {
        turned(sensor, -self.turn_rad(t_s))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude_error::attitude_error;

    #[test]
    fn the_drift_is_largest_after_half_a_period_and_comes_off_again() {
        let drift = MountingDrift { arcsec: [20.0, -10.0, 60.0], period_s: 5400.0 };
        let largest = DVec3::new(20.0, -10.0, 60.0) * ARCSEC;
        assert!((drift.turn_rad(2700.0) - largest).length() < 1e-15);
        assert!((drift.turn_rad(1350.0) - 0.5 * largest).length() < 1e-15 && drift.turn_rad(0.0) == DVec3::ZERO);
        let aligned = DQuat::from_xyzw(0.1, -0.4, 0.3, 0.86).normalize();
        let sensor = drift.sensor(aligned, 2700.0);
        assert!((attitude_error(sensor, aligned) - largest).length() < 1e-15);
        assert!(attitude_error(drift.aligned(sensor, 2700.0), aligned).length() < 1e-15);
    }
}
