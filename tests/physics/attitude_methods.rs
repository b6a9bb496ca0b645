//! The methods for the attitude at one instant: inside their domain the error is under the bound and the budget,
//! outside it the error is over the budget and the method refused. The truth is in `analytic_motion.rs`, in closed
//! form.

use crate::analytic_motion::{Motion, Turn, epoch};
use crate::scene::Dice;
use base::axes::{Body, Icrf, Rotation, sensor_from_ra_dec_roll};
use base::units::{ARCSEC, DEG};
use core::f64::consts::{PI, TAU};
use glam::DVec3;
use plan::attitude::{
    AttitudeHistory, AttitudeMethod, AttitudeSample, AttitudeVerdict, HistoryLimits, MotionScale, Reach,
    assess_methods, cheapest, state_by,
};

/// Quaternions in f64 through a product, a root and an arc tangent, seen as an angle.
const ROUNDING_RAD: f64 = 2e-14;
/// Line-of-sight budget of the scenes.
const BUDGET_RAD: f64 = 0.1 * ARCSEC;
fn verdict(method: AttitudeMethod, motion: &Motion, span: f64) -> AttitudeVerdict {
    let reach = Reach { horizon_s: span, spacing_s: Some(span) };
    let assessed = assess_methods(BUDGET_RAD, &motion.scale(span), reach);
    assessed.iter().find(|a| a.method == method).unwrap().verdict
}

fn assert_inside(method: AttitudeMethod, motion: &Motion, error: f64, span: f64, what: &str) {
    let bound = method.bound_rad(&motion.scale(span), span);
    assert!(error <= bound + ROUNDING_RAD, "{what}, {method}: {} arcsec over {}", error / ARCSEC, bound / ARCSEC);
    assert!(error <= BUDGET_RAD, "{what}, {method}: {} arcsec", error / ARCSEC);
    assert_eq!(verdict(method, motion, span), AttitudeVerdict::Fits, "{what}, {method}");
}

fn assert_outside(method: AttitudeMethod, motion: &Motion, error: f64, span: f64, what: &str) {
    let bound = method.bound_rad(&motion.scale(span), span);
    assert!(error > BUDGET_RAD, "{what}, {method}: only {} arcsec", error / ARCSEC);
    assert!(error <= bound + ROUNDING_RAD, "{what}, {method}: {} arcsec over {}", error / ARCSEC, bound / ARCSEC);
    assert_ne!(verdict(method, motion, span), AttitudeVerdict::Fits, "{what}, {method}");
}

#[test]
fn each_method_has_a_slew_it_follows_and_one_it_does_not() {
    let slew = |cubic: [f64; 3]| Motion::new(vec![Turn::slew(DVec3::new(0.6, 0.0, -0.8), cubic.map(|v| v * DEG))]);
    // Method, a slew within the budget of 0.1 arcsec, one beyond it (deg/s, deg/s^2, deg/s^3), the span.
    let cases = [
        (AttitudeMethod::Hold, [0.002, 0.0, 0.0], [0.004, 0.0, 0.0], 0.01),
        (AttitudeMethod::ConstantRate, [2.0, 0.1, 0.0], [2.0, 1.0, 0.0], 0.02),
        (AttitudeMethod::ConstantAcceleration, [2.0, 1.0, 0.5], [2.0, 1.0, 20.0], 0.05),
        (AttitudeMethod::Interpolation, [2.0, 1.0, 2.0], [2.0, 1.0, 50.0], 0.1),
    ];
    for (method, inside, outside, span) in cases {
        let [calm, wild] = [inside, outside].map(slew);
        assert_inside(method, &calm, calm.error_rad(method, 0.0, span), span, "slew");
        let error = wild.error_rad(method, 0.0, span);
        let bound = method.bound_rad(&wild.scale(span), span);
        if method == AttitudeMethod::Interpolation {
            // A constant jerk is a cubic, which the interpolation follows: its bound is for jerks that step.
            assert!(error < 1e-3 * BUDGET_RAD && bound > BUDGET_RAD, "{} arcsec", error / ARCSEC);
        } else {
            assert_outside(method, &wild, error, span, "slew");
        }
    }
}

