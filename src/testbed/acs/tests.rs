//! The control closed around a rigid body with wheels, knowledge perfect.

use super::laws::{Gains, error_to_direction, limited};
use super::mode_logic::{Cause, Mode};
use super::params::AcsParams;
use super::test_body::{KEEP_OUT, PERIOD, TestBody, inertia, params, run, start};
use super::{control::Acs, filter::StructuralFilter, params::Command};
use base::axes::{Body, Icrf, Rotation};
use base::units::{ARCSEC, DEG};
use base::{refused::Refused, time::Span};
use core::f64::consts::{PI, TAU};
use glam::DVec3;

/// Returns the fine pointing at rest on the body's attitude.
fn settled(params: AcsParams, body: &mut TestBody) -> Acs {
    let mut acs = Acs::new(params, start()).expect("settings in range");
    acs.command(Command::Point(body.attitude)).expect("accepted");
    run(&mut acs, body, 30.0, |_, _| {});
    assert_eq!(acs.mode(), Mode::FinePointing, "settled");
    acs
}

fn off_target(body: &TestBody, target: &Rotation<Body, Icrf>) -> DVec3 {
    body.attitude.rotation_vector_to(target)
}

/// Returns the overshoot and time of the first peak after a step of the target about `axis`.
fn step_response(gains: Gains, axis: DVec3) -> (f64, f64, f64) {
    let mut body = TestBody::new(DVec3::ZERO);
    let mut acs = settled(AcsParams { fine: gains, ..params() }, &mut body);
    let step_rad = 0.1 * DEG;
    let target = body.attitude.rotated_by(axis * step_rad);
    acs.command(Command::Point(target)).expect("accepted");
    let begun = body.at;
    let (mut peak, mut peak_s, mut across) = (0.0, 0.0, 0.0_f64);
    run(&mut acs, &mut body, 0.8 / gains.bandwidth_hz, |body, _| {
        let left = off_target(body, &target) / step_rad;
        let beyond = -left.dot(axis);
        across = across.max((left - axis * left.dot(axis)).length());
        if beyond > peak {
            (peak, peak_s) = (beyond, (body.at - begun).s());
        }
    });
    (peak, peak_s, across)
}

#[test]
fn a_step_overshoots_as_a_second_order_loop_does() {
    for (bandwidth_hz, damping) in [(0.03, 0.4), (0.05, 0.5), (0.02, 0.6)] {
        let axis = DVec3::new(1.0, -2.0, 2.0) / 3.0;
        let (peak, peak_s, across) = step_response(Gains { bandwidth_hz, damping, integral_s: None }, axis);
        let root = (1.0_f64 - damping * damping).sqrt();
        let wanted = (-PI * damping / root).exp();
        let wanted_s = PI / (TAU * bandwidth_hz * root);
        // Half a control period of delay takes w T / 2 off the phase: up to 0.01 in damping, 0.03 in the overshoot.
        assert!((peak - wanted).abs() < 0.03, "overshoot {peak} for {wanted}");
        assert!((peak_s / wanted_s - 1.0).abs() < 0.03, "peak after {peak_s} s for {wanted_s} s");
        assert!(across < 0.01, "the turn leaves its eigen-axis by {across} of the step");
        let other = (-PI * (damping + 0.1) / (1.0 - (damping + 0.1).powi(2)).sqrt()).exp();
        assert!((peak - other).abs() > 0.03, "another damping must differ");
    }
}

#[test]
fn a_slew_ends_on_its_target_within_the_torque() {
    let mut body = TestBody::new(DVec3::ZERO);
    let mut acs = settled(params(), &mut body);
    let momentum = body.momentum_icrf();
    let target = body.attitude.rotated_by(DVec3::new(0.5, -0.8, 0.3));
    acs.command(Command::SlewTo(target)).expect("accepted");
    let (mut most, mut fastest, mut behind) = (0.0_f64, 0.0_f64, 0.0_f64);
    let events = run(&mut acs, &mut body, 120.0, |body, output| {
        most = most.max(output.torque_n_m.abs().max_element());
        fastest = fastest.max(body.rate.length());
        behind = behind.max(output.error_rad.length());
    });
    let changes: Vec<_> = events.iter().map(|event| (event.to, event.cause)).collect();
    assert_eq!(changes, [(Mode::Slew, Cause::Commanded), (Mode::FinePointing, Cause::Settled)]);
    let (begun, path) = *acs.slew().expect("made");
    let duration_s = (events[1].at - begun).s() - params().thresholds.fine_enter_dwell.s();
    assert!((duration_s - path.duration_s()).abs() < 0.2, "{duration_s} s for {} s", path.duration_s());
    assert!(most <= 0.1 * (1.0 + 1e-12) && most > 0.005, "torque {most}");
    assert!(fastest < 1.02 * DEG, "rate {} deg/s", fastest / DEG);
    // The held torque is half a period late behind the profile.
    assert!(behind < 60.0 * ARCSEC, "behind by {} arcsec", behind / ARCSEC);
    let left = off_target(&body, &target).length();
    assert!(left < 0.1 * ARCSEC, "{} arcsec off", left / ARCSEC);
    let drift = (body.momentum_icrf() - momentum).length();
    assert!(drift < 1e-4, "the test's own body must keep its momentum: {drift}");
}

