//! Numbers of stars as catalogs store them -> names in their source catalogs.
//!
//! A stored number is Gaia's `source_id`, or the user's own, or below zero one of a bright star: minus the Hipparcos
//! number, or -(10^12 + 10^6 TYC1 + 10 TYC2 + TYC3). Whether numbers are Gaia's is found from the stars themselves:
//! `source_id` divided by 2^35 is the nested HEALPix cell at order 12 in which the star was first seen (Gaia DR3
//! documentation, section 20.1.1), 52 arcsec wide, so numbers of other origin do not lie where they say. Tests: below,
//! and `catalog::tests::built_in_stars_have_the_names_of_their_sources`.
//!
//! *Hipparcos.* Gaia numbers -> Hipparcos numbers of the same stars.
//!
//! In: a `source_id` of Gaia DR3. Out: the star's number in the Hipparcos catalog, where it has one and is brighter
//! than G = 8.5, the limit of the built-in catalog. The table is made by `hil_scripts/generate/make_hipparcos_table.py`. Tests:
//! below, and places in the Hipparcos catalog itself in `hil_scripts/tests/test_data_sets.py`.

use crate::healpix::chord_squared;
use base::source_id::{GaiaRelease, SourceId};
use base::{source::direction_from_ra_dec, units::ARCSEC};
use serde::{Deserialize, Serialize};

/// Stored number of a star without a number.
pub const NO_NUMBER: i64 = i64::MIN;
/// Bits of a Gaia number below its HEALPix cell.
const GAIA_CELL_BITS: u32 = 35;
/// Order of that cell.
const GAIA_CELL_ORDER: u8 = 12;
/// A star may be this far from its cell's centre: half the cell's diagonal, and what it has moved since it was first
/// seen. Of the built-in catalog 99.9 % are within 46 arcsec; Barnard's star is at 157.
const GAIA_REACH_RAD: f64 = 180.0 * ARCSEC;
/// Numbers are Gaia's when at least this share of them lie where they say.
const GAIA_SHARE: f64 = 0.9;
/// Beyond all Hipparcos numbers: where Tycho-2 numbers begin.
pub const TYCHO_NUMBERS: i64 = 1_000_000_000_000;
/// Hipparcos numbers are below this.
const HIPPARCOS_END: i64 = 1_000_000;
/// Epochs of the positions of Gaia's releases, Julian years.
const GAIA_EPOCHS: [(f64, GaiaRelease); 2] = [(2015.5, GaiaRelease::Dr2), (2016.0, GaiaRelease::Dr3)];

/// Returns whether a star at this place may have this number in Gaia's archive.
pub fn is_gaia_number(number: i64, ra_rad: f64, dec_rad: f64) -> bool {
    let Some(cell) = u64::try_from(number).ok().map(|number| number >> GAIA_CELL_BITS) else { return false };
    if number == 0 || cell >= 12 << (2 * GAIA_CELL_ORDER) {
        return false;
    }
    let (ra, dec) = crate::healpix::centre(GAIA_CELL_ORDER, cell);
    let apart2 = direction_from_ra_dec(ra, dec).distance_squared(direction_from_ra_dec(ra_rad, dec_rad));
    apart2 <= chord_squared(GAIA_REACH_RAD)
}

/// How many stars of each origin were seen.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct Origins {
    /// Stars with a number above zero.
    pub numbered: u64,
    /// Of them, those that lie where Gaia's numbers say.
    pub gaia: u64,
    /// Stars of Hipparcos.
    pub hipparcos: u64,
    /// Stars of Tycho-2.
    pub tycho: u64,
    /// Stars with a number below zero that is neither, or may be another's.
    pub negative: u64,
    /// Stars that a packed CSV says to be of Hipparcos, or in part.
    #[serde(default)]
    pub named_hipparcos: u64,
    /// Stars that a packed CSV says to be of Tycho-2, or in part.
    #[serde(default)]
    pub named_tycho: u64,
    /// Numbers below zero are known to be those of bright stars.
    #[serde(default)]
    pub is_bright: bool,
}

impl Origins {
    /// Counts a star.
    pub fn see(&mut self, number: i64, ra_rad: f64, dec_rad: f64) {
        if number > 0 {
            self.numbered += 1;
            self.gaia += u64::from(is_gaia_number(number, ra_rad, dec_rad));
        } else {
            match bright(number) {
                Some(SourceId::Hipparcos(_)) => self.hipparcos += 1,
                Some(SourceId::Tycho(..)) => self.tycho += 1,
                Some(SourceId::Gaia(..) | SourceId::Own(_)) | None => self.negative += 1,
            }
        }
    }

    /// Counts the catalogs that a packed CSV's column `origin` names, such as `gaia+hip_lb`: proper motions may be
    /// theirs.
    pub fn see_words(&mut self, origin: &str) {
        let names = |catalog| origin.split(|c: char| !c.is_alphanumeric()).any(|word| word == catalog);
        self.named_hipparcos += u64::from(names("hip"));
        self.named_tycho += u64::from(names("tyc"));
    }

