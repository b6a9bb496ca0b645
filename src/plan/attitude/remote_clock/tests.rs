use super::*;
use base::units::NS_PER_S;
use firmware_protocol::ticks::{WRAP_US, wrapped};
use proptest::prelude::*;

const LOCAL_AT_BOOT_NS: i64 = 1_800_000_000_000_000_000;
/// A tenth of a second: the period of marks.
const TENTH_NS: i64 = NS_PER_S / 10;

fn local(remote_ns: i64, delay_ns: i64) -> Tai {
    Tai::from_ns(LOCAL_AT_BOOT_NS + remote_ns + delay_ns)
}

fn clock_after(marks: impl IntoIterator<Item = (i64, i64)>, limits: RemoteClockLimits) -> RemoteClock {
    let mut clock = RemoteClock::new(limits);
    for (remote_ns, delay_ns) in marks {
        clock.observe(remote_ns, local(remote_ns, delay_ns));
    }
    clock
}

fn ticks_of(remote_ns: i64) -> u32 {
    wrapped(remote_ns.div_euclid(1000))
}

fn offset_ns(clock: &RemoteClock) -> i64 {
    clock.estimate().expect("marks").offset.ns() - LOCAL_AT_BOOT_NS
}

#[test]
fn first_mark_gives_an_estimate_with_a_large_sigma() {
    let limits = RemoteClockLimits { constant_delay: Span::from_ns(30_000), ..Default::default() };
    let estimate = clock_after([(5 * NS_PER_S, 40_000)], limits).estimate().expect("a mark");
    assert_eq!(estimate.offset.ns(), LOCAL_AT_BOOT_NS + 40_000 - 30_000);
    assert_eq!((estimate.drift, estimate.pairs, estimate.spread), (0.0, 1, Span::ZERO));
    assert!(estimate.offset_sigma.ns() > 100_000, "a delay it cannot see: {estimate:?}");
    assert!((2e-5..1e-4).contains(&estimate.drift_sigma), "any quartz: {estimate:?}");
}

#[test]
fn the_least_delayed_marks_count() {
    // 40, 55 and 60 us confirm each other; 900 and 700 are late, and so is 3000.
    let delays_us = [900, 40, 3000, 700, 55, 60];
    let clock =
        clock_after((0..).zip(delays_us).map(|(i, us)| (i * TENTH_NS, us * 1000)), RemoteClockLimits::default());
    assert!((30_000..65_000).contains(&offset_ns(&clock)), "{} ns", offset_ns(&clock));
    assert_eq!((clock.outliers, clock.shifts), (3, 1), "700 us was early beside 900");
}

#[test]
fn drift_is_followed_and_carries_on() {
    // The remote clock loses 20 ppm: the difference grows by 20 us each second.
    let clock = clock_after((0..600).map(|i| (i * TENTH_NS, i * 2_000)), RemoteClockLimits::default());
    let estimate = clock.estimate().expect("marks");
    assert!((estimate.drift - 20e-6).abs() < 1e-9, "{estimate:?}");
    assert!((offset_ns(&clock) - 599 * 2_000).abs() < 100, "{estimate:?}");
    let minute_later_ns = 120 * NS_PER_S;
    let error_ns = (estimate.to_tai(minute_later_ns) - local(minute_later_ns, 120 * 20_000)).ns();
    assert!(error_ns.abs() < 200, "{error_ns} ns");
    assert!(estimate.sigma_at(minute_later_ns) > estimate.offset_sigma);
}

#[test]
fn ticks_unwrap_across_71_minutes() {
    let wrap_ns = WRAP_US * 1000;
    let clock = clock_after([(wrap_ns - NS_PER_S, 0)], RemoteClockLimits::default());
    for remote_ns in [wrap_ns - 2_000, wrap_ns - 1_000, wrap_ns, wrap_ns + 1_000, wrap_ns + 1_000_000] {
        let at = clock.to_tai(ticks_of(remote_ns), local(wrap_ns, 0)).expect("known clock");
        assert_eq!(at, local(remote_ns, 0), "{remote_ns}");
    }
    let unaware = clock.to_tai(0, local(0, 0)).expect("known clock");
    assert_ne!(unaware, local(wrap_ns, 0), "the nearness must decide");
}

#[test]
fn no_estimate_exists_before_the_first_mark() {
    let clock = RemoteClock::new(RemoteClockLimits::default());
    assert_eq!(clock.to_tai(5, Tai::from_ns(0)), None);
    assert_eq!(clock.estimate(), None);
}

