//! Judges time marks: which of them are used.
//!
//! Input: a mark and the line so far. Output: a [`Verdict`]. A mark is early relative to the predicted line: the gate
//! is 3 us and six deviations of the prediction (at most 100 us of them while the line is young), because no delay is
//! below the floor. Limits: marks that are equally damaged as often as [`AGREEING`] are used; only the bus's own
//! checksum keeps them rare.

use super::line::{Line, Mark};
use std::collections::VecDeque;

/// Number of outliers that a further one must agree with.
pub(super) const AGREEING: usize = 2;
/// Number of marks after which an outlier is dropped: when the link has become faster most marks show it; damage is
/// rare.
const OUTLIER_KEPT_FOR: u64 = 16;
/// Number of consecutive marks beyond the limit that make a growing step.
const LATE_MARKS_FOR_STEP: u32 = 3;
/// Tolerance within which early marks agree, ns: at the rate of a fast slew (0.5 deg/s) it is 0.2 arcsec. Or
/// [`AGREE_SCALES`] scales of the delays, if that is larger.
const AGREE_NS: f64 = 100_000.0;
const AGREE_SCALES: f64 = 4.0;
/// Smallest gate for early marks, ns: the resolution of stamps, and floors that are not quite constant.
const LEAST_GATE_NS: f64 = 3_000.0;
/// Deviations of the prediction up to which a mark is normal.
const GATE_SIGMAS: f64 = 6.0;
/// Largest contribution of these deviations while a line is young, ns.
const MOST_SIGMAS_NS: f64 = 95_000.0;

/// Classification of a mark.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    /// It fits the line.
    Fits,
    /// Earlier than physically possible, as are others before it.
    Fell,
    /// Outlier: earlier than physically possible.
    Outlier,
    /// Later than the limit.
    Late,
    /// The clock has stepped.
    Stepped,
}

/// Memory of doubtful marks.
#[derive(Debug, Clone)]
pub(super) struct Doubts {
    /// Outliers, each with its number.
    outliers: VecDeque<(u64, Mark)>,
    judged: u64,
    late_in_a_row: u32,
}

impl Mark {
    /// Returns the time from another mark to this one, remote s.
    pub(super) fn since_s(&self, other: &Self) -> f64 {
        self.remote_ns.saturating_sub(other.remote_ns) as f64 * 1e-9
    }

    /// Returns the remote time `by_s` seconds after this mark, ns.
    pub(super) fn later_ns(&self, by_s: f64) -> i64 {
        #[allow(clippy::cast_possible_truncation, reason = "float-to-int casts saturate")]
        let by_ns = (by_s * 1e9).round() as i64;
        self.remote_ns.saturating_add(by_ns)
    }
}

/// Returns how far below the line a mark may lie without being early, ns.
pub(super) fn gate_ns(line: &Line, mark: &Mark) -> f64 {
    let (offset_sigma_ns, rate_sigma_ns_per_s) = line.sigmas();
    let silent_s = mark.since_s(&line.newest()).abs();
    let young_ns = (GATE_SIGMAS * offset_sigma_ns).min(MOST_SIGMAS_NS);
    LEAST_GATE_NS + young_ns + GATE_SIGMAS * rate_sigma_ns_per_s * silent_s
}

/// Returns true when a mark belongs to the former line and not to the present one: near the floor of the one and not of
/// the other, or less than a step away from the one (late, perhaps) and a step away from the other.
pub(super) fn belongs_rather(mark: &Mark, former: &Line, present: &Line, step_ns: f64) -> bool {
    let is_near = |line: &Line| lies_within(line, mark, gate_ns(line, mark) + AGREE_SCALES * line.scale_ns());
    let could_be = |line: &Line| lies_within(line, mark, step_ns);
    (is_near(former) && !is_near(present)) || (could_be(former) && is_step_away(mark, present, step_ns))
}

fn lies_within(line: &Line, mark: &Mark, most_above_ns: f64) -> bool {
    let above_ns = line.at(mark.remote_ns).above_ns(mark.difference_ns);
    mark.remote_ns >= line.newest().remote_ns && (-gate_ns(line, mark)..=most_above_ns).contains(&above_ns)
}

fn is_step_away(mark: &Mark, line: &Line, step_ns: f64) -> bool {
    let above_ns = line.at(mark.remote_ns).above_ns(mark.difference_ns);
    mark.remote_ns < line.newest().remote_ns || above_ns.abs() > step_ns
}

impl Doubts {
    pub(super) fn new() -> Self {
        Self { outliers: VecDeque::with_capacity(OUTLIER_KEPT_FOR as usize), judged: 0, late_in_a_row: 0 }
    }

    pub(super) fn clear(&mut self) {
        self.outliers.clear();
        self.late_in_a_row = 0;
    }

    /// Judges a mark against the line; outliers are kept for comparison with later ones.
    pub(super) fn judge(&mut self, line: &Line, mark: &Mark, step_ns: f64) -> Verdict {
        self.judged += 1;
        while self.outliers.front().is_some_and(|(number, _)| self.judged - number >= OUTLIER_KEPT_FOR) {
            self.outliers.pop_front();
        }
        let above_ns = line.at(mark.remote_ns).above_ns(mark.difference_ns);
        if mark.remote_ns < line.newest().remote_ns || above_ns < -step_ns {
            return Verdict::Stepped;
        }
        if above_ns > step_ns {
            self.late_in_a_row += 1;
            return if self.late_in_a_row >= LATE_MARKS_FOR_STEP { Verdict::Stepped } else { Verdict::Late };
        }
        if above_ns >= -gate_ns(line, mark) {
            self.late_in_a_row = 0;
            return Verdict::Fits;
        }
        if self.agreeing(line, mark).count() >= AGREEING {
            self.late_in_a_row = 0;
            return Verdict::Fell;
        }
        self.outliers.push_back((self.judged, *mark));
        Verdict::Outlier
    }

    /// Returns the outliers that agree with this one, in order of time.
    pub(super) fn agreeing<'a>(&'a self, line: &Line, mark: &'a Mark) -> impl Iterator<Item = Mark> + 'a {
        let within_ns = AGREE_NS.max(AGREE_SCALES * line.scale_ns());
        let rate = line.at(mark.remote_ns).rate_ns_per_s;
        self.outliers.iter().map(|(_, outlier)| *outlier).filter(move |outlier| {
            let between_ns = mark.difference_ns.saturating_sub(outlier.difference_ns) as f64;
            (between_ns - rate * mark.since_s(outlier)).abs() <= within_ns
        })
    }
}
