//! Two lists of stars -> which of the one are in the other.
//!
//! **Where.** A pair is compared at the bright star's own epoch, to which the reference star (Gaia, or Hipparcos for Tycho-2)
//! is moved by its own proper motion, the better one: what is left is the bright star's error of place (Hipparcos 1
//! mas, Tycho-2 60 to 100) and what orbital motion adds in 25 years. A reference star without a motion is compared at
//! its own epoch, to which the bright star is moved by its own. They are one when they are within [`RADIUS_ARCSEC`].
//! That is wide for single stars, for pairs: where one catalog sees two stars and the other their common light, the
//! places differ by up to half their distance. It may be wide, as stars as bright are rare: 200 of G 10 to 12 in a
//! square degree of the plane make 2 false pairs in 10,000.
//!
//! **How bright.** Gaia often has a faint companion of a bright star that it lacks itself, so that a star close by is not
//! enough: magnitudes must agree within [`BrightStar::tolerance_mag`]. Two equal stars seen as one are 0.75 mag brighter than each,
//! and the relations between bands are good to 0.1, hence 1 mag; more for a star that varies, whose colour is unknown,
//! or that is saturated in Gaia. Within [`UNRESOLVED_ARCSEC`] Gaia has no two stars: there it is one star at up to 1.5
//! mag more.
//!
//! **One for one.** A reference star matches one bright star, the one that fits best: where Tycho-2 sees two stars and
//! Gaia one, the second is added.
//!
//! What it gets wrong, and how often, is in `bright_tests` (a made sky) and `hil_scripts/tests/test_catalog.py` (the real
//! one).

use super::bright_star::{BrightStar, moved};
use base::source::{direction_from_ra_dec, ra_dec_rad};
use base::units::ARCSEC;
use glam::DVec3;
use std::collections::HashSet;

/// Furthest apart that a star is from itself in another catalog, arcsec.
pub(super) const RADIUS_ARCSEC: f64 = 2.0;
/// Closer than this, Gaia has one star of two (Gaia DR3: pairs are complete from 0.7 arcsec on, and begin at 0.2),
/// arcsec.
const UNRESOLVED_ARCSEC: f64 = 0.5;
/// Added to the tolerance there, mag.
const UNRESOLVED_MAG: f64 = 1.5;
/// Order of the cells among which bright stars are looked up: 51 arcsec wide.
const CELL_ORDER: u8 = 12;
/// How far a pair may be apart before motions are taken into account, arcsec; within a cell's neighbours. A star
/// without a motion in Tycho-2 whose Gaia star moves by more than 0.5 arcsec/yr is beyond it.
#[cfg(test)]
pub(super) const REACH_ARCSEC: f64 = 15.0;
/// Pairs kept for a star.
const PAIRS_PER_STAR: usize = 4;

/// A star of the list that is there already.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct ReferenceStar {
    /// Its number in its file.
    pub(super) source_id: i64,
    /// Direction at its epoch, unit vector.
    pub(super) direction_icrf: DVec3,
    pub(super) epoch_yr: f64,
    pub(super) motion_mas_yr: Option<[f64; 2]>,
    pub(super) mag_g: f64,
}

/// How the rule is drawn: the limits are varied by tests that show what each is good for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Rule {
    pub(super) radius_arcsec: f64,
    /// Whether magnitudes must agree.
    pub(super) by_magnitude: bool,
}

impl Default for Rule {
    fn default() -> Self {
        Self { radius_arcsec: RADIUS_ARCSEC, by_magnitude: true }
    }
}

/// Distinguishes reference stars: files numbered independently may use a number twice, at different places.
type ReferenceKey = (i64, [u64; 3]);

/// A pair that may be one star.
#[derive(Debug, Clone, Copy)]
struct Pair {
    star: u32,
    reference: ReferenceKey,
    /// Arcsec and magnitudes apart, added: the less the better.
    apart: f32,
}

/// Bright stars, and the reference stars that may be they.
pub(super) struct Crossmatch<'a> {
    stars: &'a [BrightStar],
    rule: Rule,
    /// Cells and places of the stars as they are at the reference epoch, sorted.
    cells: Vec<(u64, u32)>,
    /// A bit for every cell that has a star in it or beside it.
    near: Vec<u64>,
    pairs: Vec<Pair>,
}

impl<'a> Crossmatch<'a> {
    /// Returns stars to be found among reference stars of about `epoch_yr`.
    pub(super) fn new(stars: &'a [BrightStar], epoch_yr: f64, rule: Rule) -> Self {
        let cell = |star: &BrightStar| {
            let at = star.at(epoch_yr);
            stars::healpix::cell(CELL_ORDER, at.ra_rad, at.dec_rad)
        };
        let mut cells: Vec<(u64, u32)> = stars.iter().map(cell).zip(0..).collect();
        cells.sort_unstable();
        let mut near = vec![0; (12_usize << (2 * CELL_ORDER)) / 64];
        for (cell, _) in &cells {
            for beside in around(*cell) {
                near[place(beside)] |= 1 << (beside % 64);
            }
        }
        Self { stars, rule, cells, near, pairs: Vec::new() }
    }

