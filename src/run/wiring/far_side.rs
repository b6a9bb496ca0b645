//! The far end of the cable and its observers: flight computer, vehicle, trackers' frames, events, witness.
//!
//! The owner of the clock steps it; it never reads a clock itself.

use crate::runtime::tracker_in::{Answer, TrackerIn};
use crate::runtime::{error::FarEndError, frame_faults::NEVER, outside_tracker::commands_of};
use crate::wiring::error::{LoopError, Result};
use crate::wiring::faults::{Aboard, Placed};
use crate::wiring::{bench_parts, run_clock::RunTimes, vehicle_parts::vehicle_params, witness::Witness};
use base::axes::{Body, Rotation, Sensor};
use base::refused::Refused;
use base::time::{Span, Tai};
use config::{Action, Event, Plant, Scenario};
use frames::sink::{FrameMeta, TapEnd};
use frames::{camera_control::CameraDesk, sink::tap::TappedFrame};
use link::{Port, tap::Arrival};
use testbed::flight_computer::{FlightComputer, FlightError};
use testbed::tracker::Exposed;
use testbed::vehicle::{TelemetryRow, Vehicle, VehicleFault};

/// A fault aboard that has started, with its kind's number of hits at its start and end.
struct Watched {
    number: usize,
    fault: VehicleFault,
    began_at: u64,
    ended_at: Option<u64>,
}

/// Longest time that a frame waits for its time tag, which comes over the bus.
const TAG_WAIT: Span = Span::from_ms(50);

/// The far end of the cable: flight computer, vehicle, and their observers.
pub(super) struct FarSide {
    /// Its end of the cable and the simulated flight computer there; `None` when the flight computer is external.
    simulated: Option<(Port, FlightComputer)>,
    pub(super) taps: Vec<TapEnd>,
    /// Queues to the exposures of the heads whose trackers command them, in the order of the heads.
    desks: Vec<CameraDesk>,
    /// Time to slew half a turn plus half a turn around the Sun at the spacecraft's slew rate, and to settle.
    longest_slew: Span,
    /// Faults aboard that have begun.
    watched: Vec<Watched>,
    /// Frames that came before their time tag, each with its deadline and head.
    waiting: Vec<(Tai, usize, TappedFrame)>,
    /// Star trackers outside.
    trackers: Vec<TrackerIn>,
    /// Their answers that go aboard next.
    answers: Vec<Answer>,
    /// Faults and commands aboard, the next one last.
    pub(super) aboard: Vec<(Tai, Aboard)>,
    pub(super) witness: Witness,
    pub(super) on_row: Box<dyn FnMut(&TelemetryRow) + Send>,
}

impl FarSide {
    /// Returns the far end of a run with these times and mountings of the heads; `port` is its end of the cable, if
    /// it is simulated.
    pub(super) fn new(
        scenario: &Scenario,
        port: Option<Port>,
        (taps, desks): (Vec<TapEnd>, Vec<CameraDesk>),
        (times, mountings): (RunTimes, Vec<Rotation<Sensor, Body>>),
    ) -> Result<Self, Refused> {
        let RunTimes { start, zero, end } = times;
        let mut params = bench_parts::flight_computer_of(&scenario.plant, &scenario.bench, start, zero);
        let computer = match &scenario.plant {
            Plant::Outside => None,
            Plant::FlightComputer | Plant::File(_) => Some(FlightComputer::new(params)),
            Plant::Vehicle(vehicle) => {
                params.jitter_lines.clear();
                let vehicle = Vehicle::new(vehicle_params(scenario, vehicle, zero), start)?;
                Some(FlightComputer::flying(params, vehicle))
            }
        };
        Ok(Self {
            simulated: port.zip(computer),
            taps,
            desks,
            waiting: Vec::new(),
            watched: Vec::new(),
            trackers: Vec::new(),
            answers: Vec::new(),
            longest_slew: scenario.vehicle().map_or(Span::ZERO, longest_slew),
            aboard: Vec::new(),
            witness: Witness::new(scenario, mountings, zero, end),
            on_row: Box::new(|_| {}),
        })
    }

