//! Every rule has a failing example, whose message names file, line and reason.

use super::*;

fn refused_attitude(text: &str, parts: &[&str]) {
    let error = read::attitudes("x.aem", text, None).expect_err(text).to_string();
    assert!(error.starts_with("x.aem"), "{error}");
    assert!(parts.iter().all(|part| error.contains(part)), "{parts:?} not in: {error}");
}

fn refused_orbit(text: &str, parts: &[&str]) {
    let error = read::orbit("x.oem", text).expect_err(text).to_string();
    assert!(error.starts_with("x.oem"), "{error}");
    assert!(parts.iter().all(|part| error.contains(part)), "{parts:?} not in: {error}");
}

#[test]
fn json_is_named_as_such_and_a_tab_parts_a_comment() {
    refused_attitude("\u{feff} {\"a\": 1}", &["JSON", "CCSDS AEM"]);
    let commented = AEM_2.replacen("META_START", "META_START\nCOMMENT\tturned", 1);
    assert_ne!(commented, AEM_2, "control");
    read::attitudes("x.aem", &commented, None).unwrap();
}

#[test]
fn attitude_messages_are_refused_with_line_and_reason() {
    for (from, to, parts) in [
        ("VERS = 2.0", "VERS = 3.0", ["3.0", "1.0 or 2.0"]),
        ("= UTC", "= UT1", [":10:", "UTC, TAI, TT, TDB, GPS"]),
        ("= GCRF", "= TEME", [":8:", "ICRF, GCRF, EME2000"]),
        ("SC_BODY_1", "ICRF", [":9:", "spacecraft frame"]),
        ("SC_BODY_1", "ITRF2014", [":9:", "spacecraft frame"]),
        ("ATTITUDE_TYPE = QUATERNION", "ATTITUDE_TYPE = MATRIX", [":13:", "SPIN/NUTATION"]),
        ("ATTITUDE_TYPE = QUATERNION", "ATTITUDE_TYPE = QUATERNION/RATE", [":13:", "QUATERNION/ANGVEL"]),
        ("ATTITUDE_TYPE = QUATERNION", "ATTITUDE_TYPE = EULER_ANGLE", [":5:", "EULER_ROT_SEQ"]),
        ("META_STOP", "INTERPOLATION_METHOD = HERMITE\nMETA_STOP", [":14:", "HERMITE of degree 3"]),
        (
            "META_STOP",
            "INTERPOLATION_METHOD = Linear\nINTERPOLATION_DEGREE = 7\nMETA_STOP",
            [":14:", "Linear of degree 7"],
        ),
        ("META_STOP", "INTERPOLATION_METHOD = LAGRANGE\nINTERPOLATION_DEGREE = 99\nMETA_STOP", [":15:", "1 to 27"]),
        ("0.9950041652780258", "0.99", [":16:", "norm is 1"]),
        ("0.9950041652780258", "nan", [":16:", "finite number"]),
        ("0.9950041652780258", "0.9950041652780258 1 2 3", [":16:", "4 numbers"]),
        ("2026-03-01T00:00:00 0.0", "yesterday 0.0", [":16:", "a time such as"]),
        ("T00:00:10 0.1", "T00:00:00 0.1", ["row 2", "rising times"]),
        ("DATA_STOP", "", ["cut short", "DATA_STOP"]),
        ("META_STOP\n", "", [":14:", "KEY = VALUE or META_STOP"]),
        ("STOP_TIME = 2026-03-01T00:00:10", "STOP_TIME = 2026-03-01T00:00:09", [":12:", "every row"]),
        ("OBJECT_NAME = SAT", "OBJECT_ID = SAT", [":7:", "once in a segment"]),
        ("TIME_SYSTEM = UTC\n", "", [":5:", "TIME_SYSTEM"]),
    ] {
        refused_attitude(&AEM_2.replacen(from, to, 1), &parts);
    }
    refused_attitude("", &["0 rows"]);
    refused_attitude("CCSDS_OEM_VERS = 2.0\n", &[":1:", "CCSDS_AEM_VERS"]);
    refused_attitude("CCSDS_AEM_VERS = 2.0\n", &["no segment", "wanted META_START"]);
    refused_attitude("CCSDS_AEM_VERS = 2.0\nMETA_START\nOBJECT_NAME = X\n", &["META_STOP"]);
    let second = AEM_2.split_once("META_START").unwrap().1;
    refused_attitude(&format!("{AEM_2}META_START{second}"), &["segment 2", "do not overlap"]);
    let other = second.replace("T00:00:", "T00:01:").replace("2026-001A", "2026-002B");
    refused_attitude(&format!("{AEM_2}META_START{other}"), &["one object"]);
}

#[test]
fn xml_is_refused_with_line_and_reason() {
    for (text, parts) in [
        ("<aem version=\"2.0\">\n<body></aem>", [":2:", "well-formed"]),
        ("<!DOCTYPE a [<!ENTITY b \"c\">]>\n<aem version=\"2.0\"/>", [":1:", "DTD"]),
        ("<oem version=\"2.0\"/>", ["no element <aem>", "wanted an AEM"]),
        ("<aem/>", [":1:", "version"]),
        ("<aem version=\"2.0\"/>", ["no segment", "wanted"]),
        (
            "<aem version=\"2.0\"><segment><metadata/><data>\n<attitudeState><spin/></attitudeState></data></segment></aem>",
            [":2:", "each once"],
        ),
    ] {
        refused_attitude(text, &parts);
    }
}

