use super::*;
use crate::orbit::{EARTH_GM_KM3_S2, MOON_GM_KM3_S2, SUN_GM_KM3_S2};
use base::time::Span;

/// Gravitational parameter; elements as in [`KeplerElements`]; seconds after the epoch; position, km, and velocity,
/// km/s, by Kepler's equation solved and rotated in 40-digit arithmetic (mpmath 1.3; no universal variable there).
type Case = (f64, [f64; 6], f64, [f64; 3], [f64; 3]);

#[allow(clippy::approx_constant, reason = "an anomaly of 3.14 is not pi")]
#[rustfmt::skip]
const CASES: [Case; 9] = [
    // A low orbit after 1000 s and after 1000 days; a Molniya orbit; a transfer to the Moon; a near-rectilinear lunar
    // orbit; two flybys; the Earth's year, ten times; a comet.
    (EARTH_GM_KM3_S2, [6878.137, 0.001, 1.7, 0.5, 0.3, 0.1], 1000.0, [798.63052645544188, -571.22997338310427, 6805.2227315092681], [-6.6401216358251562, -3.6979931873784466, 0.47603825638298155]),
    (EARTH_GM_KM3_S2, [6878.137, 0.001, 1.7, 0.5, 0.3, 0.1], 86_400_000.0, [-5261.295218904756, -3311.6905278263404, 2954.5913596797831], [-3.3172100435318883, -0.80573435860148664, -6.7980760931326655]),
    (EARTH_GM_KM3_S2, [26600.0, 0.74, 1.1, 4.0, 4.7, 3.0], -30_000.0, [21097.548074632511, 2459.7638024221507, 28211.724785253453], [-0.30516307908368826, 1.4534678401571756, -2.3203775431484376]),
    (EARTH_GM_KM3_S2, [192_000.0, 0.96, 0.9, 2.0, 1.0, 0.01], 700_000.0, [173069.7417185275, -22804.117113705378, -186354.72963654297], [-0.71733687066442328, 0.37272920179865122, 0.62650340031249708]),
    (MOON_GM_KM3_S2, [37000.0, 0.915, 1.57, 0.2, 1.5, 3.14], 280_000.0, [12334.454529616584, 2481.2475353988823, -23470.317079293551], [-0.027803114894733126, -0.0052421612132335757, 0.48467432001382731]),
    (EARTH_GM_KM3_S2, [-20_000.0, 1.4, 0.5, 0.1, 5.0, -2.0], 40_000.0, [83947.267545175833, 134754.68281080129, 68670.620763667858], [1.9499390442972385, 4.0446371425790554, 2.0922083668915965]),
    (SUN_GM_KM3_S2, [150_000_000.0, 0.0167, 2.67e-5, 3.0, 1.8, 0.2], 315_576_000.0, [4734362.8629473492, -147422730.8689, 3878.9568854086732], [30.228461861112687, 0.99833953542704388, -0.00014028685783062228]),
    (SUN_GM_KM3_S2, [-190_000_000.0, 1.2, 2.14, 0.4, 4.4, -1.0], 200_000_000.0, [4865833062.0495762, 51350793.376419906, 2887489314.411081], [23.242469773160169, -0.12365745261573219, 14.323673732856173]),
    (EARTH_GM_KM3_S2, [-2000.0, 4.5, 0.5, 0.1, 5.0, -30.0], 1_000_000.0, [11609051.944019915, 7235200.6832773425, 3299712.6532106777], [11.64361647913381, 7.2661072371391196, 3.3146275056119205]),
];

fn epoch() -> Tai {
    Tai::from_rfc3339("2026-03-01T00:00:00Z").expect("a valid instant")
}

fn after(seconds: f64) -> Tai {
    epoch() + Span::from_s(seconds)
}

fn orbit(gm: f64, elements: [f64; 6]) -> TwoBodyOrbit {
    let [semi_major_axis_km, eccentricity, inclination_rad, raan_rad, argument_of_periapsis_rad, mean_anomaly_rad] =
        elements;
    let elements = KeplerElements {
        semi_major_axis_km,
        eccentricity,
        inclination_rad,
        raan_rad,
        argument_of_periapsis_rad,
        mean_anomaly_rad,
    };
    TwoBodyOrbit::from_elements(epoch(), &elements, gm).expect("a valid orbit")
}

/// Returns the bound of the module doc: shares of distance and of speed, and of the phase.
fn bound(gm: f64, elements: [f64; 6], seconds: f64) -> f64 {
    let phase_rad = elements[5].abs() + (gm / elements[0].abs().powi(3)).sqrt() * seconds.abs();
    1e-11 + 4.0 * f64::EPSILON * phase_rad
}

