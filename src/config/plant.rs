//! `[plant]`: source of the spacecraft's motion, and how one simulated here starts, points and is controlled.
//!
//! A scenario file that names a bench has the same tables at its top level. Tests: `plant_tests`.
//!
//! `[plant] kind = "file"`: attitudes from a file, and how they are laid upon the run. Tests: `plant_tests`.

use crate::key::{Given, Section, section};
use crate::key_type::{Any, Numbers, Raw, Shape, Whole, Word};
use crate::named_files::{Kernels, refused};
use crate::timing::{StartTime, Timing};
use crate::{check::Checker, error::Result, event::Pointing, spacecraft::Spacecraft};
use base::time::{Span, Tai};
use glam::DVec3;
use histories::{AttitudeHistory, Sense, Times, read};
use std::sync::Arc;
use testbed::{flight_computer::FileProfile, spacecraft::TestTorque};

/// Source of the spacecraft's motion.
#[derive(Debug, Clone, PartialEq)]
pub enum Plant {
    /// An external flight computer or simulator at the other end of the link.
    Outside,
    /// The simulated flight computer: it sends a prescribed attitude.
    FlightComputer,
    /// An attitude history, which the simulated flight computer sends.
    File(FilePlant),
    /// A simulated spacecraft: rigid body, wheels, star tracker, estimator and attitude control.
    Vehicle(Box<Vehicle>),
}

/// Commands of a tracker to its camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TrackerCommands {
    /// Windows.
    pub windows: bool,
    /// Exposure time.
    pub exposure: bool,
}

impl TrackerCommands {
    pub(super) fn check(keys: &TrackerKeys, check: &mut Checker<'_>) -> Result<Self> {
        Ok(Self { windows: keys.commands_windows().check(check)?, exposure: keys.commands_exposure().check(check)? })
    }

    /// Returns true when it commands anything.
    pub fn any(self) -> bool {
        self.windows || self.exposure
    }
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
    /// Commands of the trackers to their cameras.
    pub tracker_commands: TrackerCommands,
    /// From a control step to its torque, on top of nothing: latency injected to be studied.
    pub actuation_delay: Span,
    /// Torques by which the loop is tested. Studies add them; files have none.
    pub test_torques: Vec<TestTorque>,
    /// Control steps from one row of telemetry to the next.
    pub telemetry_every: u32,
}

