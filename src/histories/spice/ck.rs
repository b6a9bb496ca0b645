//! Segments of a CK file -> an attitude history.
//!
//! Quaternions are scalar first and turn vectors of the reference axes into those of the instrument, as ours do;
//! angular velocities are in the reference axes. Type 3: rows, and intervals within which they are interpolated, about
//! a fixed axis at a constant rate. Type 2: intervals with the rate of their record, for any number of turns. Type 1 has no attitude between its rows, and is
//! refused.

use super::clock::SpacecraftClock;
use super::daf::{Daf, Summary, uncountable, whole};
use super::{axes_from_icrf, chosen};
use crate::attitude::{AttitudeHistory, AttitudeSegment, Times, is_slow_enough};
use crate::attitude_methods::{AttitudeInterpolation, AttitudeState, s_between};
use crate::error::{HistoryError, Source};
use crate::segments::Unfit;
use base::axes::{Body, Icrf, Rotation, WRITTEN_NORM_TOLERANCE};
use glam::{DQuat, DVec3};

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
    let mut segments = Vec::new();
    for summary in daf.segments.iter().filter(|summary| summary.integers[0] == instrument) {
        let reader = Reader { clock: &clock, source, axes_from_icrf: axes_from_icrf(summary.integers[1], source)? };
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
    let history = AttitudeHistory::layered("SPICE CK", Times::Absolute, &segments);
    let mut history = history.map_err(|unfit| source.whole(unfit.to_string()))?;
    history.name = Some(instrument.to_string());
    if clock.falling > 0 {
        let words = "records of the clock are out of order: they are searched as CSPICE does";
        history.notes.push(format!("{} {words}", clock.falling));
    }
    Ok(history)
}

struct Reader<'a> {
    clock: &'a SpacecraftClock,
    source: &'a Source<'a>,
    /// Those of the segment; `None` where they are those of ICRF.
    axes_from_icrf: Option<DQuat>,
}

impl Reader<'_> {
    fn type_3(&self, words: &[f64], width: usize, summary: &Summary) -> Result<Vec<AttitudeSegment>, HistoryError> {
        let [.., intervals, rows] = words else { return Err(uncountable(self.source)) };
        let [intervals, rows] = [*intervals, *rows].map(whole);
        let sizes = [rows.checked_mul(width), Some(rows), rows.checked_sub(1).map(|n| n / DIRECTORY)];
        let ends = [Some(intervals), intervals.checked_sub(1).map(|n| n / DIRECTORY), Some(2)];
        let total = sizes.into_iter().chain(ends).try_fold(0_usize, |sum, size| sum.checked_add(size?));
        if total != Some(words.len()) {
            return Err(uncountable(self.source));
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
            segments.extend(self.segment(states, AttitudeInterpolation::Slerp, summary)?);
        }
        Ok(segments)
    }

    fn type_2(&self, words: &[f64], summary: &Summary) -> Result<Vec<AttitudeSegment>, HistoryError> {
        // Ten words a record, and one more for each hundred.
        let count = (words.len() * DIRECTORY + DIRECTORY) / (10 * DIRECTORY + 1);
        if count == 0 || 10 * count + (count - 1) / DIRECTORY != words.len() {
            return Err(uncountable(self.source));
        }
        let (records, rest) = words.split_at(8 * count);
        let (starts, rest) = rest.split_at(count);
        let interval = |place: usize| {
            let record = &records[8 * place..][..8];
            let (begin, end) = (starts[place], rest[place]);
            let mut first = self.row(begin, &record[..7])?;
            // The record's own rate of the clock, s per tick: with 0, or without a turn, the instrument is at rest
            // (CSPICE's `cke02`).
            let turn_s = record[7] * (end - begin);
            let last_at = self.instant(end)?;
            let by_clock_s = s_between(first.t_ns, last_at);
            let is_still = record[7].abs() <= 0.0 || first.rate_rad_s.is_none_or(|rate| rate.length_squared() <= 0.0);
            if last_at > first.t_ns && !is_still && !(0.5 * by_clock_s..=2.0 * by_clock_s).contains(&turn_s) {
                return Err(self.source.whole(format!(
                    "the interval from tick {begin} has {turn_s} s by its own rate of the clock, and {by_clock_s} s by the \
                     clock kernel; wanted the same within a factor of 2: take the kernel that belongs to this file"
                )));
            }
            if last_at <= first.t_ns {
                return self.segment(vec![first], AttitudeInterpolation::ConstantRate, summary);
            }
            let part = if is_still { 0.0 } else { turn_s / by_clock_s };
            first.rate_rad_s = first.rate_rad_s.map(|rate| rate * part);
            let turn = first.rate_rad_s.unwrap_or_default() * by_clock_s;
            let last = AttitudeState { t_ns: last_at, body_from_icrf: first.body_from_icrf.rotated_by(turn), ..first };
            self.segment(vec![first, last], AttitudeInterpolation::ConstantRate, summary)
        };
        (0..count).filter_map(|place| interval(place).transpose()).collect()
    }

    /// Returns one row: a quaternion, and perhaps an angular velocity in reference axes.
    fn row(&self, ticks: f64, record: &[f64]) -> Result<AttitudeState, HistoryError> {
        let quaternion = [record[0], record[1], record[2], record[3]];
        let Some(body_from_axes) = Rotation::<Body, Icrf>::from_wxyz(quaternion, WRITTEN_NORM_TOLERANCE) else {
            let wanted = format!("a unit one, within {WRITTEN_NORM_TOLERANCE}");
            return Err(self
                .source
                .whole(format!("the quaternion at tick {ticks} is {quaternion:?}; wanted {wanted}")));
        };
        let rate_rad_s = record.get(4..7).map(|v| body_from_axes.apply(DVec3::new(v[0], v[1], v[2])));
        let turned = |axes: DQuat| Rotation::from_quat(body_from_axes.quat() * axes);
        let body_from_icrf = self.axes_from_icrf.map_or(body_from_axes, turned);
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

    /// Returns the segment of an interval; `None` for one outside of the bounds that the file states.
    fn segment(
        &self,
        states: Vec<AttitudeState>,
        method: AttitudeInterpolation,
        summary: &Summary,
    ) -> Result<Option<AttitudeSegment>, HistoryError> {
        let usable = summary.doubles.map(|ticks| self.clock.tai_ns(ticks));
        match AttitudeSegment::new(states, method, usable) {
            Err(Unfit::NotUsable) => Ok(None),
            found => found.map(Some).map_err(|unfit| self.source.whole(unfit.to_string())),
        }
    }
}
