//! Every rule of `check.rs` broken once.

use super::*;

/// A part of the refusal's text, and the change that causes it.
type Case<'a> = (&'a str, &'a dyn Fn(&mut SpacecraftParams));

fn sound() -> SpacecraftParams {
    SpacecraftParams {
        wheels: pyramid(),
        modes: vec![mode(0.7, 0.01, DVec3::Z)],
        ..bare(lopsided(), Span::from_ms(10))
    }
}

/// Returns the refusal's text after `spoil`.
fn refusal(spoil: impl Fn(&mut SpacecraftParams)) -> String {
    let mut params = sound();
    spoil(&mut params);
    let text = Spacecraft::new(&params, START, Rotation::IDENTITY, DVec3::ZERO, 1).expect_err("refused").to_string();
    assert_eq!(MicroVibration::new(&params, START, Span::from_ms(1), 1).expect_err("refused").to_string(), text);
    text
}

#[test]
fn sound_parameters_pass() {
    assert!(Spacecraft::new(&sound(), START, Rotation::IDENTITY, DVec3::ZERO, 1).is_ok());
    assert!(MicroVibration::new(&sound(), START, Span::from_ms(1), 1).is_ok());
}

#[test]
fn no_body_has_such_an_inertia() {
    for bad in [
        DMat3::ZERO,
        DMat3::from_diagonal(DVec3::new(1.0, 1.0, 3.0)),
        DMat3::from_diagonal(DVec3::new(-1.0, -1.0, 1.0)),
        DMat3::from_cols(DVec3::new(100.0, 1.0, 0.0), DVec3::Y * 100.0, DVec3::Z * 100.0),
        DMat3::IDENTITY * f64::NAN,
    ] {
        let text = refusal(|params| params.inertia_kg_m2 = bad);
        assert!(text.starts_with("inertia_kg_m2"), "{text}");
    }
}

#[test]
fn wheels_and_modes_have_their_limits() {
    let cases: [Case<'_>; 12] = [
        ("at most 6, got 8", &|p| p.wheels.extend(pyramid())),
        ("at most 4, got 5", &|p| p.modes = vec![mode(0.7, 0.01, DVec3::Z); 5]),
        ("wheel 1: length of axis_body = 0", &|p| p.wheels[1].axis_body = DVec3::ZERO),
        ("wheel 2: inertia_kg_m2 = 0", &|p| p.wheels[2].inertia_kg_m2 = 0.0),
        ("wheel 0: coulomb_n_m = -1", &|p| p.wheels[0].coulomb_n_m = -1.0),
        ("initial_speed_rad_s = 700", &|p| p.wheels[0].initial_speed_rad_s = 700.0),
        ("imbalance multiple = 0", &|p| p.wheels[0].imbalance = vec![Harmonic { multiple: 0.0, torque_n_m_s2: 0.0 }]),
        ("mode 0: frequency_hz = -1", &|p| p.modes[0].frequency_hz = -1.0),
        ("mode 0: damping = 1", &|p| p.modes[0].damping = 1.0),
        ("couple more inertia", &|p| p.modes[0].coupling = DVec3::Z * 9.0),
        ("altitude_m = NaN", &|p| p.orbit.altitude_m = f64::NAN),
        ("gain_per_s = -1", &|p| p.unloading.gain_per_s = -1.0),
    ];
    for (wanted, spoil) in cases {
        let text = refusal(spoil);
        assert!(text.contains(wanted), "{text}, wanted {wanted}");
    }
}

#[test]
fn steps_that_would_not_do_are_refused_with_the_reason() {
    let cases: [Case<'_>; 4] = [
        ("the body", &|p| p.step = Span::ZERO),
        ("the body", &|p| p.step = Span::from_ms(101)),
        ("a mode's frequency", &|p| p.modes[0].frequency_hz = 10.0),
        ("a wheel's friction", &|p| p.wheels[0].viscous_n_m_s = 2.0),
    ];
    for (wanted, spoil) in cases {
        let text = refusal(spoil);
        assert!(text.contains(wanted), "{text}, wanted {wanted}");
    }
}

#[test]
fn rates_periods_and_undamped_modes_are_refused_where_they_matter() {
    let rate = Spacecraft::new(&sound(), START, Rotation::IDENTITY, DVec3::NAN, 1).expect_err("refused");
    assert!(rate.to_string().contains("rate_rad_s"), "{rate}");
    let period = MicroVibration::new(&sound(), START, Span::ZERO, 1).expect_err("refused").to_string();
    assert!(period.contains("period: 0 s"), "{period}");
    let mut undamped = sound();
    undamped.modes[0].damping = 0.0;
    let text = MicroVibration::new(&undamped, START, Span::from_ms(1), 1).expect_err("refused").to_string();
    assert!(text.contains("free mode 0: damping = 0"), "{text}");
    assert!(Spacecraft::new(&undamped, START, Rotation::IDENTITY, DVec3::ZERO, 1).is_ok(), "the smooth motion may");
}
