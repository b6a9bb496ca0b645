//! Remote ticks -> TAI.
//!
//! *The relation.* The flight computer has one clock, counted since its boot. TIME messages carry it as SCET (whole
//! seconds + 24-bit fraction); attitude messages carry `t_us`: the low 32 bits of the same clock in whole
//! microseconds ([`remote_ticks_us`]). Two-step SYNC + TIME_FUP gives pairs (remote time of SYNC's transmission,
//! local time of its reception).
//!
//! *Estimator.* `local - remote` is the clocks' offset plus the delay of the link; delays only add, so the smallest
//! difference over a sliding window is the best one, less a calibrated constant delay (one-way data cannot see it).
//! Error: the smallest queueing delay in the window, plus drift times the window (2 s at 20 ppm: 40 us). It answers with
//! a [`ClockEstimate`] that has room for a drift, so a hull or Kalman estimator changes nothing outside this file.
//!
//! *Lonely marks.* A pair that lies further below the window's smallest than delays and drift explain (a damaged mark: one
//! such would be believed for the whole window) is used only when two more within the window agree with it. Marks that are damaged alike as often are believed: the
//! bus's own checksum is what keeps them rare.
//!
//! *Steps.* A remote clock that jumps (reboot) restarts the window: at once when the difference shrinks by more than
//! the limit or remote time runs backwards, after three pairs when it grows (one late message is no step).

use crate::base::time::{Span, Tai};
use std::collections::VecDeque;

/// Microseconds after which `t_us` wraps: 71.6 minutes.
const WRAP_US: i64 = 1 << 32;
/// Consecutive pairs that must agree on a growing step.
const LATE_PAIRS_FOR_STEP: u32 = 3;

/// Nanoseconds of a SCET of whole seconds and a fraction in 2^-24 s (only its low 24 bits count), rounded down.
#[must_use]
pub fn scet_ns(seconds: u32, fraction_2_24: u32) -> i64 {
    let fraction = i64::from(fraction_2_24 & 0x00FF_FFFF);
    i64::from(seconds) * 1_000_000_000 + ((fraction * 1_000_000_000) >> 24)
}

/// The tick count that messages carry at a remote time: whole microseconds, modulo 2^32.
#[must_use]
pub fn remote_ticks_us(remote_ns: i64) -> u32 {
    u32::try_from(remote_ns.div_euclid(1000).rem_euclid(WRAP_US)).unwrap_or_default()
}

/// A difference may fall this far below the window's smallest, and two that agree may differ by it: at the rate of a fast
/// slew (0.5 deg/s) it is 0.2 arcsec.
const EARLY: Span = Span::from_ns(100_000);

/// Lonely pairs that a further one must agree with.
const AGREEING: usize = 2;
/// Lonely pairs that are kept.
const LONELY_MAX: usize = 16;

/// How pairs are believed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct RemoteClockLimits {
    /// Pairs older than this (by local time) leave the window.
    pub window: Span,
    /// Most pairs held.
    pub capacity: usize,
    /// Calibrated constant delay from transmission to the receive stamp.
    pub constant_delay: Span,
    /// A difference further than this from the window's smallest is a late message or a step.
    pub step: Span,
}

impl Default for RemoteClockLimits {
    /// 2 s, 64 pairs, no constant delay, steps from 250 ms.
    fn default() -> Self {
        Self { window: Span::from_ms(2000), capacity: 64, constant_delay: Span::ZERO, step: Span::from_ms(250) }
    }
}

/// What was done with a pair.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Observed {
    /// In the window.
    Used,
    /// Left out: too late to be of use.
    Late,
    /// Left out for now: earlier than can be, and no other says so yet.
    Lonely,
    /// The remote clock stepped: the window begins again with this pair.
    Restarted,
}

/// Local time of a remote time: `local = remote + offset + drift * (remote - reference)`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ClockEstimate {
    /// Local minus remote time at the reference, the constant delay taken off.
    pub offset: Span,
    /// Remote time at which the offset holds, ns.
    pub reference_remote_ns: i64,
    /// Local seconds per remote second, less one (0 with this estimator).
    pub drift: f64,
    /// Largest less smallest difference in the window: how unsteady the link's delay was.
    pub spread: Span,
    /// Pairs in the window.
    pub pairs: usize,
}

impl ClockEstimate {
    /// Local time of a remote time.
    #[must_use]
    pub fn to_tai(&self, remote_ns: i64) -> Tai {
        let since = Span::from_ns(remote_ns.saturating_sub(self.reference_remote_ns));
        Tai::from_ns(remote_ns) + self.offset + Span::from_s(self.drift * since.s())
    }

