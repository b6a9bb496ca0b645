//! Control of a run on the real clock by an external program: it observes, injects events and triggers, or is the
//! plant.
//!
//! [`Steering`] is made before the run and shared with its clients. The run attaches itself when it starts. Events are
//! checked by the caller's thread, placed by the frame thread between two slots, and reach the far end's thread between
//! two of its steps. Resources of an event (tables of other optics, places of false stars) are made then: a frame that
//! this delays is counted as late. Tests: `tests/closed_loop/control.rs`.

use crate::runtime::ledger::{Event as LedgerEvent, EventKind};
use crate::runtime::{Head, PlantSample, RunError, RunRecord};
use crate::runtime::{real_head::FrameOrder, receiver::Receiver};
use crate::wiring::error::{LoopError, Result};
use crate::wiring::faults::{FaultDesk, lock, make_ready};
use crate::wiring::{control::NewestFrames, far_side::FarSide, replay::SampleTap, run_clock::RunTimes};
use base::clock::{Clock, Stopwatch};
use base::time::{Span, Tai};
use config::{Action, Event};
use core::time::Duration;
use crossbeam_channel::{Receiver as Queue, RecvTimeoutError, Sender, TrySendError, bounded};
use frames::report::RunNumbers;
use frames::sink::{NullSink, SentFrame, Sink, SinkError, SinkSummary, Tee};
use link::Stamped;
use std::sync::{Arc, Mutex};

/// Capacity for orders that wait for the frame thread or the far end.
const ORDERS: usize = 16;
/// Capacity for samples of an external plant that wait for the frame thread: two full requests.
const SAMPLES: usize = 8192;
/// Timeout for an order to be executed.
const DONE_WITHIN: Duration = Duration::from_secs(120);
/// Timeout for a run to be summed up when its frame thread has ended.
const END_WITHIN: Span = Span::from_ms(10_000);

/// A run on the real clock as seen from outside.
#[derive(Clone)]
pub struct Steering {
    attached: Arc<Mutex<Option<Attached>>>,
    newest: Arc<Mutex<NewestFrames>>,
    injected: Arc<Mutex<Vec<(Event, Span)>>>,
    /// Instants and counts of a run that is over.
    last: Arc<Mutex<Option<(RunTimes, RunNumbers)>>>,
}

#[derive(Clone)]
struct Attached {
    desk: Arc<Mutex<FaultDesk>>,
    frames: Sender<FrameOrder>,
    far: Sender<FarOrder>,
    samples: Sender<Stamped<PlantSample>>,
    recorded: Option<SampleTap>,
    clock: Arc<dyn Clock>,
    times: RunTimes,
}

/// An order that the far end's thread executes between two steps.
pub(super) type FarOrder = Box<dyn FnOnce(&mut FarSide) + Send>;

/// Queues by which a run receives orders.
pub(super) struct Orders {
    pub(super) frames: Queue<FrameOrder>,
    pub(super) far: Queue<FarOrder>,
    pub(super) samples: Queue<Stamped<PlantSample>>,
}

/// Returns why a request did not reach a thread of the run.
fn unsent<T>(what: &str, error: &TrySendError<T>) -> LoopError {
    match error {
        TrySendError::Disconnected(_) => over(what),
        TrySendError::Full(_) => LoopError::Parts(anyhow::anyhow!("{what} has a full queue of requests: ask again")),
    }
}

/// Returns why a thread of the run did not answer a request.
fn unanswered(what: &str, error: RecvTimeoutError) -> LoopError {
    match error {
        RecvTimeoutError::Disconnected => over(what),
        RecvTimeoutError::Timeout => {
            LoopError::Parts(anyhow::anyhow!("{what} did not answer within {} s", DONE_WITHIN.as_secs()))
        }
    }
}

fn over(what: &str) -> LoopError {
    LoopError::Parts(anyhow::anyhow!("the run is over: {what} has ended"))
}

impl Steering {
    /// Returns the steering of a run that has not started; frames of its heads are kept in `newest`.
    pub fn new(newest: NewestFrames) -> Self {
        let newest = Arc::new(Mutex::new(newest));
        Self { attached: Arc::default(), newest, injected: Arc::default(), last: Arc::default() }
    }

