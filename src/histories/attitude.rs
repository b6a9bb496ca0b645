//! Attitudes over time as a file has them: segments of rows, and what is between the rows.
//!
//! Within one segment the attitude is interpolated ([`AttitudeInterpolation`]); outside of all segments, and outside a
//! segment's usable interval, it is not available.

use crate::attitude_methods::{
    AttitudeInterpolation, AttitudeMotion, AttitudeState, MOST_TURN_RAD, s_between, turn_beside_rates, turn_between,
};
use crate::findings::{self, Comparison, Floor, Names, Step, compare};
use crate::segments::{self, Unfit};
use base::time::Tai;
use glam::DVec3;
use std::sync::Arc;

/// Origin of the times of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Times {
    /// TAI: the file says when its attitudes are.
    Absolute,
    /// A zero that the file does not name.
    FromZero,
}

/// Rows that belong together.
#[derive(Debug, Clone, PartialEq)]
pub struct AttitudeSegment {
    states: Arc<[AttitudeState]>,
    method: AttitudeInterpolation,
    /// From when to when it may be used.
    usable_ns: [i64; 2],
}

/// Attitudes of one body over time.
#[derive(Debug, Clone, PartialEq)]
pub struct AttitudeHistory {
    /// Name of the format, for people.
    pub format: String,
    /// Name of the body or the object, where the file has one.
    pub name: Option<String>,
    /// Origin of its times.
    pub times: Times,
    /// Approximations and peculiarities, one sentence each.
    pub notes: Vec<String>,
    /// Doubts about its contents, one sentence each.
    pub warnings: Vec<String>,
    segments: Vec<AttitudeSegment>,
    /// Why its rates, which it is interpolated with, cannot be those of its attitudes.
    contradiction: Option<String>,
}

/// Quaternions have six decimals (4e-6 rad in a turn), rates two digits; within a step no more than 6 degrees.
const FLOOR: Floor = Floor { part: 0.02, value: 2e-5, most: 0.1 };
const NAMES: Names = Names { derivatives: "rates", values: "attitudes", unit: "deg/s", unit_is: base::units::DEG };

/// Fastest rate of a row, rad/s: far beyond any spacecraft.
pub(crate) const MOST_RATE_RAD_S: f64 = 1e3;

/// Why a history without rows is none.
const NO_ROWS: &str = "no attitude; wanted one row at least";

/// Returns true for a rate that a row may have.
pub(crate) fn is_slow_enough(rate_rad_s: DVec3) -> bool {
    rate_rad_s.length() <= MOST_RATE_RAD_S
}

impl AttitudeSegment {
    /// Returns the segment of these rows. `usable_ns`: where the file restricts it.
    pub(crate) fn new(
        states: Vec<AttitudeState>,
        method: AttitudeInterpolation,
        usable_ns: [Option<i64>; 2],
    ) -> Result<Self, Unfit> {
        // A product with a length of time must stay a number.
        let is_too_fast = |state: &AttitudeState| state.rate_rad_s.is_some_and(|rate| !is_slow_enough(rate));
        if let Some(place) = states.iter().position(is_too_fast) {
            return Err(Unfit::of_row(
                place + 1,
                format!(
                    "the rate of row {} is above {MOST_RATE_RAD_S} rad/s or no number; wanted that of a spacecraft: check the unit",
                    place + 1
                ),
            ));
        }
        let (Some(first), Some(last)) = (states.first(), states.last()) else { return Err(Unfit::of_all(NO_ROWS)) };
        let usable = segments::usable([first.t_ns, last.t_ns], usable_ns);
        for (place, pair) in states.windows(2).enumerate() {
            if pair[0].t_ns >= pair[1].t_ns {
                return Err(Unfit::not_rising(place + 2));
            }
            let turn_rad = match method {
                AttitudeInterpolation::Slerp | AttitudeInterpolation::ConstantRate => 0.0,
                AttitudeInterpolation::CubicHermite => turn_between(&pair[0], &pair[1])[1].length(),
                AttitudeInterpolation::Lagrange(_) => {
                    pair[0].body_from_icrf.rotation_vector_to(&pair[1].body_from_icrf).length()
                }
            };
            if turn_rad > MOST_TURN_RAD {
                let (row, next, turn_deg) = (place + 1, place + 2, turn_rad.to_degrees());
                let most = MOST_TURN_RAD.to_degrees();
                return Err(Unfit::of_row(
                    row,
                    format!(
                        "the body turns by {turn_deg:.0} deg between rows {row} and {next}; wanted at most {most:.0} deg for this interpolation: give denser rows"
                    ),
                ));
            }
        }
        let usable_ns = usable.ok_or(Unfit::NotUsable)?;
        Ok(Self { states: states.into(), method, usable_ns })
    }

