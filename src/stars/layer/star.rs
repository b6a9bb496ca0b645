//! A star on its way into a layer: as an importer has it, and as a row that waits on disk to be sorted.

use super::layout::{
    FASTEST_MAS_YR, NO_COLOUR, NO_MOTION, PARALLAX_STEP_MAS, StarRecord, TileFrame, motion_mas_yr, motion_steps,
};
use crate::store::{
    COLOUR_DOMAIN_MAG, FAINTEST_MAG, MAG_STEP, MAG_ZERO, NO_PARALLAX, mag_of, nearest_i16, nearest_u16, u64_at,
};
use base::{refused::Refused, source::direction_from_ra_dec};
use core::f64::consts::{FRAC_PI_2, TAU};
use serde::{Deserialize, Serialize};

/// A star as an importer reads it; ICRS at the catalog's epoch.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NewStar {
    /// Number in its catalog.
    pub source_id: i64,
    /// Right ascension, 0..2 pi rad.
    pub ra_rad: f64,
    /// Declination, rad.
    pub dec_rad: f64,
    /// Proper motion eastward (with cos dec) and northward, mas/yr, where it is known.
    pub motion_mas_yr: Option<[f64; 2]>,
    /// Parallax, mas, where it is known.
    pub parallax_mas: Option<f64>,
    /// Gaia G magnitude.
    pub mag_g: f64,
    /// Gaia colour BP - RP, mag, where it is known.
    pub bp_rp: Option<f64>,
}

/// A star that was taken in, as it waits to be sorted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TakenStar {
    /// Number in its catalog.
    pub source_id: i64,
    /// Right ascension, rad.
    pub ra_rad: f64,
    /// Declination, rad.
    pub dec_rad: f64,
    /// Proper motion eastward (with cos dec) and northward, mas/yr, where it is known.
    pub motion_mas_yr: Option<[f64; 2]>,
    /// Gaia G magnitude.
    pub mag_g: f64,
}

/// Counts of the stars of an import.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct StarCounts {
    /// Stars taken in.
    pub stars: u64,
    /// Fainter than the faintest layer: left out.
    pub too_faint: u64,
    /// Of those taken in, without a proper motion.
    pub without_motion: u64,
    /// Without a parallax.
    pub without_parallax: u64,
    /// Without a colour.
    pub without_colour: u64,
    /// With a negative parallax, stored as zero.
    pub negative_parallaxes: u64,
    /// With a colour beyond -0.5..5, clamped.
    pub clamped_colours: u64,
}

/// A row that waits: everything in stored steps but the place, whose tile is not known yet.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct WaitingRow {
    pub(super) source_id: i64,
    ra_rad: f64,
    dec_rad: f64,
    pub(super) g: u16,
    bp_rp: i16,
    motion: [i16; 2],
    parallax: u16,
}

/// Returns stars of one tile as its records, brightest first; each is in the tile.
pub fn tile_records(order: u8, tile: u64, stars: &[NewStar]) -> Result<Vec<StarRecord>, Refused> {
    let (frame, mut counts) = (TileFrame::new(order, tile), StarCounts::default());
    let record = |star: &NewStar| Ok(WaitingRow::new(star, &mut counts)?.record(&frame));
    let mut records = stars.iter().map(record).collect::<Result<Vec<_>, Refused>>()?;
    records.sort_by_key(|record| record.g);
    Ok(records)
}

/// Bytes of a waiting row.
pub(super) const ROW_BYTES: usize = 34;
/// Its first bytes, its number, place and magnitude: two rows with the same are one star that came twice.
pub(super) const IDENTITY_BYTES: usize = 26;

impl WaitingRow {
    /// Returns right ascension and declination.
    pub(super) fn place_rad(&self) -> [f64; 2] {
        [self.ra_rad, self.dec_rad]
    }

    /// Returns a star in stored steps, and what was found in it.
    pub(super) fn new(star: &NewStar, counts: &mut StarCounts) -> Result<Self, Refused> {
        let inside = |what, value: f64, low: f64, high: f64| {
            let wanted = || format!("{low}..{high}");
            let refused = || {
                Refused(format!(
                    "source {source_id}: {what}: wanted {wanted}, got {value}",
                    source_id = star.source_id,
                    wanted = wanted()
                ))
            };
            if (low..=high).contains(&value) { Ok(value) } else { Err(refused()) }
        };
        let ra_rad = inside("right ascension, rad", star.ra_rad, 0.0, TAU)?;
        let dec_rad = inside("declination, rad", star.dec_rad, -FRAC_PI_2, FRAC_PI_2)?;
        let g = nearest_u16((inside("G magnitude", star.mag_g, MAG_ZERO, FAINTEST_MAG)? - MAG_ZERO) / MAG_STEP);
        let motion = match star.motion_mas_yr {
            Some([east, north]) => {
                let fits = |value| inside("proper motion, mas/yr", value, -FASTEST_MAS_YR, FASTEST_MAS_YR);
                [motion_steps(fits(east)?), motion_steps(fits(north)?)]
            }
            None => [NO_MOTION; 2],
        };
        let parallax = match star.parallax_mas {
            Some(mas) => {
                let most_mas = f64::from(NO_PARALLAX - 1) * PARALLAX_STEP_MAS;
                nearest_u16(inside("parallax, mas", mas, -most_mas, most_mas)?.max(0.0) / PARALLAX_STEP_MAS)
            }
            None => NO_PARALLAX,
        };
        let [bluest, reddest] = COLOUR_DOMAIN_MAG;
        let bp_rp = match star.bp_rp {
            Some(mag) => nearest_i16(inside("BP - RP, mag", mag, -20.0, 20.0)?.clamp(bluest, reddest) / MAG_STEP),
            None => NO_COLOUR,
        };
        counts.stars += 1;
        counts.without_motion += u64::from(star.motion_mas_yr.is_none());
        counts.without_parallax += u64::from(star.parallax_mas.is_none());
        counts.without_colour += u64::from(star.bp_rp.is_none());
        counts.negative_parallaxes += u64::from(star.parallax_mas.is_some_and(|mas| mas < 0.0));
        counts.clamped_colours += u64::from(star.bp_rp.is_some_and(|mag| !(bluest..=reddest).contains(&mag)));
        Ok(Self { source_id: star.source_id, ra_rad, dec_rad, g, bp_rp, motion, parallax })
    }

