//! Pulses per second beside the bus.

use super::link::{Bench, CONSTANT_DELAY, Link, quantile};
use super::{CONVERGED_S, QUIET};
use base::time::{Span, Tai};
use plan::attitude::{ObservedPps, RemoteClock, RemoteClockLimits};

/// Returns the local time at which the remote clock reads the second that comes next, by small steps of the truth.
fn edge_after(bench: &mut Bench, at_s: f64) -> Tai {
    bench.advance_to(at_s);
    let (remote_ns, local) = bench.truth();
    let left_ns = 1_000_000_000 - remote_ns.rem_euclid(1_000_000_000);
    // 20 ppm of at most a second, and what the clock wanders in it (1 ns).
    local + Span::from_s(left_ns as f64 * 1e-9 / (1.0 + 20e-6))
}

#[test]
fn pulses_take_over_and_show_the_bus_delay() {
    let (mut errors, mut without_errors) = (Vec::new(), Vec::new());
    for seed in 0..5 {
        let mut bench = Bench::new(seed, QUIET, Link::USUAL);
        // The bus is not calibrated.
        let mut clock = RemoteClock::new(RemoteClockLimits::default());
        let mut marks_only = clock.clone();
        for i in 0..2000_u32 {
            let at_s = f64::from(i) / 10.0;
            let (remote_ns, local) = bench.mark(at_s);
            clock.observe(remote_ns, local);
            marks_only.observe(remote_ns, local);
            if i % 10 == 5 {
                let stamped = edge_after(&mut bench, at_s) + Span::from_ns((500.0 * bench.dice.normal()) as i64);
                assert_eq!(clock.observe_pps(stamped), ObservedPps::Used, "seed {seed}, mark {i}");
            }
            bench.advance_to(at_s + 0.05);
            if at_s > CONVERGED_S {
                let (remote_ns, truth) = bench.truth();
                let error_of = |clock: &RemoteClock| {
                    ((clock.estimate().expect("marks").to_tai(remote_ns) - truth).ns() as f64).abs()
                };
                errors.push(error_of(&clock));
                without_errors.push(error_of(&marks_only));
            }
        }
        let measured = clock.measured_delay().expect("pulses");
        let error_ns = (measured.delay.ns() - CONSTANT_DELAY.ns()).abs();
        assert!(error_ns < 1500, "seed {seed}: {error_ns} ns, sigma {} ns", measured.sigma.ns());
        assert!((50..2000).contains(&measured.sigma.ns()), "{measured:?}");
        // The pulses stop: their delay stays, and nothing jumps.
        for i in 2000..2300_u32 {
            let (remote_ns, local) = bench.mark(f64::from(i) / 10.0);
            clock.observe(remote_ns, local);
        }
        let (remote_ns, truth) = bench.truth();
        let after_ns = (clock.estimate().expect("marks").to_tai(remote_ns) - truth).ns();
        assert!(after_ns.abs() < 3000, "seed {seed}, after the pulses: {after_ns} ns");
    }
    let p99 = quantile(&mut errors, 0.99);
    println!("with pulses: 99 % of errors below {:.2} us", p99 * 1e-3);
    assert!(p99 < 1500.0, "{p99}");
    assert!(quantile(&mut without_errors, 0.5) > 290_000.0, "without pulses the delay is not seen");
}

#[test]
fn pulses_that_name_no_second_or_the_wrong_place_are_left_out() {
    let mut bench = Bench::new(3, QUIET, Link::USUAL);
    let mut clock = RemoteClock::new(RemoteClockLimits::default());
    assert_eq!(clock.observe_pps(Tai::from_ns(0)), ObservedPps::NoTimeYet);
    let (remote_ns, local) = bench.mark(0.0);
    clock.observe(remote_ns, local);
    let edge = edge_after(&mut bench, 0.1);
    assert_eq!(clock.observe_pps(edge + Span::from_ms(300)), ObservedPps::Ambiguous);
    assert_eq!(clock.observe_pps(edge + Span::from_ms(700)), ObservedPps::Ambiguous);
    assert_eq!(clock.observe_pps(edge), ObservedPps::Used);
    let next = edge_after(&mut bench, 1.1);
    assert_eq!(clock.observe_pps(next), ObservedPps::Used);
    let third = edge_after(&mut bench, 2.1);
    assert_eq!(clock.observe_pps(third + Span::from_ms(5)), ObservedPps::Odd, "a glitch");
    let fourth = edge_after(&mut bench, 3.1);
    assert_eq!(clock.observe_pps(fourth), ObservedPps::Used);
}
