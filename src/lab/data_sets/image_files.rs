//! Images of a shard in files: FITS, PNG, WebDataset, Zarr.
//!
//! In: frames in the order of their items. Out: files below the folder of the data set, each written whole or not at all,
//! with length and SHA-256. Sources: FITS standard 4.0; PNG (ISO 15948); POSIX ustar, with the names that WebDataset joins
//! (`000012.png`, `000012.json`); Zarr core specification version 3, codecs `bytes` and `zstd`. Tests: below, and with
//! astropy, webdataset and zarr in `hil_scripts/tests/test_data_sets.py`.

use crate::spec::ImageForm;
use anyhow::{Context, Result};
use base::unfinished::Unfinished;
use frames::sink::{SentFrame, fits, png, replace_own_file};
use serde::{Deserialize, Serialize};
use serde_json::json;
use sha2::{Digest, Sha256};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::{fs::Permissions, os::unix::fs::PermissionsExt};
use tempfile::NamedTempFile;

/// Level of Zarr's chunks: the fastest.
const ZSTD_LEVEL: i32 = 1;
/// Name of the array of all images.
pub const ARRAY: &str = "images.zarr";

/// A file of a data set.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileRow {
    /// Path relative to the folder.
    pub path: String,
    /// Length.
    pub bytes: u64,
    /// SHA-256, hexadecimal.
    pub sha256: String,
}

/// Writes files below a folder, and lists them.
pub struct Files {
    folder: PathBuf,
    rows: Vec<FileRow>,
}

impl Files {
    /// Returns a list of no file below a folder.
    pub fn new(folder: &Path) -> Self {
        Self { folder: folder.into(), rows: Vec::new() }
    }

    /// Writes a file at a path relative to the folder.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn write(&mut self, path: &str, bytes: &[u8]) -> Result<()> {
        write_below(&self.folder, path, bytes)?;
        let sha256 = sha256_of(bytes);
        self.rows.push(FileRow { path: path.into(), bytes: bytes.len() as u64, sha256 });
        Ok(())
    }

    /// Begins a file that grows; it takes its name when it is finished.
    ///
    /// # Errors
    /// When it cannot be made.
    fn begin(&self, path: &str) -> Result<Growing> {
        let whole = self.folder.join(path);
        let parent = whole.parent().unwrap_or(&self.folder);
        std::fs::create_dir_all(parent).with_context(|| parent.display().to_string())?;
        let file = tempfile::Builder::new().prefix(".").suffix(".part").tempfile_in(parent)?;
        let registered = Unfinished::register(file.path());
        Ok(Growing { file, _registered: registered, hash: Sha256::new(), bytes: 0 })
    }

    /// Gives a file that has grown its name.
    ///
    /// # Errors
    /// When it cannot be written.
    fn end(&mut self, path: &str, mut growing: Growing) -> Result<()> {
        growing.flush()?;
        growing.file.as_file().set_permissions(Permissions::from_mode(0o644))?;
        growing.file.persist(self.folder.join(path))?;
        self.rows.push(FileRow {
            path: path.into(),
            bytes: growing.bytes,
            sha256: hexadecimal(&growing.hash.finalize()),
        });
        Ok(())
    }

    /// Returns the files, by path.
    pub fn into_rows(mut self) -> Vec<FileRow> {
        self.rows.sort_by(|a, b| a.path.cmp(&b.path));
        self.rows
    }
}

/// A file that grows, under a name that nothing else has.
struct Growing {
    file: NamedTempFile,
    _registered: Unfinished,
    hash: Sha256,
    bytes: u64,
}