    /// Adds star trackers outside: each takes the place of the spacecraft's own at its head, if there is one.
    pub(super) fn add_trackers(&mut self, trackers: Vec<TrackerIn>) {
        if let Some(vehicle) = self.vehicle_mut() {
            trackers.iter().for_each(|tracker| vehicle.heads.hand_over(tracker.head()));
        }
        self.trackers = trackers;
    }

    /// Returns true when star trackers outside answer.
    pub(super) fn has_trackers(&self) -> bool {
        !self.trackers.is_empty()
    }

    /// Returns the star trackers outside, at the end.
    pub(super) fn take_trackers(&mut self) -> Vec<TrackerIn> {
        core::mem::take(&mut self.trackers)
    }

    /// Passes the answers of trackers outside to the spacecraft, if one is flown.
    fn take_answers(&mut self, now: Tai) {
        self.trackers.iter_mut().for_each(|tracker| tracker.listen(now, &mut self.answers));
        let mut answers = core::mem::take(&mut self.answers);
        if let Some(vehicle) = self.vehicle_mut() {
            answers.iter().for_each(|answer| vehicle.heads.take_answer(answer.head, answer.frame, answer.outcome, now));
        }
        answers.clear();
        self.answers = answers;
    }

    /// Returns true when there is anything to step.
    pub(super) fn is_simulated(&self) -> bool {
        self.simulated.is_some()
    }

    /// Returns the vehicle, if one is flown.
    pub(super) fn vehicle(&self) -> Option<&Vehicle> {
        self.simulated.as_ref().and_then(|(_, computer)| computer.vehicle.as_deref())
    }

    /// Returns the vehicle for changes, if one is flown.
    pub(super) fn vehicle_mut(&mut self) -> Option<&mut Vehicle> {
        self.simulated.as_mut().and_then(|(_, computer)| computer.vehicle.as_deref_mut())
    }

    /// Makes the flight computer fire a trigger over the bus, to act at `at` or on arrival.
    pub(super) fn send_trigger(&mut self, number: u16, at: Option<Tai>, now: Tai) -> Result<()> {
        let event = |why: String| LoopError::Event { what: "trigger", why };
        let outside = || event("the flight computer is outside this program: fire it there".into());
        let (_, computer) = self.simulated.as_mut().ok_or_else(outside)?;
        computer.send_trigger(number, at, now).map_err(|error| event(error.to_string()))
    }

    /// Accepts an event that was placed: its actions aboard, and what the witness must expect.
    pub(super) fn take_event(&mut self, placed: Placed, zero: Tai) {
        self.add_aboard(placed.aboard);
        self.prepare_witness(&placed.event, zero);
        placed.disturbances.into_iter().for_each(|(from, until)| self.witness.expect_disturbance(from, until));
    }

    /// Adds actions aboard: the list ends with the next one, and of simultaneous ones with the first added.
    fn add_aboard(&mut self, actions: Vec<(Tai, Aboard)>) {
        for (at, action) in actions {
            let place = self.aboard.partition_point(|(other, _)| *other > at);
            self.aboard.insert(place, (at, action));
        }
    }

    /// Prepares the witness for the effects of an event on pointing and time marks.
    fn prepare_witness(&mut self, event: &Event, zero: Tai) {
        let from = zero + event.at;
        let until = from + event.lasts;
        if matches!(event.action, Action::Slew(_)) {
            self.witness.expect_disturbance(from, from + self.longest_slew);
        }
        // All others change neither the pointing nor the arrival of packets.
        let Action::Bus(fault) = event.action else { return };
        match fault.arrival(event.lasts) {
            Arrival::Late(by) => self.witness.expect_delay(from, until, by),
            Arrival::Misstamped(by) => self.witness.expect_clock(from, until, by),
            Arrival::AsSent => {}
        }
    }

    /// Returns how often the fault of this number has hit something aboard.
    pub(super) fn hits_aboard(&self, number: usize) -> u64 {
        let Some(watched) = self.watched.iter().find(|watched| watched.number == number) else { return 0 };
        let now = self.vehicle().map_or(0, |vehicle| vehicle.fault_hits(&watched.fault));
        watched.ended_at.unwrap_or(now) - watched.began_at
    }

