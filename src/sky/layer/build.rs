//! Stars in any order -> layers, in bounded memory and resumable.
//!
//! Stars are dealt to files on disk, one for each layer and each of 3,072 parts of the sky ([`Sorting::add`]); then each
//! file is sorted by tile and magnitude and appended to its layer ([`Sorting::finish`]). Memory: buffers of 64 MiB, and one
//! file at a time (the densest part of the whole of Gaia DR3 has some 5 million stars: half a gigabyte while it is sorted).
//! After each input, [`Sorting::checkpoint`] writes down how long the files are: an import that is cut short goes on after
//! its last whole input, as files are cut back to those lengths, when it reads the same inputs in the same way
//! ([`Sorting::hold_to`]). Layers get their names when all are whole; that they are about to is written down before, so that
//! an import cut short there goes on too ([`Sorting::is_finishing`]). A star whose row comes twice (the same number, place
//! and magnitude) is taken once and counted. Tests: `tests`.

use super::error::LayerError;
use super::layout::{
    HEADER_BYTES, Header, RECORD_BYTES, StarRecord, TileFrame, VERSION, head_crc32, order_for, tiles_of,
};
use super::star::{IDENTITY_BYTES, NewStar, ROW_BYTES, StarCounts, TakenStar, WaitingRow};
use crate::base::unfinished::Unfinished;
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File, OpenOptions};
use std::io::{BufWriter, Read, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// HEALPix order of the parts of the sky that are sorted one at a time.
const PART_ORDER: u8 = 4;
/// Rows are written to disk when so many bytes wait.
const BUFFERED_BYTES: usize = 64 << 20;
/// Where an import keeps what it needs to go on.
const PROGRESS: &str = "progress.json";

/// What an import has done.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
struct Progress {
    /// Layers it makes: below which magnitude each.
    limits_mag: Vec<f32>,
    /// How inputs are read, in words.
    #[serde(default)]
    options: String,
    /// The folder into which its layers are being written, when all stars are taken in.
    #[serde(default)]
    finishing: Option<String>,
    /// Inputs taken in whole: name and what tells that it is the same.
    inputs: BTreeMap<String, String>,
    /// Bytes of each file of rows.
    rows: BTreeMap<String, u64>,
    counts: StarCounts,
    /// What else the importer counts.
    told: BTreeMap<String, u64>,
}

/// Stars on their way into layers.
pub struct Sorting {
    work: PathBuf,
    progress: Progress,
    /// Rows that wait for the disk, by layer and part.
    waiting: BTreeMap<(usize, u64), Vec<u8>>,
    waiting_bytes: usize,
    /// Files written to since the last checkpoint.
    unsynced: BTreeSet<String>,
}

/// A layer that was written.
#[derive(Debug, Clone, PartialEq)]
pub struct LayerReport {
    /// Its file.
    pub path: PathBuf,
    /// Magnitudes from, and below.
    pub magnitudes: [f32; 2],
    /// Stars in it.
    pub stars: u64,
    /// Stars that came twice and were taken once.
    pub doubled: u64,
    /// HEALPix order of its tiles.
    pub order: u8,
    /// Bytes of the file.
    pub bytes: u64,
}

impl Sorting {
    /// Begins in the folder `work`, or goes on where an earlier import into it was cut short. `limits_mag`: the layers'
    /// faint ends, rising; the first begins with the brightest star.
    ///
    /// # Errors
    /// When the folder cannot be used, or holds an import into other layers.
    pub fn start(work: &Path, limits_mag: &[f32]) -> Result<Self, LayerError> {
        fs::create_dir_all(work).map_err(LayerError::file("cannot make", work))?;
        let path = work.join(PROGRESS);
        let mut there = fs::read_dir(work).map_err(LayerError::file("cannot list", work))?;
        if there.any(|entry| entry.is_ok_and(|entry| !is_ours(&entry.path()))) {
            let why = "wanted a folder of its own for what is sorted, got one with other files".into();
            return Err(LayerError::Work { path: work.into(), why });
        }
        let refuse = |why: String| LayerError::Work { path: path.clone(), why };
        let progress = match fs::read(&path) {
            Ok(text) => serde_json::from_slice(&text).map_err(|error| refuse(format!("cannot be read: {error}")))?,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                Progress { limits_mag: limits_mag.to_vec(), ..Progress::default() }
            }
            Err(source) => return Err(LayerError::file("cannot read", &path)(source)),
        };
        if progress.limits_mag != limits_mag {
            return Err(refuse(format!(
                "an import into layers to {:?} mag was cut short here, wanted {limits_mag:?}",
                progress.limits_mag
            )));
        }
        let (waiting, unsynced) = (BTreeMap::new(), BTreeSet::new());
        let sorting = Self { work: work.into(), progress, waiting, waiting_bytes: 0, unsynced };
        sorting.cut_back()?;
        Ok(sorting)
    }

    /// True when an earlier import into the folder `work` had begun to write its layers into `out`: those that are there
    /// may be its own, and it goes on.
    #[must_use]
    pub fn is_finishing(work: &Path, out: &Path) -> bool {
        let progress =
            fs::read(work.join(PROGRESS)).ok().and_then(|text| serde_json::from_slice::<Progress>(&text).ok());
        progress.is_some_and(|progress| progress.finishing.is_some() && progress.finishing == folder_mark(out).ok())
    }

    /// Holds the import to what an earlier try began: `options` says how inputs are read, and all inputs that the earlier
    /// try took in must be among `inputs`.
    ///
    /// # Errors
    /// When the earlier try read its inputs otherwise, or took in one that is not named now.
    pub fn hold_to(&mut self, options: &str, inputs: &[&str]) -> Result<(), LayerError> {
        let refuse = |why| Err(LayerError::Work { path: self.work.join(PROGRESS), why });
        let progress = &self.progress;
        if !progress.inputs.is_empty() && progress.options != options {
            let began = if progress.options.is_empty() { "unknown options" } else { &progress.options };
            return refuse(format!("an import with {began} was cut short here, wanted {options}"));
        }
        if let Some(other) = progress.inputs.keys().find(|known| !inputs.contains(&known.as_str())) {
            return refuse(format!(
                "an import that was cut short here took in \"{other}\", which is not named now: name all its files again"
            ));
        }
        self.progress.options = options.into();
        Ok(())
    }

    /// Cuts files of rows back to where the last checkpoint has them, and removes those that it does not know.
    fn cut_back(&self) -> Result<(), LayerError> {
        for entry in fs::read_dir(&self.work).map_err(LayerError::file("cannot list", &self.work))? {
            let path = entry.map_err(LayerError::file("cannot list", &self.work))?.path();
            let Some(name) = path.file_name().and_then(|name| name.to_str()).filter(|name| name.ends_with(".rows"))
            else {
                continue;
            };
            let wanted = self.progress.rows.get(name).copied().unwrap_or(0);
            if wanted == 0 {
                fs::remove_file(&path).map_err(LayerError::file("cannot remove", &path))?;
                continue;
            }
            let file = OpenOptions::new().write(true).open(&path).map_err(LayerError::file("cannot open", &path))?;
            let got = file.metadata().map_err(LayerError::file("cannot read", &path))?.len();
            if got < wanted {
                let why = format!("{got} bytes, wanted {wanted} by {PROGRESS}");
                return Err(LayerError::Work { path, why });
            }
            file.set_len(wanted).map_err(LayerError::file("cannot cut", &path))?;
        }
        let missing = self.progress.rows.keys().map(|name| self.work.join(name)).find(|path| !path.exists());
        missing.map_or(Ok(()), |path| Err(LayerError::Work { path, why: "missing".into() }))
    }

    /// True when this input was taken in whole before; `mark` tells that it is the same one.
    ///
    /// # Errors
    /// When an input of that name was another one.
    pub fn has(&self, input: &str, mark: &str) -> Result<bool, LayerError> {
        match self.progress.inputs.get(input) {
            Some(known) if known == mark => Ok(true),
            Some(known) => {
                let why = format!("\"{input}\" was taken in as {known}, and is {mark} now");
                Err(LayerError::Work { path: self.work.join(PROGRESS), why })
            }
            None => Ok(false),
        }
    }

    /// Takes a star in.
    ///
    /// # Errors
    /// When it cannot be stored, or the disk failed.
    pub fn add(&mut self, star: &NewStar) -> Result<(), LayerError> {
        let limits = &self.progress.limits_mag;
        let Some(layer) = limits.iter().position(|limit| star.mag_g < f64::from(*limit)) else {
            self.progress.counts.too_faint += 1;
            return Ok(());
        };
        let row = WaitingRow::new(star, &mut self.progress.counts)?;
        let waiting = self.waiting.entry((layer, row.tile(PART_ORDER))).or_default();
        waiting.extend_from_slice(&row.to_bytes());
        self.waiting_bytes += ROW_BYTES;
        if self.waiting_bytes >= BUFFERED_BYTES { self.write_rows() } else { Ok(()) }
    }

    /// Shows every star taken in so far that layers below `faintest_mag` hold, part by part; of a star that came twice both.
    ///
    /// # Errors
    /// When the disk failed.
    pub fn each_star(&mut self, faintest_mag: f64, look: &mut dyn FnMut(&TakenStar)) -> Result<(), LayerError> {
        self.write_rows()?;
        let limits = &self.progress.limits_mag;
        let begins = |layer: usize| layer.checked_sub(1).map_or(f64::NEG_INFINITY, |before| limits[before].into());
        for part in 0..tiles_of(PART_ORDER) as u64 {
            for layer in (0..limits.len()).take_while(|layer| begins(*layer) < faintest_mag) {
                if self.progress.rows.contains_key(&rows_name(layer, part)) {
                    self.read_rows(layer, part)?.iter().for_each(|row| look(&row.taken()));
                }
            }
        }
        Ok(())
    }

    /// Counts something else that a person should know of.
    pub fn tell(&mut self, what: &str, count: u64) {
        *self.progress.told.entry(what.into()).or_default() += count;
    }

    /// What else was counted.
    pub fn told(&self) -> impl Iterator<Item = (&str, u64)> {
        self.progress.told.iter().map(|(what, count)| (what.as_str(), *count))
    }

    /// Where the faintest layer ends, mag: stars from there on are not taken.
    #[must_use]
    pub fn faint_end_mag(&self) -> f64 {
        self.progress.limits_mag.last().map_or(f64::NEG_INFINITY, |limit| f64::from(*limit))
    }

    /// What was found so far.
    #[must_use]
    pub fn counts(&self) -> StarCounts {
        self.progress.counts
    }

    /// What an import does that is cut short after its buffers were full.
    #[cfg(test)]
    pub(super) fn write_rows_for_tests(&mut self) {
        self.write_rows().unwrap();
    }

    fn write_rows(&mut self) -> Result<(), LayerError> {
        for ((layer, part), rows) in core::mem::take(&mut self.waiting) {
            let name = rows_name(layer, part);
            let path = self.work.join(&name);
            let file = OpenOptions::new().create(true).append(true).open(&path);
            let mut file = file.map_err(LayerError::file("cannot open", &path))?;
            file.write_all(&rows).map_err(LayerError::file("cannot write", &path))?;
            self.unsynced.insert(name.clone());
            *self.progress.rows.entry(name).or_default() += rows.len() as u64;
        }
        self.waiting_bytes = 0;
        Ok(())
    }

    /// An input has been taken in whole: from here an import goes on.
    ///
    /// # Errors
    /// When the disk failed.
    pub fn checkpoint(&mut self, input: &str, mark: &str) -> Result<(), LayerError> {
        self.progress.inputs.insert(input.into(), mark.into());
        self.save()
    }

    /// Writes the progress down, after the rows that it speaks of.
    fn save(&mut self) -> Result<(), LayerError> {
        self.write_rows()?;
        // Rows must be on the disk before it is written down that they are.
        for name in core::mem::take(&mut self.unsynced) {
            let path = self.work.join(name);
            File::open(&path).and_then(|file| file.sync_data()).map_err(LayerError::file("cannot write", &path))?;
        }
        let text = serde_json::to_vec_pretty(&self.progress).map_err(std::io::Error::from);
        let path = self.work.join(PROGRESS);
        let written = text.and_then(|text| {
            let part = path.with_extension("part");
            fs::write(&part, text).and_then(|()| File::open(&part)?.sync_all()).and_then(|()| fs::rename(&part, &path))
        });
        written.map_err(LayerError::file("cannot write", &path))
    }

    /// Sorts everything into layers `out/gNN.starlayer` of epoch `epoch_yr`, with the credits the stars ask for, in the
    /// place of those that are there, and removes the folder of the import. No layer gets its name before all are whole.
    /// `progress` is told the share done, 0..1.
    ///
    /// # Errors
    /// When the disk failed.
    pub fn finish(
        mut self,
        out: &Path,
        epoch_yr: f64,
        credits: &str,
        progress: &mut dyn FnMut(f64),
    ) -> Result<Vec<LayerReport>, LayerError> {
        fs::create_dir_all(out).map_err(LayerError::file("cannot make", out))?;
        self.progress.finishing = Some(folder_mark(out).map_err(LayerError::file("cannot find", out))?);
        self.save()?;
        let limits = self.progress.limits_mag.clone();
        let mut whole = Vec::with_capacity(limits.len());
        for (layer, limit) in limits.iter().enumerate() {
            let from = layer.checked_sub(1).map_or(f32::NEG_INFINITY, |before| limits[before]);
            let path = out.join(layer_name(*limit));
            let head = Head { magnitudes: [from, *limit], epoch_yr, credits };
            let mut share = |done: f64| progress((layer as f64 + done) / limits.len() as f64);
            whole.push(self.write_layer(layer, &path, &head, &mut share)?);
        }
        let reports = whole.into_iter().map(UnnamedLayer::name).collect::<Result<_, _>>()?;
        self.remove_work()?;
        Ok(reports)
    }

    /// Removes what was needed to go on, the progress first: without it nothing else is missed.
    fn remove_work(&self) -> Result<(), LayerError> {
        let path = self.work.join(PROGRESS);
        fs::remove_file(&path).map_err(LayerError::file("cannot remove", &path))?;
        for entry in fs::read_dir(&self.work).map_err(LayerError::file("cannot list", &self.work))? {
            let path = entry.map_err(LayerError::file("cannot list", &self.work))?.path();
            if is_ours(&path) {
                fs::remove_file(&path).map_err(LayerError::file("cannot remove", &path))?;
            }
        }
        fs::remove_dir(&self.work).map_err(LayerError::file("cannot remove", &self.work))
    }

    fn write_layer(
        &self,
        layer: usize,
        path: &Path,
        head: &Head<'_>,
        progress: &mut dyn FnMut(f64),
    ) -> Result<UnnamedLayer, LayerError> {
        let parts: Vec<u64> = (0..tiles_of(PART_ORDER) as u64).collect();
        let length = |part: &u64| self.progress.rows.get(&rows_name(layer, *part)).copied().unwrap_or(0);
        let order = order_for(parts.iter().map(length).sum::<u64>() / ROW_BYTES as u64);
        let mut writer = LayerWriter::create(path, order, head.credits)?;
        for part in &parts {
            if length(part) > 0 {
                let rows = self.read_rows(layer, *part)?;
                writer.append(rows)?;
            }
            progress(*part as f64 / parts.len() as f64);
        }
        writer.complete(head)
    }

    fn read_rows(&self, layer: usize, part: u64) -> Result<Vec<WaitingRow>, LayerError> {
        let path = self.work.join(rows_name(layer, part));
        let mut bytes = Vec::new();
        File::open(&path)
            .and_then(|mut file| file.read_to_end(&mut bytes))
            .map_err(LayerError::file("cannot read", &path))?;
        let (rows, rest) = bytes.as_chunks::<ROW_BYTES>();
        if !rest.is_empty() {
            return Err(LayerError::Work { path, why: format!("{} bytes are no whole rows", bytes.len()) });
        }
        Ok(rows.iter().map(WaitingRow::from_bytes).collect())
    }
}

