//! One head of a run, drawn again: its own ports, receiver, engine and faults.
//!
//! In: the parts of the run and what was captured. Out: images in a sink, each compared with the captured one. Messages are
//! fed in the order of their stamps, of each link as many as a row states.

use super::captured_links::{CapturedLinks, Source};
use super::head_faults::HeadFaults;
use super::{CapturedFate, Difference, DrawnFrom, FrameRow, HeadOutcome, ReplayError};
use crate::runtime::frame_faults::Fate;
use crate::runtime::head_step::HeadStep;
use crate::runtime::receiver::{PORTS_MAX, Receiver};
use crate::runtime::{FrameEngine, Imager, Ledger, RunParams, Slot};
use crate::wiring::bench_parts;
use base::time::{Span, Tai};
use config::{Bench, Scenario};
use core::ops::Range;
use frames::sink::crc32::pixel_crc32;
use frames::sink::{SentFrame, Sink};
use plan::exposure::cost::CostModel;
use sky::almanac::Almanac;
use stars::Sky;

/// What all heads of a replay share.
pub(super) struct Replayed<'a> {
    pub(super) scenario: &'a Scenario,
    pub(super) start: Tai,
    pub(super) source: &'a Source<'a>,
    /// On the real clock: the costs that its planners used. `None`: the virtual clock.
    pub(super) real: Option<Option<CostModel>>,
    /// Frames that are compared.
    pub(super) frames: Range<u32>,
    /// Made by the first head.
    pub(super) sky: Option<(Sky, Almanac)>,
}

impl Replayed<'_> {
    /// Time from one frame of the first head to the next, by which events count frames.
    pub(super) fn event_period(&self) -> Span {
        Span::from_s(1.0 / self.scenario.bench.timing.frame_rate_hz)
    }

    /// The bench as a head is drawn from it.
    fn bench_of_head(&self, head: usize) -> Bench {
        let mut bench = self.scenario.bench.of_head(head);
        if self.scenario.vehicle().is_some() {
            // The jitter of a flown vehicle comes over the bus.
            bench.flight_computer.jitter_lines.clear();
        }
        bench
    }

    fn params(&self, bench: &Bench) -> Result<RunParams, ReplayError> {
        let mut params = bench_parts::run_params(bench, self.start).map_err(parts)?;
        if let Some(cost) = self.real {
            bench_parts::take_real_clock(&mut params, bench, cost);
        }
        Ok(params)
    }

    fn engine(&mut self, params: RunParams) -> Result<FrameEngine, ReplayError> {
        let imager = bench_parts::imager(&params).map_err(parts)?;
        if self.sky.is_none() {
            self.sky = Some((params.open_sky().map_err(crate::runtime::RunError::from)?, params.almanac()));
        }
        let made = self.sky.as_ref().map(|(sky, almanac)| FrameEngine::with_sky(params, imager, sky, almanac));
        let mut engine = made.ok_or_else(|| ReplayError::Parts("the run has no sky".into()))??;
        if self.real.is_some() {
            engine.follow_load();
        }
        Ok(engine)
    }
}

fn parts(error: anyhow::Error) -> ReplayError {
    ReplayError::Parts(format!("{error:#}"))
}

/// A head under way.
pub(super) struct HeadPlayback {
    engine: FrameEngine,
    receiver: Receiver,
    faults: HeadFaults,
    links: CapturedLinks,
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
    /// Makes the parts of a head, with the events of the run file placed.
    pub(super) fn new(
        replayed: &mut Replayed<'_>,
        head: usize,
        sink: Option<Box<dyn Sink>>,
    ) -> Result<Self, ReplayError> {
        let bench = replayed.bench_of_head(head);
        let params = replayed.params(&bench)?;
        let mut receiver = Receiver::new(params.attitude.clone())?.with_session(bench_parts::session_params(&bench));
        // The times of events count from the first exposure of the first head.
        let zero = match head {
            0 => params.first_exposure,
            _ => replayed.params(&replayed.bench_of_head(0))?.first_exposure,
        };
        let mut engine = replayed.engine(params)?;
        let run = &replayed.scenario.bench;
        let mut faults = HeadFaults::new(head, run.head_count(), zero, run.sensor_from_body);
        faults.place_all(&replayed.scenario.events, &mut receiver, &mut engine)?;
        let camera = &engine.params().camera;
        let [width, height] = camera.output().size_px;
        let mut frame = SentFrame::with_capacity(width, height, 0, camera.name.clone());
        engine.warm_up(&mut frame)?;
        Ok(Self {
            engine,
            receiver,
            faults,
            links: CapturedLinks::open(run, replayed.source)?,
            ledger: Ledger::default(),
            frame,
            frames: replayed.frames.clone(),
            is_real: replayed.real.is_some(),
            sink,
            previous: None,
            has_run_out: false,
            outcome: HeadOutcome { head, ..HeadOutcome::default() },
            doubts: Vec::new(),
        })
    }

