//! Scripted motions that begin in motion: a constant rate with sinusoids on top of it, and a smooth path through
//! waypoints.
//!
//! *Steady motion.* The body turns at a constant rate about an axis fixed in it, and then by `A sin(2 pi f t + phase)` about
//! further axes, each fixed in the body that the turns before it have moved. All of it is closed form.
//!
//! *Waypoints.* Between two neighbours `q(t) = q0.rotated_by(phi(t))`, where `phi` is the quintic that has the attitude and
//! the rate of both waypoints and no acceleration there: attitude, rate and acceleration are continuous. Rate and
//! acceleration follow from `phi` by the kinematics of the rotation vector (Bortz 1971). Where the body stops at the
//! waypoints, each turn is about a fixed axis with the least jerk. Before the first waypoint and after the last it
//! rests.
//!
//! *Limits.* Less than 180 degrees between neighbours. Tests: finite differences, and formulas written by hand.

use base::axes::{Body, Icrf, Rotation};
use base::time::Tai;
use core::f64::consts::{PI, TAU};
use glam::{DQuat, DVec3};
use histories::AttitudeMotion;

/// A turn to and fro about an axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Swing {
    /// Axis, body axes; of any length but zero.
    pub axis_body: DVec3,
    /// Amplitude, rad.
    pub amplitude_rad: f64,
    /// Frequency, Hz.
    pub frequency_hz: f64,
    /// Phase at the zero of the motion, rad.
    pub phase_rad: f64,
}

/// A constant rate, and sinusoids on top of it, for ever.
#[derive(Debug, Clone, PartialEq)]
pub struct SteadyMotion {
    /// Attitude at `zero`, without the sinusoids.
    pub initial: Rotation<Body, Icrf>,
    /// When the body is there.
    pub zero: Tai,
    /// Rate, body axes, rad/s.
    pub rate_rad_s: DVec3,
    /// Sinusoids.
    pub swings: Vec<Swing>,
}

impl SteadyMotion {
    /// Returns attitude, rate and acceleration at `at`.
    pub fn at(&self, at: Tai) -> AttitudeMotion {
        let t_s = (at - self.zero).s();
        let start = AttitudeMotion {
            body_from_icrf: self.initial.rotated_by(self.rate_rad_s * t_s),
            rate_rad_s: self.rate_rad_s,
            acceleration_rad_s2: DVec3::ZERO,
        };
        self.swings.iter().fold(start, |truth, swing| swing.on(&truth, t_s))
    }
}

impl Swing {
    /// Returns the motion of a body that turns so in the axes of `truth`.
    fn on(&self, truth: &AttitudeMotion, t_s: f64) -> AttitudeMotion {
        let axis = self.axis_body.normalize_or_zero();
        let angular_rad_s = TAU * self.frequency_hz;
        let (sin, cos) = (TAU * (self.frequency_hz * t_s).fract() + self.phase_rad).sin_cos();
        let turn = axis * (self.amplitude_rad * sin);
        let tilt_rad_s = axis * (self.amplitude_rad * angular_rad_s * cos);
        let into_turned = DQuat::from_scaled_axis(-turn);
        let rate = into_turned * truth.rate_rad_s;
        AttitudeMotion {
            body_from_icrf: truth.body_from_icrf.rotated_by(turn),
            rate_rad_s: rate + tilt_rad_s,
            acceleration_rad_s2: into_turned * truth.acceleration_rad_s2
                - tilt_rad_s.cross(rate)
                - turn * (angular_rad_s * angular_rad_s),
        }
    }
}

/// A waypoint: seconds after the zero of the motion, and the attitude then.
pub type Waypoint = (f64, Rotation<Body, Icrf>);

/// How the body is at its waypoints.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AtWaypoints {
    /// At rest.
    Stop,
    /// Moving on, at the mean of the rates before and after; at rest at both ends and where a neighbour has the same
    /// pointing.
    Pass,
}

