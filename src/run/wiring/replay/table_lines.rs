//! Reads a table of a captured run line by line: complete lines only, none beyond a length.

use super::{ReplayError, Result};
use base::refused::Refused;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

/// Reads the lines one by one.
pub(super) struct TableLines<R> {
    source: R,
    path: PathBuf,
    /// Action for error messages.
    doing: &'static str,
    /// Longest line, bytes, and the message for a longer one.
    most: (u64, &'static str),
    line: u64,
    is_cut_off: bool,
}

impl TableLines<BufReader<File>> {
    /// Opens the file.
    pub(super) fn open(path: &Path, doing: &'static str, most: (u64, &'static str)) -> Result<Self> {
        let file = File::open(path).map_err(ReplayError::file(path, doing))?;
        Ok(Self::new(BufReader::new(file), path, doing, most))
    }
}

impl<R: BufRead> TableLines<R> {
    /// Reads from `source`; errors name `path`.
    pub(super) fn new(source: R, path: &Path, doing: &'static str, most: (u64, &'static str)) -> Self {
        Self { source, path: path.into(), doing, most, line: 0, is_cut_off: false }
    }

    /// Returns true when the last line was cut off, as by a power cut; it is left out.
    pub(super) fn is_cut_off(&self) -> bool {
        self.is_cut_off
    }

    /// Returns the number of the latest line, from 1.
    pub(super) fn line(&self) -> u64 {
        self.line
    }

    /// Returns the next line without its end; `None` at the end of the file.
    pub(super) fn read(&mut self) -> Result<Option<String>> {
        let (most, too_long) = self.most;
        let mut bytes = Vec::new();
        self.line += 1;
        let read = self.source.by_ref().take(most).read_until(b'\n', &mut bytes);
        read.map_err(ReplayError::file(&self.path, self.doing))?;
        let text = String::from_utf8_lossy(&bytes).into_owned();
        match text.strip_suffix('\n') {
            Some(whole) => Ok(Some(whole.trim_end_matches('\r').into())),
            None if bytes.len() as u64 == most => Err(self.refuse(too_long, &text)),
            None => {
                self.is_cut_off = !bytes.is_empty();
                Ok(None)
            }
        }
    }

    /// Returns the error of the latest line.
    pub(super) fn refuse(&self, why: &'static str, text: &str) -> ReplayError {
        let text: String = text.chars().take(60).map(|c| if c.is_control() { '.' } else { c }).collect();
        Refused(format!("{}:{}: {why}; got \"{text}\"", self.path.display(), self.line)).into()
    }
}
