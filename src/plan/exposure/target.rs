//! Targets: point sources with their own motion over the detector, in addition to the camera's motion.
//!
//! In: a script on the detector (where a target is first seen, its velocity then, and how the velocity changes), or a
//! trajectory on the sky ([`SkyPath`]) that is computed for every exposure. Out: its place at any instant on the
//! detector without the camera's motion within the exposure. A script is straight, accelerating, or an arc (the
//! velocity turns at a constant rate): kinematics of a point, any textbook. Smear of a script as in the paper that the
//! chain follows: length `sqrt(vx^2 + vy^2) T`, angle `atan2(vy, vx)`, of the velocity at the middle of the light; of a
//! trajectory on the sky: the chord from its first place to its last. Brightness may change within an exposure
//! ([`LightCurve`]). Tests: below, and `tests/physics/targets.rs`.

use crate::{attitude::LosPath, exposure::sky_path::SkyPath, exposure::track::StarPlace};
use base::time::{Span, Tai};
use sky::astrometry::CameraGeometry;

/// First identifier of targets, which are numbered in the order of the script.
pub const FIRST_TARGET_ID: u32 = 0xF000_0000;
/// First identifier of false stars.
pub const FIRST_FALSE_STAR_ID: u32 = 0xE000_0000;

/// First identifier of proton tracks, which are numbered in the order of one frame.
pub const FIRST_TRACK_ID: u32 = 0xD000_0000;

/// First identifier of bodies: planets by their number from the Sun, 9 for the Moon.
pub const FIRST_BODY_ID: u32 = 0xC000_0000;

/// Change of a target's velocity.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TargetCurve {
    /// Constant velocity.
    Straight,
    /// Constant acceleration, px/s^2.
    Accelerating([f64; 2]),
    /// Constant speed with this rate of turn, rad/s, from x towards y (clockwise on the screen): a circle.
    Arc(f64),
}

/// Trajectory of a target over the detector; times count from its first appearance.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TargetPath {
    /// Place at its first appearance, px.
    pub position_px: [f64; 2],
    /// Velocity at that time, px/s.
    pub velocity_px_s: [f64; 2],
    /// Change of the velocity.
    pub curve: TargetCurve,
}

/// Trajectory of a target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum TargetWay {
    /// Over the detector, by a script.
    Script(TargetPath),
    /// On the sky, in one exposure.
    Sky(SkyPath),
}

/// Number of samples of a light curve.
pub const LIGHT_SAMPLES: usize = 17;

/// Light within one exposure: shares of [`Target::e_per_s`] at evenly spaced instants, linear between them. A penumbra
/// in a low orbit lasts 8 s: in an exposure of that length straight lines between 17 samples are within 0.4 % of its
/// curve; for shorter exposures the error falls with the square of the length.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightCurve {
    /// Time from mid-exposure to the first and the last sample, s.
    pub half_s: f64,
    /// Shares.
    pub shares: [f64; LIGHT_SAMPLES],
}

impl LightCurve {
    /// Returns the instants at which samples are needed, s after mid-exposure.
    pub fn instants_s(half_s: f64) -> [f64; LIGHT_SAMPLES] {
        core::array::from_fn(|i| half_s * (2.0 * i as f64 / (LIGHT_SAMPLES as f64 - 1.0) - 1.0))
    }

    /// Returns the share `t_s` after mid-exposure, constant beyond the samples.
    pub fn at(&self, t_s: f64) -> f64 {
        let place = (0.5 * (t_s / self.half_s + 1.0)).clamp(0.0, 1.0) * (LIGHT_SAMPLES as f64 - 1.0);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the samples")]
        let before = (place as usize).min(LIGHT_SAMPLES - 2);
        let [a, b] = [self.shares[before], self.shares[before + 1]];
        a + (b - a) * (place - before as f64)
    }
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
    /// Time of its first appearance.
    pub begin: Tai,
    /// End of its appearance, exclusive.
    pub end: Tai,
    /// Trajectory.
    pub way: TargetWay,
    /// Change of its light within the exposure; `None`: constant.
    pub light: Option<LightCurve>,
}

/// Smear of a target's own motion in one exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Smear {
    /// Length, px.
    pub length_px: f64,
    /// Direction of motion, from x towards y, rad; 0 for a static target.
    pub angle_rad: f64,
}

/// Angle below which a series is used, rad: the closed form loses digits.
const SMALL_TURN_RAD: f64 = 1e-4;

impl TargetPath {
    /// Returns the place `t_s` after its first appearance, px.
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

    /// Returns the velocity `t_s` after its first appearance, px/s.
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

