//! The folder of a data set: what it is about, and what is written when all shards are there.
//!
//! In: a description, the number of items, the records of all shards. Out: `data_set.json` and `spec.toml` before the first
//! shard; `README.md` (the data card), `coco.json`, the description of a Zarr array and `checksums.sha256` after the last.
//! Nothing in these files depends on when, where or by how many workers they were made. Tests: below and `make`.
//!
//! One shard on disk: images, labels, and last a record that says that all of it is there.
//!
//! In: the studio of a shard and its items. Out: the files of the shard and `records/00012.json`, which lists them with
//! length and SHA-256. A shard without a record is drawn again from its beginning: a program may be killed at any instant.
//! Tests: below and `make`.

use crate::image_files::{ARRAY, FileRow, Files, ImageFiles, array_description, sha256_of, write_below};
use crate::labels::{Filed, ITEM_COLUMNS, Labels, STAR_COLUMNS, json_of};
use crate::spec::{ImageForm, Spec};
use crate::{coco, coco::Entries, studio::Studio};
use anyhow::{Context, Result, bail};
use base::clock::Stopwatch;
use base::input_file::{DATA_BYTES, read_bytes, read_text};
use core::{fmt::Write, ops::Range};
use frames::sink::crc32::pixel_crc32;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use stars::credits;
use std::{fs::File, path::Path};

/// Name of the file that says what the folder is about.
const ABOUT: &str = "data_set.json";
/// Name of the list of all files with their SHA-256, as `sha256sum -c` reads it.
pub const CHECKSUMS: &str = "checksums.sha256";

/// Subject of a folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct About {
    /// Name of the data set.
    pub name: String,
    /// Its purpose.
    pub description: String,
    /// Licence of its images.
    pub licence: String,
    /// Number of items.
    pub items: u32,
    /// Items of a shard.
    pub shard_items: u32,
    /// Form of the images.
    pub images: String,
    /// Seed of everything that is drawn.
    pub seed: u64,
    /// Camera, as the description names it.
    pub camera: String,
    /// SHA-256 of the description.
    pub spec_sha256: String,
    /// Version of the program, with its commit.
    pub program: String,
}

impl About {
    /// Returns what a folder is about.
    pub fn new(spec: &Spec, count: u32, program: &str) -> Self {
        let camera = spec.camera.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned());
        Self {
            name: spec.name.clone(),
            description: spec.description.clone(),
            licence: spec.licence.clone(),
            items: count,
            shard_items: spec.output.shard_items,
            images: spec.output.images.name().into(),
            seed: spec.seed,
            camera,
            spec_sha256: sha256_of(spec.text.as_bytes()),
            program: program.into(),
        }
    }
}

/// Begins a folder, or goes on with one that is about the same; more items may be asked for than before.
///
/// # Errors
/// When the folder is about something else, has more items, or cannot be written.
pub fn begin(folder: &Path, spec: &Spec, about: &About) -> Result<()> {
    let _mine = alone(folder)?;
    // Looked into before the file is read: where a folder cannot be locked, a worker beside this one may write that file.
    let has_files = has_finished_files(folder);
    let path = folder.join(ABOUT);
    match read_text(&path, DATA_BYTES) {
        Ok(text) => {
            let there: About = serde_json::from_str(&text).with_context(|| path.display().to_string())?;
            check_same(&there, about).with_context(|| folder.display().to_string())?;
        }
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => {
            if has_files {
                bail!("{}: a folder with other files; wanted a new one, or one of a data set", folder.display());
            }
        }
        Err(error) => return Err(error).with_context(|| path.display().to_string()),
    }
    write_below(folder, ABOUT, format!("{:#}\n", serde_json::to_value(about)?).as_bytes())?;
    write_below(folder, "spec.toml", spec.text.as_bytes())
}

/// Waits until no other worker begins or finishes the folder; they wait until the result is dropped. Makes the folder. A file system
/// without locks gives `None`.
fn alone(folder: &Path) -> Result<Option<File>> {
    std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    let opened = File::open(folder).with_context(|| folder.display().to_string())?;
    Ok(opened.lock().is_ok().then_some(opened))
}

