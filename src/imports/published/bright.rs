//! Stars of catalogs brighter and older than Gaia's, at the epoch of each.
//!
//! A file is known by its lines: `hip2.dat` has fixed columns, `tyc2.dat` 32 parts between bars, `suppl_1.dat` 18; any
//! may be packed with gzip. All stars are held in memory, at most [`MOST_BRIGHT`].

use super::error::ImportError;
use super::lines::Lines;
use super::{hipparcos, tycho};
use base::source::ra_dec_rad;
use base::units::MAS;
use flate2::read::MultiGzDecoder;
use glam::DVec3;
use stars::layer::NewStar;
use std::collections::BTreeMap;
use std::fs::File;
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

/// A star as Hipparcos or Tycho-2 has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BrightStar {
    /// Minus the Hipparcos number, or -(10^12 + 10^6 TYC1 + 10 TYC2 + TYC3): Gaia's numbers are positive.
    pub source_id: i64,
    /// Direction at its epoch, unit vector.
    pub direction_icrf: DVec3,
    /// Julian year of the direction.
    pub epoch_yr: f64,
    /// Proper motion eastward (with cos dec) and northward, mas/yr, where it is known.
    pub motion_mas_yr: Option<[f64; 2]>,
    /// Parallax, mas, where it is known.
    pub parallax_mas: Option<f32>,
    /// G magnitude by the bands that were measured.
    pub mag_g: f32,
    /// BP - RP by them, where both are known.
    pub bp_rp: Option<f32>,
    /// How far Gaia's magnitude of the same star may be from it (`crossmatch`), mag.
    pub tolerance_mag: f32,
}

impl BrightStar {
    /// Returns the star at a Julian year, as a layer takes it.
    #[must_use]
    pub fn at(&self, epoch_yr: f64) -> NewStar {
        let (direction, motion_mas_yr) = moved(self.direction_icrf, self.motion_mas_yr, epoch_yr - self.epoch_yr);
        let [ra_rad, dec_rad] = ra_dec_rad(direction);
        NewStar {
            source_id: self.source_id,
            ra_rad,
            dec_rad,
            motion_mas_yr,
            parallax_mas: self.parallax_mas.map(f64::from),
            mag_g: f64::from(self.mag_g),
            bp_rp: self.bp_rp.map(f64::from),
        }
    }
}

/// Returns direction and proper motion `years` later: uniform straight motion in space, as `sky::astrometry::at_epoch`;
/// what is eastward there may not be here (Polaris). A star without a motion stays.
#[must_use]
pub(super) fn moved(direction: DVec3, motion_mas_yr: Option<[f64; 2]>, years: f64) -> (DVec3, Option<[f64; 2]>) {
    let Some([east_mas_yr, north_mas_yr]) = motion_mas_yr else { return (direction, None) };
    let [east, north] = east_and_north(direction);
    let rate = east * east_mas_yr + north * north_mas_yr;
    let later = (direction + rate * (years * MAS)).normalize();
    (later, Some(east_and_north(later).map(|axis| rate.dot(axis))))
}

fn east_and_north(direction: DVec3) -> [DVec3; 2] {
    let east = DVec3::new(-direction.y, direction.x, 0.0).normalize_or(DVec3::Y);
    [east, direction.cross(east)]
}

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

impl BrightStars {
    /// Reads a file, and adds its stars.
    ///
    /// # Errors
    /// When the file cannot be read to its end, is in none of the three formats, a field is malformed, or there are
    /// more stars than memory is meant to hold.
    pub fn read(&mut self, path: &Path) -> Result<(), ImportError> {
        let failed = |source| ImportError::File { path: path.into(), source };
        let file = File::open(path).map_err(failed)?;
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
    pub fn read_text(&mut self, text: impl BufRead, path: &Path) -> Result<(), ImportError> {
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

    fn add(&mut self, row: &Line<'_>, format: &Format) -> Result<(), ImportError> {
        let star = match format {
            Format::Hipparcos => hipparcos::star(row)?,
            Format::Tycho => tycho::star(row)?,
            Format::TychoSupplement => tycho::supplement_star(row)?,
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

/// One line of a file.
pub(super) struct Line<'a> {
    pub(super) path: &'a Path,
    /// From 1.
    pub(super) number: u64,
    pub(super) text: &'a str,
}

impl Line<'_> {
    fn format(&self) -> Option<Format> {
        match self.text.matches('|').count() + 1 {
            tycho::PARTS => Some(Format::Tycho),
            tycho::SUPPLEMENT_PARTS => Some(Format::TychoSupplement),
            1 if self.text.is_ascii() && self.text.len() >= hipparcos::LEAST_CHARACTERS => Some(Format::Hipparcos),
            _ => None,
        }
    }

    /// Returns a number, or `None` where the field is blank.
    pub(super) fn number(&self, column: &str, field: &str) -> Result<Option<f64>, ImportError> {
        let field = field.trim();
        if field.is_empty() {
            return Ok(None);
        }
        let number = field.parse().ok().filter(|number: &f64| number.is_finite());
        number.map(Some).ok_or_else(|| self.refuse(column, "a number, or blank", field))
    }

    /// Reads a number within limits that must be there.
    pub(super) fn required(
        &self,
        column: &str,
        field: &str,
        [low, high]: [f64; 2],
        wanted: &'static str,
    ) -> Result<f64, ImportError> {
        let number = self.number(column, field)?.filter(|number| (low..=high).contains(number));
        number.ok_or_else(|| self.refuse(column, wanted, field))
    }

    pub(super) fn refuse(&self, column: &str, wanted: &'static str, got: &str) -> ImportError {
        ImportError::Cell {
            path: self.path.into(),
            line: self.number,
            column: column.into(),
            wanted,
            got: got.trim().chars().take(40).collect(),
        }
    }

    fn refuse_line(&self, wanted: &'static str) -> ImportError {
        self.refuse("all", wanted, self.text)
    }
}
