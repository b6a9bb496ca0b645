//! A run as one SER file, which planetary-imaging programs (Siril, PIPP, SER Player) call a sequence.
//!
//! Input: frames of one size, 16 bits a pixel. Output: a header of 178 bytes, the frames one after the other, and, when
//! the file is finished, a trailer with the UTC of each frame's mid-exposure. Source: *SER format description version
//! 3* (H. Wilkens, 2014). Numbers are little-endian. Times are ticks of 100 ns since 0001-01-01T00:00:00, rounded down;
//! "local" time is UTC as well.
//!
//! *The field for the byte order.* The description says 1 for little-endian pixels; the first programs wrote 0 for
//! them, and the programs in use read it so. Here 0 is written, and pixels are little-endian.
//!
//! *Unfinished files.* The count in the header is brought up to date after each frame, over
//! bytes that are there already: a program that is killed leaves a file whose count is true, without a trailer (which
//! the format allows); `frames.csv` beside it has the times. On a full disk the file is cut back to its last whole
//! frame, and the next frame is tried again.
//!
//! Limits: 2^31 - 1 frames and pixels a side; 8 bytes of memory a frame, for the trailer. Tests: below, and
//! `hil_scripts/tests/test_recorders.py` with a reader of its own and with Siril.

use crate::sink::{SentFrame, SinkError};
use base::{bayer::BayerPattern, time::Tai};
use std::fs::{File, OpenOptions};
use std::io::{self, Seek, SeekFrom, Write};
use std::path::PathBuf;

/// Bytes before the first frame.
pub const HEADER_BYTES: u64 = 178;
/// Place of the number of frames in the header.
const FRAME_COUNT_AT: u64 = 38;
/// 1970-01-01 in days since 0001-01-01, both Gregorian.
const UNIX_EPOCH_D: i64 = 719_162;
const TICKS_PER_S: i64 = 10_000_000;

/// A SER file under way.
#[derive(Debug)]
pub struct SerFile {
    path: PathBuf,
    file: File,
    /// Columns and rows; `None` before the first frame.
    size_px: Option<[usize; 2]>,
    times: Vec<i64>,
    /// One frame as bytes.
    bytes: Vec<u8>,
}

impl SerFile {
    /// Makes a new file, without a byte in it.
    ///
    /// # Errors
    /// [`SinkError::Write`] when it is already there or cannot be made.
    pub fn create(path: PathBuf) -> Result<Self, SinkError> {
        match OpenOptions::new().write(true).create_new(true).open(&path) {
            Ok(file) => Ok(Self { path, file, size_px: None, times: Vec::new(), bytes: Vec::new() }),
            Err(source) => Err(SinkError::Write { path, source }),
        }
    }

    /// Returns frames in it.
    pub fn frames(&self) -> usize {
        self.times.len()
    }

    /// Adds a frame; the system has it, and the header counts it, when this returns. Gives the bytes that were added.
    ///
    /// # Errors
    /// [`SinkError::Write`], with the file as it was before; [`SinkError::FrameSize`] for a frame of another size.
    pub fn append(&mut self, frame: &SentFrame) -> Result<u64, SinkError> {
        let got = [frame.image.width(), frame.image.height()];
        let wanted = self.size_px.unwrap_or(got);
        if got != wanted {
            return Err(SinkError::FrameSize { path: self.path.clone(), wanted, got });
        }
        let written = self.write_frame(frame).inspect_err(|_| self.cut_back());
        written.map_err(|source| self.failed(source))
    }

    /// Takes the last frame out again.
    pub fn take_back(&mut self) {
        if self.times.pop().is_some() {
            self.cut_back();
        }
    }

    /// Writes the trailer, and waits until all is on the disk. May be called again.
    ///
    /// # Errors
    /// [`SinkError::Write`]: the frames and their count stay as they are, without a trailer.
    pub fn finish(&mut self) -> Result<u64, SinkError> {
        let written = self.write_trailer().inspect_err(|_| self.cut_back());
        written.map_err(|source| self.failed(source))
    }

    fn failed(&self, source: io::Error) -> SinkError {
        SinkError::Write { path: self.path.clone(), source }
    }

    fn write_frame(&mut self, frame: &SentFrame) -> io::Result<u64> {
        let count = i32::try_from(self.times.len() + 1).map_err(|_| io::ErrorKind::FileTooLarge)?;
        let mut added = 0;
        if self.size_px.is_none() {
            let header = header(frame)?;
            self.file.seek(SeekFrom::Start(0))?;
            self.file.write_all(&header)?;
            self.size_px = Some([frame.image.width(), frame.image.height()]);
            added += HEADER_BYTES;
        }
        self.bytes.clear();
        self.bytes.extend(frame.image.pixels().iter().flat_map(|pixel| pixel.to_le_bytes()));
        self.file.seek(SeekFrom::Start(self.end_of_frames()))?;
        self.file.write_all(&self.bytes)?;
        self.write_count(count)?;
        self.times.push(ticks(frame.meta.mid_exposure));
        Ok(added + self.bytes.len() as u64)
    }

