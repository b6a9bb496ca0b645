//! Assembles every run, on either clock and with any plant.
//!
//! ```text
//! Scenario + RunOptions -> Run { heads with sinks, fault desk, taps, clock } -> connect -> Run::fly      real clock
//!                                                                                       -> SteppedRun    virtual clock
//! ```
//!
//! Order: memory is added up; heads (engine, faults) and their receiver are made; then their sinks, on the run's clock; around
//! the sinks the trackers' taps, the capture and the live view; the cable and the far end when the run connects; the
//! events of the file last. Tests: `tests/closed_loop`, above all `matrix`.

use crate::runtime::receiver::Receiver;
use crate::runtime::{Head, Hygiene, Imager, tracker_in::TrackerIn};
use crate::wiring::faults::{FaultDesk, Inventory, in_order_of_placing, lock};
use crate::wiring::heads::{CostsHere, HeadSetting, make_heads, make_receiver, size_of, take_sink};
use crate::wiring::memory::{RunForm, RunMemory};
use crate::wiring::ports::{Cable, arm, is_unreachable, needs_real_clock};
use crate::wiring::run_clock::{RunClock, RunClockKind, RunTimes, note_lag, planned_start, start_clock};
use crate::wiring::sinks::{directory_of_head, make_sinks};
use crate::wiring::taps::{CaptureOptions, LiveOptions, LiveTap, Taps};
use crate::wiring::tracker_ins::open_trackers;
use crate::wiring::tracker_outs::{TrackerOuts, WaitingOut, tap_heads};
use crate::wiring::{
    cable::CableSetting, error::Result, far_side::FarSide, sink_setting::SinkSetting, steering::Steering,
};
use anyhow::Context;
use base::time::{Span, Tai};
use config::{Scenario, SinkSettings};
use core::cell::RefCell;
use frames::camera_control::{CameraDesk, desk};
use frames::sink::{NullSink, SentFrame, Sink};
use link::tap::FaultControl;
use outputs::live::Numbers;
use std::path::PathBuf;
use std::sync::{Arc, Mutex};
use testbed::vehicle::TelemetryRow;

/// Destination of the frames.
pub enum Outputs<'a> {
    /// These sinks, with files below this directory.
    Configured {
        /// Kinds and settings.
        sinks: &'a [SinkSettings],
        /// Directory of the run; `None`: no sink keeps files.
        directory: Option<PathBuf>,
    },
    /// Sinks that are made by a function for each head.
    Made(&'a mut dyn FnMut(usize) -> Box<dyn Sink>),
}

/// Options that are not in the run's file.
pub struct RunOptions<'a> {
    /// Clock of the run.
    pub clock: RunClockKind,
    /// Destination of the frames.
    pub outputs: Outputs<'a>,
    /// Costs measured on this machine, for the real clock; `None`: the built-in ones.
    pub costs: Option<CostsHere<'a>>,
    /// Requests of the threads to the operating system, on the real clock.
    pub hygiene: Option<Arc<Hygiene>>,
    /// The capture, if one is made.
    pub capture: Option<CaptureOptions<'a>>,
    /// The live view, if there is one.
    pub live: Option<LiveOptions>,
    /// Control from outside on the real clock.
    pub steering: Option<Steering>,
    /// True when events may come from outside during the run, also on the virtual clock; so may samples of an external
    /// plant.
    pub is_controlled: bool,
}

impl<'a> RunOptions<'a> {
    /// Returns options of a run on the virtual clock with these outputs and nothing else.
    pub fn stepped(outputs: Outputs<'a>) -> Self {
        let (costs, hygiene, capture, live, steering) = (None, None, None, None, None);
        let (clock, is_controlled) = (RunClockKind::Virtual, false);
        Self { clock, outputs, costs, hygiene, capture, live, steering, is_controlled }
    }

    /// Returns options of a run on the real clock with these outputs and nothing else.
    pub fn real(outputs: Outputs<'a>) -> Self {
        Self { clock: RunClockKind::Real, ..Self::stepped(outputs) }
    }
}

/// An assembled run.
pub struct Run {
    /// The scenario.
    pub scenario: Scenario,
    /// The instants of the run.
    pub times: RunTimes,
    pub(super) clock: RunClock,
    /// The heads, the first one first; at least one.
    pub heads: Vec<Head>,
    pub(super) receiver: Receiver,
    pub(super) desk: Arc<Mutex<FaultDesk>>,
    pub(super) faults_of_bus: [FaultControl; 2],
    pub(super) hygiene: Option<Arc<Hygiene>>,
    pub(super) taps: Taps,
    pub(super) on_row: Option<OnRow>,
    pub(super) steering: Option<Steering>,
    is_controlled: bool,
    pub(super) cable: Option<Cable>,
    /// Trackers whose lines are not open yet.
    waiting_outs: Vec<WaitingOut>,
    /// Trackers whose lines are open.
    pub(super) outs: TrackerOuts,
    /// Star trackers outside, until the far end takes them.
    trackers: Vec<TrackerIn>,
    /// Delay of the bench's clock behind the machine's clock, if it was to start at the machine's time.
    lag: Span,
}

