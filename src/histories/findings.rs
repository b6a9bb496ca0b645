//! Doubts about the rows of a file that readers share: gaps, ends before those that the file states, early UTC, and
//! derivatives that rows state (rates, velocities) beside the differences of their values (attitudes, positions).
//!
//! Between two rows `h` apart the difference quotient `d` of a smooth motion is the mean of the stated derivatives less
//! `h^2 / 12` times their second derivative, which the neighbouring rows show. The rest is the *residual* of the step.
//! A step contradicts itself where its residual is more than
//!
//! `2 max(s, m) + floor`
//!
//! * `s`: how far the stated derivatives, and the differences beside them, are off a straight line through the
//!   neighbouring rows. A change of the derivative within the step (thrust, the beginning of a slew) gives a residual of at
//!   most half of it, a slew that begins and ends within the step one of `s`;
//! * `m`: the median of `s` over the segment: the noise of measured rows;
//! * `floor`: what rounded numbers may do ([`Floor`]).
//!
//! Another unit, sign, order or frame contradicts in most steps, an event in few. Tests: `tests::contradictions`.

use base::{least_squares::median, time::Tai};
use glam::DVec3;

/// Fewest steps in which a usual one can be seen.
const STEPS_MIN: usize = 8;
/// Part of the steps, in tenths, that must be usual.
const USUAL_TENTHS: usize = 8;
/// From how many usual steps on a step is a gap.
const GAP_STEPS: f64 = 3.0;
/// Usual steps that the stated times of a segment may lie beyond its rows.
const BEYOND_STEPS: i64 = 2;
/// 1972-01-01T00:00:00 UTC, from which on UTC differs from TAI by whole seconds, on the count of TAI.
const UTC_BEGIN_NS: i64 = 63_072_010_000_000_000;

/// Returns a warning of times before the UTC of today.
pub(crate) fn early_utc(first_ns: i64) -> Option<String> {
    let words =
        "its times are before 1972: UTC of those years is counted as TAI here, and differed from it by up to 10 s";
    (first_ns < UTC_BEGIN_NS).then(|| words.into())
}

/// Returns a warning of the gaps in the rows of segments that are otherwise evenly spaced.
pub(crate) fn gaps_of_segments<T: Iterator<Item = i64> + Clone>(segments: impl Iterator<Item = T>) -> Option<String> {
    first_of(segments.zip(1..).filter_map(|(times_ns, number)| gaps(number, times_ns)).collect())
}

/// Returns a warning of the gaps in rows that are otherwise evenly spaced; `segment` counts from 1.
fn gaps(segment: usize, times_ns: impl Iterator<Item = i64> + Clone) -> Option<String> {
    let steps_ns: Vec<i64> = times_ns.clone().zip(times_ns.skip(1)).map(|(from, to)| to.saturating_sub(from)).collect();
    let usual_ns = usual(&steps_ns)?;
    let is_usual = |step_ns: &&i64| (**step_ns as f64 / usual_ns as f64 - 1.0).abs() < 0.5;
    if 10 * steps_ns.iter().filter(is_usual).count() < USUAL_TENTHS * steps_ns.len() {
        return None;
    }
    let steps = |step_ns: i64| step_ns as f64 / usual_ns as f64;
    let mut found = steps_ns.iter().enumerate().filter(|(_, step_ns)| steps(**step_ns) > GAP_STEPS);
    let (place, first_ns) = found.next()?;
    Some(format!(
        "rows are missing after row {} of segment {segment}: the next is {:.0} usual steps of {} s later{}; between them is \
         only what the interpolation makes of it",
        place + 1,
        steps(*first_ns),
        usual_ns as f64 * 1e-9,
        match found.count() {
            0 => String::new(),
            more => format!(", and in {more} other places"),
        }
    ))
}

/// Returns the median of steps, ns; `None` for too few of them.
fn usual(steps_ns: &[i64]) -> Option<i64> {
    let mut sorted = steps_ns.to_vec();
    sorted.sort_unstable();
    sorted.get(sorted.len() / 2).copied().filter(|usual_ns| steps_ns.len() >= STEPS_MIN && *usual_ns > 0)
}

