//! Values between the rows: methods, their bounds on both sides, gaps.

use super::*;
use crate::attitude_methods::AttitudeInterpolation as Method;
use crate::{AttitudeHistory, AttitudeSegment, Times};

fn history(states: Vec<AttitudeState>, method: Method) -> AttitudeHistory {
    let segment = AttitudeSegment::new(states, method, [None; 2]).unwrap();
    AttitudeHistory::new("test", Times::Absolute, vec![segment]).unwrap()
}

/// Returns the largest error of a history against its motion, rad, rad/s and rad/s^2.
fn errors(history: &AttitudeHistory, motion: impl Fn(f64) -> (Rotation<Body, Icrf>, DVec3)) -> [f64; 3] {
    let [first, last] = history.span_ns();
    let count = 4001;
    (0..count).fold([0.0; 3], |worst: [f64; 3], i| {
        let t_ns = first + (last - first) / (count - 1) * i;
        let t_s = (t_ns - first) as f64 * 1e-9;
        let (wanted, rate) = motion(t_s);
        let got = history.at_ns(t_ns).unwrap();
        let acceleration = (motion(t_s + 1e-4).1 - motion(t_s - 1e-4).1) / 2e-4;
        let errors = [
            angle(&got.body_from_icrf, &wanted),
            (got.rate_rad_s - rate).length(),
            (got.acceleration_rad_s2 - acceleration).length(),
        ];
        core::array::from_fn(|n| worst[n].max(errors[n]))
    })
}

/// Returns a body that swings about one axis and spins about another: rates change in all axes.
fn swing(t_s: f64) -> (Rotation<Body, Icrf>, DVec3) {
    let spin = turned(DVec3::Z * 0.3 * t_s);
    let angle = 0.4 * (1.1 * t_s).sin();
    let body = spin.rotated_by(DVec3::X * angle);
    // The spin, seen in axes that the swing has turned.
    let rate = Rotation::<Body, Icrf>::from_rotation_vector(DVec3::X * angle).apply(DVec3::Z * 0.3);
    (body, rate + DVec3::X * 0.44 * (1.1 * t_s).cos())
}

/// Returns a turn that accelerates evenly about y.
fn accelerated(t_s: f64) -> (Rotation<Body, Icrf>, DVec3) {
    (turned(DVec3::Y * 0.15 * t_s * t_s), DVec3::Y * 0.3 * t_s)
}

#[test]
fn slerp_errs_by_an_eighth_of_the_acceleration_times_the_step_squared() {
    let step_s = 0.1;
    let table = history(sampled(50, step_s, accelerated), Method::Slerp);
    let ([error, ..], bound) = (errors(&table, accelerated), 0.3 * step_s * step_s / 8.0);
    assert!(error <= bound * (1.0 + 1e-6) && error > 0.9 * bound, "{error} rad, bound {bound} rad");
    // The error shown by the file itself: steps twice as long, four times the error.
    let shown = table.interpolation_error_rad().unwrap();
    assert!((shown / bound - 4.0).abs() < 0.01, "{shown}");
}

#[test]
fn cubics_with_rates_are_of_fourth_order_and_their_error_shows() {
    let of = |step_s: f64| history(sampled((10.0 / step_s) as u32, step_s, swing), Method::CubicHermite);
    let [coarse, fine] = [of(0.2), of(0.1)];
    let [[coarse_rad, ..], [fine_rad, fine_rate, fine_acceleration]] = [errors(&coarse, swing), errors(&fine, swing)];
    assert!((14.0..18.0).contains(&(coarse_rad / fine_rad)), "{coarse_rad} and {fine_rad} rad");
    assert!(fine_rate < 1e-4 && fine_acceleration < 5e-3, "{fine_rate} rad/s, {fine_acceleration} rad/s^2");
    let shown = fine.interpolation_error_rad().unwrap();
    assert!(fine_rad < shown && shown < 20.0 * fine_rad, "{shown} for {fine_rad}");
    let [slerp, ..] = errors(&history(sampled(100, 0.1, swing), Method::Slerp), swing);
    assert!(slerp > shown, "control: without rates it is worse, {slerp}");
}

