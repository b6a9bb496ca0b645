//! Targets: point sources that move over the detector by a script of their own, besides the camera's motion.
//!
//! In: where a target is first seen, its velocity then, and how the velocity changes. Out: its place at any instant, px,
//! as it would stand on the detector without the camera's motion within the exposure. A path is straight, accelerating,
//! or an arc (the velocity turns at a constant rate): kinematics of a point, any textbook. Smear as in the paper the
//! chain follows: length `sqrt(vx^2 + vy^2) T`, angle `atan2(vy, vx)`, of the velocity at the middle of the light.
//! Limits: brightness does not change while the target is seen. Tests: below, and `tests/physics/targets.rs`.

use crate::base::time::{Span, Tai};

/// Identifiers from here on are targets', in the order of the script.
pub const FIRST_TARGET_ID: u32 = 0xF000_0000;
/// Identifiers from here to the targets' are false stars'.
pub const FIRST_FALSE_STAR_ID: u32 = 0xE000_0000;

/// Identifiers from here to the false stars' are proton tracks', in the order of one frame.
pub const FIRST_TRACK_ID: u32 = 0xD000_0000;

/// Identifiers from here to the proton tracks' are bodies': planets by their number from the Sun, 9 for the Moon.
pub const FIRST_BODY_ID: u32 = 0xC000_0000;

/// How a target's velocity changes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TargetCurve {
    /// Not at all.
    Straight,
    /// By a constant acceleration, px/s^2.
    Accelerating([f64; 2]),
    /// It turns at this rate, rad/s, from x towards y (clockwise on the screen), and keeps its size: a circle.
    Arc(f64),
}

/// The way of a target over the detector; times count from where it is first seen.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TargetPath {
    /// Place when first seen, px.
    pub position_px: [f64; 2],
    /// Velocity then, px/s.
    pub velocity_px_s: [f64; 2],
    /// What becomes of the velocity.
    pub curve: TargetCurve,
}

/// One target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// Identifier in truth tables: [`FIRST_TARGET_ID`] and above.
    pub id: u32,
    /// Magnitude in the instrument's band (NaN: its light was given otherwise).
    pub mag: f32,
    /// Light into the whole image plane, e-/s.
    pub e_per_s: f64,
    /// First seen.
    pub begin: Tai,
    /// Last seen, exclusive.
    pub end: Tai,
    /// Its way.
    pub path: TargetPath,
}

/// Smear of a target's own motion in one exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Smear {
    /// Length, px.
    pub length_px: f64,
    /// Direction of motion, from x towards y, rad; 0 for one that stands still.
    pub angle_rad: f64,
}

/// Angles below this, rad, are summed by their series: the closed form loses digits.
const SMALL_TURN_RAD: f64 = 1e-4;

impl TargetPath {
    /// Place `t_s` after it is first seen, px.
    #[must_use]
    pub fn at(&self, t_s: f64) -> [f64; 2] {
        let ([x, y], [vx, vy]) = (self.position_px, self.velocity_px_s);
        match self.curve {
            TargetCurve::Straight => [x + vx * t_s, y + vy * t_s],
            TargetCurve::Accelerating([ax, ay]) => [x + (vx + 0.5 * ax * t_s) * t_s, y + (vy + 0.5 * ay * t_s) * t_s],
            TargetCurve::Arc(turn_rad_s) => {
                let [along, across] = chord(turn_rad_s * t_s);
                [x + t_s * (vx * along - vy * across), y + t_s * (vy * along + vx * across)]
            }
        }
    }

    /// Velocity `t_s` after it is first seen, px/s.
    #[must_use]
    pub fn velocity_at(&self, t_s: f64) -> [f64; 2] {
        let [vx, vy] = self.velocity_px_s;
        match self.curve {
            TargetCurve::Straight => [vx, vy],
            TargetCurve::Accelerating([ax, ay]) => [vx + ax * t_s, vy + ay * t_s],
            TargetCurve::Arc(turn_rad_s) => {
                let (sin, cos) = (turn_rad_s * t_s).sin_cos();
                [vx * cos - vy * sin, vy * cos + vx * sin]
            }
        }
    }

    /// Length of the way from one instant to another, px; an upper bound for an accelerating target.
    #[must_use]
    pub fn length_px(&self, from_s: f64, to_s: f64) -> f64 {
        let speed = |t_s: f64| self.velocity_at(t_s).into_iter().fold(0.0, f64::hypot);
        // A velocity that changes linearly is fastest at one of the ends.
        (to_s - from_s) * speed(from_s).max(speed(to_s))
    }
}

