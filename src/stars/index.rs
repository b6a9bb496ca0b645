//! Index of a store of stars, known before a star is read: the facts at its head, and where the stars of each tile are.

use crate::{cover::cells_of_cone, numbering::Numbering};
use base::{source_id::SourceId, units::MAS};
use core::ops::Range;
use glam::DVec3;

/// Added to a cone: stars at a cell's edge may be stored half a step beyond it, rad.
const ROUNDING_RAD: f64 = MAS;

/// The facts of one store of stars, a catalog in memory or a layer on disk, and its tiles.
#[derive(Debug, Clone)]
pub struct StarIndex {
    /// Julian year to which the positions refer.
    pub epoch_yr: f64,
    /// Magnitudes (Gaia G) from, and below, which it holds stars; minus infinity: no bright star is missing.
    pub magnitudes: [f32; 2],
    /// No star is faster, mas/yr.
    pub fastest_mas_yr: f64,
    /// Its fingerprint in reports: the checksum at its head.
    pub crc32: u32,
    /// Credits its stars ask for.
    pub credits: String,
    /// How the numbers of its stars are to be read; `None`: it has none.
    pub numbering: Option<Numbering>,
    /// HEALPix order of its tiles, nested numbering.
    pub order: u8,
    /// Place of the first star of each tile, and the number of stars.
    pub(crate) firsts: Vec<u64>,
}

impl StarIndex {
    /// Returns stars in it.
    pub fn stars(&self) -> u64 {
        self.firsts.last().copied().unwrap_or(0)
    }

    /// Returns how many stars each tile has, in nested order.
    pub fn stars_of_tiles(&self) -> impl Iterator<Item = u64> {
        self.firsts.windows(2).map(|pair| pair[1] - pair[0])
    }

    /// Returns places of a tile's stars in the store.
    pub fn places(&self, tile: u64) -> Range<u64> {
        let tile = usize::try_from(tile).unwrap_or(usize::MAX);
        self.firsts[tile]..self.firsts[tile + 1]
    }

    /// Returns stars of one tile.
    pub fn stars_of_tile(&self, tile: u64) -> u64 {
        let places = self.places(tile);
        places.end - places.start
    }

    /// Returns the tile that has the star at this place of the store.
    pub(crate) fn tile_of(&self, place: u64) -> Option<u64> {
        (place < self.stars()).then(|| self.firsts.partition_point(|first| *first <= place) as u64 - 1)
    }

    /// Calls `take` with every tile that may have stars within `radius_rad` of `axis` (a unit vector), ascending. A
    /// radius that is not a number or negative gives none.
    pub fn tiles_of_cone(&self, axis: DVec3, radius_rad: f64, mut take: impl FnMut(u64)) {
        if radius_rad < 0.0 {
            return;
        }
        cells_of_cone(self.order, axis, radius_rad + ROUNDING_RAD, |tile| {
            if self.stars_of_tile(tile) > 0 {
                take(tile);
            }
        });
    }

    /// Returns the name in its source catalog of the star with a stored number.
    pub fn source_id(&self, number: i64) -> Option<SourceId> {
        self.numbering?.source_id(number)
    }
}
