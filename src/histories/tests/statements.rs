//! Statements of a file are used, refused, or named in a warning: none is passed over.

use super::{files::xml_metadata, *};
use crate::{AttitudeInterpolation, OrbitInterpolation};

fn refused(text: &str, is_orbit: bool) -> String {
    let error = if is_orbit { read::orbit("x", text).err() } else { read::attitudes("x", text, None).err() };
    error.unwrap_or_else(|| panic!("read: {text}")).to_string()
}

#[test]
fn hermite_without_rates_is_a_polynomial_through_the_quaternions() {
    let text = AEM_2.replace("META_STOP", "INTERPOLATION_METHOD = HERMITE\nINTERPOLATION_DEGREE = 7\nMETA_STOP");
    let history = attitudes(&text);
    assert_eq!(history.segments()[0].method(), AttitudeInterpolation::Lagrange(7));
    assert!(history.notes.iter().any(|note| note.contains("HERMITE without rates")), "{:?}", history.notes);
}

#[test]
fn a_degree_without_a_method_is_refused() {
    let text = oem(3, 60.0).replace("META_STOP", "INTERPOLATION_DEGREE = 5\nMETA_STOP");
    assert!(refused(&text, true).starts_with("x:12: got \"INTERPOLATION_DEGREE = 5\", wanted the method too"));
    let with = text.replace("META_STOP", "INTERPOLATION = HERMITE\nMETA_STOP");
    assert_eq!(orbit(&with).segments()[0].method(), OrbitInterpolation::Hermite { rows: 3 }, "control");
}

#[test]
fn keywords_that_a_message_does_not_have_are_named_and_units_refused() {
    let with = |line: &str| AEM_2.replace("META_STOP", &format!("{line}\nMETA_STOP"));
    let warnings = attitudes(&with("COLOUR = blue")).warnings;
    assert_eq!(warnings, ["COLOUR = blue (line 14) is a keyword that this message does not have: it is not used"]);
    assert!(refused(&with("RATE_UNIT = rad/s"), false).starts_with("x:14: got \"RATE_UNIT = rad/s\""));
    assert!(refused(&oem(3, 60.0).replace("META_STOP", "POSITION_UNIT = m\nMETA_STOP"), true).contains("kilometres"));
    assert_eq!(attitudes(AEM_2).warnings, Vec::<String>::new(), "control");
}

#[test]
fn rows_that_end_before_stop_time_are_a_warning() {
    let short = attitudes(&AEM_2.replace("STOP_TIME = 2026-03-01T00:00:10", "STOP_TIME = 2026-03-01T00:01:10"));
    assert!(
        short.warnings[0].contains("in line 5 end at") && short.warnings[0].contains("60.0 s before"),
        "{:?}",
        short.warnings
    );
    let whole = oem(5, 60.0).replace("2026-03-02T00:00:00", "2026-03-01T00:04:00");
    assert_eq!(orbit(&whole).warnings, Vec::<String>::new(), "control");
    let cut = whole.lines().take(14).fold(String::new(), |text, line| text + line + "\n");
    assert!(orbit(&cut).warnings[0].contains("cut short"), "{:?}", orbit(&cut).warnings);
}

#[test]
fn a_message_cut_in_its_last_number_is_a_warning() {
    let rows = |last: &str| {
        let head = oem(0, 60.0).replace("2026-03-02T00:00:00", "2026-03-01T00:02:00");
        let row = |minute: u32, y_km: f64, vz: &str| format!("2026-03-01T00:0{minute}:00 7000 {y_km} 0 0 7.5 {vz}\n");
        format!("{head}{}{}{}", row(0, 0.0, "0.00012"), row(1, 450.0, "0.00034"), row(2, 900.0, last))
    };
    let cut = rows("0.00");
    assert!(
        orbit(cut.trim_end()).warnings[0].contains("cut short in a number"),
        "{:?}",
        orbit(cut.trim_end()).warnings
    );
    for good in [cut.as_str(), rows("0.00056").trim_end()] {
        assert_eq!(orbit(good).warnings, Vec::<String>::new(), "control");
    }
}

