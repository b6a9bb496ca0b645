//! One shard on disk: images, labels, and last a record that says that all of it is there.
//!
//! In: the studio of a shard and its items. Out: the files of the shard and `records/00012.json`, which lists them with
//! length and SHA-256. A shard without a record is drawn again from its beginning: a program may be killed at any instant.
//! Tests: below and `make`.

use crate::image_files::{FileRow, Files, ImageFiles, write_below};
use crate::labels::{Filed, Labels, json_of};
use crate::{coco::Entries, spec::Spec, studio::Studio};
use anyhow::{Context, Result};
use base::clock::Stopwatch;
use base::input_file::{DATA_BYTES, read_text};
use core::ops::Range;
use frames::sink::crc32::pixel_crc32;
use serde::{Deserialize, Serialize};
use serde_json::Value;
use std::path::Path;

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
        let drawn_keys = studio.drawn_keys();
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
        drawn_keys: studio.drawn_keys().into(),
        files: files.into_rows(),
        coco: studio.has_targets().then(|| coco.json()),
    };
    write_below(folder, &record_path(shard), serde_json::to_string(&record)?.as_bytes())?;
    times.write_s += watch.lap().s();
    Ok(Some(times))
}
