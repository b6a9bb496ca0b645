//! `[[head]]` and `[[extra_head]]`: camera heads, each with its mounting, camera, frame rate and phase.

use crate::key::{listed, section};
use crate::timing::{PHASE_MAX_MS, check_frame_rate};
use crate::{camera::Camera, check::Checker, error::ConfigError};
use base::axes::{Body, Rotation, Sensor, WRITTEN_NORM_TOLERANCE};
use base::time::Span;

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

section! {
    /// A camera head.
    HeadKeys at "head" {
        /// How the head is mounted: a unit quaternion [w, x, y, z], scalar first.
        sensor_from_body: [f64; 4] = Needed, Within(-1.0, 1.0), "how the head is mounted";
        /// Camera file; left out, the bench's camera.
        camera: String = Optional, "path";
        /// Frames per second, such as 10.0; left out, as in [timing].
        frame_rate_hz: f64 = Computed("timing.frame_rate_hz"), PositiveUpTo(10_000.0);
        /// Milliseconds after the run's first exposure at which this head begins its own.
        phase_ms: f64 = Optional, Within(0.0, PHASE_MAX_MS);
    }
}

/// Returns the heads listed under `name`, at most `most`; keys that a head leaves out are as in `usual`.
pub(super) fn check_heads(
    name: &str,
    keys: &[HeadKeys],
    most: usize,
    usual: &Head,
    check: &mut Checker<'_>,
) -> Result<Vec<Head>, ConfigError> {
    if keys.len() > most {
        return Err(check.invalid(name, keys.len(), format!("at most {most}"), "leave some out"));
    }
    listed(keys, name).iter().map(|keys| keys.head(usual, check)).collect()
}

impl HeadKeys {
    fn head(&self, usual: &Head, check: &mut Checker<'_>) -> Result<Head, ConfigError> {
        let mounting = self.sensor_from_body();
        let wxyz = mounting.raw().ok_or_else(|| mounting.missing("a unit quaternion [w, x, y, z]", check))?;
        let sensor_from_body = quaternion(&mounting.key(), *wxyz, check)?;
        let camera = match self.camera().raw() {
            Some(path) => {
                let camera = Camera::partly(&check.document.named(&self.camera().key(), path)?)?;
                check.take(camera)
            }
            None => usual.camera.clone(),
        };
        let frame_rate_hz = self.frame_rate_hz().or_silently(usual.frame_rate_hz);
        let frame_rate_hz = check_frame_rate(frame_rate_hz, Some(camera.exposure.exposure_s), check)?;
        let phase = if self.phase_ms().is_given() { self.phase_ms().ms(check)? } else { usual.phase };
        Ok(Head { sensor_from_body, camera, frame_rate_hz, phase })
    }
}

/// Returns a quaternion of numbers from a file.
pub(super) fn quaternion(
    key: &str,
    wxyz: [f64; 4],
    check: &Checker<'_>,
) -> Result<Rotation<Sensor, Body>, ConfigError> {
    Rotation::from_wxyz(wxyz, WRITTEN_NORM_TOLERANCE).ok_or_else(|| {
        let wanted = "a unit quaternion [w, x, y, z], norm within 0.001 of 1";
        let advice = "scalar first; [1.0, 0.0, 0.0, 0.0] when sensor and body axes are the same";
        check.invalid(key, format!("{wxyz:?}"), wanted, advice)
    })
}
