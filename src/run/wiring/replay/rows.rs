//! `frames.csv` of a captured run: a row per frame, written by the sink's side, read by a replay.
//!
//! Columns: frame; messages taken in before it was drawn (all since the run began; empty: nothing was drawn); load, the
//! 64 bits of the number in hexadecimal; rung; fate; CRC-32 of the pixels that went out (empty: none did). A row of fate
//! `held` has the checksum of the frame that went out again in its place.
//!
//! A thread of their own writes the rows: one that blocks is given up, as the writer of a capture's packets is.

use super::{ReplayError, RowCounts};
use crate::runtime::{FrameMark, FrameMarksEnd};
use base::patience::{self, join_or_give_up, put_in_time};
use base::time::Span;
use crossbeam_channel::{Receiver, Sender, bounded};
use frames::sink::crc32::pixel_crc32;
use frames::sink::{FaultFlags, Loss, SentFrame, Sink, SinkError, SinkLine, SinkSummary};
use link::capture::CaptureError;
use std::fs::File;
use std::io::{self, BufRead, BufReader, BufWriter, Read, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;

const HEADER: &str = "frame,messages,load_bits,rung,fate,crc32";
/// Rows between the sink's side and the writer.
const QUEUE_ROWS: usize = 4096;
/// Longest row, bytes.
const ROW_MAX: u64 = 256;

/// What became of a frame.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CapturedFate {
    /// It went out in time.
    Sent,
    /// It went out late.
    Late,
    /// The last one that went out in time went out again in its place.
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

/// One row.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameRow {
    /// Frame number.
    pub frame: u32,
    /// Messages taken in before it was drawn, and the load under which it was planned; `None`: nothing was drawn.
    pub drawn: Option<(u64, f64)>,
    /// How far it was degraded.
    pub rung: String,
    /// What became of it.
    pub fate: CapturedFate,
    /// Of the pixels that went out.
    pub crc32: Option<u32>,
}

impl FrameRow {
    fn write(&self, out: &mut dyn Write) -> io::Result<()> {
        write!(out, "{},", self.frame)?;
        match self.drawn {
            Some((messages, load)) => write!(out, "{messages},{:016x},", load.to_bits())?,
            None => out.write_all(b",,")?,
        }
        write!(out, "{},{},", self.rung, self.fate.name())?;
        match self.crc32 {
            Some(crc32) => writeln!(out, "{crc32:08x}"),
            None => writeln!(out),
        }
    }

    /// Reads a row without its line's end.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn parse(text: &str) -> Result<Self, &'static str> {
        let fields: Vec<&str> = text.split(',').collect();
        let [frame, messages, load, rung, fate, crc32] = fields.as_slice() else { return Err("wanted six fields") };
        let drawn = match (*messages, *load) {
            ("", "") => None,
            (messages, load) => {
                let messages = messages.parse().map_err(|_| "messages: wanted a whole number")?;
                let load = u64::from_str_radix(load, 16).map_err(|_| "load_bits: wanted 16 hexadecimal digits")?;
                Some((messages, f64::from_bits(load)))
            }
        };
        let crc32 = match *crc32 {
            "" => None,
            crc32 => Some(u32::from_str_radix(crc32, 16).map_err(|_| "crc32: wanted 8 hexadecimal digits")?),
        };
        Ok(Self {
            frame: frame.parse().map_err(|_| "frame: wanted a whole number")?,
            drawn,
            rung: (*rung).into(),
            fate: CapturedFate::of_name(fate).ok_or("fate: wanted sent, late, held or dropped")?,
            crc32,
        })
    }
}

/// How writing goes; shared with whoever ends the capture.
#[derive(Debug, Default)]
pub(super) struct RowsState {
    pub(super) lost: u64,
    pub(super) counts: RowCounts,
    pub(super) error: Option<String>,
    /// The writer was given up: what it writes from here on does not count.
    is_given_up: bool,
}

fn lock(state: &Mutex<RowsState>) -> MutexGuard<'_, RowsState> {
    state.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Where rows go, and what becomes of them.
pub(super) struct RowsTo {
    /// What has been written, and why not more.
    pub(super) state: Arc<Mutex<RowsState>>,
    /// Whether frames wait for the writer, on the virtual clock.
    pub(super) waits: bool,
}

