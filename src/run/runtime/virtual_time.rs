//! The loop on the virtual clock: one thread, events in order of time, bit-identical on every machine.
//!
//! Four kinds of events: a sample of an external plant reaches its instant; the other end of the cable has work; a
//! slot's exposure ends and its frame is drawn; a frame has been read out and goes out. At one instant they come in
//! that order, except that a frame goes out before the next one is drawn. Drawing takes no simulated time, so nothing
//! is late; wall times per stage are still measured. [`VirtualLoop`] is advanced step by step, or to the
//! end.

use crate::runtime::error::{FarEndError, Result, RunError};
use crate::runtime::head::{Head, give_commands, show_cameras};
use crate::runtime::ledger::{Event, EventKind};
use crate::runtime::outside_tracker::{OutsideTracker, commands_of};
use crate::runtime::plant_queue::{PlantQueue, PlantRefusal, PlantSample};
use crate::runtime::record::{RunOutcome, RunRecord, lines_of_head};
use crate::runtime::reply::{Reply, ReportedFrame};
use crate::runtime::{
    engine::FrameEngine, frame_faults::Fate, port_reading::PortReading, real_head::end_of, receiver::Receiver,
    shutter::NextSlot, slot::Slot,
};
use base::clock::{Clock, Stopwatch, Virtual};
use base::time::{Span, Tai};
use frames::report::{FrameEnd, Stage};
use frames::sink::{SentFrame, Sink, sink_lines};
use link::Port;
use std::{collections::VecDeque, sync::Arc};

/// Interval at which a slot that waits for jitter samples looks for them.
const JITTER_POLL: Span = Span::from_ms(1);

/// The environment of a [`VirtualLoop`].
pub struct World<'a> {
    /// The stimulator's end of the cable.
    pub port: &'a mut Port,
    /// Receives messages.
    pub receiver: &'a mut Receiver,
    /// Steps the other end to an instant and returns when it next has work.
    pub far_end: &'a mut dyn FnMut(Tai) -> Result<Tai, FarEndError>,
    /// Called with every frame that has gone out and the number of its head; false ends the run. It may exchange the
    /// frame for another one of that head.
    pub progress: &'a mut dyn FnMut(usize, &mut SentFrame, &RunRecord) -> bool,
}

/// A frame between its exposure and its delivery.
struct Pending {
    deliver_at: Tai,
    head: usize,
    frame: SentFrame,
    drawn: Span,
    exposure_start: Tai,
    end: FrameEnd,
}

/// The loop's own state.
pub struct VirtualLoop {
    clock: Arc<Virtual>,
    /// Counts and events so far.
    pub record: RunRecord,
    /// When the other end next has work; `None` before the start.
    far_due: Option<Tai>,
    /// Samples of an external plant that wait for their instants.
    pub plant: PlantQueue,
    /// The tracker of each head beside an external plant, where there is one; they receive the frames as they go out.
    pub trackers: Vec<Option<OutsideTracker>>,
    /// Until when each head's next slot waits for jitter samples; `None` when it is drawn at its release.
    waits_until: Vec<Option<Tai>>,
    pending: VecDeque<Pending>,
    spare: Vec<SentFrame>,
    stopped: bool,
    reply: Reply,
    /// Reading of the port at the previous frame.
    reading: PortReading,
}

/// Kind of the next event.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Next {
    Plant,
    FarEnd,
    Deliver,
    Draw(usize),
}

impl VirtualLoop {
    /// Returns a loop at its start.
    pub fn new(clock: Arc<Virtual>) -> Self {
        Self {
            clock,
            record: RunRecord::default(),
            far_due: None,
            plant: PlantQueue::default(),
            trackers: Vec::new(),
            waits_until: Vec::new(),
            pending: VecDeque::new(),
            spare: Vec::new(),
            stopped: false,
            reply: Reply::default(),
            reading: PortReading::default(),
        }
    }

    /// Returns the simulated time.
    pub fn now(&self) -> Tai {
        self.clock.now()
    }

    /// Queues samples of an external plant until their instants, all of a list or none. Samples of an instant that has
    /// passed are refused; refusals are counted.
    ///
    /// # Errors
    /// Returns the place in the list of the first bad sample, counted from 0, and what is wrong with it.
    pub fn put_plant(&mut self, samples: &[PlantSample]) -> Result<(), (usize, PlantRefusal)> {
        let now = self.clock.now();
        let is_fresh = self.far_due.is_none();
        let put = self.plant.put(samples, if is_fresh { now } else { now + Span::from_ns(1) });
        if put.is_err() {
            let refused = |sample: &PlantSample| Event::new(EventKind::SampleRefused, now, None, now - sample.at);
            samples.iter().for_each(|sample| self.record.ledger.note(refused(sample)));
        }
        put
    }

