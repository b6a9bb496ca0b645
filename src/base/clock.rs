//! The two clocks: `Monotonic` for the bench, `Virtual` for simulation. The only reader of the machine's clocks.
//!
//! Loops take `&dyn Clock`; physics takes `at`. On the virtual clock a run does not depend on the machine's speed.

use crate::time::{Span, Tai};
use core::sync::atomic::{AtomicI64, Ordering};
use std::time::{Duration, Instant, SystemTime};

/// A source of time that can also wait.
pub trait Clock: Send + Sync {
    /// Returns the present instant.
    fn now(&self) -> Tai;
    /// Returns at `at` or just after it; at once when `at` has passed.
    fn sleep_until(&self, at: Tai);
    /// Returns whether waiting takes wall time (a bench), false when time is only simulated.
    fn is_real(&self) -> bool;
}

/// Wall time that never steps: set once from the system clock, then carried by the monotonic clock.
#[derive(Debug)]
pub struct Monotonic {
    origin: Instant,
    tai_ns_at_origin: AtomicI64,
}

impl Monotonic {
    /// Returns a clock that reads `at` now: a bench that plays another time of the sky.
    #[allow(clippy::disallowed_methods, reason = "the one place that reads the machine's clocks")]
    pub fn start_at(at: Tai) -> Self {
        Self { origin: Instant::now(), tai_ns_at_origin: AtomicI64::new(at.ns()) }
    }

    /// Starts from the system's idea of UTC (assumes it is right; TAI follows by the leap-second table).
    #[allow(clippy::disallowed_methods, reason = "the one place that reads the machine's clocks")]
    pub fn start() -> Self {
        let unix = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let unix_ns = i64::try_from(unix.as_nanos()).unwrap_or(i64::MAX);
        Self { origin: Instant::now(), tai_ns_at_origin: AtomicI64::new(Tai::from_unix_ns(unix_ns).ns()) }
    }

    /// Reads `at` from now on. For the code that sets a bench up, before any thread waits on it: parts that need the
    /// clock may start slowly (a window, a socket), and the run begins on time all the same.
    pub fn restart_at(&self, at: Tai) {
        let elapsed = self.now() - Tai::from_ns(self.tai_ns_at_origin.load(Ordering::SeqCst));
        self.tai_ns_at_origin.store((at - elapsed).ns(), Ordering::SeqCst);
    }
}

impl Clock for Monotonic {
    fn now(&self) -> Tai {
        let elapsed_ns = i64::try_from(self.origin.elapsed().as_nanos()).unwrap_or(i64::MAX);
        Tai::from_ns(self.tai_ns_at_origin.load(Ordering::Relaxed)) + Span::from_ns(elapsed_ns)
    }

    fn sleep_until(&self, at: Tai) {
        let left_ns = (at - self.now()).ns();
        if let Ok(ns) = u64::try_from(left_ns) {
            std::thread::sleep(Duration::from_nanos(ns));
        }
    }

    fn is_real(&self) -> bool {
        true
    }
}

/// Time that moves only on request.
#[derive(Debug)]
pub struct Virtual {
    now_ns: AtomicI64,
}

impl Virtual {
    /// Returns a virtual clock that shows `start`.
    pub fn new(start: Tai) -> Self {
        Self { now_ns: AtomicI64::new(start.ns()) }
    }

    /// Moves time forward to `at`; never back.
    pub fn advance_to(&self, at: Tai) {
        self.now_ns.fetch_max(at.ns(), Ordering::SeqCst);
    }
}

impl Clock for Virtual {
    fn now(&self) -> Tai {
        Tai::from_ns(self.now_ns.load(Ordering::SeqCst))
    }

    fn sleep_until(&self, at: Tai) {
        self.advance_to(at);
    }

    fn is_real(&self) -> bool {
        false
    }
}

/// One instant on two clocks: a clock of ours and the system's CLOCK_REALTIME.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PairedReading {
    /// Reading of our clock.
    pub bench: Tai,
    /// CLOCK_REALTIME at that instant, nanoseconds since 1970-01-01 UTC, unsmoothed: it may step at any time.
    pub realtime_ns: i64,
    /// The two readings are at most half of this apart: time that passed while both were read.
    pub window: Span,
}

impl PairedReading {
    /// A window no longer than this is good enough.
    const GOOD_WINDOW: Span = Span::from_ns(5_000);
    const MOST_TRIES: u32 = 4;

    /// Reads both clocks. When the reader was interrupted in between it tries again, and keeps the closest pair of at
    /// most four.
    pub fn take(clock: &dyn Clock) -> Self {
        let mut best = Self::once(clock);
        for _ in 1..Self::MOST_TRIES {
            if best.window <= Self::GOOD_WINDOW {
                break;
            }
            let again = Self::once(clock);
            best = if again.window < best.window { again } else { best };
        }
        best
    }

    #[allow(clippy::disallowed_methods, reason = "the one place that reads the machine's clocks")]
    fn once(clock: &dyn Clock) -> Self {
        let before = clock.now();
        let unix = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
        let window = clock.now() - before;
        let realtime_ns = i64::try_from(unix.as_nanos()).unwrap_or(i64::MAX);
        Self { bench: before + Span::from_ns(window.ns() / 2), realtime_ns, window }
    }
}

/// Wall-clock stopwatch for measuring stages; never feeds physics.
#[derive(Debug, Clone, Copy)]
pub struct Stopwatch {
    from: Instant,
}

impl Stopwatch {
    /// Starts measuring.
    #[allow(clippy::disallowed_methods, reason = "the one place that reads the machine's clocks")]
    pub fn start() -> Self {
        Self { from: Instant::now() }
    }

    /// Returns the wall time since the start (or the last lap), and starts the next lap.
    pub fn lap(&mut self) -> Span {
        let now = Self::start();
        let taken = now.since(self);
        *self = now;
        taken
    }

    /// Returns the wall time since the start (or the last lap), which goes on.
    pub fn elapsed(&self) -> Span {
        Self::start().since(self)
    }

    fn since(&self, earlier: &Self) -> Span {
        Span::from_ns(i64::try_from((self.from - earlier.from).as_nanos()).unwrap_or(i64::MAX))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn virtual_time_moves_only_forward_and_when_asked() {
        let clock = Virtual::new(Tai::from_ns(100));
        assert_eq!(clock.now(), clock.now(), "does not move");
        clock.sleep_until(Tai::from_ns(250));
        clock.advance_to(Tai::from_ns(50));
        assert_eq!(clock.now().ns(), 250);
    }

    #[test]
    fn paired_readings_are_of_one_instant() {
        let clock = Monotonic::start();
        let (before, pair, after) = (clock.now(), PairedReading::take(&clock), clock.now());
        assert!(before <= pair.bench && pair.bench <= after, "{pair:?}");
        assert!(pair.window >= Span::ZERO && pair.window <= after - before, "{pair:?}");
        let lies = PairedReading::take(&Virtual::new(Tai::from_ns(7)));
        assert_eq!((lies.bench.ns(), lies.window), (7, Span::ZERO), "a virtual clock does not move");
        // 2020-01-01: a system clock before that was never set.
        assert!(lies.realtime_ns > 1_577_836_800_000_000_000, "the system's clock is read: {lies:?}");
    }

    #[test]
    fn monotonic_time_agrees_with_the_leap_second_table() {
        let clock = Monotonic::start();
        let a = clock.now();
        assert!(clock.now() >= a, "never goes back");
        assert!(a > Tai::from_rfc3339("2024-01-01T00:00:00Z").expect("a valid instant"), "{a}");
    }
}
