//! Gaia's bulk CSV (`GaiaSource_AAAAAA-BBBBBB.csv.gz`: an ECSV header of `#` lines, `null` for what is blank) -> stars.
//!
//! Columns, found by name, others ignored: `source_id`, `ra`, `dec` (deg, ICRS), `pmra` (with cos dec), `pmdec`
//! (mas/yr), `parallax` (mas), `phot_g_mean_mag`, and `bp_rp` or else `phot_bp_mean_mag` and `phot_rp_mean_mag` (mag),
//! `ref_epoch` (Julian year of the place); or the names that `starloop catalog pack` takes (`ra_deg`, `g_mag` and so on).
//! Where a file has other names, [`Names`] says so. A cell may be in quotes; a row is one line all the same, so that a
//! stray quote cannot swallow the lines after it, and at most [`LONGEST_LINE`]. Blank is an empty cell, `null`, `nan`
//! or `NaN`. A row without place or magnitude is left out and counted: nothing can be drawn of it; so is a line of `#`
//! after the header: it may be a row whose first bytes are damaged. Places are of the epoch that the user names, J2016.0
//! (Gaia DR3) otherwise; one of another `ref_epoch` is moved to it in a straight line, without radial velocity, and
//! counted. Tests: `tests` below, `damage_tests`.

use super::lines::{Lines, TextLine};
use base::source::{direction_from_ra_dec, ra_dec_rad};
use base::units::{DEG, MAS};
use base::{input_file::InputFile, refused::Refused};
use flate2::read::MultiGzDecoder;
use glam::DVec3;
use stars::{catalog::PACKED_NAMES, layer::NewStar, layer::Sorting};
use std::io::{BufRead, BufReader};
use std::path::Path;

/// Epoch of Gaia DR3's positions, Julian year.
pub const EPOCH_YR: f64 = 2016.0;
/// Longest line, bytes: the archive's rows of 152 columns have some 1,500.
pub const LONGEST_LINE: usize = 1 << 20;
/// Characters of a file that a message shows.
const LONGEST_SHOWN: usize = 400;
/// Rows from one call of `progress` to the next.
const ROWS_A_STEP: u64 = 50_000;
/// Count of rows left out because they have no place.
pub const WITHOUT_PLACE: &str = "rows without a place, left out";
/// Count of rows left out because they have no G magnitude.
pub const WITHOUT_MAGNITUDE: &str = "rows without a G magnitude, left out";
/// Count of rows whose place was moved to the epoch of the layers.
pub const MOVED: &str = "rows of another ref_epoch, moved to the epoch of the layers";
/// Count of rows of another epoch that could not be moved.
pub const NOT_MOVED: &str = "rows of another ref_epoch without a proper motion, taken where they are";
/// Count of lines after the header that begin as those before it.
pub const COMMENTS: &str = "lines of # after the header, left out";
/// Count of last lines that end with the file: of a row that is cut short in its last cell, nothing else is seen.
pub const WITHOUT_END: &str = "last lines without an end, taken: the file may be cut short";

/// Columns by what they hold, as a file names them, and the epoch of the places in Julian years.
#[derive(Debug, Clone, PartialEq)]
pub struct Names {
    columns: [String; COLUMNS],
    pub(crate) epoch_yr: f64,
}

pub(crate) const SOURCE_ID: usize = 0;
pub(crate) const RA: usize = 1;
pub(crate) const DEC: usize = 2;
pub(crate) const PM_RA: usize = 3;
pub(crate) const PM_DEC: usize = 4;
pub(crate) const PARALLAX: usize = 5;
pub(crate) const G: usize = 6;
pub(crate) const BP_RP: usize = 7;
pub(crate) const BP: usize = 8;
pub(crate) const RP: usize = 9;
pub(crate) const REF_EPOCH: usize = 10;
pub(crate) const COLUMNS: usize = 11;

/// Names in Gaia's archive.
const ARCHIVE: [&str; COLUMNS] = [
    "source_id",
    "ra",
    "dec",
    "pmra",
    "pmdec",
    "parallax",
    "phot_g_mean_mag",
    "bp_rp",
    "phot_bp_mean_mag",
    "phot_rp_mean_mag",
    "ref_epoch",
];