/// Returns a warning of rows that begin later or end earlier than the file states.
pub(crate) fn shorter(rows: &str, rows_ns: &[i64], stated: [Tai; 2]) -> Option<String> {
    let [first_ns, .., last_ns] = *rows_ns else { return None };
    let steps = rows_ns.windows(2).map(|pair| pair[1].saturating_sub(pair[0]));
    let beyond_ns = steps.max()?.saturating_mul(BEYOND_STEPS);
    let (early_ns, late_ns) = (first_ns.saturating_sub(stated[0].ns()), stated[1].ns().saturating_sub(last_ns));
    if late_ns > beyond_ns {
        return Some(format!(
            "{rows} end at {}, {:.1} s before its STOP_TIME: the file may be cut short",
            Tai::from_ns(last_ns),
            late_ns as f64 * 1e-9
        ));
    }
    (early_ns > beyond_ns).then(|| {
        format!("{rows} begin at {}, {:.1} s after its START_TIME", Tai::from_ns(first_ns), early_ns as f64 * 1e-9)
    })
}

/// Returns the first of several warnings, with the number of the others.
pub(crate) fn first_of(warnings: Vec<String>) -> Option<String> {
    let more = warnings.len().saturating_sub(1);
    let first = warnings.into_iter().next()?;
    Some(if more == 0 { first } else { format!("{first} (and in {more} other segments)") })
}

/// Part of a residual that the acceleration between rows explains, times this.
const EXPLAINED: f64 = 2.0;
/// Largest error of a cubic whose slopes at both ends are off by 1, for a step of 1: `u (1 - u) (1 - 2 u)`.
const CUBIC_OF_SLOPES: f64 = 0.0963;

/// The step from a row to the next.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Step {
    pub(crate) s: f64,
    /// Derivatives of both rows.
    pub(crate) stated: [DVec3; 2],
    /// Difference quotient of the values, less the mean of the derivatives.
    pub(crate) beside: DVec3,
}

/// Bounds of the part of a residual that rounding makes.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Floor {
    /// Part of the derivative.
    pub(crate) part: f64,
    /// Rounding of a value.
    pub(crate) value: f64,
    /// Most that `part` may make of a value within a step.
    pub(crate) most: f64,
}

/// Comparison of the steps of one segment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct Comparison {
    pub(crate) steps: usize,
    /// Steps that contradict themselves.
    pub(crate) contradicting: usize,
    /// Place of the first of them, with its mean derivative as the rows state it, and as their values have it.
    pub(crate) first: Option<(usize, [DVec3; 2])>,
    /// Error of cubics through the rows in value, and of the derivatives, as residuals show it.
    pub(crate) errors: [f64; 2],
}

impl Comparison {
    /// Returns true where the contradiction is that of the file, not of an event in it.
    pub(crate) fn is_of_most(&self) -> bool {
        2 * self.contradicting > self.steps
    }

    /// Returns what to say of a contradiction in a segment, numbered from 1; `None` without one.
    pub(crate) fn words(&self, segment: usize, names: Names) -> Option<String> {
        let (place, [stated, differing]) = self.first?;
        let Names { derivatives, values, unit, unit_is } = names;
        let [stated, differing] = [stated, differing].map(|v| vector(v / unit_is));
        Some(format!(
            "the {derivatives} contradict the {values} in {} of {} steps: from row {} to row {} of segment {segment} the \
             {derivatives} say {stated} {unit}, the {values} {differing}",
            self.contradicting,
            self.steps,
            place + 1,
            place + 2
        ))
    }
}

/// Names of a derivative and of its values, for messages.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Names {
    pub(crate) derivatives: &'static str,
    pub(crate) values: &'static str,
    pub(crate) unit: &'static str,
    /// The unit, in that of the derivatives.
    pub(crate) unit_is: f64,
}

/// Returns three numbers as messages show them.
fn vector(v: DVec3) -> String {
    let [x, y, z] = v.to_array();
    let largest = v.abs().max_element();
    if (0.01..1e5).contains(&largest) {
        format!("[{x:.4}, {y:.4}, {z:.4}]")
    } else {
        format!("[{x:.2e}, {y:.2e}, {z:.2e}]")
    }
}

