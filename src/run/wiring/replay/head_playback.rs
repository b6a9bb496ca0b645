//! One head of a run, drawn again: its own ports, receiver, engine and faults.
//!
//! In: the parts of the run and its capture. Out: images in a sink, each compared with the captured one. Messages are
//! fed in the order of their stamps, as many of each link as a row states.
//!
//! The events of a captured run, placed as in the run, for one head: frames are hit as they were.
//!
//! In: the run file's events and the injected ones. Out: the faults of the head's frames, with their numbers in the
//! list of all faults. Faults of the bus and aboard the vehicle only take their numbers: the capture contains packets
//! that arrived after those faults acted.

use super::captured_links::{CapturedLinks, Source};
use super::{CapturedFate, CapturedSample, DrawnFrom, FrameRow, Result};
use crate::runtime::frame_faults::{Fate, FrameFaults};
use crate::runtime::{Exposed, Head, Imager, Ledger, Slot, clock_intake::PORTS_MAX, receiver::Receiver};
use crate::wiring::faults::{FaultDesk, Inventory, in_order_of_placing, make_ready};
use crate::wiring::heads::{CostsHere, HeadSetting, make_heads, make_receiver, size_of};
use base::refused::Refused;
use base::time::{Span, Tai};
use config::{Event, Scenario};
use core::ops::Range;
use frames::sink::crc32::pixel_crc32;
use frames::sink::{SentFrame, Sink};
use plan::exposure::cost::CostModel;
use std::collections::VecDeque;

/// An image that differs from the captured one.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Difference {
    /// Number of its head.
    pub head: usize,
    /// Frame number.
    pub frame: u32,
    /// Checksum in the capture.
    pub wanted: u32,
    /// Checksum of the replay.
    pub got: u32,
}

/// Result of the replay of a head.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct HeadOutcome {
    /// Number of the head, from 0.
    pub head: usize,
    /// Frames drawn.
    pub drawn: u64,
    /// Frames compared with the capture.
    pub compared: u64,
    /// Frames that went out and could not be compared.
    pub uncompared: u64,
    /// Number of compared frames that are not bit-identical.
    pub differing: u64,
    /// The first of them.
    pub first: Option<Difference>,
}

/// Data shared by all heads of a replay.
pub(super) struct Replayed<'a> {
    pub(super) scenario: &'a Scenario,
    pub(super) start: Tai,
    pub(super) source: &'a Source<'a>,
    /// On the real clock: the costs that its planners used. `None`: the virtual clock.
    pub(super) real: Option<Option<CostModel>>,
    /// Frames that are compared.
    pub(super) frames: Range<u32>,
    /// Detectors and images of all heads, and wheels.
    there: Inventory,
    /// First exposure of the first head: time zero of events.
    zero: Tai,
}

impl<'a> Replayed<'a> {
    /// Returns the heads of a run whose clock started at `start`, as the run makes them.
    pub(super) fn with_heads(
        scenario: &'a Scenario,
        start: Tai,
        source: &'a Source<'a>,
        real: Option<Option<CostModel>>,
        frames: Range<u32>,
    ) -> Result<(Self, Vec<Head>)> {
        let mut captured = |_: &Imager| real.flatten();
        let costs: Option<CostsHere<'_>> = if real.is_some() { Some(&mut captured) } else { None };
        let heads = make_heads(HeadSetting { scenario, start, costs });
        let heads = heads.map_err(|error| Refused(format!("{error:#}")))?;
        let there = Inventory {
            heads: heads.iter().map(size_of).collect(),
            wheels: scenario.vehicle().map(|vehicle| vehicle.spacecraft.params.wheels.len()),
        };
        let zero = heads.first().map_or(start, |head| head.engine.params.first_exposure);
        Ok((Self { scenario, start, source, real, frames, there, zero }, heads))
    }
}

/// A head that is being replayed.
pub(super) struct HeadPlayback {
    head: Head,
    receiver: Receiver,
    faults: HeadFaults,
    links: CapturedLinks,
    /// Samples of a plant in lockstep that act later.
    samples: VecDeque<CapturedSample>,
    ledger: Ledger,
    frame: SentFrame,
    frames: Range<u32>,
    is_real: bool,
    sink: Option<Box<dyn Sink>>,
    /// Checksum of the last frame that went out in time.
    previous: Option<u32>,
    has_run_out: bool,
    outcome: HeadOutcome,
    doubts: Vec<String>,
}