/// Names in a CSV for `starloop catalog pack`; a file may have either.
const PACKED: [&str; COLUMNS] = {
    let [ra, dec, pm_ra, pm_dec, parallax, g, bp_rp, id] = PACKED_NAMES;
    [id, ra, dec, pm_ra, pm_dec, parallax, g, bp_rp, ARCHIVE[BP], ARCHIVE[RP], ARCHIVE[REF_EPOCH]]
};

impl Default for Names {
    /// Returns the names of Gaia's archive, and the epoch of DR3.
    fn default() -> Self {
        Self { columns: ARCHIVE.map(String::from), epoch_yr: EPOCH_YR }
    }
}

impl Names {
    /// Returns the same columns, of places at another epoch.
    #[must_use]
    pub fn at_epoch(self, epoch_yr: f64) -> Self {
        Self { epoch_yr, ..self }
    }

    /// Returns the column that Gaia's archive calls `archive` is called `here`; false when the archive has no such
    /// column.
    pub fn rename(&mut self, archive: &str, here: &str) -> bool {
        let place = ARCHIVE.iter().position(|name| *name == archive);
        place.map(|place| self.columns[place] = here.into()).is_some()
    }

    /// Renames a column as [`Self::rename`] does, unless it was renamed before.
    pub fn rename_unless_renamed(&mut self, archive: &str, here: &str) {
        if self.columns.iter().zip(ARCHIVE).any(|(name, of_archive)| of_archive == archive && name == archive) {
            self.rename(archive, here);
        }
    }

    /// Returns the name of the column in the file.
    pub(crate) fn here(&self, column: usize) -> &str {
        &self.columns[column]
    }

    /// Returns the place of a column among those of a file, by its name here, or by that of a CSV to pack.
    fn place(&self, column: usize, cells: &[&str]) -> Option<usize> {
        let place = |name: &str| cells.iter().position(|cell| *cell == name).filter(|_| !name.is_empty());
        let packed = PACKED[column];
        place(self.here(column)).or_else(|| place(packed).filter(|_| self.here(column) == ARCHIVE[column]))
    }

    /// Returns the columns that a file must have and `is_there` says it has not, by their names in the file: all but
    /// colours, which are complete in one form, the epoch, and those that are said to be missing (an empty name).
    pub(crate) fn missing(&self, is_there: impl Fn(usize) -> bool) -> Vec<&str> {
        let is_missing = |column: &usize| match *column {
            BP_RP => !(is_there(BP_RP) || is_there(BP) && is_there(RP)),
            BP | RP | REF_EPOCH => false,
            column => !is_there(column),
        };
        let wanted = (0..COLUMNS).filter(|column| !self.here(*column).is_empty()).filter(is_missing);
        wanted.map(|column| self.here(column)).collect()
    }

    /// Returns columns that may be said to be missing, by their names in Gaia's archive: nothing else is known of their
    /// values.
    pub fn may_be_missing(archive: &str) -> bool {
        [PM_RA, PM_DEC, PARALLAX, BP_RP, REF_EPOCH].iter().any(|column| ARCHIVE[*column] == archive)
    }

    /// Returns the columns that may be renamed.
    pub fn all() -> &'static [&'static str] {
        &ARCHIVE
    }
}

/// Takes a file in, `.csv` or `.csv.gz`; returns the number of rows. `progress` gets the rows now and then.
///
/// # Errors
/// When the file cannot be read to its end, lacks a column, or a cell is not a number; stars taken in before are then
/// to be forgotten (no checkpoint was written).
pub fn import(
    path: &Path,
    names: &Names,
    sorting: &mut Sorting,
    progress: &mut dyn FnMut(u64),
) -> Result<u64, Refused> {
    let file = InputFile::open(path, u64::MAX)
        .map_err(|source| Refused::at(path, format_args!("{source}; what was read before is not used")))?;
    let is_packed = path.extension().is_some_and(|kind| kind.eq_ignore_ascii_case("gz"));
    let file = BufReader::with_capacity(1 << 20, file);
    if is_packed {
        import_text(BufReader::new(MultiGzDecoder::new(file)), path, names, sorting, progress)
    } else {
        import_text(file, path, names, sorting, progress)
    }
}

