//! The closed loop on the virtual clock: both ends of the cable, the frames between them, the faults, and the witness.
//!
//! In: a checked scenario and a sink per head. Out: frames in the sinks, telemetry, verdicts. [`ClosedLoop::advance_to`]
//! moves simulated time; nothing else does. The same scenario and seed give the same bits, however it is advanced.
//! Tests: `tests/closed_loop/pixels.rs`, `campaign.rs`, `control.rs`.

use crate::base::axes::{Body, Icrf, Rotation, Sensor};
use crate::base::clock::{Clock, Virtual};
use crate::base::time::{Span, Tai};
use crate::config::{ConfigError, Event, Scenario, StartTime};
use crate::link::Port;
use crate::link::simulated::simulated_pair;
use crate::link::tap::{FaultControl, FaultyLink};
use crate::runtime::error::FarEndError;
use crate::runtime::frame_faults::FrameFaults;
use crate::runtime::ledger::Event as LedgerEvent;
use crate::runtime::receiver::Receiver;
use crate::runtime::virtual_time::{Head, VirtualLoop, World};
use crate::runtime::{EventKind, FrameEngine, RunError, RunRecord};
use crate::sink::{FrameMeta, SentFrame, Sink, SinkSummary, TapEnd, Tee, tap};
use crate::testbed::acs::linear::PointingLoop;
use crate::testbed::acs::pointing_error::PointingNoise;
use crate::testbed::estimator::GyroNoise;
use crate::testbed::flight_computer::{FlightComputer, FlightError};
use crate::testbed::vehicle::{TelemetryRow, Vehicle, VehicleError, VehicleParams};
use crate::wiring::assessment::Assessment;
use crate::wiring::bench_parts;
use crate::wiring::faults::{Aboard, FaultLine, FaultLog, LoggedFault, Places, PlacesRead};
use crate::wiring::vehicle_parts::vehicle_params;
use crate::wiring::witness::Witness;
use core::cell::RefCell;
use firmware_protocol::can::IdMap;
use std::sync::Arc;

/// Frames on their way to a tracker.
const TAP_FRAMES: usize = 8;
/// Streams of the seed, so that faults, frames and sensors do not share numbers.
const BUS_SEED: u64 = 0x6275_7300;

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

/// One head of the stimulator.
struct LoopHead {
    engine: FrameEngine,
    receiver: Receiver,
    sink: Box<dyn Sink>,
    faults: FrameFaults,
}

/// The far end of the cable: flight computer, vehicle, and what looks at them.
struct FarSide {
    port: Port,
    computer: FlightComputer,
    taps: Vec<TapEnd>,
    /// Faults and commands aboard, the next one last.
    aboard: Vec<(Tai, Aboard)>,
    witness: Witness,
    on_row: Box<dyn FnMut(&TelemetryRow) + Send>,
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

/// What stands after a run.
pub struct LoopOutcome {
    /// Counts, times and events of the stimulator.
    pub record: RunRecord,
    /// What each head's sink wrote.
    pub sinks: Vec<SinkSummary>,
    /// Telemetry summed up, invariants.
    pub assessment: Assessment,
    /// Every fault and what it hit.
    pub faults: Vec<FaultLine>,
    /// What linear theory makes of the tracker's noise: rms error of the boresight's direction, rad.
    pub predicted_pointing_rad: Option<f64>,
}

impl ClosedLoop {
    /// A loop in which nothing has happened. `sink` makes the sink of each head; the trackers see the same frames.
    ///
    /// # Errors
    /// The first thing that cannot be made.
    pub fn new(scenario: &Scenario, mut sink: impl FnMut(usize) -> Box<dyn Sink>) -> Result<Self, LoopError> {
        let bench = &scenario.bench;
        let StartTime::At(start) = bench.timing.start else {
            return Err(LoopError::Parts("a scenario needs a start_utc: \"now\" does not repeat".into()));
        };
        let clock = Arc::new(Virtual::new(start));
        let (mut heads, mut taps) = (Vec::new(), Vec::new());
        for (i, mounting) in scenario.heads.iter().enumerate() {
            let (head, end) = loop_head(scenario, i, mounting, start, sink(i))?;
            heads.push(head);
            taps.push(end);
        }
        let Some(first) = heads.first() else { return Err(LoopError::Parts("a scenario needs a head".into())) };
        let params = first.engine.params();
        let zero = params.first_exposure;
        let end = params.exposure_start(params.frames);
        let [to_stimulator, to_computer] = [FaultControl::default(), FaultControl::default()];
        let (near, far) = ports(scenario, &clock, &to_stimulator, &to_computer)?;
        let vehicle = Vehicle::new(vehicle_params(scenario, zero), start)?;
        let mut computer = bench_parts::flight_computer(bench, start);
        computer.jitter_lines.clear();
        let witness = Witness::new(scenario, zero, end);
        let far = FarSide {
            port: far,
            computer: FlightComputer::flying(computer, vehicle),
            taps,
            aboard: Vec::new(),
            witness,
            on_row: Box::new(|_| {}),
        };
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
        for event in &scenario.events {
            made.inject(event)?;
        }
        Ok(made)
    }

