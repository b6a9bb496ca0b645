//! Segments of a CK file -> an attitude history.
//!
//! Quaternions are scalar first and turn vectors of the reference axes into those of the instrument, as ours do;
//! angular velocities are in the reference axes. Type 3: rows, and intervals within which they are interpolated, about
//! a fixed axis at a constant rate. Type 2: intervals of constant rate. Type 1 has no attitude between its rows, and is
//! refused.

use super::clock::SpacecraftClock;
use super::daf::{Daf, Summary, whole};
use super::{check_axes, chosen};
use crate::attitude::{AttitudeHistory, AttitudeSegment, Times, is_slow_enough};
use crate::attitude_methods::{AttitudeInterpolation, s_between};
use crate::attitude_state::AttitudeState;
use crate::error::{HistoryError, Source};
use base::axes::{Body, COMPUTED_NORM_TOLERANCE, Icrf, Rotation};
use glam::DVec3;

/// Rows of a directory.
const DIRECTORY: usize = 100;

/// Reads the attitudes of one instrument.
pub(super) fn read(
    daf: &Daf<'_>,
    source: &Source<'_>,
    instrument: Option<i32>,
    clock_of: impl Fn(i32) -> Result<SpacecraftClock, HistoryError>,
) -> Result<AttitudeHistory, HistoryError> {
    let numbers: Vec<i32> = daf.segments.iter().map(|segment| segment.integers[0]).collect();
    let instrument = chosen(&numbers, instrument, "instrument", source)?;
    let clock = clock_of(instrument)?;
    let reader = Reader { clock: &clock, source };
    let mut segments = Vec::new();
    for summary in daf.segments.iter().filter(|summary| summary.integers[0] == instrument) {
        check_axes(summary.integers[1], source)?;
        let words = daf.words(summary, source)?;
        let width = if summary.integers[3] != 0 { 7 } else { 4 };
        let found = match summary.integers[2] {
            3 => reader.type_3(&words, width, summary)?,
            2 => reader.type_2(&words, summary)?,
            other => {
                let advice = "type 1 has no attitude between its rows, others are rare: write it again as type 3";
                return Err(source.whole(format!("a segment of type {other}; wanted type 2 or 3: {advice}")));
            }
        };
        segments.extend(found);
    }
    segments.sort_by_key(|segment| segment.usable_ns()[0]);
    let mut history =
        AttitudeHistory::new("SPICE CK", Times::Absolute, segments).map_err(|unfit| source.whole(unfit.to_string()))?;
    history.name = Some(instrument.to_string());
    Ok(history)
}

struct Reader<'a> {
    clock: &'a SpacecraftClock,
    source: &'a Source<'a>,
}

