//! A layer file -> [`Layer`]: its head in memory, its stars read tile by tile, each checked when it is read.
//!
//! Stars are read with positioned reads and not mapped into memory: a file that is cut short while it is mapped kills the
//! program (SIGBUS), one that is read gives an error, and both come from the same page cache.

use super::build::head_bytes;
use super::cover::cells_of_cone;
use super::error::LayerError;
use super::layout::{
    FASTEST_MAS_YR, HEADER_BYTES, Header, LEAST_ORDER, MAG_STEP, MAG_ZERO, MAGIC, MOST_ORDER, NO_COLOUR, NO_MOTION,
    NO_PARALLAX, PARALLAX_STEP_MAS, RECORD_BYTES, StarRecord, TileFrame, VERSION, head_crc32, motion_mas_yr, tiles_of,
};
use super::set::ROUNDING_RAD;
use crate::base::units::DEG;
use crate::sky::catalog::{CatalogSource, ProperMotion, chord_squared};
use core::cmp::Ordering;
use core::ops::Range;
use glam::DVec3;
use std::fs::File;
use std::path::{Path, PathBuf};

/// Colour of stars whose colour is unknown, mag: what most Gaia stars have.
pub const UNKNOWN_BP_RP_MAG: f32 = 0.9;
/// Whether a file begins as a layer does. A file that cannot be read does not.
#[must_use]
pub fn is_layer(path: &Path) -> bool {
    let mut magic = [0; MAGIC.len()];
    File::open(path).and_then(|file| read_at(&file, 0, &mut magic)).is_ok() && magic == MAGIC
}

/// A layer of stars on disk.
#[derive(Debug)]
pub struct Layer {
    path: PathBuf,
    file: File,
    header: Header,
    order: u8,
    /// First star of each tile, and the number of stars.
    firsts: Vec<u64>,
    crcs: Vec<u32>,
    credits: String,
    records_at: u64,
}

impl Layer {
    /// Opens a layer and checks its head and its length.
    ///
    /// # Errors
    /// When it cannot be read, is no layer, of another version, half written, cut short, too long or damaged at its head.
    pub fn open(path: &Path) -> Result<Self, LayerError> {
        let file = File::open(path).map_err(LayerError::file("cannot open", path))?;
        let got = file.metadata().map_err(LayerError::file("cannot read", path))?.len();
        let read = |at: u64, bytes: &mut [u8]| {
            read_at(&file, at, bytes).map_err(|source| match source.kind() {
                std::io::ErrorKind::UnexpectedEof => {
                    LayerError::Length { path: path.into(), wanted: at + bytes.len() as u64, got }
                }
                _ => LayerError::file("cannot read", path)(source),
            })
        };
        let mut magic = [0; MAGIC.len()];
        let shown = usize::try_from(got).unwrap_or(usize::MAX).min(MAGIC.len());
        read(0, &mut magic[..shown])?;
        if magic != MAGIC {
            let got = String::from_utf8_lossy(&magic[..shown]).into_owned();
            return Err(LayerError::Magic { path: path.into(), got });
        }
        let mut bytes = [0; HEADER_BYTES];
        read(0, &mut bytes)?;
        let header = Header::from_bytes(&bytes);
        let order = checked_order(path, &header)?;
        let records_at = head_bytes(order, header.credits_bytes as usize);
        let wanted = header.stars.saturating_mul(RECORD_BYTES as u64).saturating_add(records_at);
        if got != wanted {
            return Err(LayerError::Length { path: path.into(), wanted, got });
        }
        let mut head = vec![0; usize::try_from(records_at).unwrap_or(usize::MAX)];
        read(0, &mut head)?;
        let crc32 = head_crc32(&head);
        if crc32 != header.crc32 {
            return Err(LayerError::Head { path: path.into(), wanted: header.crc32, got: crc32 });
        }
        let tiles = tiles_of(order);
        let crcs_at = HEADER_BYTES + 8 * (tiles + 1);
        let (firsts, crcs) = (&head[HEADER_BYTES..crcs_at], &head[crcs_at..crcs_at + 4 * tiles]);
        let firsts: Vec<u64> = firsts.as_chunks().0.iter().map(|bytes| u64::from_le_bytes(*bytes)).collect();
        let crcs = crcs.as_chunks().0.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect();
        if !firsts.is_sorted() || firsts[0] != 0 || firsts[tiles] != header.stars {
            let got = format!("{}..{} with steps back", firsts[0], firsts[tiles]);
            return Err(field(path, "tile table", format!("0..{}, rising", header.stars), got));
        }
        let credits = String::from_utf8_lossy(&head[crcs_at + 4 * tiles..]).into_owned();
        Ok(Self { path: path.into(), file, header, order, firsts, crcs, credits, records_at })
    }

