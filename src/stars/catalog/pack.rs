//! CSV of stars -> packed catalog.
//!
//! Columns, found by name: `source_id`, `ra_deg`, `dec_deg`, `pmra_masyr` (with cos dec), `pmdec_masyr`,
//! `parallax_mas`, `g_mag`, `bp_rp`, and optionally `origin`; others are ignored. An empty or `nan` cell is blank
//! (allowed for proper motion and parallax). Some origins write an unknown proper motion as `0.00,0.00`
//! ([`ORIGINS_WITHOUT_MOTION`]): those become blank too.
//!
//! The numbers in `source_id` are kept: Gaia's, those of bright stars below zero, or one's own ([`Origins`]); credits
//! that are not given are those that the stars' origins ask for.
//!
//! The same CSV gives the same bytes: stars are ordered by tile, stored magnitude, then `source_id`.

use super::layout::{
    DEC_STEP_RAD, FASTEST_MAS_YR, Header, MOST_STARS, NO_PROPER_MOTION, PARALLAX_STEP_MAS, PM_STEP_MAS_YR, RA_STEP_RAD,
    StarRecord, TILE_ORDER, TILES, VERSION, file_crc32,
};
use crate::store::{COLOUR_DOMAIN_MAG, FAINTEST_MAG, MAG_STEP, MAG_ZERO, NO_PARALLAX, nearest_i16, nearest_u16};
use crate::{credits::credits_of, numbering::Origins};
use base::{refused::Refused, units::DEG};
use csv::StringRecord;
use std::io::Read;

/// Origins whose zero proper motion means "not known".
const ORIGINS_WITHOUT_MOTION: [&str; 3] = ["gaia_nopm", "gaia+tyc_lb_nopm", "tyc_only"];
/// Characters of a file that a message shows.
const LONGEST_SHOWN: usize = 400;

/// Counts of packing.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct PackReport {
    /// Stars written.
    pub stars: usize,
    /// Stars without a proper motion.
    pub without_proper_motion: usize,
    /// Stars without a parallax.
    pub without_parallax: usize,
    /// Negative parallaxes stored as zero.
    pub negative_parallaxes: usize,
    /// Colours clamped to -0.5..5.
    pub clamped_colours: usize,
    /// Where stars came from.
    pub origins: Origins,
}

struct Star {
    tile: u64,
    source_id: i64,
    record: StarRecord,
}

/// Packs the CSV's stars, whose positions are those of Julian year `epoch_yr`, with `credits`, or those that their
/// origins ask for.
///
/// # Errors
/// When the text is not CSV, a column is missing or a cell is out of its field's range (with line and column).
pub fn pack(input: impl Read, epoch_yr: f64, credits: Option<&str>) -> Result<(Vec<u8>, PackReport), Refused> {
    let mut reader = csv::Reader::from_reader(input);
    let columns = Columns::find(reader.headers().map_err(not_csv)?)?;
    let mut report = PackReport::default();
    let mut stars = Vec::new();
    for row in reader.records() {
        if stars.len() == MOST_STARS {
            return Err(too_many("stars", MOST_STARS + 1, MOST_STARS));
        }
        stars.push(star(&Row { columns: &columns, cells: row.map_err(not_csv)? }, &mut report)?);
    }
    report.stars = stars.len();
    stars.sort_by_key(|star| (star.tile, star.record.g, star.source_id, star.record.ra, star.record.dec));
    let asked_for = credits_of(&report.origins);
    Ok((file(&stars, &report.origins, epoch_yr, credits.unwrap_or(&asked_for))?, report))
}

