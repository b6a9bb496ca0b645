//! The loop on the bench clock: a receiving thread, this (frame) thread and a sink thread, bounded queues between them.
//!
//! In: an engine, a port, a sink. Out: a run's record. Every slot leaves a [`FrameRecord`], also those for which nothing is
//! drawn: pushed when its fate is decided, completed when its buffer comes back from the sink thread. Limits: work begins
//! at the release and not before; late frames are judged when finished, not when delivered (`[budget]` total is held
//! against delivery). Tests: `tests/closed_loop/{deadline,budget}.rs`, which assert no wall time.

use crate::attitude::PathOrigin;
use crate::base::clock::Clock;
use crate::base::time::{Span, Tai};
use crate::link::Port;
use crate::link::pps::Pps;
use crate::report::{Fate, FrameRecord, MissCause, Stage, StageTimes};
use crate::runtime::delivery::{Delivery, Parcel};
use crate::runtime::engine::{FrameEngine, Slot, origin_name};
use crate::runtime::error::RunError;
use crate::runtime::frame_faults::{Fate as Spoiling, FrameFaults};
use crate::runtime::hygiene::{Hygiene, Role};
use crate::runtime::ledger::EventKind;
use crate::runtime::outcome::RunOutcome;
use crate::runtime::params::DeadlinePolicy;
use crate::runtime::port_reading::PortReading;
use crate::runtime::radio::{Heard, Radio};
use crate::runtime::receiver::Receiver;
use crate::runtime::record::RunRecord;
use crate::runtime::reply::{Reply, ToldFrame};
use crate::sink::{FaultFlags, FrameMeta, SentFrame, Sink};
use core::sync::atomic::{AtomicBool, Ordering};
use std::sync::Arc;
use std::time::Duration;

/// A sleeping frame thread notices a stop within this.
const STOP_POLL: Span = Span::from_ms(50);

/// Stars that a frame has room for at the start: more make its buffers grow, once.
pub const STARS_AT_FIRST: usize = 16_384;

/// What a run on the bench clock runs in.
pub struct Setting<'a> {
    /// The bench clock.
    pub clock: &'a Arc<dyn Clock>,
    /// Set by whoever wants the run to end.
    pub stop: &'a Arc<AtomicBool>,
    /// What threads ask of the system; `None`: nothing.
    pub hygiene: Option<&'a Arc<Hygiene>>,
    /// Frames whose times are kept one by one.
    pub ring_frames: usize,
}

/// Where a run on the bench clock hears the flight computer.
pub struct Sources {
    /// The bench's ports; the first one is told of the frames.
    pub ports: Vec<Port>,
    /// Pulses of the flight computer's clock.
    pub pulses: Option<Pps>,
}

impl From<Port> for Sources {
    fn from(port: Port) -> Self {
        Self { ports: vec![port], pulses: None }
    }
}

/// Runs every slot of the engine until the end, an error, or `stop`. `progress` is called after each frame and must
/// not block.
pub fn run(
    engine: &mut FrameEngine,
    receiver: &mut Receiver,
    port: Port,
    clock: &Arc<dyn Clock>,
    sink: Box<dyn Sink>,
    stop: &Arc<AtomicBool>,
    progress: &mut dyn FnMut(&SentFrame, &RunRecord),
) -> RunOutcome {
    let setting = Setting { clock, stop, hygiene: None, ring_frames: 0 };
    run_in(&setting, engine, receiver, port.into(), sink, progress)
}

/// The same in a setting of choice. The calling thread becomes the frame thread and stays what it is made.
pub fn run_in(
    setting: &Setting<'_>,
    engine: &mut FrameEngine,
    receiver: &mut Receiver,
    sources: Sources,
    sink: Box<dyn Sink>,
    progress: &mut dyn FnMut(&SentFrame, &RunRecord),
) -> RunOutcome {
    run_spoilt(setting, engine, receiver, None, sources, sink, progress)
}

