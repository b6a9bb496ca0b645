//! Time correlation against simulated clocks and links, beside estimators written afresh.
//!
//! The remote oscillator is 20 ppm fast and its frequency a random walk (Allan deviation at 1 s stated). The link has
//! 300 us of constant delay (calibrated), queueing of 20 us on average (exponential), 10 % of the marks uniformly up to
//! 5 ms late and 0.2 % 50 ms late. SCET is cut to 2^-24 s as on the wire. Error: local time by the estimate half-way
//! between two marks, less the true one.

#[path = "time_correlation/doubt.rs"]
mod doubt;
#[path = "time_correlation/link.rs"]
mod link;
#[path = "time_correlation/others.rs"]
mod others;
#[path = "time_correlation/pulses.rs"]
mod pulses;

use link::{Bench, Link, limits, quantile};
use others::{HullAlone, LastMark, LeastOfTwoSeconds};
use plan::attitude::RemoteClock;

/// Two windows: one to learn the drift, one to use it.
const CONVERGED_S: f64 = 60.0;
const RUN_S: f64 = 300.0;
const SEEDS: u64 = 10;
/// The promise: 99 % of the errors at 10 marks per second, ns.
const PROMISE_NS: f64 = 2000.0;
/// Sizes of a quartz's wander: a good one and one whose temperature changes.
const QUIET: f64 = 1e-9;
const RESTLESS: f64 = 1e-8;

/// 99 % errors, ns, of the estimator, of hull alone, of the least of 2 s, of the last mark; and errors over sigma.
struct Found {
    p99_ns: [f64; 4],
    worst_ns: f64,
    in_sigmas: Vec<f64>,
}

fn run_all(rate_hz: f64, allan_1s: f64) -> Found {
    let mut errors: [Vec<f64>; 4] = [const { Vec::new() }; 4];
    let mut in_sigmas = Vec::new();
    for seed in 0..SEEDS {
        let mut bench = Bench::new(seed, allan_1s, Link::USUAL);
        let mut clock = RemoteClock::new(limits());
        let (mut hull, mut least, mut last) = (HullAlone::new(), LeastOfTwoSeconds::new(), LastMark::default());
        for i in 0..(RUN_S * rate_hz) as u32 {
            let at_s = f64::from(i) / rate_hz;
            let (remote_ns, local) = bench.mark(at_s);
            clock.observe(remote_ns, local);
            hull.observe(remote_ns, local);
            least.observe(remote_ns, local);
            last.observe(remote_ns, local);
            bench.advance_to(at_s + 0.5 / rate_hz);
            if at_s < CONVERGED_S {
                continue;
            }
            let (remote_ns, truth) = bench.truth();
            let estimate = clock.estimate().expect("marks");
            let found = [estimate.to_tai(remote_ns), least.to_tai(remote_ns), last.to_tai(remote_ns)];
            let [error, least_error, last_error] = found.map(|tai| (tai - truth).ns() as f64);
            errors[0].push(error.abs());
            errors[2].push(least_error.abs());
            errors[3].push(last_error.abs());
            // Dear when there are thousands of marks: every tenth second is enough.
            if i % (10 * rate_hz as u32) == 0 {
                errors[1].push(((hull.to_tai(remote_ns) - truth).ns() as f64).abs());
            }
            in_sigmas.push(error.abs() / estimate.sigma_at(remote_ns).ns() as f64);
        }
    }
    let worst_ns = quantile(&mut errors[0].clone(), 1.0);
    Found { p99_ns: errors.map(|mut all| quantile(&mut all, 0.99)), worst_ns, in_sigmas }
}

/// 99 % errors that the guide (flight_computer.md) states, ns, with a margin for other seeds.
const STATED: [(f64, f64, f64); 7] = [
    (1.0, 6000.0, 14_000.0),
    (2.0, 3000.0, 9000.0),
    (5.0, 3000.0, 6000.0),
    (10.0, 1500.0, 4000.0),
    (20.0, 1000.0, 3000.0),
    (50.0, 600.0, 3000.0),
    (100.0, 500.0, 3000.0),
];

#[test]
fn errors_stay_as_stated_at_every_rate() {
    println!("99 % error, us: hull and filter | hull alone | least of 2 s | last mark (largest of hull and filter)");
    for (rate_hz, quiet_ns, restless_ns) in STATED {
        for (allan_1s, bound_ns) in [(QUIET, quiet_ns), (RESTLESS, restless_ns)] {
            let found = run_all(rate_hz, allan_1s);
            let [ours, hull, least, last] = found.p99_ns.map(|ns| ns * 1e-3);
            let worst = found.worst_ns * 1e-3;
            println!("{rate_hz:5} Hz, {allan_1s:.0e}: {ours:7.2} | {hull:7.2} | {least:7.1} | {last:7.0} ({worst:.2})");
            assert!(found.p99_ns[0] <= bound_ns, "{rate_hz} Hz: {ours} us, stated {bound_ns} ns");
            assert!(last > 3000.0, "the link is as bad as said: {last}");
            assert!(ours < 0.5 * least, "{rate_hz} Hz");
            // The filter pays where marks are rare. Where they are many and the oscillator is quiet, a plain hull is
            // better: twice at 100 Hz, where both are below 0.3 us.
            let share = if allan_1s == QUIET && rate_hz <= 5.0 { 0.9 } else { 2.5 };
            assert!(ours < share * hull, "{rate_hz} Hz: {ours} against {hull} us");
        }
    }
}