/// What a folder is known by when it is named again in another way.
fn folder_mark(folder: &Path) -> std::io::Result<String> {
    Ok(fs::canonicalize(folder)?.to_string_lossy().into_owned())
}

/// Whether a file of a folder is one of an import.
fn is_ours(path: &Path) -> bool {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    name == PROGRESS || name == "progress.part" || (name.starts_with("layer") && name.ends_with(".rows"))
}

/// The file of a layer to this magnitude.
#[must_use]
pub fn layer_name(limit_mag: f32) -> String {
    format!("g{limit_mag}.starlayer")
}

fn rows_name(layer: usize, part: u64) -> String {
    format!("layer{layer}_part{part:04}.rows")
}

/// What stands at the head of a layer beside its tables.
pub(in crate::sky) struct Head<'a> {
    pub(in crate::sky) magnitudes: [f32; 2],
    pub(in crate::sky) epoch_yr: f64,
    pub(in crate::sky) credits: &'a str,
}

/// A layer that is whole and on the disk, before it gets its name.
#[must_use]
struct UnnamedLayer {
    unfinished: PathBuf,
    /// Until it gets its name.
    _registered: Unfinished,
    report: LayerReport,
}

impl UnnamedLayer {
    /// Gives the file its name.
    fn name(self) -> Result<LayerReport, LayerError> {
        let renamed = fs::rename(&self.unfinished, &self.report.path);
        renamed.map_err(LayerError::file("cannot rename", &self.unfinished))?;
        Ok(self.report)
    }
}