    /// Remote time, ns, of a local time.
    #[must_use]
    pub fn to_remote_ns(&self, local: Tai) -> i64 {
        let undrifted = local - self.offset;
        let since = Span::from_ns(undrifted.ns().saturating_sub(self.reference_remote_ns));
        (undrifted - Span::from_s(self.drift / (1.0 + self.drift) * since.s())).ns()
    }
}

/// The remote clock as seen through its time messages.
#[derive(Debug, Clone)]
pub struct RemoteClock {
    limits: RemoteClockLimits,
    pairs: VecDeque<Pair>,
    late_in_a_row: u32,
    /// Pairs of the window that were left out as too early.
    lonely: VecDeque<Pair>,
    lonely_count: u64,
    steps: u64,
}

#[derive(Debug, Clone, Copy)]
struct Pair {
    remote_ns: i64,
    local: Tai,
    difference_ns: i64,
}

impl RemoteClock {
    /// A clock nothing is known about yet; all memory is taken here.
    #[must_use]
    pub fn new(limits: RemoteClockLimits) -> Self {
        let limits = RemoteClockLimits { capacity: limits.capacity.max(1), ..limits };
        Self {
            limits,
            pairs: VecDeque::with_capacity(limits.capacity),
            late_in_a_row: 0,
            lonely: VecDeque::with_capacity(LONELY_MAX),
            lonely_count: 0,
            steps: 0,
        }
    }

    /// Takes one pair: remote time of SYNC's transmission (ns, from TIME_FUP's SCET), local time of its reception.
    pub fn observe(&mut self, sync_scet_ns: i64, local: Tai) -> Observed {
        let pair = Pair { remote_ns: sync_scet_ns, local, difference_ns: local.ns().saturating_sub(sync_scet_ns) };
        let outcome = self.judge(&pair);
        match outcome {
            Observed::Late => return outcome,
            Observed::Lonely => {
                if self.lonely.len() >= LONELY_MAX {
                    self.lonely.pop_front();
                }
                self.lonely.push_back(pair);
                self.lonely_count += 1;
                return outcome;
            }
            Observed::Restarted => {
                self.pairs.clear();
                self.lonely.clear();
                self.steps += 1;
            }
            Observed::Used => self.forget_before(local - self.limits.window),
        }
        self.late_in_a_row = 0;
        self.join_lonely(&pair);
        self.keep(pair);
        outcome
    }

    /// Takes in what was left out as too early and is not earlier than `pair`, which is believed.
    fn join_lonely(&mut self, pair: &Pair) {
        while let Some(place) =
            self.lonely.iter().position(|lonely| lonely.difference_ns >= pair.difference_ns - EARLY.ns())
        {
            if let Some(lonely) = self.lonely.remove(place) {
                self.keep(lonely);
            }
        }
    }

    fn keep(&mut self, pair: Pair) {
        if self.pairs.len() >= self.limits.capacity {
            self.pairs.pop_front();
        }
        let place = self.pairs.partition_point(|other| other.local <= pair.local);
        self.pairs.insert(place, pair);
    }

    fn judge(&mut self, pair: &Pair) -> Observed {
        let (Some(last), Some((smallest, _))) = (self.pairs.back(), self.extremes()) else {
            return Observed::Used;
        };
        let step_ns = self.limits.step.ns();
        let above_smallest_ns = pair.difference_ns.saturating_sub(smallest);
        if pair.remote_ns < last.remote_ns || above_smallest_ns < -step_ns {
            return Observed::Restarted;
        }
        let agrees = |lonely: &&Pair| (pair.difference_ns - lonely.difference_ns).abs() <= EARLY.ns();
        if above_smallest_ns < -EARLY.ns() && self.lonely.iter().filter(agrees).count() < AGREEING {
            return Observed::Lonely;
        }
        if above_smallest_ns <= step_ns {
            return Observed::Used;
        }
        self.late_in_a_row += 1;
        if self.late_in_a_row >= LATE_PAIRS_FOR_STEP { Observed::Restarted } else { Observed::Late }
    }

    fn forget_before(&mut self, oldest: Tai) {
        while self.pairs.front().is_some_and(|pair| pair.local < oldest) {
            self.pairs.pop_front();
        }
        self.lonely.retain(|pair| pair.local >= oldest);
    }

    /// Smallest and largest difference in the window, ns.
    fn extremes(&self) -> Option<(i64, i64)> {
        let smallest = self.pairs.iter().map(|pair| pair.difference_ns).min()?;
        let largest = self.pairs.iter().map(|pair| pair.difference_ns).max()?;
        Some((smallest, largest))
    }

