//! A layer file -> [`Layer`]: its head in memory, its stars read tile by tile, each checked when it is read.
//!
//! Stars are read with positioned reads and not mapped into memory: a file that is cut short while it is mapped kills
//! the program (SIGBUS), one that is read gives an error, and both come from the same page cache. Tiles are read in
//! pieces of a megabyte, so that memory is taken for stars that are there and bright enough, and not for what a head
//! promises.

use super::layout::{
    FASTEST_MAS_YR, HEADER_BYTES, Header, LEAST_ORDER, LONGEST_CREDITS, MAGIC, MOST_ORDER, NO_COLOUR, NUMBER_BYTES,
    PARALLAX_STEP_MAS, RECORD_BYTES, StarRecord, TileFrame, VERSION, VERSION_WITHOUT_NUMBERS, head_crc32, tiles_of,
};
use super::writer::head_bytes;
use crate::numbering::{NO_NUMBER, Numbering};
use crate::store::{MAG_STEP, MAG_ZERO, NO_PARALLAX, mag_of, source};
use crate::{StarIndex, healpix::chord_squared, layer::error};
use base::{refused::Refused, source::CatalogSource, source_id::SourceId, units::DEG};
use core::cmp::Ordering;
use glam::DVec3;
use std::fs::File;
use std::path::{Path, PathBuf};

/// Colour of stars whose colour is unknown, mag: what most Gaia stars have.
pub const UNKNOWN_BP_RP_MAG: f32 = 0.9;
/// Stars that are read at a time.
const PIECE_STARS: usize = 1 << 16;
/// A file that is this many times longer than what the disk holds of it has holes in the place of stars: their records
/// hardly shrink on a disk that packs its files.
const MOST_PACKED: u64 = 64;
/// Shorter files may pack better: their head is mostly zeros.
const LEAST_HOLES_BYTES: u64 = 16 << 20;
/// Returns whether a file begins as a layer does. A file that cannot be read does not.
pub fn is_layer(path: &Path) -> bool {
    let mut magic = [0; MAGIC.len()];
    path.is_file() && File::open(path).and_then(|file| read_at(&file, 0, &mut magic)).is_ok() && magic == MAGIC
}

/// A layer of stars on disk.
#[derive(Debug)]
pub struct Layer {
    path: PathBuf,
    file: File,
    index: StarIndex,
    crcs: Vec<u32>,
    records_at: u64,
    numbers: Option<Numbers>,
}

/// Where the numbers of the stars are.
#[derive(Debug)]
struct Numbers {
    at: u64,
    /// Checksum of each tile's.
    crcs: Vec<u32>,
}

/// Some stars of a tile, one after the other.
pub(super) struct Piece<'a> {
    /// Place of the first in the layer.
    pub(super) first: u64,
    pub(super) records: &'a [[u8; RECORD_BYTES]],
    /// Their numbers; empty when the layer has none.
    numbers: &'a [[u8; NUMBER_BYTES]],
}

impl Piece<'_> {
    /// Returns the stars: place in the layer, record, and number, [`NO_NUMBER`] where the layer has none.
    pub(super) fn stars(&self) -> impl Iterator<Item = (u64, &[u8; RECORD_BYTES], i64)> {
        let number = |place: usize| self.numbers.get(place).map_or(NO_NUMBER, |bytes| i64::from_le_bytes(*bytes));
        (self.first..)
            .zip(self.records.iter().enumerate())
            .map(move |(at, (place, record))| (at, record, number(place)))
    }
}

