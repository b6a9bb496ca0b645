//! Damaged marks, steps of either clock, and links that change.

use super::link::{Bench, Link, as_on_the_wire, limits, quantile, received_ns, scet, with_bit_flipped};
use super::others::HullAlone;
use super::{CONVERGED_S, PROMISE_NS, QUIET};
use base::time::Span;
use plan::attitude::{Observed, RemoteClock};

/// A single damaged mark may move the estimate by so much, ns: "a few microseconds".
const ONE_DAMAGED_NS: i64 = 5000;

fn error_ns(clock: &RemoteClock, bench: &Bench) -> f64 {
    let (remote_ns, truth) = bench.truth();
    (clock.estimate().expect("marks").to_tai(remote_ns) - truth).ns() as f64
}

/// Returns a clock that has seen `marks` marks at 10 Hz, and the time of the next one.
fn settled(seed: u64, marks: u32) -> (Bench, RemoteClock, f64) {
    let mut bench = Bench::new(seed, QUIET, Link::USUAL);
    let mut clock = RemoteClock::new(limits());
    for i in 0..marks {
        let (remote_ns, local) = bench.mark(f64::from(i) / 10.0);
        clock.observe(remote_ns, local);
    }
    (bench, clock, f64::from(marks) / 10.0)
}

fn feed(bench: &mut Bench, clock: &mut RemoteClock, from_s: f64, marks: u32) -> Vec<Observed> {
    let mark = |i: u32| {
        let (remote_ns, local) = bench.mark(from_s + f64::from(i) / 10.0);
        clock.observe(remote_ns, local)
    };
    (0..marks).map(mark).collect()
}

#[test]
fn one_flipped_bit_anywhere_in_a_time_mark_changes_little() {
    for bit in 0..56_u32 {
        let (mut bench, mut clock, now_s) = settled(u64::from(bit), 900);
        let before = clock.estimate().expect("marks");
        let (remote_ns, local) = bench.mark(now_s);
        let damaged = received_ns(with_bit_flipped(scet(remote_ns), bit));
        let outcome = clock.observe(damaged, local);
        let (again_ns, again) = bench.mark(now_s + 0.1);
        clock.observe(again_ns, again);
        let moved = clock.estimate().expect("marks").to_tai(again_ns) - before.to_tai(again_ns);
        assert!(moved.ns().abs() <= ONE_DAMAGED_NS, "bit {bit}, {outcome:?}: {} ns", moved.ns());
        assert!(error_ns(&clock, &bench).abs() < 10_000.0, "bit {bit}: {} ns", error_ns(&clock, &bench));
    }
}

/// Every hundredth mark has one wrong bit in its fraction: half of those are early, and a hull alone believes them.
#[test]
fn damaged_marks_now_and_then_do_not_matter() {
    let (mut errors, mut hull_errors, mut outlier) = (Vec::new(), Vec::new(), 0);
    for seed in 0..10 {
        let mut bench = Bench::new(seed, QUIET, Link::USUAL);
        let mut clock = RemoteClock::new(limits());
        let mut hull = HullAlone::new();
        for i in 0..3000_u32 {
            let at_s = f64::from(i) / 10.0;
            let (mut remote_ns, local) = bench.mark(at_s);
            if bench.dice.uniform() < 0.01 {
                let bit = (24.0 * bench.dice.uniform()) as u32;
                remote_ns = received_ns(with_bit_flipped(scet(remote_ns), bit));
            }
            clock.observe(remote_ns, local);
            hull.observe(remote_ns, local);
            bench.advance_to(at_s + 0.05);
            if at_s > CONVERGED_S {
                errors.push(error_ns(&clock, &bench).abs());
                if i % 10 == 0 {
                    let (remote_ns, truth) = bench.truth();
                    hull_errors.push(((hull.to_tai(remote_ns) - truth).ns() as f64).abs());
                }
            }
        }
        outlier += clock.outliers;
    }
    let (p99, hull_p50) = (quantile(&mut errors, 0.99), quantile(&mut hull_errors, 0.5));
    println!(
        "1 % damaged: 99 % of errors below {:.2} us; half of hull alone's above {:.0} us",
        p99 * 1e-3,
        hull_p50 * 1e-3
    );
    // A mark early by less than the gate is believed, and tilts a window's line.
    assert!(p99 < 4.0 * PROMISE_NS, "{p99}");
    assert!(outlier > 50, "{outlier} of about 100 early ones");
    assert!(hull_p50 > 100.0 * PROMISE_NS, "damage matters to those who believe it: {hull_p50}");
}