/// A sink around a sink: writes a row for each frame that went out or was given up.
pub(super) struct RowSink {
    inner: Box<dyn Sink>,
    marks: FrameMarksEnd,
    /// The oldest mark whose frame has not been seen.
    next: Option<FrameMark>,
    /// `None`: no more rows come, or the writer was given up.
    to_write: Option<Sender<FrameRow>>,
    writer: Option<JoinHandle<()>>,
    /// Rows so far, and frames whose mark was lost.
    offered: u64,
    lost_marks: u64,
    to: RowsTo,
}

impl RowSink {
    /// Begins the file.
    pub(super) fn create(
        path: &Path,
        inner: Box<dyn Sink>,
        marks: FrameMarksEnd,
        to: RowsTo,
    ) -> Result<Self, ReplayError> {
        let refuse = |source| ReplayError::File { path: path.into(), doing: "write the frames", source };
        let mut out = BufWriter::new(File::create_new(path).map_err(refuse)?);
        writeln!(out, "{HEADER}").and_then(|()| out.flush()).map_err(refuse)?;
        Self::start(Box::new(out), inner, marks, to).map_err(refuse)
    }

    /// Starts the writer of a file that has begun.
    fn start(
        mut out: Box<dyn Write + Send>,
        inner: Box<dyn Sink>,
        marks: FrameMarksEnd,
        to: RowsTo,
    ) -> io::Result<Self> {
        let (to_write, rows) = bounded(QUEUE_ROWS);
        let state = Arc::clone(&to.state);
        let thread = std::thread::Builder::new().name("frames.csv".into());
        let writer = Some(thread.spawn(move || write_all(&rows, &mut *out, &state))?);
        Ok(Self { inner, marks, next: None, to_write: Some(to_write), writer, offered: 0, lost_marks: 0, to })
    }

    fn next_mark(&mut self) -> Option<FrameMark> {
        self.next = self.next.take().or_else(|| self.marks.take());
        self.next
    }

    /// Hands a row to the writer. One that cannot be written is lost and counted: the run goes on.
    fn write(&mut self, row: FrameRow) {
        self.offered += 1;
        let Some(to_write) = &self.to_write else { return };
        if !self.to.waits {
            let _ = to_write.try_send(row); // a row that is not written counts as lost
            return;
        }
        if !put_in_time(to_write, row) {
            self.give_up(patience::stall());
        }
    }

    /// Ends the writer, and counts the rows that it has not written; one that blocks is given up.
    fn end_writer(&mut self) {
        self.to_write = None;
        if let Some(writer) = self.writer.take() {
            let joined = join_or_give_up(writer, || lock(&self.to.state).counts.rows);
            if !matches!(joined, Some(Ok(()))) {
                self.give_up(patience::end());
            }
        }
        let mut state = lock(&self.to.state);
        state.lost = self.offered - state.counts.rows;
    }

    /// Leaves the writer behind.
    fn give_up(&mut self, patience: Span) {
        (self.to_write, self.writer) = (None, None);
        let mut state = lock(&self.to.state);
        state.is_given_up = true;
        let error = CaptureError::GivenUp { file: "frames.csv", patience };
        state.error.get_or_insert_with(|| error.to_string());
    }

    /// Rows of frames before `frame` that were drawn and never came.
    fn write_dropped_before(&mut self, frame: u32) {
        while let Some(mark) = self.next_mark().filter(|mark| mark.frame < frame) {
            self.next = None;
            self.write(row(&mark, CapturedFate::Dropped, None));
        }
    }
}

/// The writer's thread: each row is in the file before the next is taken, as a power cut should cost few rows.
fn write_all(rows: &Receiver<FrameRow>, out: &mut dyn Write, state: &Mutex<RowsState>) {
    for row in rows {
        let written = row.write(out).and_then(|()| out.flush());
        let mut state = lock(state);
        if state.is_given_up {
            return;
        }
        if let Err(error) = written {
            state.error = Some(format!("frames.csv: {error}"));
            return;
        }
        state.counts.add(&row);
    }
}

fn row(mark: &FrameMark, fate: CapturedFate, crc32: Option<u32>) -> FrameRow {
    FrameRow { frame: mark.frame, drawn: Some((mark.messages, mark.load)), rung: mark.rung.into(), fate, crc32 }
}

