//! A run on the virtual clock, step by step: both ends of the cable, the frames between them, the faults, and the
//! witness.
//!
//! In: an assembled run. Out: frames in the sinks, telemetry, verdicts. [`SteppedRun::advance_to`] moves simulated
//! time; nothing else does. The same scenario and seed give the same bits, however it is advanced. Tests:
//! `tests/closed_loop/pixels.rs`, `campaign.rs`, `control.rs`.

use crate::runtime::exposing::Exposing;
use crate::runtime::ledger::{Event as LedgerEvent, EventKind};
use crate::runtime::virtual_time::{VirtualLoop, World, last_release};
use crate::runtime::{Head, Ledger, PlantSample, PortReading, RunError, RunRecord, TrackerOutput};
use crate::wiring::assemble::{Outputs, Run, RunOptions};
use crate::wiring::error::{LoopError, Result};
use crate::wiring::faults::{FaultLine, lock, make_ready};
use crate::wiring::run_clock::{RunClock, RunTimes};
use crate::wiring::run_end::{Flown, LoopView, RunEnd};
use crate::wiring::verdict::{CutShort, Facts, Promise, limits, verdict};
use crate::wiring::{far_side::FarSide, landing::Landing, tracker_outs::outside_trackers};
use base::time::{Span, Tai};
use config::{Event, Plant, Scenario};
use core::cell::RefCell;
use frames::report::{FrameEnd, Losses};
use frames::sink::{SentFrame, Sink};
use plan::attitude::{EstimatedAttitude, state_at};
use testbed::vehicle::{HeadReport, TelemetryRow, Vehicle};

/// A run on the virtual clock.
pub struct SteppedRun {
    pub(super) run: Run,
    pub(super) going: VirtualLoop,
    pub(super) far: RefCell<FarSide>,
    promise: Promise,
    cut_short: Option<CutShort>,
}

impl SteppedRun {
    /// Returns a run of `scenario` at its start. `sink` makes the sink of each head; trackers get the same frames.
    ///
    /// # Errors
    /// The first part that cannot be made.
    pub fn new(scenario: &Scenario, mut sink: impl FnMut(usize) -> Box<dyn Sink>) -> Result<Self> {
        Self::of(Run::assemble(scenario, RunOptions::stepped(Outputs::Made(&mut sink)))?)
    }

    /// Returns an assembled run at its start.
    ///
    /// # Errors
    /// When it is on the real clock, its cable cannot be opened or its far end cannot be made.
    pub fn of(mut run: Run) -> Result<Self> {
        let RunClock::Virtual(clock) = run.clock.clone() else {
            return Err(anyhow::anyhow!("the real clock cannot be stepped; wanted the virtual clock").into());
        };
        let mut far = run.far_side()?;
        let mut going = VirtualLoop::new(clock);
        for note in run.place_events(&mut far)? {
            going.record.ledger.note(note);
        }
        going.trackers = outside_trackers(&run.scenario, run.times.start)?;
        going.record.limits = limits(&run.scenario);
        let (far, promise) = (RefCell::new(far), Promise::of(&run.scenario, &run.heads));
        Ok(Self { run, going, far, promise, cut_short: None })
    }

    /// Calls `on_row` with every row of telemetry from here on.
    pub fn on_row(&mut self, on_row: Box<dyn FnMut(&TelemetryRow) + Send>) {
        self.far.get_mut().on_row = on_row;
    }

    /// Adds an event; its time counts from the first exposure. An event of the past starts now.
    ///
    /// # Errors
    /// When it names a head or wheel that does not exist.
    pub fn inject(&mut self, event: &Event) -> Result<()> {
        let now = self.now();
        let Run { desk, heads, receiver, taps, times, .. } = &mut self.run;
        let mut desk = lock(desk);
        desk.check(event)?;
        let placed = desk.place(event, now, heads.iter_mut().map(|head| &mut head.faults).collect());
        if let Some(note) = placed.note {
            self.going.record.ledger.note(note);
        }
        make_ready(event, heads.iter_mut(), receiver)?;
        if let Some(recording) = &taps.recording {
            recording.note_injected(&placed.event, now - times.zero);
        }
        self.far.get_mut().take_event(placed, times.zero);
        Ok(())
    }

