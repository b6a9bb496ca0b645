//! Tests sinks on the bench clock: a slow one, a failing one and one that panics cost the run only their own frames.
//!
//! A slow sink is one that waits until the last frame has been drawn: no time is measured.

use crate::bench::{built_in, fly_real_head, start};
use base::clock::{Clock, Monotonic};
use config::Bench;
use crossbeam_channel::{Receiver as Gate, bounded};
use frames::report::MissCause;
use frames::sink::{BranchParams, Fan, NullSink, OnFull, SentFrame, Sink, SinkError, SinkSummary};
use link::{Port, simulated::simulated_pair};
use run::runtime::{EventKind, FrameEngine, Head, RunOutcome};
use run::{runtime::receiver::Receiver, wiring::bench_parts};
use std::sync::Arc;

pub(crate) const FRAMES: u64 = 14;
/// Number of frames by which the slow sink may lag.
const SPACE: usize = 3;

/// Fault of a sink.
pub(crate) enum Trouble {
    /// It is busy with its first frame until the end of the run.
    Slow(Gate<()>),
    /// The disk is full for frames with an odd number.
    Full,
    /// It panics at its third frame.
    Breaks,
}

pub(crate) struct Troubled {
    pub(crate) inner: NullSink,
    pub(crate) trouble: Trouble,
}

impl Sink for Troubled {
    fn name(&self) -> &'static str {
        "troubled"
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        match &self.trouble {
            Trouble::Slow(gate) => drop(gate.recv()),
            Trouble::Full if frame.meta.number % 2 == 1 => {
                return Err(SinkError::Write { path: "full".into(), source: std::io::ErrorKind::StorageFull.into() });
            }
            Trouble::Breaks => assert!(frame.meta.number < 2, "as the test wants it"),
            Trouble::Full => {}
        }
        self.inner.send(frame)
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        self.inner.finish()
    }
}

pub(crate) fn bench() -> Bench {
    let mut bench = built_in(0.1 * FRAMES as f64);
    bench.camera.detector.width_px = 64;
    bench.camera.detector.height_px = 64;
    bench
}

/// Runs on the bench clock without another end of the bus; `at_end` is dropped after the last frame is drawn.
fn run(sink: Box<dyn Sink>, at_end: Option<crossbeam_channel::Sender<()>>) -> RunOutcome {
    let bench = bench();
    let start = start(&bench);
    let params = bench_parts::run_params(&bench, start).unwrap();
    let mut head = Head::new(FrameEngine::new(params.clone()).unwrap(), sink);
    let mut receiver = Receiver::new(params.attitude).unwrap();
    let clock: Arc<dyn Clock> = Arc::new(Monotonic::start_at(start));
    let (bus, format) = bench_parts::bus(&bench);
    let (near, _far) = simulated_pair(bus, &clock);
    let port = Port::new(Box::new(near), format, firmware_protocol::can::IdMap::new(0, 0).unwrap());
    let mut at_end = at_end;
    fly_real_head(&mut head, &mut receiver, port, &clock, &mut |frame, _| {
        if u64::from(frame.meta.number) + 1 == FRAMES {
            at_end = None;
        }
    })
}

/// Returns the faulty sink beside one that keeps up.
fn beside_another(trouble: Trouble) -> Box<dyn Sink> {
    let camera = bench_parts::run_params(&bench(), start(&bench())).unwrap().camera;
    let [width, height] = camera.output().size_px;
    let prototype = SentFrame::with_capacity(width, height, 100, camera.name);
    let troubled = Troubled { inner: NullSink::new(), trouble };
    let sinks: [(&str, Box<dyn Sink>); 2] =
        [("sink", Box::new(troubled)), ("extra_sink[0]", Box::new(NullSink::new()))];
    let branch = |(place, sink): (&str, Box<dyn Sink>)| BranchParams { place: place.into(), sink, buffers: SPACE };
    Box::new(Fan::start(sinks.map(branch), &prototype, OnFull::Drop).unwrap())
}

/// Returns the number of frames passed to the sinks: every slot is accounted for on any machine.
fn handed(outcome: &RunOutcome) -> u64 {
    assert!(outcome.error.is_none(), "{:?}", outcome.error.as_ref().map(ToString::to_string));
    let frames = outcome.record.frames;
    assert_eq!((frames.scheduled, frames.delivered + frames.dropped), (FRAMES, FRAMES), "{frames:?}");
    for line in &outcome.sinks {
        assert_eq!(line.frames + line.dropped + line.refused, frames.delivered, "{line:?}");
    }
    frames.delivered
}