    /// Returns the tile it belongs to.
    pub(super) fn tile(&self, order: u8) -> u64 {
        crate::healpix::cell(order, self.ra_rad, self.dec_rad)
    }

    /// Returns the star as it will be read.
    pub(super) fn taken(&self) -> TakenStar {
        let is_known = !self.motion.contains(&NO_MOTION);
        TakenStar {
            source_id: self.source_id,
            ra_rad: self.ra_rad,
            dec_rad: self.dec_rad,
            motion_mas_yr: is_known.then(|| self.motion.map(motion_mas_yr)),
            mag_g: mag_of(self.g),
        }
    }

    /// Returns the record of the star in its tile.
    pub(super) fn record(&self, frame: &TileFrame) -> StarRecord {
        let place = frame.steps(direction_from_ra_dec(self.ra_rad, self.dec_rad));
        StarRecord { place, g: self.g, bp_rp: self.bp_rp, motion: self.motion, parallax: self.parallax }
    }

    pub(super) fn to_bytes(self) -> [u8; ROW_BYTES] {
        let mut bytes = [0; ROW_BYTES];
        bytes[0..8].copy_from_slice(&self.source_id.to_le_bytes());
        bytes[8..16].copy_from_slice(&self.ra_rad.to_le_bytes());
        bytes[16..24].copy_from_slice(&self.dec_rad.to_le_bytes());
        bytes[24..26].copy_from_slice(&self.g.to_le_bytes());
        bytes[26..28].copy_from_slice(&self.bp_rp.to_le_bytes());
        bytes[28..30].copy_from_slice(&self.motion[0].to_le_bytes());
        bytes[30..32].copy_from_slice(&self.motion[1].to_le_bytes());
        bytes[32..34].copy_from_slice(&self.parallax.to_le_bytes());
        bytes
    }

    pub(super) fn from_bytes(b: &[u8; ROW_BYTES]) -> Self {
        let eight = |at: usize| u64_at(b, at);
        let i16_at = |at: usize| i16::from_le_bytes([b[at], b[at + 1]]);
        Self {
            source_id: eight(0).cast_signed(),
            ra_rad: f64::from_bits(eight(8)),
            dec_rad: f64::from_bits(eight(16)),
            g: u16::from_le_bytes([b[24], b[25]]),
            bp_rp: i16_at(26),
            motion: [i16_at(28), i16_at(30)],
            parallax: u16::from_le_bytes([b[32], b[33]]),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const STAR: NewStar = NewStar {
        source_id: -7,
        ra_rad: 1.0,
        dec_rad: -0.5,
        motion_mas_yr: Some([3.0, -4.0]),
        parallax_mas: Some(10.0),
        mag_g: 12.3456,
        bp_rp: Some(0.8),
    };

    #[test]
    fn rows_come_back_from_disk() {
        let row = WaitingRow::new(&STAR, &mut StarCounts::default()).unwrap();
        assert_eq!(WaitingRow::from_bytes(&row.to_bytes()), row);
        assert_eq!((row.g, row.bp_rp, row.parallax), (14_346, 800, 500));
    }

    #[test]
    fn unknown_and_changed_values_are_counted() {
        let mut counts = StarCounts::default();
        let unknown = NewStar { motion_mas_yr: None, parallax_mas: None, bp_rp: None, ..STAR };
        let row = WaitingRow::new(&unknown, &mut counts).unwrap();
        assert_eq!((row.motion, row.parallax, row.bp_rp), ([NO_MOTION; 2], NO_PARALLAX, NO_COLOUR));
        let odd = NewStar { parallax_mas: Some(-0.3), bp_rp: Some(5.2), ..STAR };
        let row = WaitingRow::new(&odd, &mut counts).unwrap();
        assert_eq!((row.parallax, row.bp_rp), (0, 5000));
        let wanted = StarCounts {
            stars: 2,
            without_motion: 1,
            without_parallax: 1,
            without_colour: 1,
            negative_parallaxes: 1,
            clamped_colours: 1,
            too_faint: 0,
        };
        assert_eq!(counts, wanted);
    }

    #[test]
    fn stars_that_cannot_be_stored_are_refused_with_their_number() {
        let refused = |star: NewStar| WaitingRow::new(&star, &mut StarCounts::default()).unwrap_err().to_string();
        for (star, words) in [
            (NewStar { ra_rad: -0.1, ..STAR }, "source -7: right ascension"),
            (NewStar { dec_rad: 1.6, ..STAR }, "declination"),
            (NewStar { mag_g: f64::NAN, ..STAR }, "G magnitude: wanted -2..60, got NaN"),
            (NewStar { motion_mas_yr: Some([0.0, 2e4]), ..STAR }, "proper motion"),
            (NewStar { parallax_mas: Some(5e3), ..STAR }, "parallax"),
            (NewStar { bp_rp: Some(f64::INFINITY), ..STAR }, "BP - RP"),
        ] {
            assert!(refused(star).contains(words), "{}", refused(star));
        }
    }
}
