//! `frames.csv`: one line per recorded frame, with the columns of [`crate::sink::facts`].
//!
//! Times are given twice: UTC text for people and exact integer nanoseconds (spans: nanoseconds only). A line appears
//! whole or not at all: when the disk fills up in the middle of one, the file is cut back to the last whole line.

use crate::sink::SinkError;
use crate::sink::facts::{Column, FactSource, Scalar, TABLE};
use base::refused::Refused;
use serde::{Serialize, Serializer, de::DeserializeOwned};
use std::fs::{File, OpenOptions};
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

/// The file under way.
#[derive(Debug)]
pub struct FrameLog {
    path: PathBuf,
    file: File,
    whole_bytes: u64,
}

impl FrameLog {
    /// Makes a new file.
    ///
    /// # Errors
    /// [`SinkError::Write`] when the file is already there or cannot be made.
    pub fn create(path: PathBuf) -> Result<Self, SinkError> {
        match OpenOptions::new().write(true).create_new(true).open(&path) {
            Ok(file) => Ok(Self { path, file, whole_bytes: 0 }),
            Err(source) => Err(SinkError::Write { path, source }),
        }
    }

    /// Returns a log whose lines cannot be written.
    #[cfg(test)]
    pub(super) fn on_a_full_disk() -> Self {
        let path = PathBuf::from("/dev/full");
        let file = OpenOptions::new().write(true).open(&path).expect("Linux has /dev/full");
        Self { path, file, whole_bytes: 0 }
    }

    /// Appends the line of a frame (and the header before the first); it is with the system when this returns.
    ///
    /// # Errors
    /// [`SinkError::Write`]; the lines before stay whole.
    pub fn append(&mut self, frame: &FactSource<'_>) -> Result<u64, SinkError> {
        let written = self.lines(frame).and_then(|bytes| self.append_bytes(&bytes));
        written.map_err(|source| SinkError::Write { path: self.path.clone(), source })
    }

    /// Waits until the lines are on the disk.
    ///
    /// # Errors
    /// [`SinkError::Write`] when they cannot be brought there.
    pub fn finish(&mut self) -> Result<(), SinkError> {
        self.file.sync_data().map_err(|source| SinkError::Write { path: self.path.clone(), source })
    }

    fn lines(&self, frame: &FactSource<'_>) -> io::Result<Vec<u8>> {
        let mut writer = csv::WriterBuilder::new().has_headers(false).from_writer(Vec::new());
        if self.whole_bytes == 0 {
            writer.write_record(TABLE.iter().flat_map(|row| row.csv).map(|Column(name, _)| name))?;
        }
        writer.serialize(Line(frame))?;
        writer.into_inner().map_err(|e| e.into_error())
    }

    fn append_bytes(&mut self, bytes: &[u8]) -> io::Result<u64> {
        if let Err(error) = self.file.write_all(bytes) {
            // The first error is the one to report; a cut that fails leaves a line that does not parse.
            let _ = cut_back(&mut self.file, self.whole_bytes);
            return Err(error);
        }
        self.whole_bytes += bytes.len() as u64;
        Ok(bytes.len() as u64)
    }
}

/// The columns of one frame.
struct Line<'a>(&'a FactSource<'a>);

impl Serialize for Line<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let cells = TABLE.iter().flat_map(|row| {
            let fact = (row.value)(self.0);
            row.csv.iter().enumerate().map(move |(element, Column(_, form))| Cell(fact.element(element, *form)))
        });
        serializer.collect_seq(cells)
    }
}

/// One of them.
struct Cell<'a>(Scalar<'a>);

impl Serialize for Cell<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match &self.0 {
            Scalar::Absent => serializer.serialize_none(),
            Scalar::Flag(is_so) => serializer.serialize_bool(*is_so),
            Scalar::Whole(number) => serializer.collect_str(number),
            Scalar::Real(number) => serializer.serialize_f64(*number),
            Scalar::Text(text) => serializer.serialize_str(text),
        }
    }
}

fn cut_back(file: &mut File, length: u64) -> io::Result<()> {
    file.set_len(length)?;
    io::Seek::seek(file, io::SeekFrom::Start(length)).map(drop)
}

/// Reads a `frames.csv` back: of each line the columns that a field of `Row` is named after. Units and meaning are those
/// of the table of facts.
///
/// # Errors
/// A refusal with the line that is not as written by [`FrameLog`].
pub fn read_frame_log<Row: DeserializeOwned>(input: impl Read) -> Result<Vec<Row>, SinkError> {
    let bad = |e: csv::Error| {
        let line = e.position().map_or(0, csv::Position::line);
        Refused(format!("frames.csv, line {line}: wanted the columns of FrameRow, got {e}")).into()
    };
    csv::Reader::from_reader(input).into_deserialize().map(|row| row.map_err(bad)).collect()
}

/// Returns the name of the file in a recording.
pub fn path_in(directory: &Path) -> PathBuf {
    directory.join("frames.csv")
}

#[cfg(test)]
pub(in crate::sink) mod tests {
    use super::*;
    use crate::sink::{SentFrame, sample::sample_frame};
    use serde::Deserialize;