impl HeadPlayback {
    /// Starts the replay of a head, and places the events of the run file.
    pub(super) fn new(
        replayed: &Replayed<'_>,
        (number, head): (usize, Head),
        sink: Option<Box<dyn Sink>>,
    ) -> Result<Self> {
        let Replayed { scenario, start, zero, .. } = *replayed;
        // Alone with its receiver, it is the first head.
        let mut head = Head { engine: head.engine.of_head(0), ..head };
        let receiver = make_receiver(scenario, core::slice::from_ref(&head));
        let mut receiver = receiver.map_err(|error| Refused(format!("{error:#}")))?;
        let there = replayed.there.clone();
        let heads = there.heads.len();
        // Faults of the bus have no effect in a replay.
        let desk = FaultDesk::new(zero, scenario.bench.sensor_from_body, there, Default::default());
        let mut faults = HeadFaults::new(desk, zero, number, heads);
        faults.place_all(&scenario.events, start, &mut head, &mut receiver)?;
        let camera = &head.engine.params.camera;
        let [width, height] = camera.output().size_px;
        let mut frame = SentFrame::with_capacity(width, height, 0, camera.name.clone());
        head.engine.warm_up(&mut frame)?;
        if replayed.real.is_some() {
            head.engine.pace.follow_load();
        }
        Ok(Self {
            head,
            receiver,
            faults,
            links: CapturedLinks::open(&scenario.bench, replayed.source)?,
            samples: VecDeque::new(),
            ledger: Ledger::default(),
            frame,
            frames: replayed.frames.clone(),
            is_real: replayed.real.is_some(),
            sink,
            previous: None,
            has_run_out: false,
            outcome: HeadOutcome { head: number, ..HeadOutcome::default() },
            doubts: Vec::new(),
        })
    }

    /// Returns the imager of the head.
    pub(super) fn imager(&self) -> &Imager {
        &self.head.engine.drawer.imager
    }

    /// Returns the number of its frames in the whole run.
    pub(super) fn frame_count(&self) -> u32 {
        self.head.engine.params.frames
    }

    /// Adds an event injected this long after the first exposure.
    pub(super) fn inject(&mut self, came: Span, event: Event) {
        self.faults.add_injected(came, event);
    }

    /// Takes the samples of a plant in lockstep, in the order in which they act.
    pub(super) fn take_samples(&mut self, samples: &[CapturedSample]) {
        self.samples = samples.iter().copied().collect();
    }

    fn doubt(&mut self, why: String) {
        self.doubts.push(why);
    }

    /// Draws the frame of a row, and compares it with the captured result.
    pub(super) fn row(&mut self, row: &FrameRow) -> Result<()> {
        let mut own = None;
        if let Some(DrawnFrom { messages, load, exposed }) = &row.drawn {
            self.receive_up_to(messages, row.frame)?;
            // A frame may show the previous one.
            let from = self.frames.start.saturating_sub(u32::from(self.faults.has_any(&self.head)));
            if (from..self.frames.end).contains(&row.frame) {
                self.head.engine.pace.assume_load(*load);
                own = self.draw_as_captured(row, exposed.as_ref())?.filter(|_| self.frames.contains(&row.frame));
            }
        }
        let (wanted, got) = match row.fate {
            CapturedFate::Sent => {
                self.previous = own;
                (row.crc32, own)
            }
            CapturedFate::Late => (row.crc32, own),
            CapturedFate::Held => (row.crc32, self.previous.filter(|_| self.frames.contains(&row.frame))),
            CapturedFate::Dropped => (None, None),
        };
        let is_to_compare = row.crc32.is_some() && self.frames.contains(&row.frame);
        if is_to_compare && (wanted.is_none() || got.is_none()) {
            self.outcome.uncompared += 1;
        }
        if let (Some(wanted), Some(got)) = (wanted, got) {
            self.compare(Difference { head: self.outcome.head, frame: row.frame, wanted, got });
        }
        Ok(())
    }

    fn compare(&mut self, pair: Difference) {
        self.outcome.compared += 1;
        if pair.wanted != pair.got {
            self.outcome.differing += 1;
            self.outcome.first = self.outcome.first.or(Some(pair));
        }
    }

    fn receive_up_to(&mut self, messages: &[u64; PORTS_MAX], frame: u32) -> Result<()> {
        while !self.has_run_out {
            let taken = self.receiver.messages;
            let is_wanted = |link: usize| {
                let place = link.min(PORTS_MAX - 1);
                taken[place] < messages[place]
            };
            if !(0..PORTS_MAX).any(is_wanted) {
                return Ok(());
            }
            // Input of the bus at the instant of a sample came first.
            let until = self.samples.front().map_or(Tai::from_ns(i64::MAX), |next| next.arrived);
            match (self.links.take(until, is_wanted)?, self.samples.front().copied()) {
                (None, Some(CapturedSample { sample, arrived })) => {
                    self.samples.pop_front();
                    self.receiver.take_sample(&sample, arrived, &mut self.ledger);
                }
                (Some((link, message)), _) => drop(self.receiver.accept_input(link, &message, &mut self.ledger)),
                (None, None) => {
                    self.has_run_out = true;
                    let (wanted, held) = (messages.iter().sum::<u64>(), self.receiver.messages.iter().sum::<u64>());
                    self.doubt(format!("frame {frame} was drawn after {wanted} messages; the capture holds {held}"));
                }
            }
        }
        Ok(())
    }

