//! Times in few bins: small enough to be copied to another thread after every frame.
//!
//! In: times, ns. Out: count, mean and maximum, exact; cumulative counts per bound; quantiles. Bounds are the preferred
//! numbers R10 (ten per decade, each about 1.26 of the one before) from 10 us to 10 s, and one bin for all that is
//! longer. Limit: a quantile lies in the right bin, so it is wrong by at most 26 % of itself (10 us below the first
//! bound); where that is too coarse, `histogram` keeps three digits. Tests: below.

use base::time::Span;

/// Ten bounds per decade, rounded as ISO 3 has them.
const R10: [u64; 10] = [1_000, 1_250, 1_600, 2_000, 2_500, 3_150, 4_000, 5_000, 6_300, 8_000];
/// Shortest bound in units of the first number of [`R10`].
const FIRST_NS: u64 = 10_000 / R10[0];
const DECADES: usize = 6;
const BOUNDS: usize = DECADES * R10.len() + 1;
/// Upper ends of the bins, ns, ends included.
const UPPER_NS: [u64; BOUNDS] = upper_ns();

const fn upper_ns() -> [u64; BOUNDS] {
    let mut bounds = [0; BOUNDS];
    let (mut i, mut decade) = (0, 1);
    while i < BOUNDS {
        bounds[i] = R10[i % R10.len()] * FIRST_NS * decade;
        i += 1;
        if i.is_multiple_of(R10.len()) {
            decade *= 10;
        }
    }
    bounds
}

/// Count, sum, maximum and bins of times.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TimeTally {
    count: u64,
    sum_ns: u64,
    max_ns: u64,
    bins: [u32; BOUNDS + 1],
}

impl Default for TimeTally {
    fn default() -> Self {
        Self::EMPTY
    }
}

impl TimeTally {
    /// Tally without recorded times.
    pub const EMPTY: Self = Self { count: 0, sum_ns: 0, max_ns: 0, bins: [0; BOUNDS + 1] };

    /// Records one time; a negative one counts as 0. Takes no memory.
    pub fn record(&mut self, time: Span) {
        self.record_ns(u64::try_from(time.ns()).unwrap_or(0));
    }

    pub(super) fn record_ns(&mut self, ns: u64) {
        let bin = UPPER_NS.partition_point(|upper| *upper < ns);
        self.bins[bin] = self.bins[bin].saturating_add(1);
        self.count += 1;
        self.sum_ns = self.sum_ns.saturating_add(ns);
        self.max_ns = self.max_ns.max(ns);
    }

    /// Returns times recorded.
    pub fn count(&self) -> u64 {
        self.count
    }

    /// Returns the sum of the times, s.
    pub fn sum_s(&self) -> f64 {
        self.sum_ns as f64 / 1e9
    }

    /// Returns the longest time, exact, ms; 0 when nothing was recorded.
    pub fn max_ms(&self) -> f64 {
        self.max_ns as f64 / 1e6
    }

    /// Returns the mean time, exact, ms; 0 when nothing was recorded.
    pub fn mean_ms(&self) -> f64 {
        self.sum_ns as f64 / self.count.max(1) as f64 / 1e6
    }

    /// Returns the time below which a share `q` (0 to 1) of the times lies, ms: interpolated in its bin, and never
    /// above the longest. 0 when nothing was recorded.
    pub fn quantile_ms(&self, q: f64) -> f64 {
        let rank = q.clamp(0.0, 1.0) * self.count as f64;
        let mut below = 0.0;
        for (i, bin) in self.bins.iter().map(|bin| f64::from(*bin)).enumerate().filter(|(_, bin)| *bin > 0.0) {
            if below + bin >= rank {
                let low_ns = i.checked_sub(1).map_or(0, |i| UPPER_NS[i]);
                let high_ns = UPPER_NS.get(i).copied().unwrap_or(u64::MAX).min(self.max_ns);
                let share = (rank - below) / bin;
                let low_ns = low_ns as f64;
                return (low_ns + share * (high_ns as f64 - low_ns)) / 1e6;
            }
            below += bin;
        }
        self.max_ms()
    }

    /// Returns the upper bounds, s, of a histogram with three bounds per decade (1, 2, 5), and how many times were at
    /// most each.
    pub fn cumulative(&self) -> impl Iterator<Item = (f64, u64)> + '_ {
        let mut sum = 0;
        let summed = UPPER_NS.iter().zip(&self.bins).map(move |(upper, bin)| {
            sum += u64::from(*bin);
            (*upper as f64 / 1e9, sum)
        });
        summed.enumerate().filter(|(i, _)| matches!(i % R10.len(), 0 | 3 | 7)).map(|(_, bound)| bound)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of_us(times_us: impl Iterator<Item = i64>) -> TimeTally {
        let mut tally = TimeTally::EMPTY;
        times_us.for_each(|us| tally.record(Span::from_ns(us * 1_000)));
        tally
    }

    #[test]
    fn bounds_go_from_10_us_to_10_s_and_a_time_at_a_bound_is_below_it() {
        assert_eq!((UPPER_NS[0], UPPER_NS[10], UPPER_NS[BOUNDS - 1]), (10_000, 100_000, 10_000_000_000));
        assert!(UPPER_NS.windows(2).all(|pair| pair[0] < pair[1]), "{UPPER_NS:?}");
        let tally = of_us([10, 11, 20, 50, 51].into_iter());
        let found: Vec<(f64, u64)> = tally.cumulative().take(4).collect();
        assert_eq!(found, [(1e-5, 1), (2e-5, 3), (5e-5, 4), (1e-4, 5)]);
        let last = tally.cumulative().last().unwrap();
        assert_eq!(last, (10.0, 5));
    }

    #[test]
    fn quantiles_are_within_a_bin_of_the_exact_ones() {
        /// One step of R10, the widest of them (1.25 to 1.6).
        const STEP: f64 = 1.281;
        let tally = of_us(1..=10_000);
        for q in [0.1, 0.5, 0.9, 0.99, 0.999] {
            let (got, exact) = (tally.quantile_ms(q), 10.0 * q);
            assert!(got <= exact * STEP && got >= exact / STEP, "{got} ms for {exact} ms");
        }
        assert!(tally.quantile_ms(0.5) < 9.0 / STEP, "the comparison can fail");
        assert_eq!((tally.quantile_ms(1.0), tally.max_ms(), tally.mean_ms()), (10.0, 10.0, 5.000_5));
        assert_eq!((tally.count(), tally.sum_s()), (10_000, 50.005));
    }

    #[test]
    fn empty_tally_zeros_and_longest_times_are_counted() {
        let none = TimeTally::EMPTY;
        assert_eq!((none.quantile_ms(0.99), none.mean_ms(), none.max_ms()), (0.0, 0.0, 0.0));
        let mut tally = TimeTally::EMPTY;
        [-5, 0, i64::MAX, i64::MAX].into_iter().for_each(|ns| tally.record(Span::from_ns(ns)));
        assert_eq!((tally.count(), tally.cumulative().last()), (4, Some((10.0, 2))), "longer ones are in no bound");
        assert_eq!(tally.max_ms(), i64::MAX as f64 / 1e6);
        assert!(tally.quantile_ms(0.99) <= tally.max_ms());
        assert!(tally.quantile_ms(0.25) <= 0.01, "zeros are in the first bin");
    }
}