#[test]
fn a_late_message_is_left_out_and_a_reboot_is_found() {
    let mut clock = clock_after((0..10).map(|i| (i * TENTH_NS, 0)), RemoteClockLimits::default());
    let before_ns = offset_ns(&clock);
    assert_eq!(clock.observe(NS_PER_S, local(NS_PER_S, 400_000_000)), Observed::Late);
    assert_eq!(offset_ns(&clock), before_ns, "unmoved");
    assert_eq!(clock.observe(0, local(2 * NS_PER_S, 0)), Observed::Restarted, "remote time ran backwards");
    assert_eq!(clock.steps, 1);
    let jumped = clock.observe(9 * NS_PER_S, local(3 * NS_PER_S, 0));
    assert_eq!(jumped, Observed::Restarted, "remote time jumped ahead");
    let slow = [9, 10, 11].map(|s| clock.observe(s * NS_PER_S, local((s + 1) * NS_PER_S, 0)));
    assert_eq!(slow, [Observed::Late, Observed::Late, Observed::Restarted], "a growing step needs three marks");
    assert_eq!((clock.pairs, clock.late, clock.outliers), (13, 3, 0), "counted since the start, over all steps");
}

#[test]
fn a_damaged_mark_is_not_believed_and_a_shorter_delay_is_with_the_third_mark_that_shows_it() {
    let mut clock = clock_after((0..10).map(|i| (i * TENTH_NS, 50_000)), RemoteClockLimits::default());
    let before_ns = offset_ns(&clock);
    assert!((before_ns - 50_000).abs() < 100, "{before_ns}");
    // A bit of its fraction is wrong: 4 ms early.
    assert_eq!(clock.observe(NS_PER_S, local(NS_PER_S, -4_000_000)), Observed::Outlier);
    let again = clock.observe(11 * TENTH_NS, local(11 * TENTH_NS, -9_000_000));
    assert_eq!(again, Observed::Outlier, "another bit");
    assert_eq!((offset_ns(&clock), clock.outliers), (before_ns, 2), "unmoved, and counted");
    // The bus has become faster by 4 ms: two more marks agree with the first one.
    let marks = [12, 13].map(|i| clock.observe(i * TENTH_NS, local(i * TENTH_NS, -3_990_000)));
    assert_eq!(marks, [Observed::Outlier, Observed::Used]);
    assert!((offset_ns(&clock) + 3_995_000).abs() <= 10_000, "{}", offset_ns(&clock));
    assert_eq!((clock.shifts, clock.steps), (1, 0));
}

#[test]
fn outliers_far_apart_do_not_support_each_other() {
    let mut clock = clock_after((0..100).map(|i| (i * TENTH_NS, 50_000)), RemoteClockLimits::default());
    for i in 100..400 {
        let is_damaged = i % 20 == 0;
        let outcome = clock.observe(i * TENTH_NS, local(i * TENTH_NS, if is_damaged { 0 } else { 50_000 }));
        assert_eq!(outcome == Observed::Outlier, is_damaged, "mark {i}");
    }
    assert!((offset_ns(&clock) - 50_000).abs() < 100, "{}", offset_ns(&clock));
}

proptest! {
    #[test]
    fn ticks_come_back_as_the_instant_they_left(
        remote_us in 0_i64..40 * WRAP_US,
        age_us in -2_000_000_000_i64..2_000_000_000,
    ) {
        let clock = clock_after([(remote_us * 1000, 0)], RemoteClockLimits::default());
        let near = local((remote_us + age_us) * 1000, 0);
        prop_assert_eq!(clock.to_tai(ticks_of(remote_us * 1000), near), Some(local(remote_us * 1000, 0)));
    }

    #[test]
    fn extreme_times_never_panic(
        marks in proptest::collection::vec((any::<i64>(), any::<i64>()), 1..40),
        near_marks in proptest::collection::vec((0_i64..4_000_000_000, -400_000_000_i64..400_000_000), 1..200),
        t in any::<u32>(),
    ) {
        let mut clock = RemoteClock::new(RemoteClockLimits::default());
        for (i, (remote_ns, difference_ns)) in near_marks.into_iter().enumerate() {
            let remote_ns = remote_ns + i as i64 * TENTH_NS;
            clock.observe(remote_ns, local(remote_ns, difference_ns));
            clock.observe_pps(local(remote_ns, 0));
        }
        for (remote_ns, local_ns) in marks {
            clock.observe(remote_ns, Tai::from_ns(local_ns));
            clock.observe_pps(Tai::from_ns(local_ns));
            let _any = clock.to_tai(t, Tai::from_ns(local_ns));
            let estimate = clock.estimate().expect("marks");
            prop_assert!(estimate.drift.is_finite() && estimate.drift.abs() <= 200e-6 + 1e-12, "{:?}", estimate);
            prop_assert!(estimate.offset_sigma.ns() >= 0 && estimate.drift_sigma.is_finite(), "{:?}", estimate);
        }
    }
}