impl Write for Growing {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let written = self.file.write(bytes)?;
        self.hash.update(&bytes[..written]);
        self.bytes += written as u64;
        Ok(written)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// Writes a file at a path relative to a folder, and the folders between.
///
/// # Errors
/// When it cannot be written.
pub fn write_below(folder: &Path, path: &str, bytes: &[u8]) -> Result<()> {
    let whole = folder.join(path);
    if let Some(parent) = whole.parent() {
        std::fs::create_dir_all(parent).with_context(|| parent.display().to_string())?;
    }
    replace_own_file(&whole, |out| out.write_all(bytes))?;
    Ok(())
}

/// Returns the SHA-256 of bytes, hexadecimal.
pub fn sha256_of(bytes: &[u8]) -> String {
    hexadecimal(&Sha256::digest(bytes))
}

fn hexadecimal(bytes: &[u8]) -> String {
    bytes.iter().map(|byte| format!("{byte:02x}")).collect()
}

/// Images of one shard on their way to files.
pub struct ImageFiles {
    form: ImageForm,
    shard: u32,
    /// The tar file under way.
    tar: Option<tar::Builder<Growing>>,
}

impl ImageFiles {
    /// Begins the files of a shard.
    ///
    /// # Errors
    /// When a file cannot be made.
    pub fn new(form: ImageForm, shard: u32, files: &Files) -> Result<Self> {
        let tar = match form {
            ImageForm::Webdataset => Some(tar::Builder::new(files.begin(&tar_name(shard))?)),
            ImageForm::Fits | ImageForm::Png | ImageForm::Zarr => None,
        };
        Ok(Self { form, shard, tar })
    }

    /// Returns where the image of an item is, as the labels name it.
    pub fn place(form: ImageForm, shard: u32, item: u32) -> String {
        match form {
            ImageForm::Fits => format!("images/{shard:05}/{item:08}.fits.fz"),
            ImageForm::Png => format!("images/{shard:05}/{item:08}.png"),
            ImageForm::Webdataset => format!("{}:{item:08}.png", tar_name(shard)),
            ImageForm::Zarr => format!("{ARRAY}[{item}]"),
        }
    }

    /// Returns where the image of an item of this shard is.
    pub fn place_of(&self, item: u32) -> String {
        Self::place(self.form, self.shard, item)
    }

    /// Writes the image of an item, or adds it to the file of the shard with its labels.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn push(
        &mut self,
        item: u32,
        frame: &SentFrame,
        labels: impl FnOnce() -> String,
        files: &mut Files,
    ) -> Result<()> {
        let mut bytes = Vec::new();
        match self.form {
            ImageForm::Fits => {
                fits::write_compressed_frame(&mut bytes, frame)?;
                files.write(&self.place_of(item), &bytes)
            }
            ImageForm::Png => {
                png::write_dn_raw(&mut bytes, &frame.image)?;
                files.write(&self.place_of(item), &bytes)
            }
            ImageForm::Webdataset => {
                png::write_dn_raw(&mut bytes, &frame.image)?;
                let Some(tar) = &mut self.tar else { return Ok(()) };
                append(tar, &format!("{item:08}.png"), &bytes)?;
                append(tar, &format!("{item:08}.json"), labels().as_bytes())
            }
            ImageForm::Zarr => {
                let mut words = vec![0; 2 * frame.image.pixels().len()];
                for (bytes, dn) in words.as_chunks_mut().0.iter_mut().zip(frame.image.pixels()) {
                    *bytes = dn.to_le_bytes();
                }
                let chunk = zstd::bulk::compress(&words, ZSTD_LEVEL)?;
                files.write(&format!("{ARRAY}/c/{item}/0/0"), &chunk)
            }
        }
    }

    /// Writes the file of the shard, where there is one.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn finish(self, files: &mut Files) -> Result<()> {
        match self.tar {
            Some(tar) => files.end(&tar_name(self.shard), tar.into_inner()?),
            None => Ok(()),
        }
    }
}

fn tar_name(shard: u32) -> String {
    format!("shards/{shard:06}.tar")
}

