//! Index of a store of stars, known before a star is read: the facts at its head, and where the stars of each tile are.
//!
//! *Records.* Steps in which packed catalogs and layers store magnitudes, colours and parallaxes, and the star that a
//! record makes.

use crate::{healpix::cells_of_cone, numbering::Numbering, radial_velocity::radial_mas_yr};
use base::source::{CatalogSource, ProperMotion};
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