#[test]
fn agrees_with_forty_digits() {
    for (gm, elements, seconds, position_km, velocity_km_s) in CASES {
        let got = orbit(gm, elements).state(after(seconds));
        let (position_km, velocity_km_s) = (DVec3::from_array(position_km), DVec3::from_array(velocity_km_s));
        let far = got.position_km.distance(position_km) / position_km.length();
        let slip = got.velocity_km_s.distance(velocity_km_s) / velocity_km_s.length();
        println!("e = {}: {far:.1e} of the distance, {slip:.1e} of the speed", elements[1]);
        assert!(far.max(slip) < bound(gm, elements, seconds), "{elements:?} {seconds} s: {far:e}, {slip:e}");
        let other = orbit(gm * (1.0 + 1e-7), elements).state(after(seconds));
        let apart = other.position_km.distance(position_km) / position_km.length();
        assert!(apart > bound(gm, elements, seconds), "control: another mass is seen, {apart:e}");
    }
}

#[test]
fn a_state_on_the_way_gives_the_same_orbit() {
    for (gm, elements, seconds, ..) in CASES {
        let by_elements = orbit(gm, elements);
        let now = by_elements.state(epoch());
        let by_state = TwoBodyOrbit::from_state(epoch(), now.position_km, now.velocity_km_s, gm).expect("valid");
        assert_eq!(by_state.state(epoch()), now, "at its epoch a state is itself");
        for share in [0.01, -0.3, 1.0] {
            let [a, b] = [by_elements, by_state].map(|orbit| orbit.state(after(share * seconds)));
            let apart = a.position_km.distance(b.position_km) / a.position_km.length();
            // The state's 16 digits fix the axis to 1e-15 of r / a of it, the phase to that times the phase, and near
            // the focus of a thin orbit both are seen enlarged.
            assert!(apart < 1e4 * bound(gm, elements, seconds), "{elements:?}: {apart:e} at {share}");
        }
    }
}

#[test]
fn a_published_case() {
    // Vallado, Fundamentals of Astrodynamics and Applications, example 2-4: 40 minutes on.
    let position_km = DVec3::new(1_131.340, -2_282.343, 6_672.423);
    let orbit =
        TwoBodyOrbit::from_state(epoch(), position_km, DVec3::new(-5.643_05, 4.303_33, 2.428_79), 398_600.441_5);
    let got = orbit.expect("valid").state(after(2_400.0));
    let wanted_km = DVec3::new(-4_219.752_7, 4_363.029_2, -3_958.766_6);
    assert!(got.position_km.distance(wanted_km) < 1e-3, "{}", got.position_km);
    assert!(got.velocity_km_s.distance(DVec3::new(3.689_866, -1.916_735, -6.112_511)) < 1e-5, "{}", got.velocity_km_s);
}

/// Returns the position on a parabola in its own axes, by Barker's equation.
fn parabola_km(periapsis_km: f64, gm: f64, since_s: f64) -> DVec3 {
    let w = 1.5 * (gm / (2.0 * periapsis_km.powi(3))).sqrt() * since_s;
    let y = (w + (w * w + 1.0).sqrt()).cbrt();
    let tangent = y - 1.0 / y;
    periapsis_km * DVec3::new(1.0 - tangent * tangent, 2.0 * tangent, 0.0)
}

#[test]
fn the_parabola_lies_between_its_neighbours() {
    let (q_km, gm) = (7_000.0, EARTH_GM_KM3_S2);
    let escape_km_s = (2.0 * gm / q_km).sqrt();
    for seconds in [-200_000.0, 10.0, 5_000.0, 200_000.0] {
        let wanted_km = parabola_km(q_km, gm, seconds);
        for (excess, tolerance) in [(0.0, 1e-11), (1e-13, 1e-10), (-1e-13, 1e-10), (1e-9, 1e-6), (-1e-9, 1e-6)] {
            let velocity = DVec3::Y * (escape_km_s * (1.0 + excess));
            let orbit = TwoBodyOrbit::from_state(epoch(), DVec3::X * q_km, velocity, gm).expect("valid");
            let apart = orbit.state(after(seconds)).position_km.distance(wanted_km) / wanted_km.length();
            assert!(apart < tolerance, "{excess}, {seconds} s: {apart:e}");
        }
    }
    let [thin, open] = [1.0 - 1e-9, 1.0 + 1e-9].map(|e| orbit(gm, [q_km / (1.0 - e), e, 0.0, 0.0, 0.0, 0.0]));
    let wanted_km = parabola_km(q_km, gm, 200_000.0);
    for orbit in [thin, open] {
        assert!(orbit.state(after(200_000.0)).position_km.distance(wanted_km) < 1e-6 * wanted_km.length());
        assert!((orbit.periapsis_km() - q_km).abs() < 1e-5, "{}", orbit.periapsis_km());
    }
    assert!(thin.period_s().is_some() && open.period_s().is_none(), "one side of the parabola returns");
}