/// Takes a file's text in; `path` is for messages.
///
/// # Errors
/// As [`import`].
pub fn import_text(
    text: impl BufRead,
    path: &Path,
    names: &Names,
    sorting: &mut Sorting,
    progress: &mut dyn FnMut(u64),
) -> Result<u64, Refused> {
    let mut lines = Lines::new(text, path, LONGEST_LINE);
    let columns = loop {
        match lines.next()? {
            Some(line) if line.text.starts_with('#') => {}
            header => break Columns::find(path, names, header.map_or("", |line| line.text))?,
        }
    };
    let mut rows = 0;
    while let Some(line) = lines.next()? {
        if line.text.starts_with('#') {
            sorting.announce(COMMENTS, 1);
            continue;
        }
        rows += 1;
        let row = Row::split(&columns, &line)?;
        if let Some(star) = row.star(sorting)? {
            sorting.add(&star).map_err(|source| {
                Refused(format!("{path}, line {line}: {source}", path = path.display(), line = line.number))
            })?;
        }
        if !line.is_ended {
            sorting.announce(WITHOUT_END, 1);
        }
        if rows % ROWS_A_STEP == 0 {
            progress(rows);
        }
    }
    progress(rows);
    Ok(rows)
}

/// Values that a cell of a column may have, in the column's unit, and in words.
type CellRange = (usize, [f64; 2], &'static str);
/// Columns of places.
const ANGLES: [CellRange; 2] =
    [(RA, [0.0, 360.0], "degrees from 0 to 360"), (DEC, [-90.0, 90.0], "degrees from -90 to 90")];

/// Returns a row of Gaia's archive as a star; `None`, counted, when nothing can be drawn of it. `number` gives a cell
/// by its column, `None` where it is blank; `refuse` makes an error of a cell by its column, what was wanted, and what
/// it holds. The place is moved to `epoch_yr` where the row states another one.
pub(crate) fn star_of_row<E>(
    source_id: i64,
    epoch_yr: f64,
    number: impl Fn(usize) -> Result<Option<f64>, E>,
    refuse: impl Fn(usize, &'static str, f64) -> E,
    sorting: &mut Sorting,
) -> Result<Option<NewStar>, E> {
    let (Some(ra_deg), Some(dec_deg)) = (number(RA)?, number(DEC)?) else {
        sorting.announce(WITHOUT_PLACE, 1);
        return Ok(None);
    };
    for ((column, [low, high], wanted), angle) in ANGLES.into_iter().zip([ra_deg, dec_deg]) {
        if !(low..=high).contains(&angle) {
            return Err(refuse(column, wanted, angle));
        }
    }
    let Some(mag_g) = number(G)? else {
        sorting.announce(WITHOUT_MAGNITUDE, 1);
        return Ok(None);
    };
    let bp_rp = match (number(BP_RP)?, number(BP)?, number(RP)?) {
        (Some(bp_rp), ..) => Some(bp_rp),
        (None, Some(bp), Some(rp)) => Some(bp - rp),
        _ => None,
    };
    let motion_mas_yr = number(PM_RA)?.zip(number(PM_DEC)?).map(<[f64; 2]>::from);
    let parallax_mas = number(PARALLAX)?;
    let (ra_rad, dec_rad) = (ra_deg * DEG, dec_deg * DEG);
    let star = NewStar { source_id, ra_rad, dec_rad, motion_mas_yr, parallax_mas, mag_g, bp_rp };
    let ref_epoch_yr = number(REF_EPOCH)?.unwrap_or(epoch_yr);
    if !(1900.0..=2100.0).contains(&ref_epoch_yr) {
        return Err(refuse(REF_EPOCH, "a Julian year from 1900 to 2100", ref_epoch_yr));
    }
    let years = epoch_yr - ref_epoch_yr;
    if years == 0.0 {
        return Ok(Some(star));
    }
    let moved = motion_mas_yr.map(|motion_mas_yr| moved(&star, motion_mas_yr, years));
    sorting.announce(if moved.is_some() { MOVED } else { NOT_MOVED }, 1);
    Ok(Some(moved.unwrap_or(star)))
}

/// Returns a star years later, on a straight line (ESA, The Hipparcos and Tycho Catalogues, vol. 1, section 1.5.5,
/// without radial velocity).
fn moved(star: &NewStar, motion_mas_yr: [f64; 2], years: f64) -> NewStar {
    // The directions of east and north at a place.
    let axes = |ra_rad: f64, dec_rad: f64| {
        let ((sin_ra, cos_ra), (sin_dec, cos_dec)) = (ra_rad.sin_cos(), dec_rad.sin_cos());
        [DVec3::new(-sin_ra, cos_ra, 0.0), DVec3::new(-sin_dec * cos_ra, -sin_dec * sin_ra, cos_dec)]
    };
    let place = direction_from_ra_dec(star.ra_rad, star.dec_rad);
    let [east, north] = axes(star.ra_rad, star.dec_rad);
    let [pm_ra, pm_dec] = motion_mas_yr.map(|mas_yr| mas_yr * MAS);
    let per_yr = east * pm_ra + north * pm_dec;
    let line = place + per_yr * years;
    let later = line.normalize();
    let [ra_rad, dec_rad] = ra_dec_rad(later);
    let turned = (per_yr - later * later.dot(per_yr)) / line.length();
    let motion = axes(ra_rad, dec_rad).map(|axis| axis.dot(turned) / MAS);
    NewStar { ra_rad, dec_rad, motion_mas_yr: Some(motion), ..*star }
}

/// Returns the text of a cell, without blanks and the pair of quotes that may be around it.
fn without_quotes(cell: &str) -> &str {
    // Blanks alone: the bit that makes a carriage return of a minus sign must not make a number positive.
    let blanks = [' ', '\t'];
    let cell = cell.trim_matches(blanks);
    cell.strip_prefix('"').and_then(|cell| cell.strip_suffix('"')).map_or(cell, |cell| cell.trim_matches(blanks))
}

struct Columns<'a> {
    path: &'a Path,
    names: &'a Names,
    /// `None`: the file has no such column, and needs none.
    places: [Option<usize>; COLUMNS],
    /// Cells of a line.
    count: usize,
}

impl<'a> Columns<'a> {
    fn find(path: &'a Path, names: &'a Names, header: &str) -> Result<Self, Refused> {
        // Some programs begin a file with the mark of UTF-8.
        let header = header.trim_start_matches('\u{feff}');
        let cells: Vec<&str> = header.split(',').map(without_quotes).collect();
        let places: [Option<usize>; COLUMNS] = core::array::from_fn(|column| names.place(column, &cells));
        let missing = names.missing(|column| places[column].is_some());
        if missing.is_empty() {
            return Ok(Self { path, names, places, count: cells.len() });
        }
        let got = header.chars().take(LONGEST_SHOWN).collect::<String>();
        Err(Refused::at(
            path,
            format_args!(
                "no column {missing}; got {got}; say what the file calls them, such as --column phot_g_mean_mag=NAME, or that it \
         has none, such as --column pmra= (of pmra, pmdec, parallax and bp_rp)",
                missing = missing.join(", ")
            ),
        ))
    }
}

struct Row<'a> {
    columns: &'a Columns<'a>,
    line: u64,
    cells: Vec<&'a str>,
}