/// A layer while it is written: records first, then the head before them. It gets its name when it is whole.
pub(in crate::sky) struct LayerWriter {
    path: PathBuf,
    unfinished: PathBuf,
    registered: Unfinished,
    out: BufWriter<File>,
    order: u8,
    stars: u64,
    doubled: u64,
    fastest_mas_yr: f64,
    /// First star of each tile up to the one being written.
    firsts: Vec<u64>,
    crcs: Vec<u32>,
}

impl LayerWriter {
    pub(in crate::sky) fn create(path: &Path, order: u8, credits: &str) -> Result<Self, LayerError> {
        let unfinished = path.with_extension("part");
        let registered = Unfinished::register(&unfinished);
        let mut file = File::create(&unfinished).map_err(LayerError::file("cannot make", &unfinished))?;
        let head_bytes = head_bytes(order, credits.len());
        file.seek(SeekFrom::Start(head_bytes)).map_err(LayerError::file("cannot write", &unfinished))?;
        let (firsts, crcs) = (Vec::with_capacity(tiles_of(order) + 1), Vec::with_capacity(tiles_of(order)));
        Ok(Self {
            path: path.into(),
            unfinished,
            registered,
            out: BufWriter::with_capacity(1 << 20, file),
            order,
            stars: 0,
            doubled: 0,
            fastest_mas_yr: 0.0,
            firsts,
            crcs,
        })
    }

