//! `[plant]`: who moves the spacecraft, and how one that is flown inside begins, points and is controlled.
//!
//! A scenario file that names a bench has the same tables at its top level. Tests: `plant_tests`.

use crate::check::{Checker, Rule};
use crate::error::ConfigError;
use crate::event::Pointing;
use crate::spacecraft::Spacecraft;
use base::time::Span;
use glam::DVec3;
use serde::Deserialize;
use testbed::spacecraft::TestTorque;

/// Who moves the spacecraft.
#[derive(Debug, Clone, PartialEq)]
pub enum Plant {
    /// A flight computer or simulator at the other end of the link, which is no part of this program.
    Outside,
    /// The simulated flight computer: it sends a prescribed attitude.
    FlightComputer,
    /// A simulated spacecraft: rigid body, wheels, star tracker, estimator and attitude control.
    Vehicle(Box<Vehicle>),
}

/// A spacecraft that is flown inside the program, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Vehicle {
    /// Masses, wheels, sensors, control.
    pub spacecraft: Spacecraft,
    /// Attitude of the first head at the start; `None`: a random one from the seed.
    pub initial: Option<Pointing>,
    /// Rate at the start, body axes, rad/s.
    pub initial_rate_rad_s: DVec3,
    /// Where the first head is to point.
    pub target: Pointing,
    /// How long a tracker thinks: end of readout to attitude.
    pub tracker_delay: Span,
    /// Error of the trackers' time tags, unknown to the flight computer.
    pub tag_error: Span,
    /// Most stars a tracker measures in a frame.
    pub tracker_stars: usize,
    /// From a control step to its torque, on top of nothing: latency injected to be studied.
    pub actuation_delay: Span,
    /// Torques by which the loop is tested. Studies add them; files have none.
    pub test_torques: Vec<TestTorque>,
    /// Control steps from one row of telemetry to the next.
    pub telemetry_every: u32,
}

/// `[plant]` of a bench.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct PlantKeys {
    kind: Option<String>,
    initial: Option<InitialKeys>,
    pointing: Option<PointingKeys>,
    tracker: Option<TrackerKeys>,
    control: Option<ControlKeys>,
    telemetry: Option<TelemetryKeys>,
}