/// Compares the steps of a segment, which follow each other; `None` without steps.
pub(crate) fn compare(steps: &[Step], floor: Floor) -> Option<Comparison> {
    let bends: Vec<Bend> = (0..steps.len()).map(|place| Bend::of(steps, place)).collect();
    let mut sizes: Vec<f64> = bends.iter().map(|bend| bend.size).collect();
    let noise = if sizes.is_empty() { return None } else { median(&mut sizes) };
    let mut found = Comparison { steps: steps.len(), contradicting: 0, first: None, errors: [0.0; 2] };
    for (place, (step, bend)) in steps.iter().zip(&bends).enumerate() {
        let residual = (step.beside + bend.second / 12.0).length();
        let largest = step.stated[0].length().max(step.stated[1].length());
        let rounding = (floor.part * largest).min(floor.most / step.s) + floor.value / step.s;
        if residual > EXPLAINED * bend.size.max(noise) + rounding {
            found.contradicting += 1;
            let mean = (step.stated[0] + step.stated[1]) / 2.0;
            found.first = found.first.or(Some((place, [mean, mean + step.beside])));
        }
        // At the ends the second derivative is that of the next step: less sharp, and taken only where it is the only one.
        if bend.is_inside || steps.len() == 2 {
            let errors = [CUBIC_OF_SLOPES * residual * step.s, residual];
            found.errors = core::array::from_fn(|n| found.errors[n].max(errors[n]));
        }
    }
    Some(found)
}

/// How the derivative bends about a step.
struct Bend {
    /// Second derivative times the step squared.
    second: DVec3,
    /// Distance of derivatives and differences from a straight line through their neighbours.
    size: f64,
    is_inside: bool,
}

impl Bend {
    fn of(steps: &[Step], place: usize) -> Self {
        let step = &steps[place];
        let rise = step.stated[1] - step.stated[0];
        let before = place.checked_sub(1).map(|place| &steps[place]);
        let after = steps.get(place + 1);
        // Beyond the straight line of the step before, or after; the second derivative that this is.
        let off = |other: &Step| rise - (other.stated[1] - other.stated[0]) * (step.s / other.s);
        let second = |other: &Step, sign: f64| off(other) * (sign * 2.0 * step.s / (step.s + other.s));
        let seconds = [before.map(|other| second(other, 1.0)), after.map(|other| second(other, -1.0))];
        let beside = match (before, after) {
            (Some(before), Some(after)) => step.beside - (before.beside + after.beside) / 2.0,
            (Some(other), None) | (None, Some(other)) => step.beside - other.beside,
            (None, None) => rise,
        };
        let sizes = [before, after].into_iter().flatten().map(|other| off(other).length());
        let second = match seconds {
            [Some(before), Some(after)] => (before + after) / 2.0,
            [before, after] => before.or(after).unwrap_or_default(),
        };
        let is_inside = before.is_some() && after.is_some();
        Self { second, size: sizes.fold(beside.length(), f64::max), is_inside }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const S: i64 = 1_000_000_000;

    #[test]
    fn a_gap_is_one_in_rows_that_are_evenly_spaced() {
        let even = |skip: &[i64]| {
            gaps(1, (0..40).filter(|i| !skip.contains(i)).map(|i| i * S).collect::<Vec<_>>().into_iter())
        };
        assert_eq!(even(&[]), None);
        assert_eq!(even(&[7, 8]), None, "three steps");
        let words = even(&[7, 8, 9]).unwrap();
        assert!(words.contains("after row 7 of segment 1") && words.contains("4 usual steps of 1 s"), "{words}");
        let uneven = (0..40_i64).map(|i| i * i * i * S);
        assert_eq!(gaps(1, uneven), None, "growing steps have no gap");
        assert_eq!(gaps(1, [0, 1, 2, 50].map(|i| i * S).into_iter()), None, "too few rows to see a usual step");
    }

    #[test]
    fn rows_that_end_before_the_stated_time_are_noticed() {
        let rows = [0, 10, 20].map(|i| i * S);
        let stated = |from: i64, until: i64| shorter("the rows", &rows, [from * S, until * S].map(Tai::from_ns));
        assert_eq!(stated(-20, 40), None);
        assert!(stated(0, 41).unwrap().contains("21.0 s before its STOP_TIME"));
        assert!(stated(-21, 20).unwrap().contains("21.0 s after its START_TIME"));
    }

    #[test]
    fn utc_before_1972_is_said() {
        let ns = |text: &str| Tai::from_rfc3339(text).unwrap().ns();
        assert!(early_utc(ns("1971-12-31T23:59:59Z")).is_some());
        assert_eq!(early_utc(ns("1972-01-01T00:00:00Z")), None);
    }
}
