//! `frames.csv` -> rows in the order of the file, or the rows of one head in the order of its frames.

use super::rows::{ORDER_FRAMES, WANTED_HEADER};
use super::table_lines::TableLines;
use super::{FrameRow, ReplayError, RowForm};
use std::io::{BufRead, BufReader};
use std::{collections::BTreeMap, fs::File, path::Path};

const DOING: &str = "read the frames";
/// Longest row, bytes.
const ROW_MAX: (u64, &str) = (2048, "longer than 2048 bytes");

/// Reads the rows one by one.
pub struct RowReader<R> {
    lines: TableLines<R>,
    form: RowForm,
}

impl RowReader<BufReader<File>> {
    /// Opens the file and checks its first line.
    ///
    /// # Errors
    /// When it cannot be read, or is not a table of frames.
    pub fn open(path: &Path) -> Result<Self, ReplayError> {
        Self::of(TableLines::open(path, DOING, ROW_MAX)?)
    }
}

impl<R: BufRead> RowReader<R> {
    /// Reads from `source`; errors name `path`.
    ///
    /// # Errors
    /// When its first line is not that of a table of frames.
    pub fn new(source: R, path: &Path) -> Result<Self, ReplayError> {
        Self::of(TableLines::new(source, path, DOING, ROW_MAX))
    }

    fn of(mut lines: TableLines<R>) -> Result<Self, ReplayError> {
        let text = lines.read()?.unwrap_or_default();
        let refuse = || lines.refuse(WANTED_HEADER, &text);
        let form = RowForm::of_header(&text).ok_or_else(refuse)?;
        Ok(Self { lines, form })
    }

    /// Returns true when the last line was cut off, as by a power cut; it is left out.
    pub fn is_cut_off(&self) -> bool {
        self.lines.is_cut_off()
    }

    /// Returns the next row; `None` at the end.
    ///
    /// # Errors
    /// When the line is not a valid row.
    pub fn read(&mut self) -> Result<Option<FrameRow>, ReplayError> {
        let Some(text) = self.lines.read()? else { return Ok(None) };
        FrameRow::parse(&text, self.form).map(Some).map_err(|why| self.lines.refuse(why, &text))
    }
}

/// Reads the rows of one head in the order of frames; at most [`ORDER_FRAMES`] rows wait for an earlier one.
pub(super) struct RowsOfHead<R> {
    reader: RowReader<R>,
    head: usize,
    /// Number of heads of the bench.
    heads: usize,
    /// Waiting rows by frame and line: two rows of one frame keep the order of the file.
    waiting: BTreeMap<(u32, u64), FrameRow>,
    newest: u32,
    is_over: bool,
}

impl<R: BufRead> RowsOfHead<R> {
    pub(super) fn new(reader: RowReader<R>, head: usize, heads: usize) -> Self {
        Self { reader, head, heads, waiting: BTreeMap::new(), newest: 0, is_over: false }
    }

    /// Returns the same as [`RowReader::is_cut_off`], at the end.
    pub(super) fn is_cut_off(&self) -> bool {
        self.reader.is_cut_off()
    }

    /// Returns the next row; `None` at the end.
    pub(super) fn read(&mut self) -> Result<Option<FrameRow>, ReplayError> {
        loop {
            let first = self.waiting.first_key_value().map(|((frame, _), _)| *frame);
            if self.is_over || first.is_some_and(|frame| frame.saturating_add(ORDER_FRAMES) <= self.newest) {
                return Ok(self.waiting.pop_first().map(|(_, row)| row));
            }
            match self.reader.read()? {
                None => self.is_over = true,
                Some(row) if row.head >= self.heads => {
                    let text = format!("frame {}, head {}", row.frame, row.head);
                    return Err(self.reader.lines.refuse("wanted a head of the bench, counted from 0", &text));
                }
                Some(row) if row.head != self.head => {}
                Some(row) => {
                    self.newest = self.newest.max(row.frame);
                    self.waiting.insert((row.frame, self.reader.lines.line()), row);
                }
            }
        }
    }
}
