//! Wheels: exchange of momentum, friction, limits, failures, unloading.

use super::*;
use base::refused::Refused;

fn along_z(params: &mut SpacecraftParams) {
    params.wheels = vec![wheel(DVec3::Z, 0.0)];
}

#[test]
fn spinning_up_a_wheel_turns_the_body_the_other_way() {
    let mut params = bare(DMat3::IDENTITY * 50.0, Span::from_ms(10));
    along_z(&mut params);
    let mut craft = at_rest(&params);
    let start = craft.attitude_at(START).expect("the start").body_from_icrf;
    let got = craft.command_torques(DVec3::Z * 0.05);
    assert!((got - DVec3::Z * 0.05).length() < 1e-9, "{got}");
    craft.advance_to(after(10.0));
    // (J - J_w) w' = T: the body alone.
    let angle = 0.5 * 0.05 / (50.0 - 0.02) * 100.0;
    let turned = start.rotation_vector_to(&craft.attitude_at(after(10.0)).expect("the end").body_from_icrf);
    assert!((turned - DVec3::Z * angle).length() < 1e-9, "{turned} for {angle}");
    let exchanged = 50.0 * craft.state.rate.z + 0.02 * craft.wheel_speeds_rad_s()[0];
    assert!(exchanged.abs() < 1e-12, "{exchanged} N m s");
    assert!(50.0 * craft.state.rate.z - 0.02 * craft.wheel_speeds_rad_s()[0] > 0.1, "negative control: sign");
}

#[test]
fn friction_runs_a_wheel_down_in_closed_form() {
    // A body so heavy that it does not move: W' = -(v W + c) / J_w while W is well above the smoothing.
    let mut params = bare(DMat3::IDENTITY * 1e9, Span::from_ms(10));
    params.wheels = vec![WheelParams { viscous_n_m_s: 2e-4, coulomb_n_m: 1e-3, ..wheel(DVec3::Z, 300.0) }];
    let mut craft = at_rest(&params);
    craft.advance_to(after(100.0));
    let (rate, floor) = (2e-4 / 0.02, 1e-3 / 2e-4);
    let wanted = (300.0 + floor) * f64::exp(-rate * 100.0) - floor;
    let got = craft.wheel_speeds_rad_s()[0];
    assert!((got - wanted).abs() < 1e-6, "{got} for {wanted}");
    craft.advance_to(after(2000.0));
    assert!(craft.wheel_speeds_rad_s()[0].abs() < 1e-6, "it stops: {}", craft.wheel_speeds_rad_s()[0]);
    params.wheels[0].coulomb_n_m = 0.0;
    let mut craft = at_rest(&params);
    craft.advance_to(after(100.0));
    assert!((craft.wheel_speeds_rad_s()[0] - wanted).abs() > 1.0, "negative control: viscous only");
}

#[test]
fn four_wheels_give_any_torque_and_report_when_they_cannot() {
    let params = SpacecraftParams { wheels: pyramid(), ..bare(lopsided(), Span::from_ms(10)) };
    let mut craft = at_rest(&params);
    let wanted = DVec3::new(0.03, -0.05, 0.02);
    assert!((craft.command_torques(wanted) - wanted).length() < 1e-15);
    assert_eq!(craft.command_torques(DVec3::ZERO), DVec3::ZERO);
    let got = craft.command_torques(DVec3::X * 10.0);
    // Four motors of 0.1 N m, each with 1 / sqrt(2.49) along x.
    assert!((got.x - 0.4 / 2.49f64.sqrt()).abs() < 1e-12 && got.y.abs() < 1e-12, "{got}");
}

#[test]
fn a_wheel_at_its_largest_speed_takes_no_more() {
    let mut params = bare(DMat3::IDENTITY * 50.0, Span::from_ms(10));
    along_z(&mut params);
    params.wheels[0].initial_speed_rad_s = 599.0;
    let mut craft = at_rest(&params);
    craft.command_torques(DVec3::Z * -0.1);
    craft.advance_to(after(60.0));
    let speed = craft.wheel_speeds_rad_s()[0];
    // The limiter leaves out the body's own acceleration: J_w / J of the last step's change, 0.05 rad/s.
    assert!((speed - 600.0).abs() < 1e-4, "{speed}");
    assert!(craft.command_torques(DVec3::Z * -0.1).length() < 1e-6, "no more that way");
    assert!((craft.command_torques(DVec3::Z * 0.1).z - 0.1).abs() < 1e-9, "all the other way");
}

