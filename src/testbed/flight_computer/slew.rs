//! Attitude over time: scripted, a turn about one body axis, with its rate and acceleration in closed form.
//!
//! Rate: up a ramp, constant, down the same ramp. With `theta(t)` the angle turned about the unit axis `a`: `q(t) =
//! exp(-a theta / 2) q(0)`, rate `a theta'`, acceleration `a theta''`. Exact, because the axis is fixed in the body.
//! `tests` below: finite differences.
//!
//! Or from a file of times and quaternions, such as a simulator or a flight gives. Between two rows the file's interpolation applies (`histories::attitude`); a gap of the file has no attitude.
//! Before its first row and after its last one the body rests, or there is none, as the plant says.

use crate::flight_computer::motion::{SteadyMotion, WaypointMotion};
use base::axes::{Body, Icrf, Rotation, sensor_from_ra_dec_roll};
use base::time::Tai;
use core::f64::consts::PI;
use glam::DVec3;
use histories::{AttitudeHistory, AttitudeMotion};
use std::sync::Arc;

/// How the rate rises to its peak.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RampShape {
    /// Linear: the acceleration is constant and steps at the corners.
    Trapezoid,
    /// `(1 - cos) / 2`: the acceleration is a half sine, without steps.
    Versine,
}

/// One turn about a body axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slew {
    /// Axis, body axes; of any length. Zero: no turn.
    pub axis_body: DVec3,
    /// Angle, rad; negative turns the other way.
    pub angle_rad: f64,
    /// Highest rate, rad/s. Reduced when the angle is too small to reach it.
    pub peak_rate_rad_s: f64,
    /// Time from rest to the highest rate, s. Zero: at once.
    pub ramp_s: f64,
    /// How the rate rises and falls.
    pub shape: RampShape,
}

/// Attitude over time: at rest, one turn, at rest.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SlewProfile {
    initial: Rotation<Body, Icrf>,
    axis: DVec3,
    start: Tai,
    peak_rate_rad_s: f64,
    ramp_s: f64,
    cruise_s: f64,
    shape: RampShape,
}

/// Returns the attitude of a body whose +Z points at (`ra_rad`, `dec_rad`), rolled as a sensor's image would be: body
/// and sensor axes coincide.
pub fn body_from_ra_dec_roll(ra_rad: f64, dec_rad: f64, roll_rad: f64) -> Rotation<Body, Icrf> {
    Rotation::from_quat(sensor_from_ra_dec_roll(ra_rad, dec_rad, roll_rad).quat())
}

impl SlewProfile {
    /// Makes a motion at rest for ever.
    pub fn hold(body_from_icrf: Rotation<Body, Icrf>) -> Self {
        Self::turning(body_from_icrf, Tai::from_ns(0), DVec3::ZERO)
    }

    /// Makes a motion at rest until `start`, then turning at a constant rate (body axes) for ever.
    pub fn turning(initial: Rotation<Body, Icrf>, start: Tai, rate_rad_s: DVec3) -> Self {
        Self {
            initial,
            axis: rate_rad_s.normalize_or_zero(),
            start,
            peak_rate_rad_s: rate_rad_s.length(),
            ramp_s: 0.0,
            cruise_s: f64::INFINITY,
            shape: RampShape::Trapezoid,
        }
    }

    /// Makes a motion at rest until `start`, one turn, at rest.
    pub fn slew(initial: Rotation<Body, Icrf>, start: Tai, slew: &Slew) -> Self {
        let angle_rad = slew.angle_rad.abs();
        let ramp_s = slew.ramp_s.max(0.0);
        // Both ramps together turn by peak * ramp.
        let peak_rate_rad_s = slew.peak_rate_rad_s.abs().min(angle_rad / ramp_s);
        let cruise_s = if peak_rate_rad_s > 0.0 { (angle_rad / peak_rate_rad_s - ramp_s).max(0.0) } else { 0.0 };
        let axis = slew.axis_body.normalize_or_zero() * slew.angle_rad.signum();
        Self { initial, axis, start, peak_rate_rad_s, ramp_s, cruise_s, shape: slew.shape }
    }