    /// Its file.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Stars in it.
    #[must_use]
    pub fn stars(&self) -> u64 {
        self.header.stars
    }

    /// Julian year to which the positions refer.
    #[must_use]
    pub fn epoch_yr(&self) -> f64 {
        self.header.epoch_yr
    }

    /// Magnitudes from, and below, which it holds.
    #[must_use]
    pub fn magnitudes(&self) -> [f32; 2] {
        self.header.magnitudes
    }

    /// HEALPix order of its tiles.
    #[must_use]
    pub fn order(&self) -> u8 {
        self.order
    }

    /// CRC-32 of its head, which covers the checksums of its stars: its fingerprint.
    #[must_use]
    pub fn crc32(&self) -> u32 {
        self.header.crc32
    }

    /// Credits its stars ask for.
    #[must_use]
    pub fn credits(&self) -> &str {
        &self.credits
    }

    /// How many stars each tile has, in nested order.
    pub fn stars_of_tiles(&self) -> impl Iterator<Item = u64> {
        self.firsts.windows(2).map(|pair| pair[1] - pair[0])
    }

    /// No star is faster, mas/yr.
    #[must_use]
    pub fn fastest_mas_yr(&self) -> f64 {
        f64::from(self.header.fastest_mas_yr)
    }

    /// Stars of one tile.
    #[must_use]
    pub fn stars_of_tile(&self, tile: u64) -> u64 {
        let places = self.places(tile);
        places.end - places.start
    }

    /// Replaces `tiles` by the tiles that may have stars within `radius_rad` of `axis` (a unit vector).
    pub fn tiles_of_cone(&self, axis: DVec3, radius_rad: f64, tiles: &mut Vec<u64>) {
        tiles.clear();
        cells_of_cone(self.order, axis, radius_rad + ROUNDING_RAD, |tile| {
            if self.stars_of_tile(tile) > 0 {
                tiles.push(tile);
            }
        });
    }

    /// Places of a tile's stars in the layer.
    pub(super) fn places(&self, tile: u64) -> Range<u64> {
        let tile = usize::try_from(tile).unwrap_or(usize::MAX);
        self.firsts[tile]..self.firsts[tile + 1]
    }

