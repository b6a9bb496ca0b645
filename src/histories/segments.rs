//! Common parts of segments of attitudes and of orbits: their usable intervals, and the search for an instant.

/// Instants from which to which something may be used, ns.
pub(crate) type Interval = [i64; 2];

/// Returns the interval of rows as far as a file lets it be used; `None` where nothing is left.
pub(crate) fn usable(rows: Interval, given: [Option<i64>; 2]) -> Option<Interval> {
    let from = given[0].map_or(rows[0], |ns| ns.max(rows[0]));
    let until = given[1].map_or(rows[1], |ns| ns.min(rows[1]));
    (from <= until).then_some([from, until])
}

/// Returns the number, from 1, of the first segment that begins before the one before it ends.
pub(crate) fn overlapping<S>(segments: &[S], interval: fn(&S) -> Interval) -> Option<usize> {
    let overlaps = |pair: &[S]| interval(&pair[0])[1] > interval(&pair[1])[0];
    segments.windows(2).position(overlaps).map(|place| place + 2)
}

/// Returns the segment that an instant is in; `None` in gaps and outside. Does not allocate.
pub(crate) fn containing<S>(segments: &[S], t_ns: i64, interval: fn(&S) -> Interval) -> Option<&S> {
    let after = segments.partition_point(|segment| interval(segment)[0] <= t_ns);
    let segment = segments.get(after.checked_sub(1)?)?;
    (t_ns <= interval(segment)[1]).then_some(segment)
}