    /// Returns the turn from a row to the next, rad, as the interpolation has it.
    fn turn(&self, [before, after]: [&AttitudeState; 2]) -> DVec3 {
        match self.method {
            AttitudeInterpolation::CubicHermite => turn_between(before, after)[0],
            AttitudeInterpolation::ConstantRate => {
                before.rate_rad_s.unwrap_or_default() * s_between(before.t_ns, after.t_ns)
            }
            AttitudeInterpolation::Slerp | AttitudeInterpolation::Lagrange(_) => {
                before.body_from_icrf.rotation_vector_to(&after.body_from_icrf)
            }
        }
    }

    /// Compares the rates of the rows with the differences of their attitudes; `None` where a row has no rate.
    fn comparison(&self) -> Option<Comparison> {
        if self.method == AttitudeInterpolation::ConstantRate {
            return None;
        }
        let step = |pair: &[AttitudeState]| {
            let s = s_between(pair[0].t_ns, pair[1].t_ns);
            let beside = turn_beside_rates(&pair[0], &pair[1])? / s;
            Some(Step { s, stated: [pair[0].rate_rad_s?, pair[1].rate_rad_s?], beside })
        };
        compare(&self.states.windows(2).map(step).collect::<Option<Vec<_>>>()?, FLOOR)
    }

    /// Returns its rows, by rising time.
    pub fn states(&self) -> &[AttitudeState] {
        &self.states
    }

    /// Returns the rows at which it may be used.
    pub fn usable_states(&self) -> impl Iterator<Item = &AttitudeState> + '_ {
        let [from, until] = self.usable_ns;
        self.states.iter().filter(move |state| (from..=until).contains(&state.t_ns))
    }

    /// Returns how it is interpolated.
    pub fn method(&self) -> AttitudeInterpolation {
        self.method
    }

    /// Returns from when to when it may be used, ns.
    pub fn usable_ns(&self) -> [i64; 2] {
        self.usable_ns
    }

    /// Returns the motion at an instant within the rows.
    fn at(&self, t_ns: i64) -> AttitudeMotion {
        let after = self.states.partition_point(|state| state.t_ns <= t_ns);
        if self.states.len() < 2 {
            let AttitudeState { body_from_icrf, rate_rad_s, .. } = self.states[0];
            let rate_rad_s = rate_rad_s.unwrap_or_default();
            return AttitudeMotion { body_from_icrf, rate_rad_s, acceleration_rad_s2: DVec3::ZERO };
        }
        self.method.between(&self.states, after.clamp(1, self.states.len() - 1) - 1, t_ns)
    }

    /// Returns the largest angle, rad, by which every second row misses the rows between; `None` with fewer than three
    /// rows.
    fn left_out_error_rad(&self) -> Option<f64> {
        let missed = |first: usize| {
            let kept: Vec<AttitudeState> = self.states.iter().skip(first).step_by(2).copied().collect();
            let kept = Self { states: kept.into(), method: self.method, usable_ns: self.usable_ns };
            let inside = self.states.iter().skip(first + 1).step_by(2);
            let last_ns = kept.states.last().map_or(i64::MIN, |state| state.t_ns);
            inside.filter(move |state| state.t_ns < last_ns).fold(None, |worst: Option<f64>, state| {
                let error = kept.at(state.t_ns).body_from_icrf.rotation_vector_to(&state.body_from_icrf).length();
                Some(worst.map_or(error, |worst| worst.max(error)))
            })
        };
        let by_rates = (self.method == AttitudeInterpolation::CubicHermite)
            .then(|| self.comparison().map(|comparison| comparison.errors[0]).filter(|error| *error > 0.0))
            .flatten();
        let found = [missed(0), missed(1), by_rates];
        found.into_iter().flatten().reduce(f64::max)
    }
}

impl AttitudeHistory {
    /// Returns a history of these segments; their order is that of the file.
    pub(crate) fn new(format: &str, times: Times, segments: Vec<AttitudeSegment>) -> Result<Self, Unfit> {
        if segments.is_empty() {
            return Err(Unfit::of_all(NO_ROWS));
        }
        segments::check_overlap(&segments, AttitudeSegment::usable_ns)?;
        let mut history = Self {
            format: format.into(),
            name: None,
            times,
            notes: Vec::new(),
            warnings: Vec::new(),
            segments,
            contradiction: None,
        };
        history.compare_rates();
        if times == Times::Absolute {
            history.warnings.extend(findings::early_utc(history.span_ns()[0]));
        }
        Ok(history)
    }

    /// Returns a history of these segments; an instant that several of them have is that of the last one in the file.
    #[cfg(feature = "spice")]
    pub(crate) fn layered(format: &str, times: Times, segments: &[AttitudeSegment]) -> Result<Self, Unfit> {
        let intervals: Vec<segments::Interval> = segments.iter().map(AttitudeSegment::usable_ns).collect();
        let parts = segments::later_wins(&intervals).into_iter();
        let part =
            |(place, usable_ns): (usize, segments::Interval)| AttitudeSegment { usable_ns, ..segments[place].clone() };
        Self::new(format, times, parts.map(part).collect())
    }

