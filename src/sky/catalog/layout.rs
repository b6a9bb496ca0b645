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
//! | 36..40 | zero |
//! | then | u32 x (tiles + 1): first star of each tile, and the number of stars |
//! | then | 16 B per star: u32 ra, i32 dec, i16 pm ra, i16 pm dec, u16 G, i16 BP-RP ([`StarRecord`]) |
//! | then | u16 per star: parallax |
//! | then | UTF-8 credits |
//!
//! Stars of one tile are sorted by magnitude, so that a brightness cut is a prefix of the tile.

use core::f64::consts::{PI, TAU};

/// First bytes of a packed catalog.
pub(super) const MAGIC: [u8; 8] = *b"STARCAT1";
/// Format version read and written.
pub(super) const VERSION: u32 = 1;
/// HEALPix order of the tiles.
pub(super) const TILE_ORDER: u8 = 4;
/// Tiles of the sphere at [`TILE_ORDER`].
pub(super) const TILES: usize = 12 << (2 * TILE_ORDER);
/// Bytes of the header.
pub(super) const HEADER_BYTES: usize = 40;
/// Where the checksum stands.
pub(super) const CRC_AT: usize = 32;
/// Bytes of one star record.
pub(super) const RECORD_BYTES: usize = 16;
/// Bytes of one parallax.
pub(super) const PARALLAX_BYTES: usize = 2;

/// Photometric bands of every packed catalog.
pub const BANDS: &str = "Gaia DR3 G, and BP - RP (Vega system)";

/// Credits that the catalog's sources ask for; carried inside the packed file.
pub const DEFAULT_CREDITS: &str = "This work has made use of data from the European Space Agency (ESA) mission Gaia \
    (https://www.cosmos.esa.int/gaia), processed by the Gaia Data Processing and Analysis Consortium (DPAC, \
    https://www.cosmos.esa.int/web/gaia/dpac/consortium). Proper motions, parallaxes and the brightest stars: \
    Hipparcos, the new reduction (van Leeuwen 2007, A&A 474, 653). Proper motions of the rest: Tycho-2 (Hog et al. \
    2000, A&A 355, L27).";

/// Step of a proper motion, mas/yr.
pub(super) const PM_STEP_MAS_YR: f64 = 0.5;
/// Step of a parallax, mas.
pub(super) const PARALLAX_STEP_MAS: f64 = 0.05;
/// Step of magnitudes and colours, mag.
pub(super) const MAG_STEP: f64 = 1e-3;
/// Magnitude stored as zero.
pub(super) const MAG_ZERO: f64 = -2.0;
/// Both proper-motion fields of a star whose motion is unknown.
pub(super) const NO_PROPER_MOTION: i16 = i16::MIN;
/// Parallax field of a star whose parallax is unknown.
pub(super) const NO_PARALLAX: u16 = u16::MAX;
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
        bytes
    }

    /// Reads everything but the magic, which the caller has checked.
    pub(super) fn from_bytes(bytes: &[u8; HEADER_BYTES]) -> Self {
        Self {
            version: u32_at(bytes, 8),
            order: u32_at(bytes, 12),
            stars: u32_at(bytes, 16),
            credits_bytes: u32_at(bytes, 20),
            epoch_yr: f64::from_bits(u64::from(u32_at(bytes, 24)) | u64::from(u32_at(bytes, 28)) << 32),
            crc32: u32_at(bytes, CRC_AT),
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
    pub(super) pm_ra: i16,
    /// Proper motion in declination, likewise.
    pub(super) pm_dec: i16,
    /// G magnitude above [`MAG_ZERO`], [`MAG_STEP`].
    pub(super) g: u16,
    /// BP - RP, [`MAG_STEP`].
    pub(super) bp_rp: i16,
    /// Parallax, [`PARALLAX_STEP_MAS`]; [`NO_PARALLAX`] when unknown. Stored in its own column.
    pub(super) parallax: u16,
}

impl StarRecord {
    pub(super) fn to_bytes(self) -> [u8; RECORD_BYTES] {
        let mut bytes = [0; RECORD_BYTES];
        bytes[0..4].copy_from_slice(&self.ra.to_le_bytes());
        bytes[4..8].copy_from_slice(&self.dec.to_le_bytes());
        bytes[8..10].copy_from_slice(&self.pm_ra.to_le_bytes());
        bytes[10..12].copy_from_slice(&self.pm_dec.to_le_bytes());
        bytes[12..14].copy_from_slice(&self.g.to_le_bytes());
        bytes[14..16].copy_from_slice(&self.bp_rp.to_le_bytes());
        bytes
    }

    pub(super) fn from_bytes(record: &[u8; RECORD_BYTES], parallax: [u8; PARALLAX_BYTES]) -> Self {
        let b = record;
        Self {
            ra: u32_at(b, 0),
            dec: i32::from_le_bytes([b[4], b[5], b[6], b[7]]),
            pm_ra: i16::from_le_bytes([b[8], b[9]]),
            pm_dec: i16::from_le_bytes([b[10], b[11]]),
            g: u16::from_le_bytes([b[12], b[13]]),
            bp_rp: i16::from_le_bytes([b[14], b[15]]),
            parallax: u16::from_le_bytes(parallax),
        }
    }
}

/// The u32 that begins at byte `at`, which the caller knows to be inside.
pub(super) fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
}

/// CRC-32 of a packed file: IEEE 802.3 (polynomial 0xEDB88320 reflected), over all bytes but the stored checksum.
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
        let header = Header { version: 1, order: 4, stars: 7, credits_bytes: 9, epoch_yr: 2016.0, crc32: 0xDEAD_BEEF };
        assert_eq!(Header::from_bytes(&header.to_bytes()), header);
        let star = StarRecord { ra: 1 << 31, dec: -5, pm_ra: -7, pm_dec: 8, g: 9000, bp_rp: -300, parallax: 12 };
        assert_eq!(StarRecord::from_bytes(&star.to_bytes(), star.parallax.to_le_bytes()), star);
    }
}
