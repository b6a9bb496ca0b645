//! The head of a report: where results come from, names and dates that are given.
//!
//! Where results come from: SHA-256 of files, versions, command line, machine.

use anyhow::{Context, Result};
use base::input_file::InputFile;
use frames::report::Page;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::{fmt::Write as _, io::Read, path::Path};

/// Version of the form of `provenance.json`.
pub const SCHEMA: &str = "starloop.provenance/1";

/// Where a result comes from.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Provenance {
    /// Form of this list.
    pub schema: String,
    /// Version of the program.
    pub program_version: String,
    /// SHA-256 of the program, hexadecimal; empty where it cannot be read.
    pub program_sha256: String,
    /// The command line, word by word.
    pub command_line: Vec<String>,
    /// When it was made, UTC.
    pub made_utc: String,
    /// Name of the machine.
    pub host: String,
    /// Processor.
    pub cpu: String,
    /// Operating system and architecture.
    pub system: String,
    /// Seeds by their names.
    pub seeds: Vec<(String, u64)>,
    /// Star catalogs by their names, with versions or hashes.
    pub catalogs: Vec<(String, String)>,
    /// Files that the result depends on.
    pub files: Vec<FileHash>,
}

impl Provenance {
    /// Writes where a result comes from, with at most so many of its files.
    pub fn write(&self, page: &mut Page, most_files: usize) {
        page.heading("Provenance");
        let seeds: Vec<String> = self.seeds.iter().map(|(name, seed)| format!("{name} {seed}")).collect();
        let catalogs: Vec<String> = self.catalogs.iter().map(|(name, what)| format!("{name}: {what}")).collect();
        page.values([
            ("made", self.made_utc.clone()),
            ("command line", self.command_line.join(" ")),
            ("starloop", format!("{}, SHA-256 {}", self.program_version, self.program_sha256)),
            ("machine", format!("{}, {}, {}", self.host, self.cpu, self.system)),
            ("seeds", seeds.join(", ")),
            ("catalogs", catalogs.join(", ")),
        ]);
        page.table(&["file as used", "bytes", "SHA-256"]);
        for file in self.files.iter().take(most_files) {
            page.row(&[&file.path, &file.bytes.to_string(), &file.sha256]);
        }
        page.end_table();
        if self.files.len() > most_files {
            page.paragraph(&format!("{} more are in provenance.json.", self.files.len() - most_files));
        }
    }
}

/// A file with its hash.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct FileHash {
    /// Its path as it was given, or its name in the program.
    pub path: String,
    /// SHA-256, hexadecimal.
    pub sha256: String,
    /// Its size.
    pub bytes: u64,
}

impl FileHash {
    /// Reads a file's hash; `name` is what it is called.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn of_file(path: &Path, name: &str) -> Result<Self> {
        let refuse = || format!("cannot read {}", path.display());
        let mut file = InputFile::open(path, u64::MAX).with_context(refuse)?;
        let (mut hash, mut bytes, mut part) = (Sha256::new(), 0, vec![0; 1 << 16]);
        loop {
            let read = file.read(&mut part).with_context(refuse)?;
            if read == 0 {
                break;
            }
            hash.update(&part[..read]);
            bytes += read as u64;
        }
        Ok(Self { path: name.into(), sha256: hex(&hash.finalize()), bytes })
    }

    /// Returns the hash of a text that is in no file of its own.
    pub fn of_text(name: &str, text: &str) -> Self {
        Self { path: name.into(), sha256: hex(&Sha256::digest(text)), bytes: text.len() as u64 }
    }
}

fn hex(bytes: &[u8]) -> String {
    bytes.iter().fold(String::with_capacity(64), |mut text, byte| {
        let _ = write!(text, "{byte:02x}"); // writing to a string does not fail
        text
    })
}

// Names and dates in the head of a report, which are given and not measured.

/// `[document]` of a plan: names for the report's head.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Paperwork {
    /// The unit under test, such as "ST-20 engineering model".
    pub unit: Option<String>,
    /// Its serial number.
    pub serial_number: Option<String>,
    /// The person who made the test and the report.
    pub author: Option<String>,
    /// Date of the test; a flown plan has the day of the flight.
    pub date_of_test: Option<String>,
}

impl Paperwork {
    /// Returns these, with what is missing taken from others.
    #[must_use]
    pub fn or(self, other: Self) -> Self {
        Self {
            unit: self.unit.or(other.unit),
            serial_number: self.serial_number.or(other.serial_number),
            author: self.author.or(other.author),
            date_of_test: self.date_of_test.or(other.date_of_test),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hashes_are_those_of_the_standard() {
        // FIPS 180-2, appendix B.1.
        let wanted = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(FileHash::of_text("t", "abc").sha256, wanted);
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("abc");
        std::fs::write(&path, "abc").unwrap();
        let file = FileHash::of_file(&path, "abc").unwrap();
        assert_eq!((file.sha256.as_str(), file.bytes), (wanted, 3));
        std::fs::write(&path, "abd").unwrap();
        assert_ne!(FileHash::of_file(&path, "abc").unwrap().sha256, wanted);
    }
}