fn sink_busy(outcome: &RunOutcome) -> u64 {
    let reported = outcome.record.ring.misses().get(MissCause::SinkBusy.name()).copied().unwrap_or_default();
    assert_eq!(reported, outcome.record.ledger.count(EventKind::SinkBusy), "in the ledger and in the summary");
    reported
}

#[test]
fn a_slow_sink_loses_its_own_frames_and_no_slot() {
    let (at_end, gate) = bounded(0);
    let outcome = run(beside_another(Trouble::Slow(gate)), Some(at_end));
    let handed = handed(&outcome);
    assert_eq!(sink_busy(&outcome), 0, "no slot was missed because of a sink");
    let [slow, quick] = outcome.sinks.as_slice() else { panic!("two sinks: {:?}", outcome.sinks) };
    // It took as many as its queue holds; after the end of the gate there may have been time for the last ones.
    assert!(slow.dropped >= handed.saturating_sub(SPACE as u64 + 2), "{slow:?}");
    assert_eq!((quick.frames, quick.dropped, quick.refused), (handed, 0, 0));
    assert_eq!(outcome.record.ledger.count(EventKind::SinkDropped), slow.dropped);
    let losses = outcome.losses();
    let [loss] = losses.lines() else { panic!("the quick sink lost nothing: {losses}") };
    assert_eq!((loss.name.as_str(), loss.count), ("sink (troubled)", slow.dropped));
    assert!(!loss.detail.contains("failure"), "slow is not a failure: {losses}");
}

/// Tests that the same sink without its own queue delays slots: this shows that the test above can fail.
#[test]
fn without_a_queue_of_its_own_a_slow_sink_costs_slots() {
    // A machine that is too busy to draw any frame in time misses its slots for lack of time: then the test is
    // repeated.
    let outcome =
        (0..5).map(|_| slow_alone()).find(|outcome| outcome.record.frames.rendered >= 4).expect("drawn in time");
    handed(&outcome);
    assert!(sink_busy(&outcome) > 0, "{:?}", outcome.record.frames);
}

/// Returns a run whose only sink is slow and has no queue.
fn slow_alone() -> RunOutcome {
    let (at_end, gate) = bounded(0);
    let slow = Troubled { inner: NullSink::new(), trouble: Trouble::Slow(gate.clone()) };
    // The last slots are never drawn: another thread opens the gate.
    let open = move || {
        std::thread::sleep(std::time::Duration::from_secs(4));
        drop(at_end);
    };
    let opens = std::thread::Builder::new().name("gate".into()).spawn(open).unwrap();
    let outcome = run(Box::new(slow), None);
    opens.join().unwrap();
    outcome
}

#[test]
fn a_full_disk_is_counted_and_the_run_goes_on() {
    for alone in [true, false] {
        let sink: Box<dyn Sink> = match alone {
            true => Box::new(Troubled { inner: NullSink::new(), trouble: Trouble::Full }),
            false => beside_another(Trouble::Full),
        };
        let outcome = run(sink, None);
        assert!(outcome.error.is_none());
        let line = &outcome.sinks[0];
        assert!(line.refused > 0 && line.frames > 0, "{line:?}");
        assert_eq!(outcome.record.ledger.count(EventKind::SinkRefused), line.refused, "alone: {alone}");
        let losses = outcome.losses().to_string();
        assert!(losses.contains("sink (troubled)") && losses.contains("freeing space"), "{losses}");
        let frames = outcome.record.frames;
        assert_eq!(frames.delivered + frames.dropped, FRAMES, "every slot is accounted for");
        let handed = line.frames + if alone { 0 } else { line.refused };
        assert_eq!(handed, frames.delivered, "alone: {alone}");
    }
}

#[test]
fn failed_sink_is_lost_and_the_run_goes_on() {
    let outcome = run(beside_another(Trouble::Breaks), None);
    let handed = handed(&outcome);
    let [broken, whole] = outcome.sinks.as_slice() else { panic!("two sinks: {:?}", outcome.sinks) };
    assert!(broken.is_lost && broken.frames <= 2, "{broken:?}");
    assert_eq!(whole.frames, handed);
    assert_eq!(outcome.record.ledger.count(EventKind::SinkLost), 1);
    let losses = outcome.losses().to_string();
    assert!(losses.contains("broke down"), "{losses}");
}