#[test]
fn from_tumbling_to_fine_pointing() {
    let mut body = TestBody::new(DVec3::new(3.0, -3.0, 2.6) * DEG);
    body.tracker_works = false;
    let mut acs = Acs::new(AcsParams { largest_torque_n_m: 0.05, ..params() }, start()).expect("settings in range");
    let target = body.attitude.rotated_by(DVec3::new(0.0, 2.0, 0.0));
    acs.command(Command::Point(target)).expect("accepted");
    let mut most = 0.0_f64;
    let mut torque = |output: DVec3| most = most.max(output.abs().max_element());
    let mut events = run(&mut acs, &mut body, 20.0, |_, output| torque(output.torque_n_m));
    assert!(body.rate.length() < 5.0 * DEG, "the rate falls");
    body.tracker_works = true;
    events.extend(run(&mut acs, &mut body, 480.0, |_, output| torque(output.torque_n_m)));
    let changes: Vec<_> = events.iter().map(|event| (event.to, event.cause)).collect();
    assert_eq!(
        changes,
        [
            (Mode::CoarsePointing, Cause::RateLow),
            (Mode::Slew, Cause::FarFromTarget),
            (Mode::FinePointing, Cause::Settled),
        ]
    );
    assert!(most <= 0.05 * (1.0 + 1e-12) && most > 0.0499, "the limit is met and kept: {most}");
    assert!(off_target(&body, &target).length() < 1.0 * ARCSEC, "{}", off_target(&body, &target));
}

#[test]
fn a_lost_attitude_leads_to_coarse_then_safe_and_back() {
    let mut body = TestBody::new(DVec3::ZERO);
    body.sun = Some(DVec3::new(0.3, 0.9, 0.1).normalize());
    let mut acs = settled(params(), &mut body);
    let target = body.attitude;
    let lost_at = body.at;
    body.tracker_works = false;
    let events = run(&mut acs, &mut body, 400.0, |_, _| {});
    let changes: Vec<_> = events.iter().map(|event| ((event.at - lost_at).ms(), event.to, event.cause)).collect();
    // 2 s to coarse pointing; there the 30 s begin at the next step.
    let safe_ms = 2000.0 + PERIOD.ms() + 30_000.0;
    assert_eq!(
        changes,
        [(2000.0, Mode::CoarsePointing, Cause::AttitudeLost), (safe_ms, Mode::Safe, Cause::AttitudeLost)]
    );
    let sun_axis = body.attitude.apply(body.sun.expect("set")).dot(params().safe.sun_axis_body);
    assert!(sun_axis > (0.1 * DEG).cos() && body.rate.length() < 0.01 * DEG, "Sun-pointing: {sun_axis}");
    body.tracker_works = true;
    run(&mut acs, &mut body, 60.0, |_, _| {});
    assert_eq!(acs.mode(), Mode::Safe, "safe mode is left by command only");
    acs.command(Command::Resume).expect("accepted");
    let events = run(&mut acs, &mut body, 300.0, |_, _| {});
    assert_eq!(events[0].to, Mode::RateDamping);
    assert_eq!(acs.mode(), Mode::FinePointing, "{events:?}");
    assert!(off_target(&body, &target).length() < 1.0 * ARCSEC, "back on the target");
}

#[test]
fn without_sun_safe_mode_searches_and_the_opposite_sun_is_found() {
    let mut body = TestBody::new(DVec3::new(0.0, 0.0, 1.0) * DEG);
    let mut acs = Acs::new(params(), start()).expect("settings in range");
    acs.command(Command::Safe).expect("accepted");
    run(&mut acs, &mut body, 300.0, |_, _| {});
    let search = params().safe.search_rate_rad_s;
    assert!((body.rate - search).length() < 0.01 * search.length(), "{}", body.rate);
    body.sun = Some(body.attitude.inverse().apply(-params().safe.sun_axis_body));
    run(&mut acs, &mut body, 800.0, |_, _| {});
    let sun_axis = body.attitude.apply(body.sun.expect("set")).dot(params().safe.sun_axis_body);
    assert!(sun_axis > (0.1 * DEG).cos(), "{sun_axis}");
}