/// Why waypoints do not make a path.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum WaypointError {
    /// Fewer than two.
    #[error("{got} waypoints; wanted two or more")]
    TooFew {
        /// How many there are.
        got: usize,
    },
    /// A time is not after that of the waypoint before.
    #[error("waypoint {place} is not later than the one before it: sort them")]
    NotRising {
        /// Which one, from 0.
        place: usize,
    },
    /// The shortest turn from the waypoint before is not known.
    #[error("waypoint {place} is half a turn from the one before it: put one between them")]
    TooFar {
        /// Which one, from 0.
        place: usize,
    },
}

/// A smooth path through waypoints.
#[derive(Debug, Clone, PartialEq)]
pub struct WaypointMotion {
    pieces: Vec<Piece>,
}

/// The path between two waypoints.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Piece {
    begin_s: f64,
    length_s: f64,
    from: Rotation<Body, Icrf>,
    to: Rotation<Body, Icrf>,
    /// Coefficients of the rotation vector by powers of the time since `begin_s`, which begin with the first.
    powers: [DVec3; 5],
}

/// Turns this near to half a one have no shortest way that a rounding would not change, rad.
const HALF_TURN_MARGIN_RAD: f64 = 0.01;
/// Points per piece at which its rate, acceleration and jerk are found.
const SCAN_POINTS: u32 = 64;

impl WaypointMotion {
    /// Returns a path through these waypoints.
    ///
    /// # Errors
    /// Fewer than two, times that do not rise, or half a turn between neighbours.
    pub fn new(waypoints: &[Waypoint], at_waypoints: AtWaypoints) -> Result<Self, WaypointError> {
        if waypoints.len() < 2 {
            return Err(WaypointError::TooFew { got: waypoints.len() });
        }
        let mut turns = Vec::with_capacity(waypoints.len() - 1);
        for (place, pair) in (1..).zip(waypoints.windows(2)) {
            let length_s = pair[1].0 - pair[0].0;
            if !(length_s.is_finite() && length_s > 0.0) {
                return Err(WaypointError::NotRising { place });
            }
            let turn_rad = pair[0].1.rotation_vector_to(&pair[1].1);
            if turn_rad.length() > PI - HALF_TURN_MARGIN_RAD {
                return Err(WaypointError::TooFar { place });
            }
            turns.push((turn_rad, length_s));
        }
        let rates = rates_at(&turns, at_waypoints);
        let piece = |(place, (turn_rad, length_s)): (usize, &(DVec3, f64))| {
            let powers = quintic(*turn_rad, *length_s, [rates[place], rates[place + 1]]);
            let ((begin_s, from), (_, to)) = (waypoints[place], waypoints[place + 1]);
            Piece { begin_s, length_s: *length_s, from, to, powers }
        };
        Ok(Self { pieces: turns.iter().enumerate().map(piece).collect() })
    }

    /// Returns attitude, rate and acceleration `t_s` after the zero of the motion.
    pub fn at_s(&self, t_s: f64) -> AttitudeMotion {
        let place = self.pieces.partition_point(|piece| piece.begin_s <= t_s);
        let resting = |body_from_icrf| AttitudeMotion {
            body_from_icrf,
            rate_rad_s: DVec3::ZERO,
            acceleration_rad_s2: DVec3::ZERO,
        };
        match place.checked_sub(1).map(|place| &self.pieces[place]) {
            None => resting(self.pieces[0].from),
            Some(piece) if t_s >= piece.begin_s + piece.length_s => resting(piece.to),
            Some(piece) => piece.at(t_s - piece.begin_s),
        }
    }

