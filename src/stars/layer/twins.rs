//! Rows of a tile in the order of a layer -> those whose number a brighter row of the tile has, at the same place.
//!
//! A star that two files have, or one file twice with other values, is one star. Only the
//! [`MOST_KEPT`] brightest stars of a tile are compared, and a pair that lies across the edge of two tiles is not found.
//! Tests: [`super::tests`].

use super::star::WaitingRow;
use crate::numbering::NO_NUMBER;
use base::units::ARCSEC;
use std::collections::BTreeMap;

/// Stars of a tile that are compared.
const MOST_KEPT: usize = 8192;
/// Largest distance of two places of one star.
const NEAR_RAD: f64 = 10.0 * ARCSEC;

/// The stars of a tile so far, by their numbers.
#[derive(Debug, Default)]
pub(super) struct Twins {
    tile: u64,
    places: BTreeMap<i64, [f64; 2]>,
    /// Rows that were left out.
    pub(super) count: u64,
    /// Number of the first of them.
    pub(super) first: Option<i64>,
}

impl Twins {
    /// Returns whether a row is of a star that was there before; counts it.
    pub(super) fn is_known(&mut self, tile: u64, row: &WaitingRow) -> bool {
        if row.source_id == NO_NUMBER {
            return false;
        }
        if tile != self.tile {
            (self.tile, self.places) = (tile, BTreeMap::new());
        }
        let [ra_rad, dec_rad] = row.place_rad();
        if let Some([known_ra_rad, known_dec_rad]) = self.places.get(&row.source_id) {
            let turn = (ra_rad - known_ra_rad).rem_euclid(core::f64::consts::TAU);
            let east_rad = turn.min(core::f64::consts::TAU - turn) * dec_rad.cos();
            let is_near = east_rad.hypot(dec_rad - known_dec_rad) < NEAR_RAD;
            self.count += u64::from(is_near);
            self.first = self.first.or(is_near.then_some(row.source_id));
            return is_near;
        }
        if self.places.len() < MOST_KEPT {
            self.places.insert(row.source_id, [ra_rad, dec_rad]);
        }
        false
    }
}