    fn write_count(&mut self, count: i32) -> io::Result<()> {
        self.file.seek(SeekFrom::Start(FRAME_COUNT_AT))?;
        self.file.write_all(&count.to_le_bytes())
    }

    fn write_trailer(&mut self) -> io::Result<u64> {
        let trailer: Vec<u8> = self.times.iter().flat_map(|time| time.to_le_bytes()).collect();
        self.file.seek(SeekFrom::Start(self.end_of_frames()))?;
        self.file.write_all(&trailer)?;
        self.file.sync_data()?;
        Ok(trailer.len() as u64)
    }

    fn end_of_frames(&self) -> u64 {
        let frame_bytes = self.size_px.map_or(0, |[width, height]| 2 * (width * height) as u64);
        let header_bytes = if self.size_px.is_some() { HEADER_BYTES } else { 0 };
        header_bytes + self.times.len() as u64 * frame_bytes
    }

    /// Cuts the file back to its whole frames.
    fn cut_back(&mut self) {
        if self.times.is_empty() {
            self.size_px = None;
        }
        let count = i32::try_from(self.times.len()).unwrap_or(i32::MAX);
        let cut = self.file.set_len(self.end_of_frames());
        // The error that led here is the one to report; a count that is too high by one is the worst that can stay.
        let _ = cut.and_then(|()| if count > 0 { self.write_count(count) } else { Ok(()) });
    }
}

/// Ticks of 100 ns since year 1, UTC.
fn ticks(at: Tai) -> i64 {
    at.to_unix_ns().div_euclid(100) + UNIX_EPOCH_D * 86_400 * TICKS_PER_S
}

/// Pixels without colours.
const MONO: i32 = 0;

/// Returns the number that the format has for the colours of pixels.
const fn color_id(pattern: BayerPattern) -> i32 {
    match pattern {
        BayerPattern::Rggb => 8,
        BayerPattern::Grbg => 9,
        BayerPattern::Gbrg => 10,
        BayerPattern::Bggr => 11,
    }
}

/// Returns the header of a file without frames.
fn header(first: &SentFrame) -> io::Result<Vec<u8>> {
    let side = |px: usize| i32::try_from(px).map_err(|_| io::Error::from(io::ErrorKind::FileTooLarge));
    let (little_endian, depth, frames) = (0, 16, 0);
    let colours = first.meta.facts.as_ref().and_then(|facts| facts.colours).map_or(MONO, color_id);
    let mut bytes = b"LUCAM-RECORDER".to_vec();
    let numbers =
        [0, colours, little_endian, side(first.image.width())?, side(first.image.height())?, depth, frames].into_iter();
    bytes.extend(numbers.flat_map(i32::to_le_bytes));
    for text in ["starloop", &*first.meta.camera, "simulated sky"] {
        bytes.extend(text_field(text));
    }
    let start = ticks(first.meta.mid_exposure).to_le_bytes();
    bytes.extend(start.iter().chain(&start));
    Ok(bytes)
}

