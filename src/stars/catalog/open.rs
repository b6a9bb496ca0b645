//! Packed bytes -> [`Catalog`], decoded and checked once.

use super::layout::{
    DEC_STEP_RAD, HEADER_BYTES, Header, MAGIC, MOST_BYTES, NO_PROPER_MOTION, NUMBER_BYTES, PARALLAX_BYTES,
    PARALLAX_STEP_MAS, PM_STEP_MAS_YR, RA_STEP_RAD, RECORD_BYTES, StarRecord, TILE_ORDER, TILES, VERSION, file_crc32,
};
use crate::store::{MAG_STEP, NO_PARALLAX, mag_of, source, u32_at};
use crate::{StarIndex, catalog::pack, healpix::chord_squared, numbering::Numbering};
use base::source::{CatalogSource, direction_from_ra_dec};
use base::{input_file::read_bytes, refused::Refused, source_id::SourceId};
use glam::DVec3;
use std::path::Path;

/// The catalog that is part of the program: 106 462 stars to G < 8.5, epoch J2016.0.
static BUILT_IN: &[u8] = include_bytes!("bright_g85.starcat");

/// A star catalog, decoded, in tiles: a layer in memory.
#[derive(Debug, Clone)]
pub struct Catalog {
    index: StarIndex,
    sources: Vec<CatalogSource>,
}

impl Catalog {
    /// Returns the catalog that is part of the program.
    ///
    /// # Errors
    /// Never with the bytes this version was built from (`the_built_in_catalog_opens`).
    pub fn built_in() -> Result<Self, Refused> {
        Self::from_bytes(BUILT_IN)
    }

    /// Opens a packed catalog file.
    ///
    /// # Errors
    /// When the file cannot be read, and as [`Self::from_bytes`].
    pub fn open(path: &Path) -> Result<Self, Refused> {
        let failed = |source| Refused(format!("catalog {path}: {source}", path = path.display()));
        let length = std::fs::metadata(path).map_err(failed)?.len();
        if length > MOST_BYTES {
            let count = usize::try_from(length).unwrap_or(usize::MAX);
            return Err(pack::too_many("bytes", count, MOST_BYTES as usize));
        }
        let bytes = read_bytes(path, MOST_BYTES)
            .map_err(|source| Refused(format!("catalog {path}: {source}", path = path.display())))?;
        Self::from_bytes(&bytes)
    }

    /// Reads a packed catalog.
    ///
    /// # Errors
    /// When the bytes are not a packed catalog, of another version, cut short, too long or damaged.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Refused> {
        let (header, parts) = checked_parts(bytes)?;
        let records = parts.records.chunks_exact(RECORD_BYTES).zip(parts.parallaxes.chunks_exact(PARALLAX_BYTES));
        let numbering = numbering(&header)?;
        let numbers = parts.numbers.as_chunks::<NUMBER_BYTES>().0.iter();
        let named = numbers.map(|bytes| numbering.source_id(i64::from_le_bytes(*bytes)));
        let stars = (0..).zip(records.zip(named));
        let sources: Vec<_> = stars.map(|(id, ((r, p), name))| star_of(id, name, &record(r, p))).collect();
        let index = StarIndex {
            epoch_yr: header.epoch_yr,
            magnitudes: [f32::NEG_INFINITY, sources.iter().map(|star| star.mag_g).fold(f32::MIN, f32::max)],
            fastest_mas_yr: sources
                .iter()
                .filter_map(|s| s.proper_motion)
                .map(|motion| f64::from(motion.speed_mas_yr()))
                .fold(0.0, f64::max),
            crc32: header.crc32,
            credits: String::from_utf8_lossy(parts.credits).into_owned(),
            numbering: Some(numbering),
            order: TILE_ORDER,
            firsts: first_stars(parts.offsets, &sources)?,
        };
        Ok(Self { index, sources })
    }

    /// Returns its facts and tiles.
    pub fn index(&self) -> &StarIndex {
        &self.index
    }

    /// Returns all sources; a source's `id` is its place here.
    pub fn sources(&self) -> &[CatalogSource] {
        &self.sources
    }

    /// Returns the stars of a tile that are not fainter than `limiting_mag` (Gaia G), brightest first.
    pub(crate) fn bright_of_tile(&self, tile: u64, limiting_mag: f32) -> &[CatalogSource] {
        #[allow(clippy::cast_possible_truncation, reason = "places of `sources`")]
        let stars = &self.sources[self.index.places(tile).start as usize..self.index.places(tile).end as usize];
        &stars[..stars.partition_point(|star| star.mag_g <= limiting_mag)]
    }

    /// Replaces `out` by the sources within `radius_rad` of `axis` (any length) at the catalog's epoch and not fainter
    /// than `limiting_mag` (Gaia G), in the catalog's order. An axis or radius that is not a number, or a negative
    /// radius, gives no source; a radius of pi or more gives the whole sky.
    ///
    /// Allocates only when `out` must grow.
    pub fn cone(&self, axis: DVec3, radius_rad: f64, limiting_mag: f32, out: &mut Vec<CatalogSource>) {
        out.clear();
        let Some(axis) = axis.try_normalize() else { return };
        let chord2 = chord_squared(radius_rad);
        self.index.tiles_of_cone(axis, radius_rad, |tile| {
            let bright = self.bright_of_tile(tile, limiting_mag).iter();
            out.extend(bright.filter(|star| star.direction_icrf.distance_squared(axis) <= chord2));
        });
    }
}