    /// What draws it.
    pub(super) fn imager(&self) -> &Imager {
        self.engine.imager()
    }

    /// Frames of it in the whole run.
    pub(super) fn frame_count(&self) -> u32 {
        self.engine.params().frames
    }

    /// Adds an event that came while the run went on, so long after its first exposure.
    pub(super) fn inject(&mut self, came: Span, event: config::Event) {
        self.faults.add_injected(came, event);
    }

    fn doubt(&mut self, why: String) {
        self.doubts.push(why);
    }

    /// Draws what a row says was drawn, and compares what it says went out.
    pub(super) fn row(&mut self, row: &FrameRow) -> Result<(), ReplayError> {
        let mut own = None;
        if let Some(DrawnFrom { messages, load }) = &row.drawn {
            self.receive_up_to(messages, row.frame)?;
            // A frame may show what the one before was.
            let from = self.frames.start.saturating_sub(u32::from(self.faults.has_any()));
            if (from..self.frames.end).contains(&row.frame) {
                self.engine.assume_load(*load);
                own = self.draw_as_captured(row)?.filter(|_| self.frames.contains(&row.frame));
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

    fn receive_up_to(&mut self, messages: &[u64; PORTS_MAX], frame: u32) -> Result<(), ReplayError> {
        while !self.has_run_out {
            let taken = self.receiver.messages_by_port();
            let is_wanted = |link: usize| {
                let place = link.min(PORTS_MAX - 1);
                taken[place] < messages[place]
            };
            if !(0..PORTS_MAX).any(is_wanted) {
                return Ok(());
            }
            match self.links.take(Tai::from_ns(i64::MAX), is_wanted)? {
                Some((link, message)) => drop(self.receiver.accept_from(link, &message, &mut self.ledger)),
                None => {
                    self.has_run_out = true;
                    let (wanted, held) = (messages.iter().sum::<u64>(), self.receiver.messages());
                    self.doubt(format!("frame {frame} was drawn after {wanted} messages; the capture holds {held}"));
                }
            }
        }
        Ok(())
    }

    /// Takes in what arrived by the release of a slot, and draws it; false when the capture ended before.
    pub(super) fn draw_at_release(&mut self, number: u32) -> Result<bool, ReplayError> {
        let slot = self.engine.slot(number);
        while let Some((link, message)) = self.links.take(slot.release, |_| true)? {
            self.receiver.accept_from(link, &message, &mut self.ledger);
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

    /// Draws the frame of a row with the faults that it went out with; its checksum.
    fn draw_as_captured(&mut self, row: &FrameRow) -> Result<Option<u32>, ReplayError> {
        let Some(fate) = self.expose(self.engine.slot(row.frame))? else { return Ok(None) };
        let went_out = matches!(row.fate, CapturedFate::Sent | CapturedFate::Late);
        if went_out && fate.is_dropped {
            self.doubt(format!("frame {} went out; by the events of the run it is dropped", row.frame));
        }
        // On the real clock a frame that was given up is not spoilt.
        if went_out || fate.is_dropped || !self.is_real {
            self.spoil(&fate);
        }
        if self.frames.contains(&row.frame) {
            self.hand_on()?;
        }
        Ok(Some(pixel_crc32(&self.frame.image)))
    }

    /// Draws a slot; `None`, and a doubt, when it has no attitude.
    fn expose(&mut self, slot: Slot) -> Result<Option<Fate>, ReplayError> {
        let Self { engine, receiver, faults, ledger, frame, .. } = self;
        faults.place_injected_before(slot.release, receiver, engine)?;
        let drawn = HeadStep { engine, receiver, faults: faults.own() }.draw(slot, ledger, frame)?;
        if drawn.is_none() {
            self.doubt(format!("frame {} was drawn, and has no attitude here", slot.number));
        }
        self.frame.meta.lateness = Span::ZERO;
        Ok(drawn.map(|(fate, _times)| fate))
    }

    fn spoil(&mut self, fate: &Fate) {
        if let Some(faults) = self.faults.own() {
            faults.spoil(fate, &mut self.frame);
        }
    }

    fn hand_on(&mut self) -> Result<(), ReplayError> {
        self.outcome.drawn += 1;
        if let Some(sink) = &mut self.sink {
            sink.send(&self.frame)?;
        }
        Ok(())
    }

    /// Ends the head: what it came to, how many packets have no form here, and what makes it doubtful.
    pub(super) fn finish(mut self) -> Result<(HeadOutcome, u64, Vec<String>), ReplayError> {
        if let Some(sink) = &mut self.sink {
            sink.finish()?;
        }
        let (skipped, damage) = self.links.finish()?;
        self.doubts.extend(damage);
        Ok((self.outcome, skipped, self.doubts))
    }
}