    /// Adds a sink that keeps the newest frame to each head.
    pub(super) fn watch_frames(&self, heads: &mut [Head]) {
        for (number, head) in heads.iter_mut().enumerate() {
            let sink = core::mem::replace(&mut head.sink, Box::new(NullSink::new()));
            let newest = NewestSink { head: number, newest: Arc::clone(&self.newest) };
            head.sink = Box::new(Tee::new(sink, Box::new(newest)));
        }
    }

    /// Starts the run: returns the queues of orders for its frame thread and far end, and of samples of an external
    /// plant.
    pub(super) fn attach(
        &self,
        desk: &Arc<Mutex<FaultDesk>>,
        clock: &Arc<dyn Clock>,
        times: RunTimes,
        recorded: Option<SampleTap>,
    ) -> Orders {
        let (frames, of_frames) = bounded(ORDERS);
        let (far, of_far) = bounded(ORDERS);
        let (samples, of_plant) = bounded(SAMPLES);
        let (desk, clock) = (Arc::clone(desk), Arc::clone(clock));
        *lock(&self.attached) = Some(Attached { desk, frames, far, samples, recorded, clock, times });
        Orders { frames: of_frames, far: of_far, samples: of_plant }
    }

    /// Records the final instants and counts of a run that is over.
    pub(super) fn detach(&self, times: RunTimes, numbers: RunNumbers) {
        *lock(&self.last) = Some((times, numbers));
        *lock(&self.attached) = None;
    }

    /// Returns the instants and counts of a run that is over.
    pub fn ended(&self) -> Option<(RunTimes, RunNumbers)> {
        *lock(&self.last)
    }

    /// Waits for the end of a run whose frame thread has ended.
    pub(super) fn awaited_end(&self) -> Option<(RunTimes, RunNumbers)> {
        let waited = Stopwatch::start();
        while self.has_begun() && self.ended().is_none() && waited.elapsed() < END_WITHIN {
            std::thread::sleep(Duration::from_millis(5));
        }
        self.ended()
    }

    /// Returns the events that were injected so far, as they were placed, with their times after the first exposure.
    pub(super) fn injected(&self) -> Vec<(Event, Span)> {
        lock(&self.injected).clone()
    }

    /// Returns true when the run has started; it may be over.
    pub fn has_begun(&self) -> bool {
        lock(&self.attached).is_some() || self.ended().is_some()
    }

    fn attached(&self) -> Result<Attached> {
        let none = || LoopError::Parts(anyhow::anyhow!("the run has not begun, or is over"));
        lock(&self.attached).clone().ok_or_else(none)
    }

    /// Returns the run's instants, and the present time of its clock.
    ///
    /// # Errors
    /// When the run has not started, or is over.
    pub fn now(&self) -> Result<(RunTimes, Tai)> {
        self.attached().map(|attached| (attached.times, attached.clock.now()))
    }

    /// Returns a copy of the newest frames; sinks only wait for the time of the copy.
    pub fn newest(&self) -> NewestFrames {
        lock(&self.newest).clone()
    }

