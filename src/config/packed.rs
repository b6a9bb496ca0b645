//! A configuration with every file that it names: what a capture and a co-simulation unit carry.
//!
//! Configurations are kept as text, by the keys that name them. Files of data (attitudes, orbits, elements, jitter,
//! kernels, maps, images of stars) are kept as files, each with its length and CRC-32; [`PackedDocuments::keep_data`]
//! copies them. Layers of stars, which may have gigabytes, and what displays are calibrated by are not kept. Tests:
//! below, `tests/closed_loop/replay.rs`.

use crate::document::{Document, beside};
use crate::error::{ConfigError, Result};
use crate::setting::NAMES_A_FILE;
use base::input_file::{DATA_BYTES, InputFile};
use serde::{Deserialize, Serialize};
use std::path::{Component, Path, PathBuf};
use std::{collections::BTreeMap, io::Read};

/// Keys of a camera that name a file of points.
const NAMES_A_TABLE: [&str; 2] = ["band.qe_file", "band.transmission_file"];
/// Lists of heads; each head may name a camera.
const NAMES_CAMERAS: [&str; 2] = ["head", "extra_head"];
/// Ends of the keys whose value is the path of a file of data, or a list of such paths.
const NAMES_DATA: [&str; 8] =
    ["plant.attitude", "dark_factor", "density", "dsnu_e", "file", "kernels", "prnu", "series"];
/// Folder of the files of data, below that of the pack.
const DATA_FOLDER: &str = "data";
/// How names of documents of the binary begin.
const BUILT_IN: &str = "built-in ";
/// Most characters that a kept file keeps of its original name.
const NAME_CHARACTERS: usize = 80;

/// A document with every file that it names: what it says whatever becomes of the files.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(transparent)]
pub struct PackedDocuments {
    /// By the keys that name them, joined by dots: "" is the document itself.
    documents: BTreeMap<String, PackedText>,
    /// Where the files of data are kept; `None`: where they were packed from.
    #[serde(skip)]
    folder: Option<PathBuf>,
}

#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PackedText {
    /// How messages call it.
    name: String,
    text: String,
    /// Files of data that it names.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    data: Vec<PackedData>,
}

/// A file of data.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct PackedData {
    /// Its path as the document names it.
    named: String,
    /// Where it is kept, below the folder of the pack.
    kept: String,
    bytes: u64,
    crc32: u32,
}

/// Two packs are equal when they say the same, wherever their files are kept.
impl PartialEq for PackedDocuments {
    fn eq(&self, other: &Self) -> bool {
        self.documents == other.documents
    }
}

impl Eq for PackedDocuments {}

impl Document {
    /// Packs this document and every file it names. Settings decide which files are named; the packed text is without
    /// them.
    ///
    /// # Errors
    /// When a file that it names cannot be read.
    pub fn pack(&self) -> Result<PackedDocuments> {
        let mut set = PackedDocuments { documents: BTreeMap::new(), folder: None };
        self.pack_into(&mut set, String::new())?;
        Ok(set)
    }

    fn pack_into(&self, set: &mut PackedDocuments, keys: String) -> Result<()> {
        let table: toml::Table = self.read_as()?;
        for key in NAMES_A_FILE.into_iter().chain(NAMES_A_TABLE) {
            if let Some(path) = value_of(&table, key).and_then(toml::Value::as_str) {
                self.named(key, path)?.pack_into(set, joined(&keys, key))?;
            }
        }
        for list in NAMES_CAMERAS {
            let heads = table.get(list).and_then(toml::Value::as_array).into_iter().flatten();
            for (place, head) in heads.enumerate() {
                if let Some(path) = head.get("camera").and_then(toml::Value::as_str) {
                    let key = format!("{list}[{place}].camera");
                    self.named(&key, path)?.pack_into(set, joined(&keys, &key))?;
                }
            }
        }
        let links = table.get("extra_link").and_then(toml::Value::as_array).into_iter().flatten();
        for (place, link) in links.enumerate() {
            if let Some(path) = link.as_str() {
                let key = format!("extra_link[{place}]");
                self.named(&key, path)?.pack_into(set, joined(&keys, &key))?;
            }
        }
        let mut named = Vec::new();
        find_data(&table, "", &mut named);
        let before: usize = set.documents.values().map(|packed| packed.data.len()).sum();
        let data = named.into_iter().zip(before..).map(|((key, path), number)| self.measured(&key, path, number));
        let data = data.collect::<Result<_, _>>()?;
        set.documents.insert(keys, PackedText { name: self.name(), text: self.text().to_owned(), data });
        Ok(())
    }

