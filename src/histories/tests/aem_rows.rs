//! Euler angles and spin in AEM: the attitude and the rate that they are, and what is refused.

use super::*;

/// Returns a message of version 2 with two rows of this type, ten seconds apart.
fn message(kind: &str, more: &str, rows: [&str; 2]) -> String {
    let [first, last] = rows;
    AEM_2
        .replace("= QUATERNION\n", &format!("= {kind}\n{more}"))
        .replace("0.09983341664682815 0 0 0.9950041652780258", first)
        .replace("0.14943813247359922 0 0 0.9887710779360422", last)
}

/// Returns the message of version 1.
fn first_version(text: &str) -> String {
    text.replace("VERS = 2.0", "VERS = 1.0").replace("TIME_SYSTEM", "ATTITUDE_DIR = A2B\nTIME_SYSTEM")
}

fn state(text: &str) -> AttitudeState {
    attitudes(text).segments()[0].states()[0]
}

/// Returns a direction of the inertial axes in body axes, by matrices that turn the axes about z, x and z.
fn turned_axes(degrees: [f64; 3], v: DVec3) -> DVec3 {
    let about = |is_z: bool, degrees: f64, v: DVec3| {
        let (sin, cos) = degrees.to_radians().sin_cos();
        if is_z {
            DVec3::new(cos * v.x + sin * v.y, cos * v.y - sin * v.x, v.z)
        } else {
            DVec3::new(v.x, cos * v.y + sin * v.z, cos * v.z - sin * v.y)
        }
    };
    let [a, b, c] = degrees;
    about(true, c, about(false, b, about(true, a, v)))
}

const SOMEWHERE: DVec3 = DVec3::new(0.3, -0.5, 0.8);

#[test]
fn euler_angles_turn_the_axes_one_after_another() {
    let text = message("EULER_ANGLE", "EULER_ROT_SEQ = ZXZ\n", ["30 40 50", "31 40 50"]);
    let got = state(&text).body_from_icrf.apply(SOMEWHERE);
    assert!((got - turned_axes([30.0, 40.0, 50.0], SOMEWHERE)).length() < 1e-14, "{got}");
    assert!((got - turned_axes([50.0, 40.0, 30.0], SOMEWHERE)).length() > 0.1, "control: the other order");
    // The frames named the other way round: the same numbers are the turn from the body to the inertial axes.
    let other = text.replace("= GCRF", "= X").replace("= SC_BODY_1", "= GCRF").replace("= X", "= SC_BODY_1");
    let back = state(&other).body_from_icrf.inverse().apply(SOMEWHERE);
    assert!((back - turned_axes([30.0, 40.0, 50.0], SOMEWHERE)).length() < 1e-14, "{back}");
}

#[test]
fn derivatives_of_angles_and_body_rates_are_the_rate_of_the_attitude() {
    // 1, 2 and -3 deg/s: what the attitude does from a millisecond before to one after.
    let rows = ["30 40 50 1 2 -3", "40 60 20 1 2 -3"];
    let text = message("EULER_ANGLE/DERIVATIVE", "EULER_ROT_SEQ = ZXZ\n", rows);
    let now = state(&text);
    let beside = |row| state(&message("EULER_ANGLE", "EULER_ROT_SEQ = ZXZ\n", [row, "31 40 50"])).body_from_icrf;
    let (before, after) = (beside("29.999 39.998 50.003"), beside("30.001 40.002 49.997"));
    let rate = before.rotation_vector_to(&after) / 2e-3;
    let given = now.rate_rad_s.unwrap();
    assert!((given - rate).length() < 1e-8 * rate.length(), "{given} and {rate}");
    assert!((given + rate).length() > rate.length(), "control: its sign");
    let [x, y, z] = given.to_array().map(f64::to_degrees);
    let rows = [format!("30 40 50 {x} {y} {z}"), format!("30 40 50 {} {} {}", -x, -y, -z)];
    let keys = "EULER_ROT_SEQ = ZXZ\nANGVEL_FRAME = SC_BODY_1\n";
    let same = state(&message("EULER_ANGLE/ANGVEL", keys, [&rows[0], &rows[1]])).rate_rad_s.unwrap();
    assert!((same - given).length() < 1e-14, "{same}");
    let other = state(&text.replace("= GCRF", "= X").replace("= SC_BODY_1", "= GCRF").replace("= X", "= SC_BODY_1"));
    let body_rate = other.rate_rad_s.unwrap();
    assert!((body_rate + other.body_from_icrf.apply(given)).length() < 1e-14, "of the body, in its axes: {body_rate}");
}