#[test]
fn a_reboot_is_found_at_once_and_time_is_of_use_at_once() {
    let (mut bench, mut clock, now_s) = settled(5, 900);
    bench.stepped_ns = -(90.0 * 1e9) as i64;
    bench.advance_to(now_s + 5.0);
    assert_eq!(feed(&mut bench, &mut clock, now_s + 5.0, 1), [Observed::Restarted]);
    assert!(error_ns(&clock, &bench).abs() < 6e6, "one mark's delay: {}", error_ns(&clock, &bench));
    feed(&mut bench, &mut clock, now_s + 5.1, 50);
    assert!(error_ns(&clock, &bench).abs() < 20_000.0, "5 s later: {}", error_ns(&clock, &bench));
    assert_eq!(clock.steps, 1);
}

/// Steps of the local clock: every stamp shifts. Backwards it shows at once or with the third mark, forwards it looks
/// like delay: three marks beyond the limit, 4 s below it.
#[test]
fn steps_of_the_local_clock_are_followed() {
    for (step_ms, marks_until_found) in [(-2000, 1), (2000, 3), (-37, 8), (37, 60), (-1, 8), (1, 60)] {
        let (mut bench, mut clock, now_s) = settled(6, 900);
        bench.local_stepped_ns = step_ms * 1_000_000;
        feed(&mut bench, &mut clock, now_s, marks_until_found);
        let found_ns = error_ns(&clock, &bench).abs();
        assert!(found_ns < 6e6 && found_ns < 1e6 * step_ms.abs() as f64, "{step_ms} ms: {found_ns} ns");
        feed(&mut bench, &mut clock, now_s + 0.1 * f64::from(marks_until_found), 100);
        assert!(error_ns(&clock, &bench).abs() < 10_000.0, "{step_ms} ms, later: {} ns", error_ns(&clock, &bench));
        // The mark of the restart may have been late itself; then the line comes down again.
        assert!((1..=3).contains(&(clock.steps + clock.shifts)), "{step_ms} ms: {}, {}", clock.steps, clock.shifts);
        assert_eq!(clock.steps, u64::from(step_ms.abs() > 250), "{step_ms} ms");
    }
}

/// 20 ms of delay for 3 s: the line stays where it was. For 20 s: it follows, and comes back with the third mark.
#[test]
fn a_slow_link_is_waited_for_and_its_end_is_seen_at_once() {
    for (slow_marks, follows) in [(30, false), (200, true)] {
        let (mut bench, mut clock, now_s) = settled(8, 900);
        bench.slower = Span::from_ms(20);
        feed(&mut bench, &mut clock, now_s, slow_marks);
        let error = error_ns(&clock, &bench);
        assert_eq!(error > 19e6, follows, "{slow_marks} marks: {error} ns, shifts {}", clock.shifts);
        bench.slower = Span::ZERO;
        feed(&mut bench, &mut clock, now_s + 0.1 * f64::from(slow_marks), 5);
        assert!(error_ns(&clock, &bench).abs() < 100_000.0, "back: {} ns", error_ns(&clock, &bench));
        feed(&mut bench, &mut clock, now_s + 0.1 * f64::from(slow_marks) + 0.5, 100);
        assert!(error_ns(&clock, &bench).abs() < 10_000.0, "later: {} ns", error_ns(&clock, &bench));
    }
}

/// A damaged second looks like a step; the next good mark takes it back, and nothing of the line is lost.
#[test]
fn a_step_that_was_damage_is_undone_by_the_next_mark() {
    let (mut bench, mut clock, now_s) = settled(9, 900);
    let before_ns = error_ns(&clock, &bench).abs();
    let (remote_ns, local) = bench.mark(now_s);
    assert_eq!(clock.observe(as_on_the_wire(remote_ns + 64_000_000_000), local), Observed::Restarted);
    assert!(error_ns(&clock, &bench).abs() > 1e9, "believed for one mark");
    // Marks that are not late: the one that undoes must fit.
    let undone = feed(&mut bench, &mut clock, now_s + 0.1, 8);
    assert!(undone.contains(&Observed::Restarted), "{undone:?}");
    assert!(error_ns(&clock, &bench).abs() < before_ns + 2000.0, "{} ns", error_ns(&clock, &bench));
    // A real step is not undone.
    let (mut bench, mut clock, now_s) = settled(9, 900);
    bench.stepped_ns = 64_000_000_000;
    let stepped = feed(&mut bench, &mut clock, now_s, 20);
    assert_eq!(stepped.iter().filter(|outcome| **outcome == Observed::Restarted).count(), 1, "{stepped:?}");
}