#[test]
fn at_its_largest_speed_the_motor_still_makes_up_for_friction() {
    let mut params = bare(DMat3::IDENTITY * 50.0, Span::from_ms(10));
    along_z(&mut params);
    (params.wheels[0].initial_speed_rad_s, params.wheels[0].viscous_n_m_s) = (599.0, 1e-4);
    let mut craft = at_rest(&params);
    craft.command_torques(DVec3::Z * -0.1);
    craft.advance_to(after(60.0));
    // Without it the speed would settle where friction's 0.06 N m take in one step what is left: 0.03 rad/s lower.
    assert!((craft.wheel_speeds_rad_s()[0] - 600.0).abs() < 1e-4, "{}", craft.wheel_speeds_rad_s()[0]);
    let got = craft.command_torques(DVec3::Z * -0.1).z;
    assert!((got + 0.06).abs() < 1e-3, "the motor balances friction, no torque acts on the body: {got}");
}

#[test]
fn with_three_wheels_left_all_torques_remain_and_with_two_a_plane() {
    let params = SpacecraftParams { wheels: pyramid(), ..bare(lopsided(), Span::from_ms(10)) };
    let mut craft = at_rest(&params);
    let wanted = DVec3::new(0.01, -0.02, 0.01);
    craft.fail_wheel(1).expect("a wheel");
    assert!((craft.command_torques(wanted) - wanted).length() < 1e-14, "three");
    craft.fail_wheel(3).expect("a wheel");
    let got = craft.command_torques(wanted);
    let normal = DVec3::new(1.0, 1.0, 0.7).cross(DVec3::new(-1.0, -1.0, 0.7)).normalize();
    let in_plane = wanted - normal * wanted.dot(normal);
    assert!((got - in_plane).length() < 1e-7 * wanted.length(), "two: {got} for {in_plane}");
    let speed = craft.wheel_speeds_rad_s()[1];
    craft.advance_to(after(1.0));
    assert!((craft.wheel_speeds_rad_s()[1] - speed).abs() < 0.01, "a dead wheel coasts with the body");
    for index in [0, 2] {
        craft.fail_wheel(index).expect("a wheel");
    }
    assert_eq!(craft.command_torques(wanted).length(), 0.0, "none");
    assert_eq!(
        craft.fail_wheel(4),
        Err(Refused(format!("wheel {got}: wanted one of the {count}, counted from 0", got = 4, count = 4)))
    );
}

/// Returns the momentum of the whole after `t_s` of unloading.
fn unloaded(is_on: bool, t_s: f64, largest_torque_n_m: f64) -> DVec3 {
    let mut params = bare(DMat3::IDENTITY * 1e9, Span::from_ms(10));
    params.wheels = vec![wheel(DVec3::Z, 300.0)];
    params.unloading = UnloadingParams { gain_per_s: 0.01, largest_torque_n_m };
    let mut craft = at_rest(&params);
    craft.command_unloading(is_on);
    // The controller holds the body: the wheel takes what comes from outside.
    for second in 1..=100 {
        let at = after(t_s * f64::from(second) / 100.0);
        let outside = if is_on { craft.unloading_torque_n_m() } else { DVec3::ZERO };
        craft.command_torques(-outside);
        craft.advance_to(at);
    }
    craft.wheel_momentum_n_m_s()
}

#[test]
fn unloading_takes_momentum_out_at_its_gain_and_limit() {
    assert_eq!(unloaded(false, 100.0, 1.0), DVec3::Z * 6.0);
    // Held for 1 s against a time constant of 100 s: (1 - 0.01)^100.
    let got = unloaded(true, 100.0, 1.0).z;
    assert!((got - 6.0 * 0.99f64.powi(100)).abs() < 1e-3, "{got}");
    let got = unloaded(true, 100.0, 0.01).z;
    assert!((got - 5.0).abs() < 1e-3, "limited to 0.01 N m: {got}");
}