#[test]
fn a_far_target_is_reached_around_the_sun() {
    let mut body = TestBody::new(DVec3::ZERO);
    let target = body.attitude.rotated_by(DVec3::Y * 100.0 * DEG);
    // The Sun is halfway, a little to the side.
    let halfway = body.attitude.rotated_by(DVec3::new(0.05, 50.0 * DEG, 0.0));
    body.sun = Some(halfway.inverse().apply(DVec3::Z));
    let closest = |exclusion, body: &mut TestBody| {
        let mut acs = settled(AcsParams { exclusion, ..params() }, body);
        acs.command(Command::Point(target)).expect("accepted");
        let mut closest = PI;
        run(&mut acs, body, 600.0, |body, _| {
            let sun = body.attitude.apply(body.sun.expect("set"));
            closest = sun.dot(DVec3::Z).clamp(-1.0, 1.0).acos().min(closest);
        });
        assert!(off_target(body, &target).length() < 1.0 * ARCSEC, "reached: {}", off_target(body, &target));
        closest
    };
    let sun = body.sun;
    let kept = closest(Some(KEEP_OUT), &mut body);
    assert!(kept > KEEP_OUT.half_angle_rad, "{} deg", kept / DEG);
    let mut other = TestBody::new(DVec3::ZERO);
    other.sun = sun;
    let straight = closest(None, &mut other);
    assert!(straight < KEEP_OUT.half_angle_rad, "straight it must enter: {} deg", straight / DEG);
}

#[test]
fn impossible_commands_are_refused_with_a_reason() {
    let mut body = TestBody::new(DVec3::ZERO);
    let mut acs = Acs::new(AcsParams { exclusion: Some(KEEP_OUT), ..params() }, start()).expect("in range");
    let slew = Command::SlewTo(body.attitude.rotated_by(DVec3::X));
    assert_eq!(
        acs.command(slew),
        Err(Refused(format!(
            "slew refused in mode {mode:?}, wanted CoarsePointing or FinePointing; try Point, or Resume before",
            mode = Mode::RateDamping
        )))
    );
    run(&mut acs, &mut body, 30.0, |_, _| {});
    assert_eq!(acs.mode(), Mode::FinePointing, "the first attitude is held");
    assert_eq!(
        acs.command(slew),
        Err(Refused(
            "slew refused: the boresight must keep from the Sun, and no direction of the Sun came yet; try later"
                .to_owned()
        ))
    );
    let Command::SlewTo(target) = slew else { unreachable!("made above") };
    body.sun = Some(target.inverse().apply(DVec3::new(0.1, 0.0, 1.0)));
    run(&mut acs, &mut body, 1.0, |_, _| {});
    for command in [slew, Command::Point(target)] {
        let refused = acs.command(command).expect_err("in the cone").to_string();
        assert!(refused.contains("5.71 deg from the Sun, wanted at least 30.00 deg"), "{refused}");
    }
    body.tracker_works = false;
    run(&mut acs, &mut body, 0.3, |_, _| {});
    assert_eq!(acs.command(slew), Err(Refused("slew refused: no attitude is known; try later".to_owned())));
    let bad = AcsParams { largest_torque_n_m: -1.0, ..params() };
    let error = Acs::new(bad, start()).expect_err("negative").to_string();
    assert!(error.contains("largest_torque_n_m is -1"), "{error}");
    let filter = StructuralFilter::LowPass { corner_hz: 7.0, damping: 0.7 };
    assert!(Acs::new(AcsParams { filter, ..params() }, start()).is_err(), "above half the control frequency");
}

#[test]
fn a_point_during_a_slew_ends_it() {
    let mut body = TestBody::new(DVec3::ZERO);
    let mut acs = settled(params(), &mut body);
    let first = body.attitude;
    acs.command(Command::SlewTo(first.rotated_by(DVec3::X * 1.5))).expect("accepted");
    run(&mut acs, &mut body, 60.0, |_, _| {});
    assert_eq!(acs.mode(), Mode::Slew);
    acs.command(Command::Point(first)).expect("accepted");
    let events = run(&mut acs, &mut body, 300.0, |_, _| {});
    let changes: Vec<_> = events.iter().map(|event| (event.to, event.cause)).collect();
    assert_eq!(
        changes,
        [
            (Mode::CoarsePointing, Cause::Commanded),
            (Mode::Slew, Cause::FarFromTarget),
            (Mode::FinePointing, Cause::Settled),
        ]
    );
    assert!(off_target(&body, &first).length() < 1.0 * ARCSEC, "back");
}

#[test]
fn a_command_to_safe_mode_is_not_undone_by_the_next_one() {
    let mut body = TestBody::new(DVec3::ZERO);
    let mut acs = settled(params(), &mut body);
    let far = body.attitude.rotated_by(DVec3::X);
    acs.command(Command::Safe).expect("accepted");
    assert_eq!(
        acs.command(Command::SlewTo(far)),
        Err(Refused(format!(
            "slew refused in mode {mode:?}, wanted CoarsePointing or FinePointing; try Point, or Resume before",
            mode = Mode::Safe
        )))
    );
    acs.command(Command::Point(far)).expect("kept for later");
    let events = run(&mut acs, &mut body, 10.0, |_, output| assert_eq!(output.target, None, "follows no attitude"));
    assert_eq!((acs.mode(), events.len()), (Mode::Safe, 1));
}

