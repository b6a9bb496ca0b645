//! Motions with a closed form: symmetric top, gravity gradient, constant torque.

use super::*;
use base::axes::Icrf;
use core::f64::consts::{PI, TAU};

/// Rounding of the closed form and of 2e4 steps.
const ROUNDING_RAD: f64 = 1e-11;

#[test]
fn a_symmetric_top_precesses_as_euler_found() {
    // Goldstein, "Classical Mechanics", section 5.6: the rate turns about the symmetry axis at (I3 - I1) w3 / I1 in the
    // body; the axis turns about the momentum at H / I1 in space.
    let (i1, i3, rate) = (100.0, 60.0, DVec3::new(0.03, 0.0, 0.1));
    let params = bare(DMat3::from_diagonal(DVec3::new(i1, i1, i3)), Span::from_ms(10));
    let mut craft = turning(&params, rate);
    let (momentum, axis) = (craft.momentum_icrf_n_m_s(), craft.state.q.conjugate() * DVec3::Z);
    craft.advance_to(after(200.0));
    let truth = craft.attitude_at(after(200.0)).expect("the last boundary");
    let (sin, cos) = ((i3 - i1) / i1 * rate.z * 200.0).sin_cos();
    let wanted = DVec3::new(rate.x * cos, rate.x * sin, rate.z);
    assert!((truth.rate_rad_s - wanted).length() < ROUNDING_RAD, "rate {} for {wanted}", truth.rate_rad_s);
    let turned = glam::DQuat::from_axis_angle(momentum.normalize(), momentum.length() / i1 * 200.0) * axis;
    let got = truth.body_from_icrf.inverse().apply(DVec3::Z);
    assert!((got - turned).length() < ROUNDING_RAD, "axis {got} for {turned}");
    let wrong = glam::DQuat::from_axis_angle(momentum.normalize(), -momentum.length() / i1 * 200.0) * axis;
    assert!((got - wrong).length() > 0.01, "negative control");
}

/// Returns the gravity gradient acceleration at rest, from the formula with the place of the public orbit.
fn gravity_gradient(params: &SpacecraftParams, body_from_icrf: &Rotation<Body, Icrf>, at: Tai) -> DVec3 {
    let place_m = body_from_icrf.apply(CircularOrbit::new(&params.orbit).position_m(at));
    let inertia = params.inertia_kg_m2;
    3.0 * 3.986_004_415e14 / place_m.length().powi(5) * place_m.cross(inertia * place_m)
}

#[test]
fn gravity_gradient_is_the_formula() {
    let mut params = bare(lopsided(), Span::from_ms(10));
    params.disturbance.gravity_gradient = true;
    let craft = at_rest(&params);
    let truth = craft.attitude_at(START).expect("the start");
    let torque = params.inertia_kg_m2 * truth.acceleration_rad_s2;
    let wanted = gravity_gradient(&params, &truth.body_from_icrf, START);
    assert!(wanted.length() > 1e-6, "some torque: {wanted}");
    assert!((torque - wanted).length() < 1e-12 * wanted.length() + 1e-20, "{torque} for {wanted}");
    let later = gravity_gradient(&params, &truth.body_from_icrf, after(60.0));
    assert!((torque - later).length() > 0.01 * wanted.length(), "negative control: another place");
}

/// Returns the body axes along radial (x), velocity (y) and orbit normal (z), turned by `pitch_rad` about z.
fn orbit_pointing(params: &SpacecraftParams, pitch_rad: f64) -> Rotation<Body, Icrf> {
    let orbit = CircularOrbit::new(&params.orbit);
    let (x, y) = (orbit.position_m(START).normalize(), orbit.velocity_m_s(START).normalize());
    Rotation::from_axes(x, y, x.cross(y)).rotated_by(DVec3::Z * pitch_rad)
}