    fn measured(&self, key: &str, path: String, number: usize) -> Result<PackedData> {
        let place = self.data_beside(&path);
        let named_by = format!("; named by {key} in {}: paths are relative to the file that names them", self.name());
        let (bytes, crc32) = sum_of(&place).map_err(|error| unread(&place, &error, named_by))?;
        let name = Path::new(&path).file_name().unwrap_or_default().to_string_lossy();
        let is_plain = |c: char| c.is_ascii_alphanumeric() || ['.', '-', '_'].contains(&c);
        let name: String = name.chars().map(|c| if is_plain(c) { c } else { '_' }).take(NAME_CHARACTERS).collect();
        Ok(PackedData { named: path, kept: format!("{DATA_FOLDER}/{number}_{name}"), bytes, crc32 })
    }
}

impl PackedDocuments {
    /// Returns the same pack with its files of data kept below this folder.
    #[must_use]
    pub fn kept_in(self, folder: &Path) -> Self {
        Self { folder: Some(folder.to_path_buf()), ..self }
    }

    /// Returns each file of data: where it is, and its path below the folder that it is kept in.
    pub fn data(&self) -> impl Iterator<Item = (PathBuf, &str)> {
        self.documents
            .values()
            .flat_map(|packed| packed.data.iter().map(move |data| (packed, data)))
            .map(move |(packed, data)| (self.place_of(packed, data), data.kept.as_str()))
    }

    /// Copies the files of data below a folder, and keeps them there from now on.
    ///
    /// # Errors
    /// When one cannot be read or written.
    pub fn keep_data(&mut self, folder: &Path) -> Result<()> {
        for (from, kept) in self.data() {
            let to = folder.join(kept);
            let refuse =
                |error: std::io::Error| unread(&from, &error, format!("; wanted a copy of it as {}", to.display()));
            std::fs::create_dir_all(folder.join(DATA_FOLDER)).map_err(refuse)?;
            std::fs::copy(&from, &to).map_err(refuse)?;
        }
        self.folder = Some(folder.to_path_buf());
        Ok(())
    }

    /// Refuses files of data that are not those that were packed.
    ///
    /// # Errors
    /// With the first that is missing, of another content, or outside the folder.
    pub fn check_data(&self) -> Result<()> {
        for packed in self.documents.values() {
            for data in &packed.data {
                let place = self.place_of(packed, data);
                let named_by = || format!("; named as \"{}\" in {}", data.named, packed.name);
                let refuse =
                    |why: String| ConfigError::Read { file: place.display().to_string(), why, named_by: named_by() };
                if !Path::new(&data.kept).components().all(|part| matches!(part, Component::Normal(_))) {
                    return Err(refuse("wanted a path below the folder of the pack".into()));
                }
                let got = sum_of(&place).map_err(|error| unread(&place, &error, named_by()))?;
                if got != (data.bytes, data.crc32) {
                    let ((bytes, crc32), PackedData { bytes: wanted, crc32: sum, .. }) = (got, data);
                    let why =
                        format!("got {bytes} bytes of CRC-32 {crc32:08x}, wanted {wanted} of {sum:08x}, as packed");
                    return Err(refuse(why));
                }
            }
        }
        Ok(())
    }

    pub(super) fn text_of(&self, keys: &str) -> Option<&str> {
        self.documents.get(keys).map(|packed| packed.text.as_str())
    }

    pub(super) fn name_of(&self, keys: &str) -> String {
        self.documents.get(keys).map_or_else(String::new, |packed| packed.name.clone())
    }

    /// Returns where the file of data lies that the document of these keys names so.
    pub(super) fn data_file(&self, keys: &str, path: &str) -> PathBuf {
        let Some(packed) = self.documents.get(keys) else { return PathBuf::from(path) };
        let data = packed.data.iter().find(|data| data.named == path);
        data.map_or_else(|| original(packed, path), |data| self.place_of(packed, data))
    }

    fn place_of(&self, packed: &PackedText, data: &PackedData) -> PathBuf {
        match &self.folder {
            Some(folder) => folder.join(&data.kept),
            None => original(packed, &data.named),
        }
    }
}

/// Returns where a file lay when its document was packed.
fn original(packed: &PackedText, path: &str) -> PathBuf {
    if packed.name.starts_with(BUILT_IN) { PathBuf::from(path) } else { beside(Path::new(&packed.name), path) }
}