/// The same with frames that are spoilt on purpose. `progress` sees them before that.
pub fn run_spoilt(
    setting: &Setting<'_>,
    engine: &mut FrameEngine,
    receiver: &mut Receiver,
    faults: Option<&mut FrameFaults>,
    sources: Sources,
    sink: Box<dyn Sink>,
    progress: &mut dyn FnMut(&SentFrame, &RunRecord),
) -> RunOutcome {
    let mut record = RunRecord::with_ring(setting.ring_frames);
    match start(setting, engine, sources, sink) {
        Err(error) => RunOutcome { record, ports: Vec::new(), sink: None, sinks: Vec::new(), error: Some(error) },
        Ok((prototype, radio, delivery)) => {
            let mut bench = Bench {
                engine,
                receiver,
                faults,
                spoiling: Spoiling::SEND,
                clock: &**setting.clock,
                radio: &radio,
                delivery: &delivery,
                spare: None,
                previous: prototype,
                has_previous: false,
                readings: vec![PortReading::default(); radio.readings().count()],
                reply: Reply::default(),
            };
            let error = bench.frames(setting.stop, &mut record, progress).err();
            let delivered = delivery.finish(|back| take_back(&mut record, back));
            record.frames.delivered = delivered.frames;
            record.frames.dropped += delivered.refused;
            record.note_losses(&delivered.losses, setting.clock.now());
            let (ports, receiving) = radio.finish();
            let error = delivered.error.or(receiving).or(error);
            RunOutcome { record, ports, sink: delivered.summary, sinks: delivered.lines, error }
        }
    }
}

/// Warms up, and starts the threads.
fn start(
    setting: &Setting<'_>,
    engine: &mut FrameEngine,
    sources: Sources,
    sink: Box<dyn Sink>,
) -> Result<(SentFrame, Radio, Delivery), RunError> {
    let camera = &engine.params().camera;
    let [width, height] = camera.output().size_px;
    let mut prototype = SentFrame::with_capacity(width, height, STARS_AT_FIRST, camera.name.clone());
    engine.warm_up(&mut prototype)?;
    engine.follow_load();
    let radio = Radio::start(sources.ports, sources.pulses, setting.clock, setting.hygiene)?;
    let delivery = Delivery::start(sink, &prototype, setting.clock, setting.hygiene)?;
    // Last: threads are born with the policy of the thread that starts them.
    if let Some(hygiene) = setting.hygiene {
        hygiene.enter(Role::Frame);
    }
    Ok((prototype, radio, delivery))
}

/// The frame thread's own state.
struct Bench<'a> {
    engine: &'a mut FrameEngine,
    receiver: &'a mut Receiver,
    faults: Option<&'a mut FrameFaults>,
    /// What becomes of the frame that is being made.
    spoiling: Spoiling,
    clock: &'a dyn Clock,
    radio: &'a Radio,
    delivery: &'a Delivery,
    spare: Option<Parcel>,
    previous: SentFrame,
    has_previous: bool,
    /// What each port had counted at the frame before.
    readings: Vec<PortReading>,
    reply: Reply,
}