/// A slew whose jerk steps in the middle of the interval: rest, then a parabola of the rate.
#[test]
fn a_jerk_that_steps_between_two_samples_meets_the_bound_of_the_interpolation() {
    let (span, jerk) = (0.1, 50.0 * DEG);
    let q0 = Rotation::<Body, Icrf>::from_rotation_vector(DVec3::new(0.1, 0.2, 0.3));
    // Jerk -j before the middle and +j after it: the worst case of the Peano kernel.
    let truth = |t: f64, seq| {
        let (u, side) = (t - span / 2.0, if t < span / 2.0 { -1.0 } else { 1.0 });
        let j = side * jerk;
        let body_from_icrf = q0.rotated_by(DVec3::Y * (j * u * u * u / 6.0));
        let (rate_rad_s, acceleration_rad_s2) = (DVec3::Y * (j * u * u / 2.0), DVec3::Y * (j * u));
        AttitudeSample { at: epoch(t), seq, body_from_icrf, rate_rad_s, acceleration_rad_s2 }
    };
    let mut history = AttitudeHistory::new(HistoryLimits::default());
    for (seq, t) in [(0, 0.0), (1, span)] {
        history.insert(truth(t, seq), epoch(t)).unwrap();
    }
    let got = state_by(AttitudeMethod::Interpolation, &history, epoch(span / 2.0)).unwrap().body_from_icrf;
    let error = truth(span / 2.0, 0).body_from_icrf.rotation_vector_to(&got).length();
    let scale = MotionScale {
        rate_rad_s: jerk * span * span / 8.0,
        acceleration_rad_s2: jerk * span / 2.0,
        jerk_rad_s3: jerk,
        sinusoids: Vec::new(),
    };
    let bound = AttitudeMethod::Interpolation.bound_rad(&scale, span);
    assert!(error <= bound && error > 0.9 * bound, "{} arcsec, bound {}", error / ARCSEC, bound / ARCSEC);
    assert!(error > BUDGET_RAD, "and it is over the budget: {} arcsec", error / ARCSEC);
}

#[test]
fn no_prediction_follows_jitter_above_5_hz() {
    for hz in [7.0, 11.3, 33.0] {
        for span in [0.01, 0.02, 0.05, 0.1, 0.2] {
            let motion = Motion::new(vec![Turn::jitter(DVec3::X, hz, 10.0 * ARCSEC, 0.0)]);
            for method in &AttitudeMethod::ALL[..3] {
                let error = motion.worst_error_rad(*method, hz, span);
                assert_outside(*method, &motion, error, span, &format!("{hz} Hz over {span} s"));
            }
            let reach = Reach { horizon_s: span, spacing_s: None };
            let assessed = assess_methods(BUDGET_RAD, &motion.scale(span), reach);
            assert_eq!(cheapest(&assessed), None, "{hz} Hz over {span} s: nothing is good enough, and that is said");
        }
    }
}

#[test]
fn slow_jitter_is_predicted_over_a_short_horizon() {
    let motion = Motion::new(vec![Turn::jitter(DVec3::X, 1.0, 10.0 * ARCSEC, 0.0)]);
    let error = |method| motion.worst_error_rad(method, 1.0, 0.01);
    assert_outside(AttitudeMethod::Hold, &motion, error(AttitudeMethod::Hold), 0.01, "1 Hz");
    for method in &AttitudeMethod::ALL[1..] {
        assert_inside(*method, &motion, error(*method), 0.01, "1 Hz");
    }
}

