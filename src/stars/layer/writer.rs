//! Stars by tile, brightest first -> a layer file.
//!
//! Records are written as they come, numbers into a file of their own that is appended at the end, and the head before
//! the records last. The file gets its name when it is whole and on the disk; on any failure nothing of it is left.
//! Memory: the tables of the head, 12 to 16 bytes a tile (200 MB at the finest order), and two buffers.

use super::layout::{
    HEADER_BYTES, Header, LONGEST_CREDITS, NUMBER_BYTES, RECORD_BYTES, StarRecord, VERSION, VERSION_WITHOUT_NUMBERS,
    tiles_of,
};
use super::runs::new_file;
use crate::numbering::Numbering;
use base::{refused::Refused, source_id::SourceId, unfinished};
use std::fs::{self, File};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Bytes that wait before they go to the system.
const BUFFER_BYTES: usize = 1 << 20;

/// A layer that was written.
#[derive(Debug, Clone, PartialEq)]
pub struct LayerReport {
    /// Its file.
    pub path: PathBuf,
    /// Magnitudes from, and below. Brightest and faintest magnitude, Gaia G.
    pub magnitudes: [f32; 2],
    /// Stars in it.
    pub stars: u64,
    /// Stars that came twice and were taken once.
    pub doubled: u64,
    /// Number of one that came with other values.
    pub doubled_number: Option<SourceId>,
    /// HEALPix order of its tiles.
    pub order: u8,
    /// Bytes of the file.
    pub bytes: u64,
}

/// Head of a layer, without its tables.
pub struct Head<'a> {
    /// Brightest and faintest magnitude, Gaia G.
    pub magnitudes: [f32; 2],
    /// Julian year of the positions.
    pub epoch_yr: f64,
    /// Credits of the stars' origins, one for each line.
    pub credits: &'a str,
    /// How the stars' numbers are to be read; `None`: the layer has none.
    pub numbering: Option<Numbering>,
}

/// A file that is removed unless it is kept.
struct Unfinished {
    path: PathBuf,
    is_kept: bool,
    /// A signal that ends the program removes it too.
    _registered: unfinished::Unfinished,
}

impl Unfinished {
    fn create(path: PathBuf) -> Result<(Self, File), Refused> {
        let registered = unfinished::Unfinished::register(&path);
        let file = new_file(&path).map_err(Refused::file("cannot make", &path))?;
        Ok((Self { path, is_kept: false, _registered: registered }, file))
    }
}

impl Drop for Unfinished {
    fn drop(&mut self) {
        if !self.is_kept {
            let _it_failed_already = fs::remove_file(&self.path);
        }
    }
}

/// A layer that is whole and on the disk, before it gets its name.
#[must_use]
pub struct UnnamedLayer {
    unfinished: Unfinished,
    report: LayerReport,
}

impl UnnamedLayer {
    /// Gives the file its name.
    pub fn name(mut self) -> Result<LayerReport, Refused> {
        let renamed = fs::rename(&self.unfinished.path, &self.report.path);
        renamed.map_err(Refused::file("cannot rename", &self.unfinished.path))?;
        self.unfinished.is_kept = true;
        sync_folder_of(&self.report.path).map_err(Refused::file("cannot write the folder of", &self.report.path))?;
        Ok(self.report.clone())
    }
}

/// Waits until the names in the folder of `path` are on the disk.
pub(super) fn sync_folder_of(path: &Path) -> io::Result<()> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    File::open(folder)?.sync_all()
}

/// Numbers of stars on their way to the end of a layer.
struct NumberFile {
    unfinished: Unfinished,
    out: BufWriter<File>,
    crc: crc32fast::Hasher,
    crcs: Vec<u32>,
}

/// A layer while it is written.
pub struct LayerWriter {
    path: PathBuf,
    unfinished: Unfinished,
    out: BufWriter<File>,
    order: u8,
    stars: u64,
    doubled: u64,
    doubled_number: Option<SourceId>,
    fastest_mas_yr: f64,
    /// First star of each tile up to the one being written.
    firsts: Vec<u64>,
    /// Checksums of the tiles before the one being written.
    crcs: Vec<u32>,
    crc: crc32fast::Hasher,
    numbers: Option<NumberFile>,
}

impl LayerWriter {
    /// Begins a layer with the credits that its head will have, and numbers where `has_numbers`.
    pub fn create(path: &Path, order: u8, credits: &str, has_numbers: bool) -> Result<Self, Refused> {
        if credits.len() > LONGEST_CREDITS {
            let (wanted, got) = (format!("at most {LONGEST_CREDITS} bytes"), format!("{}", credits.len()));
            return Err(Refused::at(path, format_args!("credits: wanted {wanted}, got {got}")));
        }
        let (unfinished, mut file) = Unfinished::create(path.with_extension("part"))?;
        let head_bytes = head_bytes(order, credits.len(), has_numbers);
        file.seek(SeekFrom::Start(head_bytes)).map_err(Refused::file("cannot write", &unfinished.path))?;
        let tables = || Vec::with_capacity(tiles_of(order));
        let numbers = has_numbers.then(|| {
            let (unfinished, file) = Unfinished::create(path.with_extension("numbers.part"))?;
            let out = BufWriter::with_capacity(BUFFER_BYTES, file);
            Ok(NumberFile { unfinished, out, crc: crc32fast::Hasher::new(), crcs: tables() })
        });
        Ok(Self {
            path: path.into(),
            unfinished,
            out: BufWriter::with_capacity(BUFFER_BYTES, file),
            order,
            stars: 0,
            doubled: 0,
            doubled_number: None,
            fastest_mas_yr: 0.0,
            firsts: Vec::with_capacity(tiles_of(order) + 1),
            crcs: tables(),
            crc: crc32fast::Hasher::new(),
            numbers: numbers.transpose()?,
        })
    }

