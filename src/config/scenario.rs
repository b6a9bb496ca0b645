//! A run file, checked: a bench, the source of its spacecraft's motion, events and expectations.
//!
//! A bench file holds all of it, and a bench is a scenario without a vehicle. A scenario file names a bench and a
//! spacecraft, and takes everything else from the bench.
//!
//! `[plant.tracker]` of a plant outside: the built-in star trackers beside it.

use crate::bench::{Bench, BesideBench, check_sinks_of_heads};
use crate::camera::{HEADS_MAX, HeadKeys, check_heads};
use crate::check::{Checker, Defaulted};
use crate::error::{Partly, Result};
use crate::event::{Action, Event};
use crate::expect::{Expect, ExpectKeys};
use crate::file_kind::{FileKind, must_be_one_of};
use crate::key::{Given, Section, section};
use crate::link::Carrier;
use crate::observer::{Observer, OrbitSettings};
use crate::plant::{
    ControlKeys, FilePlant, FlightKeys, IN_BENCH, IN_SCENARIO, InitialKeys, Plant, PlantKeys, PlantKind, PointingKeys,
    TelemetryKeys, TrackerCommands, TrackerKeys, Vehicle,
};
use crate::several::{check_all, check_partly};
use crate::{
    document::Document, event_places::check_event_places, event_word::EventKeys, key_type::Whole, link::SessionStart,
    setting::Setting,
};
use base::time::Span;
use link::gateway::GatewayParams;
use std::path::Path;

/// A run of the stimulator, checked, with everything its file names.
#[derive(Debug, Clone, PartialEq)]
pub struct Scenario {
    /// Name for people.
    pub name: String,
    /// Cameras, bus, clockwork, sinks.
    pub bench: Bench,
    /// Source of the spacecraft's motion.
    pub plant: Plant,
    /// Star trackers beside a plant outside.
    pub trackers: Option<OutsideTrackers>,
    /// Commands and faults, in order of time.
    pub events: Vec<Event>,
    /// Events of the file that do not come, because a setting made the run shorter than the file has it.
    pub events_left_out: usize,
    /// Conditions that must be met.
    pub expect: Expect,
    /// Values left at their defaults, beside those of the bench.
    pub defaulted: Vec<Defaulted>,
}

section! {
    /// A scenario: a bench with a spacecraft, events and expectations.
    ScenarioKeys at "" {
        /// Name of the run; it names a folder below out/.
        name: String = Computed("the file's name"), "text";
        /// The path of a bench file, relative to this one.
        bench: String = Needed, "path";
        /// The path of a spacecraft file, relative to this one.
        spacecraft: String = Needed, "path";
        /// Seed of every random number of the run, in place of the bench's; any number repeats its own run.
        seed: Whole<u64> = Optional, 0..=i64::MAX;
        /// Seed of the noise of exposures, in place of the bench's; any number repeats its own run.
        noise_seed: Whole<u64> = Optional, 0..=i64::MAX;
        /// Length of the run in seconds, in place of the bench's.
        duration_s: f64 = Optional, PositiveUpTo(1e7);
        tables:
        /// Attitude and rate at the start.
        initial: InitialKeys;
        /// Where the first head is to point.
        target: PointingKeys;
        /// Camera heads, in place of the bench's.
        head: Vec<HeadKeys>;
        /// Star trackers.
        tracker: TrackerKeys;
        /// Attitude control.
        control: ControlKeys;
        /// Telemetry.
        telemetry: TelemetryKeys;
        /// Commands and faults, each at its time.
        event: Vec<EventKeys>;
        /// Conditions that must be met for the run to pass.
        expect: ExpectKeys;
    }
}

/// Returns whether a document is a scenario: it names a spacecraft. A file that cannot be parsed is not.
pub fn is_scenario(document: &Document) -> bool {
    document.has_key("spacecraft")
}

/// Returns whether a file names a bench, or has tables that only such a file has at its top.
fn is_over_bench(document: &Document) -> bool {
    ["bench", "initial", "tracker", "control", "telemetry", "duration_s"].iter().any(|key| document.has_key(key))
}

impl Bench {
    /// Checks a bench that is already text, and all else that is in it: the bench of [`Scenario::from_document`].
    ///
    /// # Errors
    /// Everything that is wrong, as far as one error does not hide another.
    pub fn from_document(document: &Document) -> Result<Self> {
        Scenario::from_document(document).map(|scenario| scenario.bench)
    }
}

impl Scenario {
    /// Makes the run one without a cable, which its plant steps: so 42 runs, and so its capture is drawn again.
    pub fn step_by_plant(&mut self) {
        self.bench.link.carrier = Carrier::Simulated(GatewayParams::default());
        self.plant = Plant::Outside;
    }

