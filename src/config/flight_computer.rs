//! `[flight_computer]`: the simulated one at the other end of the link.

use crate::key::{Section, listed, section, taken};
use crate::motion::{Motion, MotionKeys};
use crate::{check::Checker, error::Result, key_type::Word};
use base::units::{ARCSEC, DEG};
use core::f64::consts::PI;
use glam::DVec3;
use plan::attitude::{JitterLine, MOST_ACCELERATION_RAD_S2, MOST_RATE_RAD_S};
use testbed::flight_computer::JitterLineParams;

/// Least and largest right ascension that is taken, degrees: one turn to either side.
pub const RIGHT_ASCENSION_DEG: [f64; 2] = [-360.0, 360.0];
/// When the first waypoint is.
const FIRST_WAYPOINT: &str = "flight_computer.motion.waypoint[0].t_s";
/// Highest rate of attitude messages the protocol takes, Hz.
const HIGHEST_ATTITUDE_HZ: f64 = 100.0;
/// Highest rate of jitter samples the protocol takes, Hz.
const HIGHEST_JITTER_HZ: f64 = 1000.0;

/// How jitter reaches the stimulator.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum JitterSource {
    /// As lines that both ends know.
    Lines,
    /// As samples over the bus.
    Samples,
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
    /// True when it is a real or external one; the rates are then those expected of it.
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
    /// Another motion.
    pub motion: Option<Motion>,
    /// Jitter of the line of sight.
    pub jitter_lines: Vec<JitterLineParams>,
    /// How it reaches the stimulator.
    pub jitter_source: JitterSource,
    /// Samples per second when it is sent as samples.
    pub jitter_sample_hz: f64,
    /// Drift of the flight computer's clock, parts per million (positive: it runs fast).
    pub clock_drift_ppm: f64,
}

section! {
    /// The simulated flight computer at the other end of the link.
    FlightComputerKeys at "flight_computer" {
        /// Simulated is the one inside this program, external the one at the other end of the link.
        kind: Word<IsExternal> = "simulated", [("simulated", IsExternal(false)), ("external", IsExternal(true))];
        /// Messages per second; the protocol carries up to 100.
        attitude_hz: f64 = 100.0, PositiveUpTo(HIGHEST_ATTITUDE_HZ),
            "messages per second; the protocol carries up to 100";
        /// Right ascension of the boresight at the start, in degrees, not hours: 5h 30m is 82.5.
        ra_deg: f64 = 0.0, Within(RIGHT_ASCENSION_DEG[0], RIGHT_ASCENSION_DEG[1]);
        /// Declination of the boresight at the start, degrees.
        dec_deg: f64 = 0.0, Within(-90.0, 90.0);
        /// Position angle, east of north, of the image's up direction at the start, degrees.
        roll_deg: f64 = 0.0, Within(RIGHT_ASCENSION_DEG[0], RIGHT_ASCENSION_DEG[1]);
        /// Lines are known to both ends; samples travel over the bus.
        jitter_source: Word<JitterSource> = "lines",
            [("lines", JitterSource::Lines), ("samples", JitterSource::Samples)];
        /// Samples per second; the protocol carries up to 1000.
        jitter_sample_hz: f64 = HIGHEST_JITTER_HZ, PositiveUpTo(HIGHEST_JITTER_HZ);
        /// Drift of its clock in parts per million: 20 is a usual crystal.
        clock_drift_ppm: f64 = 0.0, Within(-1000.0, 1000.0);
        tables:
        /// A turn during the run, from rest to rest.
        slew: Option<SlewKeys>;
        /// A motion in place of a turn: a constant rate, sinusoids, or waypoints.
        motion: Option<MotionKeys>;
        /// A line of the spectrum of jitter of the line of sight.
        jitter_line: Vec<JitterLineKeys>;
    }

    /// A turn from rest to rest.
    SlewKeys at "flight_computer.slew" {
        /// A direction in body axes, such as [0.0, 1.0, 0.0].
        axis: [f64; 3] = Needed, Finite;
        /// Seconds after the start of the run.
        start_s: f64 = 0.0, NotNegative;
        /// Degrees to turn.
        angle_deg: f64 = Needed, Within(-360.0, 360.0);
        /// Seconds the turn takes.
        duration_s: f64 = Needed, Positive;
    }

    /// A line of the spectrum of jitter.
    JitterLineKeys at "flight_computer.jitter_line" {
        /// Hertz, such as 50.0.
        frequency_hz: f64 = Needed, PositiveUpTo(10_000.0);
        /// Arcseconds about the sensor's x, y and z axes, such as [2.0, 1.0, 0.0].
        amplitude_arcsec: [f64; 3] = Needed, Within(-36_000.0, 36_000.0);
        /// Degrees at the start of the run.
        phase_deg: f64 = Silent(0.0), Within(-360.0, 360.0);
    }
}

/// Whether the flight computer is external, not simulated here.
#[derive(Debug, Clone, Copy)]
pub(super) struct IsExternal(bool);

