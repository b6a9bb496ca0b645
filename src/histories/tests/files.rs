//! The same attitude by every form of file.

use super::*;
use crate::{Times, csv::Sense};

/// Returns a turn of 0.2 rad about x, this program's quaternion: x = -sin 0.1.
fn expected() -> Rotation<Body, Icrf> {
    Rotation::from_wxyz([0.1_f64.cos(), -(0.1_f64.sin()), 0.0, 0.0], 1e-12).unwrap()
}

fn first(history: &AttitudeHistory) -> AttitudeState {
    history.segments()[0].states()[0]
}

#[test]
fn version_2_of_an_aem_is_the_conjugate_of_this_programs_quaternion() {
    let history = attitudes(AEM_2);
    assert_eq!(first(&history).t_ns, utc("2026-03-01T00:00:00Z").ns());
    assert!(angle(&first(&history).body_from_icrf, &expected()) < 1e-15);
    assert!(angle(&first(&history).body_from_icrf.inverse().into_body(), &expected()) > 0.3, "control: the conjugate");
    assert_eq!(history.format, "CCSDS AEM 2.0 (KVN)");
    assert_eq!(history.name.as_deref(), Some("SAT, SC_BODY_1"));
}

/// The opposite rotation read as if it were the same.
trait AsBody {
    fn into_body(self) -> Rotation<Body, Icrf>;
}

impl AsBody for Rotation<Icrf, Body> {
    fn into_body(self) -> Rotation<Body, Icrf> {
        Rotation::from_quat(self.quat())
    }
}

#[test]
fn frames_may_be_named_the_other_way_round() {
    let other = AEM_2
        .replace("REF_FRAME_A = GCRF", "REF_FRAME_A = X")
        .replace("REF_FRAME_B = SC_BODY_1", "REF_FRAME_B = GCRF")
        .replace("= X", "= SC_BODY_1")
        .replace(" 0.0998", " -0.0998")
        .replace(" 0.1494", " -0.1494");
    assert!(angle(&first(&attitudes(&other)).body_from_icrf, &expected()) < 1e-15);
}

#[test]
fn version_1_states_its_direction_and_order() {
    let with = |direction: &str, order: &str, row: &str| {
        AEM_2
            .replace("VERS = 2.0", "VERS = 1.0")
            .replace("TIME_SYSTEM", &format!("ATTITUDE_DIR = {direction}\nTIME_SYSTEM"))
            .replace("META_STOP", &format!("QUATERNION_TYPE = {order}\nMETA_STOP"))
            .replace("0.09983341664682815 0 0 0.9950041652780258", row)
            .replace("2026-03-01T00:00:10 0.14943813247359922 0 0 0.9887710779360422\n", "")
    };
    let (plus, minus) = (0.1_f64.sin(), -(0.1_f64.sin()));
    let scalar = 0.1_f64.cos();
    for (direction, order, row) in [
        ("A2B", "LAST", format!("{plus} 0 0 {scalar}")),
        ("A2B", "FIRST", format!("{scalar} {plus} 0 0")),
        ("B2A", "LAST", format!("{minus} 0 0 {scalar}")),
        ("B2A", "FIRST", format!("{scalar} {minus} 0 0")),
    ] {
        let history = attitudes(&with(direction, order, &row));
        assert!(angle(&first(&history).body_from_icrf, &expected()) < 1e-15, "{direction} {order}");
    }
    let wrong = attitudes(&with("B2A", "LAST", &format!("{plus} 0 0 {scalar}")));
    assert!(angle(&first(&wrong).body_from_icrf, &expected()) > 0.3, "control: the direction counts");
}