#[test]
fn the_integral_takes_a_steady_torque_off_the_error() {
    let left = |integral_s| {
        let mut body = TestBody::new(DVec3::ZERO);
        let gains = Gains { integral_s, ..params().fine };
        let mut acs = settled(AcsParams { fine: gains, ..params() }, &mut body);
        let target = body.attitude;
        body.disturbance = DVec3::new(1e-4, 0.0, -5e-5);
        run(&mut acs, &mut body, 600.0, |_, _| {});
        (off_target(&body, &target), body.disturbance)
    };
    let (without, torque) = left(None);
    let wanted = -(params().fine.of(&inertia()).angle.inverse() * torque);
    assert!((without - wanted).length() < 0.01 * wanted.length(), "{without} for T / kp = {wanted}");
    let (with, _) = left(Some(20.0));
    assert!(with.length() < 0.01 * without.length(), "{with}");
}

#[test]
fn the_integral_does_not_wind_up() {
    let gains = Gains { integral_s: Some(10.0), ..params().coarse };
    let mut body = TestBody::new(DVec3::ZERO);
    let mut acs = settled(AcsParams { coarse: gains, fine: gains, ..params() }, &mut body);
    let target = body.attitude;
    // More than the torque limit for a while: the body is pushed away, then released.
    body.disturbance = DVec3::X * 0.12;
    run(&mut acs, &mut body, 10.0, |_, _| {});
    body.disturbance = DVec3::ZERO;
    run(&mut acs, &mut body, 600.0, |_, _| {});
    assert!(off_target(&body, &target).length() < 10.0 * ARCSEC, "{}", off_target(&body, &target));
    assert_eq!(acs.mode(), Mode::FinePointing);
}

#[test]
fn a_filtered_loop_settles_as_well() {
    let mut body = TestBody::new(DVec3::ZERO);
    let filter = StructuralFilter::Notch { centre_hz: 1.0, width_hz: 0.5 };
    let mut acs = settled(AcsParams { filter, ..params() }, &mut body);
    let target = body.attitude.rotated_by(DVec3::Z * 0.2 * DEG);
    acs.command(Command::Point(target)).expect("accepted");
    run(&mut acs, &mut body, 120.0, |_, _| {});
    assert!(off_target(&body, &target).length() < 1.0 * ARCSEC, "{}", off_target(&body, &target));
}

#[test]
fn unloading_is_asked_for_with_hysteresis() {
    let mut acs = Acs::new(params(), start()).expect("settings in range");
    let body = TestBody::new(DVec3::ZERO);
    let mut asked = Vec::new();
    for (k, momentum) in [0.5, 2.0, 3.1, 2.0, 1.1, 0.9, 2.0].into_iter().enumerate() {
        let at = start() + Span::from_ns(PERIOD.ns() * i64::try_from(k).expect("small"));
        let mut input = body.input();
        input.wheel_momentum_n_m_s = DVec3::Y * momentum;
        asked.push(acs.step(at, &input).unload);
    }
    assert_eq!(asked, [false, false, true, true, true, false, false]);
}

#[test]
fn numbers_that_are_not_finite_do_no_harm() {
    let mut body = TestBody::new(DVec3::ZERO);
    let mut acs = settled(params(), &mut body);
    let mut input = body.input();
    (input.rate_rad_s, input.wheel_momentum_n_m_s) = (DVec3::NAN, DVec3::INFINITY);
    (input.sun_icrf, input.sun_body, input.attitude_sigma_rad) = (Some(DVec3::NAN), Some(DVec3::ZERO), f64::NAN);
    assert!(acs.step(body.at, &input).torque_n_m.is_finite(), "finite torque");
}

#[test]
fn limits_keep_directions_and_directions_turn_the_right_way() {
    let wanted = DVec3::new(0.3, -0.1, 0.2);
    let got = limited(wanted, 0.1);
    assert!((got * 3.0 - wanted).length() < 1e-15 && got.x == 0.1, "{got}");
    assert_eq!(limited(got, 0.1), got, "within the limit nothing changes");
    let (axis, sun) = (DVec3::X, DVec3::new(0.5, 0.5, -1.0).normalize());
    for sun in [sun, -axis, axis] {
        let turned = Rotation::<Body, Body>::IDENTITY.rotated_by(error_to_direction(axis, sun));
        assert!((turned.apply(sun) - axis).length() < 1e-12, "after the turn {sun} lies on the axis");
    }
}
