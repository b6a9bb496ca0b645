//! A scenario's events, distributed to the places where they act (bus, frames, vehicle), and their results.
//!
//! Checks and places the events of a run, before and during the run; the same on both clocks.
//!
//! In: an event, and the faults of each head's frames. Out: actions and expectations for the far side (`Placed`).
//! Faults of the bus go to the links' own lists. Tests: of `faults`, and `tests/closed_loop`.

use crate::runtime::frame_faults::{Begin, FrameFaults, NEVER};
use crate::runtime::{EventKind, Head, RunError};
use crate::runtime::{ledger::Event as LedgerEvent, receiver::Receiver};
use crate::wiring::error::{LoopError, Result};
use crate::wiring::vehicle_parts::attitude;
use base::axes::{Body, Rotation, Sensor};
use base::time::{Span, Tai};
use config::{Action, Event, link_flag};
use frames::sink::{FrameFault, PixelsOf};
use link::tap::{FaultControl, LinkFault};
use serde::Serialize;
use std::sync::{Mutex, MutexGuard, PoisonError};
use testbed::{acs::Command, vehicle::VehicleFault};

/// Time by which delayed packets and the error of the flight computer's clock estimate outlast a fault of the bus.
const BUS_AFTERMATH: Span = Span::from_ms(2000);

/// An action aboard the vehicle at an instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Aboard {
    /// A fault starts.
    Inject {
        /// The fault.
        fault: VehicleFault,
        /// Its number in the log.
        number: usize,
    },
    /// A fault ends.
    Clear {
        /// The fault.
        fault: VehicleFault,
        /// Its number in the log.
        number: usize,
    },
    /// A command from the ground.
    Command(Command),
}

/// Where a fault acts, and its number there.
#[derive(Debug, Clone, PartialEq)]
enum Place {
    BusToStimulator(usize),
    BusToComputer(usize),
    /// Number per head; `None` for unaffected heads.
    Frames(Vec<Option<usize>>),
    Aboard(usize),
}

/// One fault with its times.
#[derive(Debug, Clone, PartialEq)]
pub struct LoggedFault {
    /// Name in scenario files.
    pub name: &'static str,
    /// Start.
    pub from: Tai,
    /// End; equal to the start for permanent faults.
    pub until: Tai,
    /// Trigger that it waits for, and the delay from the trigger to its start.
    trigger: Option<(u16, Span)>,
    lasts: Span,
    place: Place,
}

/// A fault in the form used by reports.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct FaultLine {
    /// Name in scenario files.
    pub name: &'static str,
    /// Start, s after the first exposure.
    pub from_s: f64,
    /// End, s after the first exposure.
    pub until_s: f64,
    /// Number of packets, frames or times that it hit.
    pub hits: u64,
}

/// Every fault of a run.
#[derive(Debug, Default)]
pub struct FaultLog {
    faults: Vec<LoggedFault>,
}

/// The places where faults act.
pub struct Places<'a> {
    /// Faults of what the stimulator receives.
    pub to_stimulator: &'a FaultControl,
    /// Faults of what the flight computer receives.
    pub to_computer: &'a FaultControl,
    /// Faults of each head's frames.
    pub frames: Vec<&'a mut FrameFaults>,
}