/// Returns seconds between the first two times that pitch passes zero.
fn half_period_s(params: &SpacecraftParams, pitch_rad: f64) -> Option<f64> {
    let orbit = CircularOrbit::new(&params.orbit);
    let rate = DVec3::Z * orbit.rate_rad_s();
    let start = orbit_pointing(params, pitch_rad);
    let mut craft = Spacecraft::new(params, START, start, rate, 1).expect("sound parameters");
    let (mut before, mut crossings) = (pitch_rad, Vec::new());
    for second in (10..9000).step_by(10) {
        let at = after(f64::from(second));
        craft.advance_to(at);
        let truth = craft.attitude_at(at).expect("the last boundary");
        let nominal = orbit_pointing(params, 0.0).rotated_by(rate * f64::from(second));
        let pitch = nominal.rotation_vector_to(&truth.body_from_icrf).z;
        if pitch * before < 0.0 {
            crossings.push(f64::from(second) - 10.0 * pitch / (pitch - before));
        }
        before = pitch;
    }
    Some(crossings.get(1)? - crossings.first()?)
}

#[test]
fn a_stable_body_librates_in_pitch_as_hughes_says() {
    // Hughes (1986), section 9.1: pitch'' = -3 n^2 (I_y - I_x) / I_z pitch, x radial, y along the velocity.
    let inertia = DVec3::new(40.0, 100.0, 110.0);
    let mut params = bare(DMat3::from_diagonal(inertia), Span::from_ms(100));
    params.disturbance.gravity_gradient = true;
    let n = CircularOrbit::new(&params.orbit).rate_rad_s();
    let wanted_s = PI / (n * (3.0 * (inertia.y - inertia.x) / inertia.z).sqrt());
    let got_s = half_period_s(&params, 0.01).expect("two crossings");
    // Finite amplitude: sin(2 a) shortens nothing and lengthens by a^2 / 4 = 2.5e-5; crossings by secants: less.
    assert!((got_s / wanted_s - 1.0).abs() < 1e-4, "{got_s} s for {wanted_s} s");
    params.inertia_kg_m2 = DMat3::from_diagonal(DVec3::new(100.0, 40.0, 110.0));
    assert!(
        half_period_s(&params, 0.01).is_none_or(|s| (s / wanted_s - 1.0).abs() > 0.1),
        "negative control: unstable"
    );
}

#[test]
fn a_constant_torque_and_a_turning_one_do_what_newton_says() {
    let mut params = bare(DMat3::IDENTITY * 50.0, Span::from_ms(10));
    params.disturbance.constant_torque_n_m = DVec3::new(0.0, 0.0, 1e-3);
    let mut craft = at_rest(&params);
    let start = craft.attitude_at(START).expect("the start").body_from_icrf;
    craft.advance_to(after(100.0));
    let truth = craft.attitude_at(after(100.0)).expect("the last boundary");
    assert!((start.rotation_vector_to(&truth.body_from_icrf) - DVec3::Z * 0.1).length() < ROUNDING_RAD);
    // In ICRF, whatever the attitude does: momentum = torque times time.
    params.disturbance = DisturbanceParams { solar_torque_icrf_n_m: DVec3::X * 1e-3, ..Default::default() };
    let mut craft = turning(&params, DVec3::new(0.0, 0.1, 0.05));
    let before = craft.momentum_icrf_n_m_s();
    craft.advance_to(after(100.0));
    let gained = craft.momentum_icrf_n_m_s() - before;
    assert!((gained - DVec3::X * 0.1).length() < 1e-10, "{gained}");
}