    /// Returns whether the stars' numbers above zero are Gaia's.
    pub fn is_gaia(&self) -> bool {
        self.numbered > 0 && self.gaia as f64 >= GAIA_SHARE * self.numbered as f64
    }

    /// Notes that stars with numbers of Hipparcos and Tycho-2 below zero follow. A user's own numbers below zero, if
    /// there were any, look the same.
    pub fn begin_bright(&mut self) {
        if !self.is_gaia() && !self.is_bright {
            self.negative += self.hipparcos + self.tycho;
            (self.hipparcos, self.tycho) = (0, 0);
        }
        self.is_bright = true;
    }

    /// Returns whether numbers below zero are those of Hipparcos and Tycho-2: bright files were read, a packed CSV
    /// names them, or the others are Gaia's.
    pub fn has_bright_numbers(&self) -> bool {
        let is_known = self.is_bright || self.is_gaia() || self.named_hipparcos + self.named_tycho > 0;
        is_known && self.negative == 0
    }

    /// Returns whether Hipparcos, and Tycho-2, have given stars or motions.
    pub fn are_bright(&self) -> [bool; 2] {
        let is_numbered = self.is_bright || self.has_bright_numbers();
        [
            self.named_hipparcos > 0 || is_numbered && self.hipparcos > 0,
            self.named_tycho > 0 || is_numbered && self.tycho > 0,
        ]
    }

    /// Returns how the numbers of these stars, of epoch `epoch_yr`, are to be read.
    pub fn numbering(&self, epoch_yr: f64) -> Numbering {
        let release = GAIA_EPOCHS.iter().find(|(epoch, _)| (epoch - epoch_yr).abs() < 0.01);
        let gaia = self.is_gaia().then(|| release.map_or(GaiaRelease::Unknown, |(_, release)| *release));
        Numbering { gaia, bright: self.has_bright_numbers() }
    }
}

/// How stored numbers are to be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Numbering {
    /// Numbers above zero are Gaia's.
    pub gaia: Option<GaiaRelease>,
    /// Numbers below zero are those of Hipparcos and Tycho-2.
    pub bright: bool,
}

/// The mark of each origin of numbers above zero in a file.
const MARKS: [(Option<GaiaRelease>, u32); 4] =
    [(None, 1), (Some(GaiaRelease::Dr3), 2), (Some(GaiaRelease::Dr2), 3), (Some(GaiaRelease::Unknown), 4)];
/// Set in a file when numbers below zero are those of bright stars.
const BRIGHT_MARK: u32 = 0x100;

impl Numbering {
    /// Returns the number that a file stores; never zero, which means that the file has no numbers.
    pub fn mark(self) -> u32 {
        let gaia = MARKS.iter().find(|(gaia, _)| *gaia == self.gaia).map_or(1, |(_, mark)| *mark);
        gaia | if self.bright { BRIGHT_MARK } else { 0 }
    }

    /// Returns the numbering of a stored number; `None` when this program does not know the mark.
    pub fn of_mark(mark: u32) -> Option<Self> {
        let gaia = MARKS.iter().find(|(_, known)| *known == mark & !BRIGHT_MARK)?.0;
        Some(Self { gaia, bright: mark & BRIGHT_MARK != 0 })
    }

    /// Returns the name of the star with a stored number; `None` when it has none.
    pub fn source_id(self, number: i64) -> Option<SourceId> {
        if number == NO_NUMBER {
            return None;
        }
        let bright = if self.bright { bright(number) } else { None };
        let gaia = || Some(SourceId::Gaia(self.gaia?, u64::try_from(number).ok()?));
        bright.or_else(gaia).or(Some(SourceId::Own(number)))
    }
}

/// Returns the stored number of a name: [`NO_NUMBER`] of none.
pub fn stored_number(id: Option<SourceId>) -> i64 {
    match id {
        Some(SourceId::Gaia(_, number)) => number.cast_signed(),
        Some(SourceId::Hipparcos(number)) => -i64::from(number),
        Some(SourceId::Tycho(region, number, component)) => {
            let [region, number, component] = [region, number, component].map(i64::from);
            -(TYCHO_NUMBERS + 1_000_000 * region + 10 * number + component)
        }
        Some(SourceId::Own(number)) => number,
        None => NO_NUMBER,
    }
}

/// Returns the bright star with a number below zero.
fn bright(number: i64) -> Option<SourceId> {
    let size = number.checked_neg()?;
    if (1..HIPPARCOS_END).contains(&size) {
        return u32::try_from(size).ok().map(SourceId::Hipparcos);
    }
    let tycho = u64::try_from(size.checked_sub(TYCHO_NUMBERS)?).ok()?;
    let part = |value: u64| u32::try_from(value).ok();
    let region = part(tycho / 1_000_000).filter(|region| (1..100_000).contains(region))?;
    Some(SourceId::Tycho(region, part(tycho / 10 % 100_000)?, part(tycho % 10)?))
}

