//! Observers of a run besides its sinks: capture and live view; the same on both clocks.
//!
//! The capture of a run: its cable, and the inputs that each frame was drawn from.
//!
//! The live view of a run: a page with the newest frame of each head and the run's numbers.

use crate::runtime::{FrameEngine, Head};
use crate::wiring::replay::{Recording, ReplayError, SessionParams};
use crate::wiring::{run_clock::RunClock, run_end::RunEnd};
use anyhow::{Context, Result};
use base::clock::{Clock, Monotonic};
use base::{refused::Refused, time::Tai};
use config::{Bench, Document, Scenario};
use frames::report::Stage;
use frames::sink::{NullSink, Tee};
use link::capture::CaptureFormat;
use outputs::live::{HeadParams, LiveView, Numbers, Params};
use std::{net::SocketAddr, path::PathBuf, sync::Arc};

/// The taps of one run.
pub(super) struct Taps {
    pub(super) recording: Option<Recording>,
    pub(super) live: Option<LiveTap>,
}

impl Taps {
    /// Ends the taps, at `now`; their losses are losses of the run.
    pub(super) fn finish(self, end: &mut RunEnd, now: Tai) {
        if let Some(recording) = self.recording {
            let lost = end.ports.iter().map(|port| port.queue_overflows).sum();
            let missing = match recording.finish(lost) {
                Ok(session) => session.doubts(),
                Err(error) => vec![error.to_string()],
            };
            missing.iter().for_each(|what| end.losses.note_capture(what));
        }
        let Some(live) = self.live else { return };
        // After a failure the last numbers are not published: a failed run must not look like a finished one.
        if end.error.is_none() {
            let frames = end.heads.iter().map(|head| u64::from(head.engine.params.frames)).sum();
            live.numbers().send_last(&end.record.numbers(Some(frames)));
        }
        if !live.finish() {
            end.note_lost_thread("live view", now);
        }
    }
}

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
        let Some(first) = heads.first() else { return Err(Refused("a run without a head".into()).into()) };
        let params = SessionParams {
            document: self.document,
            settings: self.settings,
            scenario,
            start,
            is_real: matches!(clock, RunClock::Real(_)),
            backend: first.engine.drawer.imager.name(),
            adapter: first.engine.drawer.imager.description(),
            cost: first.engine.params.cost,
        };
        let recording = Recording::start(&self.directory, self.format, &params)?;
        for (number, head) in heads.iter_mut().enumerate() {
            let sink = core::mem::replace(&mut head.sink, Box::new(NullSink::new()));
            head.sink = recording.tap_frames(number, &mut head.engine, sink);
        }
        Ok(recording)
    }
}

/// Address of the live view.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LiveOptions {
    /// Address that it listens on; port 0 selects a free one.
    pub address: SocketAddr,
    /// Host names that requests may use, besides addresses and localhost.
    pub names: Vec<String>,
}

/// The live view of a run, in addition to its sinks.
pub(super) struct LiveTap {
    view: LiveView,
    numbers: Numbers,
}

impl LiveTap {
    /// Starts the view and adds it to the sinks of the heads.
    ///
    /// # Errors
    /// When the address cannot be listened on.
    pub(super) fn beside(options: &LiveOptions, bench: &Bench, heads: &mut [Head]) -> Result<Self> {
        // The view shows the time at which a frame came: its clock is the machine's, even for a simulated bench.
        let clock: Arc<dyn Clock> = Arc::new(Monotonic::start());
        let shown = heads.iter().enumerate().map(|(number, head)| head_params(number, &head.engine)).collect();
        let params = Params {
            address: options.address,
            names: options.names.clone(),
            bench: bench.name.clone(),
            stage_limit_ms: stage_limit_ms(bench),
            heads: shown,
        };
        let (view, sinks, numbers) = LiveView::start(params, clock).context("--monitor")?;
        for (head, shown) in heads.iter_mut().zip(sinks) {
            let sink = core::mem::replace(&mut head.sink, Box::new(NullSink::new()));
            head.sink = Box::new(Tee::new(sink, Box::new(shown)));
        }
        Ok(Self { view, numbers })
    }

    /// Returns the destination of the run's numbers.
    pub(super) fn numbers(&self) -> Numbers {
        self.numbers.clone()
    }

    /// Returns its address, and whether other machines can reach it.
    pub(super) fn notes(&self) -> Vec<String> {
        let address = self.view.address();
        let mut notes = vec![format!("live view: http://{address}/")];
        if self.view.is_exposed() {
            notes.push(format!(
                "starloop: the live view at {address} can be reached from other machines, and asks for no password"
            ));
        }
        notes
    }

    /// Ends the view; returns false when its thread ended before the run did.
    pub(super) fn finish(self) -> bool {
        self.view.finish()
    }
}

/// Returns the bench's limits of its stages.
fn stage_limit_ms(bench: &Bench) -> [Option<f64>; Stage::COUNT] {
    let mut limits = [None; Stage::COUNT];
    for (name, ms) in &bench.budget.stage_p99_ms {
        if let Some(stage) = Stage::named(name) {
            limits[stage as usize] = Some(*ms);
        }
    }
    limits
}

fn head_params(number: usize, engine: &FrameEngine) -> HeadParams {
    let run = &engine.params;
    let camera = &run.camera;
    let output = camera.output();
    let half_tangent = |axis: usize| {
        let sensor_px = output.size_px[axis] as f64 * f64::from(output.binning);
        sensor_px * camera.geometry.ifov_rad()[axis] / 2.0
    };
    HeadParams {
        name: format!("head {number}"),
        camera: Arc::clone(&camera.name),
        size_px: output.size_px,
        field_deg: [0, 1].map(|axis| 2.0 * half_tangent(axis).atan().to_degrees()),
        frame_period_s: run.frame_period.s(),
        readout_s: camera.readout_s,
    }
}