impl Reader<'_> {
    fn broken(&self) -> HistoryError {
        self.source
            .whole("the counts of a segment do not fit its length; wanted a whole file: copy it again, in binary")
    }

    fn type_3(&self, words: &[f64], width: usize, summary: &Summary) -> Result<Vec<AttitudeSegment>, HistoryError> {
        let [.., intervals, rows] = words else { return Err(self.broken()) };
        let [intervals, rows] = [*intervals, *rows].map(whole);
        let sizes = [rows.checked_mul(width), Some(rows), rows.checked_sub(1).map(|n| n / DIRECTORY)];
        let ends = [Some(intervals), intervals.checked_sub(1).map(|n| n / DIRECTORY), Some(2)];
        let total = sizes.into_iter().chain(ends).try_fold(0_usize, |sum, size| sum.checked_add(size?));
        if total != Some(words.len()) {
            return Err(self.broken());
        }
        let (records, rest) = words.split_at(rows * width);
        let (ticks, rest) = rest.split_at(rows);
        let starts = &rest[(rows - 1) / DIRECTORY..][..intervals];
        if starts.first().zip(ticks.first()).is_none_or(|(start, tick)| start > tick) {
            let why = "rows before the first interval of a segment; wanted all rows within intervals: write it again";
            return Err(self.source.whole(why));
        }
        let mut segments = Vec::new();
        for (place, start) in starts.iter().enumerate() {
            let first = ticks.partition_point(|tick| tick < start);
            let last = starts.get(place + 1).map_or(rows, |next| ticks.partition_point(|tick| tick < next));
            let states = (first..last.max(first))
                .map(|row| self.row(ticks[row], &records[row * width..][..width]))
                .collect::<Result<_, _>>()?;
            segments.push(self.segment(states, summary)?);
        }
        Ok(segments)
    }

    fn type_2(&self, words: &[f64], summary: &Summary) -> Result<Vec<AttitudeSegment>, HistoryError> {
        // Ten words a record, and one more for each hundred.
        let count = (words.len() * DIRECTORY + DIRECTORY) / (10 * DIRECTORY + 1);
        if count == 0 || 10 * count + (count - 1) / DIRECTORY != words.len() {
            return Err(self.broken());
        }
        let (records, rest) = words.split_at(8 * count);
        let (starts, rest) = rest.split_at(count);
        let interval = |place: usize| {
            let record = &records[8 * place..][..8];
            let (begin, end) = (starts[place], rest[place]);
            let first = self.row(begin, &record[..7])?;
            // The record's own rate of the clock, s per tick.
            let turn_s = if record[7] > 0.0 { record[7] } else { self.clock.s_per_tick(begin) } * (end - begin);
            let last_at = self.instant(end)?;
            let by_clock_s = s_between(first.t_ns, last_at);
            if last_at > first.t_ns && !(0.5 * by_clock_s..=2.0 * by_clock_s).contains(&turn_s) {
                return Err(self.source.whole(format!(
                    "the interval from tick {begin} has {turn_s} s by its own rate of the clock, and {by_clock_s} s by the \
                     clock kernel; wanted the same within a factor of 2: take the kernel that belongs to this file"
                )));
            }
            let rate = first.rate_rad_s.unwrap_or_default();
            let last = AttitudeState {
                t_ns: last_at,
                body_from_icrf: first.body_from_icrf.rotated_by(rate * turn_s),
                rate_rad_s: first.rate_rad_s,
            };
            self.segment(if last_at > first.t_ns { vec![first, last] } else { vec![first] }, summary)
        };
        (0..count).map(interval).collect()
    }

    /// Returns one row: a quaternion, and perhaps an angular velocity in reference axes.
    fn row(&self, ticks: f64, record: &[f64]) -> Result<AttitudeState, HistoryError> {
        let quaternion = [record[0], record[1], record[2], record[3]];
        let Some(body_from_icrf) = Rotation::<Body, Icrf>::from_wxyz(quaternion, COMPUTED_NORM_TOLERANCE) else {
            return Err(self
                .source
                .whole(format!("the quaternion at tick {ticks} is {quaternion:?}; wanted a unit one")));
        };
        let rate_rad_s = record.get(4..7).map(|v| body_from_icrf.apply(DVec3::new(v[0], v[1], v[2])));
        if rate_rad_s.is_some_and(|rate| !is_slow_enough(rate)) {
            return Err(self.source.whole(format!(
                "the angular velocity at tick {ticks} is above 1000 rad/s or no number; wanted that of a spacecraft"
            )));
        }
        Ok(AttitudeState { t_ns: self.instant(ticks)?, body_from_icrf, rate_rad_s })
    }

    fn instant(&self, ticks: f64) -> Result<i64, HistoryError> {
        let refuse =
            || self.source.whole(format!("tick {ticks} is before its clock begins; wanted a clock kernel that has it"));
        self.clock.tai_ns(ticks).ok_or_else(refuse)
    }

    fn segment(&self, states: Vec<AttitudeState>, summary: &Summary) -> Result<AttitudeSegment, HistoryError> {
        let usable = summary.doubles.map(|ticks| self.clock.tai_ns(ticks));
        // An interval outside of the segment's own bounds is none.
        AttitudeSegment::new(states, AttitudeInterpolation::Slerp, usable)
            .map_err(|unfit| self.source.whole(unfit.to_string()))
    }
}
