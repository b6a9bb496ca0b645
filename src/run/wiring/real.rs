//! A run on the real clock: the far end has its own thread, and frames are late when they are late.
//!
//! In: an assembled run. Out: its results. Faults act as on the virtual clock; frames that a fault delays keep their
//! buffers. Each head has four buffers: a delay beyond three frames loses some, counted. Frames go to the trackers as
//! the sink threads deliver them; a vehicle looks every [`POLL`]. Orders from outside, such as events that are
//! injected, reach the frame thread between two slots and the far end's thread between two steps.
//!
//! Flies an assembled run to its end, on the clock that it has.

use crate::runtime::hygiene::{Hygiene, Role};
use crate::runtime::real_head::{Setting, Sources};
use crate::runtime::{RunError, RunRecord, tracker_in::LOOK};
use crate::runtime::{error::FarEndError, real_time::run_in};
use crate::wiring::error::{LoopError, Result};
use crate::wiring::steering::{FarOrder, Orders};
use crate::wiring::verdict::{Promise, limits};
use crate::wiring::{
    assemble::Run, far_side::FarSide, landing::Landing, replay::Recording, run_clock::RunClock, run_end::RunEnd,
    stepped::SteppedRun,
};
use base::clock::{Clock, Monotonic};
use base::time::Span;
use core::sync::atomic::{AtomicBool, Ordering};
use crossbeam_channel::{Receiver as Queue, bounded};
use frames::sink::{FrameMeta, SentFrame};
use link::gateway::DroppedFrames;
use std::{sync::Arc, thread::JoinHandle};

/// Interval at which the far end's thread looks for frames and orders.
const POLL: Span = Span::from_ms(2);
/// Capacity for frames whose attitude waits to be compared with the truth.
const SEEN_FRAMES: usize = 64;

/// Flies a run to its end, or until `stop` is set.
pub(super) fn fly(
    mut run: Run,
    clock: &Arc<Monotonic>,
    stop: &Arc<AtomicBool>,
    progress: &mut dyn FnMut(usize, &SentFrame, &RunRecord),
) -> Result<RunEnd> {
    let mut far = run.far_side()?;
    let notes = run.place_events(&mut far)?;
    let promise = Promise::of(&run.scenario, &run.heads);
    let Run { scenario, times, heads, receiver, desk, hygiene, taps, cable, steering, .. } = &mut run;
    let (times, recording, hygiene) = (*times, taps.recording.as_ref(), hygiene.as_ref());
    let cable = cable.as_mut().ok_or_else(|| anyhow::anyhow!("a run without a cable"))?;
    let clock: Arc<dyn Clock> = Arc::<Monotonic>::clone(clock);
    let over = Arc::new(AtomicBool::new(false));
    let (seen, queue) = bounded::<(usize, FrameMeta)>(SEEN_FRAMES * heads.len());
    let recorded = recording.and_then(Recording::samples);
    let orders = steering.as_ref().map(|steering| steering.attach(desk, &clock, times, recorded));
    let (frame_orders, far_orders, samples) = match orders {
        Some(Orders { frames, far, samples }) => (Some(frames), Some(far), Some(samples)),
        None => (None, None, None),
    };
    let ends = Ends { over: Arc::clone(&over), stop: Arc::clone(stop) };
    let flight = Flight { far, clock: Arc::clone(&clock), ends, seen: queue.clone(), orders: far_orders };
    let thread = flight.start(hygiene.map(Arc::clone))?;
    let ring_frames = usize::try_from(scenario.bench.budget.ring_frames).unwrap_or(0);
    let (limits, orders) = (limits(scenario), frame_orders.as_ref());
    let setting = Setting { clock: &clock, stop, hygiene, ring_frames, limits, orders };
    let mut seen_and_reported = |head: usize, frame: &SentFrame, record: &RunRecord| {
        let _the_witness_may_be_busy = seen.try_send((head, frame.meta.clone()));
        progress(head, frame, record);
    };
    let (ports, chips) = (core::mem::take(&mut cable.near), core::mem::take(&mut cable.chips));
    let (pulses, dropped) = (cable.pulses.take(), DroppedFrames::of(&cable.gateways));
    let sources = Sources { ports, pulses, samples, chips, dropped };
    let mut outcome = run_in(&setting, heads, receiver, sources, &mut seen_and_reported);
    let (now, was_over) = (clock.now().min(times.end), !stop.load(Ordering::SeqCst));
    over.store(true, Ordering::SeqCst);
    if let Some(steering) = steering {
        steering.detach(times, outcome.record.numbers(None));
        for (event, came) in steering.injected() {
            recording.into_iter().for_each(|tap| tap.note_injected(&event, came));
        }
    }
    let mut error = outcome.error.take().map(LoopError::from);
    let mut far = match joined(thread) {
        Ok(far) => far,
        Err(lost) => {
            error.get_or_insert(lost.into());
            FarSide::new(scenario, None, (Vec::new(), Vec::new()), (times, Vec::new()))?
        }
    };
    notes.into_iter().for_each(|note| outcome.record.ledger.note(note));
    queue_rest(&mut far, &queue);
    let simulated_s = (now - times.zero).s().max(0.0);
    Ok(run.end(Landing { outcome, far, promise, cut_short: None, was_over, now, simulated_s, error }))
}

