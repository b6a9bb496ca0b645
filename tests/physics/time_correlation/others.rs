//! Simpler estimators, to compare with.

use super::link::CONSTANT_DELAY;
use base::time::{Span, Tai};
use std::collections::VecDeque;

const HULL_S: f64 = 30.0;
const LEAST_NS: i64 = 2_000_000_000;

/// The newest mark's difference, whatever its delay.
#[derive(Default)]
pub(super) struct LastMark {
    difference_ns: i64,
}

/// The smallest difference of 2 s.
pub(super) struct LeastOfTwoSeconds {
    marks: VecDeque<(i64, i64)>,
}

/// The line under 30 s of marks that is highest over their middle, by Newton's method on its slope.
pub(super) struct HullAlone {
    marks: VecDeque<(i64, i64)>,
}

fn keep(marks: &mut VecDeque<(i64, i64)>, remote_ns: i64, local: Tai, length_ns: i64) {
    marks.push_back((remote_ns, local.ns() - remote_ns - CONSTANT_DELAY.ns()));
    while marks.front().is_some_and(|mark| mark.0 < remote_ns - length_ns) {
        marks.pop_front();
    }
}

impl LastMark {
    pub(super) fn observe(&mut self, remote_ns: i64, local: Tai) {
        self.difference_ns = local.ns() - remote_ns - CONSTANT_DELAY.ns();
    }

    pub(super) fn to_tai(&self, remote_ns: i64) -> Tai {
        Tai::from_ns(remote_ns + self.difference_ns)
    }
}

impl LeastOfTwoSeconds {
    pub(super) fn new() -> Self {
        Self { marks: VecDeque::new() }
    }

    pub(super) fn observe(&mut self, remote_ns: i64, local: Tai) {
        keep(&mut self.marks, remote_ns, local, LEAST_NS);
    }

    pub(super) fn to_tai(&self, remote_ns: i64) -> Tai {
        Tai::from_ns(remote_ns + self.marks.iter().map(|mark| mark.1).min().unwrap())
    }
}

impl HullAlone {
    pub(super) fn new() -> Self {
        Self { marks: VecDeque::new() }
    }

    pub(super) fn observe(&mut self, remote_ns: i64, local: Tai) {
        keep(&mut self.marks, remote_ns, local, (HULL_S * 1e9) as i64);
    }

    /// Returns the height over the middle, as a function of the slope, is concave: its maximum by golden section.
    pub(super) fn to_tai(&self, remote_ns: i64) -> Tai {
        let (first, last) = (self.marks[0], self.marks[self.marks.len() - 1]);
        let middle_ns = (first.0 + last.0) / 2;
        let points: Vec<(f64, f64)> =
            self.marks.iter().map(|m| ((m.0 - middle_ns) as f64 * 1e-9, (m.1 - first.1) as f64)).collect();
        let height = |slope: f64| points.iter().fold(f64::MAX, |least, p| least.min(p.1 - slope * p.0));
        let (mut low, mut high) = (-200_000.0, 200_000.0);
        const GOLDEN: f64 = 0.618_033_988_749_894_9;
        for _ in 0..45 {
            let (a, b) = (high - GOLDEN * (high - low), low + GOLDEN * (high - low));
            if height(a) < height(b) {
                low = a;
            } else {
                high = b;
            }
        }
        let slope = 0.5 * (low + high);
        let since_s = (remote_ns - middle_ns) as f64 * 1e-9;
        Tai::from_ns(remote_ns + first.1) + Span::from_s((height(slope) + slope * since_s) * 1e-9)
    }
}