/// Reports whether a folder has an entry that is not an unfinished file.
fn has_finished_files(folder: &Path) -> bool {
    std::fs::read_dir(folder).is_ok_and(|mut entries| {
        entries.any(|entry| entry.map_or(true, |entry| !is_unfinished(&entry.file_name().to_string_lossy())))
    })
}

/// Reports whether a file name is that of a file that is being written.
fn is_unfinished(name: &str) -> bool {
    name.starts_with('.') && name.ends_with(".part")
}

fn check_same(there: &About, wanted: &About) -> Result<()> {
    if there.items > wanted.items {
        bail!("a data set of {} items; wanted at least as many, got --count {}", there.items, wanted.items);
    }
    let wanted = About { items: there.items, ..wanted.clone() };
    if *there == wanted {
        return Ok(());
    }
    let what = if there.program != wanted.program {
        format!("written by {}, this is {}", there.program, wanted.program)
    } else {
        "of another description".into()
    };
    bail!("a data set {what}: its items would not fit together; give another folder")
}

/// Returns the records of all shards; `None` while one is missing.
///
/// # Errors
/// When a record cannot be read.
pub fn all_records(folder: &Path, spec: &Spec, count: u32) -> Result<Option<Vec<Record>>> {
    (0..spec.shards(count)).map(|shard| read_record(folder, shard, &spec.items_of(shard, count))).collect()
}

/// Writes what belongs to the whole data set, and removes what a killed program left unfinished.
///
/// # Errors
/// When a file cannot be written.
pub fn finish(folder: &Path, spec: &Spec, about: &About, records: &[Record]) -> Result<()> {
    // Temporary files of another worker that finishes the folder are not unfinished.
    let _mine = alone(folder)?;
    remove_unfinished(folder)?;
    let mut more = vec![("README.md".to_owned(), card(spec, about, records).into_bytes())];
    let size_px = records.first().map_or([0; 2], |record| record.size_px);
    if spec.output.images == ImageForm::Zarr {
        if records.iter().any(|record| record.size_px != size_px) {
            bail!("images differ in size, which an array cannot hold; choose fits, png or webdataset");
        }
        more.push((format!("{ARRAY}/zarr.json"), array_description(about.items, size_px).into_bytes()));
    }
    if records.iter().any(|record| record.coco.is_some()) {
        let entries = records.iter().filter_map(|record| record.coco.clone());
        more.push(("coco.json".into(), coco::whole(&spec.name, &spec.licence, entries).to_string().into_bytes()));
    }
    let mut sums = String::new();
    for (path, bytes) in &more {
        write_below(folder, path, bytes)?;
        writeln!(sums, "{}  {path}", sha256_of(bytes))?;
    }
    for path in [ABOUT, "spec.toml"] {
        writeln!(sums, "{}  {path}", sha256_of(&read_bytes(&folder.join(path), DATA_BYTES)?))?;
    }
    for row in records.iter().flat_map(|record| &record.files) {
        writeln!(sums, "{}  {}", row.sha256, row.path)?;
    }
    write_below(folder, CHECKSUMS, sums.as_bytes())
}

/// Removes temporary files below a folder.
fn remove_unfinished(folder: &Path) -> Result<()> {
    for entry in std::fs::read_dir(folder).with_context(|| folder.display().to_string())? {
        let entry = entry?;
        let name = entry.file_name();
        let name = name.to_string_lossy();
        if entry.file_type()?.is_dir() {
            remove_unfinished(&entry.path())?;
        } else if is_unfinished(&name) {
            std::fs::remove_file(entry.path())?;
        }
    }
    Ok(())
}

/// Returns the files whose bytes are not those that were written, with the reason.
///
/// # Errors
/// When the list of checksums cannot be read.
pub fn damaged(folder: &Path) -> Result<Vec<String>> {
    let path = folder.join(CHECKSUMS);
    let text = read_text(&path, DATA_BYTES).with_context(|| format!("{}: not a finished data set", path.display()))?;
    let mut wrong = Vec::new();
    for line in text.lines() {
        let Some((sum, name)) = line.split_once("  ") else { bail!("{}: got \"{line}\"", path.display()) };
        match read_bytes(&folder.join(name), u64::MAX) {
            Ok(bytes) if sha256_of(&bytes) == sum => {}
            Ok(_) => wrong.push(format!("{name}: other bytes than were written")),
            Err(error) => wrong.push(format!("{name}: {error}")),
        }
    }
    Ok(wrong)
}