impl Layer {
    /// Opens a layer and checks its head and its length.
    ///
    /// # Errors
    /// When it cannot be read, is not a layer, of another version, half written, cut short, too long or its head is
    /// damaged.
    pub fn open(path: &Path) -> Result<Self, Refused> {
        let file = File::open(path).map_err(Refused::file("cannot open", path))?;
        let got = file.metadata().map_err(Refused::file("cannot read", path))?.len();
        let read = |at: u64, bytes: &mut [u8]| {
            read_at(&file, at, bytes).map_err(|source| {
                if source.kind() == std::io::ErrorKind::UnexpectedEof {
                    error::length(path, at + bytes.len() as u64, got)
                } else {
                    Refused::file("cannot read", path)(source)
                }
            })
        };
        let mut magic = [0; MAGIC.len()];
        let shown = usize::try_from(got).unwrap_or(usize::MAX).min(MAGIC.len());
        read(0, &mut magic[..shown])?;
        if magic != MAGIC {
            let got = String::from_utf8_lossy(&magic[..shown]).into_owned();
            return Err(Refused::at(
                path,
                format_args!(
                    "not a star layer: wanted it to begin with \"STARLAY1\", got {got:?}; `starloop catalog import` makes layers of \
                     a CSV (what `catalog pack` makes is for `catalog info`, `query` and `map`)"
                ),
            ));
        }
        let mut bytes = [0; HEADER_BYTES];
        read(0, &mut bytes)?;
        let header = Header::from_bytes(&bytes);
        let order = checked_order(path, &header)?;
        let numbering = checked_numbering(path, &header)?;
        let records_at = head_bytes(order, header.credits_bytes as usize, numbering.is_some());
        let numbers_at = header.stars.saturating_mul(RECORD_BYTES as u64).saturating_add(records_at);
        let of_numbers = if numbering.is_some() { header.stars.saturating_mul(NUMBER_BYTES as u64) } else { 0 };
        let wanted = numbers_at.saturating_add(of_numbers);
        if got != wanted {
            return Err(error::length(path, wanted, got));
        }
        refuse_holes(path, &file)?;
        let mut head = zeros(path, usize::try_from(records_at).unwrap_or(usize::MAX))?;
        read(0, &mut head)?;
        let crc32 = head_crc32(&head);
        if crc32 != header.crc32 {
            return Err(Refused::at(
                path,
                format_args!(
                    "damaged: CRC-32 of its head wanted {wanted:08x}, got {crc32:08x}; import it again",
                    wanted = header.crc32
                ),
            ));
        }
        let (tiles, rest) = (tiles_of(order), &head[HEADER_BYTES..]);
        let (firsts, rest) = rest.split_at(8 * (tiles + 1));
        let (crcs, rest) = rest.split_at(4 * tiles);
        let (number_crcs, credits) = rest.split_at(if numbering.is_some() { 4 * tiles } else { 0 });
        let firsts: Vec<u64> = firsts.as_chunks().0.iter().map(|bytes| u64::from_le_bytes(*bytes)).collect();
        let words = |bytes: &[u8]| bytes.as_chunks().0.iter().map(|bytes| u32::from_le_bytes(*bytes)).collect();
        if !firsts.is_sorted() || firsts[0] != 0 || firsts[tiles] != header.stars {
            let got = format!("{}..{} with steps back", firsts[0], firsts[tiles]);
            return Err(field(path, "tile table", format!("0..{}, rising", header.stars), got));
        }
        let numbers = numbering.map(|_| Numbers { at: numbers_at, crcs: words(number_crcs) });
        let index = StarIndex {
            epoch_yr: header.epoch_yr,
            magnitudes: header.magnitudes,
            fastest_mas_yr: f64::from(header.fastest_mas_yr),
            crc32,
            credits: String::from_utf8_lossy(credits).into_owned(),
            numbering,
            order,
            firsts,
        };
        Ok(Self { path: path.into(), file, index, crcs: words(crcs), records_at, numbers })
    }

