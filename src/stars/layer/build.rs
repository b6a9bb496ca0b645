//! Stars in any order -> layers, in bounded memory and resumable.
//!
//! Stars are dealt to files on disk, one for each layer and each of 3,072 parts of the sky ([`Sorting::add`]); then
//! each file is sorted by tile and magnitude and appended to its layer ([`Sorting::finish`]). Memory: [`MEMORY_BYTES`]
//! or what [`Sorting::with_memory`] says, wherever the stars are: while stars come, half of it for rows that wait for
//! the disk; while files are sorted, as many rows as it holds at a time (`runs`), beside the tables of one layer
//! (`writer`). After each input, [`Sorting::checkpoint`] writes down how long the files are: an import that is cut
//! short goes on after its last whole input, as files are cut back to those lengths, when it reads the same inputs in
//! the same way ([`Sorting::hold_to`]). Layers get their names when all are whole; that they are about to is written
//! down before, so that an import cut short there goes on too ([`Sorting::is_finishing`]). A star whose row comes twice
//! (the same number, place and magnitude) is taken once and counted. Tests: `tests`.
//!
//! *Twins.* Rows of a tile in the order of a layer -> those whose number a brighter row of the tile has, at the same
//! place.
//!
//! A star that two files have, or one file twice with other values, is one star. Only the [`MOST_KEPT`] brightest stars
//! of a tile are compared, and a pair that lies across the edge of two tiles is not found. Tests: [`super::tests`].

use super::layout::{TileFrame, order_for, tiles_of};
use super::runs::{RunSort, SORTED_BYTES, each_row, new_file};
use super::star::{NewStar, ROW_BYTES, StarCounts, TakenStar, WaitingRow};
use super::writer::{Head, LayerReport, LayerWriter, UnnamedLayer, sync_folder_of};
use crate::numbering::{NO_NUMBER, Origins};
use crate::{credits::credits_of, layer::error};
use base::input_file::{DATA_BYTES, read_bytes};
use base::{refused::Refused, units::ARCSEC};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File, OpenOptions};
use std::io::Write;
use std::path::{Path, PathBuf};

/// HEALPix order of the parts of the sky that are sorted one at a time.
const PART_ORDER: u8 = 4;
/// Memory of an import, as long as no one asks for another amount, bytes: the densest part of the whole of Gaia DR3,
/// some 5 million stars, is sorted at once.
pub const MEMORY_BYTES: usize = 512 << 20;
/// Least memory of an import, bytes.
pub const LEAST_MEMORY_BYTES: usize = 1 << 20;
/// Rows of one part of the sky are written when this share of the memory waits for it alone: its buffer grows no
/// further.
const PART_SHARE: usize = 16;
/// Where an import keeps what it needs to go on.
const PROGRESS: &str = "progress.json";

/// Progress of an import.
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
    /// Completed inputs: name and fingerprint.
    inputs: BTreeMap<String, String>,
    /// Bytes of each file of rows.
    rows: BTreeMap<String, u64>,
    counts: StarCounts,
    /// Where stars came from.
    #[serde(default)]
    origins: Origins,
    /// Stars whose numbers are those of no source catalog were taken in, or numbers were not asked for.
    #[serde(default)]
    is_without_numbers: bool,
    /// Further counts of the importer.
    #[serde(alias = "told")]
    reported: BTreeMap<String, u64>,
}

/// Stars on their way into layers.
pub struct Sorting {
    work: PathBuf,
    memory_bytes: usize,
    progress: Progress,
    /// Rows that wait for the disk, by layer and part.
    waiting: BTreeMap<(usize, u64), Vec<u8>>,
    waiting_bytes: usize,
    /// Files written to since the last checkpoint.
    unsynced: BTreeSet<String>,
}

