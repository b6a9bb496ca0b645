//! The closed loop on the bench clock: the vehicle flies in a thread of its own, the frames are late when they are late.
//!
//! Faults act as on the virtual clock; frames that a fault delays keep their buffers, of which each head has four: a delay
//! beyond three frames loses some, counted. Frames go to the trackers as the sink threads deliver them; the vehicle looks
//! every `POLL`.

use crate::runtime::error::FarEndError;
use crate::runtime::frame_faults::FrameFaults;
use crate::runtime::hygiene::{Hygiene, Role};
use crate::runtime::real_time::Head;
use crate::runtime::{RunError, RunParams, RunRecord, real_time};
use crate::wiring::closed_loop::LoopError;
use crate::wiring::far_side::FarSide;
use crate::wiring::faults::{FaultLine, FaultLog, Inventory, LoggedFault, Places, PlacesRead, check_places};
use crate::wiring::loop_outcome::{LoopOutcome, predicted_pointing_rad, vehicle_counts};
use crate::wiring::loop_parts::{loop_head, ports};
use base::axes::Rotation;
use base::clock::{Clock, Monotonic};
use base::time::{Span, Tai};
use config::{Action, Event, Scenario, StartTime};
use core::sync::atomic::{AtomicBool, Ordering};
use crossbeam_channel::{Receiver as Queue, bounded};
use frames::sink::{FrameMeta, SentFrame, Sink};
use link::tap::FaultControl;
use scene::camera::CameraParams;
use std::sync::Arc;
use std::thread::JoinHandle;
use testbed::vehicle::TelemetryRow;

/// The vehicle's thread looks for frames this often.
const POLL: Span = Span::from_ms(2);
/// Frames whose attitude waits to be held against the truth.
const TOLD_FRAMES: usize = 64;

/// What a run on the bench clock is given beside its scenario.
pub struct RealSetting<'a> {
    /// The clock of the run, which its sinks read too; it is set to the scenario's start when all is made.
    pub clock: &'a Arc<Monotonic>,
    /// Set by whoever wants the run to end.
    pub stop: &'a Arc<AtomicBool>,
    /// What threads ask of the system; `None`: nothing.
    pub hygiene: Option<&'a Arc<Hygiene>>,
    /// Frames whose times are kept one by one.
    pub ring_frames: usize,
}