#[test]
fn tables_are_refused_with_line_and_reason() {
    for (text, parts) in [
        ("t_s,q_w,q_x,q_y\n0,1,0,0\n", [":1:", "q1,q2,q3,q4"]),
        ("when,w,x,y,z\n0,1,0,0,0\n", [":1:", "a column of time"]),
        ("t_s,w,x,y,z\n0,1,0,0\n", [":2:", "5 values in a row"]),
        ("t_s,w,x,y,z\n0,1,0,0,x\n", [":2: got \"x\"", "a finite number in column 5"]),
        ("t_s,w,x,y,z\n1e300,1,0,0,0\n", [":2:", "fewer than 5e9"]),
        ("tai_ns,w,x,y,z\n9200000000000000000,1,0,0,0\n", [":2:", "1682 to 2258"]),
        ("t_s,w,x,y,z,w_x,w_y,w_z\n", [":1:", "a unit in the rate's names"]),
        ("t_s,w,x,y,z,w_x_rad_s,w_y_rad_s,other\n", [":1:", "w_z_rad_s"]),
        ("# sense: both\n0 1 0 0 0\n", [":1:", "body_from_icrf or icrf_from_body"]),
        ("# axes: TEME\n0 1 0 0 0\n", [":1:", "EME2000"]),
        ("utc,w,x,y,z\n2026-03-01,1,0,0,0\n", [":2:", "a time such as"]),
        ("0 1 0 0 0\n0 1 0 0 0\n", ["2 rows", "rising times"]),
        ("t_s,w,x,y,z,w_x_deg_s,w_y_deg_s,w_z_deg_s\n0,1,0,0,0,0,0,0\n1,0,1,0,0,0,0,0\n", ["180 deg", "denser rows"]),
    ] {
        refused_attitude(text, &parts);
    }
    let error = read::attitudes("x.aem", AEM_2, Some(crate::Sense::BodyFromIcrf)).unwrap_err().to_string();
    assert!(error.contains("states its own frames"), "{error}");
    let both = "# sense: body_from_icrf\n0 1 0 0 0\n";
    let error = read::attitudes("x.csv", both, Some(crate::Sense::IcrfFromBody)).unwrap_err().to_string();
    assert!(error.contains("they differ"), "{error}");
    assert!(read::attitudes("x.csv", both, Some(crate::Sense::BodyFromIcrf)).is_ok(), "control");
}

#[test]
fn orbits_are_refused_with_line_and_reason() {
    for (from, to, parts) in [
        ("= EARTH", "= MARS", [":7:", "EARTH, MOON, SUN"]),
        ("= ICRF", "= ITRF2000", [":8:", "ICRF, GCRF, EME2000"]),
        ("META_STOP", "INTERPOLATION = HERMITE\nINTERPOLATION_DEGREE = 4\nMETA_STOP", [":12:", "odd degree"]),
        ("STOP_TIME = 2026-03-02", "STOP_TIME = 2026-02-02", [":11:", "every row"]),
        ("7000 0 0 -0 ", "7000 0 0 ", [":13:", "6 or 9 numbers"]),
    ] {
        refused_orbit(&oem(3, 60.0).replacen(from, to, 1), &parts);
    }
    refused_orbit(&oem(1, 60.0), &["1 rows", "two at least"]);
    refused_orbit("t_s,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s\n", &[":1:", "absolute times"]);
    refused_orbit("utc,x_km,y_km\n", &[":1:", "a column z_km"]);
    refused_orbit("utc,x_km,y_km,z_km\n", &[":1:", "vx_km_s"]);
    refused_orbit("1 2 3\n", &[":1:", "names of columns"]);
}

#[test]
fn stk_files_are_refused_with_line_and_reason() {
    let file = "stk.v.11.0\nBEGIN Attitude\nNumberOfAttitudePoints 1\nScenarioEpoch 1 Mar 2026 00:00:00.0\nCoordinateAxes \
                ICRF\nAttitudeTimeQuaternions\n0 0 0 0 1\nEND Attitude\n";
    assert!(read::attitudes("x.a", file, None).is_ok(), "control");
    for (from, to, parts) in [
        ("Points 1", "Points 2", [":3:", "1, the number of rows"]),
        ("1 Mar 2026", "1 Foo 2026", [":4:", "a date such as"]),
        ("ICRF", "Fixed", [":5:", "ICRF or J2000"]),
        ("TimeQuaternions", "TimeEulerAngles", [":6:", "angles and matrices are not read"]),
        ("0 0 0 0 1", "0 0 0 1", [":7:", "4 finite numbers"]),
        ("0 0 0 0 1", "0 0 0 0 2", [":7:", "norm is 1"]),
        ("0 0 0 0 1", "9e99 0 0 0 1", [":7:", "seconds and 4 finite numbers"]),
        ("END Attitude", "", ["cut short", "END Attitude"]),
        ("BEGIN Attitude", "BEGIN Ephemeris", [":2:", "BEGIN Attitude"]),
    ] {
        refused_attitude(&file.replacen(from, to, 1), &parts);
    }
    let bare = "stk.v.11.0\nBEGIN Attitude\nNumberOfAttitudePoints 2\nEND Attitude\n";
    refused_attitude(bare, &["wanted", "AttitudeTime"]);
}

#[test]
fn files_that_are_no_text_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.aem");
    std::fs::write(&path, b"one\n\xff\n").unwrap();
    let error = read::text_of(&path).unwrap_err().to_string();
    assert!(error.contains("x.aem:2:") && error.contains("UTF-8"), "{error}");
    let error = read::text_of(&folder.path().join("none")).unwrap_err().to_string();
    assert!(error.contains("cannot be opened"), "{error}");
}
