//! The loop on the bench clock: receiving threads, this (frame) thread and a sink thread per camera head, bounded
//! queues between them.
//!
//! In: heads (an engine and a sink each), ports. Out: a run's record. In every slot the heads are drawn in turn, each
//! with all cores and its share of the readout time. Every slot leaves a [`FrameRecord`], also those for which nothing
//! is drawn: pushed when its result is decided, completed when its buffer comes back from the sink thread. Limits: work
//! starts at the release and not before; late frames are judged when finished, not when delivered (`[budget]` total is
//! compared with delivery). Tests: `tests/closed_loop/{deadline,budget}.rs`, which assert no wall time.

use crate::runtime::head::{Head, give_commands, show_cameras};
use crate::runtime::ledger::{Event, EventKind};
use crate::runtime::link_thread::{LinkThreads, Received};
use crate::runtime::real_head::{FrameOrder, RealHead, Setting, Shared, Sources, take_back};
use crate::runtime::record::{RunOutcome, RunRecord, lines_of_head};
use crate::runtime::{
    engine::FrameEngine, error::Result, error::RunError, hygiene::Role, port_reading::PortReading, receiver::Receiver,
    reply::Reply, shutter::NextSlot, slot::Slot,
};
use base::time::{Span, Tai};
use core::sync::atomic::{AtomicBool, Ordering};
use crossbeam_channel::Receiver as Queue;
use frames::camera_control::{CameraCommand, CommandSource, Commanded, TriggerSource};
use frames::report::{FrameRecord, Stage};
use frames::sink::SentFrame;
use std::time::Duration;

/// Time within which a sleeping frame thread notices a stop.
const STOP_POLL: Span = Span::from_ms(50);
/// Interval at which the frame thread looks for commands, where clients command a camera or the run.
const DESK_POLL: Span = Span::from_ms(1);
/// Interval at which a slot that waits for jitter samples looks for them.
const JITTER_POLL: Span = Span::from_ms(1);

/// Initial capacity for the stars of a frame: more stars make its buffers grow, once.
pub const STARS_AT_FIRST: usize = 16_384;

/// Runs every slot of the heads until the end, an error, or a stop. The calling thread becomes the frame thread and keeps its settings. Each
/// head has its own slots; heads that are released at the same instant are drawn one after another. `progress` gets the
/// number of the head, and frames before they are damaged; it must not block.
pub fn run_in(
    setting: &Setting<'_>,
    heads: &mut [Head],
    receiver: &mut Receiver,
    sources: Sources,
    progress: &mut dyn FnMut(usize, &SentFrame, &RunRecord),
) -> RunOutcome {
    let mut record = RunRecord::with_ring(setting.ring_frames, heads.len());
    record.limits = setting.limits;
    let dropped = sources.dropped.clone();
    match start(setting, heads, sources) {
        Err(error) => {
            let (ports, summaries, sinks, lost_threads) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
            RunOutcome { record, ports, summaries, sinks, lost_threads, error: Some(error) }
        }
        Ok((heads, link_thread)) => {
            let readings = vec![PortReading::default(); link_thread.readings().count()];
            let shared = Shared {
                clock: &**setting.clock,
                link_thread: &link_thread,
                readings,
                lost_edges: 0,
                line_restarts: 0,
                dropped,
                dropped_noted: 0,
                reply: Reply::default(),
                receiver,
            };
            let mut bench = Bench { heads, shared };
            let mut error = bench.frames(setting, &mut record, progress).err();
            let (mut summaries, mut sinks) = (Vec::new(), Vec::new());
            let heads = bench.heads.len();
            bench.heads.iter_mut().for_each(|head| head.delivery.hang_up());
            for (number, head) in bench.heads.into_iter().enumerate() {
                let delivered = head.delivery.finish(|back| take_back(&mut record, back));
                record.frames.delivered += delivered.frames;
                record.frames.dropped += delivered.refused;
                record.note_losses(&delivered.losses, setting.clock.now());
                summaries.push(delivered.summary);
                sinks.extend(lines_of_head(number, heads, delivered.lines));
                error = delivered.error.or(error);
            }
            let (has_lost_pulses, has_lost_chips) = (link_thread.has_lost_pulses(), link_thread.has_lost_chips());
            let (ports, receiving) = link_thread.finish();
            let (lost_threads, error) = (Vec::new(), receiving.or(error));
            let mut outcome = RunOutcome { record, ports, summaries, sinks, lost_threads, error };
            if has_lost_pulses {
                outcome.note_lost_thread("pps", setting.clock.now());
            }
            if has_lost_chips {
                outcome.note_lost_thread("gpio", setting.clock.now());
            }
            outcome
        }
    }
}

