//! Slews that keep a sensor's boresight away from the Sun.
//!
//! Input: start, end, direction of the Sun. Output: a path of one to three turns whose boresight keeps outside the
//! cone. During a turn about an inertial axis `N` the cosine of the Sun's angle is `c + A cos(theta - phi)`, so the
//! closest approach is exact, not sampled. When the shortest turn comes too close, waypoints around the Sun are tried
//! and the quickest good path is taken. There always is one: away from or towards the Sun to the end's angle, around
//! the Sun at that angle, roll about the boresight; the Sun's angle is monotone, then constant.
//!
//! Assumptions: the Sun does not move during a slew (0.04 deg/h); `margin_rad` covers the tracking error and the
//! estimate's error; a slew that is broken off stops within `rate / (2 zeta wn)` of the coarse loop, wherever that is.
//! Starting or ending inside the margin is allowed and not made worse. Tests: `avoidance_tests.rs` (1000 random slews,
//! dense samples).

use super::slew::{Leg, SlewLimits, SlewPath};
use base::axes::{Body, Icrf, Rotation};
use core::f64::consts::{PI, TAU};
use glam::DVec3;

/// Rounding of angles along a path, rad.
const ROUNDING_RAD: f64 = 1e-9;
/// Sun angles tried for waypoints beyond what is asked, rad: enough to trade a wider arc for a shorter turn.
const BEYOND_RAD: [f64; 4] = [0.01, 0.1, 0.3, 0.6];
/// Parts of the way around the Sun at which waypoints are tried.
const PARTS: [f64; 3] = [0.25, 0.5, 0.75];

/// A cone about a boresight that the Sun must not enter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct KeepOut {
    /// Boresight, body axes; of any length.
    pub boresight_body: DVec3,
    /// Half angle of the cone, rad.
    pub half_angle_rad: f64,
    /// Kept beyond the half angle where the ends of a slew allow it, rad.
    pub margin_rad: f64,
}

/// Returns the angle between two vectors, rad; exact for small angles too.
fn angle_between(a: DVec3, b: DVec3) -> f64 {
    a.cross(b).length().atan2(a.dot(b))
}

impl KeepOut {
    /// Returns the angle between boresight and Sun, rad.
    pub fn sun_angle_rad(&self, body_from_icrf: &Rotation<Body, Icrf>, sun_icrf: DVec3) -> f64 {
        angle_between(self.boresight_icrf(body_from_icrf), sun_icrf)
    }

    /// Returns the smallest angle between boresight and Sun during one turn, rad, in closed form.
    pub fn closest_approach_rad(&self, leg: &Leg, sun_icrf: DVec3) -> f64 {
        let axis = leg.start().inverse().apply(leg.axis_body());
        let (b, sun) = (self.boresight_icrf(&leg.start()), sun_icrf.normalize_or_zero());
        let along = sun.dot(axis) * b.dot(axis);
        let phase = sun.dot(axis.cross(b)).atan2(sun.dot(b) - along).rem_euclid(TAU);
        let ends = angle_between(b, sun).min(self.sun_angle_rad(&leg.end(), sun));
        if leg.angle_rad() > 0.0 && phase <= leg.angle_rad() {
            ends.min(self.sun_angle_rad(&leg.start().rotated_by(leg.axis_body() * phase), sun))
        } else {
            ends
        }
    }

    /// Returns the smallest angle between boresight and Sun during a path, rad.
    pub fn closest_approach_of_path_rad(&self, path: &SlewPath, sun_icrf: DVec3) -> f64 {
        path.legs().iter().map(|leg| self.closest_approach_rad(leg, sun_icrf)).fold(PI, f64::min)
    }

