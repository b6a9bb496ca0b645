//! Common parts of segments of attitudes and of orbits: their usable intervals, and the search for an instant.

#[cfg(any(feature = "spice", test))]
use std::collections::BTreeSet;

/// Instants from which to which something may be used, ns.
pub(crate) type Interval = [i64; 2];

/// Returns the interval of rows as far as a file lets it be used; `None` where nothing is left.
pub(crate) fn usable(rows: Interval, given: [Option<i64>; 2]) -> Option<Interval> {
    let from = given[0].map_or(rows[0], |ns| ns.max(rows[0]));
    let until = given[1].map_or(rows[1], |ns| ns.min(rows[1]));
    (from <= until).then_some([from, until])
}

/// Returns intervals that do not overlap, by rising time, each with the place of the one it is part of: an instant that
/// several have belongs to the last of them, as in SPICE kernels.
#[cfg(any(feature = "spice", test))]
pub(crate) fn later_wins(intervals: &[Interval]) -> Vec<(usize, Interval)> {
    let mut ends: Vec<(i64, usize, bool)> = Vec::with_capacity(2 * intervals.len());
    for (place, [from, until]) in intervals.iter().enumerate() {
        ends.extend([(*from, place, true), (until.saturating_add(1), place, false)]);
    }
    ends.sort_unstable();
    let (mut active, mut left) = (BTreeSet::new(), Vec::<(usize, Interval)>::new());
    for (number, (at, place, begins)) in ends.iter().enumerate() {
        if *begins {
            active.insert(*place)
        } else {
            active.remove(place)
        };
        let next = ends.get(number + 1).map_or(*at, |(next, _, _)| *next);
        let Some(winner) = active.last().filter(|_| next > *at) else { continue };
        match left.last_mut().filter(|(last, [_, until])| last == winner && until + 1 == *at) {
            Some((_, interval)) => interval[1] = next - 1,
            None => left.push((*winner, [*at, next - 1])),
        }
    }
    left
}

/// Why rows make no segment, or segments no history.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub(crate) enum Unfit {
    #[error("the usable interval has no row of the segment; wanted one that lies within its rows")]
    NotUsable,
    #[error("{why}")]
    Rows {
        /// The row that is meant, from 1.
        row: Option<usize>,
        why: String,
    },
}

impl Unfit {
    pub(crate) fn of_row(row: usize, why: String) -> Self {
        Self::Rows { row: Some(row), why }
    }

    pub(crate) fn of_all(why: impl Into<String>) -> Self {
        Self::Rows { row: None, why: why.into() }
    }

    pub(crate) fn not_rising(row: usize) -> Self {
        let wanted = "wanted rising times: sort the rows, remove repeated ones";
        Self::of_row(row, format!("row {row} is not after the one before it; {wanted}"))
    }
}

/// Refuses a segment that begins before the one before it ends.
pub(crate) fn check_overlap<S>(segments: &[S], interval: fn(&S) -> Interval) -> Result<(), Unfit> {
    let overlaps = |pair: &[S]| interval(&pair[0])[1] > interval(&pair[1])[0];
    let Some(place) = segments.windows(2).position(overlaps) else { return Ok(()) };
    let wanted = "wanted usable times that do not overlap";
    Err(Unfit::of_all(format!("segment {} begins before the one before it ends; {wanted}", place + 2)))
}

/// Returns the segment that an instant is in; `None` in gaps and outside. Does not allocate.
pub(crate) fn containing<S>(segments: &[S], t_ns: i64, interval: fn(&S) -> Interval) -> Option<&S> {
    let after = segments.partition_point(|segment| interval(segment)[0] <= t_ns);
    let segment = segments.get(after.checked_sub(1)?)?;
    (t_ns <= interval(segment)[1]).then_some(segment)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_instant_of_several_belongs_to_the_last_one() {
        assert_eq!(later_wins(&[[0, 100], [30, 70]]), [(0, [0, 29]), (1, [30, 70]), (0, [71, 100])]);
        assert_eq!(later_wins(&[[30, 70], [0, 100]]), [(1, [0, 100])], "control: the order of the file counts");
        assert_eq!(later_wins(&[[0, 10], [10, 20], [40, 50]]), [(0, [0, 9]), (1, [10, 20]), (2, [40, 50])]);
        assert_eq!(later_wins(&[[0, 10], [5, 5]]), [(0, [0, 4]), (1, [5, 5]), (0, [6, 10])]);
        assert_eq!(later_wins(&[[0, 9], [2, 5], [4, 7]]), [(0, [0, 1]), (1, [2, 3]), (2, [4, 7]), (0, [8, 9])]);
    }
}
