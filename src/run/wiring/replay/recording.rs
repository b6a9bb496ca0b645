//! A run that is being captured: its session, packets, frames and input from outside.
//!
//! Use it in this order for any run file and clock:
//!
//! 1. [`Recording::start`] when the run file is checked and an engine is made (it names the backend);
//! 2. [`Recording::tap`] around each link of the stimulator, outside of its faults, with the number of the link: 0 for
//!    `[link]`, then those of `[[extra_link]]`; a receiver takes the messages of that link by `accept_from` that number;
//! 3. [`Recording::tap_frames`] around the sink of each head, before its first frame; a tracker's tap may be inside;
//! 4. [`Recording::note_injected`] for each event that was placed during the run, with its time: slots released until
//!    then were drawn before it, later ones after it;
//! 5. [`SampleTap::note`] for each list of samples that a plant in lockstep sent and the run took;
//! 6. [`Recording::finish`] when all sinks are finished and links are closed.
//!
//! Only on the virtual clock it waits for the disk; on the real clock, data that the disk does not take is lost and
//! counted.

use super::{FRAMES_FILE, ReplayError, SESSION_FILE, Session, SessionEnd};
use super::{Result, injected::Injected, row_writer::RowWriter, sample_table::SampleWriter, session::SessionParams};
use crate::runtime::{FrameEngine, PlantSample, frame_marks};
use base::time::{Span, Tai};
use config::{DeadlinePolicy, Event};
use frames::sink::Sink;
use link::{Link, capture::CaptureFormat, tap::Capture};
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::{fs::File, io::BufWriter};

/// Records samples, from any thread.
#[derive(Clone)]
pub struct SampleTap {
    writer: Arc<Mutex<SampleWriter>>,
}

impl SampleTap {
    /// Records samples that the run took at this instant; in lockstep each acts at its own.
    pub fn note(&self, samples: &[PlantSample], arrived: Tai) {
        self.lock().write(samples, arrived);
    }

    fn lock(&self) -> MutexGuard<'_, SampleWriter> {
        self.writer.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A capture in progress.
pub struct Recording {
    directory: PathBuf,
    session: Mutex<Session>,
    capture: Capture,
    rows: RowWriter,
    /// Samples of a plant in lockstep.
    samples: Option<SampleTap>,
}

impl Recording {
    /// Starts a capture in `directory`, which is made if it does not exist.
    ///
    /// # Errors
    /// When the directory holds a capture already, or a file cannot be written.
    pub fn start(directory: &Path, format: CaptureFormat, params: &SessionParams<'_>) -> Result<Self> {
        if directory.exists() && !directory.is_dir() {
            return Err(ReplayError::at(directory, "is a file; wanted a new or empty folder"));
        }
        std::fs::create_dir_all(directory).map_err(ReplayError::file(directory, "make the directory"))?;
        if directory.join(SESSION_FILE).exists() {
            let why = "holds a captured run already; wanted a new or empty folder";
            return Err(ReplayError::at(directory, why));
        }
        let mut session = Session::new(params, format)?;
        session.keep_data(directory)?;
        let bus = directory.join(&session.bus);
        let out = File::create_new(&bus).map_err(ReplayError::file(&bus, "write the packets"))?;
        let (links, waits) = (1 + params.scenario.bench.extra_links.len(), !params.is_real);
        let capture = Capture::start(Box::new(BufWriter::new(out)), format, waits)
            .map_err(|error| ReplayError::at(&bus, error))?;
        let rows = RowWriter::create(&directory.join(FRAMES_FILE), links, waits)?;
        let is_lockstep = params.scenario.bench.is_lockstep();
        let samples = is_lockstep.then(|| SampleWriter::create(directory, params.is_real)).transpose()?;
        let samples = samples.map(|writer| SampleTap { writer: Arc::new(Mutex::new(writer)) });
        session.write(directory)?;
        Ok(Self { directory: directory.into(), session: Mutex::new(session), capture, rows, samples })
    }

    /// Captures the packets of a link of this number.
    pub fn tap(&self, link: Box<dyn Link>, number: usize) -> Box<dyn Link> {
        Box::new(self.capture.tap(link, u8::try_from(number).unwrap_or(u8::MAX)))
    }

    /// Records the frames that `engine` draws for this head and `sink` sends.
    #[must_use]
    pub fn tap_frames(&self, head: usize, engine: &mut FrameEngine, sink: Box<dyn Sink>) -> Box<dyn Sink> {
        let (marks, end) = frame_marks();
        engine.marks = Some(marks);
        let holds = engine.params.deadline_policy == DeadlinePolicy::Hold;
        Box::new(self.rows.sink(head, sink, end, holds))
    }

    /// Records an event that was injected this long after the first exposure.
    pub fn note_injected(&self, event: &Event, came: Span) {
        let mut session = self.session.lock().unwrap_or_else(PoisonError::into_inner);
        session.injected.push(Injected::new(event, came));
        // Written now, because a run may be cut off; a run that ends writes it again, with any error of the disk.
        let _ = session.write(&self.directory);
    }

    /// Returns the recorder for the samples of a plant in lockstep, if the run has one.
    pub fn samples(&self) -> Option<SampleTap> {
        self.samples.clone()
    }

    /// Ends the capture; `messages_lost` were lost inside the run. The returned session lists all losses.
    ///
    /// # Errors
    /// When the session cannot be written.
    pub fn finish(self, messages_lost: u64) -> Result<Session> {
        let (packets, rows) = (self.capture.finish(), self.rows.finish());
        let samples = self.samples.map(|tap| tap.lock().finish());
        let (samples, samples_error) = samples.map_or((None, None), |(count, error)| (Some(count), error));
        let mut session = self.session.into_inner().unwrap_or_else(PoisonError::into_inner);
        session.end = Some(SessionEnd {
            packets: packets.written,
            packets_lost: packets.lost,
            messages_lost,
            rows_lost: rows.lost,
            counted: Some(rows.counts),
            samples,
            error: packets.error.map(|error| error.to_string()).or(rows.error).or(samples_error),
        });
        session.write(&self.directory)?;
        Ok(session)
    }
}