    /// One line of `frames.csv`, spelled without the table on purpose.
    #[derive(Debug, Clone, PartialEq, Deserialize)]
    pub(in crate::sink) struct FrameRow {
        pub(in crate::sink) frame: u32,
        pub(in crate::sink) mid_exposure_utc: String,
        pub(in crate::sink) mid_exposure_tai_ns: i64,
        pub(in crate::sink) exposure_s: f64,
        pub(in crate::sink) qw: f64,
        pub(in crate::sink) qx: f64,
        pub(in crate::sink) qy: f64,
        pub(in crate::sink) qz: f64,
        pub(in crate::sink) ra_deg: f64,
        pub(in crate::sink) dec_deg: f64,
        pub(in crate::sink) roll_deg: f64,
        pub(in crate::sink) rate_x_deg_s: f64,
        pub(in crate::sink) rate_y_deg_s: f64,
        pub(in crate::sink) rate_z_deg_s: f64,
        pub(in crate::sink) seed: u64,
        pub(in crate::sink) noise_seed: u64,
        pub(in crate::sink) lateness_ns: i64,
        pub(in crate::sink) attitude_age_ns: i64,
        pub(in crate::sink) horizon_ns: i64,
        pub(in crate::sink) end_horizon_ns: i64,
        pub(in crate::sink) partly_extrapolated: bool,
        pub(in crate::sink) residual_arcsec: f64,
        pub(in crate::sink) jitter_missing_ns: i64,
        pub(in crate::sink) backend: String,
        pub(in crate::sink) method: String,
        #[serde(rename = "rung")] // the published name of the column
        pub(in crate::sink) degradation: String,
        pub(in crate::sink) left_out_stars: usize,
        pub(in crate::sink) left_out_e: f64,
        pub(in crate::sink) occulted_stars: usize,
        pub(in crate::sink) overlap_lost_e: f64,
        pub(in crate::sink) origin: String,
        pub(in crate::sink) faults: String,
        pub(in crate::sink) active_faults: String,
        pub(in crate::sink) camera: String,
        pub(in crate::sink) gain_e_per_dn: f64,
        pub(in crate::sink) black_level_dn: f64,
        pub(in crate::sink) width_px: usize,
        pub(in crate::sink) height_px: usize,
        pub(in crate::sink) stars: usize,
        pub(in crate::sink) pixel_crc32: String,
    }

    impl FrameRow {
        /// The line of a frame.
        pub(in crate::sink) fn new(frame: &SentFrame, pixel_crc32: u32) -> Self {
            let meta = &frame.meta;
            let [qw, qx, qy, qz] = meta.attitude_wxyz;
            let [rate_x_deg_s, rate_y_deg_s, rate_z_deg_s] = meta.rate_deg_s;
            Self {
                frame: meta.number,
                mid_exposure_utc: meta.mid_exposure.to_rfc3339(),
                mid_exposure_tai_ns: meta.mid_exposure.ns(),
                exposure_s: meta.exposure_s,
                qw,
                qx,
                qy,
                qz,
                ra_deg: meta.ra_deg,
                dec_deg: meta.dec_deg,
                roll_deg: meta.roll_deg,
                rate_x_deg_s,
                rate_y_deg_s,
                rate_z_deg_s,
                seed: meta.seed,
                noise_seed: meta.noise_seed,
                lateness_ns: meta.lateness.ns(),
                attitude_age_ns: meta.attitude_age.ns(),
                horizon_ns: meta.horizon.ns(),
                end_horizon_ns: meta.end_horizon.ns(),
                partly_extrapolated: meta.is_partly_extrapolated,
                residual_arcsec: meta.residual_arcsec,
                jitter_missing_ns: meta.jitter_missing.ns(),
                backend: meta.backend.into(),
                method: meta.method.name().into(),
                degradation: meta.degradation.name().into(),
                left_out_stars: meta.left_out_stars,
                left_out_e: meta.left_out_e,
                occulted_stars: meta.occulted_stars,
                overlap_lost_e: meta.overlap_lost_e,
                origin: meta.origin.name().into(),
                faults: meta.faults.to_string(),
                active_faults: meta.active.to_string(),
                camera: meta.camera.to_string(),
                gain_e_per_dn: meta.gain_e_per_dn,
                black_level_dn: meta.black_level_dn,
                width_px: frame.image.width(),
                height_px: frame.image.height(),
                stars: frame.truth.len(),
                pixel_crc32: format!("{pixel_crc32:08x}"),
            }
        }
    }

    #[test]
    fn lines_read_back_exactly() {
        let directory = tempfile::tempdir().unwrap();
        let path = path_in(directory.path());
        let mut log = FrameLog::create(path.clone()).unwrap();
        let rows: Vec<FrameRow> = (0..3).map(|n| FrameRow::new(&sample_frame(n), n)).collect();
        for (i, n) in (0..3).enumerate() {
            log.append(&FactSource::of_frame(&sample_frame(n), Some(n))).unwrap();
            assert_eq!(read_frame_log::<FrameRow>(File::open(&path).unwrap()).unwrap(), rows[..=i], "as it goes");
        }
        assert_ne!(rows[0], rows[1], "the comparison can fail");
        log.finish().unwrap();
    }

    #[test]
    fn a_line_cut_short_is_taken_back() {
        let directory = tempfile::tempdir().unwrap();
        let path = path_in(directory.path());
        let mut log = FrameLog::create(path.clone()).unwrap();
        log.append(&FactSource::of_frame(&sample_frame(1), Some(1))).unwrap();
        let before = std::fs::read(&path).unwrap();
        log.file.write_all(b"2,half a li").unwrap();
        cut_back(&mut log.file, log.whole_bytes).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), before);
        log.append(&FactSource::of_frame(&sample_frame(2), Some(2))).unwrap();
        assert_eq!(read_frame_log::<FrameRow>(File::open(&path).unwrap()).unwrap().len(), 2);
    }

    #[test]
    fn a_damaged_line_is_named() {
        let error = read_frame_log::<FrameRow>("frame,seed\n1,x\n".as_bytes()).unwrap_err().to_string();
        assert!(error.contains("line 2"), "{error}");
    }
}