    /// Appends the stars of one part of the sky, which come after those before.
    fn append(&mut self, mut rows: Vec<WaitingRow>) -> Result<(), LayerError> {
        rows.sort_unstable_by_key(|row| row.to_bytes());
        let before = rows.len();
        // Catalogs that are imported together may use the same numbers for different stars.
        rows.dedup_by(|a, b| a.to_bytes()[..IDENTITY_BYTES] == b.to_bytes()[..IDENTITY_BYTES]);
        self.doubled += (before - rows.len()) as u64;
        let mut sorted: Vec<(u64, WaitingRow)> = rows.into_iter().map(|row| (row.tile(self.order), row)).collect();
        sorted.sort_by_key(|(tile, row)| (*tile, row.g, row.source_id));
        for tile in sorted.chunk_by(|a, b| a.0 == b.0) {
            let frame = TileFrame::new(self.order, tile[0].0);
            self.append_tile(tile[0].0, tile.iter().map(|(_, row)| row.record(&frame)))?;
        }
        Ok(())
    }

    /// Appends the stars of one tile, brightest first; tiles come in rising order.
    pub(in crate::sky) fn append_tile(
        &mut self,
        tile: u64,
        records: impl IntoIterator<Item = StarRecord>,
    ) -> Result<(), LayerError> {
        self.skip_to(tile);
        self.firsts.push(self.stars);
        let mut crc = crc32fast::Hasher::new();
        for record in records {
            self.fastest_mas_yr = self.fastest_mas_yr.max(record.speed_mas_yr());
            let record = record.to_bytes();
            crc.update(&record);
            self.out.write_all(&record).map_err(LayerError::file("cannot write", &self.unfinished))?;
            self.stars += 1;
        }
        self.crcs.push(crc.finalize());
        Ok(())
    }