    /// Takes note of a reference star.
    pub(super) fn offer(&mut self, reference: &ReferenceStar) {
        let [ra, dec] = ra_dec_rad(reference.direction_icrf);
        let cell = stars::healpix::cell(CELL_ORDER, ra, dec);
        if self.near[place(cell)] & (1 << (cell % 64)) == 0 {
            return;
        }
        for cell in around(cell) {
            let first = self.cells.partition_point(|(other, _)| *other < cell);
            for (_, star) in self.cells[first..].iter().take_while(|(other, _)| *other == cell) {
                if let Some(apart) = self.apart(&self.stars[*star as usize], reference) {
                    let reference = (reference.source_id, reference.direction_icrf.to_array().map(f64::to_bits));
                    self.pairs.push(Pair { star: *star, reference, apart });
                }
            }
        }
        if self.pairs.len() > 2 * PAIRS_PER_STAR * self.stars.len() + 4096 {
            self.keep_best_pairs();
        }
    }

    /// Returns how far apart a pair is that may be one star.
    #[allow(clippy::cast_possible_truncation, reason = "a rank among pairs")]
    fn apart(&self, star: &BrightStar, reference: &ReferenceStar) -> Option<f32> {
        let years = star.epoch_yr - reference.epoch_yr;
        let distance = match reference.motion_mas_yr {
            Some(_) => moved(reference.direction_icrf, reference.motion_mas_yr, years).0.distance(star.direction_icrf),
            None => moved(star.direction_icrf, star.motion_mas_yr, -years).0.distance(reference.direction_icrf),
        };
        let arcsec = distance / ARCSEC;
        let mags = (f64::from(star.mag_g) - reference.mag_g).abs();
        let unresolved = if arcsec < UNRESOLVED_ARCSEC { UNRESOLVED_MAG } else { 0.0 };
        let is_as_bright = !self.rule.by_magnitude || mags <= f64::from(star.tolerance_mag) + unresolved;
        (arcsec <= self.rule.radius_arcsec && is_as_bright).then_some((arcsec + mags) as f32)
    }

    fn keep_best_pairs(&mut self) {
        self.pairs.sort_by(|a, b| a.star.cmp(&b.star).then(a.apart.total_cmp(&b.apart)));
        let (mut star, mut kept) = (None, 0);
        self.pairs.retain(|pair| {
            kept = if star == Some(pair.star) { kept + 1 } else { 0 };
            star = Some(pair.star);
            kept < PAIRS_PER_STAR
        });
    }

    /// Returns whether each star is among the reference stars.
    pub(super) fn found(mut self) -> Vec<bool> {
        self.pairs.sort_by(|a, b| a.apart.total_cmp(&b.apart).then((a.star, a.reference).cmp(&(b.star, b.reference))));
        let (mut found, mut taken) = (vec![false; self.stars.len()], HashSet::new());
        for pair in &self.pairs {
            let star = pair.star as usize;
            if !found[star] && !taken.contains(&pair.reference) {
                found[star] = true;
                taken.insert(pair.reference);
            }
        }
        found
    }
}

/// Returns a cell and those that touch it.
fn around(cell: u64) -> impl Iterator<Item = u64> {
    // Cells at the corners of the base cells have one neighbour less.
    stars::healpix::with_neighbours(CELL_ORDER, cell)
}

/// Returns the word of the bits that has a cell's.
fn place(cell: u64) -> usize {
    usize::try_from(cell / 64).unwrap_or(usize::MAX)
}

impl From<&BrightStar> for ReferenceStar {
    fn from(star: &BrightStar) -> Self {
        Self {
            source_id: star.source_id,
            direction_icrf: star.direction_icrf,
            epoch_yr: star.epoch_yr,
            motion_mas_yr: star.motion_mas_yr,
            mag_g: f64::from(star.mag_g),
        }
    }
}

impl ReferenceStar {
    /// Returns a star that an import has taken in, of `epoch_yr`.
    pub(super) fn taken_in(star: &stars::layer::TakenStar, epoch_yr: f64) -> Self {
        Self {
            source_id: star.source_id,
            direction_icrf: direction_from_ra_dec(star.ra_rad, star.dec_rad),
            epoch_yr,
            motion_mas_yr: star.motion_mas_yr,
            mag_g: star.mag_g,
        }
    }
}