impl<'a> Row<'a> {
    fn split(columns: &'a Columns<'a>, line: &TextLine<'a>) -> Result<Self, Refused> {
        let mut cells = Vec::with_capacity(columns.count);
        cells.extend(line.text.split(','));
        if cells.len() != columns.count {
            let (path, wanted, got) = (columns.path, columns.count, cells.len());
            return Err(Refused(format!(
                "{path}, line {line}: wanted {wanted} cells as the header has, got {got}; the file may be cut short, or a cell has a \
         comma in it",
                path = path.display(),
                line = line.number
            )));
        }
        Ok(Self { columns, line: line.number, cells })
    }

    /// Returns the star of the row; `None`, counted, when nothing can be drawn of it.
    fn star(&self, sorting: &mut Sorting) -> Result<Option<NewStar>, Refused> {
        let text = self.text(SOURCE_ID);
        let source_id = text.parse().map_err(|_| self.refuse(SOURCE_ID, "a whole number"))?;
        let refuse = |column, wanted, _| self.refuse(column, wanted);
        star_of_row(source_id, self.columns.names.epoch_yr, |column| self.number(column), refuse, sorting)
    }

    fn text(&self, column: usize) -> &str {
        self.columns.places[column].and_then(|place| self.cells.get(place)).map_or("", |cell| without_quotes(cell))
    }

