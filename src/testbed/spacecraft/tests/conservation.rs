//! Momentum and energy over 1000 s, and the order of the method.

use super::*;

/// Relative, over 1000 s: rounding of 1e5 steps adds as a random walk to some 1e-13; the method's own drift, `(rate
/// step)^5 / 120` per step with nutation rates below 0.1 rad/s, is less.
const CONSERVED: f64 = 1e-10;

fn momentum_drift(craft: &mut Spacecraft, until_s: f64) -> f64 {
    let before = craft.momentum_icrf_n_m_s();
    craft.advance_to(after(until_s));
    (craft.momentum_icrf_n_m_s() - before).length() / before.length()
}

#[test]
fn rigid_body_and_wheels_keep_momentum_and_energy() {
    let params = SpacecraftParams { wheels: pyramid(), ..bare(lopsided(), Span::from_ms(10)) };
    let mut craft = turning(&params, DVec3::new(0.02, -0.01, 0.015));
    let energy = craft.energy_j();
    let drift = momentum_drift(&mut craft, 1000.0);
    assert!(drift < CONSERVED, "momentum {drift:e}");
    let drift = (craft.energy_j() / energy - 1.0).abs();
    assert!(drift < CONSERVED, "energy {drift:e}");
}

#[test]
fn an_undamped_mode_keeps_momentum_and_loses_no_more_energy_than_the_method_takes() {
    let (step, hz) = (Span::from_ms(5), 2.0);
    let modes = vec![mode(hz, 0.0, DVec3::new(1.0, -2.0, 3.0))];
    let params = SpacecraftParams { wheels: pyramid(), modes, ..bare(lopsided(), step) };
    let mut craft = turning(&params, DVec3::new(0.02, -0.01, 0.015));
    craft.state.modal[0] = 0.05;
    let energy = craft.energy_j();
    let drift = momentum_drift(&mut craft, 1000.0);
    assert!(drift < CONSERVED, "momentum {drift:e}");
    // |R(i z)|^2 = 1 - z^6 / 72 per step of the elastic part, which is all that can be lost; z of the free mode.
    let elastic = 0.5 * (hz * core::f64::consts::TAU * 0.05).powi(2);
    let z = crate::spacecraft::micro_vibration::free_modes(&params)[0].frequency_rad_s * step.s();
    let wanted = elastic * z.powi(6) / 72.0 * 1000.0 / step.s();
    let lost = energy - craft.energy_j();
    // The wheels' momentum couples the mode into the nutation: a percent of its energy.
    assert!((lost / wanted - 1.0).abs() < 0.02, "lost {lost:e} J, wanted {wanted:e} J");
    // A damping ratio of 1e-7 would take as much: exp(-2 z o t).
    assert!(lost < 4e-4 * elastic, "negligible against any structure's damping: {lost:e} of {elastic:e} J");
}

#[test]
fn a_torque_from_outside_is_seen_by_the_same_comparison() {
    let mut params = SpacecraftParams { wheels: pyramid(), ..bare(lopsided(), Span::from_ms(10)) };
    params.disturbance.constant_torque_n_m = DVec3::X * 1e-9;
    let drift = momentum_drift(&mut turning(&params, DVec3::new(0.02, -0.01, 0.015)), 1000.0);
    assert!(drift > CONSERVED, "negative control: {drift:e}");
    // Friction moves momentum and takes energy.
    let mut params = SpacecraftParams { wheels: pyramid(), ..bare(lopsided(), Span::from_ms(10)) };
    params.wheels[0].viscous_n_m_s = 1e-7;
    let mut craft = turning(&params, DVec3::ZERO);
    let energy = craft.energy_j();
    assert!(momentum_drift(&mut craft, 1000.0) < CONSERVED, "friction is internal");
    assert!((craft.energy_j() / energy - 1.0).abs() > CONSERVED, "negative control: friction");
}

/// Returns the attitude error after 20 s against a step 16 times shorter, for a case with everything in it.
fn errors(steps_ms: &[i64]) -> Vec<f64> {
    let run = |step: Span| {
        let modes = vec![mode(0.7, 0.01, DVec3::new(1.0, -2.0, 3.0)), mode(1.1, 0.02, DVec3::new(2.0, 1.0, -1.0))];
        let mut params = SpacecraftParams { wheels: pyramid(), modes, ..bare(lopsided(), step) };
        params.disturbance.gravity_gradient = true;
        params.disturbance.solar_torque_icrf_n_m = DVec3::new(1e-3, 2e-3, -1e-3);
        for wheel in &mut params.wheels {
            (wheel.viscous_n_m_s, wheel.coulomb_n_m) = (1e-4, 1e-3);
        }
        let mut craft = turning(&params, DVec3::new(0.2, -0.3, 0.25));
        craft.command_torques(DVec3::new(0.05, -0.02, 0.03));
        craft.advance_to(after(20.0));
        craft.attitude_at(after(20.0)).expect("the last boundary").body_from_icrf
    };
    let exact = run(Span::from_ns(1_250_000));
    steps_ms.iter().map(|ms| run(Span::from_ms(*ms)).rotation_vector_to(&exact).length()).collect()
}

#[test]
fn the_method_is_of_order_four() {
    let errors = errors(&[40, 20, 10]);
    for pair in errors.windows(2) {
        let order = (pair[0] / pair[1]).log2();
        assert!((order - 4.0).abs() < 0.2, "order {order} of {errors:?}");
    }
    assert!(errors[2] < 1e-8, "10 ms, a fast tumble with two modes: {errors:?} rad");
}
