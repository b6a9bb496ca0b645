//! The layer format: header, tile table, checksums, credits, star records. All numbers little-endian.
//!
//! | bytes | content |
//! |---|---|
//! | 0..8 | magic `STARLAY1` |
//! | 8..12 | u32 format version |
//! | 12..16 | u32 HEALPix order of the tiles (nested numbering) |
//! | 16..24 | u64 number of stars |
//! | 24..32 | f64 epoch, Julian year |
//! | 32..40 | f32 x 2: magnitudes from, and below, which the layer was asked to hold |
//! | 40..44 | u32 bytes of credits |
//! | 44..48 | u32 CRC-32 of everything before the records, this field taken as zero |
//! | 48..52 | f32 fastest proper motion, mas/yr |
//! | 52..56 | u32 origin of the stars' numbers ([`crate::numbering::Numbering::mark`]); zero in version 2 |
//! | 56..64 | zero |
//! | then | u64 x (tiles + 1): first star of each tile, and the number of stars |
//! | then | u32 per tile: CRC-32 of its records |
//! | then | version 3: u32 per tile: CRC-32 of its numbers |
//! | then | UTF-8 credits |
//! | then | 16 B per star ([`StarRecord`]), of one tile together, brightest first |
//! | then | version 3: i64 per star: number in its source catalog |
//!
//! The checksum at the head covers the table and the table's checksums cover the records: a layer is opened by reading
//! its head, and every tile is checked when it is read. Places are tangents about the tile's centre ([`TileFrame`]):
//! at order 6 the step is 0.5 mas, and half of it at each order more.

use crate::store::{u32_at, u64_at};
use base::source::direction_from_ra_dec;
use core::f64::consts::FRAC_PI_2;
use glam::DVec3;

/// First bytes of a layer.
pub(super) const MAGIC: [u8; 8] = *b"STARLAY1";
/// Format version of layers with numbers.
pub(super) const VERSION: u32 = 3;
/// Format version of layers without numbers.
pub(super) const VERSION_WITHOUT_NUMBERS: u32 = 2;
/// Bytes of the header.
pub(super) const HEADER_BYTES: usize = 64;
/// Offset of the checksum, bytes.
pub(super) const CRC_AT: usize = 44;
/// Bytes of one star record.
pub(super) const RECORD_BYTES: usize = 16;
/// Bytes of one number.
pub(super) const NUMBER_BYTES: usize = 8;
/// Longest credits, bytes.
pub(super) const LONGEST_CREDITS: usize = 1 << 20;
/// Coarsest tiles: coordinates have steps of half a milliarcsecond.
pub(super) const LEAST_ORDER: u8 = 6;
/// Finest tiles: the table has 150 MB.
pub(super) const MOST_ORDER: u8 = 10;
/// Stars that a mean tile should have.
const STARS_PER_TILE: u64 = 256;

/// Colour field of a star whose colour is unknown.
pub(super) const NO_COLOUR: i16 = i16::MIN;
/// Step of a parallax, mas.
pub(super) const PARALLAX_STEP_MAS: f64 = 0.02;
/// Both proper-motion fields of a star whose motion is unknown.
pub(super) const NO_MOTION: i16 = i16::MIN;
/// Step of a slow proper motion, mas/yr.
const SLOW_STEP_MAS_YR: f64 = 0.05;
/// Slow steps; what is beyond has fast steps.
const SLOW_STEPS: f64 = 28_000.0;
/// Step of a fast proper motion (beyond 1.4 arcsec/yr), mas/yr.
const FAST_STEP_MAS_YR: f64 = 2.5;
/// Fastest proper motion that can be stored, mas/yr: Barnard's star has 10,390.
pub const FASTEST_MAS_YR: f64 = 13_000.0;
/// A tile's reach in tangents, times the number of cells along a side: no point of a cell is further from its centre in
/// either axis (`every_point_of_a_tile_is_within_its_reach`).
const REACH: f64 = 1.25;
/// Steps of a coordinate.
const COORDINATE_STEPS: f64 = 16_777_216.0;

