//! Rows of attitudes, and how the attitude goes between two of them.
//!
//! | method | between rows `h` apart | error at most |
//! |---|---|---|
//! | slerp | the shortest turn, at a constant rate | `a h^2 / 8` for an angular acceleration `a` |
//! | cubic Hermite | cubic rotation vector with the rates of both rows | `s h^4 / 384` for a fourth derivative `s` |
//! | constant rate | the rate of the first row, for any number of turns | - |
//! | Lagrange of degree n | polynomial in the quaternion's components through n + 1 rows | of order `h^(n + 1)` |
//!
//! A cubic between rows that are more than [`MOST_TURN_RAD`] apart, by their attitudes or by their rates, is one beside a
//! turn at the mean of both rates: the rates say which way round, and how often, and the cubic is what is left.
//!
//! Rates of rotation vectors: `w = J(theta) dtheta/dt` with the right Jacobian of SO(3) (Sola et al. 2018, "A micro Lie
//! theory", eq. 143, 144). Rates of quaternions: `w = -2 dq/dt q^-1`. Tests: `tests::attitude`.

use crate::newton::{MOST_NODES, Newton};
use base::axes::{Body, Icrf, Rotation};
use base::units::NS_PER_S;
use core::fmt;
use glam::{DQuat, DVec3};

/// How the attitude goes between rows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AttitudeInterpolation {
    /// The shortest turn at a constant rate.
    Slerp,
    /// A cubic rotation vector that has the rates of both rows.
    CubicHermite,
    /// The rate of the row before, as a SPICE CK of type 2 has it.
    ConstantRate,
    /// A polynomial in the quaternion's components, of this degree.
    Lagrange(usize),
}

/// Highest degree of a polynomial.
pub(crate) const MOST_DEGREE: usize = MOST_NODES - 1;
/// Largest turn between two rows that a polynomial follows, rad.
pub(crate) const MOST_TURN_RAD: f64 = 2.5;

impl fmt::Display for AttitudeInterpolation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Slerp => write!(f, "slerp (constant rate between rows)"),
            Self::CubicHermite => write!(f, "cubic Hermite (rotation vector, with rates)"),
            Self::ConstantRate => write!(f, "constant rate, that of each record"),
            Self::Lagrange(degree) => write!(f, "Lagrange of degree {degree} (quaternion)"),
        }
    }
}

impl AttitudeInterpolation {
    /// Returns the motion at `t_ns` between rows `place` and `place + 1` of at least two.
    pub(crate) fn between(self, states: &[AttitudeState], place: usize, t_ns: i64) -> AttitudeMotion {
        let (before, after) = (&states[place], &states[place + 1]);
        match self {
            Self::Slerp => slerp(before, after, t_ns),
            Self::CubicHermite => hermite(before, after, t_ns),
            Self::ConstantRate => constant_rate(before, t_ns),
            Self::Lagrange(degree) => lagrange(around(states, place, degree + 1), t_ns),
        }
    }
}

/// Returns the rows that a polynomial of `count` nodes goes through: as many on both sides, where there are.
pub(crate) fn around<S>(states: &[S], place: usize, count: usize) -> &[S] {
    let count = count.min(states.len());
    let first = (place + 1).saturating_sub(count / 2).min(states.len() - count);
    &states[first..first + count]
}

/// Returns seconds from one count of nanoseconds to another.
pub(crate) fn s_between(from_ns: i64, to_ns: i64) -> f64 {
    to_ns.saturating_sub(from_ns) as f64 / NS_PER_S as f64
}

fn slerp(before: &AttitudeState, after: &AttitudeState, t_ns: i64) -> AttitudeMotion {
    let step_s = s_between(before.t_ns, after.t_ns);
    let rate_rad_s = before.body_from_icrf.rotation_vector_to(&after.body_from_icrf) / step_s;
    let body_from_icrf = before.body_from_icrf.rotated_by(rate_rad_s * s_between(before.t_ns, t_ns));
    AttitudeMotion { body_from_icrf, rate_rad_s, acceleration_rad_s2: DVec3::ZERO }
}

fn constant_rate(before: &AttitudeState, t_ns: i64) -> AttitudeMotion {
    let rate_rad_s = before.rate_rad_s.unwrap_or_default();
    let body_from_icrf = before.body_from_icrf.rotated_by(rate_rad_s * s_between(before.t_ns, t_ns));
    AttitudeMotion { body_from_icrf, rate_rad_s, acceleration_rad_s2: DVec3::ZERO }
}