/// Returns the data card.
fn card(spec: &Spec, about: &About, records: &[Record]) -> String {
    let [width, height] = records.first().map_or([0; 2], |record| record.size_px);
    let mut text = format!(
        "# {}\n\n{}\n\n{} images of {width} x {height} pixels (16 bits, {}), drawn by {} from `spec.toml` with seed {}.\n\n",
        about.name, about.description, about.items, about.images, about.program, about.seed
    );
    text += &format!(
        "Licence of the images: {}.\n\nStars: {} {} {}\n\n",
        about.licence,
        credits::GAIA,
        credits::HIPPARCOS,
        credits::TYCHO
    );
    text += "Nothing in it was observed: every image is computed, and every label is what it was computed from. \
             `starloop dataset --verify FOLDER`, or `sha256sum -c checksums.sha256`, checks every file.\n\n";
    text += &format!("| part | where |\n|---|---|\n| images | {} |\n", place_of_images(spec.output.images));
    text += "| labels of items | `labels/items/*.parquet` |\n| stars, targets and bodies of all items | `labels/stars/*.parquet` |\n";
    if records.iter().any(|record| record.coco.is_some()) {
        text += "| boxes of targets | `coco.json` |\n";
    }
    text += "\n## Items\n\n| column | meaning |\n|---|---|\n";
    ITEM_COLUMNS.iter().for_each(|column| text += &format!("| `{}` | {} |\n", column.name, column.meaning));
    text += "\n## Stars\n\n| column | meaning |\n|---|---|\n";
    STAR_COLUMNS.iter().for_each(|column| text += &format!("| `{}` | {} |\n", column.name, column.meaning));
    text
}

fn place_of_images(form: ImageForm) -> &'static str {
    match form {
        ImageForm::Fits => "`images/SHARD/ITEM.fits.fz`, Rice-compressed FITS",
        ImageForm::Png => "`images/SHARD/ITEM.png`, grey of 16 bits",
        ImageForm::Webdataset => "`shards/SHARD.tar`: `ITEM.png`, `ITEM.json`",
        ImageForm::Zarr => "`images.zarr`, an array of items, rows, columns",
    }
}

/// Contents of a record.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// Number of the shard.
    pub shard: u32,
    /// Its items: the first, and the one after the last.
    pub items: [u32; 2],
    /// Columns and rows of its images.
    pub size_px: [usize; 2],
    /// Keys that were drawn for camera and bench, as JSON.
    pub drawn_keys: String,
    /// Its files.
    pub files: Vec<FileRow>,
    /// Images and annotations for COCO; nothing where the description has no targets.
    pub coco: Option<Value>,
}

/// Wall time of a shard, s.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Times {
    /// Making the camera.
    pub prepare_s: f64,
    /// Drawing.
    pub draw_s: f64,
    /// Coding and writing.
    pub write_s: f64,
}

impl Times {
    /// Adds the times of another shard.
    pub fn add(&mut self, other: Self) {
        self.prepare_s += other.prepare_s;
        self.draw_s += other.draw_s;
        self.write_s += other.write_s;
    }
}

/// Returns the path of a shard's record, relative to the folder.
pub fn record_path(shard: u32) -> String {
    format!("records/{shard:05}.json")
}

/// Returns the record of a shard whose files are all there with their lengths; `None` when it must be drawn.
///
/// # Errors
/// When a record is there and cannot be read.
pub fn read_record(folder: &Path, shard: u32, items: &Range<u32>) -> Result<Option<Record>> {
    let path = folder.join(record_path(shard));
    let Ok(text) = read_text(&path, DATA_BYTES) else { return Ok(None) };
    let record: Record = serde_json::from_str(&text).with_context(|| path.display().to_string())?;
    let is_there =
        |row: &FileRow| std::fs::metadata(folder.join(&row.path)).is_ok_and(|found| found.len() == row.bytes);
    let is_whole = record.items == [items.start, items.end] && record.files.iter().all(is_there);
    Ok(is_whole.then_some(record))
}

