//! `[flight_computer]`: the simulated one at the other end of the link.

use crate::check::{Checker, Rule};
use crate::error::ConfigError;
use base::units::{ARCSEC, DEG};
use glam::DVec3;
use plan::attitude::JitterLine;
use serde::Deserialize;

/// Least and largest right ascension that is taken, degrees: one turn to either side.
pub const RIGHT_ASCENSION_DEG: [f64; 2] = [-360.0, 360.0];
/// Highest rate of attitude messages the protocol has room for, Hz.
const HIGHEST_ATTITUDE_HZ: f64 = 100.0;
/// Highest rate of jitter samples the protocol has room for, Hz.
const HIGHEST_JITTER_HZ: f64 = 1000.0;

/// How jitter reaches the stimulator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JitterSource {
    /// As lines that both ends know.
    Lines,
    /// As samples over the bus.
    Samples,
}

/// One line of the jitter spectrum, sensor axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct JitterLineSettings {
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Amplitude about the sensor's x, y and z axes, arcsec.
    pub amplitude_arcsec: [f64; 3],
    /// Phase at the start of the run, deg.
    pub phase_deg: f64,
}

impl JitterLineSettings {
    /// The line as `plan::attitude` takes it, its epoch being the start of the run.
    #[must_use]
    pub fn line(&self) -> JitterLine {
        JitterLine {
            frequency_hz: self.frequency_hz,
            amplitude_rad: DVec3::from_array(self.amplitude_arcsec) * ARCSEC,
            phase_rad: self.phase_deg * DEG,
        }
    }
}

/// A rest-to-rest turn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slew {
    /// Unit vector of the axis, body axes.
    pub axis: [f64; 3],
    /// Angle, deg.
    pub angle_deg: f64,
    /// Begin, s after the start of the run.
    pub start_s: f64,
    /// Length, s.
    pub duration_s: f64,
}

