//! Offset and drift with their covariance: a Kalman filter of two states.
//!
//! Input: measured offsets (ns) and rates (ns/s = ppb) with their variances, at remote times. Model: the offset is the
//! integral of the rate, the rate walks at random with `q` (ns/s)^2/s. An oscillator whose frequency walks has the
//! Allan variance `q tau / 3`, so `q = 3 a^2` with `a` the Allan deviation at 1 s. Measurements come one by one (their
//! errors are independent). One that deviates by more than [`BELIEVED_SIGMAS`] is either a bad measurement or the sign
//! of a shock; [`Trust`] selects which: the measurement's variance or the prior's is widened until the deviation equals
//! that limit. Tests: against textbook least squares, and consistency in `tests/physics/time_correlation.rs`.

use base::time::{Span, Tai};

/// Largest deviation at which a measurement is used unchanged, sigma.
const BELIEVED_SIGMAS: f64 = 4.0;

/// Side that is trusted when measurement and prior disagree.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Trust {
    /// The measurement is trusted, and the prior widened.
    Measurement,
    /// The prior is trusted, and the measurement widened.
    Prior,
}

/// The state at one remote time.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct TwoState {
    pub(super) at_remote_ns: i64,
    /// Whole nanoseconds to which `offset_ns` is added: f64 would lose them.
    base_ns: i64,
    offset_ns: f64,
    pub(super) rate_ns_per_s: f64,
    offset_variance: f64,
    covariance: f64,
    rate_variance: f64,
}

impl TwoState {
    /// Returns a state with an offset and a rate of 0, with these deviations.
    pub(super) fn new(remote_ns: i64, offset_ns: i64, offset_sigma_ns: f64, rate_sigma_ns_per_s: f64) -> Self {
        Self {
            at_remote_ns: remote_ns,
            base_ns: offset_ns,
            offset_ns: 0.0,
            rate_ns_per_s: 0.0,
            offset_variance: offset_sigma_ns * offset_sigma_ns,
            covariance: 0.0,
            rate_variance: rate_sigma_ns_per_s * rate_sigma_ns_per_s,
        }
    }

    /// Returns the offset: whole nanoseconds and the rest.
    pub(super) fn offset(&self) -> (i64, f64) {
        (self.base_ns, self.offset_ns)
    }

    pub(super) fn offset_sigma_ns(&self) -> f64 {
        self.offset_variance.max(0.0).sqrt()
    }

    pub(super) fn rate_sigma_ns_per_s(&self) -> f64 {
        self.rate_variance.max(0.0).sqrt()
    }

    /// Returns the height of an offset above this state's, ns.
    pub(super) fn above_ns(&self, offset_ns: i64) -> f64 {
        offset_ns.saturating_sub(self.base_ns) as f64 - self.offset_ns
    }

    /// Returns the state at another time.
    pub(super) fn at(mut self, remote_ns: i64, walk: f64) -> Self {
        let t_s = remote_ns.saturating_sub(self.at_remote_ns) as f64 * 1e-9;
        let age_s = t_s.abs();
        self.at_remote_ns = remote_ns;
        self.offset_ns += self.rate_ns_per_s * t_s;
        self.offset_variance +=
            t_s * (2.0 * self.covariance + t_s * self.rate_variance) + walk * age_s * age_s * age_s / 3.0;
        self.covariance += t_s * self.rate_variance + 0.5 * walk * t_s * age_s;
        self.rate_variance += walk * age_s;
        self.rebased()
    }

    /// Returns the state updated with a measured offset: `base_ns + rest_ns`.
    pub(super) fn with_offset(mut self, base_ns: i64, rest_ns: f64, variance: f64, trust: Trust) -> Self {
        let innovation = self.above_ns(base_ns) + rest_ns;
        let variance = self.widen(innovation, self.offset_variance, variance, trust);
        let share = 1.0 / (self.offset_variance + variance);
        let (by_offset, by_rate) = (self.offset_variance * share, self.covariance * share);
        self.offset_ns += by_offset * innovation;
        self.rate_ns_per_s += by_rate * innovation;
        self.rate_variance -= by_rate * self.covariance;
        self.covariance -= by_offset * self.covariance;
        self.offset_variance -= by_offset * self.offset_variance;
        self.rebased()
    }

    /// Returns the state updated with a measured rate.
    pub(super) fn with_rate(mut self, rate_ns_per_s: f64, variance: f64, trust: Trust) -> Self {
        let innovation = rate_ns_per_s - self.rate_ns_per_s;
        let variance = self.widen(innovation, self.rate_variance, variance, trust);
        let share = 1.0 / (self.rate_variance + variance);
        let (by_offset, by_rate) = (self.covariance * share, self.rate_variance * share);
        self.offset_ns += by_offset * innovation;
        self.rate_ns_per_s += by_rate * innovation;
        self.offset_variance -= by_offset * self.covariance;
        self.covariance -= by_rate * self.covariance;
        self.rate_variance -= by_rate * self.rate_variance;
        self
    }

    /// Returns the same rate with slightly more uncertainty, and an offset whose error is only known by its size.
    pub(super) fn shifted_to(mut self, remote_ns: i64, offset_ns: i64, offset_sigma_ns: f64, rate_shock: f64) -> Self {
        self.at_remote_ns = remote_ns;
        self.base_ns = offset_ns;
        self.offset_ns = 0.0;
        self.offset_variance = offset_sigma_ns * offset_sigma_ns;
        self.covariance = 0.0;
        self.rate_variance += rate_shock * rate_shock;
        self
    }