impl Sink for RowSink {
    fn name(&self) -> &'static str {
        self.inner.name()
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        self.inner.send(frame)?;
        let meta = &frame.meta;
        let fate = match meta.lateness > Span::ZERO {
            _ if meta.faults.contains(FaultFlags::FRAME_DUPLICATE) => CapturedFate::Held,
            true => CapturedFate::Late,
            false => CapturedFate::Sent,
        };
        let crc32 = Some(pixel_crc32(&frame.image));
        self.write_dropped_before(meta.number);
        match self.next_mark().filter(|mark| mark.frame == meta.number) {
            Some(mark) => {
                self.next = None;
                self.write(row(&mark, fate, crc32));
            }
            None => {
                let rung = meta.rung.into();
                self.write(FrameRow { frame: meta.number, drawn: None, rung, fate, crc32 });
            }
        }
        Ok(())
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        self.write_dropped_before(u32::MAX);
        self.end_writer();
        self.lost_marks += self.marks.take_lost();
        lock(&self.to.state).lost += self.lost_marks;
        self.inner.finish()
    }

    fn counts(&self) -> Vec<(&'static str, u64)> {
        self.inner.counts()
    }

    fn take_losses(&mut self, tell: &mut dyn FnMut(Loss)) {
        self.inner.take_losses(tell);
    }

    fn lines(&self) -> Vec<SinkLine> {
        self.inner.lines()
    }
}