/// Runs `scenario` on the bench clock, with a sink per head. `change` sees each head's parameters before they are used;
/// `on_row` every row of telemetry; `progress` every frame.
///
/// # Errors
/// When a part of the loop cannot be made or failed.
pub fn run_real(
    scenario: &Scenario,
    sinks: Vec<Box<dyn Sink>>,
    setting: &RealSetting<'_>,
    mut change: impl FnMut(&mut RunParams),
    on_row: Box<dyn FnMut(&TelemetryRow) + Send>,
    progress: &mut dyn FnMut(&SentFrame, &RunRecord),
) -> Result<LoopOutcome, LoopError> {
    let start = match scenario.bench.timing.start {
        StartTime::At(at) => at,
        StartTime::Now => Monotonic::start().now(),
    };
    let (mut drawing, mut tapped, mut taps, mut faults) = (Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut shared = None;
    for ((number, mounting), sink) in scenario.heads.iter().enumerate().zip(sinks) {
        let (head, tap) = loop_head(scenario, number, mounting, start, sink, &mut shared, &mut change)?;
        drawing.push((head.engine, head.receiver));
        tapped.push(head.sink);
        taps.push(tap);
        faults.push(head.faults);
    }
    let Some(params) = drawing.first().map(|(engine, _)| engine.params().clone()) else {
        return Err(LoopError::Parts("a scenario needs a head, and each head a sink".into()));
    };
    let (zero, end) = (params.first_exposure, params.exposure_start(params.frames));
    let [to_stimulator, to_computer] = [FaultControl::default(), FaultControl::default()];
    let mut made = Made { log: FaultLog::default(), to_stimulator, to_computer, frames: faults };
    setting.clock.restart_at(start);
    let clock: Arc<dyn Clock> = Arc::<Monotonic>::clone(setting.clock);
    let (near, far) = ports(scenario, &clock, &made.to_stimulator, &made.to_computer)?;
    let mut far = FarSide::new(scenario, far, taps, [start, zero, end])?;
    far.on_row = on_row;
    made.place_events(scenario, zero, &mut far, &params.camera)?;
    for (faults, (engine, _)) in made.frames.iter_mut().zip(&mut drawing) {
        faults.prepare(engine)?;
    }
    let over = Arc::new(AtomicBool::new(false));
    let (told, queue) = bounded::<(usize, FrameMeta)>(TOLD_FRAMES * drawing.len());
    let ends = Ends { over: Arc::clone(&over), stop: Arc::clone(setting.stop) };
    let thread = fly(far, Arc::clone(&clock), ends, queue, setting.hygiene.map(Arc::clone))?;
    let real = real_time::Setting {
        clock: &clock,
        stop: setting.stop,
        hygiene: setting.hygiene,
        ring_frames: setting.ring_frames,
    };
    let mut seen = |head: usize, frame: &SentFrame, record: &RunRecord| {
        let _the_witness_may_be_busy = told.try_send((head, frame.meta.clone()));
        progress(frame, record);
    };
    let parts = drawing.iter_mut().zip(tapped).zip(&mut made.frames);
    let heads = parts.map(|(((engine, receiver), sink), faults)| Head { engine, receiver, sink, faults: Some(faults) });
    let outcome = real_time::run_in(&real, heads.collect(), near.into(), &mut seen);
    let now = clock.now().min(end);
    over.store(true, Ordering::SeqCst);
    let far = joined(thread)?;
    let mut record = outcome.record;
    made.note_events(&mut record);
    if let Some(error) = outcome.error {
        return Err(error.into());
    }
    let faults = made.lines(zero, &far);
    let (estimator, untagged) = vehicle_counts(far.computer.vehicle());
    let predicted_pointing_rad = predicted_pointing_rad(far.computer.vehicle(), far.witness.assessment(), &params);
    let assessment = far.witness.finish(&record, &faults, now, 0);
    let simulated_s = (now - zero).s().max(0.0);
    let (sinks, sink_lines) = (outcome.summaries.into_iter().flatten().collect(), outcome.sinks);
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

/// The faults of a run and where they act.
struct Made {
    log: FaultLog,
    to_stimulator: FaultControl,
    to_computer: FaultControl,
    /// Of each head.
    frames: Vec<FrameFaults>,
}

impl Made {
    fn place_events(
        &mut self,
        scenario: &Scenario,
        zero: Tai,
        far: &mut FarSide,
        camera: &CameraParams,
    ) -> Result<(), LoopError> {
        let head = scenario.heads.first().copied().unwrap_or(Rotation::IDENTITY);
        let wheels = far.computer.vehicle().map_or(0, |vehicle| vehicle.wheel_speeds_rad_s().len());
        let (heads, size_px, output_px) = (self.frames.len(), camera.sensor_px(), camera.output().size_px);
        let there = Inventory { heads, wheels, size_px, output_px };
        let is_trigger = |event: &&Event| matches!(event.action, Action::Trigger { .. });
        let triggers = scenario.events.iter().filter(is_trigger);
        for event in scenario.events.iter().filter(|event| !is_trigger(event)).chain(triggers) {
            let what = event.action.word();
            check_places(event, there).map_err(|why| LoopError::Event { what, why })?;
            let Self { log, to_stimulator, to_computer, frames } = self;
            let mut places = Places { to_stimulator, to_computer, frames: frames.iter_mut().collect() };
            far.take_event(event, zero, &head, log, &mut places);
        }
        Ok(())
    }

    fn note_events(&self, record: &mut RunRecord) {
        for event in self.log.faults().iter().filter_map(LoggedFault::ledger_event) {
            record.ledger.note(event);
        }
    }

    fn lines(&self, zero: Tai, far: &FarSide) -> Vec<FaultLine> {
        let places = PlacesRead {
            to_stimulator: &self.to_stimulator,
            to_computer: &self.to_computer,
            frames: self.frames.iter().collect(),
            aboard: &|number| far.hits_aboard(number),
        };
        self.log.lines(zero, &places)
    }
}

/// Tells the vehicle's thread that the run is over, and the run that the vehicle's thread is.
struct Ends {
    over: Arc<AtomicBool>,
    stop: Arc<AtomicBool>,
}

impl Drop for Ends {
    /// A vehicle that ends before the run, by an error or a panic, ends the run.
    fn drop(&mut self) {
        if !self.over.load(Ordering::SeqCst) {
            self.stop.store(true, Ordering::SeqCst);
        }
    }
}

/// The vehicle's thread: flies until it is over, and comes back with all it has seen.
fn fly(
    mut far: FarSide,
    clock: Arc<dyn Clock>,
    ends: Ends,
    told: Queue<(usize, FrameMeta)>,
    hygiene: Option<Arc<Hygiene>>,
) -> Result<JoinHandle<Result<FarSide, FarEndError>>, LoopError> {
    let flight = move || {
        if let Some(hygiene) = hygiene {
            hygiene.enter(Role::FarEnd);
        }
        while !ends.over.load(Ordering::Relaxed) {
            let now = clock.now();
            let next = far.step(now)?;
            told.try_iter().for_each(|(head, meta)| far.witness_frame(head, &meta));
            clock.sleep_until(next.min(now + POLL));
        }
        Ok(far)
    };
    let thread = std::thread::Builder::new().name("vehicle".into()).spawn(flight);
    thread.map_err(|source| RunError::Thread { name: "vehicle", source }.into())
}

fn joined(thread: JoinHandle<Result<FarSide, FarEndError>>) -> Result<FarSide, LoopError> {
    match thread.join() {
        Ok(Ok(far)) => Ok(far),
        Ok(Err(error)) => Err(RunError::FarEnd(error).into()),
        Err(_panicked) => Err(RunError::ThreadLost { name: "vehicle" }.into()),
    }
}
