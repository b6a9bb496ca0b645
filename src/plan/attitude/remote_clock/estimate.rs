//! Estimate of the remote clock at one instant, with its uncertainty.

use base::time::{Span, Tai};

/// Local time of a remote time: `local = remote + offset + drift * (remote - reference)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockEstimate {
    /// Local minus remote time at the reference, with the link's constant delay subtracted.
    pub offset: Span,
    /// Remote time to which the offset refers, ns: that of the newest mark.
    pub reference_remote_ns: i64,
    /// Local seconds per remote second, minus one.
    pub drift: f64,
    /// One sigma of the offset, without the error of the calibrated constant delay.
    pub offset_sigma: Span,
    /// One sigma of the drift.
    pub drift_sigma: f64,
    /// Random walk of the drift: its variance grows by this each second, 1/s.
    pub drift_walk_per_s: f64,
    /// Height of the newest mark above the line: its queueing delay, as estimated when it came.
    pub residual: Span,
    /// Largest minus smallest difference in this window and the previous one: the variation of the link's delay.
    pub spread: Span,
    /// Number of marks in this window and the previous one.
    pub pairs: usize,
}

impl ClockEstimate {
    /// Returns the local time of a remote time.
    pub fn to_tai(&self, remote_ns: i64) -> Tai {
        Tai::from_ns(remote_ns) + self.offset + self.drifted(remote_ns)
    }

    /// Returns the remote time, ns, of a local time: the inverse of [`Self::to_tai`] to 1 ns.
    pub fn to_remote_ns(&self, local: Tai) -> i64 {
        let undrifted = local - self.offset;
        let since = Span::from_ns(undrifted.ns().saturating_sub(self.reference_remote_ns));
        let remote = undrifted - Span::from_s(self.drift / (1.0 + self.drift) * since.s());
        remote.ns()
    }

    /// Returns one sigma at a remote time from the errors of offset and drift and the random walk of the drift (`q t^3
    /// / 3`). Offset and drift are taken as independent, and their errors are added: never too small.
    pub fn sigma_at(&self, remote_ns: i64) -> Span {
        let since_s = Span::from_ns(remote_ns.saturating_sub(self.reference_remote_ns)).s().abs();
        let straight_s = self.offset_sigma.s() + self.drift_sigma * since_s;
        Span::from_s((straight_s * straight_s + self.drift_walk_per_s * since_s.powi(3) / 3.0).sqrt())
    }

    fn drifted(&self, remote_ns: i64) -> Span {
        Span::from_s(self.drift * Span::from_ns(remote_ns.saturating_sub(self.reference_remote_ns)).s())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn estimate(offset_ns: i64, reference_remote_ns: i64, drift: f64) -> ClockEstimate {
        ClockEstimate {
            offset: Span::from_ns(offset_ns),
            reference_remote_ns,
            drift,
            offset_sigma: Span::from_ns(100),
            drift_sigma: 1e-7,
            drift_walk_per_s: 3e-18,
            residual: Span::ZERO,
            spread: Span::ZERO,
            pairs: 2,
        }
    }

    #[test]
    fn drift_has_its_place_in_the_estimate() {
        let estimate = estimate(100, 1000, 1e-3);
        assert_eq!(estimate.to_tai(1000).ns(), 1100);
        assert_eq!(estimate.to_tai(1_001_000).ns(), 1_001_100 + 1000);
        assert_eq!(estimate.to_remote_ns(Tai::from_ns(1_002_100)), 1_001_000);
    }

    #[test]
    fn sigma_grows_with_the_time_since_the_last_mark() {
        let estimate = estimate(0, 0, 0.0);
        assert_eq!(estimate.sigma_at(0).ns(), 100);
        // 100 ns + 1e-7 of a minute, and sqrt(3e-18 * 60^3 / 3) s = 465 ns: 6118 ns.
        assert_eq!(estimate.sigma_at(60_000_000_000).ns(), 6118);
        assert_eq!(estimate.sigma_at(-60_000_000_000).ns(), 6118, "backwards as well");
    }

    proptest! {
        #[test]
        fn local_and_remote_are_inverse_to_a_nanosecond(
            offset_ns in -2_000_000_000_000_000_000_i64..2_000_000_000_000_000_000,
            reference_ns in 0_i64..400_000_000_000_000_000,
            since_ns in -4_000_000_000_000_i64..4_000_000_000_000,
            drift in -2e-4..2e-4,
        ) {
            let estimate = estimate(offset_ns, reference_ns, drift);
            let remote_ns = reference_ns + since_ns;
            prop_assert!((estimate.to_remote_ns(estimate.to_tai(remote_ns)) - remote_ns).abs() <= 1);
            let local = Tai::from_ns(reference_ns + since_ns) + estimate.offset;
            prop_assert!((estimate.to_tai(estimate.to_remote_ns(local)) - local).ns().abs() <= 1);
        }
    }
}
