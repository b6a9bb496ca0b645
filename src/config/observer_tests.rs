//! `[observer]` about Earth, Moon or Sun: what it means, what is refused.

use super::*;
use crate::document::Document;
use serde::Deserialize;
use std::path::Path;

#[derive(Debug, Deserialize)]
struct OnlyObserver {
    observer: ObserverKeys,
}

/// Reads the observer of a file with only this section, whether light is bent, and the keys left at defaults.
fn observer(lines: &str) -> Result<(Observer, bool, Vec<String>)> {
    let document = Document::from_text(&format!("[observer]\n{lines}\n"), Path::new("lab/bench.toml"));
    let keys: OnlyObserver = document.read_as()?;
    let mut check = Checker::new(&document);
    let observer = Observer::check(&keys.observer, &mut check)?;
    let bent = keys.observer.light_deflection().check(&mut check)?;
    Ok((observer, bent, check.defaulted.into_iter().map(|default| default.key).collect()))
}

#[test]
fn a_state_becomes_what_it_says() {
    let (got, bent, defaulted) = observer(
        "kind = \"two_body\"\nabout = \"moon\"\nepoch = \"2026-03-01T12:00:00Z\"\nposition_km = [5000, -200, 70000]\n\
         velocity_km_s = [0.01, 0.08, -0.02]\nlight_deflection = false",
    )
    .expect("a state");
    let epoch = Some(Tai::from_rfc3339("2026-03-01T12:00:00Z").expect("valid"));
    let start = OrbitStart::State { position_km: [5000.0, -200.0, 70_000.0], velocity_km_s: [0.01, 0.08, -0.02] };
    assert_eq!(got, Observer::Orbit(OrbitSettings::TwoBody { about: CentralBody::Moon, epoch, start }));
    assert!(!bent && defaulted.is_empty(), "{defaulted:?}");
}

#[test]
fn elements_become_radians_and_their_defaults_are_reported() {
    let (got, bent, defaulted) =
        observer("kind = \"two_body\"\nsemi_major_axis_km = 7000\nraan_deg = 180").expect("enough");
    let Observer::Orbit(OrbitSettings::TwoBody {
        about: CentralBody::Earth,
        epoch: None,
        start: OrbitStart::Elements(elements),
    }) = got
    else {
        unreachable!("about the Earth, from the start: {got:?}")
    };
    assert_eq!((elements.semi_major_axis_km, elements.eccentricity, elements.mean_anomaly_rad), (7000.0, 0.0, 0.0));
    assert!((elements.raan_rad - core::f64::consts::PI).abs() < 1e-15);
    assert!(bent, "as a rule");
    for key in ["about", "epoch", "inclination_deg", "eccentricity", "mean_anomaly_deg", "light_deflection"] {
        assert!(
            defaulted.iter().any(|reported| *reported == format!("observer.{key}")),
            "{key} is not among {defaulted:?}"
        );
    }
}