impl FaultLog {
    /// Places one event where it acts, its time counted from `zero`. Actions of the vehicle's side are added to
    /// `aboard`.
    pub fn place(
        &mut self,
        event: &Event,
        zero: Tai,
        head: &Rotation<Sensor, Body>,
        places: &mut Places<'_>,
        aboard: &mut Vec<(Tai, Aboard)>,
    ) {
        let (from, until) = (zero + event.at, zero + event.at + event.lasts);
        let place = match event.action {
            Action::Slew(pointing) => {
                let target = head.inverse() * attitude(&pointing);
                return aboard.push((from, Aboard::Command(Command::SlewTo(target))));
            }
            Action::Safe => return aboard.push((from, Aboard::Command(Command::Safe))),
            Action::Resume => return aboard.push((from, Aboard::Command(Command::Resume))),
            Action::Bus(fault) => {
                for frames in &mut places.frames {
                    frames.mark(from, until + BUS_AFTERMATH, link_flag(&fault));
                }
                Place::BusToStimulator(places.to_stimulator.add(from, until, fault))
            }
            Action::BusBackLoss { share } => {
                Place::BusToComputer(places.to_computer.add(from, until, LinkFault::Loss { share }))
            }
            Action::Frame { head, fault } => {
                let number = u16::try_from(self.faults.len() + 1).unwrap_or(u16::MAX);
                let begin = match event.on_trigger {
                    None => Begin::At(from),
                    Some(number) => Begin::OnTrigger { number, delay: event.at },
                };
                let add = |(i, faults): (usize, &mut &mut FrameFaults)| {
                    head.is_none_or(|head| head == i).then(|| faults.arm(begin, event.lasts, fault, number))
                };
                Place::Frames(places.frames.iter_mut().enumerate().map(add).collect())
            }
            Action::Trigger { number } => {
                for frames in &mut places.frames {
                    frames.fire_trigger(number, from);
                }
                return self.fire(number, from);
            }
            Action::Aboard(fault) => {
                let number = self.faults.len();
                aboard.push((from, Aboard::Inject { fault, number }));
                if event.lasts > Span::ZERO {
                    aboard.push((until, Aboard::Clear { fault, number }));
                }
                Place::Aboard(number)
            }
        };
        let trigger = event.on_trigger.map(|number| (number, event.at));
        let (from, until) = if trigger.is_some() { (NEVER, NEVER) } else { (from, until) };
        let (name, lasts) = (event.action.word(), event.lasts);
        self.faults.push(LoggedFault { name, from, until, trigger, lasts, place });
    }

    /// Starts the faults that wait for this trigger, after `at`.
    fn fire(&mut self, number: u16, at: Tai) {
        for fault in &mut self.faults {
            if let Some((own, delay)) = fault.trigger
                && own == number
            {
                (fault.from, fault.until) = (at + delay, at + delay + fault.lasts);
            }
        }
    }

    /// Returns the start and end of the faults that wait for this trigger.
    pub fn triggered_by(&self, number: u16) -> impl Iterator<Item = (Tai, Tai)> + '_ {
        let waits = move |fault: &&LoggedFault| fault.trigger.is_some_and(|(own, _)| own == number);
        self.faults.iter().filter(waits).map(|fault| (fault.from, fault.until))
    }

    /// Returns every fault so far.
    pub fn faults(&self) -> &[LoggedFault] {
        &self.faults
    }

    /// Returns every fault in the form used by reports, its times counted from `zero`.
    pub fn lines(&self, zero: Tai, places: &PlacesRead<'_>) -> Vec<FaultLine> {
        let after_zero_s = |at: Tai| if at == NEVER { f64::INFINITY } else { (at - zero).s() };
        let line = |fault: &LoggedFault| {
            let (from, until) = fault.times(places);
            let hits = self.hits(fault, places);
            FaultLine { name: fault.name, from_s: after_zero_s(from), until_s: after_zero_s(until), hits }
        };
        self.faults.iter().map(line).collect()
    }

    /// Returns how often a fault hit: packets, frames, gyro samples.
    pub fn hits(&self, fault: &LoggedFault, places: &PlacesRead<'_>) -> u64 {
        match &fault.place {
            Place::BusToStimulator(i) => places.to_stimulator.timed().get(*i).map_or(0, |timed| timed.hits),
            Place::BusToComputer(i) => places.to_computer.timed().get(*i).map_or(0, |timed| timed.hits),
            Place::Frames(numbers) => {
                let of = |(faults, number): (&&FrameFaults, &Option<usize>)| {
                    number.and_then(|number| faults.timed().get(number)).map_or(0, |timed| timed.hits)
                };
                places.frames.iter().zip(numbers).map(of).sum()
            }
            Place::Aboard(number) => (places.aboard)(*number),
        }
    }
}

