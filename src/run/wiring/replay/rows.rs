//! One row of `frames.csv`, the table of a captured run's frames: the inputs and the result of each frame.
//!
//! Columns: frame; head; messages that each link brought before it was drawn, `120;118` (all since the run started;
//! empty: nothing was drawn); load, the 64 bits of the number in hexadecimal; degradation; fate; CRC-32 of the pixels
//! that went out (empty: none did); exposure of a commanded camera. A row of fate `held` has the
//! checksum of the frame that was sent again.
//!
//! Form 1 of the table has no column of heads and one link, form 2 no column of exposures. All are read, form 3 is
//! written. Rows of one head are nearly in the order of frames: a row comes after every row of a frame [`ORDER_FRAMES`]
//! earlier.
//!
//! Counts of the rows of `frames.csv`, kept in the end record of a capture.
//!
//! `frames.csv` -> rows in the order of the file, or the rows of one head in the order of its frames.
//!
//! The last column of `frames.csv`: the exposure of a commanded camera.
//!
//! `start;length;gain;black level;started;trigger;regions`: TAI in ns, ns, the 64 bits of dB and of DN in hexadecimal,
//! the event that started it, time of its trigger (TAI in ns; empty: none), and `left:top:width:height` of each region
//! with `+` between them. Empty: an exposure by the frame rate with the camera's own settings.

use super::{Result, table_lines::TableLines};
use crate::runtime::clock_intake::PORTS_MAX;
use crate::runtime::{Exposed, Started};
use base::time::{Span, Tai};
use frames::camera_control::{CameraSettings, Region, Regions, TriggerSource};
use serde::{Deserialize, Serialize};
use std::io::{BufRead, BufReader, Write};
use std::{collections::BTreeMap, fs::File, io, path::Path};

/// Expands to the last columns of every form. The column of the degradation keeps its published name.
macro_rules! columns {
    () => {
        "load_bits,rung,fate,crc32"
    };
}
#[cfg(test)]
pub(super) use columns;

/// First line of form 1.
pub(super) const HEADER_OF_ONE: &str = concat!("frame,messages,", columns!());
/// First line of form 2.
const HEADER_OF_TWO: &str = concat!("frame,head,messages,", columns!());
/// First line of form 3.
pub(super) const HEADER: &str = concat!("frame,head,messages,", columns!(), ",exposed");
/// Message for a table with another first line.
pub(super) const WANTED_HEADER: &str = concat!("wanted frame,head,messages,", columns!(), ",exposed");
/// Largest number of rows of later frames before the row of a frame that goes out late.
pub(super) const ORDER_FRAMES: u32 = 1024;

/// Columns of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RowForm {
    /// One head and one link.
    One,
    /// Several heads and links.
    Two,
    /// Several, with exposures.
    Three,
}

impl RowForm {
    /// Returns the form whose first line is this.
    pub fn of_header(line: &str) -> Option<Self> {
        [(HEADER_OF_ONE, Self::One), (HEADER_OF_TWO, Self::Two), (HEADER, Self::Three)]
            .into_iter()
            .find_map(|(header, form)| (header == line).then_some(form))
    }
}

/// Result of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CapturedFate {
    /// It went out in time.
    Sent,
    /// It went out late.
    Late,
    /// The last frame that went out in time was sent again in its place.
    Held,
    /// Nothing went out.
    Dropped,
}

impl CapturedFate {
    const NAMED: [(Self, &'static str); 4] =
        [(Self::Sent, "sent"), (Self::Late, "late"), (Self::Held, "held"), (Self::Dropped, "dropped")];

    fn name(self) -> &'static str {
        Self::NAMED.iter().find(|(fate, _)| *fate == self).map_or("", |(_, name)| name)
    }

    fn of_name(name: &str) -> Option<Self> {
        Self::NAMED.iter().find(|(_, known)| *known == name).map(|(fate, _)| *fate)
    }
}

/// Inputs that a frame was drawn from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DrawnFrom {
    /// Messages that each link brought before it was drawn.
    pub messages: [u64; PORTS_MAX],
    /// The load under which it was planned.
    pub load: f64,
    /// Exposure of a commanded camera; `None`: by the camera's file and the frame rate.
    pub exposed: Option<Exposed>,
}

/// One row.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameRow {
    /// Frame number.
    pub frame: u32,
    /// Number of its head, from 0.
    pub head: usize,
    /// Inputs that it was drawn from; `None`: nothing was drawn.
    pub drawn: Option<DrawnFrom>,
    /// Degradation of the frame.
    pub degradation: String,
    /// Result of the frame.
    pub fate: CapturedFate,
    /// CRC-32 of the pixels that went out.
    pub crc32: Option<u32>,
}

