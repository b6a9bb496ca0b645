//! Stars of catalogs brighter and older than Gaia's, at the epoch of each.
//!
//! A file is known by its lines: `hip2.dat` has fixed columns, `tyc2.dat` 32 parts between bars, `suppl_1.dat` 18; any
//! may be packed with gzip. All stars are held in memory, at most [`MOST_BRIGHT`].

use super::{bright_star::BrightStar, lines::Lines, star_line::Line};
use super::{hipparcos, tycho};
use base::{input_file::InputFile, refused::Refused};
use flate2::read::MultiGzDecoder;
use std::io::{BufRead, BufReader};
use std::{collections::BTreeMap, path::Path};

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
            tycho::PARTS => Some(Format::Tycho),
            tycho::SUPPLEMENT_PARTS => Some(Format::TychoSupplement),
            1 if self.text.is_ascii() && self.text.len() >= hipparcos::LEAST_CHARACTERS => Some(Format::Hipparcos),
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