    /// Returns a number, or `None` where the cell is blank or the file has no such column.
    fn number(&self, column: usize) -> Result<Option<f64>, Refused> {
        let text = self.text(column);
        if text.is_empty() || ["null", "nan"].iter().any(|blank| text.eq_ignore_ascii_case(blank)) {
            return Ok(None);
        }
        let number = text.parse().ok().filter(|number: &f64| number.is_finite());
        number.map(Some).ok_or_else(|| self.refuse(column, "a number, or null"))
    }

    fn refuse(&self, column: usize, wanted: &'static str) -> Refused {
        Refused(format!(
            "{path}, line {line}, column {column}: wanted {wanted}, got \"{got}\"",
            path = self.columns.path.display(),
            line = self.line,
            column = self.columns.names.columns[column],
            got = self.text(column).chars().take(LONGEST_SHOWN).collect::<String>()
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::{Compression, write::GzEncoder};
    use glam::DVec3;
    use stars::layer::Layer;
    use std::io::Write;

    /// The head of a bulk file, as the archive writes it, with two rows; the second lacks much.
    const BULK: &str = "# %ECSV 1.0\n# ---\n# delimiter: ','\n# datatype:\n# - {name: source_id, datatype: int64}\n\
        solution_id,source_id,ref_epoch,ra,dec,parallax,pmra,pmdec,phot_g_mean_mag,phot_bp_mean_mag,phot_rp_mean_mag,bp_rp\n\
        1636148068921376768,4295806720,2016.0,44.99615537864534,0.005615226341865997,0.3543305595550248,\
        11.938616,-3.4,17.641426,18.1,16.9,1.2\n\
        1636148068921376768,34361129088,2016.0,45.0,0.02,null,null,null,18.5,null,null,null\n";

    fn take(text: &[u8], name: &str, names: &Names) -> (Result<u64, Refused>, Sorting, tempfile::TempDir) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(name);
        std::fs::write(&path, text).unwrap();
        let mut sorting = Sorting::start(&folder.path().join("work"), &[22.0]).unwrap();
        let done = import(&path, names, &mut sorting, &mut |_| {});
        (done, sorting, folder)
    }

    fn packed(text: &[u8]) -> Vec<u8> {
        let mut encoder = GzEncoder::new(Vec::new(), Compression::fast());
        encoder.write_all(text).unwrap();
        encoder.finish().unwrap()
    }

    /// Returns the stars of a text at an epoch, and the counts that were reported.
    fn stars_at(text: &str, epoch_yr: f64) -> (Vec<base::source::CatalogSource>, Vec<(String, u64)>) {
        let (done, sorting, folder) = take(text.as_bytes(), "g.csv", &Names::default().at_epoch(epoch_yr));
        done.unwrap();
        let counts = sorting.reported().map(|(what, count)| (what.to_owned(), count)).collect();
        let reports = sorting.finish(folder.path(), epoch_yr, "", &mut |_| {}).unwrap();
        let mut found = Vec::new();
        Layer::open(&reports[0].path).unwrap().cone(DVec3::Z, 4.0, 99.0, &mut found).unwrap();
        found.sort_by(|a, b| a.mag_g.total_cmp(&b.mag_g));
        (found, counts)
    }

    #[test]
    fn places_of_another_ref_epoch_are_moved_to_that_of_the_layers() {
        let text = "source_id,ref_epoch,ra,dec,pmra,pmdec,parallax,phot_g_mean_mag,bp_rp\n\
            11,2015.5,10.0,20.0,8000,-6000,10,5.0,0.8\n12,1991.25,11.0,20.0,8000,-6000,10,6.0,0.8\n\
            13,1991.25,12.0,20.0,,,10,7.0,0.8\n14,,13.0,20.0,8000,-6000,10,8.0,0.8\n";
        let (stars, counts) = stars_at(text, 2016.0);
        // Ten arcseconds a year, for 0.5 and 24.75 years: degrees by hand, with cos 20 deg.
        let wanted = [(10.001_182, 19.999_167), (11.058_53, 19.958_75), (12.0, 20.0), (13.0, 20.0)];
        for (star, (ra_deg, dec_deg)) in stars.iter().zip(wanted) {
            let off = star.direction_icrf.angle_between(direction_from_ra_dec(ra_deg * DEG, dec_deg * DEG)) / MAS;
            // The wanted degrees have five digits, and are along the parallel: 40 mas from a straight line.
            assert!(off < 100.0, "{off} mas at {ra_deg}");
        }
        let count = |wanted: &str| counts.iter().find(|(what, _)| what == wanted).map_or(0, |(_, count)| *count);
        assert_eq!((stars.len(), count(MOVED), count(NOT_MOVED)), (4, 2, 1));
        let (stars, _) = stars_at(text, 2015.5);
        let off = stars[0].direction_icrf.angle_between(direction_from_ra_dec(10.0 * DEG, 20.0 * DEG)) / MAS;
        assert!(off < 1.0, "at its own epoch it stays: {off} mas");
        let wrong = text.replace("11,2015.5", "11,2.0155");
        let (done, ..) = take(wrong.as_bytes(), "g.csv", &Names::default());
        let message = done.unwrap_err().to_string();
        assert!(message.contains("line 2, column ref_epoch: wanted a Julian year"), "{message}");
        let mut left_out = Names::default();
        left_out.rename("ref_epoch", "");
        assert_eq!(take(wrong.as_bytes(), "g.csv", &left_out).0.unwrap(), 4, "a column that is said to be missing");
    }

    #[test]
    fn bulk_files_are_read_packed_or_not() {
        for (text, name) in [(BULK.as_bytes().to_vec(), "g.csv"), (packed(BULK.as_bytes()), "g.csv.gz")] {
            let (done, sorting, folder) = take(&text, name, &Names::default());
            assert_eq!(done.unwrap(), 2);
            let counts = sorting.counts();
            assert_eq!((counts.stars, counts.without_motion, counts.without_parallax), (2, 1, 1));
            assert_eq!(counts.without_colour, 1);
            let reports = sorting.finish(folder.path(), EPOCH_YR, "", &mut |_| {}).unwrap();
            let mut found = Vec::new();
            Layer::open(&reports[0].path).unwrap().cone(DVec3::Z, 4.0, 99.0, &mut found).unwrap();
            let [bright, faint] = found[..] else { panic!("two stars") };
            // Python's math, from 44.99615537864534 and 0.005615226341865997 degrees.
            let wanted = DVec3::new(0.707154223984, 0.707059328414, 0.000098004188);
            assert!((bright.direction_icrf - wanted).length() < 2e-9, "{:?}", bright.direction_icrf);
            assert!((bright.mag_g - 17.641).abs() < 1e-3 && (bright.bp_rp - 1.2).abs() < 1e-6);
            assert!((bright.proper_motion.unwrap().pm_ra_cosdec_mas_yr - 11.95).abs() < 0.026);
            assert!(faint.proper_motion.is_none() && faint.parallax_mas.is_none());
        }
    }

    #[test]
    fn rows_of_which_nothing_can_be_drawn_are_counted() {
        let head = "source_id,ra,dec,pmra,pmdec,parallax,phot_g_mean_mag,bp_rp\n";
        let text = format!("{head}1,,2.0,,,,15.0,1.0\n2,1.0,2.0,,,,null,1.0\n3,1.0,2.0,1.0,,,15.0,\n");
        let (done, sorting, _folder) = take(text.as_bytes(), "g.csv", &Names::default());
        assert_eq!((done.unwrap(), sorting.counts().stars), (3, 1));
        assert_eq!(sorting.reported().collect::<Vec<_>>(), [(WITHOUT_MAGNITUDE, 1), (WITHOUT_PLACE, 1)]);
        assert_eq!(sorting.counts().without_motion, 1, "half a motion is none");
    }

    #[test]
    fn other_names_and_colours_in_two_columns() {
        let text = "id,ra,dec,pmra,pmdec,parallax,G,phot_bp_mean_mag,phot_rp_mean_mag\n5,1.0,2.0,,,,15.0,15.5,14.5\n";
        let mut names = Names::default();
        assert!(names.rename("source_id", "id") && names.rename("phot_g_mean_mag", "G"));
        assert!(!names.rename("no_such_column", "x"));
        let (done, sorting, folder) = take(text.as_bytes(), "g.csv", &names);
        done.unwrap();
        let reports = sorting.finish(folder.path(), EPOCH_YR, "", &mut |_| {}).unwrap();
        let mut found = Vec::new();
        Layer::open(&reports[0].path).unwrap().cone(DVec3::Z, 4.0, 99.0, &mut found).unwrap();
        assert!((found[0].bp_rp - 1.0).abs() < 1e-6);
    }

    #[test]
    fn quotes_are_taken_off_and_a_stray_one_costs_no_other_row() {
        let head = "\"source_id\",\"ra\",dec,pmra,pmdec,parallax,phot_g_mean_mag,bp_rp,note\n";
        let (row, last) = ("\"1\",\"3.5\",2.0,,\"\",\"null\",15.0,1.0,\"n\"\n", "2,1.0,2.0,,,,15.0,1.0,\"\n");
        let (done, sorting, _folder) = take(format!("{head}{row}{last}{row}").as_bytes(), "g.csv", &Names::default());
        assert_eq!((done.unwrap(), sorting.counts().stars), (3, 3), "a quote in an unused column");
        let stray = format!("{head}2,\"1.0,2.0,,,,15.0,1.0,\n{row}{row}");
        let reported = take(stray.as_bytes(), "g.csv", &Names::default()).0.unwrap_err().to_string();
        assert!(reported.contains("line 2, column ra: wanted a number"), "{reported}");
        let comma = format!("{head}{}", row.replace("\"n\"", "\"n,m\""));
        let reported = take(comma.as_bytes(), "g.csv", &Names::default()).0.unwrap_err().to_string();
        assert!(reported.contains("wanted 9 cells as the header has, got 10"), "{reported}");
    }

    #[test]
    fn errors_name_file_line_and_column() {
        let refused = |text: &[u8], name: &str| take(text, name, &Names::default()).0.unwrap_err().to_string();
        let bad = BULK.replace("11.938616", "11.9x");
        let reported = refused(bad.as_bytes(), "g.csv");
        assert!(reported.contains("g.csv, line 7, column pmra: wanted a number, or null, got \"11.9x\""), "{reported}");
        let reported = refused(BULK.replace("phot_g_mean_mag", "mag").replace("pmra,", "pm_e,").as_bytes(), "g.csv");
        assert!(reported.contains("g.csv: no column pmra, phot_g_mean_mag; got solution_id,source_id"), "{reported}");
        assert!(
            reported.contains("--column phot_g_mean_mag=NAME") && reported.contains("--column pmra= "),
            "{reported}"
        );
        let reported = refused(BULK.replace("4295806720", "4.3e9").as_bytes(), "g.csv");
        assert!(reported.contains("column source_id: wanted a whole number"), "{reported}");
        let reported = refused(BULK.replace("44.99615537864534", "444.9").as_bytes(), "g.csv");
        assert!(reported.contains("line 7, column ra: wanted degrees from 0 to 360, got \"444.9"), "{reported}");
        let reported = refused(BULK.replace("0.005615226341865997", "95.5").as_bytes(), "g.csv");
        assert!(reported.contains("column dec: wanted degrees from -90 to 90, got \"95.5\""), "{reported}");
        let reported = refused(BULK.replace(",1.2\n", "\n").as_bytes(), "g.csv");
        assert!(reported.contains("line 7: wanted 12 cells"), "{reported}");
        let whole = packed(BULK.as_bytes());
        for cut in [whole.len() - 1, whole.len() - 9, whole.len() / 2] {
            refused(&whole[..cut], "g.csv.gz");
        }
        let mut flipped = whole.clone();
        let crc = flipped.len() - 6;
        flipped[crc] ^= 1;
        refused(&flipped, "g.csv.gz");
        refused(BULK.as_bytes(), "g.csv.gz");
        assert_eq!(take(&whole, "g.csv.gz", &Names::default()).0.unwrap(), 2, "control");
    }
}