fn file(stars: &[Star], origins: &Origins, epoch_yr: f64, credits: &str) -> Result<Vec<u8>, Refused> {
    let header = Header {
        version: VERSION,
        order: u32::from(TILE_ORDER),
        stars: count("stars", stars.len())?,
        credits_bytes: count("bytes of credits", credits.len())?,
        epoch_yr,
        crc32: 0,
        numbering_mark: origins.numbering(epoch_yr).mark(),
    };
    let mut bytes = header.to_bytes().to_vec();
    for tile in 0..=TILES as u64 {
        let first = stars.partition_point(|star| star.tile < tile);
        bytes.extend(count("stars", first)?.to_le_bytes());
    }
    bytes.extend(stars.iter().flat_map(|star| star.record.to_bytes()));
    bytes.extend(stars.iter().flat_map(|star| star.record.parallax.to_le_bytes()));
    bytes.extend(stars.iter().flat_map(|star| star.source_id.to_le_bytes()));
    bytes.extend(credits.as_bytes());
    let header = Header { crc32: file_crc32(&bytes), ..header };
    bytes[..header.to_bytes().len()].copy_from_slice(&header.to_bytes());
    Ok(bytes)
}

fn count(what: &'static str, count: usize) -> Result<u32, Refused> {
    u32::try_from(count).map_err(|_| too_many(what, count, u32::MAX as usize))
}

fn star(row: &Row<'_>, report: &mut PackReport) -> Result<Star, Refused> {
    let ra_rad = row.required(RA, 0.0, 360.0)? * DEG;
    let dec_rad = row.required(DEC, -90.0, 90.0)? * DEG;
    let [pm_ra, pm_dec] = proper_motion(row, report)?;
    let record = StarRecord {
        ra: wrap_u32(ra_rad / RA_STEP_RAD),
        dec: nearest_i32(dec_rad / DEC_STEP_RAD),
        pm_ra,
        pm_dec,
        g: nearest_u16((row.required(G, MAG_ZERO, FAINTEST_MAG)? - MAG_ZERO) / MAG_STEP),
        bp_rp: colour(row, report)?,
        parallax: parallax(row, report)?,
    };
    let tile = crate::healpix::cell(TILE_ORDER, ra_rad, dec_rad);
    let source_id = row.source_id()?;
    report.origins.see(source_id, ra_rad, dec_rad);
    report.origins.see_words(row.origin());
    Ok(Star { tile, source_id, record })
}

fn proper_motion(row: &Row<'_>, report: &mut PackReport) -> Result<[i32; 2], Refused> {
    let east = row.optional(PM_RA, -FASTEST_MAS_YR, FASTEST_MAS_YR)?;
    let north = row.optional(PM_DEC, -FASTEST_MAS_YR, FASTEST_MAS_YR)?;
    let unknown_as_zero = ORIGINS_WITHOUT_MOTION.contains(&row.origin());
    match (east, north) {
        (Some(east), Some(north)) if !(unknown_as_zero && east == 0.0 && north == 0.0) => {
            Ok([east, north].map(|pm| nearest_i32(pm / PM_STEP_MAS_YR)))
        }
        _ => {
            report.without_proper_motion += 1;
            Ok([NO_PROPER_MOTION; 2])
        }
    }
}

fn parallax(row: &Row<'_>, report: &mut PackReport) -> Result<u16, Refused> {
    let most_mas = f64::from(NO_PARALLAX - 1) * PARALLAX_STEP_MAS;
    let Some(parallax_mas) = row.optional(PARALLAX, -most_mas, most_mas)? else {
        report.without_parallax += 1;
        return Ok(NO_PARALLAX);
    };
    report.negative_parallaxes += usize::from(parallax_mas < 0.0);
    Ok(nearest_u16(parallax_mas.max(0.0) / PARALLAX_STEP_MAS))
}

fn colour(row: &Row<'_>, report: &mut PackReport) -> Result<i16, Refused> {
    let bp_rp = row.required(BP_RP, -10.0, 20.0)?;
    let clamped = bp_rp.clamp(COLOUR_DOMAIN_MAG[0], COLOUR_DOMAIN_MAG[1]);
    report.clamped_colours += usize::from(bp_rp != clamped);
    Ok(nearest_i16(clamped / MAG_STEP))
}

