//! Flexible modes: frequencies, decay and response against closed forms.

use super::*;
use core::f64::consts::{PI, TAU};

/// Returns a body with one mode about z that holds the share `kappa` of the inertia.
fn one_mode(inertia_kg_m2: f64, kappa: f64, damping: f64) -> SpacecraftParams {
    let coupling = DVec3::Z * (kappa * inertia_kg_m2).sqrt();
    SpacecraftParams {
        modes: vec![mode(0.5, damping, coupling)],
        ..bare(DMat3::IDENTITY * inertia_kg_m2, Span::from_ms(5))
    }
}

/// Returns the modal coordinate by `x'' + 2 z o x' + o^2 x = 0` from 0.1 at rest.
fn decay(o: f64, z: f64, t_s: f64) -> f64 {
    let damped = o * (1.0 - z * z).sqrt();
    0.1 * f64::exp(-z * o * t_s) * ((damped * t_s).cos() + z * o / damped * (damped * t_s).sin())
}

/// Returns the largest difference between the modal coordinate and `decay` over 20 s.
fn worst(params: &SpacecraftParams, o: f64, z: f64) -> f64 {
    let mut craft = at_rest(params);
    craft.state.modal[0] = 0.1;
    let mut worst: f64 = 0.0;
    for tenth in 1..=200 {
        let t_s = f64::from(tenth) / 10.0;
        craft.advance_to(after(t_s));
        worst = worst.max((craft.modal_coordinates()[0] - decay(o, z, t_s)).abs());
    }
    worst
}

/// Phase error of the method, `(o step)^5 / 120` a step over 4000 steps of `o step < 0.02`, times 0.1: 1e-8.
const METHOD: f64 = 2e-8;

#[test]
fn free_decay_has_the_free_frequency_and_damping() {
    // Eliminating the body: eta'' (1 - kappa) + 2 z o eta' + o^2 eta = 0.
    let (kappa, z, o) = (0.36, 0.02, 0.5 * TAU);
    let params = one_mode(100.0, kappa, z);
    let (free_o, free_z) = (o / (1.0 - kappa).sqrt(), z / (1.0 - kappa).sqrt());
    let error = worst(&params, free_o, free_z);
    assert!(error < METHOD, "{error:e}");
    assert!(worst(&params, o, z) > 0.01, "negative control: the cantilever frequency");
}

#[test]
fn on_a_body_that_cannot_move_the_frequency_is_the_cantilever_one() {
    let mut params = one_mode(100.0, 0.36, 0.02);
    params.inertia_kg_m2 = DMat3::IDENTITY * 1e12;
    let error = worst(&params, 0.5 * TAU, 0.02);
    assert!(error < METHOD, "{error:e}");
}

#[test]
fn a_slow_torque_deflects_the_mode_and_the_body_follows_as_if_rigid() {
    let mut params = one_mode(100.0, 0.36, 0.3);
    params.disturbance.constant_torque_n_m = DVec3::Z * 0.1;
    let mut craft = at_rest(&params);
    craft.advance_to(after(60.0));
    let truth = craft.attitude_at(after(60.0)).expect("the end");
    assert!((truth.acceleration_rad_s2 - DVec3::Z * 1e-3).length() < 1e-12, "T / J once the mode is quiet");
    let wanted = -6.0 * 1e-3 / (PI * PI);
    assert!((craft.modal_coordinates()[0] - wanted).abs() < 1e-10, "-delta w' / o^2");
}

#[test]
fn free_modes_solve_the_characteristic_equation() {
    // Two modes: det([[1 - k11, -k12], [-k12, 1 - k22]] - diag(o1^2, o2^2) / o^2) = 0 as a quadratic in 1 / o^2.
    let (a, b) = (DVec3::new(1.0, -2.0, 3.0), DVec3::new(2.0, 1.5, 4.0));
    let params = SpacecraftParams {
        modes: vec![mode(0.7, 0.01, a), mode(0.8, 0.02, b)],
        wheels: pyramid(),
        ..bare(lopsided(), Span::from_ms(10))
    };
    let mut inertia = lopsided();
    for wheel in pyramid() {
        let axis = wheel.axis_body.normalize();
        inertia -= DMat3::from_cols(axis * axis.x, axis * axis.y, axis * axis.z) * 0.02;
    }
    let inverse = inertia.inverse();
    let (k11, k12, k22) = (a.dot(inverse * a), a.dot(inverse * b), b.dot(inverse * b));
    let (s1, s2) = ((0.7 * TAU).powi(2), (0.8 * TAU).powi(2));
    let determinant = |o: f64| (o * o * (1.0 - k11) - s1) * (o * o * (1.0 - k22) - s2) - (o * o * k12).powi(2);
    let modes = crate::spacecraft::micro_vibration::free_modes(&params);
    assert_eq!(modes.len(), 2);
    for free in &modes {
        let o = free.frequency_rad_s;
        assert!(determinant(o).abs() < 1e-11 * s1 * s2, "{} of {o} rad/s", determinant(o));
        assert!(determinant(1.001 * o).abs() > 1e-5 * s1 * s2, "negative control");
    }
    assert!((modes[0].frequency_rad_s - modes[1].frequency_rad_s).abs() > 0.1, "two different roots");
}