    /// Returns the number of frames drawn that have not gone out, and when the last of them will.
    pub fn on_the_way(&self) -> (u64, Option<Tai>) {
        let last = self.pending.iter().map(|pending| pending.deliver_at).max();
        (self.pending.len() as u64, last)
    }

    /// Returns when the next drawn frame goes out.
    pub fn next_out(&self) -> Option<Tai> {
        self.pending.iter().map(|pending| pending.deliver_at).min()
    }

    /// Returns whether every slot of every head has been drawn and every frame is out.
    pub fn is_finished(&self, heads: &[Head]) -> bool {
        let drawn = |head: &Head| head.engine.exposing.next().is_over(self.clock.now());
        self.far_due.is_some() && self.pending.is_empty() && heads.iter().all(drawn)
    }

    /// Processes everything that is due up to and including `until`, and leaves the clock there.
    ///
    /// # Errors
    /// When the link, the backend or a sink failed.
    pub fn advance_to(&mut self, until: Tai, heads: &mut [Head], world: &mut World<'_>) -> Result<()> {
        if self.far_due.is_none() {
            self.start(heads, world)?;
        }
        while let Some((at, next)) = self.next(heads).filter(|(at, _)| *at <= until && !self.stopped) {
            self.clock.advance_to(at);
            self.receive(at, heads, world)?;
            self.take_commands(at, heads);
            match next {
                Next::Plant => self.take_plant(at, world.receiver),
                Next::FarEnd => self.far_due = Some((world.far_end)(at).map_err(RunError::FarEnd)?),
                Next::Deliver => self.deliver(at, heads, world)?,
                Next::Draw(number) => self.draw(number, &mut heads[number], world)?,
            }
        }
        if !self.stopped {
            self.clock.advance_to(until);
            self.receive(until, heads, world)?;
        }
        Ok(())
    }

    /// Advances until the last frame of every head is out.
    ///
    /// # Errors
    /// The same errors as [`Self::advance_to`].
    pub fn finish(&mut self, heads: &mut [Head], world: &mut World<'_>) -> Result<()> {
        loop {
            let last_release = |head: &Head| last_release(&head.engine);
            let last_pending = self.pending.iter().map(|pending| pending.deliver_at).max();
            let last_wait = self.waits_until.iter().copied().flatten().max();
            let lasts = heads.iter().map(last_release).chain(last_pending).chain(last_wait);
            let until = lasts.max().unwrap_or(self.clock.now());
            self.advance_to(until, heads, world)?;
            if self.stopped || self.is_finished(heads) {
                return Ok(());
            }
        }
    }

    /// Ends the run: finishes the sinks. Frames that are still on the way do not go out and end like this.
    pub fn end(mut self, heads: &mut [Head], ports: Vec<PortReading>, on_the_way: FrameEnd) -> RunOutcome {
        let (count, now) = (heads.len(), self.clock.now());
        let mut error = None;
        let (mut summaries, mut sinks) = (Vec::with_capacity(count), Vec::new());
        for (number, head) in heads.iter_mut().enumerate() {
            let finished = head.sink.finish();
            note_losses(&mut self.record, &mut *head.sink, now);
            let summary = finished.map_err(|finishing| error.get_or_insert(finishing.into())).ok();
            sinks.extend(lines_of_head(number, count, sink_lines(&*head.sink, summary.as_ref())));
            summaries.push(summary);
        }
        for pending in &self.pending {
            self.record.frames.dropped += 1;
            self.record.account.add(on_the_way, pending.exposure_start);
        }
        RunOutcome { record: self.record, ports, summaries, sinks, lost_threads: Vec::new(), error }
    }

    fn start(&mut self, heads: &mut [Head], world: &mut World<'_>) -> Result<()> {
        self.waits_until = vec![None; heads.len()];
        for head in heads.iter_mut() {
            let mut frame = empty_frame(&head.engine);
            head.engine.warm_up(&mut frame)?;
            self.spare.push(frame);
        }
        self.far_due = Some((world.far_end)(self.clock.now()).map_err(RunError::FarEnd)?);
        Ok(())
    }