    /// Calls `on_row` with every row of telemetry from here on.
    pub fn on_row(&mut self, on_row: impl FnMut(&TelemetryRow) + Send + 'static) {
        self.far.get_mut().on_row = Box::new(on_row);
    }

    /// Adds an event; its time counts from the first exposure. One whose time has passed begins now.
    ///
    /// # Errors
    /// When it names a head or wheel that is not there.
    pub fn inject(&mut self, event: &Event) -> Result<(), LoopError> {
        let far = self.far.get_mut();
        check_event(event, self.heads.len(), far.computer.vehicle().map_or(0, |v| v.wheel_speeds_rad_s().len()))?;
        let mut event = *event;
        event.at = event.at.max(self.clock.now() - self.zero);
        let mut places = Places {
            to_stimulator: &self.to_stimulator,
            to_computer: &self.to_computer,
            frames: self.heads.iter_mut().map(|head| &mut head.faults).collect(),
        };
        let before = self.faults.faults().len();
        self.faults.place(&event, self.zero, &self.mounting, &mut places, &mut far.aboard);
        // A stable sort, latest first: what was added first comes first among simultaneous ones.
        far.aboard.reverse();
        far.aboard.sort_by_key(|(at, _)| core::cmp::Reverse(*at));
        if let Some(fault) = self.faults.faults().get(before) {
            far.witness.expect_fault(fault.from, fault.until);
            let span = fault.until - fault.from;
            self.going.record_mut().ledger.note(LedgerEvent::new(EventKind::Fault, fault.from, None, span));
        }
        Ok(())
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
        let places = PlacesRead {
            to_stimulator: &self.to_stimulator,
            to_computer: &self.to_computer,
            frames: self.heads.iter().map(|head| &head.faults).collect(),
        };
        let now = self.now();
        let line = |fault: &LoggedFault| FaultLine {
            name: fault.name,
            from_s: (fault.from - self.zero).s(),
            until_s: (fault.until - self.zero).s(),
            hits: self.faults.hits(fault, &places, now),
        };
        self.faults.faults().iter().map(line).collect()
    }

    /// Looks at the vehicle.
    pub fn with_vehicle<T>(&self, look: impl FnOnce(&Vehicle) -> T) -> Option<T> {
        self.far.borrow().computer.vehicle().map(look)
    }

    /// Looks at what has been summed up so far.
    pub fn with_assessment<T>(&self, look: impl FnOnce(&Assessment) -> T) -> T {
        look(self.far.borrow().witness.assessment())
    }

    /// The true attitude of the first head at `at`, at most two seconds ago.
    ///
    /// # Errors
    /// When it is longer ago.
    pub fn truth(&self, at: Tai) -> Result<Rotation<Sensor, Icrf>, LoopError> {
        let mut far = self.far.borrow_mut();
        let no_vehicle = || LoopError::Parts("nothing is flown".into());
        let truth = far.computer.vehicle_mut().ok_or_else(no_vehicle)?.truth(at)?;
        Ok(self.mounting * truth.body_from_icrf)
    }

