//! The truth between and at step boundaries, and determinism.

use super::*;

fn everything(step: Span) -> SpacecraftParams {
    let mut params = SpacecraftParams {
        wheels: pyramid(),
        modes: vec![mode(2.0, 0.005, DVec3::new(1.0, -2.0, 3.0))],
        ..bare(lopsided(), step)
    };
    params.disturbance = DisturbanceParams {
        constant_torque_n_m: DVec3::splat(1e-4),
        solar_torque_icrf_n_m: DVec3::X * 1e-5,
        random_walk_n_m_sqrt_s: 1e-5,
        gravity_gradient: true,
    };
    for wheel in &mut params.wheels {
        (wheel.viscous_n_m_s, wheel.coulomb_n_m) = (1e-5, 1e-3);
    }
    params
}

fn run(step: Span, t_s: f64) -> Spacecraft {
    let mut craft = turning(&everything(step), DVec3::new(0.01, 0.02, -0.01));
    craft.command_torques(DVec3::new(0.05, 0.02, -0.03));
    craft.advance_to(after(t_s));
    craft
}

#[test]
fn truth_between_boundaries_is_smooth_and_ends_at_the_boundary() {
    let craft = run(Span::from_ms(10), 5.0);
    // Across a boundary the attitude moves by rate times time: a step to either side, 1 us.
    let (boundary, little) = (after(4.0), Span::from_ns(1000));
    let at = |at: Tai| craft.attitude_at(at).expect("kept");
    let (before, now, later) = (at(boundary - little), at(boundary), at(boundary + little));
    for (a, b) in [(before, now), (now, later)] {
        let turned = a.body_from_icrf.rotation_vector_to(&b.body_from_icrf) / little.s();
        assert!((turned - now.rate_rad_s).length() < 1e-7, "{turned}: rounding 1e-16 over 1 us, and 1e-6 s of w'");
    }
    // Rate and acceleration are derivatives inside a step.
    let (middle, ms) = (after(4.005), Span::from_ms(1));
    let (a, b) = (at(middle - ms), at(middle + ms));
    let slope = (b.rate_rad_s - a.rate_rad_s) / (2.0 * ms.s());
    // (o h)^2 / 6 of an acceleration of 1e-3 at 12.6 rad/s and 1 ms.
    assert!((slope - at(middle).acceleration_rad_s2).length() < 1e-7, "{slope}");
    assert!((slope - at(middle + ms).acceleration_rad_s2).length() > 1e-7, "negative control: another instant");
}

#[test]
fn truth_between_boundaries_agrees_with_a_finer_run() {
    let mut params = everything(Span::from_ms(20));
    params.disturbance.random_walk_n_m_sqrt_s = 0.0;
    let fine = SpacecraftParams { step: Span::from_ms(1), ..params.clone() };
    let [coarse, fine] = [params, fine].map(|params| {
        let mut craft = turning(&params, DVec3::new(0.01, 0.02, -0.01));
        craft.command_torques(DVec3::new(0.05, 0.02, -0.03));
        craft.advance_to(after(5.0));
        craft
    });
    let mut worst: f64 = 0.0;
    for ms in 3000..5000 {
        let at = after(f64::from(ms) / 1000.0);
        let [a, b] = [&coarse, &fine].map(|craft| craft.attitude_at(at).expect("kept").body_from_icrf);
        worst = worst.max(a.rotation_vector_to(&b).length());
    }
    // (o step)^4 / 120 o t of the mode's 1e-5 rad: 0.25^4 / 120 * 63 = 2e-3.
    assert!(worst < 2e-8, "{worst:e} rad");
}

#[test]
fn the_past_is_kept_for_two_seconds_and_no_question_panics() {
    let craft = run(Span::from_ms(10), 5.0);
    assert!(craft.attitude_at(after(3.0)).is_ok() && craft.attitude_at(after(5.0)).is_ok());
    for t_s in [-1.0, 0.0, 2.9, 5.001, 1e9] {
        let error = craft.attitude_at(after(t_s)).expect_err("not kept").to_string();
        assert!(error.contains("kept are"), "{error}");
    }
    let young = run(Span::from_ms(10), 0.0);
    assert!(young.attitude_at(START).is_ok(), "before the first step");
    assert_eq!(young.attitude_at(START), run(Span::from_ms(10), 1.0).attitude_at(START), "and long after it");
}

#[test]
fn oldest_boundary_is_the_state_that_was() {
    let craft = run(Span::from_ms(10), 5.0);
    let oldest = craft.boundary(craft.steps.oldest());
    let then = craft.attitude_at(oldest).expect("kept");
    let mut shorter = run(Span::from_ms(10), 0.0);
    shorter.advance_to(oldest);
    let now = shorter.attitude_at(oldest).expect("the last boundary");
    assert_eq!((then.body_from_icrf, then.rate_rad_s), (now.body_from_icrf, now.rate_rad_s));
}

#[test]
fn the_same_seed_gives_the_same_bits_however_it_is_advanced() {
    let whole = run(Span::from_ms(10), 5.0);
    let mut pieces = run(Span::from_ms(10), 0.0);
    for ms in (0..=5000).step_by(7) {
        pieces.advance_to(after(f64::from(ms) / 1000.0));
    }
    pieces.advance_to(after(5.0));
    pieces.advance_to(after(1.0));
    assert_eq!(whole.state, pieces.state);
    let other = Spacecraft::new(&everything(Span::from_ms(10)), START, Rotation::IDENTITY, DVec3::ZERO, 2);
    let mut other = other.expect("sound parameters");
    let mut same = Spacecraft::new(&everything(Span::from_ms(10)), START, Rotation::IDENTITY, DVec3::ZERO, 1)
        .expect("sound parameters");
    other.advance_to(after(1.0));
    same.advance_to(after(1.0));
    assert_ne!(other.state, same.state, "the seed decides");
}