    /// Reads and checks a run file and what it names.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn load(path: &Path) -> Result<Self> {
        Self::from_document(&Document::open(path)?)
    }

    /// Checks a run file that is already text.
    ///
    /// # Errors
    /// Everything that is wrong, as far as one error does not hide another.
    pub fn from_document(document: &Document) -> Result<Self> {
        must_be_one_of(&[FileKind::Bench, FileKind::Scenario], document)?;
        check_all(document, if is_over_bench(document) { Self::over_bench } else { Self::in_one_file })
    }

    /// Checks a run file that another one names: the run without what is wrong, and what is wrong.
    fn partly(document: &Document) -> Result<Partly<Self>> {
        must_be_one_of(&[FileKind::Bench, FileKind::Scenario], document)?;
        check_partly(document, if is_over_bench(document) { Self::over_bench } else { Self::in_one_file })
    }

    /// Checks a run file for a run of this length. Where a spacecraft is flown the duration is set before anything is
    /// checked: the expectations of its pointing depend on it.
    ///
    /// # Errors
    /// As [`Self::from_document`].
    pub fn from_document_lasting(document: Document, duration_s: f64) -> Result<Self> {
        if !is_scenario(&document) {
            return Self::from_document(&document).map(|scenario| scenario.lasting(duration_s));
        }
        let key = if is_over_bench(&document) { "duration_s" } else { "timing.duration_s" };
        let setting = Setting::parse(&format!("{key}={duration_s:?}"))?;
        Self::from_document(&document.with_setting(setting))
    }

    /// Returns the run cut, or made longer, to this duration. Events that come after its end are left out and counted.
    #[must_use]
    pub fn lasting(mut self, duration_s: f64) -> Self {
        self.bench.timing.duration_s = duration_s;
        let before = self.events.len();
        self.events.retain(|event| event.on_trigger.is_some() || event.at.s() < duration_s);
        self.events_left_out += before - self.events.len();
        self
    }

    /// Returns the spacecraft that is flown inside, if one is.
    pub fn vehicle(&self) -> Option<&Vehicle> {
        match &self.plant {
            Plant::Vehicle(vehicle) => Some(vehicle),
            Plant::Outside | Plant::FlightComputer | Plant::File(_) => None,
        }
    }

    /// Returns the spacecraft that is flown inside, if one is, to be changed.
    pub fn vehicle_mut(&mut self) -> Option<&mut Vehicle> {
        match &mut self.plant {
            Plant::Vehicle(vehicle) => Some(vehicle),
            Plant::Outside | Plant::FlightComputer | Plant::File(_) => None,
        }
    }

    /// Checks a file that holds all.
    fn in_one_file(document: &Document) -> Result<Partly<Self>> {
        let (bench, beside) = Bench::checked(document)?;
        let mut check = Checker::new(document);
        let BesideBench { plant_kind, spacecraft, plant, event, expect, named_errors } = beside;
        check.named_errors = named_errors;
        let is_flown = plant_kind == PlantKind::Vehicle;
        let trackers = match plant_kind {
            PlantKind::Outside => plant.outside_trackers(&bench, &mut check)?,
            PlantKind::FlightComputer | PlantKind::File | PlantKind::Vehicle => None,
        };
        let plant = match plant_kind {
            PlantKind::Outside => Plant::Outside,
            PlantKind::FlightComputer => Plant::FlightComputer,
            PlantKind::File => Plant::File(FilePlant::check(&plant, &bench.timing, &mut check)?),
            PlantKind::Vehicle => {
                check_can_fly(&bench, &check)?;
                let vehicle = Vehicle::check(&plant.flight(), IN_BENCH, spacecraft.as_deref(), &mut check)?;
                Plant::Vehicle(Box::new(vehicle))
            }
        };
        let wheels = match &plant {
            Plant::Vehicle(vehicle) => Some(vehicle.spacecraft.params.wheels.len()),
            Plant::Outside | Plant::FlightComputer | Plant::File(_) => None,
        };
        let events = events(&event, &bench, wheels, &mut check)?;
        check_trigger_heads(&bench, &check)?;
        let expect = Expect::check(&expect, bench.timing.duration_s, is_flown, &mut check)?;
        let scenario = Self {
            name: bench.name.clone(),
            events_left_out: event.len() - events.len(),
            bench,
            plant,
            trackers,
            events,
            expect,
            defaulted: check.defaulted,
        };
        Ok((scenario, check.named_errors))
    }

    /// Checks a scenario that names a bench.
    fn over_bench(document: &Document) -> Result<Partly<Self>> {
        let keys: ScenarioKeys = document.read_as()?;
        let mut check = Checker::new(document);
        let name = check.folder_name(keys.name().raw().cloned())?;
        let mut bench = named_bench(&keys.bench(), &mut check)?;
        override_bench(&mut bench, &keys, &check)?;
        let heads = check_heads("head", &keys.head, HEADS_MAX, &bench.first_head(), &mut check)?;
        let bench = bench.of_heads(heads);
        check_can_fly(&bench, &check)?;
        check_sinks_of_heads(&bench.sinks, &bench.extra_heads, &check)?;
        let spacecraft = keys.spacecraft().raw().map(String::as_str);
        let flight = FlightKeys {
            initial: keys.initial.clone(),
            pointing: keys.target.clone(),
            tracker: keys.tracker.clone(),
            control: keys.control.clone(),
            telemetry: keys.telemetry.clone(),
        };
        let vehicle = Vehicle::check(&flight, IN_SCENARIO, spacecraft, &mut check)?;
        let wheels = Some(vehicle.spacecraft.params.wheels.len());
        let events = events(&keys.event, &bench, wheels, &mut check)?;
        let expect = Expect::check(&keys.expect, bench.timing.duration_s, true, &mut check)?;
        let scenario = Self {
            name,
            events_left_out: keys.event.len() - events.len(),
            bench,
            plant: Plant::Vehicle(Box::new(vehicle)),
            trackers: None,
            events,
            expect,
            defaulted: check.defaulted,
        };
        Ok((scenario, check.named_errors))
    }
}