impl LoggedFault {
    /// Returns the ledger event of the fault.
    ///
    /// `None` for faults of frames, which write their own events with the frame in which they start and end.
    pub fn ledger_event(&self) -> Option<LedgerEvent> {
        let event = LedgerEvent::new(EventKind::Fault, self.from, None, self.until - self.from);
        (!matches!(self.place, Place::Frames(_))).then_some(LedgerEvent { what: self.name, ..event })
    }

    /// Returns the start and end; for a fault that waits for a trigger, those of the frames' lists.
    fn times(&self, places: &PlacesRead<'_>) -> (Tai, Tai) {
        let Place::Frames(numbers) = &self.place else { return (self.from, self.until) };
        let timed = places.frames.iter().zip(numbers).find_map(|(faults, number)| faults.timed().get((*number)?));
        timed.map_or((self.from, self.until), |timed| (timed.from, timed.until))
    }
}

/// The places where faults act, read only.
pub struct PlacesRead<'a> {
    /// See [`Places`].
    pub to_stimulator: &'a FaultControl,
    /// See [`Places`].
    pub to_computer: &'a FaultControl,
    /// See [`Places`].
    pub frames: Vec<&'a FrameFaults>,
    /// Returns the hits of a fault aboard by its number in the log.
    pub aboard: &'a dyn Fn(usize) -> u64,
}

/// Hardware that exists in a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Inventory {
    /// Each head's detector and images.
    pub heads: Vec<HeadSize>,
    /// Number of wheels of the flown spacecraft; `None` without a spacecraft.
    pub wheels: Option<usize>,
}

/// Sizes of one head.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct HeadSize {
    /// Columns and rows of the detector.
    pub size_px: [usize; 2],
    /// Columns and rows of its images.
    pub output_px: [usize; 2],
}

/// Refuses an event that names a head, wheel or pixel that does not exist, with the reason.
pub(super) fn check_places(event: &Event, there: &Inventory) -> Result<(), String> {
    let heads = there.heads.len();
    let wheels = match there.wheels {
        None if event.action.is_aboard() => return Err("nothing is flown: it needs a simulated spacecraft".into()),
        wheels => wheels.unwrap_or(0),
    };
    if let Action::Frame { head, fault } = event.action {
        let hit = there.heads.iter().enumerate().filter(|(number, _)| head.is_none_or(|head| head == *number));
        for (_, size) in hit {
            check_pixels(fault, *size)?;
        }
    }
    if let Action::Frame { head: Some(head), .. } | Action::Aboard(VehicleFault::TrackerOff(Some(head))) = event.action
        && head >= heads
    {
        return Err(format!("head {head}: there are {heads}, counted from 0"));
    }
    if let Action::Aboard(VehicleFault::WheelFailure(wheel)) = event.action
        && wheel >= wheels
    {
        return Err(format!("wheel {wheel}: there are {wheels}, counted from 0"));
    }
    let is_before = event.at < Span::ZERO;
    if is_before { Err("wanted a time not before the first exposure".into()) } else { Ok(()) }
}

/// Refuses pixels that a head does not have.
fn check_pixels(fault: FrameFault, HeadSize { size_px, output_px }: HeadSize) -> Result<(), String> {
    let Some((of, spots)) = fault.spots() else { return Ok(()) };
    let (what, size) = match of {
        PixelsOf::Images => ("images have", output_px),
        PixelsOf::Detector => ("the detector has", size_px),
    };
    let [width, height] = size;
    let refusal = || Err(format!("{spots}: {what} {width} x {height} pixels, counted from 0"));
    if spots.are_outside(size) { refusal() } else { Ok(()) }
}

/// The faults of a run, and where they act.
#[derive(Debug)]
pub(super) struct FaultDesk {
    log: FaultLog,
    to_stimulator: FaultControl,
    to_computer: FaultControl,
    zero: Tai,
    mounting: Rotation<Sensor, Body>,
    there: Inventory,
}