/// Callback for rows of telemetry.
pub type OnRow = Box<dyn FnMut(&TelemetryRow) + Send>;

impl Run {
    /// Assembles a run: everything except the cable, which [`Self::connect`] opens.
    ///
    /// # Errors
    /// The first part that cannot be made.
    pub fn assemble(scenario: &Scenario, options: RunOptions<'_>) -> Result<Self> {
        let scenario = scenario.clone();
        let RunOptions { clock, mut outputs, costs, hygiene, capture, live, steering, is_controlled } = options;
        if let (RunClockKind::Virtual, Some(what)) = (clock, needs_real_clock(&scenario.bench)) {
            let why = "which has a time of its own; wanted --clock real";
            return Err(anyhow::anyhow!("--clock virtual: got a bench with {what}, {why}").into());
        }
        if let Some(why) = is_unreachable(&scenario.bench, is_controlled) {
            return Err(anyhow::anyhow!(why).into());
        }
        check_memory(&scenario, &outputs, clock, live.is_some())?;
        let start = planned_start(scenario.bench.timing.start, clock);
        let mut no_costs = |_: &Imager| None;
        let costs: Option<CostsHere<'_>> = match (clock, costs) {
            (RunClockKind::Real, Some(costs)) => Some(costs),
            (RunClockKind::Real, None) => Some(&mut no_costs),
            (RunClockKind::Virtual, _) => None,
        };
        let mut heads = make_heads(HeadSetting { scenario: &scenario, start, costs })?;
        let receiver = make_receiver(&scenario, &heads)?;
        arm(&scenario.bench, &mut heads)?;
        let clock = RunClock::new(clock, start);
        let count = heads.iter().filter(|head| head.is_shown).count();
        for (number, head) in heads.iter_mut().enumerate() {
            let sink = sink_of_head(head, (number, count), &mut outputs, &clock)?;
            take_sink(head, sink);
        }
        let outs = match &outputs {
            Outputs::Configured { directory, .. } => tap_heads(&scenario, &mut heads, start, directory.as_deref())?,
            Outputs::Made(_) => Vec::new(),
        };
        let times = times(start, &heads)?;
        let there = Inventory {
            heads: heads.iter().map(size_of).collect(),
            wheels: scenario.vehicle().map(|vehicle| vehicle.spacecraft.params.wheels.len()),
        };
        let faults_of_bus = [FaultControl::default(), FaultControl::default()];
        let desk = FaultDesk::new(times.zero, scenario.bench.sensor_from_body, there, faults_of_bus.clone());
        scenario.events.iter().try_for_each(|event| desk.check(event))?;
        let live = live.map(|live| LiveTap::beside(&live, &scenario.bench, &mut heads)).transpose()?;
        // Last: a run that cannot be assembled leaves no capture behind.
        let recording = capture.map(|capture| capture.start(&scenario, start, &clock, &mut heads)).transpose();
        let recording = recording.context("the capture")?;
        if let Some(steering) = &steering {
            steering.watch_frames(&mut heads);
        }
        let (taps, on_row, cable) = (Taps { recording, live }, None, None);
        Ok(Self {
            scenario,
            times,
            clock,
            heads,
            receiver,
            desk: Arc::new(Mutex::new(desk)),
            faults_of_bus,
            hygiene,
            taps,
            on_row,
            steering,
            is_controlled,
            waiting_outs: outs,
            outs: TrackerOuts::default(),
            trackers: Vec::new(),
            cable,
            lag: Span::ZERO,
        })
    }

    /// Opens the cable. On the real clock the run's time starts here.
    ///
    /// # Errors
    /// When a link cannot be opened.
    pub fn connect(&mut self) -> Result<()> {
        if self.cable.is_some() {
            return Ok(());
        }
        if let RunClock::Real(clock) = &self.clock {
            // Later than the start of the sinks, which takes time.
            self.lag = start_clock(clock, self.scenario.bench.timing.start, self.times.start);
        }
        let setting = CableSetting {
            scenario: &self.scenario,
            clock: &self.clock,
            faults: &self.faults_of_bus,
            recording: self.taps.recording.as_ref(),
            is_steered: self.is_controlled || self.steering.is_some(),
        };
        let cable = Cable::open(&setting)?;
        let waiting = core::mem::take(&mut self.waiting_outs);
        self.outs = TrackerOuts::open(waiting, cable.bus.as_ref(), &self.clock, self.times)?;
        self.trackers = open_trackers(&self.scenario.bench, &mut self.heads, cable.bus.as_ref(), &self.clock)?;
        self.cable = Some(cable);
        Ok(())
    }

    /// Sets a callback for every row of telemetry, if a spacecraft is flown.
    pub fn on_row(&mut self, on_row: OnRow) {
        self.on_row = Some(on_row);
    }

    /// Returns the far end, with the events of the file placed.
    pub(super) fn far_side(&mut self) -> Result<FarSide> {
        self.connect()?;
        let port = self.cable.as_mut().and_then(|cable| cable.far.take());
        let trackers = self.heads.iter_mut().filter_map(|head| head.tracker.take()).collect();
        let mountings = self.heads.iter().map(|head| head.mounting).collect();
        let desks = self.tracker_desks();
        let mut far = FarSide::new(&self.scenario, port, (trackers, desks), (self.times, mountings))?;
        far.add_trackers(core::mem::take(&mut self.trackers));
        if let Some(on_row) = self.on_row.take() {
            far.on_row = on_row;
        }
        Ok(far)
    }

    /// Returns the queues by which the trackers of an internal spacecraft command their cameras; none without such
    /// commands.
    fn tracker_desks(&mut self) -> Vec<CameraDesk> {
        let commands = self.scenario.vehicle().map(|vehicle| vehicle.tracker_commands).unwrap_or_default();
        let heads = self.heads.iter_mut().filter(|_| commands.any());
        heads
            .map(|head| {
                let (desk, end) = desk();
                head.engine.exposing.add_desk(end);
                desk
            })
            .collect()
    }

    /// Places the events of the file; returns their ledger events.
    pub(super) fn place_events(&mut self, far: &mut FarSide) -> Result<Vec<crate::runtime::ledger::Event>> {
        let mut notes = Vec::new();
        for event in in_order_of_placing(&self.scenario.events) {
            let frames = self.heads.iter_mut().map(|head| &mut head.faults).collect();
            let placed = lock(&self.desk).place(event, self.times.start, frames);
            notes.extend(placed.note);
            far.take_event(placed, self.times.zero);
        }
        for head in &mut self.heads {
            head.faults.prepare(&mut head.engine)?;
        }
        Ok(notes)
    }

    /// Returns the number of frames of all heads in the whole run.
    pub fn frames(&self) -> u64 {
        self.heads.iter().map(|head| u64::from(head.engine.params.frames)).sum()
    }

    /// Returns the destination of the live view's numbers, if there is a live view.
    pub fn numbers(&self) -> Option<Numbers> {
        self.taps.live.as_ref().map(LiveTap::numbers)
    }

    /// Returns notes for the user to read before the run starts, a sentence each.
    pub fn notes(&self) -> Vec<String> {
        let cable = self.cable.as_ref().map(Cable::notes).unwrap_or_default();
        let live = self.taps.live.as_ref().map(LiveTap::notes).unwrap_or_default();
        let trackers = self.trackers.iter().map(TrackerIn::words);
        let notes = note_lag(self.lag).into_iter().chain(live).chain(cable);
        notes.chain(self.outs.notes().to_vec()).chain(trackers).collect()
    }
}