    /// Counts rows of stars that were there before.
    pub(super) fn count_doubled(&mut self, doubled: u64) {
        self.doubled += doubled;
    }

    /// Names a star that came twice with other values.
    pub(super) fn name_doubled(&mut self, number: Option<SourceId>) {
        self.doubled_number = number;
    }

    /// Appends the stars of one tile, brightest first; tiles come in rising order.
    pub fn append_tile(&mut self, tile: u64, records: impl IntoIterator<Item = StarRecord>) -> Result<(), Refused> {
        records.into_iter().try_for_each(|record| self.append(tile, record, 0))
    }

    /// Appends a star; tiles come in rising order, the stars of each brightest first. Its number is left out of a layer
    /// without numbers.
    pub(super) fn append(&mut self, tile: u64, record: StarRecord, number: i64) -> Result<(), Refused> {
        self.begin_tile(tile);
        self.fastest_mas_yr = self.fastest_mas_yr.max(record.speed_mas_yr());
        let record = record.to_bytes();
        self.crc.update(&record);
        self.out.write_all(&record).map_err(Refused::file("cannot write", &self.unfinished.path))?;
        if let Some(numbers) = &mut self.numbers {
            let number = number.to_le_bytes();
            numbers.crc.update(&number);
            numbers.out.write_all(&number).map_err(Refused::file("cannot write", &numbers.unfinished.path))?;
        }
        self.stars += 1;
        Ok(())
    }

    /// Ends the tiles before `tile`: all of them have a first star and a checksum then.
    fn begin_tile(&mut self, tile: u64) {
        while self.firsts.len() as u64 <= tile {
            self.end_tile();
            self.firsts.push(self.stars);
        }
    }

    fn end_tile(&mut self) {
        if self.firsts.is_empty() {
            return;
        }
        self.crcs.push(core::mem::take(&mut self.crc).finalize());
        if let Some(numbers) = &mut self.numbers {
            numbers.crcs.push(core::mem::take(&mut numbers.crc).finalize());
        }
    }

    /// Writes the numbers and the head.
    pub fn complete(mut self, head: &Head<'_>) -> Result<UnnamedLayer, Refused> {
        // The end of the last tile, and the number of stars as the first star of one more.
        self.begin_tile(tiles_of(self.order) as u64);
        let written = self.write_numbers().and_then(|()| self.write_head(head));
        written.map_err(Refused::file("cannot write", &self.unfinished.path))?;
        let per_star = RECORD_BYTES + if self.numbers.is_some() { NUMBER_BYTES } else { 0 };
        let before = head_bytes(self.order, head.credits.len(), self.numbers.is_some());
        let report = LayerReport {
            path: self.path,
            magnitudes: head.magnitudes,
            stars: self.stars,
            doubled: self.doubled,
            doubled_number: self.doubled_number,
            order: self.order,
            bytes: before + self.stars * per_star as u64,
        };
        Ok(UnnamedLayer { unfinished: self.unfinished, report })
    }

    /// Appends the numbers to the records.
    fn write_numbers(&mut self) -> io::Result<()> {
        let Some(numbers) = &mut self.numbers else { return Ok(()) };
        numbers.out.flush()?;
        let file = numbers.out.get_mut();
        file.seek(SeekFrom::Start(0))?;
        io::copy(file, &mut self.out).map(|_| ())
    }

    fn write_head(&mut self, head: &Head<'_>) -> io::Result<()> {
        let mut header = Header {
            version: if self.numbers.is_some() { VERSION } else { VERSION_WITHOUT_NUMBERS },
            order: u32::from(self.order),
            stars: self.stars,
            epoch_yr: head.epoch_yr,
            magnitudes: head.magnitudes,
            credits_bytes: u32::try_from(head.credits.len()).unwrap_or(u32::MAX),
            crc32: 0,
            // Never below it, whatever the rounding.
            fastest_mas_yr: (self.fastest_mas_yr as f32).next_up(),
            numbering_mark: if self.numbers.is_some() { head.numbering.unwrap_or_default().mark() } else { 0 },
        };
        let number_crcs = self.numbers.as_ref().map_or(&[][..], |numbers| &numbers.crcs);
        let parts = |each: &mut dyn FnMut(&[u8]) -> io::Result<()>| {
            self.firsts.iter().try_for_each(|first| each(&first.to_le_bytes()))?;
            self.crcs.iter().chain(number_crcs).try_for_each(|crc| each(&crc.to_le_bytes()))?;
            each(head.credits.as_bytes())
        };
        let mut crc = crc32fast::Hasher::new();
        crc.update(&header.to_bytes());
        parts(&mut |bytes| {
            crc.update(bytes);
            Ok(())
        })?;
        header.crc32 = crc.finalize();
        let out = &mut self.out;
        out.seek(SeekFrom::Start(0))?;
        out.write_all(&header.to_bytes())?;
        parts(&mut |bytes| out.write_all(bytes))?;
        out.flush()?;
        out.get_ref().sync_all()
    }
}

/// Returns bytes before the first record.
pub(super) fn head_bytes(order: u8, credits_bytes: usize, has_numbers: bool) -> u64 {
    let checksums = if has_numbers { 8 } else { 4 };
    (HEADER_BYTES + 8 * (tiles_of(order) + 1) + checksums * tiles_of(order) + credits_bytes) as u64
}
