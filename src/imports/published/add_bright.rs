//! Bright stars that an import lacks -> the import.
//!
//! Tycho-2 is matched with Hipparcos, and what is left of both with the stars taken in: no star comes twice, none is
//! lost. Each becomes one of the counts reported at the end. Tests: `super::bright_tests`.

use super::crossmatch::{Crossmatch, ReferenceStar, Rule};
use super::{bright::BrightStars, bright_star::BrightStar};
use base::refused::Refused;
use stars::layer::Sorting;
use std::collections::HashSet;

/// Epoch of Hipparcos' positions, Julian year.
const HIPPARCOS_EPOCH_YR: f64 = 1991.25;
/// Stars taken in that are fainter than a bright star by more than any tolerance, mag: not looked at.
const LOOK_DEEPER_MAG: f64 = 7.0;

/// Count of stars whose number was there before: a file was named twice, or packed and unpacked.
pub(super) const TWICE: &str = "bright stars that came twice, taken once";
/// Count of stars that no layer takes.
pub(super) const TOO_FAINT: &str = "bright stars fainter than the layers, left out";

/// Adds the bright stars that are not among those taken in, moved to `epoch_yr`, the epoch of these.
///
/// # Errors
/// When the disk failed, or a star cannot be stored.
pub fn add_bright(bright: BrightStars, epoch_yr: f64, sorting: &mut Sorting) -> Result<(), Refused> {
    add_by(Rule::default(), bright, epoch_yr, sorting)
}

pub(super) fn add_by(rule: Rule, mut bright: BrightStars, epoch_yr: f64, sorting: &mut Sorting) -> Result<(), Refused> {
    sorting.begin_bright();
    bright.reported.iter().for_each(|(what, count)| sorting.announce(what, *count));
    let twice = keep_first(&mut bright.hipparcos) + keep_first(&mut bright.tycho);
    print_some(sorting, TWICE, twice);
    let mut stars = bright.hipparcos;
    sorting.announce("stars of Hipparcos", stars.len() as u64);
    sorting.announce("stars of Tycho-2", bright.tycho.len() as u64);
    let are_hipparcos = {
        let mut match_up = Crossmatch::new(&bright.tycho, HIPPARCOS_EPOCH_YR, rule);
        stars.iter().for_each(|star| match_up.offer(&ReferenceStar::from(star)));
        match_up.found()
    };
    sorting.announce("stars of Tycho-2 that Hipparcos has, left out", count(&are_hipparcos));
    stars.extend(bright.tycho.iter().zip(&are_hipparcos).filter(|(_, is)| !**is).map(|(star, _)| *star));
    let (all, faint_end) = (stars.len(), sorting.faint_end_mag());
    stars.retain(|star| f64::from(star.mag_g) < faint_end);
    print_some(sorting, TOO_FAINT, (all - stars.len()) as u64);
    let faintest = stars.iter().map(|star| f64::from(star.mag_g)).fold(f64::NEG_INFINITY, f64::max);
    let mut match_up = Crossmatch::new(&stars, epoch_yr, rule);
    sorting.each_star(faintest + LOOK_DEEPER_MAG, &mut |star| {
        match_up.offer(&ReferenceStar::taken_in(star, epoch_yr));
    })?;
    let are_there = match_up.found();
    sorting.announce("bright stars that were there, left out", count(&are_there));
    let missing: Vec<&BrightStar> =
        stars.iter().zip(&are_there).filter(|(_, is)| !**is).map(|(star, _)| star).collect();
    sorting.announce("bright stars that were missing, added", missing.len() as u64);
    let still = missing.iter().filter(|star| star.motion_mas_yr.is_none()).count();
    sorting.announce("of these without a proper motion, left where they were seen", still as u64);
    missing.iter().try_for_each(|star| sorting.add(&star.at(epoch_yr)))
}

/// Keeps the first star of each number; how many others there were.
fn keep_first(stars: &mut Vec<BrightStar>) -> u64 {
    let (all, mut known) = (stars.len(), HashSet::with_capacity(stars.len()));
    stars.retain(|star| known.insert(star.source_id));
    (all - stars.len()) as u64
}

fn print_some(sorting: &mut Sorting, what: &str, count: u64) {
    if count > 0 {
        sorting.announce(what, count);
    }
}

fn count(is: &[bool]) -> u64 {
    is.iter().filter(|is| **is).count() as u64
}