    /// Appends the stars of a tile that are not fainter than `limiting_mag` to `out`, brightest first; `bytes` is
    /// scratch. A star's `id` is `first_id` plus its place in the layer.
    ///
    /// # Errors
    /// When the tile cannot be read or is damaged.
    pub fn read_tile(
        &self,
        tile: u64,
        limiting_mag: f32,
        first_id: u32,
        bytes: &mut Vec<u8>,
        out: &mut Vec<CatalogSource>,
    ) -> Result<(), LayerError> {
        let places = self.places(tile);
        self.read_records(tile, bytes)?;
        let frame = TileFrame::new(self.order, tile);
        let (records, _) = bytes.as_chunks::<RECORD_BYTES>();
        let g_limit = (f64::from(limiting_mag) - MAG_ZERO) / MAG_STEP + 1e-3;
        let bright = records.partition_point(|record| f64::from(u16::from_le_bytes([record[6], record[7]])) <= g_limit);
        out.reserve(bright);
        for (place, record) in places.zip(&records[..bright]) {
            #[allow(
                clippy::cast_possible_truncation,
                reason = "numbers of stars wrap: they tell stars of one field apart"
            )]
            let id = first_id.wrapping_add(place as u32);
            out.push(source(id, &StarRecord::from_bytes(record), &frame));
        }
        Ok(())
    }

    /// Reads a tile's records and holds them against their checksum.
    pub(super) fn read_records(&self, tile: u64, bytes: &mut Vec<u8>) -> Result<(), LayerError> {
        let places = self.places(tile);
        let count = usize::try_from(places.end - places.start).unwrap_or(usize::MAX);
        bytes.resize(count.saturating_mul(RECORD_BYTES), 0);
        let at = self.records_at + places.start * RECORD_BYTES as u64;
        read_at(&self.file, at, bytes).map_err(LayerError::file("cannot read", &self.path))?;
        let got = if bytes.is_empty() { 0 } else { crc32fast::hash(bytes) };
        let wanted = self.crcs[usize::try_from(tile).unwrap_or(usize::MAX)];
        if wanted == got {
            return Ok(());
        }
        let (ra, dec) = cdshealpix::nested::center(self.order, tile);
        Err(LayerError::Tile {
            path: self.path.clone(),
            tile,
            order: self.order,
            ra_deg: ra / DEG,
            dec_deg: dec / DEG,
            wanted,
            got,
        })
    }

    /// Replaces `out` by the stars within `radius_rad` of `axis` (any length) at the layer's epoch and not fainter than
    /// `limiting_mag`. An axis or radius that is not a number, or a negative radius, gives no star; a radius of pi or
    /// more the whole sky.
    ///
    /// # Errors
    /// When a tile cannot be read or is damaged.
    pub fn cone(
        &self,
        axis: DVec3,
        radius_rad: f64,
        limiting_mag: f32,
        out: &mut Vec<CatalogSource>,
    ) -> Result<(), LayerError> {
        out.clear();
        let Some(axis) = axis.try_normalize().filter(|_| radius_rad >= 0.0) else { return Ok(()) };
        let (mut tiles, mut bytes, mut read) = (Vec::new(), Vec::new(), Vec::new());
        self.tiles_of_cone(axis, radius_rad, &mut tiles);
        let chord2 = chord_squared(radius_rad);
        for tile in tiles {
            read.clear();
            self.read_tile(tile, limiting_mag, 0, &mut bytes, &mut read)?;
            out.extend(read.iter().filter(|star| star.direction_icrf.distance_squared(axis) <= chord2));
        }
        Ok(())
    }

    /// Reads everything: checksums, order of magnitudes, whether they and the motions are the layer's. `progress` is told the
    /// share done, 0..1.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn verify(&self, progress: &mut dyn FnMut(f64)) -> Result<(), LayerError> {
        let mut bytes = Vec::new();
        let tiles = self.crcs.len();
        let steps = |mag: f32| (f64::from(mag) - MAG_ZERO) / MAG_STEP;
        let [from, below] = self.header.magnitudes.map(steps);
        for tile in 0..tiles as u64 {
            self.read_records(tile, &mut bytes)?;
            let (records, _) = bytes.as_chunks::<RECORD_BYTES>();
            let speed = |record: &[u8; RECORD_BYTES]| StarRecord::from_bytes(record).speed_mas_yr();
            if let Some(speed) = records.iter().map(speed).find(|speed| *speed > self.fastest_mas_yr()) {
                let wanted = format!("at most {} mas/yr", self.fastest_mas_yr());
                return Err(field(&self.path, "proper motion", wanted, format!("{speed}, tile {tile}")));
            }
            let g = |record: &[u8; RECORD_BYTES]| f64::from(StarRecord::from_bytes(record).g);
            if !records.is_sorted_by_key(g) {
                return Err(field(
                    &self.path,
                    "order of stars",
                    "brightest first".into(),
                    format!("tile {tile} mixed"),
                ));
            }
            // Half a step at both ends: magnitudes were rounded after they were dealt out.
            let is_outside = |g: f64| g < from - 0.5 || g > below + 0.5;
            if let Some(g) = records.iter().map(g).find(|g| is_outside(*g)) {
                let wanted = format!("{:?}", self.header.magnitudes);
                return Err(field(&self.path, "magnitude", wanted, format!("{}", g * MAG_STEP + MAG_ZERO)));
            }
            if tile % 1024 == 0 {
                progress(tile as f64 / tiles as f64);
            }
        }
        progress(1.0);
        Ok(())
    }
}

