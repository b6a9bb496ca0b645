//! Steps in which packed catalogs and layers store magnitudes, colours and parallaxes, and the star that a record
//! makes.

use crate::radial_velocity::radial_mas_yr;
use base::source::{CatalogSource, ProperMotion};
use base::source_id::SourceId;
use glam::DVec3;

/// Step of a magnitude or colour, mag.
pub(crate) const MAG_STEP: f64 = 1e-3;
/// Magnitude stored as zero.
pub(crate) const MAG_ZERO: f64 = -2.0;
/// Faintest magnitude that can be stored.
pub(crate) const FAINTEST_MAG: f64 = 60.0;
/// Parallax field of a star whose parallax is unknown.
pub(crate) const NO_PARALLAX: u16 = u16::MAX;
/// BP - RP outside this range is clamped, mag: the domain of the Gaia DR3 photometric relations (Gaia DR3
/// documentation, section 5.5.1), beyond which their cubics run away. 199 of the built-in catalog's stars are redder
/// and 2 bluer.
pub(crate) const COLOUR_DOMAIN_MAG: [f64; 2] = [-0.5, 5.0];

/// Returns the G magnitude of a stored field.
pub(crate) fn mag_of(steps: u16) -> f64 {
    f64::from(steps) * MAG_STEP + MAG_ZERO
}

/// Returns the star of a record, with the motion (eastward with cos dec, northward) and the parallax that are known,
/// and the magnitude and colour.
#[allow(clippy::cast_possible_truncation, reason = "an f32 holds every step of these fields to 1e-7 of itself")]
pub(crate) fn source(
    (id, source_id): (u32, Option<SourceId>),
    direction_icrf: DVec3,
    motion_mas_yr: Option<[f64; 2]>,
    parallax_mas: Option<f64>,
    [mag_g, bp_rp]: [f64; 2],
) -> CatalogSource {
    let parallax_mas = parallax_mas.map(|mas| mas as f32);
    let proper_motion = motion_mas_yr.map(|rates| {
        let [east, north] = rates.map(|mas_yr| mas_yr as f32);
        let radial_mas_yr = radial_mas_yr(source_id, east.hypot(north), parallax_mas);
        ProperMotion { pm_ra_cosdec_mas_yr: east, pm_dec_mas_yr: north, radial_mas_yr }
    });
    let (mag_g, bp_rp) = (mag_g as f32, bp_rp as f32);
    CatalogSource { id, source_id, direction_icrf, proper_motion, parallax_mas, mag_g, bp_rp }
}

/// Returns the nearest step, of a number that the caller knows to be in range.
#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked to be in range by the caller")]
pub(crate) fn nearest_u16(steps: f64) -> u16 {
    steps.round() as u16
}

/// Returns the same with a sign.
#[allow(clippy::cast_possible_truncation, reason = "checked to be in range by the caller")]
pub(crate) fn nearest_i16(steps: f64) -> i16 {
    steps.round() as i16
}

/// Returns the u32 that begins at byte `at`, which the caller knows to be inside; little-endian.
pub(crate) fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

/// Returns the u64, likewise.
pub(crate) fn u64_at(bytes: &[u8], at: usize) -> u64 {
    u64::from(u32_at(bytes, at)) | u64::from(u32_at(bytes, at + 4)) << 32
}