/// Refuses a bench in which a spacecraft cannot be flown.
fn check_can_fly(bench: &Bench, check: &Checker<'_>) -> Result<()> {
    let got = format!("\"{}\"", bench.name);
    let refuse = |wanted: &str, advice: &str| Err(check.invalid("bench", &got, wanted, advice));
    if !matches!(bench.observer, Observer::Orbit(OrbitSettings::Circular { .. })) {
        let advice = "the flown orbit is circular: gravity gradient and aberration follow it";
        return refuse("a bench whose observer.kind is \"circular_orbit\"", advice);
    }
    if bench.flight_computer.is_external {
        let advice = "the spacecraft's flight computer is a part of this program";
        return refuse("a bench whose flight_computer.kind is \"simulated\"", advice);
    }
    let heads = || (0..bench.head_count()).map(|number| bench.of_head(number));
    if heads().any(|head| head.camera.distortion.polynomial.is_some()) {
        let advice = "the scenario's tracker knows Brown and Conrady's distortion only";
        return refuse("a camera whose distortion.model is \"brown-conrady\"", advice);
    }
    let times = |head: &Bench| (head.timing.frame_rate_hz, head.timing.phase, head.camera.exposure.exposure_s);
    if heads().any(|head| times(&head) != times(bench)) {
        let advice = "EXPOSURE, by which the trackers inside date their frames, names no head";
        return refuse("heads with one frame rate, phase and exposure time", advice);
    }
    if bench.session.start == SessionStart::OnRun {
        let advice = "no flight computer in a scenario sends RUN";
        return refuse("a bench whose session.start is \"at_once\"", advice);
    }
    Ok(())
}

fn named_bench(given: &Given<'_, String>, check: &mut Checker<'_>) -> Result<Bench> {
    let path = given.raw().ok_or_else(|| given.missing("a path", check))?;
    let scenario = Scenario::partly(&check.document.named("bench", path)?)?;
    let bench = check.take(scenario).bench;
    check_can_fly(&bench, check)?;
    Ok(bench)
}

/// Events in order of time. One that comes after the end is refused, unless the file's own run lasts long enough for
/// it: then a setting cut the run short, and the event is left out. `wheels`: of the spacecraft that is flown inside,
/// if one is.
fn events(keys: &[EventKeys], bench: &Bench, wheels: Option<usize>, check: &mut Checker<'_>) -> Result<Vec<Event>> {
    let duration_s = bench.timing.duration_s;
    let frame_period = Span::from_s(1.0 / bench.timing.frame_rate_hz);
    let mut events: Vec<Event> = Vec::with_capacity(keys.len());
    for (place, keys) in keys.iter().enumerate() {
        let event = Event::check(keys, place, frame_period, check)?;
        if event.action.is_aboard() && wheels.is_none() {
            let advice = "a simulated spacecraft is needed for it: name one with spacecraft = \"FILE\"";
            let got = format!("\"{}\"", event.action.word());
            let wanted = "a fault of bus, frames or imaging, or a trigger";
            return Err(check.invalid(&format!("event[{place}].do"), got, wanted, advice));
        }
        check_event_places(&event, &format!("event[{place}]"), bench, wheels, check)?;
        if bench.is_lockstep() && matches!(event.action, Action::Bus(_) | Action::BusBackLoss { .. }) {
            let got = format!("\"{}\"", event.action.word());
            let advice =
                "no bus leads out of the program in this bench: give its link a gateway, or leave the fault out";
            return Err(check.invalid(&format!("event[{place}].do"), got, "a fault that does not need a bus", advice));
        }
        let at_s = event.at.s();
        if at_s < duration_s {
            events.push(event);
        } else if !written_duration_s(check.document).is_some_and(|written_s| at_s < written_s) {
            let advice = "it would never come: make duration_s longer, or leave it out";
            let wanted = format!("a time before the run ends, at {duration_s} s");
            return Err(check.invalid(&format!("event[{place}].at_s"), at_s, wanted, advice));
        }
    }
    check_triggers_fire_once(&events, check)?;
    events.sort_by_key(|event| event.at);
    Ok(events)
}