/// Returns 40 bytes of ASCII, filled up with zeros.
fn text_field(text: &str) -> [u8; 40] {
    let mut field = [0; 40];
    let ascii = text.chars().map(|c| if c.is_ascii_graphic() || c == ' ' { c as u8 } else { b'?' });
    field.iter_mut().zip(ascii).for_each(|(place, byte)| *place = byte);
    field
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sink::sample::sample_frame;
    use std::{fs, path::Path};

    const FRAME_BYTES: usize = 2 * 31 * 17;

    fn number(bytes: &[u8], at: usize) -> i32 {
        i32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
    }

    fn time(bytes: &[u8], at: usize) -> i64 {
        i64::from_le_bytes(bytes[at..at + 8].try_into().unwrap())
    }

    /// Returns a file with so many frames, not finished.
    fn begun(directory: &Path, frames: u32) -> (SerFile, PathBuf) {
        let path = directory.join("frames.ser");
        let mut ser = SerFile::create(path.clone()).unwrap();
        for number in 0..frames {
            ser.append(&sample_frame(number)).unwrap();
        }
        (ser, path)
    }

    #[test]
    fn header_frames_and_trailer_lie_where_the_format_wants_them() {
        let directory = tempfile::tempdir().unwrap();
        let (mut ser, path) = begun(directory.path(), 3);
        ser.finish().unwrap();
        let bytes = fs::read(path).unwrap();
        assert_eq!(bytes.len(), 178 + 3 * FRAME_BYTES + 3 * 8);
        assert_eq!(&bytes[..14], b"LUCAM-RECORDER");
        let numbers: Vec<i32> = (0..7).map(|i| number(&bytes, 14 + 4 * i)).collect();
        assert_eq!(numbers, [0, 10, 0, 31, 17, 16, 3], "Lu id, GBRG, little, columns, rows, bits, frames");
        assert_eq!(&bytes[82..98], b"test camera, \"A\"");
        for frame in 0..3_usize {
            let sent = sample_frame(frame as u32);
            let at = 178 + frame * FRAME_BYTES;
            let pixels = bytes[at..at + FRAME_BYTES].chunks(2).map(|two| u16::from_le_bytes([two[0], two[1]]));
            assert!(pixels.eq(sent.image.pixels().iter().copied()), "frame {frame}");
            // 100 ms between frames, of ticks of 100 ns.
            let trailer = 178 + 3 * FRAME_BYTES;
            assert_eq!(time(&bytes, trailer + 8 * frame) - time(&bytes, trailer), 1_000_000 * frame as i64);
        }
        assert_eq!(time(&bytes, 162), time(&bytes, 178 + 3 * FRAME_BYTES), "UTC of the first frame");
    }

    #[test]
    fn ticks_are_those_of_a_known_date() {
        // .NET: new DateTime(2000, 1, 1).Ticks
        let at = Tai::from_rfc3339("2000-01-01T00:00:00Z").unwrap();
        assert_eq!(ticks(at), 630_822_816_000_000_000);
        assert_eq!(ticks(Tai::from_ns(at.ns() + 199)), 630_822_816_000_000_001, "rounded down");
    }

    #[test]
    fn the_count_is_true_after_each_frame_without_an_end() {
        let directory = tempfile::tempdir().unwrap();
        let (mut ser, path) = begun(directory.path(), 0);
        for frame in 0..4 {
            ser.append(&sample_frame(frame)).unwrap();
            let bytes = fs::read(&path).unwrap();
            assert_eq!(number(&bytes, 38), frame as i32 + 1);
            assert_eq!(bytes.len(), 178 + (frame as usize + 1) * FRAME_BYTES);
        }
    }

    #[test]
    fn a_frame_taken_back_or_cut_short_leaves_those_before() {
        let directory = tempfile::tempdir().unwrap();
        let (mut ser, path) = begun(directory.path(), 2);
        let before = fs::read(&path).unwrap();
        ser.append(&sample_frame(2)).unwrap();
        assert_ne!(fs::read(&path).unwrap(), before, "the comparison can fail");
        ser.take_back();
        assert_eq!(fs::read(&path).unwrap(), before);
        ser.file.seek(SeekFrom::End(0)).unwrap();
        ser.file.write_all(&[7; 100]).unwrap();
        ser.cut_back();
        assert_eq!(fs::read(&path).unwrap(), before, "half a frame");
        (0..3).for_each(|_| ser.take_back());
        assert_eq!(fs::read(&path).unwrap(), [0; 0], "none left");
        ser.append(&sample_frame(5)).unwrap();
        assert_eq!((ser.frames(), number(&fs::read(&path).unwrap(), 38)), (1, 1));
    }

    #[test]
    fn another_size_is_refused_and_an_old_file_is_not_touched() {
        let directory = tempfile::tempdir().unwrap();
        let (mut ser, path) = begun(directory.path(), 1);
        let small = SentFrame::with_capacity(8, 8, 0, "small".into());
        let error = ser.append(&small).unwrap_err();
        assert!(matches!(error, SinkError::FrameSize { wanted: [31, 17], got: [8, 8], .. }), "{error}");
        let bytes = fs::read(&path).unwrap();
        assert!(matches!(SerFile::create(path.clone()), Err(SinkError::Write { .. })));
        assert_eq!(fs::read(&path).unwrap(), bytes);
    }

    /// Tests a file that may not grow (a limit of the process would kill it): the device that is always full.
    #[test]
    fn a_full_disk_is_an_error_each_time() {
        let full = || OpenOptions::new().write(true).open("/dev/full").unwrap();
        let mut ser = SerFile { path: "full.ser".into(), file: full(), size_px: None, times: vec![], bytes: vec![] };
        for _ in 0..2 {
            let error = ser.append(&sample_frame(1)).unwrap_err();
            let is_full =
                matches!(&error, SinkError::Write { source, .. } if source.kind() == io::ErrorKind::StorageFull);
            assert!(is_full && ser.frames() == 0 && ser.size_px.is_none(), "{error}");
        }
    }
}