#[test]
fn each_rule_has_a_failing_example() {
    let two_body = |rest: &str| format!("kind = \"two_body\"\n{rest}");
    let state = "position_km = [7000, 0, 0]\nvelocity_km_s = [0, 7.5, 0]\n";
    for (lines, key, parts) in [
        (two_body(""), "observer.semi_major_axis_km", ["missing", "position_km"]),
        (two_body("about = \"mars\""), "observer.about", ["\"earth\", \"moon\", \"sun\"", "bench.toml:3"]),
        (two_body("epoch = \"noon\"\nsemi_major_axis_km = 7000"), "observer.epoch", ["RFC 3339", "\"start\""]),
        (two_body("position_km = [7000, 0, 0]"), "observer.velocity_km_s", ["missing", "go together"]),
        (two_body("velocity_km_s = [0, 7, 0]"), "observer.position_km", ["missing", "go together"]),
        (two_body("position_km = [inf, 0, 0]\nvelocity_km_s = [0, 7, 0]"), "observer.position_km", ["inf", "finite"]),
        (two_body(&format!("{state}eccentricity = 0.1")), "observer.eccentricity", ["by elements", "leave out"]),
        (two_body(&format!("{state}raan_deg = 10")), "observer.raan_deg", ["by elements", "leave out"]),
        (two_body("semi_major_axis_km = nan"), "observer.semi_major_axis_km", ["NaN", "hyperbola"]),
        (
            two_body("semi_major_axis_km = 7000\neccentricity = 1"),
            "observer.eccentricity is 1",
            ["below 1", "parabola"],
        ),
        (two_body("semi_major_axis_km = -7000\neccentricity = 0.9"), "observer.eccentricity", ["above 1", "parabola"]),
        (
            two_body("semi_major_axis_km = 7000\ninclination_deg = 181"),
            "observer.inclination_deg",
            ["0 to 180", "ICRF"],
        ),
        (
            two_body("semi_major_axis_km = 7000\naltitude_km = 500"),
            "observer.altitude_km",
            ["belongs to", "circular_orbit"],
        ),
        ("kind = \"circular_orbit\"\nabout = \"moon\"".into(), "observer.about", ["belongs to", "two_body"]),
        ("eccentricity = 0.1".into(), "observer.eccentricity", ["belongs to", "two_body"]),
        ("raan_deg = 10".into(), "observer.raan_deg", ["belongs to", "two_body"]),
    ] {
        let error = observer(&lines).expect_err("a broken rule").to_string();
        assert!(error.contains(key), "{key}: {error}");
        for part in parts {
            assert!(error.contains(part), "no \"{part}\" in: {error}");
        }
    }
    assert!(observer("kind = \"circular_orbit\"\nraan_deg = 10\ninclination_deg = 50").is_ok(), "planes are shared");
    assert!(observer(&two_body(state)).is_ok());
    assert!(observer(&two_body("semi_major_axis_km = -7000\neccentricity = 1.1")).is_ok(), "a flyby");
}

/// Returns an observer by a file with this text, beside the document.
fn of_file(text: &str, lines: &str) -> Result<Observer> {
    let folder = tempfile::tempdir().expect("a folder");
    std::fs::write(folder.path().join("orbit.txt"), text).expect("a file");
    let lines = format!("[observer]\nkind = \"file\"\nfile = \"orbit.txt\"\n{lines}\n");
    let document = Document::from_text(&lines, &folder.path().join("bench.toml"));
    let keys: OnlyObserver = document.read_as()?;
    Observer::check(&keys.observer, &mut Checker::new(&document))
}

const TABLE: &str =
    "unix_s,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s\n1772323200,7000,0,0,0,7.5,0\n1772323260,6985,450,0,-0.5,7.5,0\n";
const LINES: &str = "ISS\n1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927\n\
                     2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537\n";

const OBJECT: &str = r#"{"OBJECT_NAME": "ISS", "OBJECT_ID": "1998-067A", "EPOCH": "2008-09-20T12:25:40.104192",
 "MEAN_MOTION": 15.72125391, "ECCENTRICITY": 0.0006703, "INCLINATION": "51.6416", "RA_OF_ASC_NODE": 247.4627,
 "ARG_OF_PERICENTER": 130.5360, "MEAN_ANOMALY": 325.0288, "EPHEMERIS_TYPE": 0, "CLASSIFICATION_TYPE": "U",
 "NORAD_CAT_ID": 25544, "ELEMENT_SET_NO": 292, "REV_AT_EPOCH": 56353, "BSTAR": -0.000011606,
 "MEAN_MOTION_DOT": -0.00002182, "MEAN_MOTION_DDOT": 0}"#;

#[test]
fn a_file_is_states_or_elements_by_what_is_in_it() {
    let Ok(Observer::Table(history)) = of_file(TABLE, "") else { unreachable!("a table of states") };
    assert_eq!((history.rows(), history.centre), (2, histories::Centre::Earth));
    for (keys, id, days) in [("", None, 30.0), ("norad_id = 25544\nmax_age_days = 365", Some(25_544), 365.0)] {
        for text in [LINES, OBJECT, &format!("\u{feff}{LINES}"), &format!("{LINES}{LINES}")] {
            let elements = OrbitSettings::Mean { text: text.to_owned(), norad_id: id, max_age_days: days };
            let wanted = Observer::Orbit(elements);
            assert_eq!(of_file(text, keys).expect("elements"), wanted, "{text}");
        }
    }
}

