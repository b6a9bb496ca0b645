//! `[flight_computer.motion]`: motions of the simulated flight computer that begin in motion.
//!
//! In: a constant rate, sinusoids, or waypoints. Out: checked values, and the largest rate, acceleration and jerk, by
//! which rates that no history takes are refused. `src/guide/motion_and_jitter.md` has the formulas. Tests:
//! `motion_tests`.

use crate::key::{Section, listed, section, taken};
use crate::key_type::{Numbers, Word};
use crate::{check::Checker, error::Result, event::Pointing};
use base::axes::{Body, Icrf, Rotation, Sensor, sensor_from_ra_dec_roll};
use base::units::DEG;
use core::f64::consts::TAU;
use glam::DVec3;
use plan::attitude::{MOST_ACCELERATION_RAD_S2, MOST_RATE_RAD_S, MotionScale, Sinusoid};
use testbed::flight_computer::{AtWaypoints, Swing, WaypointError, WaypointMotion};

/// Farthest that the body may turn from one attitude message to the next, rad: no method of attitude has a bound
/// beyond.
const MOST_TURN_RAD: f64 = 1.0;
/// Most waypoints and sinusoids of a motion.
const MOST_ROWS: usize = 10_000;

/// A motion of the simulated flight computer.
#[derive(Debug, Clone, PartialEq)]
pub enum Motion {
    /// A constant rate, and sinusoids on top of it.
    Steady {
        /// Rate, body axes, deg/s.
        rate_deg_s: [f64; 3],
        /// Sinusoids.
        swings: Vec<Swing>,
    },
    /// A path through pointings of the boresight, each at its time in s after the start of the run.
    Waypoints {
        /// Whether the body stops at them.
        at_waypoints: AtWaypoints,
        /// Times and pointings.
        points: Vec<(f64, Pointing)>,
    },
}

section! {
    /// A motion that may begin in motion.
    MotionKeys at "flight_computer.motion" {
        /// Constant_rate turns for ever, sinusoidal swings about body axes, waypoints is a smooth path through
        /// pointings.
        kind: Word<Kind> = Needed, [
            ("constant_rate", Kind::ConstantRate), ("sinusoidal", Kind::Sinusoidal), ("waypoints", Kind::Waypoints),
        ], "constant_rate, sinusoidal or waypoints";
        /// Degrees per second about the body axes; before the run, too. With sinusoidal it is below the sinusoids.
        rate_deg_s: [f64; 3] = Silent(Numbers([0.0; 3])), Within(-1000.0, 1000.0);
        /// Stop rests at every waypoint, pass goes on at the mean of the rates before and after it.
        at_waypoints: Word<AtWaypoints> = "stop", [("stop", AtWaypoints::Stop), ("pass", AtWaypoints::Pass)];
        tables:
        /// A sinusoidal turn about a body axis.
        sinusoid: Vec<SinusoidKeys>;
        /// A pointing and its time.
        waypoint: Vec<WaypointKeys>;
    }

    /// A sinusoidal turn about a body axis.
    SinusoidKeys at "flight_computer.motion.sinusoid" {
        /// A direction in body axes, such as [0.0, 1.0, 0.0].
        axis: [f64; 3] = Needed, Finite;
        /// Degrees to either side.
        amplitude_deg: f64 = Needed, Within(0.0, 180.0);
        /// Hertz; below half of flight_computer.attitude_hz.
        frequency_hz: f64 = Needed, PositiveUpTo(50.0);
        /// Degrees at the start of the run; 0 passes through the middle.
        phase_deg: f64 = Silent(0.0), Within(-360.0, 360.0);
    }

    /// A pointing and its time.
    WaypointKeys at "flight_computer.motion.waypoint" {
        /// Seconds after the start of the run; before 0 the run begins in motion.
        t_s: f64 = Needed, Finite;
        /// Right ascension of the boresight, in degrees, not hours: 5h 30m is 82.5.
        ra_deg: f64 = Needed, Within(-360.0, 360.0);
        /// Declination of the boresight, degrees.
        dec_deg: f64 = Needed, Within(-90.0, 90.0);
        /// Position angle of the image's up direction, east of north, degrees.
        roll_deg: f64 = Silent(0.0), Within(-360.0, 360.0);
    }
}

/// Values of `kind`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    ConstantRate,
    Sinusoidal,
    Waypoints,
}

