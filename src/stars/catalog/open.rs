//! Packed bytes -> [`Catalog`], decoded and checked once.

use super::cone::Tile;
use super::error::CatalogError;
use super::layout::{
    DEC_STEP_RAD, HEADER_BYTES, Header, MAG_STEP, MAG_ZERO, MAGIC, MOST_BYTES, NO_PARALLAX, NO_PROPER_MOTION,
    NUMBER_BYTES, PARALLAX_BYTES, PARALLAX_STEP_MAS, PM_STEP_MAS_YR, RA_STEP_RAD, RECORD_BYTES, StarRecord, TILE_ORDER,
    TILES, VERSION, file_crc32, u32_at,
};
use crate::numbering::Numbering;
use crate::radial_velocity::radial_mas_yr;
use base::source::{CatalogSource, ProperMotion, direction_from_ra_dec};
use base::source_id::SourceId;
use std::path::Path;

/// The catalog that is part of the program: 106 462 stars to G < 8.5, epoch J2016.0.
static BUILT_IN: &[u8] = include_bytes!("bright_g85.starcat");

/// A star catalog, decoded, in tiles.
#[derive(Debug, Clone)]
pub struct Catalog {
    pub(super) epoch_yr: f64,
    pub(super) crc32: u32,
    pub(super) credits: String,
    pub(super) fastest_mas_yr: f64,
    pub(super) sources: Vec<CatalogSource>,
    pub(super) tiles: Vec<Tile>,
}

impl Catalog {
    /// The catalog that is part of the program.
    ///
    /// # Errors
    /// Never with the bytes this version was built from (`the_built_in_catalog_opens`).
    pub fn built_in() -> Result<Self, CatalogError> {
        Self::from_bytes(BUILT_IN)
    }

    /// Opens a packed catalog file.
    ///
    /// # Errors
    /// When the file cannot be read, and as [`Self::from_bytes`].
    pub fn open(path: &Path) -> Result<Self, CatalogError> {
        let failed = |source| CatalogError::File { path: path.into(), source };
        let length = std::fs::metadata(path).map_err(failed)?.len();
        if length > MOST_BYTES {
            let count = usize::try_from(length).unwrap_or(usize::MAX);
            return Err(CatalogError::TooMany { what: "bytes", count, most: MOST_BYTES as usize });
        }
        let bytes = std::fs::read(path).map_err(|source| CatalogError::File { path: path.into(), source })?;
        Self::from_bytes(&bytes)
    }

    /// Reads a packed catalog.
    ///
    /// # Errors
    /// When the bytes are not a packed catalog, of another version, cut short, too long or damaged.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, CatalogError> {
        let (header, parts) = checked_parts(bytes)?;
        let records = parts.records.chunks_exact(RECORD_BYTES).zip(parts.parallaxes.chunks_exact(PARALLAX_BYTES));
        let numbering = numbering(&header)?;
        let numbers = parts.numbers.as_chunks::<NUMBER_BYTES>().0.iter();
        let named = numbers.map(|bytes| numbering.source_id(i64::from_le_bytes(*bytes)));
        let stars = (0..).zip(records.zip(named));
        let sources: Vec<_> = stars.map(|(id, ((r, p), name))| source(id, name, &record(r, p))).collect();
        let tiles = tiles(parts.offsets, &sources)?;
        let fastest_mas_yr = sources
            .iter()
            .filter_map(|s| s.proper_motion)
            .map(|motion| f64::from(motion.speed_mas_yr()))
            .fold(0.0, f64::max);
        let credits = String::from_utf8_lossy(parts.credits).into_owned();
        Ok(Self { epoch_yr: header.epoch_yr, crc32: header.crc32, credits, fastest_mas_yr, sources, tiles })
    }

    /// Julian year to which the positions refer.
    #[must_use]
    pub fn epoch_yr(&self) -> f64 {
        self.epoch_yr
    }

    /// CRC-32 of the packed file: its fingerprint in reports.
    #[must_use]
    pub fn crc32(&self) -> u32 {
        self.crc32
    }

    /// Credits the catalog's sources ask for.
    #[must_use]
    pub fn credits(&self) -> &str {
        &self.credits
    }

    /// Largest proper motion in the catalog, mas/yr: how much wider a cone must be, per year from the epoch.
    #[must_use]
    pub fn fastest_mas_yr(&self) -> f64 {
        self.fastest_mas_yr
    }

    /// All sources; a source's `id` is its place here.
    #[must_use]
    pub fn sources(&self) -> &[CatalogSource] {
        &self.sources
    }
}

struct Parts<'a> {
    offsets: &'a [u8],
    records: &'a [u8],
    parallaxes: &'a [u8],
    numbers: &'a [u8],
    credits: &'a [u8],
}