/// Returns the rate beside which a cubic goes from row to row; `None` where the shortest turn is short enough for it, or
/// where the attitudes are not those of the rates.
fn steady_rate(before: &AttitudeState, after: &AttitudeState) -> Option<DVec3> {
    let mean = (before.rate_rad_s? + after.rate_rad_s?) / 2.0;
    let by_rates_rad = mean.length() * s_between(before.t_ns, after.t_ns);
    let turn_rad = before.body_from_icrf.rotation_vector_to(&after.body_from_icrf).length();
    let is_far = by_rates_rad.max(turn_rad) > MOST_TURN_RAD;
    (is_far && rest_of(mean, before, after).length() <= MOST_TURN_RAD).then_some(mean)
}

/// Returns the turn that is left from one row to the next beside one at this rate, rad.
fn rest_of(steady_rad_s: DVec3, before: &AttitudeState, after: &AttitudeState) -> DVec3 {
    let steady = steady_rad_s * s_between(before.t_ns, after.t_ns);
    before.body_from_icrf.rotated_by(steady).rotation_vector_to(&after.body_from_icrf)
}

/// Returns the turn from one row to the next, and the part of it that a cubic has to follow, rad.
pub(crate) fn turn_between(before: &AttitudeState, after: &AttitudeState) -> [DVec3; 2] {
    let whole = before.body_from_icrf.rotation_vector_to(&after.body_from_icrf);
    let Some(steady) = steady_rate(before, after) else { return [whole; 2] };
    let rest = rest_of(steady, before, after);
    [steady * s_between(before.t_ns, after.t_ns) + rest, rest]
}

/// Returns by how much the attitudes of two rows differ from what their rates make of the first one: the rest of their
/// turn, rad (Magnus' expansion to second order).
pub(crate) fn turn_beside_rates(before: &AttitudeState, after: &AttitudeState) -> Option<DVec3> {
    let (first, last) = (before.rate_rad_s?, after.rate_rad_s?);
    let step_s = s_between(before.t_ns, after.t_ns);
    let turn = (first + last) * (step_s / 2.0) + first.cross(last) * (step_s * step_s / 12.0);
    Some(before.body_from_icrf.rotated_by(turn).rotation_vector_to(&after.body_from_icrf))
}

/// Returns a vector in axes that have turned by `theta_rad`.
fn seen_after(theta_rad: DVec3, vector: DVec3) -> DVec3 {
    Rotation::<Body, Icrf>::from_rotation_vector(theta_rad).apply(vector)
}

/// Step of the central difference that makes the acceleration, of the time between two rows.
const DIFFERENCE: f64 = 1e-3;

fn hermite(before: &AttitudeState, after: &AttitudeState, t_ns: i64) -> AttitudeMotion {
    let (Some(first), Some(last)) = (before.rate_rad_s, after.rate_rad_s) else { return slerp(before, after, t_ns) };
    let step_s = s_between(before.t_ns, after.t_ns);
    let steady = steady_rate(before, after);
    let steadily = |t_s: f64| {
        steady.map_or(before.body_from_icrf, |rate_rad_s| before.body_from_icrf.rotated_by(rate_rad_s * t_s))
    };
    let turn = steadily(step_s).rotation_vector_to(&after.body_from_icrf);
    let begin = (first - steady.unwrap_or_default()) * step_s;
    let last = steady.map_or(last, |rate_rad_s| last - seen_after(turn, rate_rad_s));
    let end = inverse_jacobian(turn, last) * step_s;
    // In parts of the step: rotation vector and its derivative.
    let theta = |u: f64| begin * (u * (1.0 - u).powi(2)) + turn * (u * u * (3.0 - 2.0 * u)) + end * (u * u * (u - 1.0));
    let slope =
        |u: f64| begin * ((1.0 - u) * (1.0 - 3.0 * u)) + turn * (6.0 * u * (1.0 - u)) + end * (u * (3.0 * u - 2.0));
    let rate = |u: f64| {
        let beside = jacobian(theta(u), slope(u)) / step_s;
        steady.map_or(beside, |rate_rad_s| beside + seen_after(theta(u), rate_rad_s))
    };
    let u = s_between(before.t_ns, t_ns) / step_s;
    AttitudeMotion {
        body_from_icrf: steadily(u * step_s).rotated_by(theta(u)),
        rate_rad_s: rate(u),
        acceleration_rad_s2: (rate(u + DIFFERENCE) - rate(u - DIFFERENCE)) / (2.0 * DIFFERENCE * step_s),
    }
}