/// Draws a shard into a folder; `seen` gets the number of each item, and stops the shard when it returns false. Returns
/// `None` when it was stopped.
///
/// # Errors
/// When an item cannot be drawn or a file cannot be written.
pub fn write_shard(
    spec: &Spec,
    (shard, items): (u32, Range<u32>),
    folder: &Path,
    mut seen: impl FnMut(u32) -> bool,
) -> Result<Option<Times>> {
    let (mut watch, mut times) = (Stopwatch::start(), Times::default());
    let mut studio = Studio::new(spec, shard)?;
    times.prepare_s += watch.lap().s();
    let mut files = Files::new(folder);
    let mut images = ImageFiles::new(spec.output.images, shard, &files)?;
    let (mut labels, mut coco) = (Labels::default(), Entries::default());
    for number in items.clone() {
        let item = studio.item(number)?;
        times.draw_s += watch.lap().s();
        let file = images.place_of(number);
        let drawn_keys = studio.drawn_keys.as_str();
        let filed = Filed { item: &item, file: &file, crc32: pixel_crc32(&item.frame.image), drawn_keys };
        images.push(number, &item.frame, || json_of(&filed).to_string(), &mut files)?;
        labels.push(&filed);
        if studio.has_targets() {
            coco.push(&item, &file, spec.output.masks);
        }
        times.write_s += watch.lap().s();
        if !seen(number) {
            return Ok(None);
        }
    }
    images.finish(&mut files)?;
    let [item_table, star_table] = labels.tables(&[("data_set", spec.name.clone())])?;
    files.write(&format!("labels/items/{shard:05}.parquet"), &item_table)?;
    files.write(&format!("labels/stars/{shard:05}.parquet"), &star_table)?;
    let record = Record {
        shard,
        items: [items.start, items.end],
        size_px: studio.size_px(),
        files: files.into_rows(),
        coco: studio.has_targets().then(|| coco.json()),
        drawn_keys: studio.drawn_keys,
    };
    write_below(folder, &record_path(shard), serde_json::to_string(&record)?.as_bytes())?;
    times.write_s += watch.lap().s();
    Ok(Some(times))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spec(seed: u64) -> Spec {
        let text = format!("name = \"x\"\nseed = {seed}\ncamera = \"cameras/small_tracker.toml\"\n");
        Spec::parse(&text, Path::new(".")).unwrap()
    }

    #[test]
    fn folders_of_something_else_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let open = |seed: u64, count: u32, program: &str| {
            let spec = spec(seed);
            begin(folder.path(), &spec, &About::new(&spec, count, program)).map_err(|error| format!("{error:#}"))
        };
        open(1, 10, "p").unwrap();
        open(1, 10, "p").unwrap();
        open(1, 12, "p").unwrap();
        assert!(open(1, 10, "p").unwrap_err().contains("a data set of 12 items"));
        assert!(open(2, 12, "p").unwrap_err().contains("another description"));
        assert!(open(1, 12, "q").unwrap_err().contains("written by p, this is q"));
        let other = tempfile::tempdir().unwrap();
        std::fs::write(other.path().join("thesis.txt"), "x").unwrap();
        let spec = spec(1);
        let error = begin(other.path(), &spec, &About::new(&spec, 1, "p")).unwrap_err().to_string();
        assert!(error.contains("other files"), "{error}");
    }

    #[test]
    fn workers_begin_and_finish_a_folder_at_the_same_time() {
        for _ in 0..40 {
            let folder = tempfile::tempdir().unwrap();
            let spec = spec(1);
            let about = About::new(&spec, 10, "p");
            let start = std::sync::Barrier::new(4);
            std::thread::scope(|scope| {
                let workers: Vec<_> = (0..4)
                    .map(|_| {
                        scope.spawn(|| {
                            start.wait();
                            begin(folder.path(), &spec, &about)?;
                            finish(folder.path(), &spec, &about, &[])
                        })
                    })
                    .collect();
                for worker in workers {
                    worker.join().unwrap().unwrap();
                }
            });
            assert_eq!(damaged(folder.path()).unwrap(), Vec::<String>::new());
        }
    }

    #[test]
    fn folder_without_checksums_cannot_be_verified() {
        let folder = tempfile::tempdir().unwrap();
        assert!(format!("{:#}", damaged(folder.path()).unwrap_err()).contains("not a finished data set"));
    }
}