struct Parts<'a> {
    offsets: &'a [u8],
    records: &'a [u8],
    parallaxes: &'a [u8],
    numbers: &'a [u8],
    credits: &'a [u8],
}

fn checked_parts(bytes: &[u8]) -> Result<(Header, Parts<'_>), Refused> {
    if !bytes.starts_with(&MAGIC) {
        let shown = &bytes[..bytes.len().min(MAGIC.len())];
        return Err(Refused(format!(
            "not a packed star catalog: wanted it to begin with \"STARCAT1\", got {got:?}; a CSV is packed by `starloop catalog pack`",
            got = String::from_utf8_lossy(shown).into_owned()
        )));
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
        return Err(Refused(format!(
            "packed catalog has {got} bytes, wanted {wanted}: something follows its end",
            got = bytes.len(),
            wanted = left.taken
        )));
    }
    let got = file_crc32(bytes);
    if got == header.crc32 {
        Ok((header, parts))
    } else {
        Err(Refused(format!(
            "packed catalog is damaged: CRC-32 wanted {wanted:08x}, got {got:08x}; copy or pack it again",
            wanted = header.crc32
        )))
    }
}

fn check_header(header: &Header) -> Result<(), Refused> {
    let refuse = |field, wanted: String, got: String| {
        Err(Refused(format!("packed catalog: {field} wanted {wanted}, got {got}")))
    };
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

fn numbering(header: &Header) -> Result<Numbering, Refused> {
    Numbering::of_mark(header.numbering_mark).ok_or_else(|| {
        Refused(format!(
            "packed catalog: origin of numbers wanted a mark that this program knows, got {got}",
            got = header.numbering_mark
        ))
    })
}

/// Takes parts off the front of the file.
struct Left<'a> {
    bytes: &'a [u8],
    taken: usize,
}

impl<'a> Left<'a> {
    fn take(&mut self, part: &'static str, count: usize) -> Result<&'a [u8], Refused> {
        let wanted = self.taken.saturating_add(count);
        let truncated = Refused(format!(
            "packed catalog is cut short: wanted {wanted} bytes for its {part}, got {got}; copy or pack it again",
            got = self.bytes.len()
        ));
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

fn star_of(id: u32, source_id: Option<SourceId>, star: &StarRecord) -> CatalogSource {
    let known_motion = star.pm_ra != NO_PROPER_MOTION && star.pm_dec != NO_PROPER_MOTION;
    source(
        (id, source_id),
        direction_from_ra_dec(f64::from(star.ra) * RA_STEP_RAD, f64::from(star.dec) * DEC_STEP_RAD),
        known_motion.then(|| [star.pm_ra, star.pm_dec].map(|steps| f64::from(steps) * PM_STEP_MAS_YR)),
        (star.parallax != NO_PARALLAX).then(|| f64::from(star.parallax) * PARALLAX_STEP_MAS),
        [mag_of(star.g), f64::from(star.bp_rp) * MAG_STEP],
    )
}

/// Returns the first star of each tile, and the number of stars; of each tile the brightest is the first.
fn first_stars(offsets: &[u8], sources: &[CatalogSource]) -> Result<Vec<u64>, Refused> {
    let firsts: Vec<u64> = (0..=TILES).map(|tile| u64::from(u32_at(offsets, tile * 4))).collect();
    let stars = sources.len() as u64;
    if firsts[0] != 0 || firsts[TILES] != stars {
        let why = format!("offsets wanted 0..{stars}, got {}..{}", firsts[0], firsts[TILES]);
        return Err(Refused(format!("packed catalog, tile {tile}: {why}", tile = 0)));
    }
    for (tile, ends) in firsts.windows(2).enumerate() {
        let refuse = |why: String| Err(Refused(format!("packed catalog, tile {tile}: {why}")));
        let [first, end] = [0, 1].map(|place| usize::try_from(ends[place]).unwrap_or(usize::MAX));
        let Some(members) = sources.get(first..end) else {
            return refuse(format!("stars {first}..{end} of {stars}"));
        };
        if !members.is_sorted_by(|a, b| a.mag_g <= b.mag_g) {
            return refuse("stars are not sorted by magnitude".into());
        }
    }
    Ok(firsts)
}
