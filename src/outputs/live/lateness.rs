//! How early or late frames were: a histogram with signs.
//!
//! In: lateness (completion minus deadline, negative when early). Out: counts in [`BINS`] equal bins from one readout
//! time before the deadline to one after it, and one bin beyond each end. A bin has its upper end in it, so that a
//! frame that is finished at the deadline is in time. Test: below.

use base::time::Span;

/// Bins between the ends, half of them before the deadline.
pub(super) const BINS: usize = 48;

/// Counts by lateness; plain data.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct LatenessBins {
    /// Half of the width covered, s.
    reach_s: f64,
    /// The first counts earlier frames, the last later ones.
    counts: [u64; BINS + 2],
    sum_s: f64,
}

impl LatenessBins {
    /// Returns bins from `reach_s` before the deadline to `reach_s` after it; a reach that is not a positive number
    /// becomes 1 s.
    pub(super) fn reaching(reach_s: f64) -> Self {
        let reach_s = if reach_s.is_finite() && reach_s > 0.0 { reach_s } else { 1.0 };
        Self { reach_s, counts: [0; BINS + 2], sum_s: 0.0 }
    }

    pub(super) fn record(&mut self, lateness: Span) {
        let place = (lateness.s() / self.reach_s + 1.0) * (BINS / 2) as f64;
        // A float-to-int cast saturates.
        let bin = (place.ceil().max(0.0) as usize).min(BINS + 1);
        self.counts[bin] += 1;
        self.sum_s += lateness.s();
    }

    /// Returns half of the width covered, s.
    pub(super) fn reach_s(&self) -> f64 {
        self.reach_s
    }

    /// Returns the counts: earlier, the bins, later.
    pub(super) fn counts(&self) -> &[u64; BINS + 2] {
        &self.counts
    }

    /// Returns frames counted.
    pub(super) fn total(&self) -> u64 {
        self.counts.iter().sum()
    }

    /// Returns the sum of the lateness, s.
    pub(super) fn sum_s(&self) -> f64 {
        self.sum_s
    }

    /// Returns the upper bounds, s, of every fourth bin, and how many frames were at most each.
    pub(super) fn cumulative(&self) -> impl Iterator<Item = (f64, u64)> + '_ {
        let mut sum = 0;
        let half = (BINS / 2) as f64;
        let summed = self.counts[..=BINS].iter().enumerate().map(move |(i, count)| {
            sum += count;
            ((i as f64 / half - 1.0) * self.reach_s, sum)
        });
        summed.step_by(4)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_frame_at_the_deadline_is_in_time_and_one_after_it_is_not() {
        let mut bins = LatenessBins::reaching(0.048);
        for ns in [-48_000_001, -48_000_000, -47_999_999, 0, 1, 48_000_000, 48_000_001, i64::MAX, i64::MIN] {
            bins.record(Span::from_ns(ns));
        }
        let mut wanted = [0; BINS + 2];
        (wanted[0], wanted[1], wanted[BINS / 2], wanted[BINS / 2 + 1]) = (3, 1, 1, 1);
        (wanted[BINS], wanted[BINS + 1]) = (1, 2);
        assert_eq!(bins.counts(), &wanted);
        let found: Vec<(f64, u64)> = bins.cumulative().collect();
        assert_eq!(found.len(), BINS / 4 + 1);
        assert_eq!((found[0], found[6], found[12]), ((-0.048, 3), (0.0, 5), (0.048, 7)));
        assert_eq!(bins.total(), 9, "two are beyond the last bound");
    }

    #[test]
    fn invalid_reach_is_replaced() {
        for reach_s in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(LatenessBins::reaching(reach_s).reach_s(), 1.0);
        }
    }
}