    /// Accepts and answers what has arrived by `now`.
    fn receive(&mut self, now: Tai, heads: &mut [Head], world: &mut World<'_>) -> Result<()> {
        let World { port, receiver, .. } = world;
        while let Some(message) = port.receive_any(now)? {
            show_cameras(heads.iter().map(|head| &head.engine.exposing), receiver, &message.value);
            if let Some(answer) = receiver.accept_input(0, &message, &mut self.record.ledger) {
                port.send(&answer)?;
            }
            give_commands(heads, |head| &mut head.engine.exposing, receiver, &mut self.record.ledger);
        }
        Ok(())
    }

    /// Accepts commands from clients of the cameras, and those that wait in the queues.
    fn take_commands(&mut self, now: Tai, heads: &mut [Head]) {
        for head in heads.iter_mut().filter(|head| head.engine.exposing.has_desks()) {
            head.engine.exposing.poll(now, &mut self.record.ledger);
        }
    }

    /// Accepts the samples of a plant whose instant has come.
    fn take_plant(&mut self, at: Tai, receiver: &mut Receiver) {
        while let Some(sample) = self.plant.take(at) {
            receiver.take_sample(&sample, sample.at, &mut self.record.ledger);
        }
    }

    /// Returns the earliest event; of simultaneous ones the first by kind.
    fn next(&self, heads: &[Head]) -> Option<(Tai, Next)> {
        let plant = self.plant.next_at().map(|at| (at, Next::Plant));
        let far_end = self.far_due.map(|at| (at, Next::FarEnd));
        let delivery = self.pending.iter().map(|pending| pending.deliver_at).min().map(|at| (at, Next::Deliver));
        let draw = |(i, head): (usize, &Head)| {
            let slot = head.engine.exposing.next().slot()?;
            Some((self.waits_until[i].unwrap_or(slot.release), Next::Draw(i)))
        };
        let draws = heads.iter().enumerate().filter_map(draw);
        draws.chain(delivery).chain(far_end).chain(plant).min()
    }

    fn draw(&mut self, number: usize, head: &mut Head, world: &mut World<'_>) -> Result<()> {
        let World { port, receiver, .. } = world;
        // Input since the forecast may have moved the slot.
        let now = self.clock.now();
        let Some(slot) = head.engine.exposing.next().slot().filter(|slot| slot.release <= now) else { return Ok(()) };
        if self.must_wait(number, slot, &head.engine, receiver) {
            return Ok(());
        }
        head.engine.exposing.begin(&mut self.record.ledger);
        self.record.frames.scheduled += 1;
        let mut frame = self.take_buffer(&head.engine);
        let mut watch = Stopwatch::start();
        let exposed = head.draw(slot, receiver, &mut self.record.ledger, &mut frame);
        if let (Err(RunError::AttitudeStopped { .. }), 0) = (&exposed, number) {
            port.send(&self.reply.stopped(receiver, slot.release))?;
        }
        let Some((fate, times)) = exposed? else { return self.leave_out(number, slot, frame, world) };
        frame.meta.lateness = Span::ZERO;
        let drawn = watch.lap();
        self.record.count_rendered(&frame, &times);
        if number == 0 {
            self.watch_link(slot.due, world);
        }
        let (pointing_bound_rad, rejects) = (head.engine.pointing.bound_rad, &self.reading.rejects);
        let reported = ReportedFrame { meta: &frame.meta, pointing_bound_rad, rejects, now: slot.due };
        let World { port, receiver, .. } = world;
        self.reply.report(number, &reported, receiver, |message| port.send(&message).map(|_at| ()))?;
        // The stimulator reports its own data before its frame is damaged.
        head.faults.spoil(&fate, &mut frame);
        let end = end_of(head.engine.pointing.end_on_time, fate.delay, Span::ZERO);
        self.queue((number, slot), frame, fate, (drawn, end));
        Ok(())
    }

    /// Returns true while a slot should wait for jitter samples that are under way; it waits in steps while there is
    /// time.
    fn must_wait(&mut self, number: usize, slot: Slot, engine: &FrameEngine, receiver: &Receiver) -> bool {
        let now = self.clock.now();
        let limit = slot.release + engine.jitter_wait(slot, receiver);
        let waits = now < limit && engine.lacks_jitter(slot, receiver);
        self.waits_until[number] = waits.then(|| limit.min(now + JITTER_POLL));
        waits
    }

    /// Sends nothing for a slot without an attitude, and reports this to the flight computer.
    fn leave_out(&mut self, number: usize, slot: Slot, frame: SentFrame, world: &mut World<'_>) -> Result<()> {
        if number == 0 {
            self.watch_link(slot.due, world);
            world.port.send(&self.reply.stopped(world.receiver, slot.due))?;
        }
        self.record.frames.dropped += 1;
        self.record.account.add(FrameEnd::Dropped, slot.exposure_start);
        self.spare.push(frame);
        Ok(())
    }