    /// Runs a function on the frame thread, before the slot with the release that it gets, and waits for its result.
    ///
    /// # Errors
    /// When the run is over or does not answer.
    pub fn on_frame_thread<T: Send + 'static>(
        &self,
        order: impl FnOnce(&mut [&mut Head], &mut Receiver, &mut RunRecord, Tai) -> T + Send + 'static,
    ) -> Result<T> {
        let (done, answer) = bounded(1);
        let order: FrameOrder = Box::new(move |heads, receiver, record, release| {
            let _ = done.try_send(order(heads, receiver, record, release)); // the client may be gone
        });
        self.attached()?.frames.try_send(order).map_err(|error| unsent("the frame thread", &error))?;
        answer.recv_timeout(DONE_WITHIN).map_err(|error| unanswered("the frame thread", error))
    }

    /// Runs a function on the far end, between two of its steps, and waits for its result.
    pub(super) fn on_far_end<T: Send + 'static>(
        &self,
        order: impl FnOnce(&mut FarSide) -> T + Send + 'static,
    ) -> Result<T> {
        let (done, answer) = bounded(1);
        let order: FarOrder = Box::new(move |far| {
            let _ = done.try_send(order(far)); // the client may be gone
        });
        self.attached()?.far.try_send(order).map_err(|error| unsent("the far end", &error))?;
        answer.recv_timeout(DONE_WITHIN).map_err(|error| unanswered("the far end", error))
    }

    /// Passes samples of an external plant to the frame thread, all or none; each is used by its own instant when it
    /// comes, like one of a link. Returns how many wait.
    ///
    /// # Errors
    /// When the run is over, or too many wait.
    pub fn send_samples(&self, samples: &[PlantSample]) -> Result<usize> {
        let attached = self.attached()?;
        let waiting = attached.samples.len();
        if waiting + samples.len() > SAMPLES {
            let why = format!(
                "{waiting} samples wait for the next frame already; wanted {SAMPLES} at most: send fewer at a time"
            );
            return Err(LoopError::Event { what: "plant", why });
        }
        // Before they are queued: a capture must contain the inputs of a frame.
        let at = attached.clock.now();
        attached.recorded.iter().for_each(|tap| tap.note(samples, at));
        for value in samples {
            let stamped = Stamped { at, value: *value };
            attached.samples.try_send(stamped).map_err(|error| unsent("the frame thread", &error))?;
        }
        Ok(attached.samples.len())
    }

    /// Counts a list of samples that could not be read.
    ///
    /// # Errors
    /// When the run is over or does not answer.
    pub(super) fn note_bad_samples(&self) -> Result<()> {
        let at = self.now()?.1;
        self.on_frame_thread(move |_, _, record, _| {
            record.ledger.note(LedgerEvent::new(EventKind::SampleRefused, at, None, Span::ZERO));
        })
    }

    /// Returns counts and times so far.
    ///
    /// # Errors
    /// When the run is over or does not answer.
    pub fn numbers(&self) -> Result<RunNumbers> {
        self.on_frame_thread(|_, _, record, _| record.numbers(None))
    }

    /// Adds an event; its time counts from the first exposure. An event of the past starts at once.
    ///
    /// # Errors
    /// When it names a head or wheel that does not exist, or the run is over.
    pub fn inject(&self, event: &Event) -> Result<Event> {
        let attached = self.attached()?;
        lock(&attached.desk).check(event)?;
        let (event, desk, clock) = (*event, Arc::clone(&attached.desk), Arc::clone(&attached.clock));
        let (placed, came) = self.on_frame_thread(move |heads, receiver, record, release| {
            // Before the next slot, even when that slot is overdue: a replay places it there again.
            let came = clock.now().min(release - Span::from_ns(1));
            let frames = heads.iter_mut().map(|head| &mut head.faults).collect();
            let placed = lock(&desk).place(&event, came, frames);
            placed.note.into_iter().for_each(|note| record.ledger.note(note));
            make_ready(&event, heads.iter_mut().map(|head| &mut **head), receiver)?;
            Ok::<_, RunError>((placed, came))
        })??;
        let zero = attached.times.zero;
        let event = placed.event;
        lock(&self.injected).push((event, came - zero));
        self.on_far_end(move |far| far.take_event(placed, zero))?;
        Ok(event)
    }

    /// Fires a trigger. The simulated flight computer sends it over the bus; for an external flight computer the
    /// stimulator processes it like a trigger that comes over the bus now.
    ///
    /// # Errors
    /// When the flight computer cannot take it, or the run is over.
    pub fn trigger(&self, number: u16, at: Option<Tai>, is_outside: bool) -> Result<()> {
        let (times, now) = self.now()?;
        if is_outside {
            let at = at.unwrap_or(now).max(now) - times.zero;
            let (on_trigger, lasts) = (None, Span::ZERO);
            return self.inject(&Event { at, on_trigger, lasts, action: Action::Trigger { number } }).map(drop);
        }
        self.on_far_end(move |far| far.send_trigger(number, at, now))?
    }
}

/// Keeps the newest frame of one head; runs on the head's sink thread.
struct NewestSink {
    head: usize,
    newest: Arc<Mutex<NewestFrames>>,
}

impl Sink for NewestSink {
    fn name(&self) -> &'static str {
        "newest frame"
    }

    fn send(&mut self, frame: &SentFrame) -> Result<(), SinkError> {
        lock(&self.newest).keep(self.head, frame);
        Ok(())
    }

    fn finish(&mut self) -> Result<SinkSummary, SinkError> {
        NullSink::new().finish()
    }
}