/// The tables that describe a flight, wherever they are in the file.
#[derive(Debug, Default)]
pub(super) struct FlightKeys {
    pub(super) initial: InitialKeys,
    pub(super) pointing: PointingKeys,
    pub(super) tracker: TrackerKeys,
    pub(super) control: ControlKeys,
    pub(super) telemetry: TelemetryKeys,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct InitialKeys {
    attitude: Option<String>,
    ra_deg: Option<f64>,
    dec_deg: Option<f64>,
    roll_deg: Option<f64>,
    rate_deg_s: Option<[f64; 3]>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PointingKeys {
    ra_deg: Option<f64>,
    dec_deg: Option<f64>,
    roll_deg: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TrackerKeys {
    delay_ms: Option<f64>,
    tag_error_ms: Option<f64>,
    stars: Option<i64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ControlKeys {
    delay_ms: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct TelemetryKeys {
    every: Option<i64>,
}

/// What `plant.kind` says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PlantKind {
    Outside,
    FlightComputer,
    Vehicle,
}

impl PlantKeys {
    /// Whether the spacecraft is said to be moved from outside.
    pub(super) fn is_outside(&self) -> bool {
        self.kind.as_deref() == Some("outside")
    }

    /// Reads who moves the spacecraft: without `kind` it is a vehicle where a spacecraft is named, else what
    /// `flight_computer.kind` says.
    pub(super) fn kind(
        &self,
        names_spacecraft: bool,
        is_external: bool,
        check: &mut Checker<'_>,
    ) -> Result<PlantKind, ConfigError> {
        let usual = match (names_spacecraft, is_external) {
            (true, _) => PlantKind::Vehicle,
            (false, true) => PlantKind::Outside,
            (false, false) => PlantKind::FlightComputer,
        };
        let kinds = [
            ("flight_computer", PlantKind::FlightComputer),
            ("outside", PlantKind::Outside),
            ("vehicle", PlantKind::Vehicle),
        ];
        let advice = "the simulated flight computer, one at the other end of the link, or a simulated spacecraft";
        let kind = match self.kind.as_deref() {
            None => usual,
            given => check.choice("plant.kind", given, &kinds, advice)?,
        };
        if kind != usual {
            let got = self.kind.as_deref().unwrap_or_default();
            let (wanted, advice) = match (kind, names_spacecraft) {
                (PlantKind::Vehicle, _) => ("a spacecraft", "name its file: spacecraft = \"FILE\""),
                (PlantKind::Outside | PlantKind::FlightComputer, true) => {
                    ("\"vehicle\" with a spacecraft", "leave spacecraft out")
                }
                (PlantKind::Outside | PlantKind::FlightComputer, false) => {
                    ("\"outside\" with flight_computer.kind = \"external\"", "they say different things: leave one out")
                }
            };
            return Err(check.invalid("plant.kind", format!("\"{got}\""), wanted, advice));
        }
        if kind != PlantKind::Vehicle {
            for (name, is_given) in [
                ("initial", self.initial.is_some()),
                ("pointing", self.pointing.is_some()),
                ("tracker", self.tracker.is_some()),
                ("control", self.control.is_some()),
                ("telemetry", self.telemetry.is_some()),
            ] {
                check.unused(&format!("plant.{name}"), is_given, "kind = \"vehicle\"")?;
            }
        }
        Ok(kind)
    }

    /// Returns the tables of the flight.
    pub(super) fn flight(self) -> FlightKeys {
        FlightKeys {
            initial: self.initial.unwrap_or_default(),
            pointing: self.pointing.unwrap_or_default(),
            tracker: self.tracker.unwrap_or_default(),
            control: self.control.unwrap_or_default(),
            telemetry: self.telemetry.unwrap_or_default(),
        }
    }
}

/// Names of the flight's tables in one form of file.
#[derive(Debug, Clone, Copy)]
pub(super) struct FlightNames {
    /// Before every table: `plant.` or nothing.
    pub(super) before: &'static str,
    /// The table of where the first head is to point.
    pub(super) pointing: &'static str,
}

/// In a bench file.
pub(super) const IN_BENCH: FlightNames = FlightNames { before: "plant.", pointing: "pointing" };
/// In a scenario file that names a bench.
pub(super) const IN_SCENARIO: FlightNames = FlightNames { before: "", pointing: "target" };

impl Vehicle {
    /// Checks the vehicle that a document names and describes.
    pub(super) fn check(
        keys: &FlightKeys,
        names: FlightNames,
        spacecraft: Option<&str>,
        check: &mut Checker<'_>,
    ) -> Result<Self, ConfigError> {
        let FlightNames { before, pointing } = names;
        let key = |name: &str| format!("{before}{name}");
        let spacecraft = named_spacecraft(spacecraft, check)?;
        let initial = initial(&keys.initial, before, check)?;
        let target_key = |name: &str| format!("{before}{pointing}.{name}");
        let target =
            Pointing::check([keys.pointing.ra_deg, keys.pointing.dec_deg, keys.pointing.roll_deg], target_key, check)?;
        let delay = "milliseconds from the end of readout to the attitude";
        let delay_ms =
            check.number(&key("tracker.delay_ms"), keys.tracker.delay_ms, 50.0, Rule::Within(0.0, 2000.0), delay)?;
        let tag = "milliseconds by which the trackers' time tags are late: a date error to be studied";
        let tag_rule = Rule::Within(-1000.0, 1000.0);
        let tag_ms = check.number(&key("tracker.tag_error_ms"), keys.tracker.tag_error_ms, 0.0, tag_rule, tag)?;
        let late = "milliseconds from a control step to its torque: latency to be studied";
        let late_rule = Rule::Within(0.0, 10_000.0);
        let actuation_ms = check.number(&key("control.delay_ms"), keys.control.delay_ms, 0.0, late_rule, late)?;
        let rows = "control steps from one row to the next";
        let telemetry_every =
            check.whole(&key("telemetry.every"), keys.telemetry.every, Some(1), 1..=1_000_000, rows)?;
        let stars = "brightest first";
        let tracker_stars = check.whole(&key("tracker.stars"), keys.tracker.stars, Some(40), 4..=200, stars)?;
        Ok(Self {
            spacecraft,
            initial,
            initial_rate_rad_s: initial_rate_rad_s(&keys.initial, before, check)?,
            target,
            tracker_delay: Span::from_s(delay_ms * 1e-3),
            tag_error: Span::from_s(tag_ms * 1e-3),
            tracker_stars: tracker_stars as usize,
            actuation_delay: Span::from_s(actuation_ms * 1e-3),
            test_torques: Vec::new(),
            telemetry_every,
        })
    }
}

fn named_spacecraft(path: Option<&str>, check: &Checker<'_>) -> Result<Spacecraft, ConfigError> {
    let advice = "the path of a spacecraft file, relative to this one";
    let path = path.ok_or_else(|| check.invalid("spacecraft", "missing", "a path", advice))?;
    Spacecraft::from_document(&check.document.named("spacecraft", path)?)
}

fn initial(keys: &InitialKeys, before: &str, check: &mut Checker<'_>) -> Result<Option<Pointing>, ConfigError> {
    let key = |name: &str| format!("{before}initial.{name}");
    let kinds = [("random", true), ("given", false)];
    let advice = "random takes an attitude from the seed; given needs ra_deg, dec_deg, roll_deg";
    let is_random = check.choice(&key("attitude"), keys.attitude.as_deref(), &kinds, advice)?;
    if is_random {
        for (name, given) in [("ra_deg", keys.ra_deg), ("dec_deg", keys.dec_deg), ("roll_deg", keys.roll_deg)] {
            check.unused(&key(name), given.is_some(), "attitude = \"given\"")?;
        }
        return Ok(None);
    }
    Pointing::check([keys.ra_deg, keys.dec_deg, keys.roll_deg], key, check).map(Some)
}

fn initial_rate_rad_s(keys: &InitialKeys, before: &str, check: &Checker<'_>) -> Result<DVec3, ConfigError> {
    let rate_deg_s = keys.rate_deg_s.unwrap_or_default();
    for component in rate_deg_s {
        let advice = "degrees per second about the body axes at the start";
        check.meets(&format!("{before}initial.rate_deg_s"), component, Rule::Within(-20.0, 20.0), advice)?;
    }
    Ok(DVec3::from_array(rate_deg_s.map(f64::to_radians)))
}

#[cfg(test)]
#[path = "plant_tests.rs"]
mod tests;
