//! When packets may leave: a stated rate and the client's own pause between packets.
//!
//! A receiver's buffer holds a few hundred packets; a frame sent at once overruns it. Packets leave in small batches,
//! each followed by the time that it takes at the rate. After a late wake-up the lost time is caught up, but no more
//! than [`CATCH_UP`], so that the pace never turns into a burst. Test: the average rate on a clock that does not
//! advance between batches, and one that oversleeps.

use base::clock::Clock;
use base::time::{Span, Tai};

/// Time that may be caught up.
const CATCH_UP: Span = Span::from_ns(500_000);
/// Duration of a batch: shorter ones cost wake-ups, longer ones are bursts.
const BATCH: Span = Span::from_ns(200_000);

/// The pace of one stream.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pace {
    ns_per_byte: f64,
    next: Tai,
}

impl Pace {
    /// Returns a pace of so many bits a second.
    pub(super) fn new(rate_bit_s: f64, now: Tai) -> Self {
        Self { ns_per_byte: 8e9 / rate_bit_s, next: now }
    }

    /// Returns packets of one batch, 1 to `most`.
    pub(super) fn batch(&self, packet_bytes: usize, delay_ns: u32, most: usize) -> usize {
        let packet_ns = self.packet_ns(packet_bytes, delay_ns);
        let fit = (BATCH.ns() as f64 / packet_ns.max(1.0)).floor();
        (1..most).find(|count| (*count + 1) as f64 > fit).unwrap_or(most)
    }

    fn packet_ns(&self, bytes: usize, delay_ns: u32) -> f64 {
        self.ns_per_byte * bytes as f64 + f64::from(delay_ns)
    }

    /// Waits until the next batch may leave, and books its time.
    pub(super) fn wait(&mut self, clock: &dyn Clock, bytes: usize, packets: usize, delay_ns: u32) {
        let now = clock.now();
        if self.next > now {
            clock.sleep_until(self.next);
        }
        let taken_ns = self.ns_per_byte * bytes as f64 + f64::from(delay_ns) * packets as f64;
        self.next = self.next.max(now - CATCH_UP) + Span::from_s(taken_ns * 1e-9);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::clock::Virtual;

    const START: Tai = Tai::from_ns(1_000_000_000);

    /// A clock whose every sleep is longer by so much.
    struct Sleepy(Virtual, Span);

    impl Clock for Sleepy {
        fn now(&self) -> Tai {
            self.0.now()
        }
        fn sleep_until(&self, at: Tai) {
            self.0.sleep_until(at + self.1);
        }
        fn is_real(&self) -> bool {
            false
        }
    }

    /// Returns seconds that 10 MB take in batches of 10 packets.
    fn duration_s(delay_ns: u32, oversleep: Span) -> f64 {
        let clock = Sleepy(Virtual::new(START), oversleep);
        let mut pace = Pace::new(8e8, START);
        for _ in 0..1000 {
            pace.wait(&clock, 10_000, 10, delay_ns);
        }
        (clock.now() - START).s()
    }

    #[test]
    fn the_rate_is_kept_on_average_and_the_pause_is_added() {
        assert!((duration_s(0, Span::ZERO) - 0.0999).abs() < 1e-6, "100 us for each batch but the last");
        assert!((duration_s(5_000, Span::ZERO) - 0.14985).abs() < 1e-6, "and 50 us of pause");
        assert!((duration_s(0, Span::from_ns(60_000)) - 0.0999).abs() < 2e-4, "short oversleeping is caught up");
        // Of each 2 ms that are slept too long 0.5 ms are caught up: six batches in 2 ms instead of twenty.
        assert!((0.3..0.4).contains(&duration_s(0, Span::from_ms(2))), "long oversleeping is not");
    }

    #[test]
    fn batches_take_about_their_time() {
        let pace = Pace::new(8e8, START);
        assert_eq!(pace.batch(1_500, 0, 32), 13, "15 us each");
        assert_eq!(pace.batch(9_000, 0, 32), 2);
        assert_eq!(pace.batch(65_000, 0, 32), 1);
        assert_eq!(pace.batch(1_500, 1_000_000, 32), 1);
        assert_eq!(pace.batch(100, 0, 32), 32);
    }
}
