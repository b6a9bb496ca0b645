use super::*;
use base::{time::Span, units::DEG};

const ZERO: Tai = Tai::from_ns(5_000_000_000);
/// Step of the central differences.
const STEP_S: f64 = 1e-4;

/// Returns the largest differences of rate and acceleration from the central differences of attitude and rate.
fn differences(at_s: impl Fn(f64) -> AttitudeMotion, t_s: f64) -> [f64; 2] {
    let (before, now, later) = (at_s(t_s - STEP_S), at_s(t_s), at_s(t_s + STEP_S));
    let turned = before.body_from_icrf.rotation_vector_to(&later.body_from_icrf) / (2.0 * STEP_S);
    let change = (later.rate_rad_s - before.rate_rad_s) / (2.0 * STEP_S);
    [(turned - now.rate_rad_s).length(), (change - now.acceleration_rad_s2).length()]
}

fn steady() -> SteadyMotion {
    let swing =
        |axis_body, amplitude_rad, frequency_hz, phase_rad| Swing { axis_body, amplitude_rad, frequency_hz, phase_rad };
    SteadyMotion {
        initial: Rotation::from_wxyz([0.5, -0.5, 0.5, 0.5], 1e-9).unwrap(),
        zero: ZERO,
        rate_rad_s: DVec3::new(0.02, -0.05, 0.1),
        swings: vec![swing(DVec3::X * 3.0, 0.03, 0.4, 0.2), swing(DVec3::new(0.0, 1.0, 1.0), 0.02, 1.1, -1.0)],
    }
}

#[test]
fn steady_motion_has_the_derivatives_it_says() {
    let motion = steady();
    let at_s = |t_s: f64| motion.at(ZERO + Span::from_s(t_s));
    for t_s in [-3.0, 0.0, 0.7, 12.3] {
        let [rate, acceleration] = differences(at_s, t_s);
        // Fourth derivative 60 rad/s^4 at most (1.1 Hz), times the step squared over 6, and rounding.
        assert!(rate < 2e-8 && acceleration < 1.2e-7, "{t_s} s: {rate:.1e}, {acceleration:.1e}");
    }
    let wrong = SteadyMotion { rate_rad_s: -motion.rate_rad_s, ..motion.clone() };
    let mixed = |t_s: f64| AttitudeMotion {
        rate_rad_s: wrong.at(ZERO + Span::from_s(t_s)).rate_rad_s,
        ..motion.at(ZERO + Span::from_s(t_s))
    };
    assert!(differences(mixed, 0.7)[0] > 0.1, "negative control");
}

#[test]
fn one_rate_and_one_sinusoid_about_an_axis_add_up_by_hand() {
    let swing = Swing { axis_body: DVec3::Y, amplitude_rad: 0.1, frequency_hz: 0.25, phase_rad: 0.3 };
    let motion =
        SteadyMotion { initial: Rotation::IDENTITY, zero: ZERO, rate_rad_s: DVec3::Y * 0.01, swings: vec![swing] };
    for t_s in [-7.0_f64, 0.0, 1.0, 3.3] {
        let (w, phase) = (0.5 * PI, 0.5 * PI * t_s + 0.3);
        let truth = motion.at(ZERO + Span::from_s(t_s));
        let wanted = Rotation::IDENTITY.rotated_by(DVec3::Y * (0.01 * t_s + 0.1 * phase.sin()));
        assert!(truth.body_from_icrf.rotation_vector_to(&wanted).length() < 1e-12, "{t_s} s");
        assert!((truth.rate_rad_s - DVec3::Y * (0.01 + 0.1 * w * phase.cos())).length() < 1e-12, "{t_s} s");
        assert!((truth.acceleration_rad_s2 + DVec3::Y * (0.1 * w * w * phase.sin())).length() < 1e-12, "{t_s} s");
    }
}

fn turned(x: f64, y: f64, z: f64) -> Rotation<Body, Icrf> {
    Rotation::from_wxyz([0.8, 0.0, 0.6, 0.0], 1e-9).unwrap().rotated_by(DVec3::new(x, y, z) * DEG)
}

fn waypoints() -> Vec<Waypoint> {
    let pointings =
        [turned(0.0, 0.0, 0.0), turned(40.0, 10.0, 0.0), turned(90.0, -30.0, 50.0), turned(90.0, -30.0, 50.0)];
    [-2.0, 3.0, 11.0, 14.0].into_iter().zip(pointings).chain([(15.0, turned(91.0, -30.0, 50.0))]).collect()
}