    /// Returns bounds of rate, acceleration and jerk anywhere on the path, rad/s, rad/s^2, rad/s^3.
    ///
    /// Between scanned points a derivative of `phi` changes by no more than the next one allows. With `p1`, `p2`, `p3`
    /// bounds of the derivatives of `phi`, the body's rate is below `p1`, its acceleration below `p2 + p1^2 / 2`, its
    /// jerk below `p3 + 3 p1 p2 / 2 + p1^3 / 2`: the map from `phi'` to the rate is a mean of rotations by shares of
    /// `phi`.
    pub fn extremes(&self) -> [f64; 3] {
        self.pieces
            .iter()
            .map(Piece::extremes)
            .fold([0.0; 3], |most, own| core::array::from_fn(|order| f64::max(most[order], own[order])))
    }
}

/// Returns rates at the waypoints, body axes, rad/s, for turns and times between them.
fn rates_at(turns: &[(DVec3, f64)], at_waypoints: AtWaypoints) -> Vec<DVec3> {
    let mut rates = vec![DVec3::ZERO; turns.len() + 1];
    if at_waypoints == AtWaypoints::Pass {
        for (rate, pair) in rates[1..].iter_mut().zip(turns.windows(2)) {
            let [(before_rad, before_s), (after_rad, after_s)] = [pair[0], pair[1]];
            if before_rad.length() > 0.0 && after_rad.length() > 0.0 {
                // The slope of the parabola through three points. A turn's axis is the same in the axes of both its
                // ends.
                *rate = (before_rad / before_s * after_s + after_rad / after_s * before_s) / (before_s + after_s);
            }
        }
    }
    rates
}

/// Coefficients of the quintic from no turn to `turn_rad` with these rates and no acceleration at its ends.
fn quintic(turn_rad: DVec3, length_s: f64, [begin_rate, end_rate]: [DVec3; 2]) -> [DVec3; 5] {
    let h = length_s;
    let end_slope = slope_of_rate(turn_rad, end_rate);
    let end_curvature = curvature_without_acceleration(turn_rad, end_slope, end_rate);
    // Values that powers three to five must reach at the end.
    let (value, slope, curvature) = (turn_rad - begin_rate * h, (end_slope - begin_rate) * h, end_curvature * (h * h));
    let third = value * 10.0 - slope * 4.0 + curvature * 0.5;
    let fourth = value * -15.0 + slope * 7.0 - curvature;
    let fifth = value * 6.0 - slope * 3.0 + curvature * 0.5;
    [begin_rate, DVec3::ZERO, third / h.powi(3), fourth / h.powi(4), fifth / h.powi(5)]
}

impl Piece {
    fn at(&self, t_s: f64) -> AttitudeMotion {
        let [phi, slope, curvature] = [0, 1, 2].map(|order| self.derivative(order, t_s));
        AttitudeMotion {
            body_from_icrf: self.from.rotated_by(phi),
            rate_rad_s: rate_of_slope(phi, slope),
            acceleration_rad_s2: acceleration_of_curvature(phi, slope, curvature),
        }
    }

    /// Returns the derivative of the rotation vector, `t_s` after the start of the piece.
    fn derivative(&self, order: i32, t_s: f64) -> DVec3 {
        let terms = (1..).zip(&self.powers).filter(|(power, _)| *power >= order);
        terms.fold(DVec3::ZERO, |sum, (power, coefficient)| {
            let factor: f64 = (0..order).map(|down| f64::from(power - down)).product();
            sum + *coefficient * (factor * t_s.powi(power - order))
        })
    }

    fn extremes(&self) -> [f64; 3] {
        let step_s = self.length_s / f64::from(SCAN_POINTS);
        let scanned = |order: i32| {
            let length = |i: u32| self.derivative(order, step_s * f64::from(i)).length();
            (0..=SCAN_POINTS).map(length).fold(0.0, f64::max)
        };
        // The fourth derivative is a straight line: largest at an end.
        let p4 = scanned(4);
        let p3 = scanned(3) + 0.5 * step_s * p4;
        let p2 = scanned(2) + 0.5 * step_s * p3;
        let p1 = scanned(1) + 0.5 * step_s * p2;
        [p1, p2 + 0.5 * p1 * p1, p3 + 1.5 * p1 * p2 + 0.5 * p1.powi(3)]
    }
}

