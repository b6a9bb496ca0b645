//! `[[head]]` and `[[extra_head]]`: camera heads, each with its mounting, camera, frame rate and phase.

use crate::bench::quaternion;
use crate::camera::Camera;
use crate::check::Checker;
use crate::error::ConfigError;
use crate::timing::{check_frame_rate, phase};
use base::axes::{Body, Rotation, Sensor};
use base::time::Span;
use serde::Deserialize;

/// Most camera heads of one bench or spacecraft.
pub(super) const HEADS_MAX: usize = 8;

/// A camera head, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Head {
    /// How it is mounted.
    pub sensor_from_body: Rotation<Sensor, Body>,
    /// Its camera.
    pub camera: Camera,
    /// Frames per second.
    pub frame_rate_hz: f64,
    /// By how much its exposures begin after the whole frame periods of the run.
    pub phase: Span,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct HeadKeys {
    sensor_from_body: Option<[f64; 4]>,
    pub(super) camera: Option<String>,
    frame_rate_hz: Option<f64>,
    phase_ms: Option<f64>,
}

/// Returns the heads listed under `name`, of which there may be `most`; what a head does not say is as of `usual`.
pub(super) fn check_heads(
    name: &str,
    keys: &[HeadKeys],
    most: usize,
    usual: &Head,
    check: &Checker<'_>,
) -> Result<Vec<Head>, ConfigError> {
    if keys.len() > most {
        return Err(check.invalid(name, keys.len(), format!("at most {most}"), "leave some out"));
    }
    keys.iter().enumerate().map(|(place, keys)| keys.head(&format!("{name}[{place}]"), usual, check)).collect()
}

impl HeadKeys {
    /// Checks the head that is listed at `place`.
    fn head(&self, place: &str, usual: &Head, check: &Checker<'_>) -> Result<Head, ConfigError> {
        let key = |name: &str| format!("{place}.{name}");
        let mounting_key = key("sensor_from_body");
        let advice = "how the head is mounted";
        let missing = || check.invalid(&mounting_key, "missing", "a unit quaternion [w, x, y, z]", advice);
        let sensor_from_body = quaternion(&mounting_key, self.sensor_from_body.ok_or_else(missing)?, check)?;
        let camera = match &self.camera {
            Some(path) => Camera::from_document(&check.document.named(&key("camera"), path)?)?,
            None => usual.camera.clone(),
        };
        let frame_rate_hz = self.frame_rate_hz.unwrap_or(usual.frame_rate_hz);
        check_frame_rate(&key("frame_rate_hz"), frame_rate_hz, Some(camera.exposure.exposure_s), check)?;
        let phase = match self.phase_ms {
            Some(given) => phase(&key("phase_ms"), Some(given), check)?,
            None => usual.phase,
        };
        Ok(Head { sensor_from_body, camera, frame_rate_hz, phase })
    }
}
