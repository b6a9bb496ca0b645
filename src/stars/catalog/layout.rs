//! The packed format: header, tile offsets, star records, parallaxes, credits. All numbers little-endian.
//!
//! | bytes | content |
//! |---|---|
//! | 0..8 | magic `STARCAT1` |
//! | 8..12 | u32 format version |
//! | 12..16 | u32 HEALPix order of the tiles (nested numbering) |
//! | 16..20 | u32 number of stars |
//! | 20..24 | u32 bytes of credits |
//! | 24..32 | f64 epoch, Julian year |
//! | 32..36 | u32 CRC-32 of all other bytes of the file |
//! | 36..40 | u32 origin of the stars' numbers ([`crate::numbering::Numbering::mark`]) |
//! | then | u32 x (tiles + 1): first star of each tile, and the number of stars |
//! | then | 20 B per star: u32 ra, i32 dec, i32 pm ra, i32 pm dec, u16 G, i16 BP-RP ([`StarRecord`]) |
//! | then | u16 per star: parallax |
//! | then | i64 per star: number in its source catalog |
//! | then | UTF-8 credits |
//!
//! Version 1 stored proper motions of 16 bits in steps of 0.5 mas/yr, which cost up to 12 mas by 2050, and no numbers.
//!
//! Stars of one tile are sorted by magnitude, so that a brightness cut is a prefix of the tile.

use crate::store::{u32_at, u64_at};
use core::f64::consts::{PI, TAU};

/// First bytes of a packed catalog.
pub(super) const MAGIC: [u8; 8] = *b"STARCAT1";
/// Format version read and written.
pub(super) const VERSION: u32 = 2;
/// HEALPix order of the tiles.
pub(super) const TILE_ORDER: u8 = 4;
/// Tiles of the sphere at [`TILE_ORDER`].
pub(super) const TILES: usize = 12 << (2 * TILE_ORDER);
/// Bytes of the header.
pub(super) const HEADER_BYTES: usize = 40;
/// Most stars of a packed catalog, which is held in memory: layers have more.
pub(super) const MOST_STARS: usize = 20_000_000;
/// Longest packed catalog, bytes: as many stars, and a megabyte of credits.
pub(super) const MOST_BYTES: u64 = (MOST_STARS * (RECORD_BYTES + PARALLAX_BYTES + NUMBER_BYTES) + (2 << 20)) as u64;
/// Offset of the checksum, bytes.
pub(super) const CRC_AT: usize = 32;
/// Bytes of one star record.
pub(super) const RECORD_BYTES: usize = 20;
/// Bytes of one parallax.
pub(super) const PARALLAX_BYTES: usize = 2;
/// Bytes of one number.
pub(super) const NUMBER_BYTES: usize = 8;

/// Photometric bands of every packed catalog.
pub const BANDS: &str = "Gaia DR3 G, and BP - RP (Vega system)";

/// Step of a proper motion, mas/yr.
pub(super) const PM_STEP_MAS_YR: f64 = 0.001;
/// Fastest proper motion in either axis, mas/yr: twice that of Barnard's star, and far below the field's limit.
pub(super) const FASTEST_MAS_YR: f64 = 20_000.0;
/// Step of a parallax, mas.
pub(super) const PARALLAX_STEP_MAS: f64 = 0.05;
/// Both proper-motion fields of a star whose motion is unknown.
pub(super) const NO_PROPER_MOTION: i32 = i32::MIN;
/// Radians in one step of right ascension.
pub(super) const RA_STEP_RAD: f64 = TAU / 4_294_967_296.0;
/// Radians in one step of declination.
pub(super) const DEC_STEP_RAD: f64 = PI / 4_294_967_296.0;

/// The facts at the head of a packed catalog.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Header {
    pub(super) version: u32,
    pub(super) order: u32,
    pub(super) stars: u32,
    pub(super) credits_bytes: u32,
    pub(super) epoch_yr: f64,
    pub(super) crc32: u32,
    /// Origin of the stars' numbers.
    pub(super) numbering_mark: u32,
}