/// Below this angle the closed forms lose digits, and three terms of their series are exact to 4e-9.
const SERIES_BELOW_RAD: f64 = 0.2;

/// Returns `(1 - cos x) / x^2` and `(x - sin x) / x^3`, and the derivative of each divided by `x`.
fn shares_of_turn(x: f64) -> [f64; 4] {
    let x2 = x * x;
    if x < SERIES_BELOW_RAD {
        let series = |a: f64, b: f64, c: f64| a + x2 * (b + x2 * c);
        return [
            series(1.0 / 2.0, -1.0 / 24.0, 1.0 / 720.0) - x2.powi(3) / 40_320.0,
            series(1.0 / 6.0, -1.0 / 120.0, 1.0 / 5040.0) - x2.powi(3) / 362_880.0,
            series(-1.0 / 12.0, 1.0 / 180.0, -1.0 / 6720.0),
            series(-1.0 / 60.0, 1.0 / 1260.0, -1.0 / 60_480.0),
        ];
    }
    let (sin, cos) = x.sin_cos();
    [
        (1.0 - cos) / x2,
        (x - sin) / (x2 * x),
        (x * sin - 2.0 * (1.0 - cos)) / (x2 * x2),
        (3.0 * sin - 2.0 * x - x * cos) / (x2 * x2 * x),
    ]
}

/// Returns `(1 - x/2 cot(x/2)) / x^2`, and its derivative divided by `x`.
fn shares_of_slope(x: f64) -> [f64; 2] {
    let x2 = x * x;
    if x < SERIES_BELOW_RAD {
        let value = 1.0 / 12.0 + x2 * (1.0 / 720.0 + x2 * (1.0 / 30_240.0 + x2 / 1_209_600.0));
        return [value, 1.0 / 360.0 + x2 * (1.0 / 7560.0 + x2 / 201_600.0)];
    }
    let (sin, cos) = (0.5 * x).sin_cos();
    let cot = cos / sin;
    let derivative = -2.0 / (x2 * x) + 0.5 * cot / x2 + 0.25 / (sin * sin * x);
    [1.0 / x2 - 0.5 * cot / x, derivative / x]
}

fn rate_of_slope(phi: DVec3, slope: DVec3) -> DVec3 {
    let [c1, c2, ..] = shares_of_turn(phi.length());
    let across = phi.cross(slope);
    slope - across * c1 + phi.cross(across) * c2
}

fn acceleration_of_curvature(phi: DVec3, slope: DVec3, curvature: DVec3) -> DVec3 {
    let [c1, c2, d1, d2] = shares_of_turn(phi.length());
    let (across, growth) = (phi.cross(slope), phi.dot(slope));
    let across_curvature = phi.cross(curvature);
    curvature - across_curvature * c1
        + (slope.cross(across) + phi.cross(across_curvature)) * c2
        + (phi.cross(across) * d2 - across * d1) * growth
}

fn slope_of_rate(phi: DVec3, rate: DVec3) -> DVec3 {
    let [k, _] = shares_of_slope(phi.length());
    let across = phi.cross(rate);
    rate + across * 0.5 + phi.cross(across) * k
}

/// Returns the second derivative of the rotation vector where the body turns at `rate` and does not accelerate.
fn curvature_without_acceleration(phi: DVec3, slope: DVec3, rate: DVec3) -> DVec3 {
    let [k, dk] = shares_of_slope(phi.length());
    let (across, slope_across) = (phi.cross(rate), slope.cross(rate));
    slope_across * 0.5 + (slope.cross(across) + phi.cross(slope_across)) * k + phi.cross(across) * (dk * phi.dot(slope))
}

#[cfg(test)]
#[path = "motion_tests.rs"]
mod tests;