impl Sorting {
    /// Begins in the folder `work`, or goes on where an earlier import into it was cut short. `limits_mag`: the layers'
    /// faint ends, rising; the first begins with the brightest star.
    ///
    /// # Errors
    /// When the folder cannot be used, or holds an import into other layers.
    pub fn start(work: &Path, limits_mag: &[f32]) -> Result<Self, Refused> {
        fs::create_dir_all(work).map_err(Refused::file("cannot make", work))?;
        let path = work.join(PROGRESS);
        let mut there = fs::read_dir(work).map_err(Refused::file("cannot list", work))?;
        if there.any(|entry| entry.is_ok_and(|entry| !is_ours(&entry.path()))) {
            return Err(error::work(work, "wanted a folder of its own for what is sorted, got one with other files"));
        }
        let refuse = |why: String| error::work(&path, why);
        let progress = match read_bytes(&path, DATA_BYTES) {
            Ok(text) => serde_json::from_slice(&text).map_err(|error| refuse(format!("cannot be read: {error}")))?,
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
                Progress { limits_mag: limits_mag.to_vec(), ..Progress::default() }
            }
            Err(source) => return Err(Refused::file("cannot read", &path)(source)),
        };
        if progress.limits_mag != limits_mag {
            return Err(refuse(format!(
                "an import into layers to {:?} mag was cut short here, wanted {limits_mag:?}",
                progress.limits_mag
            )));
        }
        let (waiting, unsynced) = (BTreeMap::new(), BTreeSet::new());
        let (work, memory_bytes) = (work.into(), MEMORY_BYTES);
        let sorting = Self { work, memory_bytes, progress, waiting, waiting_bytes: 0, unsynced };
        sorting.cut_back()?;
        Ok(sorting)
    }

    /// Takes this much memory, at least [`LEAST_MEMORY_BYTES`], instead of [`MEMORY_BYTES`].
    #[must_use]
    pub fn with_memory(self, memory_bytes: usize) -> Self {
        Self { memory_bytes: memory_bytes.max(LEAST_MEMORY_BYTES), ..self }
    }

    /// Leaves the numbers of stars out of the layers: they are not asked for, or are those of no source catalog.
    pub fn leave_numbers_out(&mut self) {
        self.progress.is_without_numbers = true;
    }

    /// Says that stars with numbers of Hipparcos and Tycho-2 below zero follow.
    pub fn begin_bright(&mut self) {
        self.progress.origins.begin_bright();
    }

    /// Credits that the origins of the stars ask for.
    pub fn credits(&self) -> String {
        credits_of(&self.progress.origins)
    }

    /// Returns whether an earlier import into the folder `work` has begun to write its layers into `out`: those that
    /// are there may be its own, and it goes on.
    pub fn is_finishing(work: &Path, out: &Path) -> bool {
        let progress = read_bytes(&work.join(PROGRESS), DATA_BYTES)
            .ok()
            .and_then(|text| serde_json::from_slice::<Progress>(&text).ok());
        progress.is_some_and(|progress| progress.finishing.is_some() && progress.finishing == folder_mark(out).ok())
    }

    /// Holds the import to what an earlier try began: `options` says how inputs are read, and all inputs that the
    /// earlier try took in must be among `inputs`.
    ///
    /// # Errors
    /// When the earlier try read its inputs otherwise, or took in one that is not named now.
    pub fn hold_to(&mut self, options: &str, inputs: &[&str]) -> Result<(), Refused> {
        let refuse = |why| Err(error::work(&self.work.join(PROGRESS), why));
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
    fn cut_back(&self) -> Result<(), Refused> {
        for entry in fs::read_dir(&self.work).map_err(Refused::file("cannot list", &self.work))? {
            let path = entry.map_err(Refused::file("cannot list", &self.work))?.path();
            let Some(name) = path.file_name().and_then(|name| name.to_str()).filter(|name| name.ends_with(".rows"))
            else {
                continue;
            };
            let wanted = self.progress.rows.get(name).copied().unwrap_or(0);
            if wanted == 0 {
                fs::remove_file(&path).map_err(Refused::file("cannot remove", &path))?;
                continue;
            }
            let file = OpenOptions::new().write(true).open(&path).map_err(Refused::file("cannot open", &path))?;
            let got = file.metadata().map_err(Refused::file("cannot read", &path))?.len();
            if got < wanted {
                let why = format!("{got} bytes, wanted {wanted} by {PROGRESS}");
                return Err(error::work(&path, why));
            }
            file.set_len(wanted).map_err(Refused::file("cannot cut", &path))?;
        }
        let missing = self.progress.rows.keys().map(|name| self.work.join(name)).find(|path| !path.exists());
        missing.map_or(Ok(()), |path| Err(error::work(&path, "missing")))
    }

    /// Returns whether this input was taken in whole before; `mark` is its fingerprint.
    ///
    /// # Errors
    /// When an input of that name was another one.
    pub fn has(&self, input: &str, mark: &str) -> Result<bool, Refused> {
        match self.progress.inputs.get(input) {
            Some(known) if known == mark => Ok(true),
            Some(known) => {
                let why = format!("\"{input}\" was taken in as {known}, and is {mark} now");
                Err(error::work(&self.work.join(PROGRESS), why))
            }
            None => Ok(false),
        }
    }

    /// Takes a star in.
    ///
    /// # Errors
    /// When it cannot be stored, or the disk failed.
    pub fn add(&mut self, star: &NewStar) -> Result<(), Refused> {
        let limits = &self.progress.limits_mag;
        let Some(layer) = limits.iter().position(|limit| star.mag_g < f64::from(*limit)) else {
            self.progress.counts.too_faint += 1;
            return Ok(());
        };
        let row = WaitingRow::new(star, &mut self.progress.counts)?;
        self.progress.origins.see(star.source_id, star.ra_rad, star.dec_rad);
        let waiting = self.waiting.entry((layer, row.tile(PART_ORDER))).or_default();
        waiting.extend_from_slice(&row.to_bytes());
        self.waiting_bytes += ROW_BYTES;
        // A buffer has up to twice the bytes in it.
        let is_full = waiting.len() >= self.memory_bytes / PART_SHARE || self.waiting_bytes >= self.memory_bytes / 4;
        if is_full { self.write_rows() } else { Ok(()) }
    }

    /// Shows every star taken in so far that layers below `faintest_mag` hold, part by part; of a star that came twice
    /// both.
    ///
    /// # Errors
    /// When the disk failed.
    pub fn each_star(&mut self, faintest_mag: f64, look: &mut dyn FnMut(&TakenStar)) -> Result<(), Refused> {
        self.write_rows()?;
        let limits = &self.progress.limits_mag;
        let begins = |layer: usize| layer.checked_sub(1).map_or(f64::NEG_INFINITY, |before| limits[before].into());
        for part in 0..tiles_of(PART_ORDER) as u64 {
            for layer in (0..limits.len()).take_while(|layer| begins(*layer) < faintest_mag) {
                let name = rows_name(layer, part);
                if self.progress.rows.contains_key(&name) {
                    each_row(&self.work.join(name), &mut |row| look(&row.taken()))?;
                }
            }
        }
        Ok(())
    }

    /// Counts something else that a person should know of.
    pub fn announce(&mut self, what: &str, count: u64) {
        *self.progress.reported.entry(what.into()).or_default() += count;
    }

    /// Returns the further counts.
    pub fn reported(&self) -> impl Iterator<Item = (&str, u64)> {
        self.progress.reported.iter().map(|(what, count)| (what.as_str(), *count))
    }

    /// Returns where the faintest layer ends, mag: stars from there on are not taken.
    pub fn faint_end_mag(&self) -> f64 {
        self.progress.limits_mag.last().map_or(f64::NEG_INFINITY, |limit| f64::from(*limit))
    }

    /// Returns the counts of stars so far.
    pub fn counts(&self) -> StarCounts {
        self.progress.counts
    }

    /// Writes the rows as an import does whose buffers are full, for imports that are cut short.
    #[cfg(test)]
    pub(super) fn write_rows_for_tests(&mut self) {
        self.write_rows().unwrap();
    }

    fn write_rows(&mut self) -> Result<(), Refused> {
        for ((layer, part), rows) in core::mem::take(&mut self.waiting) {
            let name = rows_name(layer, part);
            let path = self.work.join(&name);
            let file = OpenOptions::new().create(true).append(true).open(&path);
            let mut file = file.map_err(Refused::file("cannot open", &path))?;
            file.write_all(&rows).map_err(Refused::file("cannot write", &path))?;
            self.unsynced.insert(name.clone());
            *self.progress.rows.entry(name).or_default() += rows.len() as u64;
        }
        self.waiting_bytes = 0;
        Ok(())
    }

    /// Marks an input as taken in whole: a resumed import starts here.
    ///
    /// # Errors
    /// When the disk failed.
    pub fn checkpoint(&mut self, input: &str, mark: &str) -> Result<(), Refused> {
        self.progress.inputs.insert(input.into(), mark.into());
        self.save()
    }

    /// Writes the progress down, after the rows that it speaks of.
    fn save(&mut self) -> Result<(), Refused> {
        self.write_rows()?;
        // Rows must be on the disk before it is written down that they are.
        for name in core::mem::take(&mut self.unsynced) {
            let path = self.work.join(name);
            File::open(&path).and_then(|file| file.sync_data()).map_err(Refused::file("cannot write", &path))?;
        }
        let text = serde_json::to_vec_pretty(&self.progress).map_err(std::io::Error::from);
        let path = self.work.join(PROGRESS);
        let written = text.and_then(|text| {
            let part = path.with_extension("part");
            let mut file = new_file(&part)?;
            file.write_all(&text)?;
            file.sync_all()?;
            fs::rename(&part, &path)?;
            sync_folder_of(&path)
        });
        written.map_err(Refused::file("cannot write", &path))
    }

    /// Sorts everything into layers `out/gNN.starlayer` of epoch `epoch_yr`, with the credits the stars ask for, in the
    /// place of those that are there, and removes the folder of the import. No layer gets its name before all are
    /// whole. `progress` gets the share done, 0..1.
    ///
    /// # Errors
    /// When the disk failed.
    pub fn finish(
        mut self,
        out: &Path,
        epoch_yr: f64,
        credits: &str,
        progress: &mut dyn FnMut(f64),
    ) -> Result<Vec<LayerReport>, Refused> {
        fs::create_dir_all(out).map_err(Refused::file("cannot make", out))?;
        self.progress.finishing = Some(folder_mark(out).map_err(Refused::file("cannot find", out))?);
        self.save()?;
        let limits = self.progress.limits_mag.clone();
        let numbering = (!self.progress.is_without_numbers).then(|| self.progress.origins.numbering(epoch_yr));
        let mut whole = Vec::with_capacity(limits.len());
        for (layer, limit) in limits.iter().enumerate() {
            let from = layer.checked_sub(1).map_or(f32::NEG_INFINITY, |before| limits[before]);
            let path = out.join(layer_name(*limit));
            let head = Head { magnitudes: [from, *limit], epoch_yr, credits, numbering };
            let mut share = |done: f64| progress((layer as f64 + done) / limits.len() as f64);
            whole.push(self.write_layer(layer, &path, &head, &mut share)?);
        }
        let reports = whole.into_iter().map(UnnamedLayer::name).collect::<Result<_, _>>()?;
        self.remove_work()?;
        Ok(reports)
    }

    /// Removes what was needed to go on, the progress first: without it nothing else is missed.
    fn remove_work(&self) -> Result<(), Refused> {
        let path = self.work.join(PROGRESS);
        fs::remove_file(&path).map_err(Refused::file("cannot remove", &path))?;
        for entry in fs::read_dir(&self.work).map_err(Refused::file("cannot list", &self.work))? {
            let path = entry.map_err(Refused::file("cannot list", &self.work))?.path();
            if is_ours(&path) {
                fs::remove_file(&path).map_err(Refused::file("cannot remove", &path))?;
            }
        }
        fs::remove_dir(&self.work).map_err(Refused::file("cannot remove", &self.work))
    }

    fn write_layer(
        &self,
        layer: usize,
        path: &Path,
        head: &Head<'_>,
        progress: &mut dyn FnMut(f64),
    ) -> Result<UnnamedLayer, Refused> {
        let parts: Vec<u64> = (0..tiles_of(PART_ORDER) as u64).collect();
        let length = |part: &u64| self.progress.rows.get(&rows_name(layer, *part)).copied().unwrap_or(0);
        let order = order_for(parts.iter().map(length).sum::<u64>() / ROW_BYTES as u64);
        let mut writer = LayerWriter::create(path, order, head.credits, head.numbering.is_some())?;
        let mut twins = head.numbering.is_some().then(Twins::default);
        let sort = RunSort { order, most_rows: self.memory_bytes / SORTED_BYTES };
        for part in &parts {
            if length(part) > 0 {
                let mut frame: Option<(u64, TileFrame)> = None;
                let mut append = |tile, row: &WaitingRow| {
                    if twins.as_mut().is_some_and(|twins| twins.is_known(tile, row)) {
                        return Ok(());
                    }
                    let known = frame.filter(|(of, _)| *of == tile);
                    let (_, axes) = known.unwrap_or_else(|| (tile, TileFrame::new(order, tile)));
                    frame = Some((tile, axes));
                    writer.append(tile, row.record(&axes), row.source_id)
                };
                let doubled = sort.each_star(&self.work.join(rows_name(layer, *part)), &mut append)?;
                writer.count_doubled(doubled);
            }
            progress(*part as f64 / parts.len() as f64);
        }
        if let (Some(twins), Some(numbering)) = (twins, head.numbering) {
            writer.count_doubled(twins.count);
            writer.name_doubled(twins.first.and_then(|number| numbering.source_id(number)));
        }
        writer.complete(head)
    }
}