/// Warms up, and starts the threads.
fn start<'a>(
    setting: &Setting<'_>,
    heads: &'a mut [Head],
    sources: Sources,
) -> Result<(Vec<RealHead<'a>>, LinkThreads)> {
    let mut warm = Vec::with_capacity(heads.len());
    for head in heads {
        let camera = &head.engine.params.camera;
        let [width, height] = camera.output().size_px;
        let mut prototype = SentFrame::with_capacity(width, height, STARS_AT_FIRST, camera.name.clone());
        head.engine.warm_up(&mut prototype)?;
        head.engine.pace.follow_load();
        head.engine.scene.stars.read_ahead().map_err(RunError::Scene)?;
        warm.push((head, prototype));
    }
    let Sources { ports, pulses, samples, chips, .. } = sources;
    let link_thread = LinkThreads::start(ports, pulses, samples, chips, setting.clock, setting.hygiene)?;
    let started = warm
        .into_iter()
        .enumerate()
        .map(|(number, (head, prototype))| RealHead::start(number, head, prototype, setting));
    let started = started.collect::<Result<Vec<_>, _>>()?;
    // Last, because new threads inherit the scheduling policy of the thread that starts them.
    if let Some(hygiene) = setting.hygiene {
        hygiene.enter(Role::Frame);
    }
    Ok((started, link_thread))
}

/// The frame thread's own state.
struct Bench<'a> {
    heads: Vec<RealHead<'a>>,
    shared: Shared<'a>,
}