    /// Adds changes of the link to the ledger.
    fn watch_link(&mut self, now: Tai, world: &mut World<'_>) {
        world.receiver.session.watch(now, &mut self.record.ledger);
        let reading = PortReading::of(world.port, 0);
        reading.announce(&self.reading, now, &mut self.record.ledger);
        self.reading = reading;
        self.record.keep_ports(&[reading]);
    }

    fn queue(&mut self, (head, slot): (usize, Slot), frame: SentFrame, fate: Fate, (drawn, end): (Span, FrameEnd)) {
        if fate.is_dropped {
            self.record.frames.dropped += 1;
            self.record.account.add(FrameEnd::Commanded, slot.exposure_start);
            self.spare.push(frame);
            return;
        }
        let own = slot.due.max(slot.release) + fate.delay;
        // No frame overtakes one of its own head that is late, as in the queue of sinks on the real clock.
        let in_front =
            self.pending.iter().filter(|pending| pending.head == head).map(|pending| pending.deliver_at).max();
        let deliver_at = in_front.map_or(own, |in_front| own.max(in_front));
        let exposure_start = slot.exposure_start;
        self.pending.push_back(Pending { deliver_at, head, frame, drawn, exposure_start, end });
    }

    fn deliver(&mut self, at: Tai, heads: &mut [Head], world: &mut World<'_>) -> Result<()> {
        while let Some(place) = self.pending.iter().position(|pending| pending.deliver_at <= at) {
            let Some(mut pending) = self.pending.remove(place) else { break };
            let head = &mut heads[pending.head];
            let mut watch = Stopwatch::start();
            let sent = head.sink.send(&pending.frame);
            note_losses(&mut self.record, &mut *head.sink, self.clock.now());
            sent?;
            if let Some(tracker) = self.trackers.get_mut(pending.head).and_then(Option::as_mut) {
                let beta = head.engine.observer_beta(pending.frame.meta.mid_exposure).map_err(RunError::Scene)?;
                let wish = tracker.take_frame(&pending.frame, at, beta);
                for commanded in wish.iter().flat_map(|wish| commands_of(wish, at)) {
                    // A refused command is recorded as an event.
                    let _noted = head.engine.exposing.take(&commanded, &mut self.record.ledger);
                }
            }
            self.record.count_outgoing(&pending.frame.meta);
            self.record.frames.delivered += 1;
            self.record.account.add(pending.end, pending.exposure_start);
            let sending = watch.lap();
            self.record.stages.record_stage(Stage::Sink, sending);
            self.record.stages.record_stage(Stage::ReleaseToDelivered, pending.drawn + sending);
            self.stopped |= !(world.progress)(pending.head, &mut pending.frame, &self.record);
            self.spare.push(pending.frame);
        }
        // The far end processes this frame at its arrival.
        self.far_due = Some((world.far_end)(at).map_err(RunError::FarEnd)?);
        Ok(())
    }

    /// Returns a buffer of the engine's size.
    fn take_buffer(&mut self, engine: &FrameEngine) -> SentFrame {
        let size = engine.params.camera.output().size_px;
        let fits = |frame: &SentFrame| {
            [frame.image.width(), frame.image.height()] == size && frame.meta.camera == engine.params.camera.name
        };
        let place = self.spare.iter().position(fits);
        place.map_or_else(|| empty_frame(engine), |place| self.spare.swap_remove(place))
    }
}

/// Returns the latest instant at which a head may still draw, as known now.
pub(crate) fn last_release(engine: &FrameEngine) -> Tai {
    let nominal = engine.exposing.nominal(engine.params.frames.saturating_sub(1)).release;
    match engine.exposing.next() {
        NextSlot::Slot(slot) => nominal.max(slot.release),
        NextSlot::Waiting(until) => nominal.max(until),
        NextSlot::Over => nominal,
    }
}

fn empty_frame(engine: &FrameEngine) -> SentFrame {
    let camera = &engine.params.camera;
    let [width, height] = camera.output().size_px;
    SentFrame::with_capacity(width, height, 0, camera.name.clone())
}

/// Adds the losses of a sink to the ledger.
fn note_losses(record: &mut RunRecord, sink: &mut dyn Sink, now: Tai) {
    sink.take_losses(&mut |loss| record.note_losses(&[loss], now));
}
