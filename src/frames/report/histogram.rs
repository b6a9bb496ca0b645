//! Quantiles of times and counts, recorded while frames run.
//!
//! Times: 1 us to 60 s at three significant digits (0.1 %, and 0.5 us below 1 ms); all memory is taken at the start
//! (about 140 KiB), recording allocates nothing. Longer times count as 60 s in the quantiles; the maximum and the
//! mean are exact. A negative time (early, or interpolated) counts as 0.

use crate::report::time_tally::TimeTally;
use base::time::Span;
use hdrhistogram::Histogram;
use serde::Serialize;

/// Shortest time that is distinguished from 0.
const LOW_NS: u64 = 1_000;
/// Longest time that is distinguished from longer ones.
const HIGH_NS: u64 = 60_000_000_000;
/// Largest count that is distinguished from larger ones (stars in a frame).
const HIGH_COUNT: u64 = 10_000_000;
/// Significant decimal digits.
const DIGITS: u8 = 3;

/// Times of one stage over a run.
#[derive(Debug, Clone)]
pub struct StageHistogram {
    histogram: Histogram<u64>,
    max_ns: u64,
    sum_ns: u128,
    tally: TimeTally,
}

/// Summary of the times of one stage. All are 0 when nothing was recorded.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct Quantiles {
    /// Times recorded.
    pub count: u64,
    /// Half were at most this, ms.
    pub p50_ms: f64,
    /// 99 % were at most this, ms.
    pub p99_ms: f64,
    /// 99.9 % were at most this, ms. With fewer than 1000 times this is the longest.
    pub p999_ms: f64,
    /// Longest, exact, ms.
    pub max_ms: f64,
    /// Mean, exact, ms.
    pub mean_ms: f64,
}

impl Default for StageHistogram {
    fn default() -> Self {
        let histogram = Histogram::new_with_bounds(LOW_NS, HIGH_NS, DIGITS).expect("constant bounds that are valid");
        Self { histogram, max_ns: 0, sum_ns: 0, tally: TimeTally::EMPTY }
    }
}

impl StageHistogram {
    /// Records one time; takes no memory.
    pub fn record(&mut self, time: Span) {
        let ns = u64::try_from(time.ns()).unwrap_or(0);
        self.histogram.saturating_record(ns.min(HIGH_NS));
        self.max_ns = self.max_ns.max(ns);
        self.sum_ns += u128::from(ns);
        self.tally.record_ns(ns);
    }

    /// Returns the same times in few bins, small enough to be copied while the run goes on.
    pub fn tally(&self) -> &TimeTally {
        &self.tally
    }

    /// Returns the median of the times so far, ms; 0 when nothing was recorded. Cheaper than all quantiles.
    pub fn median_ms(&self) -> f64 {
        self.at_ms(0.5)
    }

    fn at_ms(&self, quantile: f64) -> f64 {
        // The histogram answers with the upper end of a bin: for zeros, and for the longest time, that is too much.
        match self.histogram.value_at_quantile(quantile).min(self.max_ns) {
            0..LOW_NS => 0.0,
            ns => ns as f64 / 1e6,
        }
    }

    /// Returns the summary of the times so far.
    pub fn quantiles(&self) -> Quantiles {
        let count = self.histogram.len();
        if count == 0 {
            return Quantiles::default();
        }
        Quantiles {
            count,
            p50_ms: self.at_ms(0.5),
            p99_ms: self.at_ms(0.99),
            p999_ms: self.at_ms(0.999),
            max_ms: self.max_ns as f64 / 1e6,
            mean_ms: self.sum_ns as f64 / count as f64 / 1e6,
        }
    }
}

/// Counts per frame (stars) over a run.
#[derive(Debug, Clone)]
pub struct CountHistogram {
    histogram: Histogram<u64>,
    min: u64,
    max: u64,
}

/// Least, middle and largest count. All are 0 when nothing was recorded.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct CountSpread {
    /// Least, exact.
    pub min: u64,
    /// Middle, to three digits.
    pub median: u64,
    /// Largest, exact.
    pub max: u64,
}

impl Default for CountHistogram {
    fn default() -> Self {
        let histogram = Histogram::new_with_bounds(1, HIGH_COUNT, DIGITS).expect("constant bounds that are valid");
        Self { histogram, min: u64::MAX, max: 0 }
    }
}

impl CountHistogram {
    /// Records one count; takes no memory.
    pub fn record(&mut self, count: u64) {
        self.histogram.saturating_record(count.min(HIGH_COUNT));
        self.min = self.min.min(count);
        self.max = self.max.max(count);
    }

    /// Returns the summary of the counts so far.
    pub fn spread(&self) -> CountSpread {
        if self.histogram.is_empty() {
            return CountSpread::default();
        }
        let median = self.histogram.value_at_quantile(0.5).clamp(self.min, self.max);
        CountSpread { min: self.min, median, max: self.max }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns three significant digits, and one step of 512 ns.
    fn within_resolution(got_ms: f64, wanted_ms: f64) -> bool {
        (got_ms - wanted_ms).abs() <= 1e-3 * wanted_ms + 0.000_512
    }

    #[test]
    fn quantiles_of_known_times() {
        let mut histogram = StageHistogram::default();
        (1..=10_000).for_each(|us| histogram.record(Span::from_ns(us * 1_000)));
        let q = histogram.quantiles();
        assert_eq!(q.count, 10_000);
        for (got, wanted) in [(q.p50_ms, 5.0), (q.p99_ms, 9.9), (q.p999_ms, 9.99)] {
            assert!(within_resolution(got, wanted), "{got} ms for {wanted} ms");
        }
        assert!(!within_resolution(q.p50_ms, 5.02), "the comparison can fail");
        assert_eq!((histogram.median_ms(), StageHistogram::default().median_ms()), (q.p50_ms, 0.0));
        assert_eq!((q.max_ms, q.mean_ms), (10.0, 5.000_5), "exact");
    }

    #[test]
    fn times_out_of_range_are_kept_honest() {
        let mut histogram = StageHistogram::default();
        [-5, 0, 1, 90_000_000_000, i64::MAX].into_iter().for_each(|ns| histogram.record(Span::from_ns(ns)));
        let q = histogram.quantiles();
        assert_eq!(q.count, 5);
        assert_eq!(q.max_ms, i64::MAX as f64 / 1e6, "the maximum is exact beyond 60 s");
        assert_eq!(q.p50_ms, 0.0, "zeros stay zero");
        assert_eq!(StageHistogram::default().quantiles(), Quantiles::default(), "nothing recorded");
    }

    #[test]
    fn a_quantile_is_never_above_the_maximum() {
        let mut histogram = StageHistogram::default();
        histogram.record(Span::from_ns(7_777_777));
        let q = histogram.quantiles();
        assert!(q.p50_ms <= q.max_ms && q.p999_ms <= q.max_ms, "{q:?}");
    }

    #[test]
    fn recording_allocates_nothing() {
        let mut histogram = StageHistogram::default();
        let bins = histogram.histogram.distinct_values();
        histogram.record(Span::from_ns(i64::MAX));
        assert_eq!(histogram.histogram.distinct_values(), bins);
        assert!(!histogram.histogram.is_auto_resize());
    }

    #[test]
    fn spread_of_counts() {
        let mut counts = CountHistogram::default();
        assert_eq!(counts.spread(), CountSpread::default());
        [0, 7, 9, 20, 99_999_999].into_iter().for_each(|n| counts.record(n));
        assert_eq!(counts.spread(), CountSpread { min: 0, median: 9, max: 99_999_999 });
    }
}