fn checked_parts(bytes: &[u8]) -> Result<(Header, Parts<'_>), CatalogError> {
    if !bytes.starts_with(&MAGIC) {
        let shown = &bytes[..bytes.len().min(MAGIC.len())];
        return Err(CatalogError::Magic { got: String::from_utf8_lossy(shown).into_owned() });
    }
    let mut left = Left { bytes, taken: 0 };
    let mut head = [0; HEADER_BYTES];
    head.copy_from_slice(left.take("header", HEADER_BYTES)?);
    let header = Header::from_bytes(&head);
    check_header(&header)?;
    let stars = header.stars as usize;
    let parts = Parts {
        offsets: left.take("tile offsets", (TILES + 1) * 4)?,
        records: left.take("star records", stars.saturating_mul(RECORD_BYTES))?,
        parallaxes: left.take("parallaxes", stars.saturating_mul(PARALLAX_BYTES))?,
        numbers: left.take("numbers", stars.saturating_mul(NUMBER_BYTES))?,
        credits: left.take("credits", header.credits_bytes as usize)?,
    };
    if left.taken != bytes.len() {
        return Err(CatalogError::TrailingBytes { wanted: left.taken, got: bytes.len() });
    }
    let got = file_crc32(bytes);
    if got == header.crc32 { Ok((header, parts)) } else { Err(CatalogError::Checksum { wanted: header.crc32, got }) }
}

fn check_header(header: &Header) -> Result<(), CatalogError> {
    let refuse = |field, wanted: String, got: String| Err(CatalogError::Layout { field, wanted, got });
    if header.version != VERSION {
        let wanted = format!("{VERSION} (pack its CSV again with `starloop catalog pack`)");
        return refuse("format version", wanted, header.version.to_string());
    }
    if header.order != u32::from(TILE_ORDER) {
        return refuse("HEALPix order", TILE_ORDER.to_string(), header.order.to_string());
    }
    if !(1900.0..=2100.0).contains(&header.epoch_yr) {
        return refuse("epoch", "a Julian year in 1900..2100".into(), header.epoch_yr.to_string());
    }
    Ok(())
}

fn numbering(header: &Header) -> Result<Numbering, CatalogError> {
    Numbering::of_mark(header.numbering_mark).ok_or_else(|| CatalogError::Layout {
        field: "origin of numbers",
        wanted: "a mark that this program knows".into(),
        got: header.numbering_mark.to_string(),
    })
}

/// Takes parts off the front of the file.
struct Left<'a> {
    bytes: &'a [u8],
    taken: usize,
}

impl<'a> Left<'a> {
    fn take(&mut self, part: &'static str, count: usize) -> Result<&'a [u8], CatalogError> {
        let wanted = self.taken.saturating_add(count);
        let truncated = CatalogError::Truncated { part, wanted, got: self.bytes.len() };
        let taken = self.bytes.get(self.taken..wanted).ok_or(truncated)?;
        self.taken = wanted;
        Ok(taken)
    }
}

fn record(record: &[u8], parallax: &[u8]) -> StarRecord {
    let mut bytes = [0; RECORD_BYTES];
    bytes.copy_from_slice(record);
    StarRecord::from_bytes(&bytes, [parallax[0], parallax[1]])
}

#[allow(clippy::cast_possible_truncation, reason = "an f32 holds every step of these fields to 1e-7 of itself")]
fn source(id: u32, source_id: Option<SourceId>, star: &StarRecord) -> CatalogSource {
    let known_motion = star.pm_ra != NO_PROPER_MOTION && star.pm_dec != NO_PROPER_MOTION;
    let mas_yr = |steps: i32| (f64::from(steps) * PM_STEP_MAS_YR) as f32;
    let parallax_mas = (star.parallax != NO_PARALLAX).then(|| (f64::from(star.parallax) * PARALLAX_STEP_MAS) as f32);
    let proper_motion = || {
        let [east, north] = [star.pm_ra, star.pm_dec].map(mas_yr);
        let radial_mas_yr = radial_mas_yr(source_id, east.hypot(north), parallax_mas);
        ProperMotion { pm_ra_cosdec_mas_yr: east, pm_dec_mas_yr: north, radial_mas_yr }
    };
    CatalogSource {
        id,
        source_id,
        direction_icrf: direction_from_ra_dec(f64::from(star.ra) * RA_STEP_RAD, f64::from(star.dec) * DEC_STEP_RAD),
        proper_motion: known_motion.then(proper_motion),
        parallax_mas,
        mag_g: (f64::from(star.g) * MAG_STEP + MAG_ZERO) as f32,
        bp_rp: (f64::from(star.bp_rp) * MAG_STEP) as f32,
    }
}

fn tiles(offsets: &[u8], sources: &[CatalogSource]) -> Result<Vec<Tile>, CatalogError> {
    let first_star = |tile: usize| u32_at(offsets, tile * 4) as usize;
    if first_star(0) != 0 || first_star(TILES) != sources.len() {
        let why = format!("offsets wanted 0..{}, got {}..{}", sources.len(), first_star(0), first_star(TILES));
        return Err(CatalogError::Tile { tile: 0, why });
    }
    (0..TILES).map(|tile| Tile::new(tile, first_star(tile), first_star(tile + 1), sources)).collect()
}