    /// Notes rates that contradict the attitudes, and those that decide how far the body turns.
    fn compare_rates(&mut self) {
        let (mut doubts, mut farthest_rad) = (Vec::new(), 0.0_f64);
        for (segment, number) in self.segments.iter().zip(1..) {
            let Some(found) = segment.comparison() else { continue };
            if segment.method == AttitudeInterpolation::CubicHermite {
                let turns = segment.states.windows(2).map(|pair| segment.turn([&pair[0], &pair[1]]).length());
                farthest_rad = turns.fold(farthest_rad, f64::max);
            }
            let Some(words) = found.words(number, NAMES) else { continue };
            if segment.method == AttitudeInterpolation::CubicHermite && found.is_of_most() {
                let wanted = "wanted the rates of these attitudes: check their unit, their sign and axes, and where the \
                              quaternion has its scalar";
                self.contradiction.get_or_insert_with(|| format!("{words}; {wanted}"));
            }
            doubts.push(words);
        }
        self.warnings.extend(findings::first_of(doubts));
        if farthest_rad > MOST_TURN_RAD {
            self.notes.push(format!(
                "the body turns by up to {:.0} deg from row to row: the rates say which way round, and how often",
                farthest_rad.to_degrees()
            ));
        }
    }

    /// Returns why the rates cannot be those of the attitudes, for a file that is interpolated with them.
    pub(crate) fn contradiction(&self) -> Option<&str> {
        self.contradiction.as_deref()
    }

    /// Notes gaps between rows that are otherwise evenly spaced.
    pub(crate) fn find_gaps(&mut self) {
        let times_ns = self.segments.iter().map(|segment| segment.states.iter().map(|state| state.t_ns));
        self.warnings.extend(findings::gaps_of_segments(times_ns));
    }

    /// Returns a history of one segment of computed states, such as the frames of a run; `None` where their times do
    /// not rise or there is none.
    pub fn of_states(states: Vec<AttitudeState>) -> Option<Self> {
        let has_rates = states.iter().all(|state| state.rate_rad_s.is_some());
        let method = if has_rates { AttitudeInterpolation::CubicHermite } else { AttitudeInterpolation::Slerp };
        let segment = AttitudeSegment::new(states.clone(), method, [None; 2]);
        let segment =
            segment.or_else(|_| AttitudeSegment::new(states, AttitudeInterpolation::Slerp, [None; 2])).ok()?;
        Self::new("states", Times::Absolute, vec![segment]).ok()
    }

    /// Returns its segments, by rising time.
    pub fn segments(&self) -> &[AttitudeSegment] {
        &self.segments
    }

    /// Returns the number of rows at which it may be used.
    pub fn rows(&self) -> usize {
        self.segments.iter().map(|segment| segment.usable_states().count()).sum()
    }

    /// Returns the first and the last usable instant, ns.
    pub fn span_ns(&self) -> [i64; 2] {
        let (first, last) = (&self.segments[0], &self.segments[self.segments.len() - 1]);
        [first.usable_ns[0], last.usable_ns[1]]
    }

    /// Returns the attitude and its motion at an instant; `None` where the file has none. Does not allocate.
    pub fn at_ns(&self, t_ns: i64) -> Option<AttitudeMotion> {
        segments::containing(&self.segments, t_ns, AttitudeSegment::usable_ns).map(|segment| segment.at(t_ns))
    }

    /// Returns the attitude at an instant of TAI, of a history with absolute times.
    pub fn at(&self, at: Tai) -> Option<AttitudeMotion> {
        self.at_ns(at.ns())
    }

    /// Returns the largest rate, acceleration and jerk, rad/s and its derivatives, by differences of rows.
    pub fn motion_limits(&self) -> [f64; 3] {
        let mut limits = [0.0_f64; 3];
        for segment in &self.segments {
            let (mut last_rate, mut last_acceleration): (Option<DVec3>, Option<DVec3>) = (None, None);
            for pair in segment.states.windows(2) {
                let step_s = s_between(pair[0].t_ns, pair[1].t_ns);
                let rate = segment.turn([&pair[0], &pair[1]]) / step_s;
                let acceleration = last_rate.map(|last| (rate - last) / step_s);
                let jerk = last_acceleration.zip(acceleration).map(|(last, now)| (now - last) / step_s);
                let found = [Some(rate), acceleration, jerk].map(|vector| vector.map_or(0.0, DVec3::length));
                limits.iter_mut().zip(found).for_each(|(limit, found)| *limit = limit.max(found));
                (last_rate, last_acceleration) = (Some(rate), acceleration);
            }
        }
        limits
    }

    /// Returns the largest error of the interpolation, rad, as the file itself shows it: each row is left out in turn
    /// with every second one, and the others are interpolated to it, over steps twice as long as those of the file.
    /// Between rows the error is less: a quarter of it with slerp, a sixteenth with cubics, where the motion is smooth.
    /// Where rates contradict the attitudes, it is what this makes of a cubic, if that is more.
    /// `None` with fewer than three rows in each segment.
    pub fn interpolation_error_rad(&self) -> Option<f64> {
        self.segments.iter().filter_map(AttitudeSegment::left_out_error_rad).reduce(f64::max)
    }
}