    /// Takes in everything that arrived by the release of a slot, and draws it; returns false when the capture ended
    /// before.
    pub(super) fn draw_at_release(&mut self, number: u32) -> Result<bool> {
        let slot = self.head.engine.exposing.nominal(number);
        while let Some((link, message)) = self.links.take(slot.release, |_| true)? {
            self.receiver.accept_input(link, &message, &mut self.ledger);
        }
        if self.links.are_over() && self.links.last_at().is_none_or(|at| at < slot.release) {
            return Ok(false);
        }
        if self.frames.contains(&number)
            && let Some(fate) = self.expose(slot)?
        {
            self.spoil(&fate);
            if !fate.is_dropped {
                self.hand_on()?;
            }
        }
        Ok(true)
    }

    /// Draws the frame of a row with the faults that it went out with; returns its checksum.
    fn draw_as_captured(&mut self, row: &FrameRow, exposed: Option<&Exposed>) -> Result<Option<u32>> {
        let slot = self.head.engine.exposing.repeat(row.frame, exposed);
        let Some(fate) = self.expose(slot)? else { return Ok(None) };
        let went_out = matches!(row.fate, CapturedFate::Sent | CapturedFate::Late);
        if went_out && fate.is_dropped {
            self.doubt(format!("frame {} went out; by the events of the run it is dropped", row.frame));
        }
        // On the real clock a frame that was not sent was not damaged either.
        if went_out || fate.is_dropped || !self.is_real {
            self.spoil(&fate);
        }
        if self.frames.contains(&row.frame) {
            self.hand_on()?;
        }
        Ok(Some(pixel_crc32(&self.frame.image)))
    }

    /// Draws a slot; returns `None`, and notes a doubt, when it has no attitude.
    fn expose(&mut self, slot: Slot) -> Result<Option<Fate>> {
        let Self { head, receiver, faults, ledger, frame, .. } = self;
        faults.place_injected_before(slot.release, head, receiver)?;
        let drawn = head.draw(slot, receiver, ledger, frame)?;
        if drawn.is_none() {
            self.doubt(format!("frame {} was drawn, and has no attitude here", slot.number));
        }
        self.frame.meta.lateness = Span::ZERO;
        Ok(drawn.map(|(fate, _times)| fate))
    }

    fn spoil(&mut self, fate: &Fate) {
        self.head.faults.spoil(fate, &mut self.frame);
    }

    fn hand_on(&mut self) -> Result<()> {
        self.outcome.drawn += 1;
        if let Some(sink) = &mut self.sink {
            sink.send(&self.frame)?;
        }
        Ok(())
    }

    /// Finishes the head; returns its result, the number of unsupported packets, and the doubts.
    pub(super) fn finish(mut self) -> Result<(HeadOutcome, u64, Vec<String>)> {
        if let Some(sink) = &mut self.sink {
            sink.finish()?;
        }
        let (skipped, damage) = self.links.finish()?;
        self.doubts.extend(damage);
        Ok((self.outcome, skipped, self.doubts))
    }
}

/// The faults of one head of several.
pub(super) struct HeadFaults {
    desk: FaultDesk,
    /// Faults of the other heads, which are not prepared; those of the replayed head are its own.
    of_heads: Vec<FrameFaults>,
    head: usize,
    /// Time zero of events.
    zero: Tai,
    /// Events that were injected during the run, with their times.
    injected: VecDeque<(Tai, Event)>,
}

impl HeadFaults {
    /// Returns the faults of head number `head` of `heads`, before any event.
    pub(super) fn new(desk: FaultDesk, zero: Tai, head: usize, heads: usize) -> Self {
        let of_heads = (0..heads).map(|_| FrameFaults::default()).collect();
        Self { desk, of_heads, head, zero, injected: VecDeque::new() }
    }

    /// Adds an event injected this long after the first exposure; call in order of time.
    pub(super) fn add_injected(&mut self, came: Span, event: Event) {
        self.injected.push_back((self.zero + came, event));
    }

    /// Returns true when a frame may show the previous one.
    pub(super) fn has_any(&self, head: &Head) -> bool {
        !self.injected.is_empty() || !head.faults.timed().is_empty()
    }

    /// Places the events of the run file, at the start of the run.
    pub(super) fn place_all(
        &mut self,
        events: &[Event],
        start: Tai,
        head: &mut Head,
        receiver: &mut Receiver,
    ) -> Result<()> {
        in_order_of_placing(events).try_for_each(|event| self.place(event, start, head, receiver))
    }

    /// Places the events that came before `at`, when a frame is drawn.
    pub(super) fn place_injected_before(&mut self, at: Tai, head: &mut Head, receiver: &mut Receiver) -> Result<()> {
        while let Some((came, event)) = self.injected.front().copied().filter(|(came, _)| *came < at) {
            self.injected.pop_front();
            self.place(&event, came, head, receiver)?;
        }
        Ok(())
    }

    fn place(&mut self, event: &Event, now: Tai, head: &mut Head, receiver: &mut Receiver) -> Result<()> {
        self.desk.check(event).map_err(Refused::of)?;
        let mut frames: Vec<&mut FrameFaults> = self.of_heads.iter_mut().collect();
        frames[self.head] = &mut head.faults;
        self.desk.place(event, now, frames);
        Ok(make_ready(event, core::iter::once(head), receiver)?)
    }
}