#[test]
fn samples_at_100_hz_carry_slow_jitter_and_refuse_fast_jitter() {
    // Frequency, spacing, amplitude that fits, amplitude that does not: the error is (w H)^4 / 384 of it. At 1 Hz and
    // 100 Hz samples that would be several turns, so the outside of 1 Hz is at 10 Hz samples.
    let cases = [(1.0, 0.1, 100.0, 500.0), (5.0, 0.01, 1000.0, 5000.0), (30.0, 0.01, 2.0, 5.0), (49.0, 0.01, 0.3, 1.0)];
    let method = AttitudeMethod::Interpolation;
    for (hz, spacing, fits, fits_not) in cases {
        for (amplitude, is_inside) in [(fits, true), (fits_not, false)] {
            let motion = Motion::new(vec![Turn::jitter(DVec3::Y, hz, amplitude * ARCSEC, 0.0)]);
            let error = motion.worst_error_rad(method, hz, spacing);
            let bound = method.bound_rad(&motion.scale(spacing), spacing);
            let what = format!("{hz} Hz, {amplitude} arcsec");
            let check = if is_inside { assert_inside } else { assert_outside };
            check(method, &motion, error, spacing, &what);
            assert!(error > 0.35 * bound, "{what}: {} arcsec idle under {}", error / ARCSEC, bound / ARCSEC);
        }
    }
    let slow = Motion::new(vec![Turn::jitter(DVec3::Y, 1.0, 1000.0 * ARCSEC, 0.0)]);
    assert_inside(method, &slow, slow.worst_error_rad(method, 1.0, 0.01), 0.01, "1 Hz, 1000 arcsec");
    let motion = Motion::new(vec![Turn::jitter(DVec3::Y, 51.0, 1e-3 * ARCSEC, 0.0)]);
    let refused = AttitudeVerdict::FasterThanSamples { frequency_hz: 51.0 };
    assert_eq!(verdict(method, &motion, 0.01), refused, "however small");
}

#[test]
fn rest_is_exact_and_so_is_a_spin_by_its_rate() {
    let still = Motion::new(Vec::new());
    let spin = Motion::new(vec![Turn::slew(DVec3::Z, [3.0 * DEG, 0.0, 0.0])]);
    for method in AttitudeMethod::ALL {
        for span in [1e-3, 0.1, 10.0] {
            assert_eq!(method.bound_rad(&still.scale(span), span), 0.0, "{method}");
            let error = still.error_rad(method, 0.0, span);
            assert!(error < ROUNDING_RAD, "{method}: {error} rad at rest");
            if method != AttitudeMethod::Hold {
                let error = spin.error_rad(method, 0.0, span);
                assert!(error < ROUNDING_RAD, "{method}: {error} rad in a spin");
            }
        }
    }
}

#[test]
fn the_sign_of_a_quaternion_changes_nothing() {
    let motion = Motion::new(vec![Turn::slew(DVec3::X, [1.0 * DEG, 0.5 * DEG, 0.0])]);
    for method in AttitudeMethod::ALL {
        let at = epoch(0.003);
        let [plain, flipped] = [1.0, -1.0].map(|sign| state_by(method, &motion.history(0.0, 0.01, sign), at).unwrap());
        assert_eq!(plain.body_from_icrf.wxyz(), flipped.body_from_icrf.wxyz(), "{method}");
        assert_eq!(plain.rate_rad_s, flipped.rate_rad_s, "{method}");
        let beyond = epoch(0.013);
        if method != AttitudeMethod::Interpolation {
            let [plain, flipped] =
                [1.0, -1.0].map(|sign| state_by(method, &motion.history(0.0, 0.01, sign), beyond).unwrap());
            assert_eq!(plain.body_from_icrf.wxyz(), flipped.body_from_icrf.wxyz(), "{method}, from the flipped one");
        }
    }
}

