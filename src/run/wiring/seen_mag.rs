//! The faintest star that a camera sees, and the magnitude down to which `radiometry.limiting_mag = "auto"` draws.
//!
//! Seen is a star of the Sun's colour whose sum over the best window has an SNR of 3 in one frame, as `starloop snr`
//! prints it: without motion, sky of the pointing or stray light. Drawn is half a magnitude more, for redder stars and
//! for the sum of those that are hardly seen, rounded up to a tenth: the last bits of a machine's mathematical library
//! do not count. No fainter star is drawn than the catalog has, nor more than fit into memory.

use crate::wiring::sensitivity::{Conditions, Sensitivity};
use base::refused::Refused;
use config::Bench;
use scene::camera::CameraParams;
use stars::{FieldMemory, Sky};

/// SNR of the faintest star that counts as seen.
pub const SEEN_SNR: f64 = 3.0;
/// Colour of the star, BP-RP: the Sun's.
const SEEN_BP_RP: f64 = 0.82;
/// Magnitudes that are drawn beyond what is seen.
const MARGIN_MAG: f64 = 0.5;
/// Steps of magnitude.
const STEPS_PER_MAG: f64 = 10.0;
/// Magnitudes within which "auto" stays, as those that a file gives.
const RANGE_MAG: [f64; 2] = [-2.0, 25.0];

/// Returns the sensitivity of a camera for stars of the Sun's colour.
pub fn sensitivity_for_suns(camera: &CameraParams) -> Sensitivity {
    Sensitivity::new(camera, &Conditions { bp_rp: SEEN_BP_RP, ..Conditions::default() })
}

/// Returns the G magnitude of the faintest star that the camera sees; `None` when it sees none.
pub fn seen_mag(camera: &CameraParams) -> Option<f64> {
    sensitivity_for_suns(camera).limiting_mag(SEEN_SNR)
}

/// Returns the magnitude down to which "auto" draws, whatever the catalog has.
pub(crate) fn auto_limiting_mag(camera: &CameraParams) -> f64 {
    let [brightest, faintest] = RANGE_MAG;
    let drawn = seen_mag(camera).unwrap_or(brightest) + MARGIN_MAG;
    ((drawn * STEPS_PER_MAG).ceil() / STEPS_PER_MAG).clamp(brightest, faintest)
}

/// Bounds the magnitude of "auto" by the bench's catalog and by the memory for its stars.
///
/// # Errors
/// When a layer cannot be read or is damaged, or the layers do not make one sky.
pub(crate) fn bound_by_catalog(camera: &mut CameraParams, bench: &Bench) -> Result<(), Refused> {
    if bench.camera.radiometry.limiting_mag.is_some() {
        return Ok(());
    }
    let field = FieldMemory { radius_rad: camera.geometry.half_diagonal_rad(), memory_mb: bench.star_memory_mb };
    camera.limiting_mag = Sky::faintest(&bench.layers, camera.limiting_mag, field)?;
    Ok(())
}