impl FrameRow {
    /// Writes the row of a run with this many links.
    pub(super) fn write(&self, links: usize, out: &mut dyn Write) -> io::Result<()> {
        write!(out, "{},{},", self.frame, self.head)?;
        if let Some(DrawnFrom { messages, .. }) = &self.drawn {
            for (number, messages) in messages.iter().take(links.max(1)).enumerate() {
                let before = if number == 0 { "" } else { ";" };
                write!(out, "{before}{messages}")?;
            }
        }
        match self.drawn {
            Some(DrawnFrom { load, .. }) => write!(out, ",{:016x},", load.to_bits())?,
            None => out.write_all(b",,")?,
        }
        write!(out, "{},{},", self.degradation, self.fate.name())?;
        if let Some(crc32) = self.crc32 {
            write!(out, "{crc32:08x}")?;
        }
        out.write_all(b",")?;
        if let Some(exposed) = self.drawn.as_ref().and_then(|drawn| drawn.exposed.as_ref()) {
            write_exposed(exposed, out)?;
        }
        writeln!(out)
    }

    /// Reads a row without its line's end.
    ///
    /// # Errors
    /// The error of the first wrong field.
    pub fn parse(text: &str, form: RowForm) -> Result<Self, &'static str> {
        let mut fields: Vec<&str> = text.split(',').collect();
        let wanted = match form {
            RowForm::One => "wanted six fields",
            RowForm::Two => "wanted seven fields",
            RowForm::Three => "wanted eight fields",
        };
        if form == RowForm::One {
            fields.insert(1, "0");
        }
        if form != RowForm::Three {
            fields.push("");
        }
        let [frame, head, messages, load, degradation, fate, crc32, exposed] = fields.as_slice() else {
            return Err(wanted);
        };
        let crc32 = match *crc32 {
            "" => None,
            crc32 => Some(u32::from_str_radix(crc32, 16).map_err(|_| "crc32: wanted 8 hexadecimal digits")?),
        };
        Ok(Self {
            frame: frame.parse().map_err(|_| "frame: wanted a whole number")?,
            head: head.parse().map_err(|_| "head: wanted a whole number")?,
            drawn: drawn(messages, load, exposed)?,
            degradation: (*degradation).into(),
            fate: CapturedFate::of_name(fate).ok_or("fate: wanted sent, late, held or dropped")?,
            crc32,
        })
    }
}

/// Reads the inputs that a frame was drawn from, if it was drawn.
fn drawn(messages: &str, load: &str, exposed: &str) -> Result<Option<DrawnFrom>, &'static str> {
    if (messages, load, exposed) == ("", "", "") {
        return Ok(None);
    }
    let mut of_links = [0; PORTS_MAX];
    for (number, text) in messages.split(';').enumerate() {
        let place = of_links.get_mut(number).ok_or("messages: wanted the numbers of 8 links at most")?;
        *place = text.parse().map_err(|_| "messages: wanted a whole number for each link, such as 120;118")?;
    }
    let load = u64::from_str_radix(load, 16).map_err(|_| "load_bits: wanted 16 hexadecimal digits")?;
    let load = Some(f64::from_bits(load)).filter(|load| load.is_finite()).ok_or("load_bits: wanted a finite number")?;
    Ok(Some(DrawnFrom { messages: of_links, load, exposed: parse_exposed(exposed)? }))
}

/// Sums over the rows of `frames.csv`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RowCounts {
    /// Rows.
    pub rows: u64,
    /// Frames that went out: rows with a checksum.
    pub frames: u64,
    /// Number of the last row's frame; absent without rows.
    pub last_frame: Option<u32>,
}

impl RowCounts {
    /// Counts one more row.
    pub(super) fn add(&mut self, row: &FrameRow) {
        self.rows += 1;
        self.frames += u64::from(row.crc32.is_some());
        self.last_frame = Some(row.frame);
    }
}

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
    pub fn open(path: &Path) -> Result<Self> {
        Self::of(TableLines::open(path, DOING, ROW_MAX)?)
    }
}

impl<R: BufRead> RowReader<R> {
    /// Reads from `source`; errors name `path`.
    ///
    /// # Errors
    /// When its first line is not that of a table of frames.
    pub fn new(source: R, path: &Path) -> Result<Self> {
        Self::of(TableLines::new(source, path, DOING, ROW_MAX))
    }

