//! Submit times of a run -> `submits.csv`: one line for each frame that was handed to the graphics driver.
//!
//! Times are those of the run's clock. `light_off_ns` says how far from the start of its exposure a frame's light is
//! expected, where the latency is known: for frames that were drawn for a refresh within half a refresh, either way.
//! Written by the sink's thread; a disk that takes no more ends the log, not the display, and what is missing is
//! counted. `starloop display latency` reads that of `starloop display flip` beside the edges that a photodiode saw.
//! Tests below.

use crate::display::error::DisplayError;
use base::time::{Span, Tai};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::{fs::File, io::Write};

/// Name of the file in the directory of a run.
pub const SUBMITS: &str = "submits.csv";

/// One line; the fields are the columns.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct SubmitRow {
    /// Frame number in the run.
    pub frame: u32,
    /// Refreshes since the display was opened.
    pub refresh: u64,
    /// Submit time, UTC, RFC 3339.
    pub submit_utc: String,
    /// Submit time, TAI since 1970-01-01T00:00:00 TAI, ns.
    pub submit_tai_ns: i64,
    /// The refresh before was missed: more than one and a half refresh times passed.
    pub late: bool,
    /// The marker patch is white.
    pub marker_is_white: bool,
    /// Expected light less the start of the exposure, ns; empty: the latency is not known.
    pub light_off_ns: Option<i64>,
}

impl SubmitRow {
    fn new(submitted: &Submitted, latency: Option<Span>) -> Self {
        let Submitted { frame, refresh, submit, wanted_light, is_late, marker_is_white } = *submitted;
        let light = latency.map(|latency| submitted.predicted_light(latency));
        Self {
            frame,
            refresh,
            submit_utc: submit.to_rfc3339(),
            submit_tai_ns: submit.ns(),
            late: is_late,
            marker_is_white,
            light_off_ns: light.zip(wanted_light).map(|(light, wanted)| (light - wanted).ns()),
        }
    }

    /// Returns the submit time, seconds since 1970 as UTC counts them: what other programs of the same machine stamp
    /// with, where the run's clock is the machine's (`starloop display flip`, a bench with `start_utc = "now"`).
    pub fn submit_unix_s(&self) -> f64 {
        Tai::from_ns(self.submit_tai_ns).to_unix_ns() as f64 * 1e-9
    }
}

/// The file while it is written.
pub(super) struct SubmitLog {
    out: csv::Writer<Box<dyn Write + Send>>,
    path: PathBuf,
    latency: Option<Span>,
    failure: Option<String>,
    unwritten: u64,
}

impl core::fmt::Debug for SubmitLog {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("SubmitLog").field("path", &self.path).finish_non_exhaustive()
    }
}

impl SubmitLog {
    /// Returns a new file.
    ///
    /// # Errors
    /// When it is there already, or cannot be made.
    pub(super) fn create(path: &Path, latency: Option<Span>) -> Result<Self, DisplayError> {
        let made = File::create_new(path);
        let file = made.map_err(|error| unwritten(path, &error.to_string()))?;
        Ok(Self::into(Box::new(file), path, latency))
    }

    fn into(out: Box<dyn Write + Send>, path: &Path, latency: Option<Span>) -> Self {
        let out = csv::Writer::from_writer(out);
        Self { out, path: path.into(), latency, failure: None, unwritten: 0 }
    }

    pub(super) fn add(&mut self, submitted: &Submitted) {
        if self.failure.is_none() {
            let written = self.out.serialize(SubmitRow::new(submitted, self.latency));
            self.failure = written.err().map(|error| error.to_string());
        }
        self.unwritten += u64::from(self.failure.is_some());
    }

    /// Returns the submit times that did not get into the file.
    pub(super) fn unwritten(&self) -> u64 {
        self.unwritten
    }

    /// Writes the buffered lines.
    ///
    /// # Errors
    /// The first that was met.
    pub(super) fn finish(&mut self) -> Result<(), DisplayError> {
        let flushed = self.out.flush().map_err(|error| error.to_string());
        let failure = self.failure.take().or(flushed.err());
        failure.map_or(Ok(()), |reason| Err(unwritten(&self.path, &reason)))
    }
}