/// Refuses a trigger line of a head that the bench does not have.
fn check_trigger_heads(bench: &Bench, check: &Checker<'_>) -> Result<()> {
    let heads = bench.head_count();
    let beyond = bench.trigger_lines.iter().zip(0..).find_map(|(line, place)| {
        let head = line.head.filter(|head| *head >= heads)?;
        Some((place, head))
    });
    let Some((place, head)) = beyond else { return Ok(()) };
    let wanted = format!("less than {heads}, the number of camera heads");
    Err(check.invalid(&format!("trigger_line[{place}].head"), head, wanted, "they are counted from 0"))
}

fn check_triggers_fire_once(events: &[Event], check: &Checker<'_>) -> Result<()> {
    for (place, event) in events.iter().enumerate() {
        let is_trigger = matches!(event.action, Action::Trigger { .. });
        if is_trigger && events[..place].iter().any(|earlier| earlier.action == event.action) {
            let advice = "a fault that waits begins once: give the second time a number, and a fault, of its own";
            let key = format!("event[{place}].number");
            return Err(check.invalid(&key, "a number fired before", "another one", advice));
        }
    }
    Ok(())
}

/// Returns how long the run lasts by the files alone, without settings; `None` when they do not say.
fn written_duration_s(document: &Document) -> Option<f64> {
    let document = document.clone().with_settings(Vec::new());
    if !is_over_bench(&document) {
        return Some(Bench::checked(&document).ok()?.0.timing.duration_s);
    }
    let keys: ScenarioKeys = document.read_as().ok()?;
    let of_bench = || Some(named_bench(&keys.bench(), &mut Checker::new(&document)).ok()?.timing.duration_s);
    keys.duration_s().raw().copied().or_else(of_bench)
}

/// Takes seeds and duration from the scenario, when it gives them.
fn override_bench(bench: &mut Bench, keys: &ScenarioKeys, check: &Checker<'_>) -> Result<()> {
    if let Some(duration_s) = keys.duration_s().optional(check)? {
        bench.timing.duration_s = duration_s;
    }
    bench.noise_seed_given = keys.noise_seed().optional(check)?.or(bench.noise_seed_given);
    if let Some(seed) = keys.seed().optional(check)? {
        bench.seed = seed;
    }
    Ok(())
}

/// The built-in star trackers beside a plant outside, one for each head.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct OutsideTrackers {
    /// How long a tracker thinks: end of readout to attitude.
    pub delay: Span,
    /// Error of the trackers' time tags, unknown to their readers.
    pub tag_error: Span,
    /// Most stars a tracker measures in a frame.
    pub most_stars: usize,
    /// Commands of the trackers to their cameras.
    pub commands: TrackerCommands,
}

impl Default for OutsideTrackers {
    /// Returns the values of a `[plant.tracker]` without keys.
    fn default() -> Self {
        Self { delay: Span::from_ms(50), tag_error: Span::ZERO, most_stars: 40, commands: TrackerCommands::default() }
    }
}

impl PlantKeys {
    /// Reads the trackers beside a plant outside, if it has any.
    pub(super) fn outside_trackers(&self, bench: &Bench, check: &mut Checker<'_>) -> Result<Option<OutsideTrackers>> {
        let Some(tracker) = self.tracker.as_ref() else { return Ok(None) };
        check.unused(
            "plant.tracker",
            !bench.is_lockstep(),
            "a plant outside in lockstep, without a bus that leads out",
        )?;
        let heads = || (0..bench.head_count()).map(|number| bench.of_head(number));
        if heads().any(|head| head.camera.distortion.polynomial.is_some()) {
            let advice =
                "the built-in tracker knows no other distortion: leave plant.tracker out, or choose another camera";
            let wanted = "a camera whose distortion.model is \"brown-conrady\"";
            return Err(check.invalid("plant.tracker", "given", wanted, advice));
        }
        let tracker = tracker.at("plant.tracker");
        let delay = tracker.delay_ms().ms(check)?;
        let tag_error = tracker.tag_error_ms().ms(check)?;
        let most_stars = tracker.stars().check(check)?;
        let commands = TrackerCommands::check(&tracker, check)?;
        Ok(Some(OutsideTrackers { delay, tag_error, most_stars, commands }))
    }
}