#[test]
fn ten_marks_per_second_keep_the_promise_and_know_their_sigma() {
    let mut found = run_all(10.0, QUIET);
    assert!(found.p99_ns[0] <= PROMISE_NS, "{:?}", found.p99_ns);
    // A normal law would have 68 % within 1 and 99 % within 2.6; the hull's errors have longer tails.
    let (p68, p99) = (quantile(&mut found.in_sigmas, 0.68), quantile(&mut found.in_sigmas, 0.99));
    assert!((0.4..1.3).contains(&p68) && p99 < 4.0, "{p68} and {p99} sigma");
    // The comparison can fail: without the hull the promise is broken, by the same numbers.
    assert!(found.p99_ns[2] > 10.0 * PROMISE_NS, "{:?}", found.p99_ns);
}

#[test]
fn the_first_mark_is_enough_and_each_later_one_improves() {
    println!("99 % error by time since the first mark, us, 10 Hz");
    let mut before_ns = f64::MAX;
    for (from_s, until_s, bound_ns) in
        [(0.0, 1.0, 5e6), (1.0, 5.0, 1e5), (5.0, 15.0, 2e4), (15.0, 30.0, 5e3), (30.0, 60.0, 4e3)]
    {
        let mut errors = Vec::new();
        for seed in 100..140 {
            let mut bench = Bench::new(seed, QUIET, Link::USUAL);
            let mut clock = RemoteClock::new(limits());
            for i in 0..(until_s * 10.0) as u32 {
                let at_s = f64::from(i) / 10.0;
                let (remote_ns, local) = bench.mark(at_s);
                clock.observe(remote_ns, local);
                bench.advance_to(at_s + 0.05);
                if at_s >= from_s {
                    let (remote_ns, truth) = bench.truth();
                    errors.push(((clock.estimate().expect("marks").to_tai(remote_ns) - truth).ns() as f64).abs());
                }
            }
        }
        let (p50, p99) = (quantile(&mut errors, 0.5), quantile(&mut errors, 0.99));
        println!("{from_s:4} to {until_s:4} s: {:9.2} (half of them below {:.2})", p99 * 1e-3, p50 * 1e-3);
        assert!(p99 < bound_ns && p99 < before_ns, "{p99}");
        before_ns = p99;
    }
}

#[test]
fn a_minute_of_silence_is_bridged_by_the_drift() {
    let mut in_sigmas = Vec::new();
    for seed in 0..30 {
        let mut bench = Bench::new(seed, QUIET, Link::USUAL);
        let mut clock = RemoteClock::new(limits());
        for i in 0..1200 {
            let (remote_ns, local) = bench.mark(f64::from(i) / 10.0);
            clock.observe(remote_ns, local);
        }
        let estimate = clock.estimate().expect("marks");
        bench.advance_to(180.0);
        let (remote_ns, truth) = bench.truth();
        let error_ns = (estimate.to_tai(remote_ns) - truth).ns() as f64;
        in_sigmas.push(error_ns.abs() / estimate.sigma_at(remote_ns).ns() as f64);
        assert!(error_ns.abs() < 20_000.0, "seed {seed}: {error_ns} ns");
        let undrifted = plan::attitude::ClockEstimate { drift: 0.0, ..estimate };
        let without_ns = (undrifted.to_tai(remote_ns) - truth).ns().abs();
        assert!(without_ns > 1_000_000, "20 ppm of a minute: {without_ns} ns");
        // Marks that come again are taken at once.
        let (outlier, steps) = (clock.outliers, clock.steps);
        for i in 0..50 {
            let (remote_ns, local) = bench.mark(180.0 + f64::from(i) / 10.0);
            clock.observe(remote_ns, local);
        }
        assert_eq!((clock.outliers, clock.steps), (outlier, steps), "seed {seed}");
    }
    let p90 = quantile(&mut in_sigmas, 0.9);
    assert!((0.1..2.5).contains(&p90), "90 % of errors within {p90} sigma");
}

/// 1 ppm per minute: a box that warms up; 6 times what the filter takes for likely over a window.
#[test]
fn a_drift_that_ramps_is_followed() {
    let mut errors = Vec::new();
    for seed in 0..SEEDS {
        let mut bench = Bench::new(seed, QUIET, Link::USUAL);
        bench.ramp_ns_per_s2 = 1000.0 / 60.0;
        let mut clock = RemoteClock::new(limits());
        for i in 0..6000 {
            let at_s = f64::from(i) / 10.0;
            let (remote_ns, local) = bench.mark(at_s);
            clock.observe(remote_ns, local);
            bench.advance_to(at_s + 0.05);
            if at_s > CONVERGED_S {
                let (remote_ns, truth) = bench.truth();
                errors.push(((clock.estimate().expect("marks").to_tai(remote_ns) - truth).ns() as f64).abs());
            }
        }
    }
    let (p99, worst) = (quantile(&mut errors, 0.99), quantile(&mut errors, 1.0));
    println!("ramp of 1 ppm per minute: 99 % {:.1} us, largest {:.1} us", p99 * 1e-3, worst * 1e-3);
    assert!(p99 < 20_000.0, "{p99}");
}

#[test]
fn a_drift_beyond_the_limit_is_no_drift() {
    let mut bench = Bench::new(1, QUIET, Link::USUAL);
    bench.ppm_more(480.0);
    let mut clock = RemoteClock::new(limits());
    for i in 0..1200 {
        let (remote_ns, local) = bench.mark(f64::from(i) / 10.0);
        clock.observe(remote_ns, local);
        let drift = clock.estimate().expect("marks").drift;
        assert!(drift.abs() <= 200e-6 + 1e-12, "{drift}");
    }
    let (remote_ns, truth) = bench.truth();
    let error_ns = (clock.estimate().expect("marks").to_tai(remote_ns) - truth).ns();
    assert!(error_ns.abs() < 10_000_000, "of use all the same: {error_ns} ns");
}
