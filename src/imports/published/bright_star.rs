//! A star of a catalog brighter and older than Gaia's, at its epoch and moved to another.

use base::{source::ra_dec_rad, units::MAS};
use glam::DVec3;
use stars::layer::NewStar;

/// A star as Hipparcos or Tycho-2 has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BrightStar {
    /// Minus the Hipparcos number, or -(10^12 + 10^6 TYC1 + 10 TYC2 + TYC3): Gaia's numbers are positive.
    pub source_id: i64,
    /// Direction at its epoch, unit vector.
    pub direction_icrf: DVec3,
    /// Julian year of the direction.
    pub epoch_yr: f64,
    /// Proper motion eastward (with cos dec) and northward, mas/yr, where it is known.
    pub motion_mas_yr: Option<[f64; 2]>,
    /// Parallax, mas, where it is known.
    pub parallax_mas: Option<f32>,
    /// G magnitude by the bands that were measured.
    pub mag_g: f32,
    /// BP - RP by them, where both are known.
    pub bp_rp: Option<f32>,
    /// How far Gaia's magnitude of the same star may be from it (`crossmatch`), mag.
    pub tolerance_mag: f32,
}

impl BrightStar {
    /// Returns the star at a Julian year, as a layer takes it.
    pub fn at(&self, epoch_yr: f64) -> NewStar {
        let (direction, motion_mas_yr) = moved(self.direction_icrf, self.motion_mas_yr, epoch_yr - self.epoch_yr);
        let [ra_rad, dec_rad] = ra_dec_rad(direction);
        NewStar {
            source_id: self.source_id,
            ra_rad,
            dec_rad,
            motion_mas_yr,
            parallax_mas: self.parallax_mas.map(f64::from),
            mag_g: f64::from(self.mag_g),
            bp_rp: self.bp_rp.map(f64::from),
        }
    }
}

/// Returns direction and proper motion `years` later: uniform straight motion in space, as `sky::astrometry::at_epoch`;
/// what is eastward there may not be here (Polaris). A star without a motion stays.
pub(super) fn moved(direction: DVec3, motion_mas_yr: Option<[f64; 2]>, years: f64) -> (DVec3, Option<[f64; 2]>) {
    let Some([east_mas_yr, north_mas_yr]) = motion_mas_yr else { return (direction, None) };
    let [east, north] = east_and_north(direction);
    let rate = east * east_mas_yr + north * north_mas_yr;
    let later = (direction + rate * (years * MAS)).normalize();
    (later, Some(east_and_north(later).map(|axis| rate.dot(axis))))
}

fn east_and_north(direction: DVec3) -> [DVec3; 2] {
    let east = DVec3::new(-direction.y, direction.x, 0.0).normalize_or(DVec3::Y);
    [east, direction.cross(east)]
}
