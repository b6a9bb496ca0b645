//! The closed loop on the virtual clock: both ends of the cable, the frames between them, the faults, and the witness.
//!
//! In: a checked scenario and a sink per head. Out: frames in the sinks, telemetry, verdicts. [`ClosedLoop::advance_to`]
//! moves simulated time; nothing else does. The same scenario and seed give the same bits, however it is advanced.
//! Tests: `tests/closed_loop/pixels.rs`, `campaign.rs`, `control.rs`.

use crate::runtime::virtual_time::{Head, VirtualLoop, World};
use crate::runtime::{RunError, RunParams, RunRecord, lines_of_head};
use crate::wiring::far_side::FarSide;
use crate::wiring::faults::{FaultLine, FaultLog, Inventory, LoggedFault, Places, PlacesRead, check_places};
use crate::wiring::loop_outcome::{LoopOutcome, LoopView, predicted_pointing_rad, vehicle_counts};
use crate::wiring::loop_parts::{LoopHead, loop_head, ports};
use base::axes::{Body, Icrf, Rotation, Sensor};
use base::clock::{Clock, Virtual};
use base::time::{Span, Tai};
use config::{Action, ConfigError, Event, Scenario, StartTime};
use core::cell::RefCell;
use frames::sink::{SentFrame, Sink};
use glam::DVec3;
use link::Port;
use link::tap::FaultControl;
use std::sync::Arc;
use testbed::vehicle::{TelemetryRow, Vehicle, VehicleError};