#[test]
fn waypoints_are_met_and_the_path_between_them_is_smooth() {
    for at_waypoints in [AtWaypoints::Stop, AtWaypoints::Pass] {
        let motion = WaypointMotion::new(&waypoints(), at_waypoints).unwrap();
        for (t_s, attitude) in waypoints() {
            let [before, after] = [t_s - 1e-9, t_s + 1e-9].map(|t_s| motion.at_s(t_s));
            assert!(after.body_from_icrf.rotation_vector_to(&attitude).length() < 1e-8, "{t_s} s");
            assert!(
                (before.rate_rad_s - after.rate_rad_s).length() < 1e-8,
                "{at_waypoints:?}, {t_s} s: the rate steps"
            );
            let step = (before.acceleration_rad_s2 - after.acceleration_rad_s2).length();
            assert!(step < 1e-7, "{at_waypoints:?}, {t_s} s: the acceleration steps by {step}");
        }
        for t_s in [-1.7, 0.0, 2.9, 3.5, 7.0, 10.8, 12.0, 14.5] {
            let [rate, acceleration] = differences(|t_s| motion.at_s(t_s), t_s);
            assert!(rate < 1e-7 && acceleration < 1e-7, "{at_waypoints:?}, {t_s} s: {rate:.1e}, {acceleration:.1e}");
        }
        for t_s in [-100.0, 12.5, 100.0] {
            assert!(motion.at_s(t_s).rate_rad_s.length() < 1e-15, "{t_s} s: it rests");
        }
        let passes = motion.at_s(3.0).rate_rad_s.length() > 0.05;
        assert_eq!(passes, at_waypoints == AtWaypoints::Pass);
    }
}

/// Least jerk from rest to rest by its textbook polynomial, 10 s^3 - 15 s^4 + 6 s^5.
#[test]
fn a_stop_to_stop_turn_is_the_one_of_least_jerk() {
    let motion =
        WaypointMotion::new(&[(0.0, Rotation::IDENTITY), (4.0, turned_about_z(0.5))], AtWaypoints::Stop).unwrap();
    for t_s in [0.3_f64, 1.0, 2.0, 3.9] {
        let s = t_s / 4.0;
        let angle_rad = 0.5 * (10.0 * s.powi(3) - 15.0 * s.powi(4) + 6.0 * s.powi(5));
        let rate = 0.5 / 4.0 * (30.0 * s.powi(2) - 60.0 * s.powi(3) + 30.0 * s.powi(4));
        let truth = motion.at_s(t_s);
        assert!(truth.body_from_icrf.rotation_vector_to(&turned_about_z(angle_rad)).length() < 1e-12, "{t_s} s");
        assert!((truth.rate_rad_s - DVec3::Z * rate).length() < 1e-12, "{t_s} s");
    }
    let [rate, acceleration, jerk] = motion.extremes();
    // 15/8, 10/sqrt 3 and 60 times the angle over powers of the time.
    for (bound, exact) in [(rate, 1.875 * 0.125), (acceleration, 5.7735 * 0.03125), (jerk, 60.0 * 0.007_812_5)] {
        assert!(bound >= exact && bound < 1.35 * exact, "{bound} for {exact}");
    }
}

fn turned_about_z(angle_rad: f64) -> Rotation<Body, Icrf> {
    Rotation::IDENTITY.rotated_by(DVec3::Z * angle_rad)
}

#[test]
fn extremes_bound_every_instant_and_are_not_idle() {
    let motion = WaypointMotion::new(&waypoints(), AtWaypoints::Pass).unwrap();
    let bounds = motion.extremes();
    let mut most = [0.0_f64; 3];
    for i in 0..17_000 {
        let t_s = -2.0 + f64::from(i) * 1e-3;
        let (now, later) = (motion.at_s(t_s), motion.at_s(t_s + 1e-4));
        let jerk = (later.acceleration_rad_s2 - now.acceleration_rad_s2).length() / 1e-4;
        let found = [now.rate_rad_s.length(), now.acceleration_rad_s2.length(), jerk];
        most = core::array::from_fn(|order| most[order].max(found[order]));
    }
    for order in 0..3 {
        assert!(most[order] <= bounds[order] && most[order] > 0.5 * bounds[order], "{order}: {most:?}, {bounds:?}");
    }
}

#[test]
fn waypoints_that_are_no_path_are_refused() {
    let refused = |waypoints: &[Waypoint]| WaypointMotion::new(waypoints, AtWaypoints::Stop).unwrap_err();
    assert_eq!(refused(&waypoints()[..1]), WaypointError::TooFew { got: 1 });
    assert_eq!(refused(&[waypoints()[1], waypoints()[0]]), WaypointError::NotRising { place: 1 });
    let half = [(0.0, Rotation::IDENTITY), (1.0, turned_about_z(PI))];
    assert_eq!(refused(&half), WaypointError::TooFar { place: 1 });
}