/// `sin(a) / a` and `(1 - cos(a)) / a`: the way along and across the first velocity on an arc of `a`.
fn chord(a: f64) -> [f64; 2] {
    if a.abs() < SMALL_TURN_RAD {
        return [1.0 - a * a / 6.0, 0.5 * a * (1.0 - a * a / 12.0)];
    }
    let half = (0.5 * a).sin();
    [a.sin() / a, 2.0 * half * half / a]
}

impl Target {
    /// When it is seen in an exposure from `from` to `to`: seconds after `begin`; `None` when it is not.
    #[must_use]
    pub fn seen_s(&self, from: Tai, to: Tai) -> Option<[f64; 2]> {
        let (from, to) = (from.max(self.begin), to.min(self.end));
        (to - from > Span::ZERO).then(|| [(from - self.begin).s(), (to - self.begin).s()])
    }

    /// Smear of its own motion between two instants, s after `begin`.
    #[must_use]
    pub fn smear(&self, [from_s, to_s]: [f64; 2]) -> Smear {
        let [vx, vy] = self.path.velocity_at(0.5 * (from_s + to_s));
        Smear { length_px: vx.hypot(vy) * (to_s - from_s), angle_rad: vy.atan2(vx) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::PI;

    fn path(curve: TargetCurve) -> TargetPath {
        TargetPath { position_px: [10.0, 20.0], velocity_px_s: [3.0, -4.0], curve }
    }

    #[test]
    fn an_arc_closes_and_its_radius_is_speed_over_turn() {
        let arc = path(TargetCurve::Arc(0.5));
        let [x, y] = arc.at(2.0 * PI / 0.5);
        assert!((x - 10.0).abs() < 1e-12 && (y - 20.0).abs() < 1e-12, "once around: {x} {y}");
        let [x, y] = arc.at(PI / 0.5);
        assert!(((x - 10.0).hypot(y - 20.0) - 2.0 * 5.0 / 0.5).abs() < 1e-12, "across: a diameter");
        assert!((arc.length_px(1.0, 3.0) - 10.0).abs() < 1e-12);
    }

    #[test]
    fn velocities_are_the_derivatives_of_places() {
        for curve in [TargetCurve::Straight, TargetCurve::Accelerating([0.7, 2.0]), TargetCurve::Arc(-0.8)] {
            let path = path(curve);
            let (h, t_s) = (1e-5, 1.7);
            let ([x0, y0], [x1, y1]) = (path.at(t_s - h), path.at(t_s + h));
            let [vx, vy] = path.velocity_at(t_s);
            assert!(((x1 - x0) / (2.0 * h) - vx).abs() < 1e-8, "{curve:?}");
            assert!(((y1 - y0) / (2.0 * h) - vy).abs() < 1e-8, "{curve:?}");
        }
    }

    #[test]
    fn a_slow_turn_is_as_good_as_the_closed_form() {
        for angle in [0.99 * SMALL_TURN_RAD, 1.01 * SMALL_TURN_RAD] {
            let [along, across] = chord(angle);
            assert!((along - (1.0 - angle * angle / 6.0)).abs() < 1e-16);
            assert!((across / angle - 0.5 * (1.0 - angle * angle / 12.0)).abs() < 1e-12);
        }
    }

    #[test]
    fn only_what_is_seen_smears() {
        let at = |s: f64| Tai::from_ns(0) + Span::from_s(s);
        let target = Target {
            id: FIRST_TARGET_ID,
            mag: f32::NAN,
            e_per_s: 1.0,
            begin: at(5.0),
            end: at(7.0),
            path: path(TargetCurve::Straight),
        };
        assert_eq!(target.seen_s(at(4.0), at(5.0)), None, "not yet");
        assert_eq!(target.seen_s(at(7.0), at(8.0)), None, "no more");
        assert_eq!(target.seen_s(at(4.0), at(5.5)), Some([0.0, 0.5]));
        assert_eq!(target.seen_s(at(6.5), at(7.5)), Some([1.5, 2.0]));
        let smear = target.smear([0.0, 0.5]);
        assert!((smear.length_px - 2.5).abs() < 1e-12 && (smear.angle_rad - (-4.0_f64).atan2(3.0)).abs() < 1e-15);
    }
}