    /// Returns the length of the trajectory from one instant to another, px; an upper bound for an accelerating target.
    pub fn length_px(&self, from_s: f64, to_s: f64) -> f64 {
        let speed = |t_s: f64| self.velocity_at(t_s).into_iter().fold(0.0, f64::hypot);
        // A velocity that changes linearly is fastest at one of the ends.
        (to_s - from_s) * speed(from_s).max(speed(to_s))
    }
}

/// Returns `sin(a) / a` and `(1 - cos(a)) / a`: displacement along and across the first velocity on an arc of `a`.
fn chord(a: f64) -> [f64; 2] {
    if a.abs() < SMALL_TURN_RAD {
        return [1.0 - a * a / 6.0, 0.5 * a * (1.0 - a * a / 12.0)];
    }
    let half = (0.5 * a).sin();
    [a.sin() / a, 2.0 * half * half / a]
}

impl Target {
    /// Returns the times of its appearance in an exposure from `from` to `to`: seconds after `begin`; `None` when it is
    /// not visible.
    pub fn seen_s(&self, from: Tai, to: Tai) -> Option<[f64; 2]> {
        let (from, to) = (from.max(self.begin), to.min(self.end));
        (to - from > Span::ZERO).then(|| [(from - self.begin).s(), (to - self.begin).s()])
    }

    /// Returns true when its light changes within the exposure.
    pub fn fades(&self) -> bool {
        self.light.is_some_and(|light| light.shares.iter().any(|share| (share - light.shares[0]).abs() > 1e-3))
    }

    /// Returns the light `t_s` after mid-exposure, e-/s.
    pub fn e_per_s_at(&self, t_s: f64) -> f64 {
        self.light.map_or(self.e_per_s, |light| self.e_per_s * light.at(t_s))
    }

    /// Returns its position `t_s` after mid-exposure without the camera's motion in the exposure, px; `None` when a
    /// trajectory on the sky leaves the camera's domain.
    pub fn own_px(&self, camera: &CameraGeometry, los: &LosPath, t_s: f64) -> Option<[f64; 2]> {
        match &self.way {
            TargetWay::Script(path) => Some(path.at(self.script_s(los) + t_s)),
            TargetWay::Sky(_) => self.own_place(camera, los, t_s).map(|place| place.mid_px),
        }
    }

    /// Returns the same as a place to which the camera's motion can be applied; `None` when no direction is imaged.
    pub fn own_place(&self, camera: &CameraGeometry, los: &LosPath, t_s: f64) -> Option<StarPlace> {
        match &self.way {
            TargetWay::Script(path) => StarPlace::of_pixel(camera, path.at(self.script_s(los) + t_s)),
            TargetWay::Sky(path) => {
                StarPlace::of_direction(camera, los.mid_sensor_from_icrf.apply(path.apparent_icrf(t_s)))
            }
        }
    }

    /// Returns the length of its own trajectory between two instants, s after mid-exposure, px; an upper bound if it
    /// accelerates.
    pub fn length_px(&self, camera: &CameraGeometry, los: &LosPath, [from_s, to_s]: [f64; 2]) -> f64 {
        match &self.way {
            TargetWay::Script(path) => {
                let mid_s = self.script_s(los);
                path.length_px(mid_s + from_s, mid_s + to_s)
            }
            TargetWay::Sky(path) => {
                let [fx, fy] = camera.parameters().focal_px;
                // Tangents grow by 1 / cos^2 of the angle off the axis.
                let off_axis = camera.half_diagonal_rad().cos().powi(2).max(1e-3);
                path.swept_rad(from_s, to_s) * fx.max(fy) / off_axis
            }
        }
    }

    /// Returns the smear of its own motion between two instants, s after mid-exposure.
    pub fn smear(&self, camera: &CameraGeometry, los: &LosPath, [from_s, to_s]: [f64; 2]) -> Smear {
        match &self.way {
            TargetWay::Script(path) => {
                let mid_s = self.script_s(los);
                let [vx, vy] = path.velocity_at(0.5 * ((mid_s + from_s) + (mid_s + to_s)));
                let length_px = vx.hypot(vy) * ((mid_s + to_s) - (mid_s + from_s));
                Smear { length_px, angle_rad: vy.atan2(vx) }
            }
            TargetWay::Sky(_) => {
                let ends = [from_s, to_s].map(|t_s| self.own_px(camera, los, t_s).unwrap_or([f64::NAN; 2]));
                let [[ax, ay], [bx, by]] = ends;
                Smear { length_px: (bx - ax).hypot(by - ay), angle_rad: (by - ay).atan2(bx - ax) }
            }
        }
    }