fn field(path: &Path, field: &'static str, wanted: String, got: String) -> LayerError {
    LayerError::Field { path: path.into(), field, wanted, got }
}

/// Holds the head's numbers to their ranges, and gives the order.
fn checked_order(path: &Path, header: &Header) -> Result<u8, LayerError> {
    if header.version != VERSION {
        return Err(field(path, "format version", VERSION.to_string(), header.version.to_string()));
    }
    let orders = LEAST_ORDER..=MOST_ORDER;
    let order = u8::try_from(header.order).ok().filter(|order| orders.contains(order));
    let order = order.ok_or_else(|| {
        field(path, "HEALPix order", format!("{LEAST_ORDER}..{MOST_ORDER}"), header.order.to_string())
    })?;
    if !(1900.0..=2100.0).contains(&header.epoch_yr) {
        return Err(field(path, "epoch", "a Julian year in 1900..2100".into(), header.epoch_yr.to_string()));
    }
    let [from, below] = header.magnitudes;
    if from.partial_cmp(&below) != Some(Ordering::Less) {
        return Err(field(path, "magnitudes", "from, and below, which is more".into(), format!("{from} and {below}")));
    }
    let fastest_mas_yr = f64::from(header.fastest_mas_yr);
    if !(0.0..=2.0 * FASTEST_MAS_YR).contains(&fastest_mas_yr) {
        let wanted = format!("0..{} mas/yr", 2.0 * FASTEST_MAS_YR);
        return Err(field(path, "fastest proper motion", wanted, fastest_mas_yr.to_string()));
    }
    Ok(order)
}

#[allow(clippy::cast_possible_truncation, reason = "an f32 holds every step of these fields to 1e-7 of itself")]
fn source(id: u32, star: &StarRecord, frame: &TileFrame) -> CatalogSource {
    let is_known = !star.motion.contains(&NO_MOTION);
    let [east, north] = star.motion.map(|steps| motion_mas_yr(steps) as f32);
    CatalogSource {
        id,
        direction_icrf: frame.direction(star.place),
        proper_motion: is_known.then_some(ProperMotion { pm_ra_cosdec_mas_yr: east, pm_dec_mas_yr: north }),
        parallax_mas: (star.parallax != NO_PARALLAX).then(|| (f64::from(star.parallax) * PARALLAX_STEP_MAS) as f32),
        mag_g: (f64::from(star.g) * MAG_STEP + MAG_ZERO) as f32,
        bp_rp: if star.bp_rp == NO_COLOUR { UNKNOWN_BP_RP_MAG } else { (f64::from(star.bp_rp) * MAG_STEP) as f32 },
    }
}

#[cfg(unix)]
fn read_at(file: &File, at: u64, bytes: &mut [u8]) -> std::io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, at)
}

#[cfg(windows)]
fn read_at(file: &File, mut at: u64, mut bytes: &mut [u8]) -> std::io::Result<()> {
    while !bytes.is_empty() {
        let read = std::os::windows::fs::FileExt::seek_read(file, bytes, at)?;
        if read == 0 {
            return Err(std::io::ErrorKind::UnexpectedEof.into());
        }
        bytes = &mut bytes[read..];
        at += read as u64;
    }
    Ok(())
}