#[test]
fn rates_are_those_of_the_body_in_its_own_axes() {
    // Turned by 90 deg about z, and turning about the inertial x axis: the body's -y axis.
    let half = core::f64::consts::FRAC_1_SQRT_2;
    let with = |frame: &str, rate: &str| {
        AEM_2
            .replace(
                "ATTITUDE_TYPE = QUATERNION",
                &format!("ATTITUDE_TYPE = QUATERNION/ANGVEL\nANGVEL_FRAME = {frame}"),
            )
            .replace("0.09983341664682815 0 0 0.9950041652780258", &format!("0 0 {half} {half} {rate}"))
            .replace("2026-03-01T00:00:10 0.14943813247359922 0 0 0.9887710779360422\n", "")
    };
    let wanted = DVec3::new(0.0, -0.01, 0.0);
    for (frame, rate) in [("GCRF", "0.5729577951308232 0 0"), ("REF_FRAME_B", "0 -0.5729577951308232 0")] {
        let rate = first(&attitudes(&with(frame, rate))).rate_rad_s.unwrap();
        assert!((rate - wanted).length() < 1e-15, "{frame}: {rate}");
    }
    let rate = first(&attitudes(&with("SC_BODY_1", "0.5729577951308232 0 0"))).rate_rad_s.unwrap();
    assert!((rate - wanted).length() > 0.01, "control: the frame counts");
    // The derivative of the quaternion says the same.
    let [dx, dy] = [0.005 * half, -0.005 * half];
    let text = AEM_2
        .replace("ATTITUDE_TYPE = QUATERNION", "ATTITUDE_TYPE = QUATERNION/DERIVATIVE")
        .replace("0.09983341664682815 0 0 0.9950041652780258", &format!("0 0 {half} {half} {dx} {dy} 0 0"))
        .replace("2026-03-01T00:00:10 0.14943813247359922 0 0 0.9887710779360422\n", "");
    let rate = first(&attitudes(&text)).rate_rad_s.unwrap();
    assert!((rate - wanted).length() < 1e-15, "{rate}");
}

/// Returns the metadata of [`AEM_2`] in XML.
pub(super) fn xml_metadata() -> String {
    AEM_2
        .lines()
        .skip_while(|line| *line != "META_START")
        .skip(1)
        .take_while(|line| *line != "META_STOP")
        .filter_map(|line| line.split_once(" = "))
        .map(|(key, value)| format!("<{key}>{value}</{key}>"))
        .collect()
}

#[test]
fn xml_has_what_kvn_has() {
    let state = "<attitudeState><quaternionEphemeris><EPOCH>2026-03-01T00:00:00</EPOCH><quaternion><QC>0.9950041652780258</QC>\
                 <Q1>0.09983341664682815</Q1><Q2>0</Q2><Q3>0</Q3></quaternion></quaternionEphemeris></attitudeState>";
    let metadata = xml_metadata();
    let text = format!(
        "<?xml version=\"1.0\"?>\n<aem id=\"CCSDS_AEM_VERS\" version=\"2.0\"><header/><body><segment><metadata>{metadata}\
         </metadata><data>{state}</data></segment></body></aem>"
    );
    let history = attitudes(&text);
    assert!(angle(&first(&history).body_from_icrf, &expected()) < 1e-15);
    assert_eq!(history.format, "CCSDS AEM 2.0 (XML)");
}

#[test]
fn time_systems_shift_an_attitude() {
    for (system, later_s) in [("TAI", -37.0), ("TT", -69.184), ("GPS", -18.0)] {
        let history = attitudes(&AEM_2.replace("= UTC", &format!("= {system}")));
        let shift = Tai::from_ns(first(&history).t_ns) - utc("2026-03-01T00:00:00Z");
        assert!((shift.s() - later_s).abs() < 1e-9, "{system}: {} s", shift.s());
    }
    let tdb = attitudes(&AEM_2.replace("= UTC", "= TDB"));
    assert!(tdb.notes[0].contains("within 60 us"), "{:?}", tdb.notes);
}