/// Returns tiles of the sphere at an order.
pub fn tiles_of(order: u8) -> usize {
    12 << (2 * order)
}

/// Returns the order at which so many stars make tiles of a handy size.
pub fn order_for(stars: u64) -> u8 {
    let enough = |order: &u8| tiles_of(*order) as u64 * STARS_PER_TILE >= stars;
    (LEAST_ORDER..MOST_ORDER).find(enough).unwrap_or(MOST_ORDER)
}

/// The facts at the head of a layer.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Header {
    pub(super) version: u32,
    pub(super) order: u32,
    pub(super) stars: u64,
    pub(super) epoch_yr: f64,
    /// From, and below.
    pub(super) magnitudes: [f32; 2],
    pub(super) credits_bytes: u32,
    pub(super) crc32: u32,
    pub(super) fastest_mas_yr: f32,
    pub(super) numbering_mark: u32,
}

impl Header {
    pub(super) fn to_bytes(self) -> [u8; HEADER_BYTES] {
        let mut bytes = [0; HEADER_BYTES];
        bytes[0..8].copy_from_slice(&MAGIC);
        bytes[8..12].copy_from_slice(&self.version.to_le_bytes());
        bytes[12..16].copy_from_slice(&self.order.to_le_bytes());
        bytes[16..24].copy_from_slice(&self.stars.to_le_bytes());
        bytes[24..32].copy_from_slice(&self.epoch_yr.to_le_bytes());
        bytes[32..36].copy_from_slice(&self.magnitudes[0].to_le_bytes());
        bytes[36..40].copy_from_slice(&self.magnitudes[1].to_le_bytes());
        bytes[40..44].copy_from_slice(&self.credits_bytes.to_le_bytes());
        bytes[CRC_AT..CRC_AT + 4].copy_from_slice(&self.crc32.to_le_bytes());
        bytes[48..52].copy_from_slice(&self.fastest_mas_yr.to_le_bytes());
        bytes[52..56].copy_from_slice(&self.numbering_mark.to_le_bytes());
        bytes
    }

    /// Reads everything but the magic, which the caller has checked.
    pub(super) fn from_bytes(bytes: &[u8; HEADER_BYTES]) -> Self {
        Self {
            version: u32_at(bytes, 8),
            order: u32_at(bytes, 12),
            stars: u64_at(bytes, 16),
            epoch_yr: f64::from_bits(u64_at(bytes, 24)),
            magnitudes: [f32::from_bits(u32_at(bytes, 32)), f32::from_bits(u32_at(bytes, 36))],
            credits_bytes: u32_at(bytes, 40),
            crc32: u32_at(bytes, CRC_AT),
            fastest_mas_yr: f32::from_bits(u32_at(bytes, 48)),
            numbering_mark: u32_at(bytes, 52),
        }
    }
}

/// One star as stored, in steps of each field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StarRecord {
    /// Eastward and northward tangent about the tile's centre, 24 bits each.
    pub(super) place: [u32; 2],
    /// G magnitude above -2 in [`MAG_STEP`](crate::store::MAG_STEP).
    pub(super) g: u16,
    /// BP - RP, likewise; [`NO_COLOUR`] when unknown.
    pub(super) bp_rp: i16,
    /// Proper motion eastward (with cos dec) and northward; [`NO_MOTION`] when unknown.
    pub(super) motion: [i16; 2],
    /// Parallax, [`PARALLAX_STEP_MAS`]; [`NO_PARALLAX`](crate::store::NO_PARALLAX) when unknown.
    pub(super) parallax: u16,
}

impl StarRecord {
    pub(super) fn to_bytes(self) -> [u8; RECORD_BYTES] {
        let mut bytes = [0; RECORD_BYTES];
        bytes[0..3].copy_from_slice(&self.place[0].to_le_bytes()[..3]);
        bytes[3..6].copy_from_slice(&self.place[1].to_le_bytes()[..3]);
        bytes[6..8].copy_from_slice(&self.g.to_le_bytes());
        bytes[8..10].copy_from_slice(&self.bp_rp.to_le_bytes());
        bytes[10..12].copy_from_slice(&self.motion[0].to_le_bytes());
        bytes[12..14].copy_from_slice(&self.motion[1].to_le_bytes());
        bytes[14..16].copy_from_slice(&self.parallax.to_le_bytes());
        bytes
    }