    /// Advances simulated time to `at`, and does everything that is due by then. `on_frame` sees each frame of each head
    /// as it goes out; false ends the run.
    ///
    /// # Errors
    /// When a part of the loop failed.
    pub fn advance_to(
        &mut self,
        at: Tai,
        on_frame: &mut dyn FnMut(usize, &SentFrame, &RunRecord) -> bool,
    ) -> Result<(), LoopError> {
        self.go(on_frame, |going, heads, world| going.advance_to(at, heads, world))
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
        let mut sinks = Vec::with_capacity(self.heads.len());
        for head in &mut self.heads {
            sinks.push(head.sink.finish().map_err(RunError::from)?);
        }
        let now = self.now();
        let camera = &self.heads[0].engine.params().camera;
        let (exposure_s, readout_s) = (camera.exposure_s, camera.readout_s);
        let period_s = self.heads[0].engine.params().frame_period.s();
        let record = self.going.into_record();
        let far = self.far.into_inner();
        let assessment = far.witness.finish(&record, &faults, now);
        let vehicle = far.computer.vehicle().map(Vehicle::params);
        let predicted = |vehicle| {
            let latency_s = 0.5 * exposure_s + readout_s;
            Some(predicted_pointing_rad(vehicle, assessment.nea_rad()?, period_s, latency_s))
        };
        let predicted_pointing_rad = vehicle.and_then(predicted);
        Ok(LoopOutcome { record, sinks, assessment, faults, predicted_pointing_rad })
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

impl FarSide {
    /// Everything due by `now`; when the next thing is due.
    fn step(&mut self, now: Tai) -> Result<Tai, FarEndError> {
        self.computer.listen(now, &mut self.port)?;
        self.take_frames(now);
        while let Some((_, action)) = self.aboard.last().copied().filter(|(at, _)| *at <= now) {
            self.aboard.pop();
            self.do_aboard(action)?;
        }
        self.computer.step(now, &mut self.port)?;
        if let Some(vehicle) = self.computer.vehicle_mut() {
            let telemetry = vehicle.telemetry_mut();
            for row in telemetry.rows.drain(..) {
                self.witness.take_row(&row);
                (self.on_row)(&row);
            }
            telemetry.mode_events.drain(..).for_each(|event| self.witness.take_mode(&event));
        }
        let next_aboard = self.aboard.last().map(|(at, _)| *at);
        Ok(next_aboard.map_or(self.computer.next_due(), |at| at.min(self.computer.next_due())))
    }

    fn take_frames(&mut self, now: Tai) {
        let Some(vehicle) = self.computer.vehicle_mut() else { return };
        for (head, tap) in self.taps.iter().enumerate() {
            while let Some(frame) = tap.take() {
                vehicle.take_frame(head, frame.number, &frame.image, now);
                tap.give_back(frame);
            }
        }
    }

    fn do_aboard(&mut self, action: Aboard) -> Result<(), FlightError> {
        let Some(vehicle) = self.computer.vehicle_mut() else { return Ok(()) };
        match action {
            Aboard::Inject(fault) => vehicle.inject(fault)?,
            Aboard::Clear(fault) => vehicle.clear(fault),
            Aboard::Command(command) => {
                if let Err(refused) = vehicle.command(command) {
                    self.witness.refuse(&refused.to_string());
                }
            }
        }
        Ok(())
    }

    /// Holds what was rendered against what is true.
    fn witness_frame(&mut self, head: usize, meta: &FrameMeta) {
        let truth = self.computer.vehicle_mut().and_then(|vehicle| vehicle.truth(meta.mid_exposure).ok());
        self.witness.take_frame(head, meta, truth.map(|truth| (truth.body_from_icrf, truth.rate_rad_s.length())));
    }
}

/// The stimulator's part of one head, and the tracker's end of its tap.
fn loop_head(
    scenario: &Scenario,
    number: usize,
    mounting: &Rotation<Sensor, Body>,
    start: Tai,
    sink: Box<dyn Sink>,
) -> Result<(LoopHead, TapEnd), LoopError> {
    let mut bench = scenario.bench.clone();
    bench.sensor_from_body = *mounting;
    // The jitter of a flown vehicle comes over the bus.
    bench.flight_computer.jitter_lines.clear();
    bench.seed = bench.seed.wrapping_add(number as u64);
    let params = bench_parts::run_params(&bench, start).map_err(|error| LoopError::Parts(format!("{error:#}")))?;
    let size = [params.camera.geometry.width_px(), params.camera.geometry.height_px()];
    let receiver = Receiver::new(params.attitude.clone())?;
    let engine = FrameEngine::new(params)?;
    let (sender, end) = tap(size, TAP_FRAMES);
    let sink = Box::new(Tee::new(sink, Box::new(sender)));
    Ok((LoopHead { engine, receiver, sink, faults: FrameFaults::default() }, end))
}

/// Both ends of the bus, each behind its faults.
fn ports(
    scenario: &Scenario,
    clock: &Arc<Virtual>,
    to_stimulator: &FaultControl,
    to_computer: &FaultControl,
) -> Result<(Port, Port), LoopError> {
    let shared: Arc<dyn Clock> = Arc::<Virtual>::clone(clock);
    let (params, format) = bench_parts::bus(&scenario.bench);
    let (near, far) = simulated_pair(params, &shared);
    let seed = scenario.bench.seed ^ BUS_SEED;
    let near = FaultyLink::new(Box::new(near), Arc::clone(&shared), to_stimulator.clone(), seed);
    let far = FaultyLink::new(Box::new(far), shared, to_computer.clone(), seed.wrapping_add(1));
    let ids = IdMap::new(0, 0).ok_or_else(|| LoopError::Parts("CAN identifiers".into()))?;
    Ok((Port::new(Box::new(near), format, ids), Port::new(Box::new(far), format, ids)))
}

/// Rms error of the boresight's direction (two axes) in fine pointing, as linear theory has it.
fn predicted_pointing_rad(vehicle: &VehicleParams, nea_rad: f64, period_s: f64, latency_s: f64) -> f64 {
    let pointing = PointingLoop {
        gains: vehicle.acs.fine,
        delay_s: vehicle.actuation_delay.s(),
        control_period_s: vehicle.acs.control_period.s(),
        filter: vehicle.acs.filter,
        inertia_ratio: 1.0,
    };
    let gyro = GyroNoise {
        arw_rad_sqrt_s: vehicle.gyro.angle_random_walk_rad_sqrt_s,
        rrw_rad_s_sqrt_s: vehicle.gyro.rate_random_walk_rad_s_sqrt_s,
    };
    let heads = vehicle.heads.len().max(1) as f64;
    let delay_s = vehicle.heads.first().map_or(0.0, |head| head.delay.s());
    let noise = PointingNoise {
        nea_rad: nea_rad / heads.sqrt(),
        tracker_period_s: period_s,
        latency_s: latency_s + delay_s,
        gyro,
    };
    core::f64::consts::SQRT_2 * pointing.pointing_error(&noise).pointing_sigma_rad
}

fn check_event(event: &Event, heads: usize, wheels: usize) -> Result<(), LoopError> {
    use crate::config::Action;
    let what = crate::wiring::faults::action_name(&event.action);
    let refuse = |why: String| Err(LoopError::Event { what, why });
    match event.action {
        Action::Frame { head: Some(head), .. } | Action::TrackerOff { head: Some(head) } if head >= heads => {
            refuse(format!("head {head}: there are {heads}, counted from 0"))
        }
        Action::WheelFailure { wheel } if wheel >= wheels => {
            refuse(format!("wheel {wheel}: there are {wheels}, counted from 0"))
        }
        _ if event.at < Span::ZERO => refuse("wanted a time not before the first exposure".into()),
        _ => Ok(()),
    }
}