    /// Returns when the turn is over, s after its start; infinite for a constant rate.
    pub fn duration_s(&self) -> f64 {
        2.0 * self.ramp_s + self.cruise_s
    }

    /// Returns attitude, rate and acceleration at `at`.
    pub fn at(&self, at: Tai) -> AttitudeMotion {
        let [angle_rad, rate_rad_s, acceleration_rad_s2] = self.about_axis((at - self.start).s());
        AttitudeMotion {
            body_from_icrf: self.initial.rotated_by(self.axis * angle_rad),
            rate_rad_s: self.axis * rate_rad_s,
            acceleration_rad_s2: self.axis * acceleration_rad_s2,
        }
    }

    /// Returns angle, rate and acceleration `t_s` after the start.
    fn about_axis(&self, t_s: f64) -> [f64; 3] {
        let (peak, ramp_s) = (self.peak_rate_rad_s, self.ramp_s);
        let left_s = self.duration_s() - t_s;
        if t_s <= 0.0 {
            [0.0; 3]
        } else if t_s < ramp_s {
            self.on_ramp(t_s)
        } else if left_s > ramp_s {
            [peak * (t_s - 0.5 * ramp_s), peak, 0.0]
        } else {
            let whole_rad = peak * (ramp_s + self.cruise_s);
            let [to_go_rad, rate, acceleration] = if left_s > 0.0 { self.on_ramp(left_s) } else { [0.0; 3] };
            [whole_rad - to_go_rad, rate, -acceleration]
        }
    }

    /// Returns angle, rate and acceleration `t_s` into the ramp up.
    fn on_ramp(&self, t_s: f64) -> [f64; 3] {
        let (peak, ramp_s, share) = (self.peak_rate_rad_s, self.ramp_s, t_s / self.ramp_s);
        let [integral, value, slope] = match self.shape {
            RampShape::Trapezoid => [0.5 * share * share, share, 1.0],
            RampShape::Versine => {
                let (sin, cos) = (PI * share).sin_cos();
                [0.5 * (share - sin / PI), 0.5 * (1.0 - cos), 0.5 * PI * sin]
            }
        };
        [peak * ramp_s * integral, peak * value, peak / ramp_s * slope]
    }
}

/// Attitudes of a file, laid upon the clock of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct FileProfile {
    /// The attitudes.
    pub history: Arc<AttitudeHistory>,
    /// An instant of the run.
    pub zero: Tai,
    /// The count of the file, ns, at that instant.
    pub zero_ns: i64,
    /// Whether the body rests before the first and after the last row; else it has no attitude there.
    pub rests_outside: bool,
}

impl FileProfile {
    /// Returns whether `at` is before the first or after the last row, and the body rests there.
    pub fn rests_at(&self, at: Tai) -> bool {
        let t_ns = (at - self.zero).ns().saturating_add(self.zero_ns);
        let [first_ns, last_ns] = self.history.span_ns();
        self.rests_outside && !(first_ns..=last_ns).contains(&t_ns)
    }

    /// Returns attitude, rate and acceleration at `at`; `None` where the file has none.
    pub fn at(&self, at: Tai) -> Option<AttitudeMotion> {
        let t_ns = (at - self.zero).ns().saturating_add(self.zero_ns);
        let [first_ns, last_ns] = self.history.span_ns();
        let inside_ns = t_ns.clamp(first_ns, last_ns);
        if inside_ns != t_ns && !self.rests_outside {
            return None;
        }
        let motion = self.history.at_ns(inside_ns)?;
        // The last row is where rest begins: a rate there would be that of the step before it.
        if self.rests_outside && (t_ns < first_ns || t_ns >= last_ns) {
            return Some(AttitudeMotion::at_rest(motion.body_from_icrf));
        }
        Some(motion)
    }
}

/// Attitude over time, when no vehicle flies it.
#[derive(Debug, Clone, PartialEq)]
pub enum Profile {
    /// At rest, one turn, at rest.
    Script(SlewProfile),
    /// Attitudes of a file.
    File(FileProfile),
    /// A constant rate with sinusoids on top of it.
    Steady(SteadyMotion),
    /// A path through waypoints whose zero is at this instant.
    Waypoints(WaypointMotion, Tai),
}