/// Refuses a run that needs more memory than is available, before any of it is allocated.
fn check_memory(scenario: &Scenario, outputs: &Outputs<'_>, clock: RunClockKind, has_view: bool) -> Result<()> {
    let sinks: &[SinkSettings] = match outputs {
        Outputs::Configured { sinks, .. } => sinks,
        Outputs::Made(_) => &[],
    };
    let form = RunForm { is_real: clock == RunClockKind::Real, has_view };
    RunMemory::of(&scenario.bench, sinks, form).check().map_err(anyhow::Error::from)?;
    Ok(())
}

/// Returns the instants of a run: from the first exposure of the first head to the end of the last frame of any.
fn times(start: Tai, heads: &[Head]) -> Result<RunTimes> {
    let params = || heads.iter().map(|head| &head.engine.params);
    let zero = params().next().map(|params| params.first_exposure).context("a run without a head")?;
    let end = params().map(|params| params.exposure_start(params.frames)).max().unwrap_or(zero);
    Ok(RunTimes { start, zero, end })
}

/// Returns the sink for the frames of one head.
fn sink_of_head(
    head: &mut Head,
    (number, count): (usize, usize),
    outputs: &mut Outputs<'_>,
    clock: &RunClock,
) -> Result<Box<dyn Sink>> {
    if !head.is_shown {
        return Ok(Box::new(NullSink::new()));
    }
    let (sinks, directory) = match outputs {
        Outputs::Made(make) => return Ok(make(number)),
        Outputs::Configured { sinks, directory } => (*sinks, directory.as_deref()),
    };
    let params = &head.engine.params;
    let camera = &params.camera;
    let [width, height] = camera.output().size_px;
    let desks = RefCell::new(Vec::new());
    let prototype =
        &SentFrame::with_capacity(width, height, crate::runtime::real_time::STARS_AT_FIRST, camera.name.clone());
    let which = (count > 1).then_some(number);
    let directory = directory.map(|run| directory_of_head(run, which));
    let setting = SinkSetting {
        directory: directory.as_deref(),
        prototype,
        head: which,
        is_real: matches!(clock, RunClock::Real(_)),
        camera,
        frame_period: params.frame_period,
        calibration: head.calibration.as_ref(),
        clock: &clock.shared(),
        commands: Some((&head.engine.exposing, &desks)),
    };
    let place = || which.map_or_else(|| "the sinks".to_owned(), |head| format!("head {head}"));
    let made = make_sinks(sinks, &setting).with_context(place)?;
    desks.into_inner().into_iter().for_each(|desk| head.engine.exposing.add_desk(desk));
    Ok(made)
}
