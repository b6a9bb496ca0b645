//! The kernel's receive time (CLOCK_REALTIME) -> the bench clock, whatever CLOCK_REALTIME does meanwhile.
//!
//! `at = bench_now - (realtime_now - stamp)`, with both clocks read together when the packet is fetched: only the time
//! that the packet lay in the queue is measured by CLOCK_REALTIME, not the time since the start. Error: half the window
//! of the paired reading and the slewing of CLOCK_REALTIME (at most 500 ppm) over that time.
//!
//! A step of CLOCK_REALTIME is seen as a jump of its distance from the bench clock between two readings. Packets
//! stamped before the step may still lie in the queue, so until it has been empty once every packet gets the instant of
//! its reading instead. Steps smaller than [`STEP_MIN`] look like slewing and pass into the stamps. The unit tests give
//! the readings as arguments.

use base::clock::PairedReading;
use base::time::{Span, Tai};
use nix::sys::time::TimeSpec;

/// A packet that seems to have waited longer than this has an impossible stamp.
const AGE_MAX: Span = Span::from_ms(60_000);
/// A jump between two readings up to this is their own uncertainty.
const STEP_MIN: Span = Span::from_ms(1);
/// The kernel slews CLOCK_REALTIME by at most 500 ppm (adjtimex) and ticks by 10 % in theory; up to 1000 ppm counts as
/// slewing.
const SLEW_PPM: i64 = 1000;

/// Puts stamps of one queue on the bench clock.
#[derive(Debug)]
pub(super) struct StampMap {
    last: PairedReading,
    distrust: bool,
    latest: Tai,
}

/// A stamp on the bench clock.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Placed {
    /// When it was received.
    pub(super) at: Tai,
    /// False when the stamp was missing or impossible and `at` is the instant of reading.
    pub(super) is_kernels: bool,
}

impl StampMap {
    /// Returns a map for a queue that was empty at `now`.
    pub(super) fn new(now: PairedReading) -> Self {
        Self { last: now, distrust: false, latest: Tai::from_ns(i64::MIN) }
    }

    /// Records that the queue is empty: later packets are stamped after any step seen so far.
    pub(super) fn drained(&mut self) {
        self.distrust = false;
    }

    /// Returns the instant of a stamp (CLOCK_REALTIME, ns) read at `now`. Never later than `now`, never earlier than
    /// the stamp before it: a queue keeps the order.
    pub(super) fn place(&mut self, stamp_ns: Option<i64>, now: PairedReading) -> Placed {
        self.distrust |= self.steps_before(now);
        self.last = now;
        let at = stamp_ns.filter(|_| !self.distrust).and_then(|stamp_ns| placed(stamp_ns, now));
        self.latest = at.unwrap_or(now.bench).max(self.latest);
        Placed { at: self.latest, is_kernels: at.is_some() }
    }

    /// Returns whether CLOCK_REALTIME jumped since the last reading.
    fn steps_before(&self, now: PairedReading) -> bool {
        let bench = now.bench - self.last.bench;
        let realtime_ns = now.realtime_ns.saturating_sub(self.last.realtime_ns);
        let allowed = bench.ns() / (1_000_000 / SLEW_PPM) + STEP_MIN.ns() + now.window.ns() + self.last.window.ns();
        realtime_ns.saturating_sub(bench.ns()).saturating_abs() > allowed
    }
}

/// Returns a stamp of the kernel, ns; all zero means that none was taken.
pub(super) fn nonzero_ns(stamp: TimeSpec) -> Option<i64> {
    let ns = stamp.tv_sec().checked_mul(1_000_000_000)?.checked_add(stamp.tv_nsec())?;
    (ns != 0).then_some(ns)
}

/// Places a stamp on the bench clock; `None` when its age is impossible. An age below zero within the window of the
/// reading is zero.
fn placed(stamp_ns: i64, now: PairedReading) -> Option<Tai> {
    let age = Span::from_ns(now.realtime_ns.saturating_sub(stamp_ns));
    let possible = age.ns() >= -now.window.ns() && age <= AGE_MAX;
    possible.then(|| now.bench - age.max(Span::ZERO))
}

#[cfg(test)]
mod tests {
    use super::*;

    const WINDOW: Span = Span::from_ns(400);