impl Profile {
    /// Returns attitude, rate and acceleration at `at`; `None` where there is none.
    pub fn at(&self, at: Tai) -> Option<AttitudeMotion> {
        match self {
            Self::Script(profile) => Some(profile.at(at)),
            Self::File(profile) => profile.at(at),
            Self::Steady(motion) => Some(motion.at(at)),
            Self::Waypoints(motion, zero) => Some(motion.at_s((at - *zero).s())),
        }
    }
}

impl From<SlewProfile> for Profile {
    fn from(profile: SlewProfile) -> Self {
        Self::Script(profile)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::{time::Span, units::DEG};

    const START: Tai = Tai::from_ns(5_000_000_000);
    /// Step of the central differences.
    const STEP_S: f64 = 1e-4;
    /// Third derivative (below 0.1 rad/s^4 here) times `STEP_S^2 / 6`, and f64 rounding `1e-16 / STEP_S`, with a
    /// margin.
    const DIFFERENCE: f64 = 2e-9;

    fn profile(shape: RampShape) -> SlewProfile {
        let axis_body = DVec3::new(1.0, -2.0, 0.5);
        let slew = Slew { axis_body, angle_rad: 20.0 * DEG, peak_rate_rad_s: 2.0 * DEG, ramp_s: 3.0, shape };
        SlewProfile::slew(body_from_ra_dec_roll(1.0, -0.5, 2.0), START, &slew)
    }

    fn after(profile: &SlewProfile, t_s: f64) -> AttitudeMotion {
        profile.at(START + Span::from_s(t_s))
    }

    #[test]
    fn rate_and_acceleration_are_the_derivatives() {
        for shape in [RampShape::Trapezoid, RampShape::Versine] {
            let profile = profile(shape);
            // Away from the trapezoid's corners at 0, 3, 10 and 13 s.
            for t_s in [-1.0, 0.7, 1.5, 2.9, 5.0, 9.9, 10.4, 12.5, 14.0] {
                let (before, now, later) =
                    (after(&profile, t_s - STEP_S), after(&profile, t_s), after(&profile, t_s + STEP_S));
                let turned = before.body_from_icrf.rotation_vector_to(&later.body_from_icrf) / (2.0 * STEP_S);
                assert!((turned - now.rate_rad_s).length() < DIFFERENCE, "{shape:?} {t_s} s: rate");
                let change = (later.rate_rad_s - before.rate_rad_s) / (2.0 * STEP_S);
                assert!((change - now.acceleration_rad_s2).length() < DIFFERENCE, "{shape:?} {t_s} s: acceleration");
            }
        }
    }

    #[test]
    fn one_step_of_the_kinematics_is_rotated_by() {
        let profile = profile(RampShape::Versine);
        let (now, later) = (after(&profile, 5.0), after(&profile, 5.01));
        let wanted = now.body_from_icrf.rotated_by(now.rate_rad_s * 0.01);
        assert!(wanted.rotation_vector_to(&later.body_from_icrf).length() < 1e-15, "constant rate: exact");
        let wrong = now.body_from_icrf.rotated_by(-now.rate_rad_s * 0.01);
        assert!(wrong.rotation_vector_to(&later.body_from_icrf).length() > 1e-4, "negative control");
    }

    #[test]
    fn the_whole_angle_is_turned_and_then_held() {
        for shape in [RampShape::Trapezoid, RampShape::Versine] {
            let profile = profile(shape);
            assert!((profile.duration_s() - 13.0).abs() < 1e-12, "20 deg at 2 deg/s, ramps of 3 s");
            let (first, last) = (after(&profile, -1.0), after(&profile, 13.0));
            let turned = first.body_from_icrf.rotation_vector_to(&last.body_from_icrf);
            assert!((turned.length() - 20.0 * DEG).abs() < 1e-14, "{shape:?}: {turned}");
            assert_eq!(after(&profile, 100.0).rate_rad_s.length(), 0.0);
            assert!(after(&profile, 100.0).body_from_icrf.rotation_vector_to(&last.body_from_icrf).length() < 1e-15);
        }
    }

    #[test]
    fn a_small_turn_lowers_the_peak_and_a_negative_one_turns_back() {
        let slew = Slew {
            axis_body: DVec3::Z * 7.0,
            angle_rad: -0.01,
            peak_rate_rad_s: 1.0,
            ramp_s: 2.0,
            shape: RampShape::Versine,
        };
        let profile = SlewProfile::slew(Rotation::IDENTITY, START, &slew);
        let end = after(&profile, 4.0);
        let turned = Rotation::IDENTITY.rotation_vector_to(&end.body_from_icrf);
        assert!((turned - DVec3::Z * -0.01).length() < 1e-15, "{turned}");
        assert!((after(&profile, 2.0).rate_rad_s.z + 0.005).abs() < 1e-15, "peak = angle / ramp");
    }

    #[test]
    fn degenerate_turns_are_rest() {
        let still = Slew {
            axis_body: DVec3::ZERO,
            angle_rad: 0.0,
            peak_rate_rad_s: 0.0,
            ramp_s: 0.0,
            shape: RampShape::Trapezoid,
        };
        for profile in [SlewProfile::slew(Rotation::IDENTITY, START, &still), SlewProfile::hold(Rotation::IDENTITY)] {
            let truth = after(&profile, 3.0);
            assert_eq!(truth.body_from_icrf, Rotation::IDENTITY);
            assert_eq!((truth.rate_rad_s, truth.acceleration_rad_s2), (DVec3::ZERO, DVec3::ZERO));
        }
    }
}

#[cfg(test)]
mod table_tests {
    use super::*;
    use base::axes::{Body, Icrf, Rotation};
    use base::time::Span;