    pub(super) fn from_bytes(b: &[u8; RECORD_BYTES]) -> Self {
        let i16_at = |at: usize| i16::from_le_bytes([b[at], b[at + 1]]);
        Self {
            place: [u32::from_le_bytes([b[0], b[1], b[2], 0]), u32::from_le_bytes([b[3], b[4], b[5], 0])],
            g: u16::from_le_bytes([b[6], b[7]]),
            bp_rp: i16_at(8),
            motion: [i16_at(10), i16_at(12)],
            parallax: u16::from_le_bytes([b[14], b[15]]),
        }
    }

    /// Returns the proper motion eastward (with cos dec) and northward, mas/yr, where it is known.
    pub(super) fn motion_mas_yr(&self) -> Option<[f64; 2]> {
        (!self.motion.contains(&NO_MOTION)).then(|| self.motion.map(motion_mas_yr))
    }

    /// Returns the total proper motion, mas/yr; 0 when it is unknown.
    pub(super) fn speed_mas_yr(&self) -> f64 {
        self.motion_mas_yr().map_or(0.0, |[east, north]| east.hypot(north))
    }
}

/// Returns a proper motion in stored steps: 0.05 mas/yr up to 1.4 arcsec/yr, 2.5 mas/yr beyond.
#[allow(clippy::cast_possible_truncation, reason = "float-to-int casts saturate")]
pub(super) fn motion_steps(mas_yr: f64) -> i16 {
    let slow = mas_yr.abs() / SLOW_STEP_MAS_YR;
    let fast = SLOW_STEPS + (mas_yr.abs() - SLOW_STEPS * SLOW_STEP_MAS_YR) / FAST_STEP_MAS_YR;
    (if slow <= SLOW_STEPS { slow } else { fast }).round().copysign(mas_yr) as i16
}

/// Returns the motion of steps, mas/yr.
pub(super) fn motion_mas_yr(steps: i16) -> f64 {
    let size = f64::from(steps).abs();
    let mas_yr = size.min(SLOW_STEPS) * SLOW_STEP_MAS_YR + (size - SLOW_STEPS).max(0.0) * FAST_STEP_MAS_YR;
    mas_yr.copysign(f64::from(steps))
}

/// The axes about the centre of a tile.
#[derive(Debug, Clone, Copy)]
pub(super) struct TileFrame {
    centre: DVec3,
    east: DVec3,
    north: DVec3,
    reach: f64,
}

impl TileFrame {
    pub(super) fn new(order: u8, tile: u64) -> Self {
        let (lon_rad, lat_rad) = crate::healpix::centre(order, tile);
        let centre = direction_from_ra_dec(lon_rad, lat_rad);
        let east = direction_from_ra_dec(lon_rad + FRAC_PI_2, 0.0);
        Self { centre, east, north: centre.cross(east), reach: REACH / f64::from(1_u32 << order) }
    }

    /// Returns a direction of the tile in steps.
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "float-to-int casts saturate")]
    pub(super) fn steps(&self, direction: DVec3) -> [u32; 2] {
        let ahead = direction.dot(self.centre);
        let steps = |axis: DVec3| {
            let tangent = direction.dot(axis) / ahead;
            ((tangent / self.reach + 1.0) * 0.5 * COORDINATE_STEPS).round().clamp(0.0, COORDINATE_STEPS - 1.0) as u32
        };
        [steps(self.east), steps(self.north)]
    }

    /// Returns the direction of steps, a unit vector.
    pub(super) fn direction(&self, steps: [u32; 2]) -> DVec3 {
        let tangent = |steps: u32| (f64::from(steps) / (0.5 * COORDINATE_STEPS) - 1.0) * self.reach;
        (self.centre + self.east * tangent(steps[0]) + self.north * tangent(steps[1])).normalize()
    }
}