section! {
    /// Source of the spacecraft's motion, and how one simulated here starts, points and is controlled.
    PlantKeys at "plant" {
        /// The simulated flight computer, one at the other end of the link, a simulated spacecraft, or a file of
        /// attitudes.
        kind: Word<PlantKind> = Computed("vehicle with spacecraft, else as flight_computer.kind says"), [
            ("flight_computer", PlantKind::FlightComputer), ("outside", PlantKind::Outside),
            ("vehicle", PlantKind::Vehicle), ("file", PlantKind::File),
        ];
        /// File of an attitude history, for kind = "file": a table with named columns, rows of seconds and the
        /// quaternion w x y z from ICRF to body axes, CCSDS AEM (KVN, XML), STK .a; the guide files_in_and_out.md has
        /// all.
        attitude: String = Optional, "path";
        /// Which rotation the quaternions of a table are, where it does not say so itself.
        sense: Word<Sense> = Optional, SENSES;
        /// Text kernels (SCLK, LSK) of a SPICE CK file, relative to this file.
        kernels: Raw<Vec<String>> = Optional, Shape::list(Shape::Text("path"));
        /// Number of the instrument or spacecraft in a SPICE CK file, where it has several.
        naif_id: Whole<i32> = Optional, -2_000_000_000..=2_000_000_000;
        /// How the file's times are placed on the clock of the run: at their own UTC, or starting at the first
        /// exposure.
        begins: Word<Begins> = Computed("utc where the file's times are absolute, else first_exposure"),
            [("utc", Begins::Utc), ("first_exposure", Begins::FirstExposure)];
        /// Attitude before the file's first row and after its last: none, or that row's attitude at rest.
        outside: Word<bool> = Computed("none where the file's times are absolute, else rest"),
            [("none", false), ("rest", true)];
        tables:
        /// Attitude and rate at the start of a flight.
        initial: Option<InitialKeys>;
        /// Where the first head of a spacecraft is to point.
        pointing: Option<PointingKeys>;
        /// Star trackers of a spacecraft, or beside a plant outside in lockstep.
        tracker: Option<TrackerKeys>;
        /// Attitude control of a spacecraft.
        control: Option<ControlKeys>;
        /// Telemetry of a spacecraft.
        telemetry: Option<TelemetryKeys>;
    }

    /// Attitude and rate at the start of a flight.
    InitialKeys at "initial" {
        /// Random takes an attitude from the seed; given needs ra_deg, dec_deg, roll_deg.
        attitude: Word<IsRandom> = "random", [("random", IsRandom(true)), ("given", IsRandom(false))];
        /// Right ascension of the boresight, in degrees, not hours: 5h 30m is 82.5.
        ra_deg: f64 = Optional, Within(-360.0, 360.0);
        /// Declination of the boresight, degrees.
        dec_deg: f64 = Optional, Within(-90.0, 90.0);
        /// Position angle of the image's up direction, east of north, degrees.
        roll_deg: f64 = Silent(0.0), Within(-360.0, 360.0);
        /// Degrees per second about the body axes at the start.
        rate_deg_s: [f64; 3] = Silent(Numbers([0.0; 3])), Within(-20.0, 20.0);
    }

    /// Where the first head is to point.
    PointingKeys at "pointing" {
        /// Right ascension of the boresight, in degrees, not hours: 5h 30m is 82.5.
        ra_deg: f64 = Needed, Within(-360.0, 360.0);
        /// Declination of the boresight, degrees.
        dec_deg: f64 = Needed, Within(-90.0, 90.0);
        /// Position angle of the image's up direction, east of north, degrees.
        roll_deg: f64 = Silent(0.0), Within(-360.0, 360.0);
    }

    /// Star trackers.
    TrackerKeys at "tracker" {
        /// Milliseconds from the end of readout to the attitude.
        delay_ms: f64 = 50.0, Within(0.0, 2000.0);
        /// Milliseconds by which the trackers' time tags are late: a date error to be studied.
        tag_error_ms: f64 = 0.0, Within(-1000.0, 1000.0);
        /// Most stars that are measured in a frame, brightest first.
        stars: Whole<usize> = 40, 4..=200;
        /// The tracker commands its camera's windows: the whole image until it has an attitude, then windows around the
        /// brightest stars that it expects.
        commands_windows: bool = false, Any;
        /// The tracker commands its camera's exposure time by the signal of its stars.
        commands_exposure: bool = false, Any;
    }

    /// Attitude control.
    ControlKeys at "control" {
        /// Milliseconds from a control step to its torque: latency to be studied.
        delay_ms: f64 = 0.0, Within(0.0, 10_000.0);
    }

    /// Telemetry.
    TelemetryKeys at "telemetry" {
        /// Control steps from one row to the next.
        every: Whole = 1, 1..=1_000_000;
    }
}

/// Whether an attitude is drawn from the seed.
#[derive(Debug, Clone, Copy)]
pub(super) struct IsRandom(bool);

/// The tables that describe a flight, wherever they are in the file.
#[derive(Debug, Default)]
pub(super) struct FlightKeys {
    pub(super) initial: InitialKeys,
    pub(super) pointing: PointingKeys,
    pub(super) tracker: TrackerKeys,
    pub(super) control: ControlKeys,
    pub(super) telemetry: TelemetryKeys,
}

/// Values of `plant.kind`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum PlantKind {
    Outside,
    FlightComputer,
    Vehicle,
    File,
}

impl PlantKeys {
    /// Returns whether the spacecraft is said to be moved from outside.
    pub(super) fn is_outside(&self) -> bool {
        self.kind().raw().is_some_and(|kind| kind == "outside")
    }

