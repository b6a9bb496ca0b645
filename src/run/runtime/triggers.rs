//! Numbered triggers of the flight computer: accepted, kept until their instants, and returned in order of time.
//!
//! In: TRIGGER commands, stamped, and the estimate of the flight computer's clock. Out: [`FiredTrigger`]s, each once,
//! or a refusal with its reason. An instant is sent modulo 71.6 minutes: it is taken as ahead by up to an hour, or as
//! past by up to five minutes (then it acts on arrival); otherwise it is refused. A number for which no fault or event
//! of the run waits is refused first. Waiting triggers follow the clock's estimate and its steps; when the clock
//! restarts they are discarded, because their instants are meaningless on it. The capacity is fixed; nothing is
//! allocated after the start. Other modules decide what a trigger does. Tests: below, and
//! `tests/closed_loop/triggers.rs`.

use base::time::{Span, Tai};
use firmware_protocol::message::{Refusal, Trigger, Triggered};
use firmware_protocol::ticks::{WRAP_US, ticks_ahead, wrapped};
use plan::attitude::ClockEstimate;
use std::collections::VecDeque;

/// Capacity for waiting triggers.
pub const PLACES: usize = 64;
/// Largest time from a trigger's arrival to its instant.
pub const MOST_AHEAD: Span = Span::from_ms(3_600_000);
/// Largest time by which an instant may have passed.
pub const MOST_LATE: Span = Span::from_ms(300_000);

/// A trigger whose instant has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FiredTrigger {
    /// Trigger number.
    pub number: u16,
    /// When it acts: its instant, or its arrival when it acts at once or came late.
    pub at: Tai,
}

/// Counts of triggers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct TriggerCounts {
    /// Accepted triggers.
    pub accepted: u64,
    /// Accepted triggers whose instant was already past.
    pub late: u64,
    /// Triggers repeated with the same token: answered, not fired twice.
    pub repeated: u64,
    /// Refused triggers.
    pub refused: u64,
    /// Accepted triggers discarded before their instant: at a STOP, or because the clock restarted or stepped out of
    /// range.
    pub forgotten: u64,
    /// Triggers returned.
    pub fired: u64,
}

/// A trigger that has just been accepted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Taken {
    /// Number of the trigger, and whether its instant was already past.
    pub triggered: Triggered,
    /// Time from its arrival to its instant; negative when the instant was already past.
    pub ahead: Span,
}

/// A trigger that waits.
#[derive(Debug, Clone, Copy)]
struct Waiting {
    fired: FiredTrigger,
    /// Number of triggers accepted before it.
    order: u64,
    /// Its instant in the flight computer's time, ns; `None` when it acts on arrival.
    remote_ns: Option<i64>,
}

/// The triggers of one flight computer.
#[derive(Debug, Clone)]
pub struct Triggers {
    /// Waiting triggers by rising time; those of one instant in order of arrival.
    waiting: VecDeque<Waiting>,
    /// Numbers for which faults or events of the run wait, rising.
    expected: Vec<u16>,
    counts: TriggerCounts,
}

impl Default for Triggers {
    fn default() -> Self {
        Self { waiting: VecDeque::with_capacity(PLACES), expected: Vec::new(), counts: TriggerCounts::default() }
    }
}

impl Triggers {
    /// Returns the empty triggers of another head of the same run.
    pub(super) fn beside(&self) -> Self {
        Self { expected: self.expected.clone(), ..Self::default() }
    }

    /// Accepts triggers of this number from now on, because a fault or an event of the run waits for it. Allocates.
    pub fn expect(&mut self, number: u16) {
        if let Err(place) = self.expected.binary_search(&number) {
            self.expected.insert(place, number);
        }
    }

    /// Accepts a trigger that arrived at `at`.
    ///
    /// # Errors
    /// When its number is unexpected, the queue is full, no time is known yet, or the instant is too far away.
    pub fn take(&mut self, trigger: Trigger, clock: Option<&ClockEstimate>, at: Tai) -> Result<Taken, Refusal> {
        let taken = self.dated(trigger, clock, at).and_then(|(waiting, ahead)| {
            self.put(waiting)?;
            Ok(Taken { triggered: Triggered { number: trigger.number, is_late: ahead < Span::ZERO }, ahead })
        });
        match taken {
            Ok(taken) => {
                self.counts.accepted += 1;
                self.counts.late += u64::from(taken.triggered.is_late);
            }
            Err(_) => self.counts.refused += 1,
        }
        taken
    }

