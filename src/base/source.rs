//! A source on the sky as a catalog lists it, and directions from right ascension and declination.
//!
//! Directions are unit vectors in ICRF axes at the catalog's epoch.

use crate::source_id::SourceId;
use glam::DVec3;

/// Angular rates of a source across the sky, at the catalog's epoch.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct ProperMotion {
    /// Towards east, including cos(dec), mas per Julian year.
    pub pm_ra_cosdec_mas_yr: f32,
    /// Towards north, mas per Julian year.
    pub pm_dec_mas_yr: f32,
    /// Away from us, as a share of the distance, in the same unit: radial velocity times parallax over 4.74; zero when
    /// it is unknown.
    pub radial_mas_yr: f32,
}

impl ProperMotion {
    /// Returns the total motion across the sky, mas per Julian year.
    pub fn speed_mas_yr(&self) -> f32 {
        self.pm_ra_cosdec_mas_yr.hypot(self.pm_dec_mas_yr)
    }
}

/// One source as the catalog lists it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CatalogSource {
    /// Row in the packed catalog (stable for one file).
    pub id: u32,
    /// Name in the catalog that the star was taken from, where it is known.
    pub source_id: Option<SourceId>,
    /// Barycentric direction at the catalog's epoch, unit vector in ICRF axes.
    pub direction_icrf: DVec3,
    /// Proper motion; `None` when the catalog has none (not the same as zero).
    pub proper_motion: Option<ProperMotion>,
    /// Parallax, mas; `None` when the catalog has none. Negative measurements are stored as zero.
    pub parallax_mas: Option<f32>,
    /// Gaia G magnitude.
    pub mag_g: f32,
    /// Gaia colour BP - RP, mag, clamped to the domain of the published photometric relations (-0.5..5).
    pub bp_rp: f32,
}

/// Returns the right ascension in 0..2 pi and declination (rad) of a direction of any length.
pub fn ra_dec_rad(direction: DVec3) -> [f64; 2] {
    let ra = direction.y.atan2(direction.x).rem_euclid(core::f64::consts::TAU);
    [ra, direction.z.atan2(direction.x.hypot(direction.y))]
}

/// Returns the unit vector towards a right ascension and declination (rad).
pub fn direction_from_ra_dec(ra_rad: f64, dec_rad: f64) -> DVec3 {
    let ((sin_ra, cos_ra), (sin_dec, cos_dec)) = (ra_rad.sin_cos(), dec_rad.sin_cos());
    DVec3::new(cos_dec * cos_ra, cos_dec * sin_ra, sin_dec)
}