/// Returns the CRC-32 of the head: IEEE 802.3 (polynomial 0xEDB88320 reflected), its own field taken as zero.
pub(super) fn head_crc32(head: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&head[..CRC_AT]);
    hasher.update(&[0; 4]);
    hasher.update(&head[CRC_AT + 4..]);
    hasher.finalize()
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::{source::ra_dec_rad, units::MAS};

    #[test]
    fn header_and_record_round_trip() {
        let header = Header {
            version: VERSION,
            order: 8,
            stars: 1 << 40,
            epoch_yr: 2016.0,
            magnitudes: [10.0, 14.0],
            credits_bytes: 9,
            crc32: 0xDEAD_BEEF,
            fastest_mas_yr: 10_393.0,
            numbering_mark: 0x102,
        };
        assert_eq!(Header::from_bytes(&header.to_bytes()), header);
        let star = StarRecord { place: [1, 0x00FE_DCBA], g: 9000, bp_rp: -300, motion: [-7, 28_005], parallax: 12 };
        assert_eq!(StarRecord::from_bytes(&star.to_bytes()), star);
    }

    #[test]
    fn proper_motions_come_back_within_half_a_step() {
        for mas_yr in [0.0, 0.024, -0.026, 3.3, -1399.98, 1400.0, 1401.0, -1402.6, 10_393.0, -FASTEST_MAS_YR] {
            let back = motion_mas_yr(motion_steps(mas_yr));
            let half_step = if mas_yr.abs() <= 1400.0 { 0.025 } else { 1.25 };
            assert!((back - mas_yr).abs() <= half_step + 1e-9, "{mas_yr}: {back}");
        }
        let steps = |mas_yr: f64| i32::from(motion_steps(mas_yr));
        assert!(steps(FASTEST_MAS_YR) < i32::from(i16::MAX), "the fastest is not the limit of the type");
        assert!(steps(-FASTEST_MAS_YR) > i32::from(NO_MOTION), "nor the mark of what is unknown");
    }

    #[test]
    fn orders_follow_the_number_of_stars() {
        assert_eq!([0, 12_000_000, 13_000_000, 300_000_000, 1_500_000_000].map(order_for), [6, 6, 7, 9, 10]);
    }

    /// Directions all over the sphere, more of them about poles and where cells change their shape.
    fn directions() -> impl Iterator<Item = DVec3> {
        let golden = core::f64::consts::PI * (3.0 - 5.0_f64.sqrt());
        let spiral = (0..200_000).map(move |i| {
            let z = 1.0 - (f64::from(i) + 0.5) / 100_000.0;
            direction_from_ra_dec(golden * f64::from(i), z.asin())
        });
        let edges = [89.999, 89.5, 66.0, 41.81, 41.80, 0.01, 0.0].into_iter().flat_map(|dec: f64| {
            (0..3600).flat_map(move |i| {
                [dec, -dec].map(|dec| direction_from_ra_dec((f64::from(i) / 10.0).to_radians(), dec.to_radians()))
            })
        });
        spiral.chain(edges)
    }

    #[test]
    fn every_point_of_a_tile_is_within_its_reach() {
        for order in [LEAST_ORDER, 8, MOST_ORDER] {
            let mut furthest: f64 = 0.0;
            for direction in directions() {
                let [ra, dec] = ra_dec_rad(direction);
                let frame = TileFrame::new(order, crate::healpix::cell(order, ra, dec));
                let ahead = direction.dot(frame.centre);
                for axis in [frame.east, frame.north] {
                    furthest = furthest.max((direction.dot(axis) / ahead).abs() / frame.reach);
                }
                let back = frame.direction(frame.steps(direction));
                let off_mas = (back - direction).length() / MAS;
                // Half a step in each axis: 2 * 1.25 / 64 / 2^24 rad is 0.48 mas at order 6.
                let most_mas = 0.36 / f64::from(1 << (order - LEAST_ORDER));
                assert!(off_mas <= most_mas, "order {order}: {off_mas} mas at {ra} {dec}");
            }
            assert!(furthest < 0.999, "order {order}: {furthest}");
            assert!(furthest > 0.7, "control: no longer than it must be: {furthest}");
        }
    }
}