fn unwritten(path: &Path, reason: &str) -> DisplayError {
    let path = path.display();
    DisplayError::refuse(format!(
        "submit times cannot be written to {path}: {reason}; wanted a new file, and free space"
    ))
}

// When a frame was handed to the graphics driver.

/// One new frame on its way to the screen. Repeats leave none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Submitted {
    /// Number of the frame.
    pub frame: u32,
    /// Refreshes since the display was opened.
    pub refresh: u64,
    /// Time at which the driver took it: the **submit time**. Light leaves the screen one or two refreshes later, plus
    /// what the monitor itself takes.
    pub submit: Tai,
    /// When its light was to begin: the start of its exposure, where it has one.
    pub wanted_light: Option<Tai>,
    /// The refresh came more than one and a half refresh times after the one before.
    pub is_late: bool,
    /// Colour of the marker patch, when there is one: true is white.
    pub marker_is_white: bool,
}

impl Submitted {
    /// Returns when light should leave the screen, by a latency that was measured or given. A prediction.
    pub fn predicted_light(&self, latency: Span) -> Tai {
        self.submit + latency
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn submitted(frame: u32) -> Submitted {
        let submit = Tai::from_ns(1_000 + i64::from(frame));
        let wanted_light = (frame != 2).then_some(Tai::from_ns(1_500));
        Submitted { frame, refresh: 9, submit, wanted_light, is_late: frame == 1, marker_is_white: frame == 0 }
    }

    fn logged(latency: Option<Span>) -> Vec<SubmitRow> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join(SUBMITS);
        let mut log = SubmitLog::create(&path, latency).unwrap();
        (0..3).for_each(|frame| log.add(&submitted(frame)));
        log.finish().unwrap();
        let error = SubmitLog::create(&path, latency).unwrap_err().to_string();
        assert!(error.contains(SUBMITS), "an earlier file is left alone: {error}");
        csv::Reader::from_path(path).unwrap().deserialize().map(Result::unwrap).collect()
    }

    #[test]
    fn each_submit_is_a_line_with_its_expected_light() {
        let rows = logged(Some(Span::from_ns(450)));
        assert_eq!(rows.iter().map(|row| row.light_off_ns).collect::<Vec<_>>(), [Some(-50), Some(-49), None]);
        let reported: Vec<_> = rows.iter().map(|row| (row.frame, row.refresh, row.late, row.marker_is_white)).collect();
        assert_eq!(reported, [(0, 9, false, true), (1, 9, true, false), (2, 9, false, false)]);
        assert_eq!(rows[1].submit_tai_ns, 1_001);
        assert!(logged(None).iter().all(|row| row.light_off_ns.is_none()), "an unknown latency predicts nothing");
    }

    #[test]
    fn unix_seconds_are_those_of_the_utc_text() {
        let submit = Tai::from_rfc3339("2026-03-01T00:00:00.25Z").unwrap();
        let row = SubmitRow::new(&Submitted { submit, ..submitted(0) }, None);
        assert_eq!((row.submit_unix_s(), row.submit_utc.get(..19)), (1_772_323_200.25, Some("2026-03-01T00:00:00")));
    }

    /// A disk without free space.
    struct Full;

    impl Write for Full {
        fn write(&mut self, _: &[u8]) -> std::io::Result<usize> {
            Err(std::io::ErrorKind::StorageFull.into())
        }

        fn flush(&mut self) -> std::io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_full_disk_is_reported_at_the_end_and_what_is_missing_is_counted() {
        let mut log = SubmitLog::into(Box::new(Full), Path::new("run/submits.csv"), None);
        (0..5000).for_each(|frame| log.add(&submitted(frame)));
        assert!(log.unwritten() > 4000, "{}", log.unwritten());
        let error = log.finish().unwrap_err().to_string();
        assert!(error.contains("run/submits.csv") && error.contains("free space"), "{error}");
    }
}