/// Why a closed loop cannot be made or go on.
#[derive(Debug, thiserror::Error)]
pub enum LoopError {
    /// the configuration
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// the parts cannot be made
    #[error("{0}")]
    Parts(String),
    /// the vehicle cannot be made
    #[error("vehicle: {0}")]
    Vehicle(#[from] VehicleError),
    /// the run failed
    #[error(transparent)]
    Run(#[from] RunError),
    /// a fault or command that names what is not there
    #[error("event \"{what}\": {why}")]
    Event {
        /// Its word.
        what: &'static str,
        /// What is wrong.
        why: String,
    },
}

/// A closed loop.
pub struct ClosedLoop {
    clock: Arc<Virtual>,
    going: VirtualLoop,
    heads: Vec<LoopHead>,
    near: Port,
    far: RefCell<FarSide>,
    to_stimulator: FaultControl,
    to_computer: FaultControl,
    faults: FaultLog,
    mounting: Rotation<Sensor, Body>,
    zero: Tai,
    end: Tai,
}

impl ClosedLoop {
    /// A loop in which nothing has happened. `sink` makes the sink of each head; the trackers see the same frames.
    ///
    /// # Errors
    /// The first thing that cannot be made.
    pub fn new(scenario: &Scenario, sink: impl FnMut(usize) -> Box<dyn Sink>) -> Result<Self, LoopError> {
        Self::on_clock(scenario, Self::clock_of(scenario)?, sink)
    }

    /// A clock that stands at the scenario's start.
    ///
    /// # Errors
    /// When it has no fixed start.
    pub fn clock_of(scenario: &Scenario) -> Result<Arc<Virtual>, LoopError> {
        match scenario.bench.timing.start {
            StartTime::At(start) => Ok(Arc::new(Virtual::new(start))),
            StartTime::Now => Err(LoopError::Parts("a scenario needs a start_utc: \"now\" does not repeat".into())),
        }
    }

    /// The same on a clock of [`Self::clock_of`], which others read too.
    ///
    /// # Errors
    /// The first thing that cannot be made.
    pub fn on_clock(
        scenario: &Scenario,
        clock: Arc<Virtual>,
        mut sink: impl FnMut(usize) -> Box<dyn Sink>,
    ) -> Result<Self, LoopError> {
        let start = clock.now();
        let (mut heads, mut taps, mut shared) = (Vec::new(), Vec::new(), None);
        for (i, mounting) in scenario.heads.iter().enumerate() {
            let (head, end) = loop_head(scenario, i, mounting, start, sink(i), &mut shared, |_| {})?;
            heads.push(head);
            taps.push(end);
        }
        let Some(first) = heads.first() else { return Err(LoopError::Parts("a scenario needs a head".into())) };
        let params = first.engine.params();
        let zero = params.first_exposure;
        let end = params.exposure_start(params.frames);
        let [to_stimulator, to_computer] = [FaultControl::default(), FaultControl::default()];
        let shared: Arc<dyn Clock> = Arc::<Virtual>::clone(&clock);
        let (near, far) = ports(scenario, &shared, &to_stimulator, &to_computer)?;
        let far = FarSide::new(scenario, far, taps, [start, zero, end])?;
        let mut made = Self {
            going: VirtualLoop::new(Arc::clone(&clock)),
            clock,
            heads,
            near,
            far: RefCell::new(far),
            to_stimulator,
            to_computer,
            faults: FaultLog::default(),
            mounting: scenario.heads.first().copied().unwrap_or(Rotation::IDENTITY),
            zero,
            end,
        };
        // A trigger finds those that wait for it.
        let is_trigger = |event: &&Event| matches!(event.action, Action::Trigger { .. });
        let triggers = scenario.events.iter().filter(is_trigger);
        for event in scenario.events.iter().filter(|event| !is_trigger(event)).chain(triggers) {
            made.inject(event)?;
        }
        Ok(made)
    }

    /// Calls `on_row` with every row of telemetry from here on.
    pub fn on_row(&mut self, on_row: Box<dyn FnMut(&TelemetryRow) + Send>) {
        self.far.get_mut().on_row = on_row;
    }

    /// Adds an event; its time counts from the first exposure. One whose time has passed begins now.
    ///
    /// # Errors
    /// When it names a head or wheel that is not there.
    pub fn inject(&mut self, event: &Event) -> Result<(), LoopError> {
        let far = self.far.get_mut();
        let wheels = far.computer.vehicle().map_or(0, |vehicle| vehicle.wheel_speeds_rad_s().len());
        let there = Inventory {
            heads: self.heads.len(),
            wheels,
            size_px: self.heads[0].size_px(),
            output_px: self.heads[0].output_px(),
        };
        check_places(event, there).map_err(|why| LoopError::Event { what: event.action.word(), why })?;
        let mut event = *event;
        if event.on_trigger.is_none() {
            event.at = event.at.max(self.clock.now() - self.zero);
        }
        let mut places = Places {
            to_stimulator: &self.to_stimulator,
            to_computer: &self.to_computer,
            frames: self.heads.iter_mut().map(|head| &mut head.faults).collect(),
        };
        let fault = far.take_event(&event, self.zero, &self.mounting, &mut self.faults, &mut places);
        if let Some(event) = fault.and_then(LoggedFault::ledger_event) {
            self.going.record_mut().ledger.note(event);
        }
        for head in &mut self.heads {
            event.on_trigger.into_iter().for_each(|number| head.receiver.expect_trigger(number));
            head.faults.prepare(&mut head.engine)?;
        }
        Ok(())
    }

    /// The flight computer fires a trigger over the bus, to act at `at` or as soon as it has come.
    ///
    /// # Errors
    /// When too many wait to be told, or the instant is more than an hour away.
    pub fn send_trigger(&mut self, number: u16, at: Option<Tai>) -> Result<(), LoopError> {
        let now = self.clock.now();
        let sent = self.far.get_mut().computer.send_trigger(number, at, now);
        sent.map_err(|error| LoopError::Event { what: "trigger", why: error.to_string() })
    }

    /// Time from one frame to the next.
    #[must_use]
    pub fn frame_period(&self) -> Span {
        self.params().frame_period
    }

    /// First exposure: where scenario time is zero.
    #[must_use]
    pub fn zero(&self) -> Tai {
        self.zero
    }

    /// End of the last frame's period.
    #[must_use]
    pub fn end(&self) -> Tai {
        self.end
    }

    /// Simulated time.
    #[must_use]
    pub fn now(&self) -> Tai {
        self.going.now()
    }

    /// Counts and events so far.
    #[must_use]
    pub fn record(&self) -> &RunRecord {
        self.going.record()
    }

    /// Every fault so far with the number of packets, frames or times it hit.
    #[must_use]
    pub fn faults(&self) -> Vec<FaultLine> {
        let far = self.far.borrow();
        let places = PlacesRead {
            to_stimulator: &self.to_stimulator,
            to_computer: &self.to_computer,
            frames: self.heads.iter().map(|head| &head.faults).collect(),
            aboard: &|number| far.hits_aboard(number),
        };
        self.faults.lines(self.zero, &places)
    }

    /// Looks at the vehicle.
    pub fn with_vehicle<T>(&self, look: impl FnOnce(&Vehicle) -> T) -> Option<T> {
        self.far.borrow().computer.vehicle().map(look)
    }

    /// The true attitude of the first head and the body's rate (body axes, rad/s) at `at`, at most two seconds ago.
    /// Looking changes nothing.
    ///
    /// # Errors
    /// When it is longer ago, or has not been flown.
    pub fn truth(&self, at: Tai) -> Result<(Rotation<Sensor, Icrf>, DVec3), LoopError> {
        let no_vehicle = || LoopError::Parts("nothing is flown".into());
        let truth = self.with_vehicle(|vehicle| vehicle.flown_truth(at)).ok_or_else(no_vehicle)??;
        Ok((self.mounting * truth.body_from_icrf, truth.rate_rad_s))
    }

    /// Mounting of the first head.
    #[must_use]
    pub fn mounting(&self) -> Rotation<Sensor, Body> {
        self.mounting
    }

    /// The end of a frame's readout, the number counted from 0; the same for all heads.
    #[must_use]
    pub fn frame_due(&self, number: u32) -> Tai {
        self.heads[0].engine.slot(number).due
    }

    /// Frames of each head in the whole run.
    #[must_use]
    pub fn frames_per_head(&self) -> u32 {
        self.heads[0].engine.params().frames
    }

    /// True when the last frame is out.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.now() >= self.last_release() && self.going.on_the_way().0 == 0
    }

    /// Advances simulated time to `at`, and does everything that is due by then; at the latest to the end of the run, so
    /// that a run in steps is the run in one. `on_frame` sees each frame of each head as it goes out; false ends the run.
    ///
    /// # Errors
    /// When a part of the loop failed.
    pub fn advance_to(
        &mut self,
        at: Tai,
        on_frame: &mut dyn FnMut(usize, &SentFrame, &RunRecord) -> bool,
    ) -> Result<(), LoopError> {
        let drawn = self.last_release();
        self.go(on_frame, |going, heads, world| going.advance_to(at.min(drawn), heads, world))?;
        // Everything is drawn: the run is over when the last frame is out, whatever else would happen later.
        match self.going.on_the_way() {
            _ if at < drawn => Ok(()),
            (_, Some(last_out)) if at < last_out && at < self.end => {
                self.go(on_frame, |going, heads, world| going.advance_to(at, heads, world))
            }
            _ => self.run_to_end(on_frame),
        }
    }

    /// When the last frame of the run has been drawn.
    fn last_release(&self) -> Tai {
        let last = |head: &LoopHead| head.engine.slot(head.engine.params().frames.saturating_sub(1)).release;
        self.heads.iter().map(last).max().unwrap_or(self.end)
    }

    /// Shows the run as it stands; the frames' CRC-32 of each head are the caller's.
    pub fn look<T>(&self, frames_crc32: Vec<u32>, look: impl FnOnce(&LoopView<'_>) -> T) -> T {
        let far = self.far.borrow();
        let assessment = far.witness.assessment();
        let (estimator, untagged) = vehicle_counts(far.computer.vehicle());
        look(&LoopView {
            record: self.record(),
            frames_crc32,
            assessment,
            faults: self.faults(),
            estimator,
            untagged,
            predicted_pointing_rad: predicted_pointing_rad(far.computer.vehicle(), assessment, self.params()),
            simulated_s: self.simulated_s(),
        })
    }

    /// Parameters of the first head.
    fn params(&self) -> &RunParams {
        self.heads[0].engine.params()
    }

    /// Since the first exposure, s; the last frame's readout is not counted.
    fn simulated_s(&self) -> f64 {
        let until = if self.is_finished() { self.end } else { self.now().min(self.end) };
        (until - self.zero).s().max(0.0)
    }

    /// Advances until the last frame is out.
    ///
    /// # Errors
    /// When a part of the loop failed.
    pub fn run_to_end(
        &mut self,
        on_frame: &mut dyn FnMut(usize, &SentFrame, &RunRecord) -> bool,
    ) -> Result<(), LoopError> {
        self.go(on_frame, VirtualLoop::finish)
    }

    /// Ends the run: sinks are finished, telemetry and invariants are summed up.
    ///
    /// # Errors
    /// When a sink could not finish.
    pub fn finish(mut self) -> Result<LoopOutcome, LoopError> {
        let faults = self.faults();
        let (mut sinks, mut sink_lines) = (Vec::with_capacity(self.heads.len()), Vec::new());
        let heads = self.heads.len();
        for (number, head) in self.heads.iter_mut().enumerate() {
            let summary = head.sink.finish().map_err(RunError::from)?;
            sink_lines.extend(lines_of_head(number, heads, frames::sink::sink_lines(&*head.sink, Some(&summary))));
            sinks.push(summary);
        }
        let (now, simulated_s) = (self.now(), self.simulated_s());
        let (on_the_way, _) = self.going.on_the_way();
        let predicted_pointing_rad = {
            let far = self.far.borrow();
            predicted_pointing_rad(far.computer.vehicle(), far.witness.assessment(), self.params())
        };
        let record = self.going.into_record();
        let far = self.far.into_inner();
        let (estimator, untagged) = vehicle_counts(far.computer.vehicle());
        let assessment = far.witness.finish(&record, &faults, now, on_the_way);
        Ok(LoopOutcome {
            record,
            sinks,
            sink_lines,
            assessment,
            faults,
            estimator,
            untagged,
            predicted_pointing_rad,
            simulated_s,
        })
    }

    fn go(
        &mut self,
        on_frame: &mut dyn FnMut(usize, &SentFrame, &RunRecord) -> bool,
        advance: impl FnOnce(&mut VirtualLoop, &mut [Head<'_>], &mut World<'_>) -> Result<(), RunError>,
    ) -> Result<(), LoopError> {
        let Self { going, heads, near, far, .. } = self;
        let far = &*far;
        let mut heads: Vec<Head<'_>> = heads
            .iter_mut()
            .map(|head| Head {
                engine: &mut head.engine,
                receiver: &mut head.receiver,
                sink: &mut *head.sink,
                faults: Some(&mut head.faults),
            })
            .collect();
        let mut far_end = |now: Tai| far.borrow_mut().step(now);
        let mut progress = |head: usize, frame: &SentFrame, record: &RunRecord| {
            far.borrow_mut().witness_frame(head, &frame.meta);
            on_frame(head, frame, record)
        };
        advance(going, &mut heads, &mut World { port: near, far_end: &mut far_end, progress: &mut progress })?;
        Ok(())
    }
}
