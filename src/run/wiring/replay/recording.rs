//! A run that is being captured: its session, its packets, its frames.

use super::rows::{RowSink, RowsState, RowsTo};
use super::session::SessionParams;
use super::{FRAMES_FILE, ReplayError, SESSION_FILE, Session, SessionEnd};
use crate::runtime::{FrameEngine, frame_marks};
use frames::sink::Sink;
use link::Link;
use link::capture::CaptureFormat;
use link::tap::Capture;
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

/// A capture under way.
pub struct Recording {
    directory: PathBuf,
    session: Session,
    capture: Capture,
    rows: Arc<Mutex<RowsState>>,
    /// Whether the run waits for files, on the virtual clock.
    waits: bool,
}

impl Recording {
    /// Begins a capture in `directory`, which is made when it is not there.
    ///
    /// # Errors
    /// When the directory holds a capture already, or a file cannot be written.
    pub fn start(directory: &Path, format: CaptureFormat, params: &SessionParams<'_>) -> Result<Self, ReplayError> {
        let refuse = |path: &Path, doing| {
            let path = path.to_path_buf();
            move |source| ReplayError::File { path, doing, source }
        };
        std::fs::create_dir_all(directory).map_err(refuse(directory, "make the directory"))?;
        if directory.join(SESSION_FILE).exists() {
            return Err(ReplayError::Occupied { path: directory.into() });
        }
        let session = Session::new(params, format)?;
        let bus = directory.join(&session.bus);
        let out = File::create_new(&bus).map_err(refuse(&bus, "write the packets"))?;
        let waits = !params.is_real;
        let capture = Capture::start(Box::new(BufWriter::new(out)), format, waits)
            .map_err(|source| ReplayError::Capture { path: bus, source })?;
        session.write(directory)?;
        Ok(Self { directory: directory.into(), session, capture, rows: Arc::default(), waits })
    }

    /// Captures what passes a link.
    #[must_use]
    pub fn tap(&self, link: Box<dyn Link>, _number: usize) -> Box<dyn Link> {
        Box::new(self.capture.tap(link))
    }

    /// Writes down the frames that `engine` draws and `sink` sends.
    ///
    /// # Errors
    /// When the file cannot be written.
    pub fn tap_frames(
        &self,
        _head: usize,
        engine: &mut FrameEngine,
        sink: Box<dyn Sink>,
    ) -> Result<Box<dyn Sink>, ReplayError> {
        let (marks, end) = frame_marks();
        engine.mark_frames(marks);
        let path = self.directory.join(FRAMES_FILE);
        let to = RowsTo { state: Arc::clone(&self.rows), waits: self.waits };
        Ok(Box::new(RowSink::create(&path, sink, end, to)?))
    }

    /// Notes an event that was injected while the run goes on.
    pub fn note_injected(&self, _event: &config::Event) {}

    /// Ends the capture; `messages_lost` were lost inside the run. What was lost is in the session that comes back.
    ///
    /// # Errors
    /// When the session cannot be written.
    pub fn finish(self, messages_lost: u64) -> Result<Session, ReplayError> {
        let outcome = self.capture.finish();
        let rows = self.rows.lock().unwrap_or_else(PoisonError::into_inner);
        let packets = outcome.error.map(|error| error.to_string());
        let mut session = self.session;
        session.end = Some(SessionEnd {
            packets: outcome.written,
            packets_lost: outcome.lost,
            messages_lost,
            rows_lost: rows.lost,
            counted: Some(rows.counts),
            error: packets.or_else(|| rows.error.clone()),
        });
        session.write(&self.directory)?;
        Ok(session)
    }
}