    /// Reads the source of the spacecraft's motion: without `kind` it is a vehicle where a spacecraft is named, else
    /// what `flight_computer.kind` says.
    pub(super) fn mover(&self, names_spacecraft: bool, is_external: bool, check: &Checker<'_>) -> Result<PlantKind> {
        let usual = match (names_spacecraft, is_external) {
            (true, _) => PlantKind::Vehicle,
            (false, true) => PlantKind::Outside,
            (false, false) => PlantKind::FlightComputer,
        };
        let kind = self.kind().optional(check)?.unwrap_or(usual);
        let replays = kind == PlantKind::File && usual == PlantKind::FlightComputer;
        if kind != PlantKind::File {
            self.refuse(&["attitude", "sense", "kernels", "naif_id", "begins", "outside"], "kind = \"file\"", check)?;
        }
        if kind != usual && !replays {
            let got = self.kind().raw().cloned().unwrap_or_default();
            let (wanted, advice) = match (kind, names_spacecraft) {
                (PlantKind::Vehicle, _) => ("a spacecraft", "name its file: spacecraft = \"FILE\""),
                (PlantKind::Outside | PlantKind::FlightComputer | PlantKind::File, true) => {
                    ("\"vehicle\" with a spacecraft", "leave spacecraft out")
                }
                (PlantKind::Outside | PlantKind::FlightComputer | PlantKind::File, false) => {
                    ("\"outside\" with flight_computer.kind = \"external\"", "they say different things: leave one out")
                }
            };
            return Err(self.kind().advised(advice).invalid(format!("\"{got}\""), wanted, check));
        }
        if kind != PlantKind::Vehicle {
            for (name, is_given) in [
                ("initial", self.initial.is_some()),
                ("pointing", self.pointing.is_some()),
                ("tracker", self.tracker.is_some() && kind != PlantKind::Outside),
                ("control", self.control.is_some()),
                ("telemetry", self.telemetry.is_some()),
            ] {
                let wanted = if name == "tracker" { "kind = \"vehicle\" or \"outside\"" } else { "kind = \"vehicle\"" };
                check.unused(&format!("plant.{name}"), is_given, wanted)?;
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
    ) -> Result<Self> {
        let FlightNames { before, pointing } = names;
        let spacecraft = named_spacecraft(spacecraft, check)?;
        let initial_keys = keys.initial.at(&format!("{before}initial"));
        let pointing = keys.pointing.at(&format!("{before}{pointing}"));
        let tracker = keys.tracker.at(&format!("{before}tracker"));
        let initial = initial(&initial_keys, check)?;
        let target = Pointing::check([pointing.ra_deg(), pointing.dec_deg(), pointing.roll_deg()], check)?;
        let tracker_delay = tracker.delay_ms().ms(check)?;
        let tag_error = tracker.tag_error_ms().ms(check)?;
        let actuation_delay = keys.control.at(&format!("{before}control")).delay_ms().ms(check)?;
        let telemetry_every = keys.telemetry.at(&format!("{before}telemetry")).every().check(check)?;
        let tracker_stars = tracker.stars().check(check)?;
        let tracker_commands = TrackerCommands::check(&tracker, check)?;
        let rate_deg_s = initial_keys.rate_deg_s().check(check)?;
        Ok(Self {
            spacecraft,
            initial,
            initial_rate_rad_s: DVec3::from_array(rate_deg_s.map(f64::to_radians)),
            target,
            tracker_delay,
            tag_error,
            tracker_stars,
            tracker_commands,
            actuation_delay,
            test_torques: Vec::new(),
            telemetry_every,
        })
    }
}

fn named_spacecraft(path: Option<&str>, check: &mut Checker<'_>) -> Result<Spacecraft> {
    let advice = "the path of a spacecraft file, relative to this one";
    let path = path.ok_or_else(|| check.invalid("spacecraft", "missing", "a path", advice))?;
    let spacecraft = Spacecraft::partly(&check.document.named("spacecraft", path)?)?;
    Ok(check.take(spacecraft))
}

fn initial(keys: &InitialKeys, check: &mut Checker<'_>) -> Result<Option<Pointing>> {
    let IsRandom(is_random) = keys.attitude().check(check)?;
    if is_random {
        keys.refuse(&["ra_deg", "dec_deg", "roll_deg"], "attitude = \"given\"", check)?;
        return Ok(None);
    }
    Pointing::check([keys.ra_deg(), keys.dec_deg(), keys.roll_deg()], check).map(Some)
}

/// Attitudes of a file, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct FilePlant {
    /// The attitudes.
    pub history: Arc<AttitudeHistory>,
    /// Which instant of the run its times belong to.
    pub begins: Begins,
    /// True: the body rests before the first and after the last row; false: no attitude is sent there.
    pub rests_outside: bool,
    /// Whether the file of the run states what is outside, rather than the format of the attitudes.
    pub outside_is_given: bool,
}

/// How the times of a file are placed on the clock of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Begins {
    /// Its zero, or its first row where its times are absolute, is the first exposure.
    FirstExposure,
    /// Its own times are those of the run.
    Utc,
}