    fn of(mut lines: TableLines<R>) -> Result<Self> {
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
    pub fn read(&mut self) -> Result<Option<FrameRow>> {
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
    pub(super) fn read(&mut self) -> Result<Option<FrameRow>> {
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

const WANTED: &str = "exposed: wanted start;length;gain;black level;started;trigger;regions, or nothing";

/// Writes the column.
fn write_exposed(exposed: &Exposed, out: &mut dyn Write) -> io::Result<()> {
    let Exposed { start, started, settings } = exposed;
    let (gain, black) = (settings.gain_db.to_bits(), settings.black_level_dn.to_bits());
    write!(out, "{};{};{gain:016x};{black:016x};{};", start.ns(), settings.exposure.ns(), started.name())?;
    match started {
        Started::Rate => {}
        Started::Trigger { at, .. } => write!(out, "{}", at.ns())?,
    }
    out.write_all(b";")?;
    for (number, region) in settings.regions.as_slice().iter().enumerate() {
        let before = if number == 0 { "" } else { "+" };
        let Region { left_px, top_px, width_px, height_px } = region;
        write!(out, "{before}{left_px}:{top_px}:{width_px}:{height_px}")?;
    }
    Ok(())
}

/// Reads the column; `None` when it is empty.
///
/// # Errors
/// The wanted form.
fn parse_exposed(text: &str) -> Result<Option<Exposed>, &'static str> {
    if text.is_empty() {
        return Ok(None);
    }
    let fields: Vec<&str> = text.split(';').collect();
    let [start, length, gain, black, name, trigger, list] = fields.as_slice() else { return Err(WANTED) };
    let ns = |text: &str| text.parse::<i64>().map_err(|_| WANTED);
    let bits = |text: &str| u64::from_str_radix(text, 16).map(f64::from_bits).map_err(|_| WANTED);
    let exposure = Span::from_ns(ns(length)?);
    let (gain_db, black_level_dn) = (bits(gain)?, bits(black)?);
    if exposure <= Span::ZERO || !gain_db.is_finite() || !black_level_dn.is_finite() {
        return Err(WANTED);
    }
    let settings = CameraSettings { exposure, gain_db, black_level_dn, regions: regions(list)? };
    Ok(Some(Exposed { start: Tai::from_ns(ns(start)?), started: started(name, trigger)?, settings }))
}

fn started(name: &str, trigger: &str) -> Result<Started, &'static str> {
    if name == Started::Rate.name() {
        return Ok(Started::Rate);
    }
    let source = TriggerSource::NAMED.iter().find(|(known, _)| *known == name).ok_or(WANTED)?.1;
    Ok(Started::Trigger { source, at: Tai::from_ns(trigger.parse().map_err(|_| WANTED)?) })
}

fn regions(list: &str) -> Result<Regions, &'static str> {
    if list.is_empty() {
        return Ok(Regions::WHOLE);
    }
    let region = |text: &str| {
        let numbers: Result<Vec<u32>, _> = text.split(':').map(str::parse).collect();
        let [left_px, top_px, width_px, height_px] = numbers.ok()?.try_into().ok()?;
        Some(Region { left_px, top_px, width_px, height_px })
    };
    let regions: Option<Vec<Region>> = list.split('+').map(region).collect();
    regions.as_deref().and_then(Regions::of).ok_or(WANTED)
}

#[cfg(test)]
mod exposed_tests {
    use super::*;

    fn text_of(exposed: &Exposed) -> String {
        let mut text = Vec::new();
        write_exposed(exposed, &mut text).unwrap();
        String::from_utf8(text).unwrap()
    }

    #[test]
    fn an_exposure_comes_back_bit_by_bit() {
        let region = Region { left_px: 1, top_px: 2, width_px: 30, height_px: 40 };
        let settings = CameraSettings {
            exposure: Span::from_ns(12_345_678),
            gain_db: 0.1 + 0.2,
            black_level_dn: 64.0,
            regions: Regions::of(&[region, Region { left_px: 100, ..region }]).unwrap(),
        };
        let at = Tai::from_ns(987_654_321);
        for started in [Started::Rate, Started::Trigger { source: TriggerSource::Line, at }] {
            for regions in [settings.regions, Regions::WHOLE] {
                let exposed = Exposed { start: at, started, settings: CameraSettings { regions, ..settings } };
                let text = text_of(&exposed);
                assert_eq!(parse_exposed(&text), Ok(Some(exposed)), "{text}");
                assert_ne!(parse_exposed(&text.replacen("12345678", "12345679", 1)), Ok(Some(exposed)), "control");
            }
        }
        assert_eq!(parse_exposed(""), Ok(None));
    }

    #[test]
    fn damage_is_refused() {
        let good = "1;2;0000000000000000;0000000000000000;bus;3;1:2:3:4";
        assert!(parse_exposed(good).is_ok());
        for (from, to) in
            [("1;2", "1;0"), ("bus", "cat"), (";3;", ";;"), ("3:4", "3"), ("1;2;0", "1;2;x"), ("1;2;", "1;")]
        {
            let bad = good.replacen(from, to, 1);
            assert_eq!(parse_exposed(&bad), Err(WANTED), "{bad}");
        }
    }
}