#[allow(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "the cell was checked to be in range; a full turn wraps to zero"
)]
fn wrap_u32(steps: f64) -> u32 {
    steps.round() as u64 as u32
}
#[allow(clippy::cast_possible_truncation, reason = "float-to-int casts saturate: +90 degrees is the last step")]
fn nearest_i32(steps: f64) -> i32 {
    steps.round() as i32
}

const RA: usize = 0;
const DEC: usize = 1;
const PM_RA: usize = 2;
const PM_DEC: usize = 3;
const PARALLAX: usize = 4;
const G: usize = 5;
const BP_RP: usize = 6;
const SOURCE_ID: usize = 7;
/// Names of the columns.
pub const NAMES: [&str; 8] =
    ["ra_deg", "dec_deg", "pmra_masyr", "pmdec_masyr", "parallax_mas", "g_mag", "bp_rp", "source_id"];

struct Columns {
    places: [usize; NAMES.len()],
    origin: Option<usize>,
}

impl Columns {
    fn find(header: &StringRecord) -> Result<Self, Refused> {
        let place = |name: &str| header.iter().position(|cell| cell.trim() == name);
        let missing: Vec<&str> = NAMES.into_iter().filter(|name| place(name).is_none()).collect();
        if !missing.is_empty() {
            let got = header.iter().collect::<Vec<_>>().join(",").chars().take(LONGEST_SHOWN).collect::<String>();
            return Err(Refused(format!(
                "catalog CSV: no column {missing}; got {got}; cells may be blank, or take the CSV in by `starloop catalog import`, \
         which reads Gaia's column names and, by --column, others",
                missing = missing.join(", ")
            )));
        }
        let places = NAMES.map(|name| place(name).unwrap_or(usize::MAX));
        Ok(Self { places, origin: place("origin") })
    }
}

struct Row<'a> {
    columns: &'a Columns,
    cells: StringRecord,
}

impl Row<'_> {
    fn text(&self, column: usize) -> &str {
        self.cells.get(self.columns.places[column]).unwrap_or("").trim()
    }

    fn origin(&self) -> &str {
        self.columns.origin.and_then(|place| self.cells.get(place)).unwrap_or("").trim()
    }

    fn refuse(&self, column: usize, wanted: String) -> Refused {
        let line = self.cells.position().map_or(0, csv::Position::line);
        let got = self.text(column).chars().take(LONGEST_SHOWN).collect::<String>();
        Refused(format!(
            "catalog CSV, line {line}, column {column}: wanted {wanted}, got \"{got}\"",
            column = NAMES[column]
        ))
    }

    fn required(&self, column: usize, low: f64, high: f64) -> Result<f64, Refused> {
        self.optional(column, low, high)?.ok_or_else(|| self.refuse(column, format!("a number in {low}..{high}")))
    }

    fn optional(&self, column: usize, low: f64, high: f64) -> Result<Option<f64>, Refused> {
        let text = self.text(column);
        if text.is_empty() || text.eq_ignore_ascii_case("nan") {
            return Ok(None);
        }
        let value = text.parse().ok().filter(|value| (low..=high).contains(value));
        value.map(Some).ok_or_else(|| self.refuse(column, format!("a number in {low}..{high}")))
    }

    fn source_id(&self) -> Result<i64, Refused> {
        self.text(SOURCE_ID).parse().map_err(|_| self.refuse(SOURCE_ID, "an integer".into()))
    }
}

/// More stars or text than a catalog in memory is meant to hold.
pub(crate) fn too_many(what: &'static str, count: usize, most: usize) -> Refused {
    Refused(format!(
        "packed catalog: {count} {what}, wanted at most {most}: `starloop catalog import` takes any number of stars"
    ))
}

/// The text is not CSV, or could not be read.
pub(crate) fn not_csv(why: csv::Error) -> Refused {
    Refused(format!("catalog CSV: {why}"))
}
