//! One line of offset and drift under the marks: earlier windows through the filter, and the hull of this one.
//!
//! Input: marks (remote time, local minus remote), already judged. Output: a [`TwoState`] at any remote time. A
//! window's hull is used from its first mark on, and goes into the filter once, when the window is full: no mark counts
//! twice. Memory is that of the hulls, allocated at construction; a mark costs O(1) amortised, an estimate O(log n).
//!
//! *Floor.* Distance of the marks' delays from their floor: the scale of queueing, learnt from the marks.
//!
//! Input: heights of marks above the line, ns. Output: `s`, the mean of the exponential law that has as many delays
//! near the floor. The octile (1/8 of the marks lie below it) is followed by steps in proportion to itself, down by 7
//! parts with a mark below it and up by 1 with one above; `s` is the octile over `-ln(7/8)`. Only marks near the floor
//! count, so late marks (10 % or 50 % of them) hardly matter. Steps shrink from 0.8 to 1/20: learnt within some 30
//! marks.

use super::hull::{Edge, HEIGHT_MEAN, HEIGHT_SIGMA, LowerHull, SLOPE_SIGMA};
use super::kalman::{Trust, TwoState};

/// Deviation of the first mark's delay, ns; each pair of marks reduces it to a tenth: the chance that all were late.
const FIRST_DELAY_SIGMA_NS: f64 = 1e6;
/// Marks needed to know the link's delay; before, the hull's mean height is not subtracted.
const MARKS_FOR_BIAS: usize = 16;
/// Marks needed to measure a slope.
const MARKS_FOR_SLOPE: usize = 3;
/// Marks more scales than this above the line do not show the floor.
const NEAR_SCALES: f64 = 8.0;
/// Number of marks, and seconds, that must all lie above the line before the line follows them.
const RISEN: (usize, f64) = (16, 4.0);
/// Height, in `s/n`, above which the least of n delays lies with a chance of e^-20. A smaller height of 16 marks is not
/// treated as a rise: the hull follows it gradually.
const RISEN_SCALES: f64 = 20.0;
/// Number of the newest of these marks with which the line then restarts: a mark that was only late may have been the
/// first.
const RISEN_KEPT: usize = 8;
/// Largest change of drift that a shift may indicate, ns/s (2 ppm).
const MOST_RATE_SHOCK: f64 = 2000.0;

/// Parameters of a line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LineParams {
    /// Length of a window of remote time, s.
    pub window_s: f64,
    /// Random walk of the rate, (ns/s)^2/s.
    pub walk: f64,
    /// Steepest slope that counts as drift, ns/s.
    pub most_rate_ns_per_s: f64,
}

/// Marks from an origin on, in a hull.
#[derive(Debug, Clone)]
struct Window {
    hull: LowerHull,
    origin: Mark,
}

/// Marks in a row that all lie above the line.
#[derive(Debug, Clone, Copy)]
struct Rising {
    first: Mark,
    newest: [Mark; RISEN_KEPT],
    count: usize,
    least_above_ns: f64,
}

/// Smallest and largest difference, and count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Seen {
    smallest_ns: i64,
    largest_ns: i64,
    marks: usize,
}

#[derive(Debug, Clone)]
pub(super) struct Line {
    params: LineParams,
    /// State after the previous windows, at the middle of the last of them.
    before: TwoState,
    /// State of the filter with this window, at the newest mark.
    now: TwoState,
    window: Window,
    rising: Rising,
    floor: DelayFloor,
    newest: Mark,
    pub(super) residual_ns: f64,
    settled: usize,
    seen: [Seen; 2],
}

impl Window {
    fn new() -> Self {
        Self { hull: LowerHull::new(), origin: Mark::default() }
    }

    fn push(&mut self, mark: Mark) {
        if self.hull.count() == 0 {
            self.origin = mark;
        }
        let from = self.origin;
        let y_ns = mark.difference_ns.saturating_sub(from.difference_ns) as f64;
        self.hull.push(mark.since_s(&from), y_ns);
    }
}

impl Rising {
    const NONE: Self = {
        let nothing = Mark { remote_ns: 0, difference_ns: 0 };
        Self { first: nothing, newest: [nothing; RISEN_KEPT], count: 0, least_above_ns: f64::MAX }
    };

