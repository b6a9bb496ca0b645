//! Written files are read back; a swapped sign is noticed.

use super::*;
use crate::write::{AttitudeFormat, Header, OrbitFormat};
use crate::{AttitudeHistory, Centre, OrbitState, write};

/// Through decimal text and f64: a few ulp.
const ROUND_TRIP: f64 = 1e-12;

fn header() -> Header {
    Header {
        object_name: "SAT <1>".into(),
        object_id: "UNKNOWN".into(),
        body: "SC_BODY_1".into(),
        created: utc("2026-01-01T00:00:00Z"),
    }
}

fn tumbling() -> AttitudeHistory {
    let motion = |t_s: f64| {
        let rate = DVec3::new(0.3, -0.2, 0.5);
        (turned(rate * t_s), rate)
    };
    AttitudeHistory::of_states(sampled(20, 0.7, motion)).unwrap()
}

fn written(format: AttitudeFormat, history: &AttitudeHistory) -> String {
    let mut out = Vec::new();
    write::attitudes(&mut out, format, history, &header()).unwrap();
    String::from_utf8(out).unwrap()
}

/// Returns the largest differences of rows: attitude, rate.
fn differences(a: &AttitudeHistory, b: &AttitudeHistory) -> [f64; 2] {
    assert_eq!(a.rows(), b.rows());
    let states = |history: &AttitudeHistory| -> Vec<AttitudeState> {
        history.segments().iter().flat_map(|segment| segment.states().to_vec()).collect()
    };
    states(a).iter().zip(&states(b)).fold([0.0; 2], |[rad, rad_s]: [f64; 2], (a, b)| {
        assert_eq!(a.t_ns, b.t_ns);
        let rate = |state: &AttitudeState| state.rate_rad_s.unwrap_or_default();
        let off = if b.rate_rad_s.is_some() { (rate(a) - rate(b)).length() } else { 0.0 };
        [rad.max(angle(&a.body_from_icrf, &b.body_from_icrf)), rad_s.max(off)]
    })
}

const FORMATS: [AttitudeFormat; 5] =
    [AttitudeFormat::Aem1, AttitudeFormat::Aem2, AttitudeFormat::Aem2Xml, AttitudeFormat::Stk, AttitudeFormat::Csv];

#[test]
fn attitudes_survive_every_format() {
    let history = tumbling();
    for format in FORMATS {
        let text = written(format, &history);
        let back = attitudes(&text);
        let [rad, rad_s] = differences(&history, &back);
        assert!(rad < ROUND_TRIP && rad_s < ROUND_TRIP, "{format:?}: {rad} rad, {rad_s} rad/s\n{text}");
        let has_rates = back.segments()[0].states()[0].rate_rad_s.is_some();
        assert_eq!(has_rates, format != AttitudeFormat::Aem1, "{format:?}");
    }
    let wrong = written(AttitudeFormat::Aem1, &history).replace("= A2B", "= B2A");
    assert!(differences(&history, &attitudes(&wrong))[0] > 0.1, "control: a conjugated quaternion is noticed");
}

#[test]
fn gaps_survive_where_a_format_has_them() {
    let second = AEM_2.split_once("META_START").unwrap().1;
    let second = second.replace("T00:00:00", "T00:01:00").replace("T00:00:10", "T00:01:10");
    let history = attitudes(&format!("{AEM_2}META_START{second}"));
    for format in [AttitudeFormat::Aem1, AttitudeFormat::Aem2, AttitudeFormat::Aem2Xml, AttitudeFormat::Csv] {
        let back = attitudes(&written(format, &history));
        assert_eq!(back.segments().len(), 2, "{format:?}");
        assert!(back.at(utc("2026-03-01T00:00:30Z")).is_none(), "{format:?}");
    }
}

#[test]
fn orbits_survive_every_format() {
    let zero = utc("2026-03-01T00:00:00Z").ns();
    let state = |i: i64| OrbitState {
        t_ns: zero + i * 10_000_000_123,
        position_km: DVec3::new(7000.1 + i as f64, 5.0 * i as f64 - 12.3, 1e-7 - 3.0 * i as f64),
        velocity_km_s: DVec3::new(0.1, 0.5, -0.3),
    };
    for centre in [Centre::Earth, Centre::Moon, Centre::Sun] {
        let history = OrbitHistory::of_states(centre, (0..5).map(state).collect()).unwrap();
        for format in [OrbitFormat::Oem, OrbitFormat::OemXml, OrbitFormat::Stk, OrbitFormat::Csv] {
            let mut out = Vec::new();
            write::orbit(&mut out, format, &history, &header()).unwrap();
            let back = orbit(&String::from_utf8(out).unwrap());
            assert_eq!(back.centre, centre, "{format:?}");
            assert_eq!(back.segments()[0].states(), history.segments()[0].states(), "{format:?}");
        }
    }
}