impl Motion {
    /// Checks a motion whose attitudes are sent `attitude_hz` times a second.
    pub(super) fn check(keys: &MotionKeys, attitude_hz: f64, check: &mut Checker<'_>) -> Result<Self> {
        let kind = keys.kind().check(check)?;
        let table = "flight_computer.motion";
        let unused = |name: &str, is_given: bool, owner: &str, check: &Checker<'_>| {
            check.unused(&format!("{table}.{name}"), is_given, owner)
        };
        unused("sinusoid", kind != Kind::Sinusoidal && !keys.sinusoid.is_empty(), "kind = \"sinusoidal\"", check)?;
        unused("waypoint", kind != Kind::Waypoints && !keys.waypoint.is_empty(), "kind = \"waypoints\"", check)?;
        let motion = match kind {
            Kind::ConstantRate | Kind::Sinusoidal => {
                keys.refuse(&["at_waypoints"], "kind = \"waypoints\"", check)?;
                Self::steady(keys, kind, check)?
            }
            Kind::Waypoints => {
                keys.refuse(&["rate_deg_s"], "kind = \"constant_rate\" or \"sinusoidal\"", check)?;
                Self::waypoints(keys, check)?
            }
        };
        motion.check_sampling(attitude_hz, check)?;
        Ok(motion)
    }

    fn steady(keys: &MotionKeys, kind: Kind, check: &mut Checker<'_>) -> Result<Self> {
        if kind == Kind::ConstantRate && !keys.rate_deg_s().is_given() {
            return Err(keys.rate_deg_s().missing("three rates", check));
        }
        if kind == Kind::Sinusoidal {
            check_count("sinusoid", keys.sinusoid.len(), 1, check)?;
        }
        let rate_deg_s = keys.rate_deg_s().check(check)?;
        let swings = listed(&keys.sinusoid, "flight_computer.motion.sinusoid");
        let swings = swings.iter().map(|keys| swing(keys, check)).collect::<Result<_, _>>()?;
        Ok(Self::Steady { rate_deg_s, swings })
    }

    fn waypoints(keys: &MotionKeys, check: &mut Checker<'_>) -> Result<Self> {
        check_count("waypoint", keys.waypoint.len(), 2, check)?;
        let at_waypoints = keys.at_waypoints().check(check)?;
        let listed = listed(&keys.waypoint, "flight_computer.motion.waypoint");
        let points = listed.iter().map(|keys| waypoint(keys, check)).collect::<Result<Vec<_>, _>>()?;
        let listed_times: Vec<f64> = points.iter().map(|(t_s, _)| *t_s).collect();
        let motion = Self::Waypoints { at_waypoints, points };
        let refused = |error: WaypointError| match error {
            WaypointError::NotRising { place } | WaypointError::TooFar { place } => {
                let key = format!("flight_computer.motion.waypoint[{place}].t_s");
                let t_s = listed_times.get(place).copied().unwrap_or_default();
                check.invalid(
                    &key,
                    t_s,
                    "rising times, and less than half a turn from one to the next",
                    &error.to_string(),
                )
            }
            WaypointError::TooFew { .. } => check.invalid("flight_computer.motion.waypoint", error, "two", "add one"),
        };
        motion.path(Rotation::IDENTITY).transpose().map_err(refused)?;
        Ok(motion)
    }

    /// Returns the path through waypoints in the axes of a body that carries the sensor so; nothing for a steady
    /// motion.
    ///
    /// # Errors
    /// Never for what was checked.
    pub fn path(&self, sensor_from_body: Rotation<Sensor, Body>) -> Option<Result<WaypointMotion, WaypointError>> {
        let Self::Waypoints { at_waypoints, points } = self else { return None };
        let rows: Vec<_> = points
            .iter()
            .map(|(t_s, pointing)| {
                let angles = [pointing.ra_deg, pointing.dec_deg, pointing.roll_deg].map(f64::to_radians);
                let attitude: Rotation<Body, Icrf> =
                    sensor_from_body.inverse() * sensor_from_ra_dec_roll(angles[0], angles[1], angles[2]);
                (*t_s, attitude)
            })
            .collect();
        Some(WaypointMotion::new(&rows, *at_waypoints))
    }

    /// Returns the largest rate, acceleration and jerk of the motion, and its sinusoids.
    pub fn scale(&self) -> MotionScale {
        match self {
            Self::Steady { rate_deg_s, swings } => MotionScale {
                rate_rad_s: DVec3::from_array(*rate_deg_s).length() * DEG,
                sinusoids: swings
                    .iter()
                    .map(|swing| Sinusoid { frequency_hz: swing.frequency_hz, amplitude_rad: swing.amplitude_rad })
                    .collect(),
                ..MotionScale::default()
            },
            Self::Waypoints { .. } => {
                let path = self.path(Rotation::IDENTITY).and_then(Result::ok);
                let [rate_rad_s, acceleration_rad_s2, jerk_rad_s3] = path.map_or([0.0; 3], |path| path.extremes());
                MotionScale { rate_rad_s, acceleration_rad_s2, jerk_rad_s3, sinusoids: Vec::new() }
            }
        }
    }

    /// Returns the first instant of the motion, s after the start of the run; nothing for one that has always been.
    pub(super) fn first_s(&self) -> Option<f64> {
        match self {
            Self::Steady { .. } => None,
            Self::Waypoints { points, .. } => points.first().map(|(t_s, _)| *t_s),
        }
    }

    /// Refuses what attitude messages cannot carry.
    fn check_sampling(&self, attitude_hz: f64, check: &Checker<'_>) -> Result<()> {
        let scale = self.scale();
        let tilt_rad_s: f64 = scale.sinusoids.iter().map(|s| s.amplitude_rad * TAU * s.frequency_hz).sum();
        let shake_rad_s2: f64 = scale.sinusoids.iter().map(|s| s.amplitude_rad * (TAU * s.frequency_hz).powi(2)).sum();
        let rate_rad_s = scale.rate_rad_s + tilt_rad_s;
        let acceleration_rad_s2 = scale.acceleration_rad_s2 + shake_rad_s2 + tilt_rad_s * rate_rad_s;
        let key = "flight_computer.motion.kind";
        if rate_rad_s > MOST_RATE_RAD_S || acceleration_rad_s2 > MOST_ACCELERATION_RAD_S2 {
            let got = format!("{:.1} deg/s, {:.1} deg/s^2", rate_rad_s / DEG, acceleration_rad_s2 / DEG);
            let wanted = "a motion of at most 1000 deg/s and 10000 deg/s^2";
            return Err(check.invalid(
                key,
                got,
                wanted,
                "faster attitudes are refused as errors of the bus: slow it down",
            ));
        }
        if rate_rad_s > MOST_TURN_RAD * attitude_hz {
            let got = format!("up to {:.1} deg/s at {attitude_hz} messages per second", rate_rad_s / DEG);
            let wanted = "at most a radian from one message to the next";
            return Err(check.invalid(key, got, wanted, "raise flight_computer.attitude_hz, or slow the motion down"));
        }
        let highest_hz = scale.highest_frequency_hz();
        if 2.0 * highest_hz >= attitude_hz {
            let wanted = format!("frequencies below half of flight_computer.attitude_hz ({} Hz)", 0.5 * attitude_hz);
            let advice =
                "attitudes between messages would be made up; faster motion is jitter: [[flight_computer.jitter_line]]";
            let place = scale.sinusoids.iter().position(|sinusoid| sinusoid.frequency_hz >= highest_hz).unwrap_or(0);
            let key = format!("flight_computer.motion.sinusoid[{place}].frequency_hz");
            return Err(check.invalid(&key, highest_hz, wanted, advice));
        }
        Ok(())
    }
}