    fn push(&mut self, mark: Mark, above_ns: f64) {
        if self.count == 0 {
            self.first = mark;
        }
        self.newest[self.count % RISEN_KEPT] = mark;
        self.count += 1;
        self.least_above_ns = self.least_above_ns.min(above_ns);
    }

    /// Returns the newest marks, oldest first.
    fn kept(&self) -> impl Iterator<Item = Mark> + use<> {
        let (marks, count) = (self.newest, self.count);
        (count.saturating_sub(RISEN_KEPT)..count).map(move |i| marks[i % RISEN_KEPT])
    }
}

impl Seen {
    const NONE: Self = Self { smallest_ns: i64::MAX, largest_ns: i64::MIN, marks: 0 };

    fn with(self, other: Self) -> Self {
        Self {
            smallest_ns: self.smallest_ns.min(other.smallest_ns),
            largest_ns: self.largest_ns.max(other.largest_ns),
            marks: self.marks + other.marks,
        }
    }

    fn of(mark: &Mark) -> Self {
        Self { smallest_ns: mark.difference_ns, largest_ns: mark.difference_ns, marks: 1 }
    }
}

impl Line {
    pub(super) fn new(params: LineParams) -> Self {
        let nowhere = TwoState::new(0, 0, FIRST_DELAY_SIGMA_NS, 0.25 * params.most_rate_ns_per_s);
        Self {
            params,
            before: nowhere,
            now: nowhere,
            window: Window::new(),
            rising: Rising::NONE,
            floor: DelayFloor::new(),
            newest: Mark::default(),
            residual_ns: 0.0,
            settled: 0,
            seen: [Seen::NONE; 2],
        }
    }

    /// Starts at a mark without other data. The prior of the drift is a quarter of its limit.
    pub(super) fn begin(&mut self, mark: Mark) {
        let rate_sigma = 0.25 * self.params.most_rate_ns_per_s;
        self.before = TwoState::new(mark.remote_ns, mark.difference_ns, FIRST_DELAY_SIGMA_NS, rate_sigma);
        self.floor = DelayFloor::new();
        self.restart(mark);
    }

    /// Starts at a mark after a step of `other`: drift and delays are kept.
    pub(super) fn begin_after(&mut self, other: &Self, mark: Mark) {
        self.floor = other.floor;
        self.before = other.now.shifted_to(mark.remote_ns, mark.difference_ns, FIRST_DELAY_SIGMA_NS, MOST_RATE_SHOCK);
        self.restart(mark);
    }

    fn restart(&mut self, mark: Mark) {
        self.window.hull.clear();
        self.rising = Rising::NONE;
        self.settled = 1;
        self.seen = [Seen::NONE, Seen::of(&mark)];
        self.newest = mark;
        self.residual_ns = 0.0;
        self.window.push(mark);
        self.now = self.fused(mark.remote_ns);
    }

    /// Returns the newest mark taken.
    pub(super) fn newest(&self) -> Mark {
        self.newest
    }

    /// Returns the mean of queueing delays near the floor, ns.
    pub(super) fn scale_ns(&self) -> f64 {
        self.floor.scale_ns()
    }

    /// Returns the smallest and largest difference, and the number of marks, of this window and the previous one.
    pub(super) fn seen(&self) -> (i64, i64, usize) {
        let seen = self.seen[0].with(self.seen[1]);
        (seen.smallest_ns, seen.largest_ns, seen.marks)
    }

    /// Returns the line at a remote time.
    pub(super) fn at(&self, remote_ns: i64) -> TwoState {
        self.now.at(remote_ns, self.params.walk)
    }

    /// Returns the deviations of offset (ns) and rate (ns/s) at the newest mark.
    pub(super) fn sigmas(&self) -> (f64, f64) {
        (self.now.offset_sigma_ns(), self.now.rate_sigma_ns_per_s())
    }