#[test]
fn the_bias_of_eme2000_is_applied_and_said() {
    let history = attitudes(&AEM_2.replace("= GCRF", "= EME2000"));
    let off = angle(&first(&history).body_from_icrf, &expected()) / base::units::MAS;
    assert!((20.0..30.0).contains(&off), "{off} mas");
    assert!(history.notes[0].contains("frame bias"), "{:?}", history.notes);
}

#[test]
fn tables_name_their_columns() {
    let (sin, cos) = 0.1_f64.sin_cos();
    for (text, times) in [
        (format!("t_s,q_w,q_x,q_y,q_z\n0,{cos},{},0,0\n", -sin), Times::FromZero),
        (format!("utc;q1;q2;q3;q4\n2026-03-01T00:00:00Z;{};0;0;{cos}\n", -sin), Times::Absolute),
        (format!("# sense: icrf_from_body\nunix_s q0 q1 q2 q3\n1772323200 {cos} {sin} 0 0\n"), Times::Absolute),
        (format!("tai_ns\tother\tw\tx\ty\tz\n1772323237000000000\t7\t{cos}\t{}\t0\t0\n", -sin), Times::Absolute),
    ] {
        let history = attitudes(&text);
        assert_eq!(history.times, times, "{text}");
        assert!(angle(&first(&history).body_from_icrf, &expected()) < 1e-15, "{text}");
        if times == Times::Absolute {
            assert_eq!(first(&history).t_ns, utc("2026-03-01T00:00:00Z").ns(), "{text}");
        }
    }
    let text = format!("t_s,q_w,q_x,q_y,q_z\n0,{cos},{sin},0,0\n");
    let read = |sense| read::attitudes("x.csv", &text, sense).unwrap();
    assert!(angle(&first(&read(Some(Sense::IcrfFromBody))).body_from_icrf, &expected()) < 1e-15);
    assert!(angle(&first(&read(None)).body_from_icrf, &expected()) > 0.3, "control: the sense counts");
    let rates = attitudes("t_s,w,x,y,z,w_x_deg_s,w_y_deg_s,w_z_deg_s\n0,1,0,0,0,90,0,0\n");
    let rate = first(&rates).rate_rad_s.unwrap();
    assert!((rate.x - core::f64::consts::FRAC_PI_2).abs() < 1e-15, "{rate}");
}

#[test]
fn stk_attitudes_are_read_in_three_forms() {
    let (sin, cos) = 0.1_f64.sin_cos();
    let with = |rows_are: &str, row: &str| {
        format!(
            "stk.v.11.0\n# written by hand\nBEGIN Attitude\nNumberOfAttitudePoints 1\nBlockingFactor 20\nInterpolationOrder 1\n\
             CentralBody Earth\nScenarioEpoch 1 Mar 2026 00:00:00.000000\nCoordinateAxes ICRF\n{rows_are}\n{row}\nEND Attitude\n"
        )
    };
    for (rows_are, row) in [
        ("AttitudeTimeQuaternions", format!("0.0 {sin} 0 0 {cos}")),
        ("AttitudeTimeQuatScalarFirst", format!("0.0 {cos} {sin} 0 0")),
        ("AttitudeTimeQuatAngVels", format!("0.0 {sin} 0 0 {cos} 1 2 3")),
    ] {
        let history = attitudes(&with(rows_are, &row));
        assert!(angle(&first(&history).body_from_icrf, &expected()) < 1e-15, "{rows_are}");
        assert_eq!(first(&history).t_ns, utc("2026-03-01T00:00:00Z").ns());
    }
}

#[test]
fn a_hash_within_a_word_is_no_remark() {
    let read = |fault: &str| attitudes(&format!("t_s,w,x,y,z,fault\n0,1,0,0,0,{fault}\n1,1,0,0,0,none # the end\n"));
    assert_eq!(read("stray_light_ramp#1=47.6 e-/s").segments()[0].states().len(), 2);
    assert_eq!(read("none # remark").segments()[0].states().len(), 2, "control: a remark behind a blank");
}