    /// Returns the quickest path found from `start` to `end` that keeps half angle and margin, or, when an end is
    /// closer to the Sun than that, comes no closer than the ends.
    pub fn path(
        &self,
        start: Rotation<Body, Icrf>,
        end: &Rotation<Body, Icrf>,
        sun_icrf: DVec3,
        limits: &SlewLimits,
    ) -> SlewPath {
        let asked = self.half_angle_rad + self.margin_rad;
        let ends = self.sun_angle_rad(&start, sun_icrf).min(self.sun_angle_rad(end, sun_icrf));
        let wanted = asked.min(ends) - ROUNDING_RAD;
        let good = |path: &SlewPath| self.closest_approach_of_path_rad(path, sun_icrf) >= wanted;
        let direct = SlewPath::single(Leg::between(start, end, limits));
        if good(&direct) {
            return direct;
        }
        let around = Around::new(self, start, end, sun_icrf);
        let mut best = around.constant_angle_path(limits);
        for beyond in BEYOND_RAD {
            for part in PARTS {
                for turn in around.both_ways() {
                    let path = around.through((asked + beyond).min(PI), part, turn, limits);
                    if path.duration_s() < best.duration_s() && good(&path) {
                        best = path;
                    }
                }
            }
        }
        best
    }

    fn boresight_icrf(&self, body_from_icrf: &Rotation<Body, Icrf>) -> DVec3 {
        body_from_icrf.inverse().apply(self.boresight_body.normalize_or_zero())
    }
}

/// The Sun as pole: angle from it and azimuth around it, counted from the start's boresight.
struct Around<'a> {
    keep_out: &'a KeepOut,
    start: Rotation<Body, Icrf>,
    end: Rotation<Body, Icrf>,
    sun: DVec3,
    zero: DVec3,
    azimuth_rad: f64,
}

impl<'a> Around<'a> {
    fn new(keep_out: &'a KeepOut, start: Rotation<Body, Icrf>, end: &Rotation<Body, Icrf>, sun_icrf: DVec3) -> Self {
        let sun = sun_icrf.normalize_or_zero();
        let (b0, b1) = (keep_out.boresight_icrf(&start), keep_out.boresight_icrf(end));
        // At a pole the azimuth is free: take the other end's, then any.
        let across = |b: DVec3| (b - sun * b.dot(sun)).try_normalize().filter(|_| sun.cross(b).length() > 1e-7);
        let zero = across(b0).or_else(|| across(b1)).unwrap_or_else(|| sun.any_orthonormal_vector());
        let azimuth_rad = across(b1).map_or(0.0, |b1| b1.dot(sun.cross(zero)).atan2(b1.dot(zero)));
        Self { keep_out, start, end: *end, sun, zero, azimuth_rad }
    }

    fn both_ways(&self) -> [f64; 2] {
        [self.azimuth_rad, self.azimuth_rad - TAU.copysign(self.azimuth_rad)]
    }

    /// Returns two turns through a waypoint at `angle_rad` from the Sun, at `part` of the way around it by `turn_rad`.
    /// The waypoint is the shortest turn's attitude, tilted as little as puts the boresight there.
    fn through(&self, angle_rad: f64, part: f64, turn_rad: f64, limits: &SlewLimits) -> SlewPath {
        let (sin, cos) = (turn_rad * part).sin_cos();
        let across = self.zero * cos + self.sun.cross(self.zero) * sin;
        let wanted = self.sun * angle_rad.cos() + across * angle_rad.sin();
        let between = self.start.rotated_by(self.start.rotation_vector_to(&self.end) * part);
        let boresight = self.keep_out.boresight_icrf(&between);
        let axis = boresight.cross(wanted).try_normalize().unwrap_or_else(|| boresight.any_orthonormal_vector());
        let tilt = axis * angle_between(boresight, wanted);
        let waypoint = between.rotated_by(between.apply(tilt));
        let first = Leg::between(self.start, &waypoint, limits);
        let second = Leg::between(waypoint, &self.end, limits);
        SlewPath::new(&[first, second]).unwrap_or(SlewPath::single(first))
    }

    /// Returns the radially to the end's Sun angle, around the Sun, roll.
    fn constant_angle_path(&self, limits: &SlewLimits) -> SlewPath {
        let angle = |attitude| self.keep_out.sun_angle_rad(attitude, self.sun);
        let outward = self.sun.cross(self.zero) * (angle(&self.end) - angle(&self.start));
        let radial = Leg::turn(self.start, self.start.apply(outward), limits);
        let around = Leg::turn(radial.end(), radial.end().apply(self.sun * self.azimuth_rad), limits);
        let roll = Leg::between(around.end(), &self.end, limits);
        SlewPath::new(&[radial, around, roll]).unwrap_or(SlewPath::single(radial))
    }
}