    /// Accepts samples of an external plant, of any instants that have not passed: each reaches the receiver at its
    /// own instant, so that batches of any size give the same frames. All of a list are accepted or none; refusals are
    /// counted.
    ///
    /// # Errors
    /// When the plant is internal, or a sample is bad.
    pub fn take_plant(&mut self, samples: &[PlantSample]) -> Result<()> {
        let refuse = |why: String| LoopError::Event { what: "plant", why };
        if self.run.scenario.plant != Plant::Outside {
            let why = "the spacecraft is moved inside the program; wanted a bench with plant.kind = \"outside\"";
            return Err(refuse(why.into()));
        }
        let (zero, now) = (self.run.times.zero, self.now());
        let put = self.going.put_plant(samples);
        if let (Ok(()), Some(recording)) = (&put, &self.run.taps.recording) {
            recording.samples().into_iter().for_each(|tap| tap.note(samples, now));
        }
        put.map_err(|(place, why)| {
            let t_s = samples.get(place).map_or(f64::NAN, |sample| (sample.at - zero).s());
            let now_s = (self.going.now() - zero).s();
            refuse(format!("sample {place} of {} (t_s {t_s}, it is {now_s} s now): {why}", samples.len()))
        })
    }

    /// Counts a message of an external plant that was refused before it was a sample.
    pub(super) fn note_refused_sample(&mut self) {
        let now = self.now();
        self.going.record.ledger.note(LedgerEvent::new(EventKind::SampleRefused, now, None, Span::ZERO));
    }

    /// Returns the number of samples of an external plant that wait for their instants, and the instant of the last
    /// attitude among them.
    pub fn plant_waiting(&self) -> (usize, Option<Tai>) {
        (self.going.plant.len(), self.going.plant.last_attitude_at())
    }

    /// Returns the output of a head's built-in tracker for the newest frame that it has processed; `None` before the
    /// first.
    ///
    /// # Errors
    /// When the head has no tracker.
    pub fn tracker_output(&self, head: usize) -> Result<Option<TrackerOutput>> {
        if let Some(tracker) = self.going.trackers.get(head).and_then(Option::as_ref) {
            return Ok(tracker.output(self.now()));
        }
        let of_report = |report: &HeadReport| {
            let (frame, mid_exposure) = report.frame?;
            report.last.map(|outcome| TrackerOutput { frame, mid_exposure, outcome })
        };
        let found = self.with_vehicle(|vehicle| vehicle.heads.reports().nth(head).map(of_report)).flatten();
        found.ok_or_else(|| {
            let heads = self.run.heads.len();
            let why = format!(
                "head {head} of {heads} has no tracker inside; wanted a head below {heads}, and [plant.tracker] with a plant \
                 outside, or a spacecraft"
            );
            LoopError::Event { what: "tracker", why }
        })
    }

    /// Returns the attitude of the body that frames of the first head are drawn with, according to the samples so far.
    ///
    /// # Errors
    /// When no sample is near: before the first one, or before the kept ones.
    pub fn attitude_at(&self, at: Tai) -> Result<EstimatedAttitude> {
        let estimated = state_at(&self.run.receiver.attitudes.history, at, &self.run.receiver.params.settings.estimate);
        estimated.map_err(|error| LoopError::Parts(error.into()))
    }

    /// Returns the instants of the run.
    pub fn times(&self) -> RunTimes {
        self.run.times
    }

    /// Returns the simulated time.
    pub fn now(&self) -> Tai {
        self.going.now()
    }

    /// Returns counts and events so far.
    pub fn record(&self) -> &RunRecord {
        &self.going.record
    }