#[test]
fn spin_is_the_direction_of_the_bodys_z_axis_and_a_turn_about_it() {
    for (kind, more) in [("SPIN", ""), ("SPIN/NUTATION", " 3 20 40"), ("SPIN/NUTATION_MOM", " 21 31 4")] {
        let text = message(kind, "", [&format!("20 30 10 6{more}"), &format!("20 30 70 6{more}")]);
        let found = state(&text);
        let (ra, dec) = (20.0_f64.to_radians(), 30.0_f64.to_radians());
        let axis = DVec3::new(dec.cos() * ra.cos(), dec.cos() * ra.sin(), dec.sin());
        assert!((found.body_from_icrf.apply(axis) - DVec3::Z).length() < 1e-14, "{kind}");
        let got = found.body_from_icrf.apply(SOMEWHERE);
        assert!((got - turned_axes([110.0, 60.0, 10.0], SOMEWHERE)).length() < 1e-14, "{kind}: {got}");
        assert_eq!(found.rate_rad_s, None);
        let history = attitudes(&text);
        assert!(history.notes.iter().any(|note| note.contains("left out")), "{:?}", history.notes);
        let rate = history.at_ns(found.t_ns + 5_000_000_000).unwrap().rate_rad_s;
        assert!((rate - DVec3::Z * 6.0_f64.to_radians()).length() < 1e-12, "{kind}: {rate}");
    }
}

#[test]
fn version_1_takes_the_one_sequence_of_angles_that_is_certain() {
    let with = |kind: &str, sequence: &str, rows| {
        first_version(&message(kind, &format!("EULER_ROT_SEQ = {sequence}\n"), rows))
    };
    let plain = state(&with("EULER_ANGLE", "123", ["10 20 30", "11 20 30"]));
    let second = state(&message("EULER_ANGLE", "EULER_ROT_SEQ = XYZ\n", ["10 20 30", "11 20 30"]));
    assert_eq!(plain.body_from_icrf, second.body_from_icrf);
    let rated = attitudes(&with("EULER_ANGLE/RATE", "123", ["10 20 30 1 2 3", "11 20 30 1 2 3"]));
    assert_eq!(rated.segments()[0].states()[0], plain);
    assert!(rated.notes.iter().any(|note| note.contains("version 1")), "{:?}", rated.notes);
    let spin = state(&first_version(&message("SPIN", "", ["20 30 10 6", "20 30 70 6"])));
    assert_eq!(spin, state(&message("SPIN", "", ["20 30 10 6", "20 30 70 6"])));
}

#[test]
fn angles_and_spins_that_are_not_certain_are_refused_with_line_and_reason() {
    let angles = |sequence: &str| message("EULER_ANGLE", &format!("EULER_ROT_SEQ = {sequence}\n"), ["1 2 3", "4 5 6"]);
    for (text, parts) in [
        (first_version(&angles("321")), [":15:", "programs differ"]),
        (angles("ZZX"), [":14:", "neighbours differ"]),
        (angles("XY"), [":14:", "three axes"]),
        (angles("ABC"), [":14:", "three axes"]),
        (angles("ZXZ").replace("1 2 3", "1 2"), [":17:", "3 numbers"]),
        (angles("ZXZ").replace("1 2 3", "1 2 inf"), [":17:", "finite number"]),
        (message("SPIN", "", ["20 30 10 60", "20 30 250 60"]), [":16:", "denser rows"]),
        (message("SPIN", "", ["20 30 10", "20 30 70"]), [":16:", "4 numbers"]),
    ] {
        let error = read::attitudes("x.aem", &text, None).expect_err(&text).to_string();
        assert!(error.starts_with("x.aem") && parts.iter().all(|part| error.contains(part)), "{parts:?}: {error}");
    }
    assert!(read::attitudes("x.aem", &angles("ZXZ"), None).is_ok(), "control");
}

#[test]
fn xml_names_angles_and_spins() {
    let xml = |kind: &str, more: &str, state: &str| {
        format!(
            "<aem version=\"2.0\"><body><segment><metadata><OBJECT_NAME>SAT</OBJECT_NAME><OBJECT_ID>2026-001A</OBJECT_ID>\
             <REF_FRAME_A>GCRF</REF_FRAME_A><REF_FRAME_B>SC_BODY_1</REF_FRAME_B><TIME_SYSTEM>UTC</TIME_SYSTEM>\
             <START_TIME>2026-03-01T00:00:00</START_TIME><STOP_TIME>2026-03-01T00:00:10</STOP_TIME>\
             <ATTITUDE_TYPE>{kind}</ATTITUDE_TYPE>{more}</metadata><data><attitudeState>{state}</attitudeState></data>\
             </segment></body></aem>"
        )
    };
    let epoch = "<EPOCH>2026-03-01T00:00:00</EPOCH>";
    let angles = format!("<e>{epoch}<ANGLE_1>30</ANGLE_1><ANGLE_2>40</ANGLE_2><ANGLE_3>50</ANGLE_3></e>");
    let named = state(&xml("EULER_ANGLE", "<EULER_ROT_SEQ>ZXZ</EULER_ROT_SEQ>", &angles));
    let lines = state(&message("EULER_ANGLE", "EULER_ROT_SEQ = ZXZ\n", ["30 40 50", "31 40 50"]));
    assert_eq!(named.body_from_icrf, lines.body_from_icrf);
    let spin = "<SPIN_ANGLE_VEL>6</SPIN_ANGLE_VEL><SPIN_ANGLE>10</SPIN_ANGLE><SPIN_ALPHA>20</SPIN_ALPHA><SPIN_DELTA>30</SPIN_DELTA>";
    let named = state(&xml("SPIN", "", &format!("<spin>{epoch}{spin}</spin>")));
    assert_eq!(named, state(&message("SPIN", "", ["20 30 10 6", "20 30 70 6"])));
}