    /// Returns its file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Returns its facts and tiles.
    pub fn index(&self) -> &StarIndex {
        &self.index
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
    ) -> Result<(), Refused> {
        let frame = TileFrame::new(self.index.order, tile);
        let g_limit = (f64::from(limiting_mag) - MAG_ZERO) / MAG_STEP + 1e-3;
        let before = out.len();
        let read = self.each_piece(tile, bytes, &mut |piece| {
            let is_bright =
                |record: &[u8; RECORD_BYTES]| f64::from(u16::from_le_bytes([record[6], record[7]])) <= g_limit;
            let bright = piece.records.partition_point(is_bright);
            let memory = bright * size_of::<CatalogSource>();
            out.try_reserve(bright).map_err(|_| error::memory(&self.path, memory))?;
            for (place, record, number) in piece.stars().take(bright) {
                #[allow(
                    clippy::cast_possible_truncation,
                    reason = "numbers of stars wrap: they distinguish stars of one field"
                )]
                let id = first_id.wrapping_add(place as u32);
                out.push(star_of(id, self.index.source_id(number), &StarRecord::from_bytes(record), &frame));
            }
            Ok(())
        });
        if read.is_err() {
            out.truncate(before);
        }
        read
    }

    /// Shows the stars of a tile piece by piece, brightest first, and then verifies their checksums; `bytes` is
    /// scratch. What was shown before an error is not to be used.
    pub(super) fn each_piece(
        &self,
        tile: u64,
        bytes: &mut Vec<u8>,
        look: &mut dyn FnMut(&Piece<'_>) -> Result<(), Refused>,
    ) -> Result<(), Refused> {
        let places = self.index.places(tile);
        let (mut crc, mut number_crc) = (crc32fast::Hasher::new(), crc32fast::Hasher::new());
        let star_bytes = RECORD_BYTES + if self.numbers.is_some() { NUMBER_BYTES } else { 0 };
        for first in places.clone().step_by(PIECE_STARS) {
            let stars = usize::try_from(places.end - first).unwrap_or(usize::MAX).min(PIECE_STARS);
            bytes.clear();
            let memory = stars * star_bytes;
            bytes.try_reserve(memory).map_err(|_| error::memory(&self.path, memory))?;
            bytes.resize(memory, 0);
            let (records, numbers) = bytes.split_at_mut(stars * RECORD_BYTES);
            let failed = Refused::file("cannot read", &self.path);
            let mut read = read_at(&self.file, self.records_at + first * RECORD_BYTES as u64, records);
            if let Some(of) = &self.numbers {
                read = read.and_then(|()| read_at(&self.file, of.at + first * NUMBER_BYTES as u64, numbers));
            }
            read.map_err(failed)?;
            crc.update(records);
            number_crc.update(numbers);
            look(&Piece { first, records: records.as_chunks().0, numbers: numbers.as_chunks().0 })?;
        }
        self.check_tile(tile, crc.finalize(), number_crc.finalize())
    }

    /// Holds checksums of a tile against those that were written.
    fn check_tile(&self, tile: u64, got: u32, got_numbers: u32) -> Result<(), Refused> {
        let at = usize::try_from(tile).unwrap_or(usize::MAX);
        let wanted = self.crcs[at];
        if wanted != got {
            let (ra, dec) = crate::healpix::centre(self.index.order, tile);
            let (path, order, ra_deg, dec_deg) = (self.path.clone(), self.index.order, ra / DEG, dec / DEG);
            return Err(Refused::at(
                path,
                format_args!(
                    "damaged: tile {tile} of order {order} (about RA {ra_deg:.3} Dec {dec_deg:+.3} deg), CRC-32 wanted \
         {wanted:08x}, got {got:08x}; import it again"
                ),
            ));
        }
        match self.numbers.as_ref().map(|numbers| numbers.crcs[at]) {
            Some(wanted) if wanted != got_numbers => Err(Refused::at(
                &self.path,
                format_args!(
                    "damaged: numbers of the stars of tile {tile}, CRC-32 wanted {wanted:08x}, got {got_numbers:08x}; import it again"
                ),
            )),
            _ => Ok(()),
        }
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
    ) -> Result<(), Refused> {
        out.clear();
        let Some(axis) = axis.try_normalize() else { return Ok(()) };
        let (mut tiles, mut bytes, mut read) = (Vec::new(), Vec::new(), Vec::new());
        self.index.tiles_of_cone(axis, radius_rad, |tile| tiles.push(tile));
        let chord2 = chord_squared(radius_rad);
        for tile in tiles {
            read.clear();
            self.read_tile(tile, limiting_mag, 0, &mut bytes, &mut read)?;
            out.extend(read.iter().filter(|star| star.direction_icrf.distance_squared(axis) <= chord2));
        }
        Ok(())
    }

    /// Reads everything: checksums, order of magnitudes, whether they and the motions are the layer's. `progress` gets
    /// the share done, 0..1.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn verify(&self, progress: &mut dyn FnMut(f64)) -> Result<(), Refused> {
        let mut bytes = Vec::new();
        let tiles = self.crcs.len();
        let steps = |mag: f32| (f64::from(mag) - MAG_ZERO) / MAG_STEP;
        let [from, below] = self.index.magnitudes.map(steps);
        for tile in 0..tiles as u64 {
            let mut last_g = f64::NEG_INFINITY;
            self.each_piece(tile, &mut bytes, &mut |piece| {
                for star in piece.records.iter().map(StarRecord::from_bytes) {
                    self.check_star(tile, &star, last_g, [from, below])?;
                    last_g = f64::from(star.g);
                }
                Ok(())
            })?;
            if tile % 1024 == 0 {
                progress(tile as f64 / tiles as f64);
            }
        }
        progress(1.0);
        Ok(())
    }

    /// Holds a star to the layer's promises: no faster, no brighter than the one before, within the magnitudes, in
    /// steps.
    fn check_star(&self, tile: u64, star: &StarRecord, last_g: f64, limits_g: [f64; 2]) -> Result<(), Refused> {
        let (speed, g) = (star.speed_mas_yr(), f64::from(star.g));
        if speed > self.index.fastest_mas_yr {
            let wanted = format!("at most {} mas/yr", self.index.fastest_mas_yr);
            return Err(field(&self.path, "proper motion", wanted, format!("{speed}, tile {tile}")));
        }
        if g < last_g {
            return Err(field(&self.path, "order of stars", "brightest first".into(), format!("tile {tile} mixed")));
        }
        // Half a step at both ends: magnitudes were rounded after they were dealt out.
        if g < limits_g[0] - 0.5 || g > limits_g[1] + 0.5 {
            let wanted = format!("{:?}", self.index.magnitudes);
            return Err(field(&self.path, "magnitude", wanted, mag_of(star.g).to_string()));
        }
        Ok(())
    }
}

