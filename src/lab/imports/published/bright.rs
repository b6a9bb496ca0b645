//! Stars of catalogs brighter and older than Gaia's, at the epoch of each.
//!
//! A file is known by its lines: `hip2.dat` has fixed columns, `tyc2.dat` 32 parts between bars, `suppl_1.dat` 18; any
//! may be packed with gzip. All stars are held in memory, at most [`MOST_BRIGHT`].
//!
//! Those that an import lacks are added to it: Tycho-2 is matched with Hipparcos, and what is left of both with the stars taken in: no star comes twice, none is
//! lost. Each becomes one of the counts reported at the end. Tests: `super::bright_tests`.

use crate::published::bright_star::{self, BrightStar, Line};
use crate::published::crossmatch::{Crossmatch, ReferenceStar, Rule};
use crate::published::lines::Lines;
use base::{input_file::InputFile, refused::Refused};
use flate2::read::MultiGzDecoder;
use stars::layer::Sorting;
use std::collections::{BTreeMap, HashSet};
use std::io::{BufRead, BufReader};
use std::path::Path;

/// Most stars held in memory, some 300 MB: Hipparcos and Tycho-2 have 2.7 million.
pub const MOST_BRIGHT: usize = 3_000_000;
/// Longest line, bytes: Tycho-2's have 206, Hipparcos' 277.
pub(super) const LONGEST_LINE: usize = 1000;
/// Count of rows left out because they have no magnitude.
const WITHOUT_MAGNITUDE: &str = "bright stars without a magnitude, left out";
/// Count of stars with one band only.
const WITHOUT_COLOUR: &str = "bright stars without a colour, G by that of a middling star";

/// Bright stars as they were read, and what was found in them.
#[derive(Debug, Default)]
pub struct BrightStars {
    /// Of Hipparcos.
    pub hipparcos: Vec<BrightStar>,
    /// Of Tycho-2 and its first supplement.
    pub tycho: Vec<BrightStar>,
    /// Counts for the user, by message.
    pub reported: BTreeMap<&'static str, u64>,
}

/// Format of a line.
enum Format {
    Hipparcos,
    Tycho,
    TychoSupplement,
}

impl Line<'_> {
    fn format(&self) -> Option<Format> {
        match self.text.matches('|').count() + 1 {
            bright_star::TYCHO_PARTS => Some(Format::Tycho),
            bright_star::SUPPLEMENT_PARTS => Some(Format::TychoSupplement),
            1 if self.text.is_ascii() && self.text.len() >= bright_star::LEAST_CHARACTERS => Some(Format::Hipparcos),
            _ => None,
        }
    }
}

impl BrightStars {
    /// Reads a file, and adds its stars.
    ///
    /// # Errors
    /// When the file cannot be read to its end, is in none of the three formats, a field is malformed, or there are
    /// more stars than memory is meant to hold.
    pub fn read(&mut self, path: &Path) -> Result<(), Refused> {
        let failed = |source| Refused::at(path, format_args!("{source}; what was read before is not used"));
        let file = InputFile::open(path, u64::MAX).map_err(failed)?;
        let mut file = BufReader::with_capacity(1 << 20, file);
        let is_packed = file.fill_buf().map_err(failed)?.starts_with(&[0x1f, 0x8b]);
        if is_packed {
            self.read_text(BufReader::new(MultiGzDecoder::new(file)), path)
        } else {
            self.read_text(file, path)
        }
    }

    /// Reads a file's text; `path` is for messages.
    ///
    /// # Errors
    /// As [`Self::read`].
    pub fn read_text(&mut self, text: impl BufRead, path: &Path) -> Result<(), Refused> {
        let (mut lines, mut format) = (Lines::new(text, path, LONGEST_LINE), None);
        while let Some(line) = lines.next()? {
            let row = Line { path, number: line.number, text: line.text };
            let found = row.format().ok_or_else(|| row.refuse_line("a line of hip2.dat, tyc2.dat or suppl_1.dat"))?;
            let first = format.get_or_insert_with(|| core::mem::discriminant(&found));
            if *first != core::mem::discriminant(&found) {
                return Err(row.refuse_line("a line as those before: the file may be cut short"));
            }
            self.add(&row, &found)?;
        }
        Ok(())
    }

    fn add(&mut self, row: &Line<'_>, format: &Format) -> Result<(), Refused> {
        let star = match format {
            Format::Hipparcos => bright_star::hipparcos_star(row)?,
            Format::Tycho => bright_star::tycho_star(row)?,
            Format::TychoSupplement => bright_star::supplement_star(row)?,
        };
        let Some(star) = star else {
            self.announce(WITHOUT_MAGNITUDE, 1);
            return Ok(());
        };
        if star.bp_rp.is_none() {
            self.announce(WITHOUT_COLOUR, 1);
        }
        if self.hipparcos.len() + self.tycho.len() == MOST_BRIGHT {
            return Err(row.refuse_line("at most 3,000,000 bright stars in all files"));
        }
        let stars = if matches!(format, Format::Hipparcos) { &mut self.hipparcos } else { &mut self.tycho };
        stars.push(star);
        Ok(())
    }

    /// Counts something that a person should know of.
    pub(super) fn announce(&mut self, what: &'static str, count: u64) {
        *self.reported.entry(what).or_default() += count;
    }
}

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