/// An event that was placed: actions and expectations for the far side.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Placed {
    /// The event.
    pub(super) event: Event,
    /// Actions aboard with their times.
    pub(super) aboard: Vec<(Tai, Aboard)>,
    /// Start and end of disturbances of pointing or frames.
    pub(super) disturbances: Vec<(Tai, Tai)>,
    /// Ledger event; `None` for faults of frames, which write it themselves.
    pub(super) note: Option<LedgerEvent>,
}

impl FaultDesk {
    /// Returns the faults of a run whose first exposure is at `zero`; `mounting` is that of the first head.
    pub(super) fn new(
        zero: Tai,
        mounting: Rotation<Sensor, Body>,
        there: Inventory,
        [to_stimulator, to_computer]: [FaultControl; 2],
    ) -> Self {
        Self { log: FaultLog::default(), to_stimulator, to_computer, zero, mounting, there }
    }

    /// Refuses an event that names a head, wheel or pixel that does not exist, or needs a spacecraft that is not flown.
    ///
    /// # Errors
    /// When the event is invalid, with the reason.
    pub(super) fn check(&self, event: &Event) -> Result<()> {
        check_places(event, &self.there).map_err(|why| LoopError::Event { what: event.action.word(), why })
    }

    /// Places an event where it acts. An event whose time is before `now` starts at once.
    pub(super) fn place(&mut self, event: &Event, now: Tai, frames: Vec<&mut FrameFaults>) -> Placed {
        let mut event = *event;
        if event.on_trigger.is_none() {
            event.at = event.at.max(now - self.zero);
        }
        let (before, mut aboard) = (self.log.faults().len(), Vec::new());
        let mut places = Places { to_stimulator: &self.to_stimulator, to_computer: &self.to_computer, frames };
        self.log.place(&event, self.zero, &self.mounting, &mut places, &mut aboard);
        let mut disturbances = Vec::new();
        if let Action::Trigger { number } = event.action {
            disturbances.extend(self.log.triggered_by(number));
        }
        let fault = self.log.faults().get(before);
        disturbances.extend(fault.filter(|_| event.on_trigger.is_none()).map(|fault| (fault.from, fault.until)));
        Placed { event, aboard, disturbances, note: fault.and_then(LoggedFault::ledger_event) }
    }

    /// Returns every fault so far with its hits; `aboard` returns the hits of a fault aboard by its number.
    pub(super) fn lines(&self, frames: Vec<&FrameFaults>, aboard: &dyn Fn(usize) -> u64) -> Vec<FaultLine> {
        let (to_stimulator, to_computer) = (&self.to_stimulator, &self.to_computer);
        self.log.lines(self.zero, &PlacesRead { to_stimulator, to_computer, frames, aboard })
    }
}

/// Returns events in the order in which they are placed: a trigger must find the faults that wait for it.
pub(super) fn in_order_of_placing(events: &[Event]) -> impl Iterator<Item = &Event> {
    let is_trigger = |event: &&Event| matches!(event.action, Action::Trigger { .. });
    events.iter().filter(move |event| !is_trigger(event)).chain(events.iter().filter(is_trigger))
}

/// Prepares what an event needs in the heads and their receiver, so that no frame waits for it later.
///
/// # Errors
/// When the tables of other optics cannot be made.
pub(super) fn make_ready<'a>(
    event: &Event,
    mut heads: impl Iterator<Item = &'a mut Head>,
    receiver: &mut Receiver,
) -> Result<(), RunError> {
    event.on_trigger.into_iter().for_each(|number| receiver.session.expect_trigger(number));
    heads.try_for_each(|Head { engine, faults, .. }| faults.prepare(engine))
}

/// Locks what threads share, also after one of them has panicked.
pub(super) fn lock<T>(shared: &Mutex<T>) -> MutexGuard<'_, T> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}