    /// The present estimate; `None` before the first pair.
    #[must_use]
    pub fn estimate(&self) -> Option<ClockEstimate> {
        let (smallest, largest) = self.extremes()?;
        Some(ClockEstimate {
            offset: Span::from_ns(smallest.saturating_sub(self.limits.constant_delay.ns())),
            reference_remote_ns: self.pairs.back()?.remote_ns,
            drift: 0.0,
            spread: Span::from_ns(largest.saturating_sub(smallest)),
            pairs: self.pairs.len(),
        })
    }

    /// Pairs that were earlier than can be when they came alone.
    #[must_use]
    pub fn lonely(&self) -> u64 {
        self.lonely_count
    }

    /// Times the remote clock was found to have stepped.
    #[must_use]
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// The instant of a tick count that was taken within 35.8 minutes of `near` (the receive time); `None` before
    /// the first pair. Resolution 1 us (ticks are whole microseconds, rounded down).
    #[must_use]
    pub fn to_tai(&self, t_us: u32, near: Tai) -> Option<Tai> {
        let estimate = self.estimate()?;
        let near_us = estimate.to_remote_ns(near).div_euclid(1000);
        Some(estimate.to_tai(unwrapped_us(t_us, near_us).saturating_mul(1000)))
    }
}

/// The count nearest to `near_us` whose low 32 bits are `t_us`.
fn unwrapped_us(t_us: u32, near_us: i64) -> i64 {
    let ahead = (i64::from(t_us) - near_us.rem_euclid(WRAP_US)).rem_euclid(WRAP_US);
    let nearest = if ahead >= WRAP_US / 2 { ahead - WRAP_US } else { ahead };
    near_us.saturating_add(nearest)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const LOCAL_AT_BOOT_NS: i64 = 1_800_000_000_000_000_000;
    const SECOND_NS: i64 = 1_000_000_000;

    fn local(remote_ns: i64, delay_ns: i64) -> Tai {
        Tai::from_ns(LOCAL_AT_BOOT_NS + remote_ns + delay_ns)
    }

    fn clock_after(pairs: impl IntoIterator<Item = (i64, i64)>, limits: RemoteClockLimits) -> RemoteClock {
        let mut clock = RemoteClock::new(limits);
        for (remote_ns, delay_ns) in pairs {
            clock.observe(remote_ns, local(remote_ns, delay_ns));
        }
        clock
    }

    #[test]
    fn scet_fraction_is_2_to_the_minus_24() {
        assert_eq!(scet_ns(3, 0x0080_0000), 3_500_000_000);
        assert_eq!(scet_ns(0, 1), 59, "59.6 ns, rounded down");
        assert_eq!(scet_ns(0, 0xFF00_0000), 0, "high byte is no part of the fraction");
    }

    #[test]
    fn the_least_delayed_pair_of_the_window_counts() {
        // 40, 55 and 60 us bear each other out, and the others with them.
        let delays_us = [900, 40, 3000, 700, 55, 60];
        let pairs = (0..).zip(delays_us).map(|(i, us)| (i * 100_000_000, us * 1000));
        let limits = RemoteClockLimits { constant_delay: Span::from_ns(30_000), ..Default::default() };
        let estimate = clock_after(pairs, limits).estimate().expect("five pairs");
        assert_eq!(estimate.offset.ns(), LOCAL_AT_BOOT_NS + 40_000 - 30_000);
        assert_eq!(estimate.spread.ns(), 2_960_000);
        assert_eq!(estimate.pairs, 6);
    }

    #[test]
    fn old_pairs_leave_so_that_drift_is_followed() {
        // The remote clock loses 20 ppm: the difference grows by 20 us each second.
        let pairs = (0..600).map(|i| (i * SECOND_NS / 10, i * 2_000));
        let estimate = clock_after(pairs, RemoteClockLimits::default()).estimate().expect("pairs");
        let lag_ns = LOCAL_AT_BOOT_NS + 599 * 2_000 - estimate.offset.ns();
        assert!((0..=40_000).contains(&lag_ns), "drift times window is 40 us, got {lag_ns} ns");
    }

    #[test]
    fn ticks_unwrap_across_71_minutes() {
        let wrap_ns = (1_i64 << 32) * 1000;
        let clock = clock_after([(wrap_ns - SECOND_NS, 0)], RemoteClockLimits::default());
        for remote_ns in [wrap_ns - 2_000, wrap_ns - 1_000, wrap_ns, wrap_ns + 1_000, wrap_ns + 1_000_000] {
            let at = clock.to_tai(remote_ticks_us(remote_ns), local(wrap_ns, 0)).expect("known clock");
            assert_eq!(at, local(remote_ns, 0), "{remote_ns}");
        }
        let unaware = clock.to_tai(0, local(0, 0)).expect("known clock");
        assert_ne!(unaware, local(wrap_ns, 0), "the nearness must decide");
    }

    #[test]
    fn nothing_is_claimed_before_the_first_pair() {
        let clock = RemoteClock::new(RemoteClockLimits::default());
        assert_eq!(clock.to_tai(5, Tai::from_ns(0)), None);
        assert_eq!(clock.estimate(), None);
    }

    #[test]
    fn a_late_message_is_left_out_and_a_reboot_is_found() {
        let mut clock = clock_after((0..10).map(|i| (i * SECOND_NS / 10, 0)), RemoteClockLimits::default());
        assert_eq!(clock.observe(SECOND_NS, local(SECOND_NS, 400_000_000)), Observed::Late);
        assert_eq!(clock.estimate().expect("pairs").offset.ns(), LOCAL_AT_BOOT_NS, "unmoved");
        assert_eq!(clock.observe(0, local(2 * SECOND_NS, 0)), Observed::Restarted, "remote time ran backwards");
        assert_eq!(clock.steps(), 1);
        let jumped = clock.observe(9 * SECOND_NS, local(3 * SECOND_NS, 0));
        assert_eq!(jumped, Observed::Restarted, "remote time jumped ahead");
        let slow = [9, 10, 11].map(|s| clock.observe(s * SECOND_NS, local((s + 1) * SECOND_NS, 0)));
        assert_eq!(slow, [Observed::Late, Observed::Late, Observed::Restarted], "a growing step needs three pairs");
    }

    #[test]
    fn a_damaged_mark_is_not_believed_and_a_shorter_delay_is_with_the_third_mark_that_shows_it() {
        let mut clock = clock_after((0..10).map(|i| (i * SECOND_NS / 10, 50_000)), RemoteClockLimits::default());
        let offset_ns = |clock: &RemoteClock| clock.estimate().expect("pairs").offset.ns() - LOCAL_AT_BOOT_NS;
        // A bit of its fraction is wrong: 4 ms early.
        assert_eq!(clock.observe(SECOND_NS, local(SECOND_NS, -4_000_000)), Observed::Lonely);
        let again = clock.observe(11 * SECOND_NS / 10, local(11 * SECOND_NS / 10, -9_000_000));
        assert_eq!(again, Observed::Lonely, "another bit");
        assert_eq!((offset_ns(&clock), clock.lonely()), (50_000, 2), "unmoved, and counted");
        // The bus has become faster by 4 ms: two marks more, beside the one that happened to say so.
        let marks = [12, 13].map(|i| clock.observe(i * SECOND_NS / 10, local(i * SECOND_NS / 10, -3_990_000)));
        assert_eq!(marks, [Observed::Lonely, Observed::Used]);
        assert_eq!(offset_ns(&clock), -4_000_000);
    }

    #[test]
    fn drift_has_its_place_in_the_estimate() {
        let estimate = ClockEstimate {
            offset: Span::from_ns(100),
            reference_remote_ns: 1000,
            drift: 1e-3,
            spread: Span::ZERO,
            pairs: 2,
        };
        assert_eq!(estimate.to_tai(1000).ns(), 1100);
        assert_eq!(estimate.to_tai(1_001_000).ns(), 1_001_100 + 1000);
        assert_eq!(estimate.to_remote_ns(Tai::from_ns(1_002_100)), 1_001_000);
    }

    proptest! {
        #[test]
        fn ticks_come_back_as_the_instant_they_left(
            remote_us in 0_i64..40 * (1 << 32),
            age_us in -2_000_000_000_i64..2_000_000_000,
        ) {
            let clock = clock_after([(remote_us * 1000, 0)], RemoteClockLimits::default());
            let near = local((remote_us + age_us) * 1000, 0);
            prop_assert_eq!(clock.to_tai(remote_ticks_us(remote_us * 1000), near), Some(local(remote_us * 1000, 0)));
        }

        #[test]
        fn extreme_times_never_panic(a in any::<i64>(), b in any::<i64>(), c in any::<i64>(), t in any::<u32>()) {
            let mut clock = RemoteClock::new(RemoteClockLimits::default());
            clock.observe(a, Tai::from_ns(b));
            clock.observe(b, Tai::from_ns(c));
            let _any = clock.to_tai(t, Tai::from_ns(c));
            let _any = clock.to_tai(t, Tai::from_ns(a));
        }
    }
}