fn unread(place: &Path, error: &std::io::Error, named_by: String) -> ConfigError {
    ConfigError::Read { file: place.display().to_string(), why: error.to_string(), named_by }
}

/// Returns the length and CRC-32 of a file.
fn sum_of(path: &Path) -> std::io::Result<(u64, u32)> {
    let (mut file, mut hasher, mut bytes) = (InputFile::open(path, DATA_BYTES)?, crc32fast::Hasher::new(), 0);
    let mut buffer = vec![0; 1 << 16];
    loop {
        let count = file.read(&mut buffer)?;
        if count == 0 {
            return Ok((bytes, hasher.finalize()));
        }
        hasher.update(&buffer[..count]);
        bytes += count as u64;
    }
}

/// Adds keys and paths of the files of data that a table names.
fn find_data(table: &toml::Table, under: &str, found: &mut Vec<(String, String)>) {
    for (name, value) in table {
        let key = joined(under, name);
        find_in(names_data(&key), value, key, found);
    }
}

/// Returns true for a key that ends in one of [`NAMES_DATA`].
fn names_data(key: &str) -> bool {
    let ends_in = |known: &str| key.strip_suffix(known).is_some_and(|table| table.is_empty() || table.ends_with('.'));
    NAMES_DATA.iter().any(|known| ends_in(known))
}

/// Adds what a value of the key `key` names; `is_path`: text in it is a path.
fn find_in(is_path: bool, value: &toml::Value, key: String, found: &mut Vec<(String, String)>) {
    if let Some(path) = value.as_str().filter(|_| is_path) {
        found.push((key, path.to_owned()));
    } else if let Some(inner) = value.as_table() {
        find_data(inner, &key, found);
    } else if let Some(items) = value.as_array() {
        for (place, item) in items.iter().enumerate() {
            find_in(is_path, item, format!("{key}[{place}]"), found);
        }
    }
}

/// Returns the value of a key such as `band.qe_file`.
fn value_of<'a>(table: &'a toml::Table, key: &str) -> Option<&'a toml::Value> {
    match key.split_once('.') {
        Some((section, rest)) => value_of(table.get(section)?.as_table()?, rest),
        None => table.get(key),
    }
}

