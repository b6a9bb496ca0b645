//! The flight computer's own clock: elapsed time since boot, at a rate slightly off.

use base::time::{Span, Tai};

/// Elapsed time since boot; on the wire its microseconds wrap at 2^32.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RemoteClock {
    boot: Tai,
    drift: f64,
}

impl RemoteClock {
    /// Returns a clock that reads zero at `boot` and runs fast by `drift_ppm`.
    pub fn new(boot: Tai, drift_ppm: f64) -> Self {
        Self { boot, drift: drift_ppm * 1e-6 }
    }

    /// Returns nanoseconds since boot; zero before it.
    pub fn elapsed_ns(&self, at: Tai) -> u64 {
        let true_span = at - self.boot;
        let read = true_span + Span::from_s(true_span.s() * self.drift);
        u64::try_from(read.ns()).unwrap_or(0)
    }

    /// Returns the whole microseconds since boot, not wrapped.
    pub fn elapsed_us(&self, at: Tai) -> u64 {
        self.elapsed_ns(at) / 1000
    }

    /// Returns the instant at which the clock reads `us` microseconds.
    pub fn at_us(&self, us: u64) -> Tai {
        let read = Span::from_ns(i64::try_from(us.saturating_mul(1000)).unwrap_or(i64::MAX));
        self.boot + read + Span::from_s(-read.s() * self.drift / (1.0 + self.drift))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reading_and_instant_are_inverse() {
        let boot = Tai::from_ns(1_700_000_000_000_000_000);
        for drift_ppm in [0.0, 20.0, -35.5] {
            let clock = RemoteClock::new(boot, drift_ppm);
            for us in [0, 1, 999_999, 5_000_000_000, 86_400_000_000] {
                let back_ns = clock.elapsed_ns(clock.at_us(us));
                assert!(back_ns.abs_diff(us * 1000) <= 1, "{back_ns} ns for {us} us at {drift_ppm} ppm");
            }
        }
        assert_eq!(RemoteClock::new(boot, 0.0).elapsed_ns(boot - Span::from_ms(1)), 0);
    }

    #[test]
    fn a_fast_clock_is_ahead() {
        let clock = RemoteClock::new(Tai::from_ns(0), 20.0);
        assert_eq!(clock.elapsed_us(Tai::from_ns(1_000_000_000_000)), 1_000_020_000);
    }
}