    /// Adds a mark that is not below the line by more than `gate_ns`. Returns true when the line was moved to marks
    /// that all lie above it.
    pub(super) fn take(&mut self, mark: Mark, gate_ns: f64) -> bool {
        let above_ns = self.at(mark.remote_ns).above_ns(mark.difference_ns);
        let near_ns = gate_ns + NEAR_SCALES * self.scale_ns();
        self.close_full_window(&mark);
        self.newest = mark;
        self.residual_ns = above_ns;
        self.seen[1] = self.seen[1].with(Seen::of(&mark));
        if above_ns <= near_ns {
            self.floor.observe(above_ns);
            self.window.push(mark);
        }
        self.settled = self.settled.saturating_add(usize::from(above_ns <= gate_ns));
        if above_ns <= gate_ns + RISEN_SCALES / RISEN.0 as f64 * self.scale_ns() {
            self.rising = Rising::NONE;
        } else {
            self.rising.push(mark, above_ns);
        }
        let has_risen = self.has_risen(gate_ns);
        if has_risen {
            self.begin_shifted(self.rising.kept());
        } else {
            self.now = self.fused(mark.remote_ns);
        }
        has_risen
    }

    /// Restarts the line at marks that do not fit it, and keeps its drift.
    pub(super) fn begin_shifted(&mut self, marks: impl Iterator<Item = Mark>) {
        let walk = self.params.walk;
        self.window.hull.clear();
        self.rising = Rising::NONE;
        for mark in marks {
            if self.window.hull.count() == 0 {
                self.shift(mark, self.now.at(mark.remote_ns, walk).above_ns(mark.difference_ns));
            }
            self.seen[1] = self.seen[1].with(Seen::of(&mark));
            self.window.push(mark);
            self.newest = mark;
        }
        self.settled = self.window.hull.count();
        self.residual_ns = 0.0;
        self.now = self.fused(self.newest.remote_ns);
    }

    fn has_risen(&self, gate_ns: f64) -> bool {
        let Rising { first, count, least_above_ns, .. } = self.rising;
        let (wanted, wanted_s) = RISEN;
        let young = 3 * self.settled;
        let is_long =
            if young < wanted { count >= young } else { count >= wanted && self.newest.since_s(&first) >= wanted_s };
        is_long && least_above_ns > gate_ns + RISEN_SCALES * self.scale_ns() / count as f64
    }

    /// Shifts the line: the cause may be the link or, when the shift is small, a drift that the filter did not follow.
    fn shift(&mut self, mark: Mark, above_ns: f64) {
        let shock = (above_ns / self.params.window_s).abs().min(MOST_RATE_SHOCK);
        let there = self.now.at(mark.remote_ns, self.params.walk);
        self.before = there.shifted_to(mark.remote_ns, mark.difference_ns, FIRST_DELAY_SIGMA_NS, shock);
        self.seen = [Seen::NONE; 2];
    }

    fn close_full_window(&mut self, mark: &Mark) {
        if self.window.hull.count() > 0 && mark.since_s(&self.window.origin) > self.params.window_s {
            if let Some(edge) = self.window.hull.middle_edge() {
                self.before = self.measured(&edge);
            }
            self.window.hull.clear();
            self.seen = [self.seen[1], Seen::NONE];
        }
    }

    fn fused(&self, remote_ns: i64) -> TwoState {
        let known = self.window.hull.middle_edge().map_or(self.before, |edge| self.measured(&edge));
        known.at(remote_ns, self.params.walk).limited(self.params.most_rate_ns_per_s)
    }

    /// Returns the state before this window updated with its edge, at the edge's middle.
    fn measured(&self, edge: &Edge) -> TwoState {
        let LineParams { walk, most_rate_ns_per_s, .. } = self.params;
        let (hull, origin) = (&self.window.hull, &self.window.origin);
        let (count, length_s) = (hull.count(), hull.length_s());
        let unit_ns = self.scale_ns() / count as f64;
        let late_ns = (0..(count / 2).min(12)).fold(FIRST_DELAY_SIGMA_NS, |sigma_ns, _| 0.1 * sigma_ns);
        let bias_ns = HEIGHT_MEAN * unit_ns;
        let is_known = count >= MARKS_FOR_BIAS;
        let is_long = is_known && length_s >= 0.5 * self.params.window_s;
        let trust = if is_long { Trust::Measurement } else { Trust::Prior };
        // Deviation of the true line from a chord because of the rate's walk, in the middle and over the length.
        let (bent, turned) = (walk * length_s.powi(3) / 192.0, walk * length_s / 12.0);
        let doubt_ns = late_ns + if is_known { 0.0 } else { bias_ns };
        let height_variance = (HEIGHT_SIGMA * unit_ns).powi(2) + doubt_ns * doubt_ns + bent;
        let height_ns = edge.height_ns - if is_known { bias_ns } else { 0.0 };
        let middle = self.before.at(origin.later_ns(edge.x_s), walk);
        let raised = middle.with_offset(origin.difference_ns, height_ns, height_variance, trust);
        if count < MARKS_FOR_SLOPE || length_s <= 0.0 || edge.slope_ns_per_s.abs() > most_rate_ns_per_s {
            return raised;
        }
        let slope_variance = ((SLOPE_SIGMA * unit_ns + doubt_ns) / length_s).powi(2) + turned;
        raised.with_rate(edge.slope_ns_per_s, slope_variance, trust)
    }
}

