//! Attitude from a table of times and quaternions, such as a simulator or a flight gives.
//!
//! Between two rows the body turns about a fixed axis at a constant rate (the shortest way); before the first row and after
//! the last it rests. Rates step at the rows, so rows should be as dense as the motion needs: with rows `h` apart and an
//! angular acceleration `a` the attitude between them errs by `a h^2 / 8` at most (`tests` below).

use crate::attitude_truth::AttitudeTruth;
use crate::flight_computer::motion::{SteadyMotion, WaypointMotion};
use crate::flight_computer::slew::SlewProfile;
use base::axes::{Body, Icrf, Rotation};
use base::time::Tai;
use glam::DVec3;
use std::sync::Arc;

/// One row: seconds after the zero of the table, and the attitude then.
pub type AttitudeRow = (f64, Rotation<Body, Icrf>);

/// Attitudes by rising time; at least one.
#[derive(Debug, Clone, PartialEq)]
pub struct AttitudeTable {
    rows: Vec<AttitudeRow>,
}

impl AttitudeTable {
    /// A table of these rows; `None` when there is none, or a time is not finite or not after the one before it.
    #[must_use]
    pub fn new(rows: Vec<AttitudeRow>) -> Option<Self> {
        let is_finite = rows.iter().all(|(t_s, _)| t_s.is_finite());
        let rises = rows.windows(2).all(|pair| pair[0].0 < pair[1].0);
        (!rows.is_empty() && is_finite && rises).then_some(Self { rows })
    }

    /// First and last time, s.
    #[must_use]
    pub fn span_s(&self) -> [f64; 2] {
        [self.rows[0].0, self.rows[self.rows.len() - 1].0]
    }

    /// Attitude and rate `t_s` after the zero of the table.
    #[must_use]
    pub fn at_s(&self, t_s: f64) -> AttitudeTruth {
        let after = self.rows.partition_point(|(row_s, _)| *row_s <= t_s);
        let rests = |(_, body_from_icrf): AttitudeRow| AttitudeTruth {
            body_from_icrf,
            rate_rad_s: DVec3::ZERO,
            acceleration_rad_s2: DVec3::ZERO,
        };
        let (Some(before), Some(next)) = (after.checked_sub(1).map(|place| self.rows[place]), self.rows.get(after))
        else {
            return rests(if after == 0 { self.rows[0] } else { self.rows[self.rows.len() - 1] });
        };
        let rate_rad_s = before.1.rotation_vector_to(&next.1) / (next.0 - before.0);
        let body_from_icrf = before.1.rotated_by(rate_rad_s * (t_s - before.0));
        AttitudeTruth { body_from_icrf, rate_rad_s, acceleration_rad_s2: DVec3::ZERO }
    }
}

/// Attitude over time, when no vehicle flies it.
#[derive(Debug, Clone, PartialEq)]
pub enum Profile {
    /// At rest, one turn, at rest.
    Script(SlewProfile),
    /// A table whose zero is at this instant.
    Table(Arc<AttitudeTable>, Tai),
    /// A constant rate with sinusoids on top of it.
    Steady(SteadyMotion),
    /// A path through waypoints whose zero is at this instant.
    Waypoints(WaypointMotion, Tai),
}

impl Profile {
    /// Attitude, rate and acceleration at `at`.
    #[must_use]
    pub fn at(&self, at: Tai) -> AttitudeTruth {
        match self {
            Self::Script(profile) => profile.at(at),
            Self::Table(table, zero) => table.at_s((at - *zero).s()),
            Self::Steady(motion) => motion.at(at),
            Self::Waypoints(motion, zero) => motion.at_s((at - *zero).s()),
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
    use base::time::Span;

    fn turned(angle_rad: f64) -> Rotation<Body, Icrf> {
        Rotation::IDENTITY.rotated_by(DVec3::new(0.0, angle_rad, 0.0))
    }

    #[test]
    fn between_rows_the_body_turns_evenly_and_outside_it_rests() {
        let table = AttitudeTable::new(vec![(1.0, turned(0.0)), (3.0, turned(0.2)), (4.0, turned(0.2))]).unwrap();
        let at = |t_s: f64| table.at_s(t_s);
        assert!(at(1.5).body_from_icrf.rotation_vector_to(&turned(0.05)).length() < 1e-12);
        assert!((at(2.9).rate_rad_s.y - 0.1).abs() < 1e-12 && at(3.5).rate_rad_s.length() < 1e-12);
        for (t_s, angle_rad) in [(-5.0, 0.0), (0.999, 0.0), (4.0, 0.2), (1e9, 0.2)] {
            assert!(at(t_s).body_from_icrf.rotation_vector_to(&turned(angle_rad)).length() < 1e-12, "{t_s} s");
            assert_eq!(at(t_s).rate_rad_s, DVec3::ZERO, "{t_s} s");
        }
        let zero = Tai::from_ns(7_000_000_000);
        let profile = Profile::Table(Arc::new(table.clone()), zero);
        assert_eq!(profile.at(zero + Span::from_ms(1500)), at(1.5));
    }

    /// The bound of the module's text, for a constant acceleration, and its control at half of it.
    #[test]
    fn error_between_rows_is_at_most_an_eighth_of_the_acceleration_times_the_step_squared() {
        let (step_s, acceleration) = (0.1, 0.3);
        let angle = |t_s: f64| 0.5 * acceleration * t_s * t_s;
        let rows = (0..50).map(|i| (f64::from(i) * step_s, turned(angle(f64::from(i) * step_s)))).collect();
        let table = AttitudeTable::new(rows).unwrap();
        let errors = (0..4800).map(|i| {
            let t_s = f64::from(i) * 1e-3;
            table.at_s(t_s).body_from_icrf.rotation_vector_to(&turned(angle(t_s))).length()
        });
        let (largest, bound) = (errors.fold(0.0, f64::max), acceleration * step_s * step_s / 8.0);
        assert!(largest <= bound * (1.0 + 1e-9) && largest > 0.9 * bound, "{largest} rad, bound {bound} rad");
    }

    #[test]
    fn tables_that_are_none_are_refused() {
        for rows in [vec![], vec![(1.0, turned(0.0)), (1.0, turned(0.1))], vec![(f64::NAN, turned(0.0))]] {
            assert!(AttitudeTable::new(rows).is_none());
        }
        assert!(AttitudeTable::new(vec![(1.0, turned(0.0))]).is_some(), "one attitude is a table");
    }
}