    /// Returns a trigger with its instant, and the time from its arrival to that instant.
    fn dated(&self, trigger: Trigger, clock: Option<&ClockEstimate>, at: Tai) -> Result<(Waiting, Span), Refusal> {
        if self.expected.binary_search(&trigger.number).is_err() {
            return Err(Refusal::UnknownTrigger);
        }
        let order = self.counts.accepted;
        let Instant { at, ahead, remote_ns } = instant_of(trigger.at_us, clock, at)?;
        Ok((Waiting { fired: FiredTrigger { number: trigger.number, at }, order, remote_ns }, ahead))
    }

    fn put(&mut self, waiting: Waiting) -> Result<(), Refusal> {
        if self.waiting.len() >= PLACES {
            return Err(Refusal::TriggersFull);
        }
        let place = self.waiting.partition_point(|other| other.fired.at <= waiting.fired.at);
        self.waiting.insert(place, waiting);
        Ok(())
    }

    /// Moves the triggers that wait for an instant to their places under a new estimate of the clock.
    pub fn follow_clock(&mut self, clock: &ClockEstimate) {
        self.place_by(|remote_ns| clock.to_tai(remote_ns));
    }

    fn place_by(&mut self, instant_of: impl Fn(i64) -> Tai) {
        for waiting in &mut self.waiting {
            if let Some(remote_ns) = waiting.remote_ns {
                waiting.fired.at = instant_of(remote_ns);
            }
        }
        self.waiting.make_contiguous().sort_unstable_by_key(|waiting| (waiting.fired.at, waiting.order));
    }

    /// Moves the triggers that wait for an instant after a step of the clock; those whose instant has passed act at
    /// once. Returns how many are discarded because their instant is now too far ahead.
    pub fn follow_step(&mut self, clock: &ClockEstimate, now: Tai) -> u64 {
        self.place_by(|remote_ns| clock.to_tai(remote_ns).max(now));
        self.forget_where(|waiting| waiting.fired.at > now + MOST_AHEAD)
    }

    /// Discards the triggers that wait for an instant of the flight computer's clock; returns how many there were.
    pub fn forget_dated(&mut self) -> u64 {
        self.forget_where(|waiting| waiting.remote_ns.is_some())
    }

    fn forget_where(&mut self, is_forgotten: impl Fn(&Waiting) -> bool) -> u64 {
        let before = self.waiting.len();
        self.waiting.retain(|waiting| !is_forgotten(waiting));
        let forgotten = (before - self.waiting.len()) as u64;
        self.counts.forgotten += forgotten;
        forgotten
    }

    /// Counts a repeat that was answered from memory.
    pub fn count_repeat(&mut self) {
        self.counts.repeated += 1;
    }

    /// Discards the waiting triggers; returns how many there were.
    pub fn forget(&mut self) -> u64 {
        self.forget_where(|_all| true)
    }

    /// Returns the next trigger that acts at or before `up_to`.
    pub fn next(&mut self, up_to: Tai) -> Option<FiredTrigger> {
        self.waiting.front().filter(|waiting| waiting.fired.at <= up_to)?;
        self.counts.fired += 1;
        self.waiting.pop_front().map(|waiting| waiting.fired)
    }

    /// Returns the number of waiting triggers.
    pub fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// Returns the counts so far.
    pub fn counts(&self) -> TriggerCounts {
        self.counts
    }
}

/// Time at which a command acts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Instant {
    /// Its instant, or its arrival when it acts at once or came late.
    pub(super) at: Tai,
    /// Time from its arrival to its instant; negative when the instant was already past.
    pub(super) ahead: Span,
    /// Its instant in the flight computer's time, ns; `None` when it acts on arrival.
    pub(super) remote_ns: Option<i64>,
}

