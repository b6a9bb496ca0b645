//! The end record of a captured run, compared with the files beside it before anything is drawn.
//!
//! A table or log that is cut at the end of a line is as readable as a complete one. Therefore the end record in
//! `session.json` states how many packets and rows there were. Input: a session and its directory. Output: nothing, or
//! the first number that differs. A run that was cut off has no end record; captures of earlier versions have no counts
//! of rows. Both are replayed with a note ([`Session::doubts`]). Tests: `tests/closed_loop/replay.rs`.

use super::{FRAMES_FILE, ReplayError, RowCounts, RowReader, Session, SessionEnd, sample_table};
use super::{Result, sample_table::SAMPLES_FILE};
use link::capture::{CaptureError, CaptureReader};
use std::{fs::File, path::Path};

/// Refuses a capture whose content differs from its end record.
///
/// # Errors
/// The first number that differs, or an unreadable file.
pub(super) fn check(directory: &Path, session: &Session) -> Result<()> {
    let Some(end) = &session.end else { return Ok(()) };
    let bus = directory.join(&session.bus);
    compare(end, &bus, "packets", end.packets, count_packets(&bus)?)?;
    if let Some(samples) = end.samples {
        let path = directory.join(SAMPLES_FILE);
        compare(end, &path, "samples", samples, sample_table::count(&path)?)?;
    }
    let Some(wanted) = end.counted else { return Ok(()) };
    let frames = directory.join(FRAMES_FILE);
    let got = count_rows(&frames)?;
    compare(end, &frames, "rows", wanted.rows, got.rows)?;
    compare(end, &frames, "frames that went out", wanted.frames, got.frames)?;
    let number = |last: Option<u32>| last.map_or(0, u64::from);
    compare(end, &frames, "as the last frame's number", number(wanted.last_frame), number(got.last_frame))
}

fn compare(end: &SessionEnd, path: &Path, what: &'static str, wanted: u64, got: u64) -> Result<()> {
    // A disk that filled up may have stored more than was confirmed; the session states this.
    let is_more_than_confirmed = got > wanted && end.error.is_some();
    if got == wanted || is_more_than_confirmed {
        return Ok(());
    }
    let why = format!(
        "holds {got} {what}, wanted {wanted} as its end record (session.json) states: the capture was cut short or changed; \
         wanted the whole directory as the run left it: copy it again"
    );
    Err(ReplayError::at(path, why))
}

fn count_packets(path: &Path) -> Result<u64> {
    let file = File::open(path).map_err(ReplayError::file(path, "read the packets"))?;
    let damaged = |error| ReplayError::at(path, error);
    let mut reader = match CaptureReader::new(file) {
        Err(CaptureError::Empty) => return Ok(0),
        reader => reader.map_err(damaged)?,
    };
    let mut packets = 0;
    while reader.read().map_err(damaged)?.is_some() {
        packets += 1;
    }
    Ok(packets)
}

fn count_rows(path: &Path) -> Result<RowCounts> {
    let mut reader = RowReader::open(path)?;
    let mut counts = RowCounts::default();
    while let Some(row) = reader.read()? {
        counts.add(&row);
    }
    Ok(counts)
}