impl Header {
    pub(super) fn to_bytes(self) -> [u8; HEADER_BYTES] {
        let mut bytes = [0; HEADER_BYTES];
        bytes[0..8].copy_from_slice(&MAGIC);
        bytes[8..12].copy_from_slice(&self.version.to_le_bytes());
        bytes[12..16].copy_from_slice(&self.order.to_le_bytes());
        bytes[16..20].copy_from_slice(&self.stars.to_le_bytes());
        bytes[20..24].copy_from_slice(&self.credits_bytes.to_le_bytes());
        bytes[24..32].copy_from_slice(&self.epoch_yr.to_le_bytes());
        bytes[CRC_AT..36].copy_from_slice(&self.crc32.to_le_bytes());
        bytes[36..40].copy_from_slice(&self.numbering_mark.to_le_bytes());
        bytes
    }

    /// Reads everything but the magic, which the caller has checked.
    pub(super) fn from_bytes(bytes: &[u8; HEADER_BYTES]) -> Self {
        Self {
            version: u32_at(bytes, 8),
            order: u32_at(bytes, 12),
            stars: u32_at(bytes, 16),
            credits_bytes: u32_at(bytes, 20),
            epoch_yr: f64::from_bits(u64_at(bytes, 24)),
            crc32: u32_at(bytes, CRC_AT),
            numbering_mark: u32_at(bytes, 36),
        }
    }
}

/// One star as stored, in steps of each field.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct StarRecord {
    /// Right ascension, 2^32 steps per turn.
    pub(super) ra: u32,
    /// Declination, 2^32 steps per half turn; +90 degrees is stored as the last step below it.
    pub(super) dec: i32,
    /// Proper motion in right ascension with cos(dec), [`PM_STEP_MAS_YR`]; [`NO_PROPER_MOTION`] when unknown.
    pub(super) pm_ra: i32,
    /// Proper motion in declination, likewise.
    pub(super) pm_dec: i32,
    /// G magnitude above -2 in [`MAG_STEP`](crate::store::MAG_STEP).
    pub(super) g: u16,
    /// BP - RP, likewise.
    pub(super) bp_rp: i16,
    /// Parallax, [`PARALLAX_STEP_MAS`]; [`NO_PARALLAX`](crate::store::NO_PARALLAX) when unknown. Stored in its own
    /// column.
    pub(super) parallax: u16,
}

impl StarRecord {
    pub(super) fn to_bytes(self) -> [u8; RECORD_BYTES] {
        let mut bytes = [0; RECORD_BYTES];
        bytes[0..4].copy_from_slice(&self.ra.to_le_bytes());
        bytes[4..8].copy_from_slice(&self.dec.to_le_bytes());
        bytes[8..12].copy_from_slice(&self.pm_ra.to_le_bytes());
        bytes[12..16].copy_from_slice(&self.pm_dec.to_le_bytes());
        bytes[16..18].copy_from_slice(&self.g.to_le_bytes());
        bytes[18..20].copy_from_slice(&self.bp_rp.to_le_bytes());
        bytes
    }

    pub(super) fn from_bytes(record: &[u8; RECORD_BYTES], parallax: [u8; PARALLAX_BYTES]) -> Self {
        let b = record;
        Self {
            ra: u32_at(b, 0),
            dec: u32_at(b, 4).cast_signed(),
            pm_ra: u32_at(b, 8).cast_signed(),
            pm_dec: u32_at(b, 12).cast_signed(),
            g: u16::from_le_bytes([b[16], b[17]]),
            bp_rp: i16::from_le_bytes([b[18], b[19]]),
            parallax: u16::from_le_bytes(parallax),
        }
    }
}

/// Returns the CRC-32 of a packed file: IEEE 802.3 (polynomial 0xEDB88320 reflected), over all bytes but the stored
/// checksum.
pub(super) fn file_crc32(bytes: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&bytes[..CRC_AT]);
    hasher.update(&bytes[CRC_AT + 4..]);
    hasher.finalize()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn header_and_record_round_trip() {
        let header = Header {
            version: 2,
            order: 4,
            stars: 7,
            credits_bytes: 9,
            epoch_yr: 2016.0,
            crc32: 0xDEAD_BEEF,
            numbering_mark: 0x102,
        };
        assert_eq!(Header::from_bytes(&header.to_bytes()), header);
        let star = StarRecord { ra: 1 << 31, dec: -5, pm_ra: -7, pm_dec: 1 << 24, g: 9000, bp_rp: -300, parallax: 12 };
        assert_eq!(StarRecord::from_bytes(&star.to_bytes(), star.parallax.to_le_bytes()), star);
    }
}