    /// Returns the state with its rate limited.
    pub(super) fn limited(mut self, most_ns_per_s: f64) -> Self {
        self.rate_ns_per_s = self.rate_ns_per_s.clamp(-most_ns_per_s, most_ns_per_s);
        self
    }

    /// Widens the untrusted side, and returns the measurement's variance.
    fn widen(&mut self, innovation: f64, prior: f64, measured: f64, trust: Trust) -> f64 {
        let total = (innovation / BELIEVED_SIGMAS).powi(2);
        if total <= prior + measured {
            return measured;
        }
        if trust == Trust::Prior || prior <= 0.0 {
            return total - prior;
        }
        let factor = (total - measured).max(prior) / prior;
        self.offset_variance *= factor;
        self.covariance *= factor;
        self.rate_variance *= factor;
        measured
    }

    /// Keeps the fractional part small.
    fn rebased(mut self) -> Self {
        #[allow(clippy::cast_possible_truncation, reason = "float-to-int casts saturate")]
        let whole = self.offset_ns.round() as i64;
        self.base_ns = self.base_ns.saturating_add(whole);
        self.offset_ns -= whole as f64;
        self
    }
}

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

    /// Rounding of sums of numbers near 1e6.
    const ROUNDING: f64 = 1e-6;

    #[test]
    fn without_a_walk_it_is_least_squares() {
        // Offsets at 0..5 s, of variance 4 ns^2, no prior: the straight line by the textbook's formulae.
        let measured = [103.0, 98.0, 111.0, 116.0, 113.0, 125.0];
        let n = measured.len() as f64;
        let (mean_t, mean_y) = (2.5, measured.iter().sum::<f64>() / n);
        let t_variance: f64 = (0..6).map(|t| (f64::from(t) - mean_t).powi(2)).sum();
        let slope = (0..6).zip(measured).map(|(t, y)| (f64::from(t) - mean_t) * (y - mean_y)).sum::<f64>() / t_variance;
        let mut state = TwoState::new(0, 0, 1e6, 1e6);
        for (t, y) in (0_i64..).zip(measured) {
            state = state.at(t * 1_000_000_000, 0.0).with_offset(0, y, 4.0, Trust::Prior);
        }
        let (base_ns, rest_ns) = state.offset();
        assert!((base_ns as f64 + rest_ns - (mean_y + slope * 2.5)).abs() < ROUNDING, "{state:?}");
        assert!((state.rate_ns_per_s - slope).abs() < ROUNDING, "{state:?}");
        let variance = 4.0 * (1.0 / n + 2.5 * 2.5 / t_variance);
        assert!((state.offset_sigma_ns() - variance.sqrt()).abs() < ROUNDING, "{state:?}");
        assert!((state.rate_sigma_ns_per_s() - (4.0 / t_variance).sqrt()).abs() < ROUNDING, "{state:?}");
    }

    #[test]
    fn a_walk_widens_by_its_integrals() {
        let state = TwoState::new(0, 0, 0.0, 0.0).at(10_000_000_000, 3.0);
        assert!((state.offset_sigma_ns() - 1000.0_f64.sqrt()).abs() < ROUNDING, "q t^3 / 3");
        assert!((state.rate_sigma_ns_per_s() - 30.0_f64.sqrt()).abs() < ROUNDING, "q t");
        let known = state.with_offset(0, 0.0, 0.0, Trust::Prior);
        // Uncertainty of the rate that remains when the offset is known: q t / 4.
        assert!((known.rate_sigma_ns_per_s() - 7.5_f64.sqrt()).abs() < ROUNDING, "{known:?}");
    }

    #[test]
    fn a_shock_widens_the_prior_and_an_ordinary_error_does_not() {
        let sure = TwoState::new(0, 0, 1.0, 1.0);
        let ordinary = sure.with_offset(0, 5.0, 1.0, Trust::Measurement);
        assert!((ordinary.offset().0 as f64 + ordinary.offset().1 - 2.5).abs() < ROUNDING, "the mean: {ordinary:?}");
        let shocked = sure.with_offset(0, 400.0, 1.0, Trust::Measurement);
        assert!(shocked.offset().0 >= 370, "{shocked:?}");
        let turned = sure.with_rate(400.0, 1.0, Trust::Measurement);
        assert!(turned.rate_ns_per_s > 370.0, "{turned:?}");
        let doubted = sure.with_offset(0, 400.0, 1.0, Trust::Prior);
        assert_eq!(doubted.offset().0, 0, "{doubted:?}");
        assert!(doubted.offset_sigma_ns() > 0.99, "nothing was learnt: {doubted:?}");
    }

    #[test]
    fn large_offsets_keep_their_nanoseconds() {
        let base_ns = 1_800_000_000_000_000_005;
        let state = TwoState::new(0, base_ns - 4, 1e3, 0.0).with_offset(base_ns, 0.25, 1.0, Trust::Prior);
        let (found_ns, rest_ns) = state.offset();
        let above = (found_ns - base_ns) as f64 + rest_ns;
        assert!((above - 0.25).abs() < 1e-4, "{above}");
    }
}

#[cfg(test)]
mod estimate_tests {
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