    /// Returns every fault so far with the number of packets, frames or times it hit.
    pub fn faults(&self) -> Vec<FaultLine> {
        let far = self.far.borrow();
        let frames = self.run.heads.iter().map(|head| &head.faults).collect();
        lock(&self.run.desk).lines(frames, &|number| far.hits_aboard(number))
    }

    /// Calls `look` with the vehicle, if there is one.
    pub fn with_vehicle<T>(&self, look: impl FnOnce(&Vehicle) -> T) -> Option<T> {
        self.far.borrow().vehicle().map(look)
    }

    /// Calls `act` with the vehicle and the run's time.
    ///
    /// # Errors
    /// When no spacecraft is flown inside.
    pub fn with_vehicle_mut<T>(&mut self, act: impl FnOnce(&mut Vehicle, Tai) -> T) -> Result<T> {
        let now = self.now();
        self.far.get_mut().vehicle_mut().map(|vehicle| act(vehicle, now)).ok_or(LoopError::NothingFlown)
    }

    /// Calls `act` with the exposures of a head.
    ///
    /// # Errors
    /// When the head does not exist.
    pub fn with_exposing<T>(&mut self, head: usize, act: impl FnOnce(&mut Exposing, &mut Ledger) -> T) -> Result<T> {
        let heads = self.run.heads.len();
        let no_head =
            || LoopError::Event { what: "camera", why: format!("head is {head}; there are {heads}, counted from 0") };
        let head = self.run.heads.get_mut(head).ok_or_else(no_head)?;
        Ok(act(&mut head.engine.exposing, &mut self.going.record.ledger))
    }

    /// Returns true when the last frame is out.
    pub fn is_finished(&self) -> bool {
        let is_drawn = |head: &Head| head.engine.exposing.next().is_over(self.now());
        let is_out = self.now() >= self.last_release() && self.going.on_the_way().0 == 0;
        is_out && self.run.heads.iter().all(is_drawn)
    }

    /// Advances simulated time to `at`, and processes everything that is due by then; it stops at the end of the run,
    /// so that a run in steps equals an uninterrupted run. `on_frame` gets each frame of each head as it goes out;
    /// false ends the run.
    ///
    /// # Errors
    /// When a part of the loop failed.
    pub fn advance_to(
        &mut self,
        at: Tai,
        on_frame: &mut dyn FnMut(usize, &mut SentFrame, &RunRecord) -> bool,
    ) -> Result<()> {
        let drawn = self.last_release();
        self.go(on_frame, |going, heads, world| going.advance_to(at.min(drawn), heads, world))?;
        // Everything is drawn: the run is over when the last frame is out, even if other events would follow.
        match self.going.on_the_way() {
            _ if at < drawn => Ok(()),
            (_, Some(last_out)) if at < last_out && at < self.run.times.end => {
                self.go(on_frame, |going, heads, world| going.advance_to(at, heads, world))
            }
            _ => self.run_to_end(on_frame),
        }
    }

    /// Returns when the last frame of the run will have been drawn, as known now.
    fn last_release(&self) -> Tai {
        self.run.heads.iter().map(|head| last_release(&head.engine)).max().unwrap_or(self.run.times.end)
    }