/// Returns a key below those that led to a document.
pub(super) fn joined(keys: &str, key: &str) -> String {
    if keys.is_empty() { key.into() } else { format!("{keys}.{key}") }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Bench, declared::Declared, file_kind::FileKind, key_type::Shape, reference::declared};
    use std::collections::BTreeSet;

    const BENCH: &str = "[timing]\nduration_s = 2.0\n[jitter]\nseries = \"in/shake it.csv\"\nat_end = \"repeat\"\n";
    const ROWS: &str = "t_s,x_arcsec\n0.0,1.0\n0.1,2.0\n0.2,0.5\n";

    fn packed(folder: &Path) -> (Document, PackedDocuments) {
        std::fs::create_dir(folder.join("in")).unwrap();
        std::fs::write(folder.join("in/shake it.csv"), ROWS).unwrap();
        let document = Document::from_text(BENCH, &folder.join("lab.toml"));
        let set = document.pack().unwrap();
        (document, set)
    }

    #[test]
    fn files_of_data_are_kept_and_read_where_they_are_kept() {
        let [from, to] = [(); 2].map(|()| tempfile::tempdir().unwrap());
        let (document, mut set) = packed(from.path());
        set.keep_data(to.path()).unwrap();
        let wanted = Bench::from_document(&document).unwrap().jitter.unwrap().record(1).unwrap();
        let text = serde_json::to_string(&set).unwrap();
        drop(from);
        assert!(Bench::from_document(&document).is_err(), "control: the original is gone");

        let read: PackedDocuments = serde_json::from_str(&text).unwrap();
        let read = read.kept_in(to.path());
        read.check_data().unwrap();
        let got = Bench::from_document(&Document::packed(read.clone()).unwrap()).unwrap().jitter.unwrap();
        assert_eq!(*got.record(1).unwrap(), *wanted);
        assert!(to.path().join("data/0_shake_it.csv").exists());

        std::fs::write(to.path().join("data/0_shake_it.csv"), ROWS.replace("2.0", "3.0")).unwrap();
        let error = read.check_data().unwrap_err().to_string();
        assert!(error.contains("CRC-32") && error.contains("in/shake it.csv"), "{error}");
        let outside: PackedDocuments = serde_json::from_str(&text.replace("data/0_", "../0_")).unwrap();
        let error = outside.kept_in(to.path()).check_data().unwrap_err().to_string();
        assert!(error.contains("wanted a path below"), "{error}");
    }

    #[test]
    fn packs_of_versions_that_kept_no_data_read_it_where_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let (document, set) = packed(folder.path());
        let mut value = serde_json::to_value(&set).unwrap();
        assert!(value[""].as_object_mut().unwrap().remove("data").is_some());
        let old: PackedDocuments = serde_json::from_value(value).unwrap();
        old.check_data().unwrap();
        let of = |document: &Document| Bench::from_document(document).unwrap().jitter;
        assert_eq!(of(&Document::packed(old).unwrap()), of(&document));
    }

    #[test]
    fn a_file_of_data_that_is_missing_is_named_with_its_key() {
        let folder = tempfile::tempdir().unwrap();
        let document = Document::from_text(BENCH, &folder.path().join("lab.toml"));
        let error = document.pack().unwrap_err().to_string();
        assert!(error.contains("jitter.series") && error.contains("shake it.csv"), "{error}");
    }

    /// Keys that are paths and name no file of data: documents, outputs, devices, and what is not kept.
    const NOT_DATA: [&str; 16] = [
        "requirements",
        "path",
        "bench",
        "calibration",
        "camera",
        "card",
        "directory",
        "far_port",
        "layers",
        "path",
        "port",
        "pps",
        "ptp_socket",
        "slcan_pty",
        "spacecraft",
        "transmission_file",
    ];

    fn paths_of(declared: &Declared, found: &mut BTreeSet<&'static str>) {
        let is_path = |shape: &Shape| matches!(shape, Shape::Text(what) if what.starts_with("path"));
        for key in &declared.keys {
            let is_paths = matches!(&key.shape, Shape::List(of) if is_path(of));
            if is_path(&key.shape) || is_paths {
                found.insert(key.name);
            }
        }
        declared.tables.iter().flat_map(|table| &table.forms).for_each(|form| paths_of(form, found));
    }

    /// Keys of such a name whose value is a text and no path.
    fn words_of(declared: &Declared, under: &str, found: &mut BTreeSet<String>) {
        for key in &declared.keys {
            let is_text = matches!(&key.shape, Shape::Text(what) if !what.starts_with("path"));
            let is_word = is_text || matches!(key.shape, Shape::Words(_) | Shape::Either(_));
            let key = joined(under, key.name);
            if is_word && names_data(&key) {
                found.insert(key);
            }
        }
        for table in &declared.tables {
            table.forms.iter().for_each(|form| words_of(form, &joined(under, table.name), found));
        }
    }

    #[test]
    fn a_word_by_the_name_of_a_file_of_data_is_no_file() {
        let mut found = BTreeSet::new();
        FileKind::ALL.into_iter().for_each(|kind| words_of(&declared(kind), "", &mut found));
        assert_eq!(found, BTreeSet::new());

        let folder = tempfile::tempdir().unwrap();
        let pack = |text: &str| Document::from_text(text, &folder.path().join("lab.toml")).pack();
        assert_eq!(pack("[initial]\nattitude = \"given\"\n").unwrap().data().count(), 0);
        let error = pack("[plant]\nattitude = \"given\"\n").unwrap_err().to_string();
        assert!(error.contains("plant.attitude"), "control: there it is a file: {error}");
    }

    #[test]
    fn every_key_that_is_a_path_is_kept_or_known_not_to_be() {
        let mut found = BTreeSet::new();
        FileKind::ALL.into_iter().for_each(|kind| paths_of(&declared(kind), &mut found));
        let last = |known: &&'static str| known.rsplit('.').next().unwrap_or_default();
        let is_data = |name: &str| NAMES_DATA.iter().any(|known| last(known) == name);
        let is_known = |name: &&&str| is_data(name) || NOT_DATA.contains(name) || **name == "qe_file";
        let unknown: Vec<_> = found.iter().filter(|name| !is_known(name)).collect();
        assert!(unknown.is_empty(), "add them to NAMES_DATA, or here: {unknown:?}");
        let unused: Vec<_> = NAMES_DATA.iter().filter(|name| !found.contains(last(name))).collect();
        assert!(unused.is_empty(), "no key: {unused:?}");
        assert!(names_data("plant.attitude") && names_data("head[0].detector.prnu"), "paths");
        assert!(!names_data("plant.initial.attitude") && !names_data("initial.attitude"), "a word, not a path");
    }
}