impl FilePlant {
    /// Reads the file and checks that the run is within it.
    pub(super) fn check(keys: &PlantKeys, timing: &Timing, check: &mut Checker<'_>) -> Result<Self> {
        let given = keys.attitude();
        let sense = keys.sense().optional(check)?;
        let kernels = Kernels { file: keys.attitude(), texts: keys.kernels(), naif_id: keys.naif_id() };
        let history = match kernels.attitudes(check)? {
            Some(_) if sense.is_some() => {
                let wanted = "no sense: a kernel states its own frames";
                return Err(keys.sense().invalid("given", wanted, check));
            }
            Some(history) => history,
            None => {
                let (text, path) = text_of(&given, check)?;
                read::attitudes(&path, &text, sense).map_err(|error| refused(&given, &error, check))?
            }
        };
        let usual = match history.times {
            Times::Absolute => "utc",
            Times::FromZero => "first_exposure",
        };
        let begins = keys.begins().or_silently(usual).check(check)?;
        if begins == Begins::Utc && history.times == Times::FromZero {
            let wanted = "\"first_exposure\": the times of the file count from a zero of its own";
            return Err(keys.begins().invalid("\"utc\"", wanted, check));
        }
        let usual = if history.times == Times::FromZero { "rest" } else { "none" };
        let outside = keys.outside().or_silently(usual).check(check)?;
        let outside_is_given = keys.outside().is_given();
        let plant = Self { history: Arc::new(history), begins, rests_outside: outside, outside_is_given };
        plant.check_overlap(&given, timing, check)?;
        Ok(plant)
    }

    /// Refuses a file none of whose attitudes is within the run.
    fn check_overlap(&self, given: &Given<'_, String>, timing: &Timing, check: &Checker<'_>) -> Result<()> {
        let (StartTime::At(start), Begins::Utc) = (timing.start, self.begins) else { return Ok(()) };
        let end = start + Span::from_s(timing.duration_s) + LEAD + timing.phase;
        let [first, last] = self.history.span_ns().map(Tai::from_ns);
        if last >= start && first <= end {
            return Ok(());
        }
        let advice = format!(
            "set timing.start_utc = \"{}\", a second before the file begins, or plant.begins = \"first_exposure\"",
            (first - LEAD).to_rfc3339()
        );
        let wanted = format!("a time of the run, from {start} to {end}");
        Err(check.invalid(&given.key(), format!("attitudes from {first} to {last}"), wanted, &advice))
    }

    /// Returns the attitudes on the clock of a run whose first exposure is at `zero`.
    pub fn profile(&self, zero: Tai) -> FileProfile {
        let zero_ns = match (self.begins, self.history.times) {
            (Begins::Utc, _) => zero.ns(),
            (Begins::FirstExposure, Times::FromZero) => 0,
            (Begins::FirstExposure, Times::Absolute) => self.history.span_ns()[0],
        };
        FileProfile { history: Arc::clone(&self.history), zero, zero_ns, rests_outside: self.rests_outside }
    }
}

/// From the start of the clock to the first exposure.
const LEAD: Span = Span::from_ms(1000);

/// Returns the text of the file that a key names, and how messages call it.
pub(super) fn text_of(given: &Given<'_, String>, check: &Checker<'_>) -> Result<(String, String)> {
    let path = given.raw().ok_or_else(|| given.missing("the path of a file", check))?;
    let path = check.document.data_beside(path);
    let text = read::text_of(&path).map_err(|error| refused(given, &error, check))?;
    Ok((text, path.display().to_string()))
}

/// Sense of a table, by its names in files.
pub(super) const SENSES: [(&str, Sense); 2] = Sense::NAMES;

#[cfg(test)]
#[path = "plant_tests.rs"]
mod tests;
