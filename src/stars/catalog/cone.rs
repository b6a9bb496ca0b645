//! Axis, radius, limiting magnitude -> the sources inside.
//!
//! Each tile is bounded by the smallest circle about its HEALPix centre that holds its own stars, measured when the
//! catalog is opened; so the choice of tiles is exact whatever the shape of a HEALPix cell. Within a tile, stars are
//! sorted by magnitude and the cut is a prefix. All angles are compared as squared chords, which stay exact for cones
//! of milliarcseconds. Test: `cone_agrees_with_brute_force`.

use super::Catalog;
use super::error::CatalogError;
use super::layout::TILE_ORDER;
use base::source::{CatalogSource, direction_from_ra_dec};
use core::f64::consts::PI;
use core::ops::Range;
use glam::DVec3;

/// Added to a tile's radius for the rounding of chords, rad (a few ulp of 1).
const ROUNDING_RAD: f64 = 1e-14;

/// Stars of one HEALPix cell, brightest first.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Tile {
    centre: DVec3,
    radius_rad: f64,
    stars: Range<usize>,
}

impl Tile {
    pub(super) fn new(tile: usize, first: usize, end: usize, all: &[CatalogSource]) -> Result<Self, CatalogError> {
        let refuse = |why: String| CatalogError::Tile { tile, why };
        let members = all.get(first..end).ok_or_else(|| refuse(format!("stars {first}..{end} of {}", all.len())))?;
        if !members.is_sorted_by(|a, b| a.mag_g <= b.mag_g) {
            return Err(refuse("stars are not sorted by magnitude".into()));
        }
        let (lon_rad, lat_rad) = cdshealpix::nested::center(TILE_ORDER, tile as u64);
        let centre = direction_from_ra_dec(lon_rad, lat_rad);
        let chord2 = members.iter().map(|s| s.direction_icrf.distance_squared(centre)).fold(0.0, f64::max);
        let radius_rad = 2.0 * (chord2.sqrt() / 2.0).min(1.0).asin() + ROUNDING_RAD;
        Ok(Self { centre, radius_rad, stars: first..end })
    }

    fn touches(&self, axis: DVec3, radius_rad: f64) -> bool {
        !self.stars.is_empty() && self.centre.distance_squared(axis) <= chord_squared(radius_rad + self.radius_rad)
    }
}

impl Catalog {
    /// Replaces `out` by the sources within `radius_rad` of `axis` (any length) at the catalog's epoch and not fainter
    /// than `limiting_mag` (Gaia G), in the catalog's order. An axis or radius that is not a number, or a negative
    /// radius, gives no source; a radius of pi or more gives the whole sky.
    ///
    /// Allocates only when `out` must grow.
    pub fn cone(&self, axis: DVec3, radius_rad: f64, limiting_mag: f32, out: &mut Vec<CatalogSource>) {
        out.clear();
        let Some(axis) = axis.try_normalize().filter(|_| radius_rad >= 0.0) else { return };
        let chord2 = chord_squared(radius_rad);
        for tile in self.tiles.iter().filter(|tile| tile.touches(axis, radius_rad)) {
            let stars = &self.sources[tile.stars.clone()];
            let bright = &stars[..stars.partition_point(|star| star.mag_g <= limiting_mag)];
            out.extend(bright.iter().filter(|star| star.direction_icrf.distance_squared(axis) <= chord2));
        }
    }
}

/// Squared chord of an angle on the unit sphere; more than any chord from pi on.
#[must_use]
pub fn chord_squared(angle_rad: f64) -> f64 {
    if angle_rad >= PI { f64::INFINITY } else { 4.0 * (angle_rad / 2.0).sin().powi(2) }
}