    fn turned(angle_rad: f64) -> Rotation<Body, Icrf> {
        Rotation::IDENTITY.rotated_by(DVec3::new(0.0, angle_rad, 0.0))
    }

    fn profile(rows: &str, rests_outside: bool) -> FileProfile {
        let history = Arc::new(histories::read::attitudes("rows", rows, None).unwrap());
        FileProfile { history, zero: Tai::from_ns(7_000_000_000), zero_ns: 0, rests_outside }
    }

    #[test]
    fn between_rows_the_body_turns_evenly_and_outside_it_rests() {
        let row = |t_s: f64, angle_rad: f64| {
            let [w, x, y, z] = turned(angle_rad).wxyz();
            format!("{t_s} {w} {x} {y} {z}\n")
        };
        let profile = profile(&(row(1.0, 0.0) + &row(3.0, 0.2) + &row(4.0, 0.2)), true);
        let at = |t_s: f64| profile.at(profile.zero + Span::from_s(t_s)).unwrap();
        assert!(at(1.5).body_from_icrf.rotation_vector_to(&turned(0.05)).length() < 1e-12);
        assert!((at(2.9).rate_rad_s.y - 0.1).abs() < 1e-12 && at(3.5).rate_rad_s.length() < 1e-12);
        for (t_s, angle_rad) in [(-5.0, 0.0), (0.999, 0.0), (4.0, 0.2), (1e9, 0.2)] {
            assert!(at(t_s).body_from_icrf.rotation_vector_to(&turned(angle_rad)).length() < 1e-12, "{t_s} s");
            assert_eq!(at(t_s).rate_rad_s, DVec3::ZERO, "{t_s} s");
        }
    }

    #[test]
    fn gaps_and_ends_have_no_attitude() {
        let rows = "t_s,w,x,y,z,segment\n0,1,0,0,0,1\n1,1,0,0,0,1\n2,1,0,0,0,2\n3,1,0,0,0,2\n";
        let [ends, rests] = [false, true].map(|rests| profile(rows, rests));
        for (t_s, has_any, has_at_rest) in
            [(-1.0, false, true), (0.5, true, true), (1.5, false, false), (4.0, false, true)]
        {
            let at = |profile: &FileProfile| profile.at(profile.zero + Span::from_s(t_s)).is_some();
            assert_eq!((at(&ends), at(&rests)), (has_any, has_at_rest), "{t_s} s");
        }
    }
}
