//! A scenario file: a bench whose attitude is flown in closed loop, by a spacecraft with a flight computer and trackers.

use crate::bench::{Bench, given_seed};
use crate::check::{Checker, Defaulted, Rule};
use crate::document::Document;
use crate::error::ConfigError;
use crate::event::{Action, Event, Pointing};
use crate::event_word::EventKeys;
use crate::expect::{Expect, ExpectKeys};
use crate::file_kind::{FileKind, must_be};
use crate::head::{HEADS_MAX, HeadKeys, check_heads};
use crate::link::{Carrier, Doors};
use crate::observer::Observer;
use crate::session::SessionStart;
use crate::several::check_all;
use crate::spacecraft::Spacecraft;
use base::axes::{Body, Rotation, Sensor};
use base::time::Span;
use glam::DVec3;
use serde::Deserialize;
use std::path::Path;
use testbed::spacecraft::TestTorque;

/// A scenario, checked, with everything it names.
#[derive(Debug, Clone, PartialEq)]
pub struct Scenario {
    /// What people call it.
    pub name: String,
    /// Camera, bus, clockwork. Its `[flight_computer]` is not flown: the spacecraft is.
    pub bench: Bench,
    /// What is flown.
    pub spacecraft: Spacecraft,
    /// Attitude of the first head at the start; `None`: a random one from the seed.
    pub initial: Option<Pointing>,
    /// Rate at the start, body axes, rad/s.
    pub initial_rate_rad_s: DVec3,
    /// Where the first head is to point.
    pub target: Pointing,
    /// Mounting of each head, of the bench where the scenario has none; at least one.
    pub heads: Vec<Rotation<Sensor, Body>>,
    /// How long a tracker thinks: end of readout to attitude.
    pub tracker_delay: Span,
    /// Error of the trackers' time tags, of which nobody aboard knows.
    pub tag_error: Span,
    /// Most stars a tracker measures in a frame.
    pub tracker_stars: usize,
    /// From a control step to its torque, on top of nothing: latency injected to be studied.
    pub actuation_delay: Span,
    /// Torques by which the loop is tested. Studies add them; files have none.
    pub test_torques: Vec<TestTorque>,
    /// Control steps from one row of telemetry to the next.
    pub telemetry_every: u32,
    /// Commands and faults, in order of time.
    pub events: Vec<Event>,
    /// Events of the file that do not come, because a setting made the run shorter than the file has it.
    pub events_left_out: usize,
    /// What must come true.
    pub expect: Expect,
    /// Values nobody gave in the scenario file.
    pub defaulted: Vec<Defaulted>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct ScenarioKeys {
    name: Option<String>,
    bench: Option<String>,
    spacecraft: Option<String>,
    seed: Option<i64>,
    noise_seed: Option<i64>,
    duration_s: Option<f64>,
    initial: InitialKeys,
    target: PointingKeys,
    head: Vec<HeadKeys>,
    tracker: TrackerKeys,
    control: ControlKeys,
    telemetry: TelemetryKeys,
    event: Vec<EventKeys>,
    expect: ExpectKeys,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct InitialKeys {
    attitude: Option<String>,
    ra_deg: Option<f64>,
    dec_deg: Option<f64>,
    roll_deg: Option<f64>,
    rate_deg_s: Option<[f64; 3]>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct PointingKeys {
    ra_deg: Option<f64>,
    dec_deg: Option<f64>,
    roll_deg: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct TrackerKeys {
    delay_ms: Option<f64>,
    tag_error_ms: Option<f64>,
    stars: Option<i64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct ControlKeys {
    delay_ms: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct TelemetryKeys {
    every: Option<i64>,
}

/// Whether a document is a scenario: it names a spacecraft. A file that cannot be parsed is not.
#[must_use]
pub fn is_scenario(document: &Document) -> bool {
    document.has_key("spacecraft")
}

impl Scenario {
    /// Reads and checks a scenario file and what it names.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        Self::from_document(&Document::open(path)?)
    }

    /// Checks a scenario that is already text.
    ///
    /// # Errors
    /// The first thing that is wrong.
    pub fn from_document(document: &Document) -> Result<Self, ConfigError> {
        must_be(FileKind::Scenario, document)?;
        check_all(document, Self::checked)
    }

    fn checked(document: &Document) -> Result<Self, ConfigError> {
        let keys: ScenarioKeys = document.read_as()?;
        let mut check = Checker::new(document);
        let name = check.folder_name(keys.name.clone())?;
        let mut bench = named_bench(keys.bench.as_deref(), &check)?;
        override_bench(&mut bench, &keys, &check)?;
        let spacecraft = named_spacecraft(keys.spacecraft.as_deref(), &check)?;
        let heads = match keys.head[..] {
            [] => bench.heads(),
            _ => check_heads("head", &keys.head, HEADS_MAX, &check)?,
        };
        // What is drawn of the bench is drawn for these heads.
        bench.extra_heads = heads.get(1..).unwrap_or_default().to_vec();
        let initial = initial(&keys.initial, &mut check)?;
        let target_key = |name: &str| format!("target.{name}");
        let target =
            Pointing::check([keys.target.ra_deg, keys.target.dec_deg, keys.target.roll_deg], target_key, &check)?;
        let delay = "milliseconds from the end of readout to the attitude";
        let delay_ms =
            check.number("tracker.delay_ms", keys.tracker.delay_ms, 50.0, Rule::Within(0.0, 2000.0), delay)?;
        let tag = "milliseconds by which the trackers' time tags are late: a date error to be studied";
        let tag_ms =
            check.number("tracker.tag_error_ms", keys.tracker.tag_error_ms, 0.0, Rule::Within(-1000.0, 1000.0), tag)?;
        let late = "milliseconds from a control step to its torque: latency to be studied";
        let actuation_ms =
            check.number("control.delay_ms", keys.control.delay_ms, 0.0, Rule::Within(0.0, 10_000.0), late)?;
        let rows = "control steps from one row to the next";
        let telemetry_every = check.whole("telemetry.every", keys.telemetry.every, Some(1), 1..=1_000_000, rows)?;
        let tracker_stars = check.whole("tracker.stars", keys.tracker.stars, Some(40), 4..=200, "brightest first")?;
        let events = events(&keys.event, &bench, &mut check)?;
        let expect = Expect::check(&keys.expect, bench.timing.duration_s, &mut check)?;
        Ok(Self {
            name,
            spacecraft,
            initial,
            initial_rate_rad_s: initial_rate_rad_s(&keys.initial, &check)?,
            target,
            heads,
            tracker_delay: Span::from_s(delay_ms * 1e-3),
            tag_error: Span::from_s(tag_ms * 1e-3),
            test_torques: Vec::new(),
            tracker_stars: tracker_stars as usize,
            actuation_delay: Span::from_s(actuation_ms * 1e-3),
            telemetry_every,
            events_left_out: keys.event.len() - events.len(),
            events,
            expect,
            bench,
            defaulted: check.defaulted,
        })
    }
}

fn named_bench(path: Option<&str>, check: &Checker<'_>) -> Result<Bench, ConfigError> {
    let advice = "the path of a bench file, relative to this one";
    let path = path.ok_or_else(|| check.invalid("bench", "missing", "a path", advice))?;
    let bench = Bench::from_document(&check.document.named("bench", path)?)?;
    if !matches!(bench.observer, Observer::CircularOrbit { .. }) {
        let advice = "the flown orbit is circular: gravity gradient and aberration follow it";
        return Err(check.invalid("bench", path, "a bench whose observer.kind is \"circular_orbit\"", advice));
    }
    let is_simulated = matches!(&bench.link.carrier, Carrier::Simulated(doors) if *doors == Doors::default());
    if !is_simulated || !bench.extra_links.is_empty() || bench.flight_computer.is_external {
        let advice = "the spacecraft is flown inside this program, over a bus inside it";
        return Err(check.invalid("bench", path, "a bench with one simulated link and flight computer", advice));
    }
    if bench.camera.distortion.polynomial.is_some() {
        let advice = "the scenario's tracker knows Brown and Conrady's distortion only";
        return Err(check.invalid("bench", path, "a camera whose distortion.model is \"brown-conrady\"", advice));
    }
    if bench.session.start == SessionStart::OnRun {
        let advice = "nobody in a scenario says RUN";
        return Err(check.invalid("bench", path, "a bench whose session.start is \"at_once\"", advice));
    }
    Ok(bench)
}

/// Events in order of time. One that comes after the end is refused, unless the file's own run lasts long enough for it:
/// then a setting cut the run short, and the event is left out.
fn events(keys: &[EventKeys], bench: &Bench, check: &mut Checker<'_>) -> Result<Vec<Event>, ConfigError> {
    let duration_s = bench.timing.duration_s;
    let frame_period = Span::from_s(1.0 / bench.timing.frame_rate_hz);
    let mut events: Vec<Event> = Vec::with_capacity(keys.len());
    for (place, keys) in keys.iter().enumerate() {
        let event = Event::check(keys, place, frame_period, check)?;
        let at_s = event.at.s();
        if at_s < duration_s {
            events.push(event);
        } else if !written_duration_s(check.document).is_some_and(|written_s| at_s < written_s) {
            let advice = "it would never come: make duration_s longer, or leave it out";
            let wanted = format!("a time before the run ends, at {duration_s} s");
            return Err(check.invalid(&format!("event[{place}].at_s"), at_s, wanted, advice));
        }
    }
    for (place, event) in events.iter().enumerate() {
        if events[..place]
            .iter()
            .any(|earlier| earlier.action == event.action && matches!(event.action, Action::Trigger { .. }))
        {
            let advice = "a fault that waits begins once: give the second time a number, and a fault, of its own";
            return Err(check.invalid(
                &format!("event[{place}].number"),
                "a number fired before",
                "another one",
                advice,
            ));
        }
    }
    events.sort_by_key(|event| event.at);
    Ok(events)
}

/// How long the run lasts by the files alone, without settings; `None` when they do not say.
fn written_duration_s(document: &Document) -> Option<f64> {
    let document = document.clone().with_settings(Vec::new());
    let keys: ScenarioKeys = document.read_as().ok()?;
    let of_bench = || Some(named_bench(keys.bench.as_deref(), &Checker::new(&document)).ok()?.timing.duration_s);
    keys.duration_s.or_else(of_bench)
}

/// Takes seeds and duration from the scenario, when it gives them.
fn override_bench(bench: &mut Bench, keys: &ScenarioKeys, check: &Checker<'_>) -> Result<(), ConfigError> {
    if let Some(duration_s) = keys.duration_s {
        let length = "length of the run in seconds";
        bench.timing.duration_s = check.meets("duration_s", duration_s, Rule::PositiveUpTo(1e7), length)?;
    }
    bench.noise_seed_given = given_seed("noise_seed", keys.noise_seed, check)?.or(bench.noise_seed_given);
    if let Some(seed) = given_seed("seed", keys.seed, check)? {
        bench.seed = seed;
    }
    Ok(())
}

fn named_spacecraft(path: Option<&str>, check: &Checker<'_>) -> Result<Spacecraft, ConfigError> {
    let advice = "the path of a spacecraft file, relative to this one";
    let path = path.ok_or_else(|| check.invalid("spacecraft", "missing", "a path", advice))?;
    Spacecraft::from_document(&check.document.named("spacecraft", path)?)
}

fn initial(keys: &InitialKeys, check: &mut Checker<'_>) -> Result<Option<Pointing>, ConfigError> {
    let kinds = [("random", true), ("given", false)];
    let advice = "random takes an attitude from the seed; given needs ra_deg, dec_deg, roll_deg";
    let is_random = check.choice("initial.attitude", keys.attitude.as_deref(), &kinds, advice)?;
    if is_random {
        for (name, given) in [("ra_deg", keys.ra_deg), ("dec_deg", keys.dec_deg), ("roll_deg", keys.roll_deg)] {
            check.unused(&format!("initial.{name}"), given.is_some(), "attitude = \"given\"")?;
        }
        return Ok(None);
    }
    let key = |name: &str| format!("initial.{name}");
    Pointing::check([keys.ra_deg, keys.dec_deg, keys.roll_deg], key, check).map(Some)
}

fn initial_rate_rad_s(keys: &InitialKeys, check: &Checker<'_>) -> Result<DVec3, ConfigError> {
    let rate_deg_s = keys.rate_deg_s.unwrap_or_default();
    for component in rate_deg_s {
        let advice = "degrees per second about the body axes at the start";
        check.meets("initial.rate_deg_s", component, Rule::Within(-20.0, 20.0), advice)?;
    }
    Ok(DVec3::from_array(rate_deg_s.map(f64::to_radians)))
}
