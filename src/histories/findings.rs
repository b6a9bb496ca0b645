//! Doubts about the rows of a file that readers share: gaps, ends before those that the file states, early UTC.

use base::time::Tai;

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
