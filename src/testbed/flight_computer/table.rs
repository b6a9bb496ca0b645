//! Attitude from a file of times and quaternions, such as a simulator or a flight gives.
//!
//! Between two rows the file's interpolation applies (`histories::attitude`); a gap of the file has no attitude.
//! Before its first row and after its last one the body rests, or there is none, as the plant says.

use crate::flight_computer::motion::{SteadyMotion, WaypointMotion};
use crate::{attitude_truth::AttitudeTruth, flight_computer::slew::SlewProfile};
use base::time::Tai;
use glam::DVec3;
use histories::{AttitudeHistory, AttitudeMotion};
use std::sync::Arc;

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
    pub fn at(&self, at: Tai) -> Option<AttitudeTruth> {
        let t_ns = (at - self.zero).ns().saturating_add(self.zero_ns);
        let [first_ns, last_ns] = self.history.span_ns();
        let inside_ns = t_ns.clamp(first_ns, last_ns);
        if inside_ns != t_ns && !self.rests_outside {
            return None;
        }
        let AttitudeMotion { body_from_icrf, rate_rad_s, acceleration_rad_s2 } = self.history.at_ns(inside_ns)?;
        // The last row is where rest begins: a rate there would be that of the step before it.
        if self.rests_outside && (t_ns < first_ns || t_ns >= last_ns) {
            let still = DVec3::ZERO;
            return Some(AttitudeTruth { body_from_icrf, rate_rad_s: still, acceleration_rad_s2: still });
        }
        Some(AttitudeTruth { body_from_icrf, rate_rad_s, acceleration_rad_s2 })
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
    pub fn at(&self, at: Tai) -> Option<AttitudeTruth> {
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