#[test]
fn nothing_happens_at_half_a_turn_from_the_catalog_axes_nor_where_roll_wraps() {
    let axis = DVec3::new(0.48, 0.6, -0.64);
    let half_turns = [PI - 1e-9, PI, PI + 1e-9].map(|angle| Rotation::from_rotation_vector(axis * angle));
    // Roll goes through 180 deg in the interval, and the quaternion's scalar through zero.
    let roll = |roll_deg: f64| Rotation::from_quat(sensor_from_ra_dec_roll(1.0, 0.0, roll_deg * DEG).quat());
    let wraps = [roll(179.999), roll(180.0), roll(-180.0), roll(-179.999), roll(359.999)];
    let turn = Turn::slew(DVec3::Z, [0.5 * DEG, 0.05 * DEG, 0.01 * DEG]);
    for initial in half_turns.into_iter().chain(wraps) {
        for rate_sign in [1.0, -1.0] {
            let turned = Turn { cubic: turn.cubic.map(|v| v * rate_sign), ..turn };
            let motion = Motion { initial, turns: vec![turned] };
            for method in &AttitudeMethod::ALL[1..] {
                assert_inside(*method, &motion, motion.error_rad(*method, 0.0, 0.02), 0.02, "wrap");
            }
            let error = motion.error_rad(AttitudeMethod::Hold, 0.0, 0.02);
            assert_outside(AttitudeMethod::Hold, &motion, error, 0.02, "wrap");
        }
    }
}

fn direction(dice: &mut Dice) -> DVec3 {
    let mut within = |low, high| dice.between(low, high);
    DVec3::new(within(-1.0, 1.0), within(-1.0, 1.0), within(-1.0, 1.0)).normalize_or(DVec3::X)
}

/// Returns a slew and up to three sinusoids; magnitudes spread over decades.
fn random_motion(dice: &mut Dice) -> Motion {
    let decades = |dice: &mut Dice, low: f64, high: f64| 10_f64.powf(dice.between(low, high));
    let axis = direction(dice);
    let cubic = [5.0, 2.0, 5.0].map(|most| dice.between(-most, most) * DEG * decades(dice, -2.0, 0.0));
    let mut turns = vec![Turn::slew(axis, cubic)];
    for _ in 0..(4.0 * dice.unit()) as u32 {
        let (hz, amplitude) = (decades(dice, -1.0, 1.7), decades(dice, -1.0, 2.0) * ARCSEC);
        turns.push(Turn::jitter(direction(dice), hz, amplitude, dice.between(0.0, TAU)));
    }
    Motion { initial: Rotation::from_rotation_vector(direction(dice) * dice.between(0.0, PI)), turns }
}

/// Returns the error over bound of 600 random motions, each by every method whose domain has it.
fn shares() -> Vec<(AttitudeMethod, f64, f64)> {
    let mut dice = Dice::new(20);
    let mut found = Vec::new();
    for _ in 0..600 {
        let (motion, span) = (random_motion(&mut dice), 10_f64.powf(dice.between(-3.0, -0.5)));
        let scale = motion.scale(span);
        for method in AttitudeMethod::ALL {
            let bound = method.bound_rad(&scale, span);
            if bound < PI {
                found.push((method, motion.error_rad(method, 0.0, span), bound));
            }
        }
    }
    found
}

#[test]
fn the_bound_is_above_the_error_of_any_motion() {
    let shares = shares();
    for method in AttitudeMethod::ALL {
        let of_method: Vec<_> = shares.iter().filter(|(m, ..)| *m == method).collect();
        let broken = of_method.iter().filter(|(_, error, bound)| *error > bound + ROUNDING_RAD).count();
        let near = of_method.iter().filter(|(_, error, bound)| *error > 0.3 * bound).count();
        let cut = of_method.iter().filter(|(_, error, bound)| *error > 0.01 * bound + ROUNDING_RAD).count();
        println!("{method}: {} motions, {near} above 0.3 of the bound, {cut} above 0.01 of it", of_method.len());
        assert_eq!(broken, 0, "{method}: errors over their bound");
        assert!(of_method.len() >= 300, "{method}: only {} motions in the domain", of_method.len());
        assert!(near * 10 >= of_method.len(), "{method}: the bound is idle, {near} of {}", of_method.len());
        // A third: the interpolation follows a constant jerk, and its bound holds for one that steps.
        assert!(cut * 3 > of_method.len(), "{method}: a hundredth of the bound would do, so this test sees nothing");
    }
}