    /// Returns mid-exposure, s after a script starts.
    fn script_s(&self, los: &LosPath) -> f64 {
        (los.mid_exposure() - self.begin).s()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::axes::Rotation;
    use core::f64::consts::PI;
    use glam::DVec3;
    use sky::astrometry::{BrownConrady, CameraParameters};

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
            way: TargetWay::Script(path(TargetCurve::Straight)),
            light: None,
        };
        assert_eq!(target.seen_s(at(4.0), at(5.0)), None, "not yet");
        assert_eq!(target.seen_s(at(7.0), at(8.0)), None, "no more");
        assert_eq!(target.seen_s(at(4.0), at(5.5)), Some([0.0, 0.5]));
        assert_eq!(target.seen_s(at(6.5), at(7.5)), Some([1.5, 2.0]));
        let los = LosPath::commanded(Rotation::IDENTITY, at(5.0), 1.0);
        let smear = target.smear(&camera(), &los, [-0.5, 0.0]);
        assert!((smear.length_px - 2.5).abs() < 1e-12 && (smear.angle_rad - (-4.0_f64).atan2(3.0)).abs() < 1e-15);
    }

    fn camera() -> CameraGeometry {
        let parameters = CameraParameters {
            width_px: 512,
            height_px: 512,
            focal_px: [2_000.0; 2],
            principal_point_px: [255.5; 2],
            distortion: BrownConrady::default(),
        };
        CameraGeometry::new(parameters).expect("a camera")
    }

    #[test]
    fn a_way_on_the_sky_is_projected() {
        // From (-10, 5, 1000) to (10, 5, 1000) km in 2 s, the camera along z: 40 px along x, 10 px down.
        let way = |t_s: f64| DVec3::new(10.0 * t_s, 5.0, 1_000.0);
        let path = SkyPath::through(SkyPath::instants_s(1.0).map(way), 1.0, [DVec3::ZERO; 2]);
        let at = |s: f64| Tai::from_ns(0) + Span::from_s(s);
        let los = LosPath::commanded(Rotation::IDENTITY, at(5.0), 2.0);
        let (begin, end) = (at(5.0), at(7.0));
        let light = Some(LightCurve { half_s: 1.0, shares: [1.0; LIGHT_SAMPLES] });
        let target = Target { id: 0, mag: 0.0, e_per_s: 4.0, begin, end, way: TargetWay::Sky(path), light };
        let px = target.own_px(&camera(), &los, 0.5).expect("in view");
        assert!((px[0] - 265.5).abs() < 1e-9 && (px[1] - 265.5).abs() < 1e-9, "{px:?}");
        let smear = target.smear(&camera(), &los, [-1.0, 1.0]);
        assert!((smear.length_px - 40.0).abs() < 1e-9 && smear.angle_rad.abs() < 1e-12, "{smear:?}");
        let length = target.length_px(&camera(), &los, [-1.0, 1.0]);
        assert!((40.0..44.0).contains(&length), "{length}");
        assert!((target.e_per_s_at(0.3) - 4.0).abs() < 1e-15);
        let behind = SkyPath::through(SkyPath::instants_s(1.0).map(|t| -way(t)), 1.0, [DVec3::ZERO; 2]);
        assert_eq!(Target { way: TargetWay::Sky(behind), ..target }.own_px(&camera(), &los, 0.0), None);
    }

    #[test]
    fn a_light_curve_is_linear_between_its_samples_and_near_a_penumbra() {
        let instants = LightCurve::instants_s(4.0);
        assert!((instants[0] + 4.0).abs() < 1e-15 && (instants[16] - 4.0).abs() < 1e-15 && instants[8].abs() < 1e-15);
        // The straight limb crosses the disc in 8 s: share of a circle beyond a chord.
        let share = |t_s: f64| {
            let x = (t_s / 4.0).clamp(-1.0, 1.0);
            0.5 + (x * (1.0 - x * x).sqrt() + x.asin()) / PI
        };
        let worst = |half_s: f64| {
            let curve = LightCurve { half_s, shares: LightCurve::instants_s(half_s).map(share) };
            let at = (-500..=500).map(|i| f64::from(i) / 500.0 * half_s);
            at.map(|t_s| (curve.at(t_s) - share(t_s)).abs()).fold(0.0, f64::max)
        };
        assert!(worst(4.0) < 4e-3, "{}", worst(4.0));
        assert!(worst(1.0) < 2e-4, "{}", worst(1.0));
        assert!(worst(40.0) > 0.02, "control: in 80 s there are two samples to the penumbra: {}", worst(40.0));
    }
}