    /// Executes everything due by `now`; returns when the next action is due.
    pub(super) fn step(&mut self, now: Tai) -> Result<Tai, FarEndError> {
        if let Some((port, computer)) = &mut self.simulated {
            computer.listen(now, port)?;
        }
        self.take_frames(now);
        self.take_answers(now);
        while let Some((_, action)) = self.aboard.last().copied().filter(|(at, _)| *at <= now) {
            self.aboard.pop();
            self.do_aboard(action)?;
        }
        let Some((port, computer)) = &mut self.simulated else { return Ok(NEVER) };
        computer.step(now, port)?;
        let computer_due = computer.next_due();
        if let Some(vehicle) = &mut computer.vehicle {
            let telemetry = &mut vehicle.telemetry;
            for row in telemetry.rows.drain(..) {
                self.witness.take_row(&row);
                (self.on_row)(&row);
            }
            telemetry.mode_events.drain(..).for_each(|event| self.witness.take_mode(&event));
        }
        let next_aboard = self.aboard.last().map(|(at, _)| *at);
        Ok(next_aboard.map_or(computer_due, |at| at.min(computer_due)))
    }

    /// Passes frames to the trackers, each with its time tag; a frame that came before its tag waits a little for it.
    fn take_frames(&mut self, now: Tai) {
        let Some((_, computer)) = &mut self.simulated else { return };
        let Some(vehicle) = &mut computer.vehicle else { return };
        for (head, tap) in self.taps.iter().enumerate() {
            self.waiting.extend(core::iter::from_fn(|| tap.take()).map(|frame| (now + TAG_WAIT, head, frame)));
        }
        let is_ready = |(until, head, frame): &mut (Tai, usize, TappedFrame)| {
            *until <= now || vehicle.heads.has_tag(*head, frame.number)
        };
        let ready: Vec<_> = self.waiting.extract_if(.., is_ready).collect();
        for (_, head, frame) in ready {
            vehicle.heads.expose(head, &Exposed { exposure_s: frame.exposure_s, regions: frame.regions });
            vehicle.take_frame(head, frame.number, &frame.image, now);
            let wish = vehicle.heads.take_wish(head).filter(|_| head < self.desks.len());
            for commanded in wish.iter().flat_map(|wish| commands_of(wish, now)) {
                // A full queue loses the command: the next frame brings another one.
                let _lost = self.desks[head].put(commanded);
            }
            if let Some(tap) = self.taps.get(head) {
                tap.give_back(frame);
            }
        }
    }

    fn do_aboard(&mut self, action: Aboard) -> Result<(), FlightError> {
        let Some((_, computer)) = &mut self.simulated else { return Ok(()) };
        let Some(vehicle) = &mut computer.vehicle else { return Ok(()) };
        match action {
            Aboard::Inject { fault, number } => {
                let began_at = vehicle.fault_hits(&fault);
                vehicle.inject(fault)?;
                self.watched.push(Watched { number, fault, began_at, ended_at: None });
            }
            Aboard::Clear { fault, number } => {
                vehicle.clear(fault);
                let hits = vehicle.fault_hits(&fault);
                let ended = self.watched.iter_mut().find(|watched| watched.number == number);
                ended.map(|watched| watched.ended_at = Some(hits)).unwrap_or_default();
            }
            Aboard::Command(command) => {
                if let Err(refused) = vehicle.command(command) {
                    self.witness.refuse(&refused.to_string());
                }
            }
        }
        Ok(())
    }

    /// Compares a rendered frame with the truth; without a vehicle the truth is unknown.
    pub(super) fn witness_frame(&mut self, head: usize, meta: &FrameMeta) {
        let Some(vehicle) = self.vehicle_mut() else { return };
        let truth = vehicle.plant.truth(meta.mid_exposure).ok();
        self.witness.take_frame(head, meta, truth.map(|truth| (truth.body_from_icrf, truth.rate_rad_s.length())));
    }
}

fn longest_slew(vehicle: &config::Vehicle) -> Span {
    const SETTLING_S: f64 = 90.0;
    let control = &vehicle.spacecraft.control;
    let turning_s = 1.5 * core::f64::consts::PI / control.slew_rate_rad_s;
    let ramps_s = 6.0 * control.slew_rate_rad_s / control.slew_acceleration_rad_s2;
    Span::from_s(turning_s + ramps_s + SETTLING_S)
}