/// One pair of stamps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct Mark {
    /// Remote time of SYNC's transmission, ns.
    pub remote_ns: i64,
    /// Local time of its reception minus `remote_ns`, ns.
    pub difference_ns: i64,
}

/// Initial `s`, ns: more than most links have, so that the first lines get a low weight.
const FIRST_NS: f64 = 100_000.0;
/// Lower limit of `s`: the resolution of stamps (SCET counts 60 ns), ns.
const LEAST_NS: f64 = 60.0;
/// `-ln(7/8)`.
const OCTILE_OF_EXPONENTIAL: f64 = 0.133_531_392_624_522_62;
/// Largest and smallest step.
const GAIN: (f64, f64) = (0.8, 0.05);

/// The present scale.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct DelayFloor {
    octile_ns: f64,
    marks: u32,
}

impl DelayFloor {
    pub(super) fn new() -> Self {
        Self { octile_ns: FIRST_NS * OCTILE_OF_EXPONENTIAL, marks: 0 }
    }

    /// Returns `s`, ns.
    pub(super) fn scale_ns(&self) -> f64 {
        (self.octile_ns / OCTILE_OF_EXPONENTIAL).max(LEAST_NS)
    }

    /// Updates the scale with a mark's height above the line. A mark below counts like one above: it shows the line's
    /// error, and must not reduce its uncertainty.
    pub(super) fn observe(&mut self, above_ns: f64) {
        self.marks = self.marks.saturating_add(1);
        let gain = (1.0 / (1.0 + f64::from(self.marks) / 4.0)).clamp(GAIN.1, GAIN.0);
        self.octile_ns *= if above_ns.abs() < self.octile_ns { 1.0 - gain * 0.875 } else { 1.0 + gain * 0.125 };
        self.octile_ns = self.octile_ns.max(LEAST_NS * OCTILE_OF_EXPONENTIAL);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::random::{key, philox};

    fn learnt_ns(mean_ns: f64, late_share: f64, marks: u32) -> f64 {
        let mut floor = DelayFloor::new();
        for i in 0..marks {
            let [a, b, ..] = philox([i, 0, 0, 0], key(3)).map(|word| (f64::from(word) + 0.5) / 4_294_967_296.0);
            floor.observe(if b < late_share { 5e6 * a } else { -mean_ns * a.ln() });
        }
        floor.scale_ns()
    }

    #[test]
    fn the_scale_is_learnt_and_late_marks_hardly_matter() {
        for mean_ns in [500.0, 20_000.0, 300_000.0] {
            // With a step of 1/20 per mark the octile is known to a factor of 1.6.
            let ratio = learnt_ns(mean_ns, 0.0, 400) / mean_ns;
            assert!((0.6..1.6).contains(&ratio), "{ratio} of {mean_ns} ns");
            let ratio = learnt_ns(mean_ns, 0.3, 400) / mean_ns;
            assert!((0.7..2.6).contains(&ratio), "{ratio} of {mean_ns} ns with 30 % late");
        }
    }

    #[test]
    fn a_constant_delay_ends_at_the_grain_of_the_stamps() {
        let mut floor = DelayFloor::new();
        (0..100).for_each(|_| floor.observe(0.0));
        assert_eq!(floor.scale_ns(), LEAST_NS);
    }
}