/// Returns the canonical path of a folder.
fn folder_mark(folder: &Path) -> std::io::Result<String> {
    Ok(fs::canonicalize(folder)?.to_string_lossy().into_owned())
}

/// Returns whether a file of a folder is one of an import.
fn is_ours(path: &Path) -> bool {
    let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
    name == PROGRESS || name == "progress.part" || (name.starts_with("layer") && name.ends_with(".rows"))
}

/// Returns the file of a layer to this magnitude.
pub fn layer_name(limit_mag: f32) -> String {
    format!("g{limit_mag}.starlayer")
}

fn rows_name(layer: usize, part: u64) -> String {
    format!("layer{layer}_part{part:04}.rows")
}

/// Stars of a tile that are compared.
const MOST_KEPT: usize = 8192;
/// Largest distance of two places of one star.
const NEAR_RAD: f64 = 10.0 * ARCSEC;

/// The stars of a tile so far, by their numbers.
#[derive(Debug, Default)]
pub(super) struct Twins {
    tile: u64,
    places: BTreeMap<i64, [f64; 2]>,
    /// Rows that were left out.
    pub(super) count: u64,
    /// Number of the first of them.
    pub(super) first: Option<i64>,
}

impl Twins {
    /// Returns whether a row is of a star that was there before; counts it.
    pub(super) fn is_known(&mut self, tile: u64, row: &WaitingRow) -> bool {
        if row.source_id == NO_NUMBER {
            return false;
        }
        if tile != self.tile {
            (self.tile, self.places) = (tile, BTreeMap::new());
        }
        let [ra_rad, dec_rad] = row.place_rad();
        if let Some([known_ra_rad, known_dec_rad]) = self.places.get(&row.source_id) {
            let turn = (ra_rad - known_ra_rad).rem_euclid(core::f64::consts::TAU);
            let east_rad = turn.min(core::f64::consts::TAU - turn) * dec_rad.cos();
            let is_near = east_rad.hypot(dec_rad - known_dec_rad) < NEAR_RAD;
            self.count += u64::from(is_near);
            self.first = self.first.or(is_near.then_some(row.source_id));
            return is_near;
        }
        if self.places.len() < MOST_KEPT {
            self.places.insert(row.source_id, [ra_rad, dec_rad]);
        }
        false
    }
}