impl Bench<'_> {
    fn frames(
        &mut self,
        setting: &Setting<'_>,
        record: &mut RunRecord,
        progress: &mut dyn FnMut(usize, &SentFrame, &RunRecord),
    ) -> Result<()> {
        while let Some(release) = self.next_release() {
            let mut asked = self.shared.clock.now();
            let forecast = self.forecast();
            self.take_orders(setting.orders, release, record);
            self.poll_desks(record);
            if self.forecast() != forecast {
                continue; // Another release is waited for.
            }
            if !self.listen_until(release, (setting.stop, setting.orders), record) {
                break;
            }
            let mut begun = self.shared.clock.now();
            if self.shared.link_thread.is_finished() {
                break; // its error is reported when the run ends
            }
            if begun < release || self.released(release).next().is_none() {
                continue; // A command has moved it, or a trigger is waited for.
            }
            if !self.await_jitter(release, setting.stop, record) {
                break;
            }
            self.receive(record);
            let received = self.shared.clock.now() - begun;
            let mut is_first = true;
            for head in &mut self.heads {
                let next = head.head.engine.exposing.next().slot().filter(|slot| slot.release == release);
                let Some(slot) = next else { continue };
                head.head.engine.exposing.begin(&mut record.ledger);
                let mut timed =
                    FrameRecord::released(slot.number, [slot.exposure_start, slot.release, slot.due], [asked, begun]);
                timed.head = head.number;
                timed.times.set(Stage::Receive, received);
                record.frames.scheduled += 1;
                if core::mem::take(&mut is_first) {
                    // Recorded once per slot: further heads wait while earlier ones are drawn.
                    record.stages.record(&timed.times);
                }
                head.take_slot(slot, timed, &mut self.shared, record, progress)?;
                // The next head has waited for this one: its time starts now.
                begun = self.shared.clock.now();
                asked = begun;
            }
        }
        Ok(())
    }

    /// Returns the next release of any head, or the end of a wait for triggers; `None` when all heads are over.
    fn next_release(&self) -> Option<Tai> {
        let now = self.shared.clock.now();
        let left = self.heads.iter().map(|head| head.head.engine.exposing.next()).filter(|next| !next.is_over(now));
        let release = |next: NextSlot| match next {
            NextSlot::Slot(slot) => Some(slot.release),
            // Wake up earlier to look for orders and commands.
            NextSlot::Waiting(until) => Some(until.min(now + STOP_POLL)),
            NextSlot::Over => None,
        };
        left.filter_map(release).min()
    }

    /// Accepts commands from clients of the cameras; returns true when the next release has moved.
    fn poll_desks(&mut self, record: &mut RunRecord) -> bool {
        let (before, now) = (self.forecast(), self.shared.clock.now());
        for head in self.heads.iter_mut().filter(|head| head.head.engine.exposing.has_desks()) {
            head.head.engine.exposing.poll(now, &mut record.ledger);
        }
        self.forecast() != before
    }

    /// Returns the earliest known release.
    fn forecast(&self) -> Option<Tai> {
        let slots = self.heads.iter().filter_map(|head| head.head.engine.exposing.next().slot());
        slots.map(|slot| slot.release).min()
    }

    /// Executes orders from outside.
    fn take_orders(&mut self, orders: Option<&Queue<FrameOrder>>, release: Tai, record: &mut RunRecord) {
        for order in orders.into_iter().flat_map(Queue::try_iter) {
            let mut heads: Vec<&mut Head> = self.heads.iter_mut().map(|head| &mut *head.head).collect();
            order(&mut heads, self.shared.receiver, record, release);
        }
    }

    /// Accepts messages and commands as they come, and sleeps in between, until `at`, or until a command has moved the
    /// next release, or an order waits; returns false when the run is to stop.
    fn listen_until(
        &mut self,
        at: Tai,
        (stop, orders): (&AtomicBool, Option<&Queue<FrameOrder>>),
        record: &mut RunRecord,
    ) -> bool {
        let (clock, link_thread, forecast) = (self.shared.clock, self.shared.link_thread, self.forecast());
        while !stop.load(Ordering::Relaxed) {
            let now = clock.now();
            let is_ordered = orders.is_some_and(|orders| !orders.is_empty());
            if now >= at || is_ordered || self.has_desks() && self.poll_desks(record) || self.forecast() != forecast {
                return true;
            }
            let look = if self.has_desks() || orders.is_some() { DESK_POLL } else { STOP_POLL };
            let span = at.min(now + look) - now;
            if let Some(got) = link_thread.wait(Duration::from_nanos(span.ns().unsigned_abs())) {
                self.take_in(&got, record);
            }
        }
        false
    }

    /// Waits for jitter samples of the exposures released at `release` that are under way, while every such head has
    /// time for it; returns false when the run is to stop.
    fn await_jitter(&mut self, release: Tai, stop: &AtomicBool, record: &mut RunRecord) -> bool {
        let limit = |bench: &Self| {
            let waits = bench.released(release).map(|(engine, slot)| engine.jitter_wait(slot, bench.shared.receiver));
            release + waits.min().unwrap_or(Span::ZERO)
        };
        let until = limit(self);
        let lacks = |bench: &Self| {
            bench.released(release).any(|(engine, slot)| engine.lacks_jitter(slot, bench.shared.receiver))
        };
        while lacks(self) {
            let now = self.shared.clock.now();
            if now >= until {
                break;
            }
            if !self.listen_until(until.min(now + JITTER_POLL), (stop, None), record) {
                return false;
            }
        }
        true
    }

    /// Returns the engines with a slot that is released at this instant, and that slot.
    fn released(&self, release: Tai) -> impl Iterator<Item = (&FrameEngine, Slot)> {
        let engines = self.heads.iter().map(|head| &head.head.engine);
        let slots = engines.filter_map(|engine| Some((engine, engine.exposing.next().slot()?)));
        slots.filter(move |(_, slot)| slot.release == release)
    }

    fn has_desks(&self) -> bool {
        self.heads.iter().any(|head| head.head.engine.exposing.has_desks())
    }

    /// Accepts everything that has arrived, without waiting, and updates the state of the ports.
    fn receive(&mut self, record: &mut RunRecord) {
        let link_thread = self.shared.link_thread;
        for got in link_thread.arrived() {
            self.take_in(&got, record);
        }
        let now = self.shared.clock.now();
        self.shared.receiver.session.watch(now, &mut record.ledger);
        for (earlier, reading) in self.shared.readings.iter_mut().zip(link_thread.readings()) {
            reading.announce(earlier, now, &mut record.ledger);
            *earlier = reading;
        }
        record.keep_ports(&self.shared.readings);
        let mut note = |kind, earlier: &mut u64, count: u64| {
            let more = count.saturating_sub(core::mem::replace(earlier, count));
            record.ledger.note_many(Event::new(kind, now, None, Span::ZERO), more);
        };
        note(EventKind::TriggerEdgeLost, &mut self.shared.lost_edges, link_thread.lost_edges());
        note(EventKind::TriggerLineRestarted, &mut self.shared.line_restarts, link_thread.line_restarts());
        note(EventKind::GatewayDropped, &mut self.shared.dropped_noted, self.shared.dropped.total());
    }

    /// Passes an input to the receiver, and camera commands to their heads.
    fn take_in(&mut self, got: &Received, record: &mut RunRecord) {
        let Self { heads, shared: Shared { receiver, link_thread, clock, .. } } = self;
        let ledger = &mut record.ledger;
        match got {
            Received::Pulse(at) => receiver.accept_pulse(*at),
            Received::Sample(sample) => receiver.take_sample(&sample.value, sample.at, ledger),
            Received::Edge { head: for_head, at, is_active } => {
                let command = CameraCommand::Trigger { source: TriggerSource::Line, is_rising: *is_active };
                let commanded = Commanded { command, at: *at, from: CommandSource::Line };
                for head in heads.iter_mut().filter(|head| for_head.is_none_or(|number| number == head.number)) {
                    // A refused command is recorded as an event.
                    let _noted = head.head.engine.exposing.take(&commanded, ledger);
                }
            }
            Received::Message { port, message } => {
                let exposings = heads.iter().map(|head| &head.head.engine.exposing);
                show_cameras(exposings, receiver, &message.value);
                if let Some(answer) = receiver.accept_input(*port, message, ledger) {
                    link_thread.send(*port, answer);
                }
                give_commands(heads, |head| &mut head.head.engine.exposing, receiver, ledger);
                record.count_intake(clock.now() - message.at);
            }
        }
    }
}