/// Returns a message in XML with one state.
fn xml(kind: &str, state: &str) -> String {
    let metadata = xml_metadata().replace("<ATTITUDE_TYPE>QUATERNION<", &format!("<ATTITUDE_TYPE>{kind}<"));
    format!(
        "<aem version=\"2.0\"><body><segment><metadata>{metadata}</metadata><data>\n<attitudeState><a>\
         <EPOCH>2026-03-01T00:00:00</EPOCH>{state}</a></attitudeState></data></segment></body></aem>"
    )
}

#[test]
fn units_and_comments_inside_xml_are_not_passed_over() {
    let quaternion = "<Q1>0</Q1><Q2>0</Q2><Q3>0</Q3>";
    let comment = xml("QUATERNION", &format!("{quaternion}<QC>1.<!-- -->0</QC>"));
    assert!(refused(&comment, false).starts_with("x:2: got \"QC\", wanted a value without a comment"));
    assert!(read::attitudes("x", &comment.replace("<!-- -->", ""), None).is_ok(), "control");
    let rate = |units: &str| {
        let rates = ["X", "Y", "Z"].map(|axis| format!("<ANGVEL_{axis} units=\"{units}\">1</ANGVEL_{axis}>")).concat();
        xml("QUATERNION/ANGVEL", &format!("{quaternion}<QC>1</QC>{rates}"))
            .replace("</metadata>", "<ANGVEL_FRAME>SC_BODY_1</ANGVEL_FRAME></metadata>")
    };
    assert!(refused(&rate("rad/s"), false).contains("got \"ANGVEL_X with units=\"rad/s\"\", wanted units=\"deg/s\""));
    assert!(read::attitudes("x", &rate("DEG/S"), None).is_ok(), "control");
    let state = |units: &str| {
        let words = ["X", "Y", "Z"].map(|axis| format!("<{axis} units=\"{units}\">7000</{axis}>")).concat();
        let speeds = ["X", "Y", "Z"].map(|axis| format!("<{axis}_DOT units=\"km/s\">0</{axis}_DOT>")).concat();
        let row = |minute: u32| {
            format!("<stateVector><EPOCH>2026-03-01T00:0{minute}:00</EPOCH>{words}{speeds}</stateVector>")
        };
        format!(
            "<oem version=\"2.0\"><segment><metadata><OBJECT_NAME>S</OBJECT_NAME><OBJECT_ID>S</OBJECT_ID><CENTER_NAME>EARTH\
             </CENTER_NAME><REF_FRAME>ICRF</REF_FRAME><TIME_SYSTEM>UTC</TIME_SYSTEM><START_TIME>2026-03-01T00:00:00</START_TIME>\
             <STOP_TIME>2026-03-01T00:01:00</STOP_TIME></metadata><data>{}{}</data></segment></oem>",
            row(0),
            row(1)
        )
    };
    assert!(refused(&state("m"), true).contains("X with units=\"m\"\", wanted units=\"km\""));
    assert!(read::orbit("x", &state("km")).is_ok(), "control");
}

#[test]
fn angles_of_version_1_are_named_by_their_rotation() {
    let rotation =
        |n: u32, axis: &str, deg: u32| format!("<rotation{n} angle=\"{axis}_ANGLE\" units=\"deg\">{deg}</rotation{n}>");
    let with = |axes: [&str; 3]| {
        let angles = [rotation(1, axes[0], 10), rotation(2, axes[1], 20), rotation(3, axes[2], 30)].concat();
        xml("EULER_ANGLE", &format!("<rotationAngles>{angles}</rotationAngles>"))
            .replace("version=\"2.0\"", "version=\"1.0\"")
            .replace("</metadata>", "<ATTITUDE_DIR>A2B</ATTITUDE_DIR><EULER_ROT_SEQ>123</EULER_ROT_SEQ></metadata>")
    };
    let got = attitudes(&with(["X", "Y", "Z"])).segments()[0].states()[0].body_from_icrf;
    let lines = AEM_2
        .replace("VERS = 2.0", "VERS = 1.0")
        .replace("TIME_SYSTEM", "ATTITUDE_DIR = A2B\nTIME_SYSTEM")
        .replace("= QUATERNION\n", "= EULER_ANGLE\nEULER_ROT_SEQ = 123\n")
        .replace("0.09983341664682815 0 0 0.9950041652780258", "10 20 30")
        .replace("0.14943813247359922 0 0 0.9887710779360422", "11 20 30");
    assert!(angle(&got, &attitudes(&lines).segments()[0].states()[0].body_from_icrf) < 1e-15);
    assert!(refused(&with(["Z", "Y", "X"]), false).contains("rotation1"), "another axis than that of its place");
}