    /// Calls `look` with the present results of the run; the caller supplies the frames' CRC-32 of each head.
    pub fn look<T>(&self, frames_crc32: Vec<u32>, look: impl FnOnce(&LoopView<'_>) -> T) -> T {
        let far = self.far.borrow();
        let assessment = &far.witness.assessment;
        let flown = Flown::of(far.vehicle(), assessment, &self.run.heads[0].engine.params);
        let facts = Facts {
            record: self.record(),
            heads: &self.run.heads,
            receiver: &self.run.receiver,
            ports: &readings(&self.run),
            losses: &Losses::default(),
            zero: self.run.times.zero,
            // Until it ends, nothing is missing that has not come up.
            cut_short: (!self.is_finished()).then_some(CutShort::Finished),
            failure: assessment.first_failure(flown.predicted_pointing_arcsec(), self.record()),
        };
        look(&LoopView {
            record: self.record(),
            account: self.promise.account(self.record(), facts.cut_short),
            verdict: verdict(&self.promise, &facts),
            frames_crc32,
            assessment,
            faults: self.faults(),
            flown,
            simulated_s: self.simulated_s(),
        })
    }

    /// Returns the time since the first exposure, s; the last frame's readout is not counted.
    fn simulated_s(&self) -> f64 {
        let RunTimes { zero, end, .. } = self.run.times;
        let until = if self.is_finished() { end } else { self.now().min(end) };
        (until - zero).s().max(0.0)
    }

    /// Advances until the last frame is out.
    ///
    /// # Errors
    /// When a part of the loop failed.
    pub fn run_to_end(&mut self, on_frame: &mut dyn FnMut(usize, &mut SentFrame, &RunRecord) -> bool) -> Result<()> {
        self.go(on_frame, VirtualLoop::finish)
    }

    /// Sends the frames that are drawn and wait for the end of their readout, and notes that a client asked for the end:
    /// the frames still to come are missing as commanded.
    ///
    /// # Errors
    /// When a part of the loop failed.
    pub fn finish_early(&mut self, on_frame: &mut dyn FnMut(usize, &mut SentFrame, &RunRecord) -> bool) -> Result<()> {
        if self.is_finished() {
            return Ok(());
        }
        self.cut_short = Some(CutShort::Finished);
        match self.going.on_the_way() {
            (_, Some(last_out)) => self.go(on_frame, |going, heads, world| going.advance_to(last_out, heads, world)),
            (_, None) => Ok(()),
        }
    }

    /// Ends the run, which `error` cut short if there is one: finishes the sinks, and sums up telemetry and invariants.
    pub fn end(mut self, error: Option<LoopError>) -> RunEnd {
        self.run.outs.finish();
        let (now, simulated_s, was_over) = (self.now(), self.simulated_s(), self.is_finished());
        let ports = readings(&self.run);
        let Self { mut run, going, far, promise, cut_short, .. } = self;
        let is_asked = cut_short == Some(CutShort::Finished);
        let on_the_way = if is_asked { FrameEnd::Commanded } else { FrameEnd::Dropped };
        let outcome = going.end(&mut run.heads, ports, on_the_way);
        run.end(Landing { outcome, far: far.into_inner(), promise, cut_short, was_over, now, simulated_s, error })
    }

    fn go(
        &mut self,
        on_frame: &mut dyn FnMut(usize, &mut SentFrame, &RunRecord) -> bool,
        advance: impl FnOnce(&mut VirtualLoop, &mut [Head], &mut World<'_>) -> Result<(), RunError>,
    ) -> Result<()> {
        let Self { run: Run { heads, receiver, cable, outs, .. }, going, far, .. } = self;
        let (far, port) = (&*far, cable.as_mut().and_then(|cable| cable.near.first_mut()));
        let port = port.ok_or_else(|| anyhow::anyhow!("a run without a port"))?;
        let mut far_end = |now: Tai| {
            let far_due = far.borrow_mut().step(now)?;
            let out_due = outs.step(now);
            Ok(out_due.map_or(far_due, |due| due.min(far_due)))
        };
        let mut progress = |head: usize, frame: &mut SentFrame, record: &RunRecord| {
            far.borrow_mut().witness_frame(head, &frame.meta);
            on_frame(head, frame, record)
        };
        advance(going, heads, &mut World { port, receiver, far_end: &mut far_end, progress: &mut progress })?;
        Ok(())
    }
}

/// Returns the counters of the ports so far.
fn readings(run: &Run) -> Vec<PortReading> {
    run.cable.iter().flat_map(|cable| &cable.near).map(|port| PortReading::of(port, 0)).collect()
}