impl FlightComputer {
    /// Checks the flight computer; without `kind` it is the external one where the plant `is_outside`.
    pub(super) fn check(keys: &FlightComputerKeys, is_outside: bool, check: &mut Checker<'_>) -> Result<Self> {
        let kind = keys.kind();
        let IsExternal(is_external) =
            if is_outside && !kind.is_given() { IsExternal(true) } else { kind.check(check)? };
        if is_external {
            let of_simulated = ["ra_deg", "dec_deg", "roll_deg"];
            keys.refuse(&of_simulated, "kind = \"simulated\"", check)?;
            check.unused("flight_computer.slew", keys.slew.is_some(), "kind = \"simulated\"")?;
            check.unused("flight_computer.motion", keys.motion.is_some(), "kind = \"simulated\"")?;
            keys.refuse(&["clock_drift_ppm"], "kind = \"simulated\"", check)?;
        }
        let jitter_source = keys.jitter_source().check(check)?;
        let lines = listed(&keys.jitter_line, "flight_computer.jitter_line");
        let jitter_lines = lines.iter().map(|line| jitter_line(line, check)).collect::<Result<_, _>>()?;
        let slew = keys.slew.as_ref().map(|slew| Slew::check(slew, check)).transpose()?;
        if keys.motion.is_some() {
            check.unused("flight_computer.slew", keys.slew.is_some(), "a bench without [flight_computer.motion]")?;
        }
        taken!(check, keys => attitude_hz, ra_deg, dec_deg, roll_deg, jitter_sample_hz, clock_drift_ppm);
        let motion = keys.motion.as_ref().map(|keys| Motion::check(keys, attitude_hz, check)).transpose()?;
        if matches!(motion, Some(Motion::Waypoints { .. })) {
            keys.refuse(
                &["ra_deg", "dec_deg", "roll_deg"],
                "another motion than waypoints, which are pointings",
                check,
            )?;
        }
        let checked = Self {
            is_external,
            attitude_hz,
            ra_deg,
            dec_deg,
            roll_deg,
            slew,
            motion,
            jitter_lines,
            jitter_source,
            jitter_sample_hz,
            clock_drift_ppm,
        };
        checked.check_sampling(check)?;
        Ok(checked)
    }

    /// Returns the lines as `plan::attitude` takes them, their epoch being the start of the run.
    pub fn known_lines(&self) -> impl Iterator<Item = JitterLine> + '_ {
        self.jitter_lines.iter().map(|line| JitterLine {
            frequency_hz: line.frequency_hz,
            amplitude_rad: DVec3::from_array(line.amplitude_arcsec) * ARCSEC,
            phase_rad: line.phase_rad,
        })
    }

    /// Refuses a slew or a path that would never begin.
    pub(super) fn check_slew_begins_before(&self, duration_s: f64, check: &Checker<'_>) -> Result<()> {
        let slew = self.slew.as_ref().map(|slew| ("flight_computer.slew.start_s", slew.start_s));
        let path = self.motion.as_ref().and_then(Motion::first_s).map(|first_s| (FIRST_WAYPOINT, first_s));
        let Some((key, begin_s)) = slew.or(path).filter(|(_, begin_s)| *begin_s >= duration_s) else { return Ok(()) };
        let wanted = format!("a time before the run ends, at {duration_s} s");
        Err(check.invalid(key, begin_s, wanted, "it would never begin"))
    }

    /// Samples must be able to carry the lines.
    fn check_sampling(&self, check: &Checker<'_>) -> Result<()> {
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
    fn check(keys: &SlewKeys, check: &mut Checker<'_>) -> Result<Self> {
        let wanted = "three finite numbers that are not all 0";
        let given = keys.axis().raw().copied().ok_or_else(|| keys.axis().missing(wanted, check))?;
        let norm = given.iter().map(|component| component * component).sum::<f64>().sqrt();
        if !(norm.is_finite() && norm > 1e-6) {
            return Err(keys.axis().invalid(format!("{given:?}"), wanted, check));
        }
        taken!(check, keys => start_s, angle_deg, duration_s);
        // From rest to rest by 1 - cos: the fastest rate is twice the mean one.
        let (rate_deg_s, acceleration_deg_s2) =
            (2.0 * angle_deg.abs() / duration_s, 2.0 * PI * angle_deg.abs() / duration_s.powi(2));
        if rate_deg_s * DEG > MOST_RATE_RAD_S || acceleration_deg_s2 * DEG > MOST_ACCELERATION_RAD_S2 {
            let wanted = format!(
                "a turn of at most 1000 deg/s and 10000 deg/s^2; this one has {rate_deg_s:.0} deg/s, {acceleration_deg_s2:.0} deg/s^2"
            );
            let advice = "faster attitudes are refused as errors of the bus: take a longer time";
            return Err(keys.duration_s().advised(advice).invalid(duration_s, wanted, check));
        }
        Ok(Self { axis: given.map(|component| component / norm), angle_deg, start_s, duration_s })
    }
}

fn jitter_line(keys: &JitterLineKeys, check: &mut Checker<'_>) -> Result<JitterLineParams> {
    taken!(check, keys => frequency_hz, amplitude_arcsec, phase_deg);
    Ok(JitterLineParams { frequency_hz, amplitude_arcsec, phase_rad: phase_deg * DEG })
}