#[test]
fn names_and_keywords_that_are_given_twice_are_refused() {
    let table = "t_s,q_w,q_x,q_y,q_z,Q_W\n0,1,0,0,0,0.5\n";
    assert_eq!(refused(table, false), "x:1: got \"Q_W\", wanted each name of a column once");
    assert!(read::attitudes("x", &table.replace("Q_W", "other"), None).is_ok(), "control");
    let stk = "stk.v.11.0\nBEGIN Attitude\nScenarioEpoch 1 Mar 2026 00:00:00.0\nCoordinateAxes ICRF\nCoordinateAxes J2000\n\
               AttitudeTimeQuaternions\n0 0 0 0 1\nEND Attitude\n";
    assert!(refused(stk, false).starts_with("x:5: got \"CoordinateAxes J2000\", wanted each keyword once"));
}

#[test]
fn segments_of_stk_end_at_their_boundaries_and_covariances_are_left_out() {
    let file = "stk.v.11.0\nBEGIN Ephemeris\nNumberOfEphemerisPoints 4\nScenarioEpoch 1 Mar 2026 00:00:00.0\nCoordinateSystem \
                ICRF\nDistanceUnit Kilometers\nBEGIN SegmentBoundaryTimes\n60.0\nEND SegmentBoundaryTimes\nEphemerisTimePosVel\n\
                0 7000 0 0 0 7 0\n60 7000 420 0 0 7 0\n60 7000 420 0 0 0 7\n120 7000 420 420 0 0 7\nCovarianceTimePos\n\
                0 1 0 1 0 0 1\nEND Ephemeris\n";
    let history = orbit(file);
    assert_eq!((history.segments().len(), history.rows()), (2, 4));
    let after = history.at_ns(utc("2026-03-01T00:01:30Z").ns()).unwrap();
    assert!((after.position_km - DVec3::new(7000.0, 420.0, 210.0)).length() < 1e-9, "{after:?}");
    let without = file.replace("BEGIN SegmentBoundaryTimes\n60.0\nEND SegmentBoundaryTimes\n", "");
    assert!(refused(&without, true).contains("row 3 is not after"), "control");
    let geodetic = file.replace("EphemerisTimePosVel", "EphemerisLLATimePos");
    assert!(refused(&geodetic, true).contains("no geodetic ones"), "{}", refused(&geodetic, true));
    assert!(refused(&file.replace("SegmentBoundaryTimes", "Other"), true).starts_with("x:7:"));
    let closed = file.replace(
        "CovarianceTimePos\n0 1 0 1 0 0 1\n",
        "END EphemerisTimePosVel\nBEGIN CovarianceTimePos\n0 1 0 1 0 0 1\nEND CovarianceTimePos\n",
    );
    assert_ne!(closed, file, "control");
    assert_eq!(orbit(&closed).rows(), 4);
    // The form of covariances is stated before the rows.
    let stated = closed.replace("DistanceUnit", "CovarianceFormat LowerTriangular\nDistanceUnit");
    assert_eq!(orbit(&stated).rows(), 4);
}

#[test]
fn packed_files_are_named_as_such() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("x.oem.gz");
    for (bytes, part) in [
        (&b"\x1f\x8b\x08\0"[..], "packed by gzip; wanted the file itself: unpack it by gunzip"),
        (b"BZh91AY", "bunzip2"),
        (b"\xfd7zXZ\0", "unxz"),
        (b"\x5d\0\0\x80", "unlzma"),
    ] {
        std::fs::write(&path, bytes).unwrap();
        let error = read::text_of(&path).unwrap_err().to_string();
        assert!(error.contains("x.oem.gz: ") && error.contains(part), "{error}");
    }
}

#[test]
fn rows_at_fault_are_named_by_their_line() {
    let text = AEM_2.replace("T00:00:10 0.1", "T00:00:00 0.1");
    assert!(refused(&text, false).starts_with("x:17: row 2 is not after the one before it; wanted rising times"));
}

#[test]
fn utc_before_1972_is_a_warning() {
    let history = attitudes("utc,w,x,y,z\n1967-08-01T00:00:00,1,0,0,0\n1967-08-01T00:01:00,1,0,0,0\n");
    assert!(history.warnings[0].contains("before 1972"), "{:?}", history.warnings);
}