/// Returns the memory for a head, if it is there.
fn zeros(path: &Path, bytes: usize) -> Result<Vec<u8>, Refused> {
    let mut zeros = Vec::new();
    zeros.try_reserve_exact(bytes).map_err(|_| error::memory(path, bytes))?;
    zeros.resize(bytes, 0);
    Ok(zeros)
}

/// Compares the length of a file with its bytes on the disk.
fn refuse_holes(path: &Path, file: &File) -> Result<(), Refused> {
    use std::os::unix::fs::MetadataExt;
    let about = file.metadata().map_err(Refused::file("cannot read", path))?;
    // In blocks of 512 bytes, whatever the disk's are; some file systems do not count them.
    let (bytes, stored) = (about.len(), about.blocks().saturating_mul(512));
    if bytes >= LEAST_HOLES_BYTES && stored > 0 && stored.saturating_mul(MOST_PACKED) < bytes {
        return Err(Refused::at(
            path,
            format_args!(
                "{bytes} bytes long, but {stored} are on the disk: it has holes where stars should be, as in a copy that \
         was cut short; import it again"
            ),
        ));
    }
    Ok(())
}

/// Finds out from a head whether the layer has numbers, and whose.
fn checked_numbering(path: &Path, header: &Header) -> Result<Option<Numbering>, Refused> {
    let numbering = Numbering::of_mark(header.numbering_mark);
    match (header.version, numbering) {
        (VERSION, Some(_)) => Ok(numbering),
        (VERSION_WITHOUT_NUMBERS, None) if header.numbering_mark == 0 => Ok(None),
        _ => {
            let wanted = "a mark that this program knows".into();
            Err(field(path, "origin of numbers", wanted, header.numbering_mark.to_string()))
        }
    }
}

fn field(path: &Path, field: &'static str, wanted: String, got: String) -> Refused {
    Refused::at(path, format_args!("{field}: wanted {wanted}, got {got}"))
}

/// Holds the head's numbers to their ranges, and gives the order.
fn checked_order(path: &Path, header: &Header) -> Result<u8, Refused> {
    if ![VERSION_WITHOUT_NUMBERS, VERSION].contains(&header.version) {
        let wanted = format!("{VERSION_WITHOUT_NUMBERS} or {VERSION}");
        return Err(field(path, "format version", wanted, header.version.to_string()));
    }
    if header.credits_bytes as usize > LONGEST_CREDITS {
        let wanted = format!("at most {LONGEST_CREDITS} bytes");
        return Err(field(path, "credits", wanted, header.credits_bytes.to_string()));
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

fn star_of(id: u32, source_id: Option<SourceId>, star: &StarRecord, frame: &TileFrame) -> CatalogSource {
    let is_coloured = star.bp_rp != NO_COLOUR;
    source(
        (id, source_id),
        frame.direction(star.place),
        star.motion_mas_yr(),
        (star.parallax != NO_PARALLAX).then(|| f64::from(star.parallax) * PARALLAX_STEP_MAS),
        [mag_of(star.g), if is_coloured { f64::from(star.bp_rp) * MAG_STEP } else { UNKNOWN_BP_RP_MAG.into() }],
    )
}

fn read_at(file: &File, at: u64, bytes: &mut [u8]) -> std::io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, at)
}
