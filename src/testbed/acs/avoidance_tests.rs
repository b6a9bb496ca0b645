//! Random slews past the Sun, sampled densely: no path enters the cone; the shortest turns do.

use super::avoidance::KeepOut;
use super::slew::{Leg, SlewLimits, SlewPath};
use base::axes::{Body, Icrf, Rotation};
use base::units::DEG;
use glam::{DQuat, DVec3};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};

const LIMITS: SlewLimits = SlewLimits { largest_rate_rad_s: 0.02, largest_acceleration_rad_s2: 0.002 };
const KEEP_OUT: KeepOut =
    KeepOut { boresight_body: DVec3::new(0.2, 0.0, 1.0), half_angle_rad: 40.0 * DEG, margin_rad: 3.0 * DEG };
const CASES: u32 = 1000;
const SAMPLES: u32 = 600;
/// Error between dense samples: half a sample's turn, squared, over the path's curvature; and rounding.
const SAMPLED_RAD: f64 = 1e-6;

struct Case {
    start: Rotation<Body, Icrf>,
    end: Rotation<Body, Icrf>,
    sun: DVec3,
}

fn attitude(random: &mut StdRng) -> Rotation<Body, Icrf> {
    loop {
        let q = DQuat::from_array(core::array::from_fn(|_| random.random::<f64>() * 2.0 - 1.0));
        if (0.01..1.0).contains(&q.length_squared()) {
            return Rotation::from_quat(q);
        }
    }
}

/// Returns the cosine of the Sun's angle, written without the module's functions.
fn cosine(attitude: &Rotation<Body, Icrf>, sun: DVec3) -> f64 {
    attitude.apply(sun).dot(KEEP_OUT.boresight_body.normalize())
}

/// Ends outside the cone; every other case has them outside the margin too.
fn cases() -> Vec<Case> {
    let mut random = StdRng::seed_from_u64(11);
    let mut found = Vec::new();
    while found.len() < CASES as usize {
        let (start, end) = (attitude(&mut random), attitude(&mut random));
        let sun = attitude(&mut random).apply(DVec3::X);
        let least = if found.len() % 2 == 0 { 43.0 * DEG } else { 40.0 * DEG };
        if cosine(&start, sun) < least.cos() && cosine(&end, sun) < least.cos() {
            found.push(Case { start, end, sun });
        }
    }
    found
}

fn sampled_closest(path: &SlewPath, sun: DVec3) -> f64 {
    let at = |k: u32| path.duration_s() * f64::from(k) / f64::from(SAMPLES);
    (0..=SAMPLES).map(|k| cosine(&path.reference(at(k)).body_from_icrf, sun)).fold(-1.0, f64::max).acos()
}

#[test]
fn no_path_enters_the_cone_and_the_shortest_turns_do() {
    let (mut entered, mut legs) = (0, [0; 4]);
    for (k, case) in cases().iter().enumerate() {
        let path = KEEP_OUT.path(case.start, &case.end, case.sun, &LIMITS);
        let closest = sampled_closest(&path, case.sun);
        let ends = cosine(&case.start, case.sun).max(cosine(&case.end, case.sun)).acos();
        let wanted = (KEEP_OUT.half_angle_rad + KEEP_OUT.margin_rad).min(ends);
        assert!(closest >= wanted - SAMPLED_RAD, "case {k}: {} deg for {}", closest / DEG, wanted / DEG);
        let apart = path.end().rotation_vector_to(&case.end).length();
        assert!(apart < 1e-9, "case {k} ends {apart} rad away");
        legs[path.legs().len()] += 1;
        let direct = SlewPath::single(Leg::between(case.start, &case.end, &LIMITS));
        entered += u32::from(sampled_closest(&direct, case.sun) < KEEP_OUT.half_angle_rad);
    }
    assert!(entered > CASES / 20, "the shortest turns must enter the cone now and then: {entered}");
    assert!(legs[1] > 0 && legs[2] as u32 > entered / 2, "paths by turns: {legs:?}");
}

#[test]
fn the_closest_approach_is_that_of_dense_samples() {
    for case in cases() {
        let leg = Leg::between(case.start, &case.end, &LIMITS);
        let got = KEEP_OUT.closest_approach_rad(&leg, case.sun);
        let sampled = sampled_closest(&SlewPath::single(leg), case.sun);
        // Samples are up to 0.4 deg apart; the minimum is missed by the square of half of that.
        assert!(got <= sampled + 1e-9 && sampled - got < 5e-4, "{got} for {sampled}");
    }
}

#[test]
fn a_start_inside_the_cone_is_left_by_the_nearest_way() {
    let start = Rotation::IDENTITY;
    let sun = KEEP_OUT.boresight_body.normalize();
    for turn in [DVec3::Y * 1.5, DVec3::X * -1.5, DVec3::Z * 1.0] {
        let end = start.rotated_by(turn);
        let path = KEEP_OUT.path(start, &end, sun, &LIMITS);
        assert!(path.end().rotation_vector_to(&end).length() < 1e-9, "{turn}");
    }
    // Boresight opposite the Sun at one end: the azimuth is free there.
    let end = start.rotated_by(DVec3::Y * 1.0);
    let path = KEEP_OUT.path(start, &end, -sun, &LIMITS);
    assert_eq!(path.legs().len(), 1, "far from the Sun the shortest turn is taken");
}

#[test]
fn the_way_around_at_constant_angle_always_exists() {
    // A cone so wide that only a thin ring is left: waypoints cannot help, the ring can.
    let wide = KeepOut { half_angle_rad: 150.0 * DEG, margin_rad: 10.0 * DEG, ..KEEP_OUT };
    let mut random = StdRng::seed_from_u64(3);
    let mut several = 0;
    for _ in 0..300 {
        let sun = attitude(&mut random).apply(DVec3::X);
        let (start, end) = (attitude(&mut random), attitude(&mut random));
        let path = wide.path(start, &end, sun, &LIMITS);
        let least = 160.0 * DEG;
        let ends = cosine(&start, sun).max(cosine(&end, sun)).acos().min(least);
        assert!(sampled_closest(&path, sun) >= ends - SAMPLED_RAD, "{}", sampled_closest(&path, sun) / DEG);
        several += u32::from(path.legs().len() == 3);
    }
    assert!(several > 0, "three turns must be needed now and then");
}