#[test]
fn a_turn_at_a_constant_rate_about_any_axis_is_exact() {
    let rate = DVec3::new(0.3, -0.2, 0.5);
    let motion = |t_s: f64| (turned(rate * t_s), rate);
    for method in [Method::Slerp, Method::CubicHermite] {
        let [rad, rad_s, rad_s2] = errors(&history(sampled(20, 1.0, motion), method), motion);
        assert!(rad < 1e-13 && rad_s < 1e-13 && rad_s2 < 1e-9, "{method}: {rad} {rad_s} {rad_s2}");
    }
}

#[test]
fn higher_degrees_follow_better_and_their_rates_too() {
    let of = |degree: usize| errors(&history(sampled(60, 0.2, swing), Method::Lagrange(degree)), swing);
    let [three, seven] = [of(3), of(7)];
    assert!(seven[0] < 0.05 * three[0] && seven[1] < 0.05 * three[1], "{three:?} {seven:?}");
    assert!(seven[0] < 1e-5 && seven[1] < 2e-4 && seven[2] < 5e-3, "{seven:?}");
}

#[test]
fn the_sign_of_a_quaternion_does_not_matter() {
    let mut states = sampled(60, 0.2, swing);
    let plain = history(states.clone(), Method::Lagrange(5));
    for state in states.iter_mut().step_by(3) {
        state.body_from_icrf = Rotation::from_quat(-state.body_from_icrf.quat());
    }
    let flipped = history(states, Method::Lagrange(5));
    let [first, last] = plain.span_ns();
    for t_ns in (first..last).step_by(70_000_001) {
        let [a, b] = [&plain, &flipped].map(|history| history.at_ns(t_ns).unwrap());
        assert!(angle(&a.body_from_icrf, &b.body_from_icrf) < 1e-14);
        assert!((a.rate_rad_s - b.rate_rad_s).length() < 1e-13);
    }
}

#[test]
fn gaps_and_ends_have_no_attitude() {
    let second = AEM_2.split_once("META_START").unwrap().1;
    let second = second.replace("T00:00:00", "T00:01:00").replace("T00:00:10", "T00:01:10");
    let history = attitudes(&format!("{AEM_2}META_START{second}"));
    assert_eq!(history.segments().len(), 2);
    let at = |text: &str| history.at(utc(text)).is_some();
    for (text, wanted) in [
        ("2026-02-28T23:59:59.999Z", false),
        ("2026-03-01T00:00:00Z", true),
        ("2026-03-01T00:00:10Z", true),
        ("2026-03-01T00:00:10.001Z", false),
        ("2026-03-01T00:00:59.999Z", false),
        ("2026-03-01T00:01:00Z", true),
        ("2026-03-01T00:01:10.001Z", false),
    ] {
        assert_eq!(at(text), wanted, "{text}");
    }
    let usable = AEM_2.replace("STOP_TIME", "USEABLE_START_TIME = 2026-03-01T00:00:05\nSTOP_TIME");
    let history = attitudes(&usable);
    assert!(history.at(utc("2026-03-01T00:00:04Z")).is_none() && history.at(utc("2026-03-01T00:00:06Z")).is_some());
}

#[test]
fn a_table_with_a_column_of_segments_has_gaps() {
    let history = attitudes("t_s,w,x,y,z,segment\n0,1,0,0,0,1\n1,1,0,0,0,1\n5,1,0,0,0,2\n6,1,0,0,0,2\n");
    assert!(history.at_ns(1_000_000_000).is_some() && history.at_ns(3_000_000_000).is_none());
}

#[test]
fn rate_and_acceleration_show_in_differences_of_rows() {
    let [rate, acceleration, jerk] = history(sampled(51, 0.1, accelerated), Method::Slerp).motion_limits();
    assert!(
        (rate - 0.3 * 4.95).abs() < 1e-9 && (acceleration - 0.3).abs() < 1e-6 && jerk < 1e-4,
        "{rate} {acceleration} {jerk}"
    );
}