/// Passes the witness the frames that its thread has not taken.
fn queue_rest(far: &mut FarSide, seen: &Queue<(usize, FrameMeta)>) {
    seen.try_iter().for_each(|(head, meta)| far.witness_frame(head, &meta));
}

/// Links the ends of the run and of the far end's thread: each ends the other.
struct Ends {
    over: Arc<AtomicBool>,
    stop: Arc<AtomicBool>,
}

impl Drop for Ends {
    /// Ends the run when the far end ends before it, by an error or a panic.
    fn drop(&mut self) {
        if !self.over.load(Ordering::SeqCst) {
            self.stop.store(true, Ordering::SeqCst);
        }
    }
}

/// The far end's thread: steps it until the run is over, and returns it with everything it has recorded.
struct Flight {
    far: FarSide,
    clock: Arc<dyn Clock>,
    ends: Ends,
    seen: Queue<(usize, FrameMeta)>,
    orders: Option<Queue<FarOrder>>,
}

type FarThread = JoinHandle<Result<FarSide, FarEndError>>;

impl Flight {
    fn start(self, hygiene: Option<Arc<Hygiene>>) -> Result<FarThread> {
        let flight = move || {
            if let Some(hygiene) = hygiene {
                hygiene.enter(Role::FarEnd);
            }
            self.fly()
        };
        let name = "far end";
        let thread = std::thread::Builder::new().name(name.into()).spawn(flight);
        thread.map_err(|source| RunError::Thread { name, source }.into())
    }

    fn fly(self) -> Result<FarSide, FarEndError> {
        let Self { mut far, clock, ends, seen, orders } = self;
        // Frames and orders come at any time; only a flight computer alone knows when it next has work.
        let looks_often = orders.is_some() || far.vehicle().is_some() || !far.is_simulated() || far.has_trackers();
        let poll = if far.has_trackers() { LOOK } else { POLL };
        while !ends.over.load(Ordering::Relaxed) {
            let now = clock.now();
            orders.iter().flat_map(Queue::try_iter).for_each(|order| order(&mut far));
            let next = far.step(now)?;
            queue_rest(&mut far, &seen);
            clock.sleep_until(if looks_often { next.min(now + poll) } else { next });
        }
        Ok(far)
    }
}

fn joined(thread: FarThread) -> Result<FarSide, RunError> {
    match thread.join() {
        Ok(Ok(far)) => Ok(far),
        Ok(Err(error)) => Err(RunError::FarEnd(error)),
        Err(_panicked) => Err(RunError::ThreadLost { name: "far end" }),
    }
}

impl Run {
    /// Flies the run to its end, or until `stop` is set. `progress` is called after each frame with the number of its
    /// head, and must not block.
    ///
    /// # Errors
    /// When the run cannot start; the result states why a started run ended early.
    pub fn fly(
        self,
        stop: &Arc<AtomicBool>,
        progress: &mut dyn FnMut(usize, &SentFrame, &RunRecord),
    ) -> Result<RunEnd> {
        match self.clock.clone() {
            RunClock::Real(clock) => fly(self, &clock, stop, progress),
            RunClock::Virtual(_) => {
                let mut run = SteppedRun::of(self)?;
                let error = run.run_to_end(&mut |head, frame, record| {
                    progress(head, frame, record);
                    !stop.load(Ordering::Relaxed)
                });
                Ok(run.end(error.err()))
            }
        }
    }
}