/// Returns the instant of a command that arrived at `at` and carries `at_us`, microseconds of the flight computer's
/// clock, 0 for at once.
///
/// # Errors
/// When no time is known yet, or the instant is too far away.
pub(super) fn instant_of(at_us: u32, clock: Option<&ClockEstimate>, at: Tai) -> Result<Instant, Refusal> {
    if at_us == 0 {
        return Ok(Instant { at, ahead: Span::ZERO, remote_ns: None });
    }
    let clock = clock.ok_or(Refusal::NoTimeYet)?;
    let now_us = clock.to_remote_ns(at).div_euclid(1000);
    let ahead_us = i64::from(ticks_ahead(at_us, wrapped(now_us)));
    if ahead_us <= MOST_AHEAD.ns() / 1000 {
        let remote_ns = now_us.saturating_add(ahead_us).saturating_mul(1000);
        let instant = clock.to_tai(remote_ns).max(at);
        return Ok(Instant { at: instant, ahead: instant - at, remote_ns: Some(remote_ns) });
    }
    let ahead = Span::from_ns((ahead_us - WRAP_US) * 1000);
    let is_near = ahead.ns() >= -MOST_LATE.ns();
    if is_near { Ok(Instant { at, ahead, remote_ns: None }) } else { Err(Refusal::TriggerTime) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::units::NS_PER_S;

    fn at_s(s: i64) -> Tai {
        Tai::from_ns(s * NS_PER_S)
    }

    /// Returns the flight computer's clock at 4000 s of its own when it is 10 000 s here, and the same rate.
    fn clock() -> ClockEstimate {
        clock_behind(6000 * NS_PER_S)
    }

    fn clock_behind(offset_ns: i64) -> ClockEstimate {
        ClockEstimate {
            offset: Span::from_ns(offset_ns),
            reference_remote_ns: 0,
            drift: 0.0,
            offset_sigma: Span::ZERO,
            drift_sigma: 0.0,
            drift_walk_per_s: 0.0,
            residual: Span::ZERO,
            spread: Span::ZERO,
            pairs: 1,
        }
    }

    /// Returns the triggers of a run with a fault for every number that these tests use.
    fn expecting_all() -> Triggers {
        let mut triggers = Triggers::default();
        (0..100).for_each(|number| triggers.expect(number));
        triggers
    }

    fn trigger(number: u16, at_us: u32) -> Trigger {
        Trigger { number, at_us }
    }

    fn take(triggers: &mut Triggers, number: u16, at_us: u32) -> Result<Taken, Refusal> {
        triggers.take(trigger(number, at_us), Some(&clock()), at_s(10_000))
    }

    fn fired(triggers: &mut Triggers, up_to: Tai) -> Vec<(u16, Tai)> {
        core::iter::from_fn(|| triggers.next(up_to)).map(|fired| (fired.number, fired.at)).collect()
    }

    #[test]
    fn triggers_come_out_once_in_order_of_time_and_not_before() {
        let mut triggers = expecting_all();
        for (number, at_us) in [(1, 4_003_000_000), (2, 4_001_000_000), (3, 0), (4, 4_001_000_000)] {
            take(&mut triggers, number, at_us).unwrap();
        }
        assert_eq!(fired(&mut triggers, at_s(9_999)), []);
        assert_eq!(fired(&mut triggers, at_s(10_000)), [(3, at_s(10_000))], "at once is when it came");
        assert_eq!(fired(&mut triggers, at_s(10_001) - Span::from_ns(1)), []);
        assert_eq!(fired(&mut triggers, at_s(10_001)), [(2, at_s(10_001)), (4, at_s(10_001))], "as they came");
        assert_eq!(fired(&mut triggers, at_s(20_000)), [(1, at_s(10_003))]);
        let counts = triggers.counts();
        assert_eq!((counts.accepted, counts.fired, counts.late, triggers.waiting()), (4, 4, 0, 0));
    }

    /// Tests both sides of each limit in the flight computer's microseconds; its clock reads 4000 s.
    #[test]
    fn instants_are_ahead_late_or_refused() {
        let now = 4_000_000_000_i64;
        let tag = |ahead_us: i64| wrapped(now + ahead_us);
        for (ahead_us, wanted) in [
            (0, Ok(false)),
            (-1, Ok(true)),
            (3_600_000_000, Ok(false)),
            (3_600_000_001, Err(Refusal::TriggerTime)),
            (-300_000_000, Ok(true)),
            (-300_000_001, Err(Refusal::TriggerTime)),
        ] {
            let mut triggers = expecting_all();
            let got = take(&mut triggers, 5, tag(ahead_us));
            assert_eq!(got.map(|taken| taken.triggered.is_late), wanted, "{ahead_us} us ahead");
            assert_eq!(got.is_ok_and(|taken| taken.ahead.ns() == 1000 * ahead_us), got.is_ok(), "{got:?}");
            let acts = at_s(10_000) + Span::from_ns(1000 * ahead_us.max(0));
            let wanted = if got.is_ok() { vec![(5, acts)] } else { vec![] };
            assert_eq!(fired(&mut triggers, at_s(20_000)), wanted, "{ahead_us} us ahead");
            let counts = triggers.counts();
            assert_eq!((counts.late, counts.refused), (u64::from(wanted_late(got)), u64::from(got.is_err())));
        }
    }

    fn wanted_late(got: Result<Taken, Refusal>) -> bool {
        got.is_ok_and(|taken| taken.triggered.is_late)
    }

    #[test]
    fn an_instant_needs_a_clock_and_at_once_does_not() {
        let mut triggers = expecting_all();
        assert_eq!(triggers.take(trigger(1, 7), None, at_s(1)), Err(Refusal::NoTimeYet));
        assert!(triggers.take(trigger(2, 0), None, at_s(1)).is_ok());
        assert_eq!(fired(&mut triggers, at_s(1)), [(2, at_s(1))]);
    }

    #[test]
    fn the_place_after_the_last_is_refused_and_a_stop_frees_all() {
        let mut triggers = expecting_all();
        let places = u16::try_from(PLACES).unwrap();
        assert!((0..places).all(|number| take(&mut triggers, number, 4_001_000_000).is_ok()));
        assert_eq!(take(&mut triggers, 99, 0), Err(Refusal::TriggersFull));
        assert_eq!((triggers.forget(), triggers.counts().forgotten), (64, 64));
        assert!(take(&mut triggers, 99, 0).is_ok());
        assert_eq!(fired(&mut triggers, at_s(20_000)), [(99, at_s(10_000))]);
    }

    #[test]
    fn waiting_triggers_follow_the_clock_and_keep_their_order() {
        let mut triggers = expecting_all();
        for (number, at_us) in [(1, 4_010_000_000), (2, 4_010_000_000), (3, 0), (4, 4_020_000_000)] {
            take(&mut triggers, number, at_us).unwrap();
        }
        // The mark took a millisecond less to arrive than assumed.
        triggers.follow_clock(&clock_behind(6000 * NS_PER_S - 1_000_000));
        let early = Span::from_ms(1);
        let wanted =
            [(3, at_s(10_000)), (1, at_s(10_010) - early), (2, at_s(10_010) - early), (4, at_s(10_020) - early)];
        assert_eq!(fired(&mut triggers, at_s(20_000)), wanted);
    }

    #[test]
    fn number_that_nothing_waits_for_is_refused_and_counted() {
        let mut triggers = Triggers::default();
        triggers.expect(7);
        triggers.expect(7);
        for (number, at_us) in [(6, 0), (8, 4_001_000_000), (0, 0), (u16::MAX, 0)] {
            assert_eq!(take(&mut triggers, number, at_us), Err(Refusal::UnknownTrigger), "{number}");
        }
        assert!(take(&mut triggers, 7, 0).is_ok());
        assert_eq!(fired(&mut triggers, at_s(20_000)), [(7, at_s(10_000))]);
        assert_eq!((triggers.counts().refused, triggers.counts().accepted), (4, 1));
    }

    #[test]
    fn triggers_follow_a_step_and_act_at_once_where_their_instant_has_passed() {
        let mut triggers = expecting_all();
        for (number, at_us) in [(1, 4_010_000_000), (2, 4_100_000_000), (3, 0)] {
            take(&mut triggers, number, at_us).unwrap();
        }
        // The flight computer's clock is set 60 s ahead at 10 005 s here: it reads 4065 s.
        assert_eq!(triggers.follow_step(&clock_behind(5940 * NS_PER_S), at_s(10_005)), 0);
        assert_eq!(fired(&mut triggers, at_s(10_039)), [(3, at_s(10_000)), (1, at_s(10_005))]);
        assert_eq!(fired(&mut triggers, at_s(10_040)), [(2, at_s(10_040))]);
    }

    #[test]
    fn triggers_leave_a_clock_on_which_they_are_out_of_reach() {
        let mut triggers = expecting_all();
        for (number, at_us) in [(1, 4_010_000_000), (2, 0)] {
            take(&mut triggers, number, at_us).unwrap();
        }
        // It is set back by 3595 s: the first one's instant is an hour and 5 s ahead.
        assert_eq!(triggers.follow_step(&clock_behind(9595 * NS_PER_S), at_s(10_000)), 1);
        assert_eq!((triggers.waiting(), triggers.counts().forgotten), (1, 1));
        take(&mut triggers, 4, 4_010_000_000).unwrap();
        assert_eq!((triggers.forget_dated(), triggers.counts().forgotten), (1, 2), "after a restart");
        assert_eq!(fired(&mut triggers, at_s(20_000)), [(2, at_s(10_000))], "what acts as it came stays");
    }
}