#[test]
fn damaged_elements_are_refused_as_elements() {
    let checksum = LINES.replace("2927", "2920");
    let short = LINES.replace("-11606-4 0  2927", "-11606-4");
    let no_break = LINES.replacen("U 98067A", "U\u{a0}98067A", 1);
    let other = LINES.replace("25544", "25545").replace("2927", "2928").replace("563537", "563538");
    for (text, keys, part) in [
        (checksum.clone(), "", "wanted checksum 7 in column 69, got \"0\""),
        (checksum.replace("ISS\n", ""), "", "wanted checksum 7 in column 69"),
        (short, "", "wanted 69 ASCII characters"),
        (no_break, "", "wanted 69 ASCII characters, got 69 with '\\u{a0}'"),
        (format!("{LINES}{other}"), "", "got 2 objects, wanted one, or the norad_id of one of them"),
        (LINES.into(), "norad_id = 7", "the object with number 7, got none among 1"),
        (TABLE.into(), "norad_id = 7", "observer.norad_id is given"),
        (TABLE.into(), "max_age_days = 7", "observer.max_age_days is given"),
        (OBJECT.replace("\"EPHEMERIS_TYPE\": 0", "\"CENTER_NAME\": \"MOON\""), "", "CENTER_NAME: wanted EARTH"),
    ] {
        let error = of_file(&text, keys).expect_err(part).to_string();
        assert!(error.contains("observer.") && error.contains(part), "{part}: {error}");
    }
    assert!(of_file(&format!("{LINES}{other}"), "norad_id = 25545").is_ok(), "control: the number chooses");
}

#[test]
fn states_that_no_orbit_has_are_refused() {
    for (from, to, part) in [
        ("0,7.5,0\n", "299793,7.5,0\n", "wanted at most 32.0 km/s"),
        ("0,7.5,0\n", "0,1e300,0\n", "wanted"),
        ("0,7.5,0\n", "0,750,0\n", "wanted at most 32.0 km/s"),
        ("7000,0,0", "6000,0,0", "contradict the positions"),
        ("6985,450", "3000,450", "contradict the positions"),
    ] {
        assert!(TABLE.contains(from), "control: {from}");
        let error = of_file(&TABLE.replacen(from, to, 1), "").expect_err(part).to_string();
        assert!(error.contains("observer.file") && error.contains(part), "{part}: {error}");
    }
    let header = "unix_s,x_m,y_m,z_m,vx_m_s,vy_m_s,vz_m_s";
    let km = format!("{header}\n1772323200,7000,0,0,0,7.5,0\n1772323260,6985,450,0,-0.5,7.5,0\n");
    let error = of_file(&km, "").expect_err("kilometres in columns of metres").to_string();
    assert!(error.contains("7.0 km from its centre") && error.contains("units"), "{error}");
}

#[test]
fn files_of_the_observer_are_refused_with_line_and_reason() {
    for (text, lines, part) in [
        (TABLE.replace("7000", "x"), "", "orbit.txt:2: got \"x\""),
        (TABLE.replace("unix_s", "t_s"), "", "absolute times"),
        (TABLE.into(), "about = \"moon\"", "observer.about is given"),
        (TABLE.into(), "altitude_km = 500", "observer.altitude_km is given"),
    ] {
        let error = of_file(&text, lines).expect_err(part).to_string();
        assert!(error.contains(part), "{part}: {error}");
    }
    let error = observer("file = \"x.oem\"").expect_err("another kind").to_string();
    assert!(error.contains("observer.file is given"), "{error}");
    let error = observer("kind = \"file\"").expect_err("no file").to_string();
    assert!(error.contains("observer.file") && error.contains("missing"), "{error}");
    let error = observer("kind = \"file\"\nfile = \"none.oem\"").expect_err("no such file").to_string();
    assert!(error.contains("none.oem: cannot be opened"), "{error}");
}