/// Adds a file to a tar file, with nothing in its header that depends on when and by whom.
fn append(tar: &mut tar::Builder<impl Write>, name: &str, bytes: &[u8]) -> Result<()> {
    let mut header = tar::Header::new_ustar();
    header.set_size(bytes.len() as u64);
    header.set_mode(0o644);
    header.set_mtime(0);
    header.set_cksum();
    Ok(tar.append_data(&mut header, name, bytes)?)
}

/// Returns the description of the array of all images: Zarr, version 3.
pub fn array_description(count: u32, [width, height]: [usize; 2]) -> String {
    let description = json!({
        "zarr_format": 3,
        "node_type": "array",
        "shape": [count, height, width],
        "data_type": "uint16",
        "chunk_grid": { "name": "regular", "configuration": { "chunk_shape": [1, height, width] } },
        "chunk_key_encoding": { "name": "default", "configuration": { "separator": "/" } },
        "codecs": [
            { "name": "bytes", "configuration": { "endian": "little" } },
            { "name": "zstd", "configuration": { "level": ZSTD_LEVEL, "checksum": false } },
        ],
        "fill_value": 0,
        "dimension_names": ["item", "y_px", "x_px"],
        "attributes": { "unit": "DN" },
    });
    format!("{description:#}\n")
}

#[cfg(test)]
mod tests {
    use super::*;
    use frames::sink::sample::sample_frame;

    fn written(form: ImageForm) -> Vec<(FileRow, Vec<u8>)> {
        let folder = tempfile::tempdir().unwrap();
        let mut files = Files::new(folder.path());
        let mut images = ImageFiles::new(form, 3, &files).unwrap();
        for item in [31, 30] {
            images.push(item, &sample_frame(0), || format!("{{\"item\":{item}}}"), &mut files).unwrap();
        }
        images.finish(&mut files).unwrap();
        let read = |row: FileRow| {
            let bytes = std::fs::read(folder.path().join(&row.path)).unwrap();
            (row, bytes)
        };
        files.into_rows().into_iter().map(read).collect()
    }

    #[test]
    fn files_have_the_places_and_sums_that_are_listed() {
        for (form, places) in [
            (ImageForm::Fits, vec!["images/00003/00000030.fits.fz", "images/00003/00000031.fits.fz"]),
            (ImageForm::Png, vec!["images/00003/00000030.png", "images/00003/00000031.png"]),
            (ImageForm::Webdataset, vec!["shards/000003.tar"]),
            (ImageForm::Zarr, vec!["images.zarr/c/30/0/0", "images.zarr/c/31/0/0"]),
        ] {
            let files = written(form);
            assert_eq!(files.iter().map(|(row, _)| row.path.as_str()).collect::<Vec<_>>(), places);
            for (row, bytes) in &files {
                assert_eq!((row.bytes, &row.sha256), (bytes.len() as u64, &sha256_of(bytes)));
            }
            assert_eq!(files, written(form), "the same bytes again");
        }
        assert_eq!(sha256_of(b"abc")[..8], *"ba7816bf", "FIPS 180-4");
    }

    #[test]
    fn tar_files_have_image_and_labels_of_each_item() {
        let (_, bytes) = written(ImageForm::Webdataset).remove(0);
        let mut tar = tar::Archive::new(bytes.as_slice());
        let names: Vec<String> =
            tar.entries().unwrap().map(|entry| entry.unwrap().path().unwrap().display().to_string()).collect();
        assert_eq!(names, ["00000031.png", "00000031.json", "00000030.png", "00000030.json"]);
    }

    #[test]
    fn chunks_hold_the_pixels() {
        let (_, bytes) = written(ImageForm::Zarr).remove(0);
        let image = sample_frame(0).image;
        let words = zstd::bulk::decompress(&bytes, 2 * image.pixels().len()).unwrap();
        assert_eq!(words[..2], image.pixels()[0].to_le_bytes());
        assert_eq!(words.len(), 2 * image.pixels().len());
    }
}