fn check_count(name: &str, count: usize, least: usize, check: &Checker<'_>) -> Result<()> {
    if (least..=MOST_ROWS).contains(&count) {
        return Ok(());
    }
    let wanted = format!("{least} to {MOST_ROWS}");
    let advice = format!("[[flight_computer.motion.{name}]] for each");
    Err(check.invalid(&format!("flight_computer.motion.{name}"), count, wanted, &advice))
}

fn swing(keys: &SinusoidKeys, check: &mut Checker<'_>) -> Result<Swing> {
    taken!(check, keys => axis, amplitude_deg, frequency_hz, phase_deg);
    let norm = DVec3::from_array(axis).length();
    if !(norm.is_finite() && norm > 1e-6) {
        return Err(keys.axis().invalid(format!("{axis:?}"), "three finite numbers that are not all 0", check));
    }
    Ok(Swing {
        axis_body: DVec3::from_array(axis.map(|component| component / norm)),
        amplitude_rad: amplitude_deg * DEG,
        frequency_hz,
        phase_rad: phase_deg * DEG,
    })
}

fn waypoint(keys: &WaypointKeys, check: &mut Checker<'_>) -> Result<(f64, Pointing)> {
    let t_s = keys.t_s().check(check)?;
    Ok((t_s, Pointing::check([keys.ra_deg(), keys.dec_deg(), keys.roll_deg()], check)?))
}

#[cfg(test)]
#[path = "motion_tests.rs"]
mod tests;
