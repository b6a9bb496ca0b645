//! Inputs and parameters of an instance: what the importer sets, as a sample of the plant.

use crate::error::FmuError;
use base::axes::{Rotation, WRITTEN_NORM_TOLERANCE};
use base::{refused::Refused, time::Tai, units::METRE_KM};
use glam::DVec3;
use run::runtime::{PlantAttitude, PlantSample};
use sky::observer::BarycentricState;

/// Inputs and parameters.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Inputs {
    pub(crate) output_dir: String,
    pub(crate) q: [f64; 4],
    pub(crate) rate: [f64; 3],
    pub(crate) acceleration: [f64; 3],
    pub(crate) jitter: [f64; 3],
    pub(crate) position: [f64; 3],
    pub(crate) velocity: [f64; 3],
    pub(crate) has_observer: bool,
    pub(crate) trigger: u16,
    pub(crate) trigger_count: u32,
}

impl Default for Inputs {
    fn default() -> Self {
        Self {
            output_dir: "starloop_fmu".into(),
            q: [1.0, 0.0, 0.0, 0.0],
            rate: [0.0; 3],
            acceleration: [0.0; 3],
            jitter: [0.0; 3],
            position: [0.0; 3],
            velocity: [0.0; 3],
            has_observer: false,
            trigger: 0,
            trigger_count: 0,
        }
    }
}

impl Inputs {
    /// Returns the sample of an instant; without `has_jitter` no jitter is given.
    pub(crate) fn sample(&self, at: Tai, has_jitter: bool) -> Result<PlantSample, FmuError> {
        Ok(PlantSample {
            at,
            attitude: Some(self.attitude()?),
            jitter_rad: has_jitter.then(|| DVec3::from_array(self.jitter)),
            observer: self.has_observer.then(|| self.observer()),
        })
    }

    fn attitude(&self) -> Result<PlantAttitude, FmuError> {
        let Inputs { q, rate, acceleration, .. } = self;
        let body_from_icrf = Rotation::from_wxyz(*q, WRITTEN_NORM_TOLERANCE).ok_or_else(|| {
            FmuError::from(Refused(format!(
                "variable q_body_from_icrf: wanted a unit quaternion w x y z (norm within 0.001 of 1), got {q:?}"
            )))
        })?;
        let (rate_rad_s, acceleration_rad_s2) = (DVec3::from_array(*rate), DVec3::from_array(*acceleration));
        Ok(PlantAttitude { body_from_icrf, rate_rad_s, acceleration_rad_s2 })
    }

    fn observer(&self) -> BarycentricState {
        BarycentricState {
            position_km: DVec3::from_array(self.position) * METRE_KM,
            velocity_km_s: DVec3::from_array(self.velocity) * METRE_KM,
        }
    }
}
