//! Orbits: every form of file, what is between the rows, gaps.

use super::*;
use crate::{Centre, OrbitInterpolation};

fn errors_km(history: &OrbitHistory) -> [f64; 2] {
    let [first, last] = history.span_ns();
    let (radius_km, rate) = (7000.0, 1.1e-3);
    (0..=5000).fold([0.0; 2], |worst: [f64; 2], i| {
        let t_ns = first + (last - first) / 5000 * i;
        let (sin, cos) = (rate * (t_ns - first) as f64 * 1e-9).sin_cos();
        let got = history.at_ns(t_ns).unwrap();
        let position = (got.position_km - DVec3::new(cos, sin, 0.0) * radius_km).length();
        let velocity = (got.velocity_km_s - DVec3::new(-sin, cos, 0.0) * radius_km * rate).length();
        [worst[0].max(position), worst[1].max(velocity)]
    })
}

#[test]
fn cubics_err_by_the_fourth_derivative_and_the_file_shows_it() {
    let history = orbit(&oem(61, 60.0));
    assert_eq!((history.centre, history.segments()[0].method()), (Centre::Earth, OrbitInterpolation::CUBIC));
    let bound_km = 7000.0 * (1.1e-3_f64 * 60.0).powi(4) / 384.0;
    let [error_km, error_km_s] = errors_km(&history);
    assert!(error_km <= 1.01 * bound_km && error_km > 0.9 * bound_km, "{error_km} km, bound {bound_km} km");
    let [shown_km, shown_km_s] = history.interpolation_error().unwrap();
    assert!((shown_km / bound_km - 16.0).abs() < 0.2, "{shown_km}");
    assert!(error_km_s < shown_km_s, "{error_km_s} {shown_km_s}");
}

#[test]
fn higher_degrees_of_the_file_are_taken() {
    let with = |lines: &str| orbit(&oem(61, 60.0).replace("META_STOP", &format!("{lines}\nMETA_STOP")));
    let [hermite, lagrange] = ["HERMITE", "LAGRANGE"]
        .map(|method| errors_km(&with(&format!("INTERPOLATION = {method}\nINTERPOLATION_DEGREE = 7"))));
    assert!(hermite[0] < 1e-7 && hermite[1] < 1e-8, "{hermite:?}");
    assert!(lagrange[0] < 1e-4 && lagrange[1] < 1e-6, "{lagrange:?}");
    let linear = errors_km(&with("INTERPOLATION = LINEAR"));
    assert!(linear[0] > 1.0, "control: {linear:?}");
}

#[test]
fn other_files_have_the_same_orbit() {
    let wanted = orbit(&oem(3, 60.0));
    let rows = |unit: f64| -> String {
        let states = wanted.segments()[0].states().iter().zip([0.0, 60.0, 120.0]);
        states
            .map(|(state, t_s)| {
                let [p, v] = [state.position_km * unit, state.velocity_km_s * unit];
                format!("{t_s} {} {} {} {} {} {}\n", p.x, p.y, p.z, v.x, v.y, v.z)
            })
            .collect()
    };
    let stk = |unit: f64, line: &str| {
        format!(
            "stk.v.11.0\nBEGIN Ephemeris\nNumberOfEphemerisPoints 3\nScenarioEpoch 1 Mar 2026 00:00:00.0\n{line}CoordinateSystem \
             ICRF\nEphemerisTimePosVel\n{}END Ephemeris\n",
            rows(unit)
        )
    };
    for text in [stk(1000.0, ""), stk(1.0, "DistanceUnit Kilometers\nCentralBody Earth\n")] {
        for (got, wanted) in orbit(&text).segments()[0].states().iter().zip(wanted.segments()[0].states()) {
            assert_eq!(got.t_ns, wanted.t_ns);
            assert!((got.position_km - wanted.position_km).length() < 1e-11, "{text}");
            assert!((got.velocity_km_s - wanted.velocity_km_s).length() < 1e-14);
        }
    }
    let wrong = orbit(&stk(1.0, ""));
    assert!(wrong.segments()[0].states()[0].position_km.length() < 10.0, "control: the unit counts");
    let eme = orbit(&oem(3, 60.0).replace("REF_FRAME = ICRF", "REF_FRAME = EME2000"));
    let off = (eme.segments()[0].states()[0].position_km - wanted.segments()[0].states()[0].position_km).length();
    assert!((1e-4..1e-2).contains(&off), "the bias is metres at 7000 km: {off} km");
}

#[test]
fn an_orbit_ends_with_its_rows() {
    let history = orbit(&oem(3, 60.0));
    let at = |text: &str| history.at_ns(utc(text).ns()).is_some();
    assert!(at("2026-03-01T00:00:00Z") && at("2026-03-01T00:02:00Z"));
    assert!(!at("2026-02-28T23:59:59Z") && !at("2026-03-01T00:02:00.001Z"));
}