/// Below this angle the series of the Jacobian's coefficients are better than their closed forms, rad.
const SMALL_RAD: f64 = 1e-3;

/// Returns the right Jacobian of SO(3) at `theta`, times `v`.
fn jacobian(theta: DVec3, v: DVec3) -> DVec3 {
    let square = theta.length_squared();
    let angle = square.sqrt();
    let (a, b) = if angle < SMALL_RAD {
        (0.5 - square / 24.0, 1.0 / 6.0 - square / 120.0)
    } else {
        ((1.0 - angle.cos()) / square, (angle - angle.sin()) / (square * angle))
    };
    let once = theta.cross(v);
    v - a * once + b * theta.cross(once)
}

/// Returns its inverse at `theta`, of less than half a turn, times `v`.
fn inverse_jacobian(theta: DVec3, v: DVec3) -> DVec3 {
    let square = theta.length_squared();
    let angle = square.sqrt();
    let b = if angle < SMALL_RAD {
        1.0 / 12.0 + square / 720.0
    } else {
        1.0 / square - (1.0 + angle.cos()) / (2.0 * angle * angle.sin())
    };
    let once = theta.cross(v);
    v + 0.5 * once + b * theta.cross(once)
}

fn lagrange(states: &[AttitudeState], t_ns: i64) -> AttitudeMotion {
    let zero_ns = states[0].t_ns;
    let mut last = states[0].body_from_icrf.quat();
    let nodes = states.iter().map(|state| {
        let quaternion = state.body_from_icrf.quat();
        // q and -q are one attitude: the sign that continues.
        last = if quaternion.dot(last) < 0.0 { -quaternion } else { quaternion };
        (s_between(zero_ns, state.t_ns), last.to_array())
    });
    let [value, first, second] = Newton::through(nodes).at(s_between(zero_ns, t_ns)).map(DQuat::from_array);
    let inverse = value.inverse_of_any_norm();
    let turn = first * inverse;
    let bend = second * inverse - turn * turn;
    AttitudeMotion {
        body_from_icrf: Rotation::<Body, Icrf>::from_quat(value),
        rate_rad_s: -2.0 * DVec3::new(turn.x, turn.y, turn.z),
        acceleration_rad_s2: -2.0 * DVec3::new(bend.x, bend.y, bend.z),
    }
}

/// Inverse that `glam` has for unit quaternions only.
trait InverseOfAnyNorm {
    fn inverse_of_any_norm(self) -> Self;
}

impl InverseOfAnyNorm for DQuat {
    fn inverse_of_any_norm(self) -> Self {
        self.conjugate() * (1.0 / self.length_squared())
    }
}

/// Returns the body rate of a quaternion `body_from_icrf` that changes so fast.
pub(crate) fn rate_of_derivative(body_from_icrf: DQuat, derivative: DQuat) -> DVec3 {
    let turn = derivative * body_from_icrf.inverse_of_any_norm();
    -2.0 * DVec3::new(turn.x, turn.y, turn.z)
}

/// One row of a file.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudeState {
    /// Nanoseconds: of TAI since 1970, or since a zero of the file's own ([`Times`](crate::Times)).
    pub t_ns: i64,
    /// Attitude.
    pub body_from_icrf: Rotation<Body, Icrf>,
    /// Rate of the body with respect to ICRF, body axes.
    pub rate_rad_s: Option<DVec3>,
}

/// Attitude, rate and acceleration at one instant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AttitudeMotion {
    /// Attitude.
    pub body_from_icrf: Rotation<Body, Icrf>,
    /// Rate of the body with respect to ICRF, body axes.
    pub rate_rad_s: DVec3,
    /// Derivative of the rate.
    pub acceleration_rad_s2: DVec3,
}

impl AttitudeMotion {
    /// Returns the motion of a body at rest.
    pub fn at_rest(body_from_icrf: Rotation<Body, Icrf>) -> Self {
        Self { body_from_icrf, rate_rad_s: DVec3::ZERO, acceleration_rad_s2: DVec3::ZERO }
    }
}