    /// Returns a reading at `bench_ns` while CLOCK_REALTIME is `offset_ns` ahead of the bench clock.
    fn reading(bench_ns: i64, offset_ns: i64) -> PairedReading {
        PairedReading { bench: Tai::from_ns(bench_ns), realtime_ns: bench_ns + offset_ns, window: WINDOW }
    }

    fn kernels(ns: i64) -> Placed {
        Placed { at: Tai::from_ns(ns), is_kernels: true }
    }

    fn when_read(ns: i64) -> Placed {
        Placed { at: Tai::from_ns(ns), is_kernels: false }
    }

    const UTC: i64 = 1_700_000_000_000_000_000;

    #[test]
    fn a_stamp_lies_its_age_before_the_reading() {
        let mut map = StampMap::new(reading(0, UTC));
        assert_eq!(map.place(Some(UTC + 1_000), reading(5_000, UTC)), kernels(1_000));
        assert_eq!(map.place(Some(UTC + 7_000), reading(7_000, UTC)), kernels(7_000), "no age at all");
        assert_eq!(map.place(None, reading(9_000, UTC)), when_read(9_000), "no stamp");
    }

    #[test]
    fn both_ends_of_a_possible_age() {
        let place = |stamp_ns, now| StampMap::new(now).place(Some(stamp_ns), now);
        let now = reading(200_000_000_000, UTC);
        let stamp = now.realtime_ns;
        assert_eq!(place(stamp + WINDOW.ns(), now), kernels(now.bench.ns()), "the reading's own uncertainty");
        assert_eq!(place(stamp + WINDOW.ns() + 1, now), when_read(now.bench.ns()), "from the future");
        assert_eq!(place(stamp - AGE_MAX.ns(), now), kernels(now.bench.ns() - AGE_MAX.ns()));
        assert_eq!(place(stamp - AGE_MAX.ns() - 1, now), when_read(now.bench.ns()), "too old");
        assert_eq!(place(i64::MIN, now), when_read(now.bench.ns()), "no overflow");
    }

    #[test]
    fn stamps_never_go_back() {
        let mut map = StampMap::new(reading(0, UTC));
        assert_eq!(map.place(Some(UTC + 3_000), reading(5_000, UTC)), kernels(3_000));
        assert_eq!(map.place(Some(UTC + 2_999), reading(6_000, UTC)), kernels(3_000), "1 ns of disorder");
    }

    #[test]
    fn a_step_either_way_distrusts_the_queue_until_it_was_empty() {
        for step_ns in [-3_600_000_000_000, -3_000_000, 3_000_000, 3_600_000_000_000] {
            let mut map = StampMap::new(reading(0, UTC));
            assert_eq!(map.place(Some(UTC + 1_000_000), reading(2_000_000, UTC)), kernels(1_000_000));
            // Three packets arrive, CLOCK_REALTIME steps, the packets are read, a fourth arrives and is read.
            let after = UTC + step_ns;
            for (stamp_ns, read_ns) in [(3_000_000, 6_000_000), (4_000_000, 6_100_000), (5_000_000, 6_200_000)] {
                let placed = map.place(Some(UTC + stamp_ns), reading(read_ns, after));
                assert_eq!(placed, when_read(read_ns), "step of {step_ns} ns");
            }
            map.drained();
            assert_eq!(map.place(Some(after + 8_000_000), reading(9_000_000, after)), kernels(8_000_000));
        }
    }

    #[test]
    fn slewing_is_accepted_and_a_jump_beyond_it_is_a_step() {
        // 100 ppm over 100 s: the distance changes by 10 ms; a queue that is never empty.
        let mut map = StampMap::new(reading(0, UTC));
        for second in 1..=100 {
            let now = reading(second * 1_000_000_000, UTC + second * 100_000);
            assert_eq!(map.place(Some(now.realtime_ns - 1_000), now), kernels(now.bench.ns() - 1_000), "{second} s");
        }
        let allowed = |bench_ns: i64| bench_ns / 1000 + STEP_MIN.ns() + 2 * WINDOW.ns();
        for (jump_ns, is_kernels) in [(allowed(1_000_000), true), (allowed(1_000_000) + 1, false)] {
            let mut map = StampMap::new(reading(0, UTC));
            let now = reading(1_000_000, UTC + jump_ns);
            assert_eq!(map.place(Some(now.realtime_ns), now).is_kernels, is_kernels, "{jump_ns} ns");
        }
    }
}