#[test]
fn a_random_walk_of_torque_has_its_variance() {
    // Rate after T of a torque walk s: variance s^2 T^3 / 3 / J^2 per axis. 600 numbers: the ratio's sigma is
    // sqrt(2 / 600); 4 sigma, false alarm 6e-5, once for the fixed seeds.
    let mut params = bare(DMat3::IDENTITY * 50.0, Span::from_ms(100));
    params.disturbance.random_walk_n_m_sqrt_s = 1e-4;
    let (t_s, runs) = (20.0, 200u32);
    let mut squares = 0.0;
    for seed in 0..runs {
        let mut craft = Spacecraft::new(&params, START, Rotation::IDENTITY, DVec3::ZERO, seed.into()).expect("sound");
        craft.advance_to(after(t_s));
        squares += craft.state.rate.length_squared();
    }
    let ratio = squares / f64::from(3 * runs) / (1e-8 * t_s.powi(3) / 3.0 / 2500.0);
    // Torques begin one step late: 1.5 steps of 200 in T^3.
    assert!((ratio - 1.0).abs() < 4.0 * (2.0f64 / 600.0).sqrt() + 0.01, "{ratio}");
}

#[test]
fn the_orbit_carries_the_radial_round_once() {
    let orbit = CircularOrbit::new(&bare(lopsided(), Span::from_ms(10)).orbit);
    let once = orbit.position_m(after(TAU / orbit.rate_rad_s()));
    assert!((once - orbit.position_m(START)).length() < 1e-3, "nanoseconds of 7.6 km/s");
}

#[test]
fn a_sine_torque_turns_a_free_body_by_its_twofold_integral() {
    // J theta'' = a sin(w t) from rest: theta = a / (J w) t - a / (J w^2) sin(w t).
    let (inertia, frequency_hz, begins_s) = (50.0, 0.2, 3.0);
    let mut craft = at_rest(&bare(DMat3::IDENTITY * inertia, Span::from_ms(10)));
    let start = craft.attitude_at(START).expect("the start").body_from_icrf;
    let sine = TestTorque { amplitude_n_m: DVec3::Y * 0.01, frequency_hz, begins_s, ramp_s: 0.0 };
    craft.add_test_torques(&[sine]).expect("sound");
    craft.advance_to(after(begins_s + 17.0));
    let turned = start.rotation_vector_to(&craft.attitude_at(after(begins_s + 17.0)).expect("kept").body_from_icrf);
    let wanted = |w: f64| 0.01 / inertia * (17.0 / w - (w * 17.0).sin() / (w * w));
    let (w, step_s) = (TAU * frequency_hz, 0.01);
    // Held at its middle, a sine loses (w h)^2 / 24 of its amplitude.
    let allowed = wanted(w).abs() * (w * step_s).powi(2) / 12.0;
    assert!((turned - DVec3::Y * wanted(w)).length() < allowed, "{turned} for {}", wanted(w));
    assert!((turned.y - wanted(1.001 * w)).abs() > allowed, "negative control: another frequency");
}

#[test]
fn a_test_torque_has_a_ramp_and_finite_numbers() {
    let sine = TestTorque { amplitude_n_m: DVec3::X, frequency_hz: 0.25, begins_s: 2.0, ramp_s: 8.0 };
    assert_eq!(sine.at_n_m(2.0), DVec3::ZERO);
    assert!((sine.at_n_m(7.0).x - 0.5 * (1.0 - (PI * 5.0 / 8.0).cos())).abs() < 1e-12, "5 s of the ramp, at a peak");
    assert!((sine.at_n_m(15.0).x - 1.0).abs() < 1e-12, "13 s after the start, at a peak");
    let mut craft = at_rest(&bare(lopsided(), Span::from_ms(10)));
    for (spoilt, field) in [
        (TestTorque { ramp_s: -1.0, ..sine }, "ramp_s"),
        (TestTorque { frequency_hz: f64::NAN, ..sine }, "frequency_hz"),
        (TestTorque { amplitude_n_m: DVec3::X * f64::INFINITY, ..sine }, "amplitude_n_m"),
    ] {
        let refused = craft.add_test_torques(&[sine, spoilt]).expect_err("refused").to_string();
        assert!(refused.contains("test torque 1") && refused.contains(field), "{refused}");
    }
}