#[test]
fn energy_and_momentum_are_kept_everywhere() {
    for (gm, elements, seconds, ..) in CASES {
        let orbit = orbit(gm, elements);
        let of = |s: BarycentricState| {
            let energy = s.velocity_km_s.length_squared() / 2.0 - gm / s.position_km.length();
            (energy, s.position_km.cross(s.velocity_km_s))
        };
        let (energy, momentum) = of(orbit.state(epoch()));
        for i in -40..=40 {
            let state = orbit.state(after(seconds * f64::from(i) / 20.0));
            let (e, l) = of(state);
            let scale = gm / state.position_km.length();
            assert!((e - energy).abs() < 1e-10 * scale.max(energy.abs()), "{elements:?} {i}: {e} for {energy}");
            assert!(l.distance(momentum) < 1e-10 * momentum.length(), "{elements:?} {i}: {l} for {momentum}");
            assert!(state.velocity_km_s.length() <= orbit.fastest_km_s() * (1.0 + 1e-9), "{elements:?} {i}");
            assert!(state.position_km.length() >= orbit.periapsis_km() * (1.0 - 1e-9), "{elements:?} {i}");
        }
    }
}

#[test]
fn both_sides_of_the_series_meet() {
    for z in [SERIES_BELOW, -SERIES_BELOW] {
        let [below, above] = [z * (1.0 - 1e-12), z].map(stumpff);
        for (a, b) in below.into_iter().zip(above) {
            assert!((a - b).abs() < 2e-12, "{a} {b} at {z}");
        }
    }
    assert_eq!(stumpff(0.0), [1.0, 0.5, 1.0 / 6.0]);
}

#[test]
fn bad_orbits_are_named() {
    let state = |r: DVec3, v: DVec3, gm: f64| TwoBodyOrbit::from_state(epoch(), r, v, gm).map_err(|e| e.to_string());
    let (r, v) = (DVec3::X * 7_000.0, DVec3::Y * 7.5);
    assert!(state(r, v, EARTH_GM_KM3_S2).is_ok());
    let falls = state(r, DVec3::X * -3.0, EARTH_GM_KM3_S2).expect_err("a straight fall");
    assert!(falls.contains("in one line"), "{falls}");
    assert!(state(r, DVec3::ZERO, EARTH_GM_KM3_S2).is_err(), "from rest, likewise");
    let fast = state(r, DVec3::Y * 2_998.1, EARTH_GM_KM3_S2).expect_err("a hundredth of c");
    assert!(fast.contains("velocity_km_s") && fast.contains("2998"), "{fast}");
    assert!(state(r, DVec3::Y * 2_998.0, EARTH_GM_KM3_S2).is_ok(), "the last one accepted");
    for (r, v, gm) in [(DVec3::ZERO, v, 1.0), (DVec3::NAN, v, 1.0), (r, v * f64::INFINITY, 1.0), (r, v, -1.0)] {
        assert!(state(r, v, gm).is_err(), "{r} {v} {gm}");
    }
    let valid = KeplerElements {
        semi_major_axis_km: 7_000.0,
        eccentricity: 0.01,
        inclination_rad: 1.0,
        raan_rad: 0.0,
        argument_of_periapsis_rad: 0.0,
        mean_anomaly_rad: 0.0,
    };
    let elements = |e: &KeplerElements| TwoBodyOrbit::from_elements(epoch(), e, EARTH_GM_KM3_S2);
    assert!(elements(&valid).is_ok());
    for wrong in [
        KeplerElements { eccentricity: 1.0, ..valid },
        KeplerElements { eccentricity: 1.2, ..valid },
        KeplerElements { eccentricity: -0.1, ..valid },
        KeplerElements { semi_major_axis_km: -7_000.0, ..valid },
        KeplerElements { raan_rad: f64::NAN, ..valid },
        KeplerElements { mean_anomaly_rad: f64::INFINITY, ..valid },
    ] {
        assert!(elements(&wrong).is_err(), "{wrong:?}");
    }
    let parabola = elements(&KeplerElements { eccentricity: 1.0, ..valid }).expect_err("no axis").to_string();
    assert!(parabola.contains("eccentricity") && parabola.contains("above 0"), "{parabola}");
}