/// Reads the rows one by one.
pub struct RowReader<R> {
    source: R,
    path: PathBuf,
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
        let mut reader = Self { source, path: path.into(), line: 0, is_cut_off: false };
        match reader.read_line()? {
            Some(text) if text == HEADER => Ok(reader),
            text => Err(reader.refuse("wanted frame,messages,load_bits,rung,fate,crc32", &text.unwrap_or_default())),
        }
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
        FrameRow::parse(&text).map(Some).map_err(|why| self.refuse(why, &text))
    }

    fn read_line(&mut self) -> Result<Option<String>, ReplayError> {
        let mut bytes = Vec::new();
        self.line += 1;
        let read = self.source.by_ref().take(ROW_MAX).read_until(b'\n', &mut bytes);
        read.map_err(|source| ReplayError::File { path: self.path.clone(), doing: "read the frames", source })?;
        let text = String::from_utf8_lossy(&bytes).into_owned();
        match text.strip_suffix('\n') {
            Some(whole) => Ok(Some(whole.trim_end_matches('\r').into())),
            None if bytes.len() as u64 == ROW_MAX => Err(self.refuse("longer than 256 bytes", &text)),
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::runtime::frame_marks;
    use frames::sink::NullSink;
    use frames::sink::sample::sample_frame;

    fn rows(text: &str) -> Result<(Vec<FrameRow>, bool), String> {
        let mut reader = RowReader::new(text.as_bytes(), Path::new("frames.csv")).map_err(|error| error.to_string())?;
        let mut rows = Vec::new();
        while let Some(row) = reader.read().map_err(|error| error.to_string())? {
            rows.push(row);
        }
        Ok((rows, reader.is_cut_off()))
    }

    #[test]
    fn every_frame_has_a_row_that_says_what_became_of_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("frames.csv");
        let (marks, end) = frame_marks();
        let state = Arc::default();
        let to = RowsTo { state: Arc::clone(&state), waits: true };
        let mut sink = RowSink::create(&path, Box::new(NullSink::new()), end, to).unwrap();
        let mark = |frame: u32| FrameMark { frame, messages: 10 * u64::from(frame), load: 1.0 / 3.0, rung: "full" };
        let mut frame = sample_frame(0);
        frame.meta.faults = FaultFlags::NONE;
        let crc32 = pixel_crc32(&frame.image);
        // 0: sent. 1: drawn, and nothing came of it. 2: late. 3: never drawn, held. 4: the run ends before it goes out.
        for (number, lateness_ms, faults) in
            [(0, -1, FaultFlags::NONE), (2, 1, FaultFlags::NONE), (3, 1, FaultFlags::FRAME_DUPLICATE)]
        {
            (number == 2).then(|| marks.put(mark(1)));
            (number != 3).then(|| marks.put(mark(number)));
            frame.meta.number = number;
            frame.meta.lateness = Span::from_ms(lateness_ms);
            frame.meta.faults = faults;
            sink.send(&frame).unwrap();
        }
        marks.put(mark(4));
        sink.finish().unwrap();
        let (rows, is_cut_off) = rows(&std::fs::read_to_string(&path).unwrap()).unwrap();
        let fates: Vec<_> = rows.iter().map(|row| (row.frame, row.fate, row.crc32)).collect();
        use CapturedFate::{Dropped, Held, Late, Sent};
        let went_out = Some(crc32);
        let wanted =
            [(0, Sent, went_out), (1, Dropped, None), (2, Late, went_out), (3, Held, went_out), (4, Dropped, None)];
        assert_eq!(fates, wanted);
        assert_eq!((rows[2].drawn, rows[3].drawn), (Some((20, 1.0 / 3.0)), None), "exact bits");
        assert!(!is_cut_off && state.lock().unwrap().lost == 0);
        let counts = state.lock().unwrap().counts;
        assert_eq!(counts, RowCounts { rows: 5, frames: 3, last_frame: Some(4) });
    }

    /// A disk on which writing never ends.
    struct Hanging(Receiver<()>);

    impl Write for Hanging {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let _ = self.0.recv(); // the test ends it
            Ok(bytes.len())
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn writer_that_blocks_is_given_up_and_its_rows_are_lost() {
        patience::be_short();
        for waits in [true, false] {
            let (_marks, end) = frame_marks();
            let (_never, blocks) = bounded(0);
            let state = Arc::default();
            let to = RowsTo { state: Arc::clone(&state), waits };
            let inner = Box::new(NullSink::new());
            let mut sink = RowSink::start(Box::new(Hanging(blocks)), inner, end, to).unwrap();
            (0..7).for_each(|number| sink.send(&sample_frame(number)).unwrap());
            assert_eq!(sink.finish().unwrap().frames, 7, "the sink has them all");
            assert_eq!(lock(&state).lost, 7);
            let error = lock(&state).error.clone().unwrap();
            assert!(error.starts_with("frames.csv cannot be written") && error.contains("given up"), "{error}");
        }
    }

    #[test]
    fn full_disk_costs_rows_and_not_the_run() {
        struct Full;
        impl Write for Full {
            fn write(&mut self, _bytes: &[u8]) -> io::Result<usize> {
                Err(io::ErrorKind::StorageFull.into())
            }
            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        let (_marks, end) = frame_marks();
        let state = Arc::default();
        let to = RowsTo { state: Arc::clone(&state), waits: true };
        let mut sink = RowSink::start(Box::new(Full), Box::new(NullSink::new()), end, to).unwrap();
        (0..7).for_each(|number| sink.send(&sample_frame(number)).unwrap());
        sink.finish().unwrap();
        assert_eq!(lock(&state).lost, 7);
        assert!(lock(&state).error.as_ref().is_some_and(|error| error.starts_with("frames.csv: ")));
    }

    #[test]
    fn damage_is_refused_with_its_line_and_a_cut_row_is_left_out() {
        let good = format!("{HEADER}\n0,12,3ff0000000000000,full,sent,0a0b0c0d\n");
        assert_eq!(rows(&good).unwrap().0[0].drawn, Some((12, 1.0)));
        assert_eq!(rows(&format!("{good}1,13,3ff")).unwrap(), (rows(&good).unwrap().0, true));
        for (bad, why) in [
            ("1,2,3", "six fields"),
            ("x,2,0,full,sent,0", "frame: "),
            ("1,-2,0,full,sent,0", "messages: "),
            ("1,2,,full,sent,0", "load_bits: "),
            ("1,2,0,full,lost,0", "fate: "),
            ("1,2,0,full,sent,g", "crc32: "),
            (&"9".repeat(300), "longer than 256"),
        ] {
            let error = rows(&format!("{good}{bad}\n")).unwrap_err();
            assert!(error.contains("frames.csv:3: ") && error.contains(why), "{bad}: {error}");
        }
        assert!(rows("frame,x\n").unwrap_err().contains("frames.csv:1: wanted frame,messages"));
    }
}
