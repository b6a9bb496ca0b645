//! `frames.csv` -> rows as they are in the file, or the rows of one head in the order of its frames.

use super::rows::ORDER_FRAMES;
use super::{FrameRow, ReplayError, RowForm};
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};

/// Longest row, bytes.
const ROW_MAX: u64 = 2048;

/// Reads the rows one by one.
pub struct RowReader<R> {
    source: R,
    path: PathBuf,
    form: RowForm,
    line: u64,
    is_cut_off: bool,
}

impl RowReader<BufReader<File>> {
    /// Opens the file and checks its first line.
    ///
    /// # Errors
    /// When it cannot be read, or is no such file.
    pub fn open(path: &Path) -> Result<Self, ReplayError> {
        let refuse = |source| ReplayError::File { path: path.into(), doing: "read the frames", source };
        Self::new(BufReader::new(File::open(path).map_err(refuse)?), path)
    }
}

impl<R: BufRead> RowReader<R> {
    /// Reads from `source`, which errors call `path`.
    ///
    /// # Errors
    /// When its first line is not that of such a file.
    pub fn new(source: R, path: &Path) -> Result<Self, ReplayError> {
        let mut reader = Self { source, path: path.into(), form: RowForm::Two, line: 0, is_cut_off: false };
        let text = reader.read_line()?.unwrap_or_default();
        let refuse = || reader.refuse("wanted frame,head,messages,load_bits,rung,fate,crc32,exposed", &text);
        reader.form = RowForm::of_header(&text).ok_or_else(refuse)?;
        Ok(reader)
    }

    /// True when the last line was cut off, as by a power cut; it is left out.
    #[must_use]
    pub fn is_cut_off(&self) -> bool {
        self.is_cut_off
    }

    /// The next row; `None` at the end.
    ///
    /// # Errors
    /// When the line is no row.
    pub fn read(&mut self) -> Result<Option<FrameRow>, ReplayError> {
        let Some(text) = self.read_line()? else { return Ok(None) };
        FrameRow::parse(&text, self.form).map(Some).map_err(|why| self.refuse(why, &text))
    }

    fn read_line(&mut self) -> Result<Option<String>, ReplayError> {
        let mut bytes = Vec::new();
        self.line += 1;
        let read = self.source.by_ref().take(ROW_MAX).read_until(b'\n', &mut bytes);
        read.map_err(|source| ReplayError::File { path: self.path.clone(), doing: "read the frames", source })?;
        let text = String::from_utf8_lossy(&bytes).into_owned();
        match text.strip_suffix('\n') {
            Some(whole) => Ok(Some(whole.trim_end_matches('\r').into())),
            None if bytes.len() as u64 == ROW_MAX => Err(self.refuse("longer than 2048 bytes", &text)),
            None => {
                self.is_cut_off = !bytes.is_empty();
                Ok(None)
            }
        }
    }

    fn refuse(&self, why: &'static str, text: &str) -> ReplayError {
        let text = text.chars().take(60).map(|c| if c.is_control() { '.' } else { c }).collect();
        ReplayError::Row { path: self.path.clone(), line: self.line, why, text }
    }
}

/// Reads the rows of one head in the order of frames, of which at most [`ORDER_FRAMES`] wait for an earlier one.
pub(super) struct RowsOfHead<R> {
    reader: RowReader<R>,
    head: usize,
    /// By frame and line: two rows of one frame come as they are in the file.
    waiting: BTreeMap<(u32, u64), FrameRow>,
    newest: u32,
    is_over: bool,
}

impl<R: BufRead> RowsOfHead<R> {
    pub(super) fn new(reader: RowReader<R>, head: usize) -> Self {
        Self { reader, head, waiting: BTreeMap::new(), newest: 0, is_over: false }
    }

    /// As [`RowReader::is_cut_off`], at the end.
    pub(super) fn is_cut_off(&self) -> bool {
        self.reader.is_cut_off()
    }

    /// The next row; `None` at the end.
    pub(super) fn read(&mut self) -> Result<Option<FrameRow>, ReplayError> {
        loop {
            let first = self.waiting.first_key_value().map(|((frame, _), _)| *frame);
            if self.is_over || first.is_some_and(|frame| frame.saturating_add(ORDER_FRAMES) <= self.newest) {
                return Ok(self.waiting.pop_first().map(|(_, row)| row));
            }
            match self.reader.read()? {
                None => self.is_over = true,
                Some(row) if row.head != self.head => {}
                Some(row) => {
                    self.newest = self.newest.max(row.frame);
                    self.waiting.insert((row.frame, self.reader.line), row);
                }
            }
        }
    }
}