/// The simulated flight computer, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct FlightComputer {
    /// True when it is no part of this program; the rates are then those expected of it.
    pub is_external: bool,
    /// Attitude messages per second.
    pub attitude_hz: f64,
    /// Right ascension of the sensor's boresight at the start, deg.
    pub ra_deg: f64,
    /// Declination of the boresight at the start, deg.
    pub dec_deg: f64,
    /// Position angle, east of north, of the image's up direction at the start, deg.
    pub roll_deg: f64,
    /// A turn during the run.
    pub slew: Option<Slew>,
    /// Jitter of the line of sight.
    pub jitter_lines: Vec<JitterLineSettings>,
    /// How it reaches the stimulator.
    pub jitter_source: JitterSource,
    /// Samples per second when it is sent as samples.
    pub jitter_sample_hz: f64,
    /// Drift of the flight computer's clock, parts per million (positive: it runs fast).
    pub clock_drift_ppm: f64,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct FlightComputerKeys {
    kind: Option<String>,
    attitude_hz: Option<f64>,
    ra_deg: Option<f64>,
    dec_deg: Option<f64>,
    roll_deg: Option<f64>,
    slew: Option<SlewKeys>,
    #[serde(default)]
    jitter_line: Vec<JitterLineKeys>,
    jitter_source: Option<String>,
    jitter_sample_hz: Option<f64>,
    clock_drift_ppm: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct SlewKeys {
    axis: Option<[f64; 3]>,
    angle_deg: Option<f64>,
    start_s: Option<f64>,
    duration_s: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
struct JitterLineKeys {
    frequency_hz: Option<f64>,
    amplitude_arcsec: Option<[f64; 3]>,
    phase_deg: Option<f64>,
}

impl FlightComputerKeys {
    /// Who is not simulated has no script.
    fn check_unused(&self, is_external: bool, check: &Checker<'_>) -> Result<(), ConfigError> {
        for (key, is_given) in [
            ("ra_deg", self.ra_deg.is_some()),
            ("dec_deg", self.dec_deg.is_some()),
            ("roll_deg", self.roll_deg.is_some()),
            ("slew", self.slew.is_some()),
            ("clock_drift_ppm", self.clock_drift_ppm.is_some()),
        ] {
            check.unused(&format!("flight_computer.{key}"), is_given && is_external, "kind = \"simulated\"")?;
        }
        Ok(())
    }
}

impl FlightComputer {
    /// Checks the flight computer; without `kind` it is the external one where the plant `is_outside`.
    pub(super) fn check(
        keys: &FlightComputerKeys,
        is_outside: bool,
        check: &mut Checker<'_>,
    ) -> Result<Self, ConfigError> {
        let kind = keys.kind.as_deref().or(is_outside.then_some("external"));
        let kinds = [("simulated", false), ("external", true)];
        let advice = "simulated is the one inside this program, external the one at the other end of the link";
        let is_external = check.choice("flight_computer.kind", kind, &kinds, advice)?;
        keys.check_unused(is_external, check)?;
        let sources = [("lines", JitterSource::Lines), ("samples", JitterSource::Samples)];
        let advice = "lines are known to both ends; samples travel over the bus";
        let jitter_source =
            check.choice("flight_computer.jitter_source", keys.jitter_source.as_deref(), &sources, advice)?;
        let jitter_lines = jitter_lines(&keys.jitter_line, check)?;
        let slew = keys.slew.as_ref().map(|slew| Slew::check(slew, check)).transpose()?;
        let mut number = |key: &str, given, default, rule, advice| {
            check.number(&format!("flight_computer.{key}"), given, default, rule, advice)
        };
        let turn = Rule::Within(RIGHT_ASCENSION_DEG[0], RIGHT_ASCENSION_DEG[1]);
        let rate = "messages per second; the protocol has room for 100";
        let checked = Self {
            is_external,
            attitude_hz: number("attitude_hz", keys.attitude_hz, 100.0, Rule::PositiveUpTo(HIGHEST_ATTITUDE_HZ), rate)?,
            ra_deg: number("ra_deg", keys.ra_deg, 0.0, turn, "degrees, not hours: 5h 30m is 82.5")?,
            dec_deg: number("dec_deg", keys.dec_deg, 0.0, Rule::Within(-90.0, 90.0), "degrees")?,
            roll_deg: number("roll_deg", keys.roll_deg, 0.0, turn, "degrees")?,
            slew,
            jitter_lines,
            jitter_source,
            jitter_sample_hz: number(
                "jitter_sample_hz",
                keys.jitter_sample_hz,
                HIGHEST_JITTER_HZ,
                Rule::PositiveUpTo(HIGHEST_JITTER_HZ),
                "samples per second; the protocol has room for 1000",
            )?,
            clock_drift_ppm: number(
                "clock_drift_ppm",
                keys.clock_drift_ppm,
                0.0,
                Rule::Within(-1000.0, 1000.0),
                "parts per million: 20 is a usual crystal",
            )?,
        };
        checked.check_sampling(check)?;
        Ok(checked)
    }

    /// Refuses a slew that would never begin.
    pub(super) fn check_slew_begins_before(&self, duration_s: f64, check: &Checker<'_>) -> Result<(), ConfigError> {
        let Some(slew) = self.slew.as_ref().filter(|slew| slew.start_s >= duration_s) else { return Ok(()) };
        let wanted = format!("a time before the run ends, at {duration_s} s");
        Err(check.invalid("flight_computer.slew.start_s", slew.start_s, wanted, "it would never begin"))
    }

    /// Samples must be able to carry the lines.
    fn check_sampling(&self, check: &Checker<'_>) -> Result<(), ConfigError> {
        for (key, hz) in [("attitude_hz", self.attitude_hz), ("jitter_sample_hz", self.jitter_sample_hz)] {
            if hz.fract() != 0.0 {
                let key = format!("flight_computer.{key}");
                return Err(check.invalid(&key, hz, "a whole number of messages per second", "such as 100"));
            }
        }
        let highest_hz = self.jitter_lines.iter().fold(0.0_f64, |highest, line| highest.max(line.frequency_hz));
        if self.jitter_source == JitterSource::Lines || self.jitter_sample_hz > 2.0 * highest_hz {
            return Ok(());
        }
        let advice = "raise it, lower the line's frequency, or use jitter_source = \"lines\"";
        let wanted = format!("more than twice the highest jitter line ({highest_hz} Hz)");
        Err(check.invalid("flight_computer.jitter_sample_hz", self.jitter_sample_hz, wanted, advice))
    }
}

impl Slew {
    fn check(keys: &SlewKeys, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        let key = "flight_computer.slew.axis";
        let given = keys.axis.unwrap_or([0.0; 3]);
        let norm = given.iter().map(|component| component * component).sum::<f64>().sqrt();
        if !(norm.is_finite() && norm > 1e-6) {
            let got = if keys.axis.is_some() { format!("{given:?}") } else { "missing".into() };
            let advice = "a direction in body axes, such as [0.0, 1.0, 0.0]";
            return Err(check.invalid(key, got, "three finite numbers that are not all 0", advice));
        }
        let mut number = |key: &str, given, default, rule, advice| {
            check.number(&format!("flight_computer.slew.{key}"), given, default, rule, advice)
        };
        let start_s = number("start_s", keys.start_s, 0.0, Rule::NotNegative, "seconds after the start of the run")?;
        let angle = "degrees to turn";
        let angle_deg =
            check.required("flight_computer.slew.angle_deg", keys.angle_deg, Rule::Within(-360.0, 360.0), angle)?;
        let length = "seconds the turn takes";
        let duration_s = check.required("flight_computer.slew.duration_s", keys.duration_s, Rule::Positive, length)?;
        Ok(Self { axis: given.map(|component| component / norm), angle_deg, start_s, duration_s })
    }
}

fn jitter_lines(keys: &[JitterLineKeys], check: &Checker<'_>) -> Result<Vec<JitterLineSettings>, ConfigError> {
    let line = |(place, keys): (usize, &JitterLineKeys)| {
        let key = |name: &str| format!("flight_computer.jitter_line[{place}].{name}");
        let hertz = "hertz, such as 50.0";
        let frequency_hz =
            check.required(&key("frequency_hz"), keys.frequency_hz, Rule::PositiveUpTo(10_000.0), hertz)?;
        let amplitude = "arcseconds about the sensor's x, y and z axes, such as [2.0, 1.0, 0.0]";
        let missing = || check.invalid(&key("amplitude_arcsec"), "missing", "three finite numbers", amplitude);
        let amplitude_arcsec = keys.amplitude_arcsec.ok_or_else(missing)?;
        for component in amplitude_arcsec {
            check.meets(&key("amplitude_arcsec"), component, Rule::Within(-36_000.0, 36_000.0), amplitude)?;
        }
        let phase_deg = keys.phase_deg.unwrap_or(0.0);
        check.meets(&key("phase_deg"), phase_deg, Rule::Within(-360.0, 360.0), "degrees at the start of the run")?;
        Ok(JitterLineSettings { frequency_hz, amplitude_arcsec, phase_deg })
    };
    keys.iter().enumerate().map(line).collect()
}