    /// Tiles without stars up to `tile`.
    fn skip_to(&mut self, tile: u64) {
        while (self.crcs.len() as u64) < tile {
            self.firsts.push(self.stars);
            self.crcs.push(0);
        }
    }

    /// Writes the head, and gives the file its name.
    pub(in crate::sky) fn finish(self, head: &Head<'_>) -> Result<LayerReport, LayerError> {
        self.complete(head)?.name()
    }

    /// Writes the head.
    fn complete(mut self, head: &Head<'_>) -> Result<UnnamedLayer, LayerError> {
        self.skip_to(tiles_of(self.order) as u64);
        self.firsts.push(self.stars);
        let header = Header {
            version: VERSION,
            order: u32::from(self.order),
            stars: self.stars,
            epoch_yr: head.epoch_yr,
            magnitudes: head.magnitudes,
            credits_bytes: u32::try_from(head.credits.len()).unwrap_or(u32::MAX),
            crc32: 0,
            // Never below it, whatever the rounding.
            fastest_mas_yr: (self.fastest_mas_yr as f32).next_up(),
        };
        let mut bytes = header.to_bytes().to_vec();
        bytes.extend(self.firsts.iter().flat_map(|first| first.to_le_bytes()));
        bytes.extend(self.crcs.iter().flat_map(|crc| crc.to_le_bytes()));
        bytes.extend(head.credits.as_bytes());
        let header = Header { crc32: head_crc32(&bytes), ..header };
        bytes[..HEADER_BYTES].copy_from_slice(&header.to_bytes());
        let written = (|| {
            self.out.seek(SeekFrom::Start(0))?;
            self.out.write_all(&bytes)?;
            self.out.flush()?;
            self.out.get_ref().sync_all()
        })();
        written.map_err(LayerError::file("cannot write", &self.unfinished))?;
        let Self { path, unfinished, registered, order, stars, doubled, .. } = self;
        let bytes = bytes.len() as u64 + stars * RECORD_BYTES as u64;
        Ok(UnnamedLayer {
            unfinished,
            _registered: registered,
            report: LayerReport { path, magnitudes: head.magnitudes, stars, doubled, order, bytes },
        })
    }
}

/// Bytes before the first record.
pub(super) fn head_bytes(order: u8, credits_bytes: usize) -> u64 {
    (HEADER_BYTES + 8 * (tiles_of(order) + 1) + 4 * tiles_of(order) + credits_bytes) as u64
}
