//! The capture of a run: its cable, and the inputs that each frame was drawn from.

use crate::wiring::replay::{Recording, ReplayError, SessionParams};
use crate::{runtime::Head, wiring::run_clock::RunClock};
use base::time::Tai;
use config::{Document, Scenario};
use frames::sink::NullSink;
use link::capture::CaptureFormat;
use std::path::PathBuf;

/// Content and destination of a capture.
#[derive(Debug, Clone)]
pub struct CaptureOptions<'a> {
    /// Directory of the capture; it must not contain one, and is made if it does not exist.
    pub directory: PathBuf,
    /// Form of the packets.
    pub format: CaptureFormat,
    /// The run's file, with the values that the command line sets.
    pub document: &'a Document,
    /// Those values, as given.
    pub settings: &'a [String],
}

impl CaptureOptions<'_> {
    /// Starts the capture around the sinks of the heads.
    pub(super) fn start(
        &self,
        scenario: &Scenario,
        start: Tai,
        clock: &RunClock,
        heads: &mut [Head],
    ) -> Result<Recording, ReplayError> {
        let Some(first) = heads.first() else { return Err(ReplayError::Parts("a run without a head".into())) };
        let params = SessionParams {
            document: self.document,
            settings: self.settings,
            scenario,
            start,
            is_real: matches!(clock, RunClock::Real(_)),
            backend: first.engine.imager().name(),
            adapter: first.engine.imager().description(),
            cost: first.engine.params().cost,
        };
        let recording = Recording::start(&self.directory, self.format, &params)?;
        for (number, head) in heads.iter_mut().enumerate() {
            let sink = core::mem::replace(&mut head.sink, Box::new(NullSink::new()));
            head.sink = recording.tap_frames(number, &mut head.engine, sink);
        }
        Ok(recording)
    }
}