impl Bench<'_> {
    fn frames(
        &mut self,
        stop: &AtomicBool,
        record: &mut RunRecord,
        progress: &mut dyn FnMut(&SentFrame, &RunRecord),
    ) -> Result<(), RunError> {
        for number in 0..self.engine.params().frames {
            let slot = self.engine.slot(number);
            let asked = self.clock.now();
            if !self.listen_until(slot.release, stop, record) {
                break;
            }
            record.frames.scheduled += 1;
            let woken = self.clock.now();
            if self.radio.is_finished() {
                break; // its error is told when the run ends
            }
            let mut timed =
                FrameRecord::released(slot.number, [slot.exposure_start, slot.release, slot.due], [asked, woken]);
            self.receive(record);
            timed.times.set(Stage::Receive, self.clock.now() - woken);
            record.stages.record(&timed.times);
            let spare = self.spare.take().or_else(|| self.delivery.take(|back| take_back(record, back)));
            let Some(mut parcel) = spare else {
                self.drop_slot(slot, &mut timed, EventKind::SinkBusy, MissCause::SinkBusy, record);
                continue;
            };
            if self.is_over(slot, woken) {
                // The slots before took so long that this one is over: nothing is drawn for it.
                parcel.frame.meta.lateness = timed.lateness;
                timed.cause = Some(timed.cause_of_late_start());
                parcel.record = timed;
                self.deliver_late(parcel, slot, record)?;
                continue;
            }
            let faults = &mut self.faults;
            self.receiver.fire_triggers(slot, &mut record.ledger, &mut |fired| {
                if let Some(faults) = faults.as_mut() {
                    faults.fire_trigger(fired.number, fired.at);
                }
            });
            timed.load = self.engine.load();
            let (engine, ledger) = (&mut *self.engine, &mut record.ledger);
            self.spoiling = self.faults.as_mut().map_or(Spoiling::SEND, |faults| faults.begin(slot, engine, ledger));
            let exposed = self.engine.expose(slot, self.receiver, &mut record.ledger, &mut parcel.frame);
            if matches!(exposed, Err(RunError::AttitudeStopped { .. })) {
                self.radio.send(0, self.reply.stopped(self.receiver, woken));
            }
            let times = exposed?;
            let finished = self.clock.now();
            parcel.frame.meta.lateness = finished - slot.due;
            self.engine.learn_load(drawn(&times), finished, slot, &mut record.ledger);
            record.count_rendered(&parcel.frame, &times);
            self.finish_record(&mut timed, &times, &parcel.frame.meta, finished, record);
            parcel.record = timed;
            progress(&parcel.frame, record);
            if self.spoiling.is_dropped {
                self.withhold(parcel, record);
                continue;
            }
            self.deliver(parcel, slot, record)?;
        }
        Ok(())
    }

    /// Writes down how a frame came about, and why it is missed if it is.
    fn finish_record(
        &self,
        timed: &mut FrameRecord,
        times: &StageTimes,
        meta: &FrameMeta,
        finished: Tai,
        record: &RunRecord,
    ) {
        timed.times.merge(times);
        timed.finished = Some(finished);
        timed.lateness = meta.lateness;
        (timed.rung, timed.method, timed.origin) = (meta.rung, meta.method, meta.origin);
        timed.horizon = meta.horizon;
        timed.pointing_bound_rad = self.engine.pointing_bound_rad();
        timed.cause = if meta.faults.contains(FaultFlags::BLANK) {
            Some(MissCause::AwaitingAttitude)
        } else {
            (timed.lateness > Span::ZERO).then(|| timed.cause_of_lateness(&record.stages))
        };
    }

    /// Takes messages in as they come, and sleeps in between, until `at`; false when the run is to stop.
    fn listen_until(&mut self, at: Tai, stop: &AtomicBool, record: &mut RunRecord) -> bool {
        while !stop.load(Ordering::Relaxed) {
            let now = self.clock.now();
            if now >= at {
                return true;
            }
            let span = at.min(now + STOP_POLL) - now;
            if let Some(heard) = self.radio.wait(Duration::from_nanos(span.ns().unsigned_abs())) {
                self.take_in(&heard, record);
            }
        }
        false
    }

    /// What has arrived and was not waited for; and what became of the ports.
    fn receive(&mut self, record: &mut RunRecord) {
        let radio = self.radio;
        for heard in radio.arrived() {
            self.take_in(&heard, record);
        }
        let now = self.clock.now();
        self.receiver.watch(now, &mut record.ledger);
        for (earlier, reading) in self.readings.iter_mut().zip(radio.readings()) {
            reading.tell(earlier, now, &mut record.ledger);
            *earlier = reading;
        }
        record.keep_ports(&self.readings);
    }

    fn take_in(&mut self, heard: &Heard, record: &mut RunRecord) {
        match heard {
            Heard::Pulse(at) => self.receiver.accept_pulse(*at),
            Heard::Message { port, message } => {
                if let Some(answer) = self.receiver.accept_from(*port, message, &mut record.ledger) {
                    self.radio.send(*port, answer);
                }
                record.count_intake(self.clock.now() - message.at);
            }
        }
    }

    fn drop_slot(
        &self,
        slot: Slot,
        timed: &mut FrameRecord,
        kind: EventKind,
        cause: MissCause,
        record: &mut RunRecord,
    ) {
        record.frames.dropped += 1;
        record.note(kind, slot.due + timed.lateness, slot.number, timed.lateness);
        timed.fate = Fate::Dropped;
        timed.cause = timed.cause.or(Some(cause));
        record.ring.push(*timed);
    }

    /// True when drawing a slot makes no sense any more: it is past due, and under `late` by more than a frame.
    fn is_over(&self, slot: Slot, now: Tai) -> bool {
        let params = self.engine.params();
        let grace = if params.deadline_policy == DeadlinePolicy::Late { params.frame_period } else { Span::ZERO };
        now > slot.due + grace
    }

    /// Loses a frame on purpose: the flight computer hears of it, and nobody sees it.
    fn withhold(&mut self, mut parcel: Parcel, record: &mut RunRecord) {
        self.tell(&parcel.frame.meta);
        if let Some(faults) = self.faults.as_mut() {
            faults.spoil(&self.spoiling, &mut parcel.frame);
        }
        record.frames.dropped += 1;
        parcel.record.fate = Fate::Dropped;
        record.ring.push(parcel.record);
        self.spare = Some(parcel);
    }

    /// Sends a finished frame, or does with a late one what the policy says.
    fn deliver(&mut self, mut parcel: Parcel, slot: Slot, record: &mut RunRecord) -> Result<(), RunError> {
        let policy = self.engine.params().deadline_policy;
        let lateness = parcel.frame.meta.lateness;
        if lateness > Span::ZERO && policy != DeadlinePolicy::Late {
            return self.deliver_late(parcel, slot, record);
        }
        parcel.record.fate = Fate::Sent;
        if lateness > Span::ZERO {
            record.frames.late += 1;
            record.note(EventKind::Late, slot.due + lateness, slot.number, lateness);
            parcel.record.fate = Fate::Late;
        }
        self.spoil_and_send(parcel, record)
    }

    /// A slot whose own frame does not go out: the previous one does under `hold`, else nothing.
    fn deliver_late(&mut self, mut parcel: Parcel, slot: Slot, record: &mut RunRecord) -> Result<(), RunError> {
        let lateness = parcel.frame.meta.lateness;
        let at = slot.due + lateness;
        record.frames.late += 1;
        if self.engine.params().deadline_policy == DeadlinePolicy::Hold && self.has_previous {
            record.frames.held += 1;
            record.note(EventKind::Held, at, slot.number, lateness);
            parcel.frame.copy_from(&self.previous);
            parcel.frame.meta.number = slot.number;
            parcel.frame.meta.lateness = lateness;
            parcel.frame.meta.faults |= FaultFlags::FRAME_DUPLICATE;
            parcel.record.fate = Fate::Held;
            self.tell(&parcel.frame.meta);
            return self.send(parcel, Span::ZERO, record);
        }
        let cause = parcel.record.cause.unwrap_or(MissCause::FramesBefore);
        self.drop_slot(slot, &mut parcel.record, EventKind::Dropped, cause, record);
        self.spare = Some(parcel);
        Ok(())
    }

    /// Tells the flight computer what is in a frame, spoils it if it is to be, and sends it.
    fn spoil_and_send(&mut self, mut parcel: Parcel, record: &mut RunRecord) -> Result<(), RunError> {
        // What the stimulator says of itself it says before its frame is spoilt.
        self.tell(&parcel.frame.meta);
        if let Some(faults) = self.faults.as_mut() {
            faults.spoil(&self.spoiling, &mut parcel.frame);
        }
        if self.engine.params().deadline_policy == DeadlinePolicy::Hold {
            // What is repeated is what went out, with all that is said of it.
            self.previous.copy_from(&parcel.frame);
            self.has_previous = true;
        }
        self.send(parcel, self.spoiling.delay, record)
    }

    /// Sends a frame out, `delay` after it is due if there is one.
    fn send(&mut self, mut parcel: Parcel, delay: Span, record: &mut RunRecord) -> Result<(), RunError> {
        parcel.not_before = (delay > Span::ZERO).then(|| parcel.record.due + delay);
        record.count_outgoing(&parcel.frame.meta);
        let meta = &parcel.frame.meta;
        // A held image is as old as when it was made: latency is that of what is seen.
        parcel.record.mid_exposure = meta.mid_exposure;
        parcel.record.commanded =
            (meta.origin != origin_name(PathOrigin::Absent)).then(|| meta.mid_exposure - meta.horizon);
        let now = self.clock.now();
        if let Some(finished) = parcel.record.finished {
            parcel.record.times.set(Stage::Handover, now - finished);
        }
        record.ring.push(parcel.record);
        self.delivery.send(parcel, now)
    }
}

impl Bench<'_> {
    /// Tells the flight computer what is in a frame.
    fn tell(&mut self, meta: &FrameMeta) {
        let now = self.clock.now();
        let pointing_bound_rad = self.engine.pointing_bound_rad();
        let rejects = PortReading::rejects_of_all(&self.readings);
        let told = ToldFrame { meta, pointing_bound_rad, rejects: &rejects, now };
        for message in self.reply.messages(&told, self.receiver) {
            self.radio.send(0, message);
        }
    }
}

/// Drawing and detector together, on whichever side of a device.
fn drawn(times: &StageTimes) -> Span {
    let stages = [Stage::Upload, Stage::Render, Stage::Detector, Stage::Readback];
    stages.into_iter().filter_map(|stage| times.get(stage)).fold(Span::ZERO, |sum, time| sum + time)
}

/// What the sink thread says of a frame whose buffer comes back.
fn take_back(record: &mut RunRecord, parcel: &Parcel) {
    if parcel.delivered {
        record.complete(&parcel.record);
    }
    record.note_losses(&parcel.losses, parcel.record.due);
}