/// Number of stars, Gaia numbers in ascending order, Hipparcos numbers; little-endian.
const TABLE: &[u8] = include_bytes!("catalog/gaia_hipparcos.bin");
const GAIA_BYTES: usize = 8;
const HIPPARCOS_BYTES: usize = 4;
/// The number of stars comes first.
const HEAD_BYTES: usize = 4;

/// Returns the Hipparcos number of a star that Gaia DR3 knows by `source_id`; `None` when the table has none.
pub fn hipparcos_of_gaia(source_id: u64) -> Option<u32> {
    let count = (TABLE.len() - HEAD_BYTES) / (GAIA_BYTES + HIPPARCOS_BYTES);
    let (gaia, hipparcos) = TABLE[HEAD_BYTES..].split_at(count * GAIA_BYTES);
    let gaia = gaia.as_chunks::<GAIA_BYTES>().0;
    let place = gaia.binary_search_by_key(&source_id, |bytes| u64::from_le_bytes(*bytes)).ok()?;
    hipparcos.as_chunks::<HIPPARCOS_BYTES>().0.get(place).map(|bytes| u32::from_le_bytes(*bytes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::units::DEG;

    /// Barnard's star: `source_id`, right ascension and declination at J2016, deg.
    const BARNARD: (i64, [f64; 2]) = (4_472_832_130_942_575_872, [269.448_503, 4.739_420]);

    #[test]
    fn gaia_numbers_lie_where_they_say() {
        let (number, [ra, dec]) = BARNARD;
        assert!(is_gaia_number(number, ra * DEG, dec * DEG));
        assert!(!is_gaia_number(number, ra * DEG, (dec + 0.1) * DEG), "control: six arcminutes off");
        let own = (1..=2000).filter(|n| is_gaia_number(*n, f64::from(*n as i32) * 0.003, 0.3)).count();
        assert_eq!(own, 0, "small numbers are those of a cell at RA 45, Dec 0");
        for number in [0, -1, i64::MAX, NO_NUMBER] {
            assert!(!is_gaia_number(number, ra * DEG, dec * DEG), "{number}");
        }
    }

    #[test]
    fn stored_numbers_become_names() {
        let (number, [ra, dec]) = BARNARD;
        let mut origins = Origins::default();
        origins.see(number, ra * DEG, dec * DEG);
        origins.see(-32_349, 1.0, 1.0);
        origins.see(-1_000_001_000_131, 1.0, 1.0);
        let name = |numbering: Numbering, number| numbering.source_id(number).map(|id| id.to_string());
        for (epoch_yr, wanted) in [(2016.0, "Gaia DR3 4472832130942575872"), (2015.5, "Gaia DR2 4472832130942575872")] {
            let numbering = origins.numbering(epoch_yr);
            assert_eq!(name(numbering, number).as_deref(), Some(wanted));
            assert_eq!(name(numbering, -32_349).as_deref(), Some("HIP 32349"));
            assert_eq!(name(numbering, -1_000_001_000_131).as_deref(), Some("TYC 1-13-1"));
            assert_eq!(name(numbering, NO_NUMBER), None);
            assert_eq!(Numbering::of_mark(numbering.mark()), Some(numbering));
            for stored in [number, -32_349, -1_000_001_000_131, -7_000_000_000_000, NO_NUMBER] {
                assert_eq!(stored_number(numbering.source_id(stored)), stored);
            }
        }
        let own = Numbering::default();
        assert_eq!(name(own, 5).as_deref(), Some("5"));
        assert_eq!(name(own, -32_349).as_deref(), Some("-32349"), "a user's own number does not name a Hipparcos star");
        assert_eq!((Numbering::of_mark(0), Numbering::of_mark(9)), (None, None));
        origins.see(-2_000_000, 1.0, 1.0);
        assert!(!origins.numbering(2016.0).bright, "numbers below zero outside the ranges of bright stars");
    }
}

#[cfg(test)]
mod hipparcos_tests {
    use super::*;

    #[test]
    fn known_stars_have_their_numbers_and_others_have_none() {
        // A star of magnitude 5.8 in Cetus.
        assert_eq!(hipparcos_of_gaia(650_159_265_042_048), Some(14_315));
        assert_eq!(hipparcos_of_gaia(650_159_265_042_049), None);
        assert_eq!((hipparcos_of_gaia(0), hipparcos_of_gaia(u64::MAX)), (None, None));
    }

    #[test]
    fn table_is_whole_and_in_order() {
        let count = u32::from_le_bytes(TABLE[..HEAD_BYTES].try_into().unwrap()) as usize;
        assert_eq!(TABLE.len(), HEAD_BYTES + count * (GAIA_BYTES + HIPPARCOS_BYTES));
        let gaia = TABLE[HEAD_BYTES..HEAD_BYTES + count * GAIA_BYTES].as_chunks::<GAIA_BYTES>().0;
        assert!(gaia.windows(2).all(|pair| u64::from_le_bytes(pair[0]) < u64::from_le_bytes(pair[1])));
    }
}
