//! Whole files: what is read from them, what is refused, what comes back after writing.

mod aem_rows;
mod attitude;
mod contradictions;
mod files;
mod orbit;
mod refusals;
mod round_trips;
mod statements;

use crate::{AttitudeHistory, AttitudeState, OrbitHistory, read};
use base::axes::{Body, Icrf, Rotation};
use base::time::Tai;
use glam::DVec3;

fn utc(text: &str) -> Tai {
    Tai::from_rfc3339(text).unwrap()
}

fn attitudes(text: &str) -> AttitudeHistory {
    read::attitudes("x.aem", text, None).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

fn orbit(text: &str) -> OrbitHistory {
    read::orbit("x.oem", text).unwrap_or_else(|error| panic!("{error}\n{text}"))
}

fn turned(v_rad: DVec3) -> Rotation<Body, Icrf> {
    Rotation::IDENTITY.rotated_by(v_rad)
}

fn angle(a: &Rotation<Body, Icrf>, b: &Rotation<Body, Icrf>) -> f64 {
    a.rotation_vector_to(b).length()
}

/// States of a motion, `step_s` apart from 2026-03-01T00:00:00 UTC; `t_s` to attitude and rate.
fn sampled(count: u32, step_s: f64, motion: impl Fn(f64) -> (Rotation<Body, Icrf>, DVec3)) -> Vec<AttitudeState> {
    let zero = utc("2026-03-01T00:00:00Z");
    let state = |i: u32| {
        let t_s = f64::from(i) * step_s;
        let (body_from_icrf, rate_rad_s) = motion(t_s);
        let t_ns = (zero + base::time::Span::from_s(t_s)).ns();
        AttitudeState { t_ns, body_from_icrf, rate_rad_s: Some(rate_rad_s) }
    };
    (0..count).map(state).collect()
}

/// One attitude, the body turned by +0.2 rad about its x axis, at 2026-03-01T00:00:00 UTC, and 0.3 rad ten seconds
/// later.
const AEM_2: &str = "CCSDS_AEM_VERS = 2.0
CREATION_DATE = 2026-01-01T00:00:00
ORIGINATOR = TEST
COMMENT turned about x
META_START
OBJECT_NAME = SAT
OBJECT_ID = 2026-001A
REF_FRAME_A = GCRF
REF_FRAME_B = SC_BODY_1
TIME_SYSTEM = UTC
START_TIME = 2026-03-01T00:00:00
STOP_TIME = 2026-03-01T00:00:10
ATTITUDE_TYPE = QUATERNION
META_STOP
DATA_START
2026-03-01T00:00:00 0.09983341664682815 0 0 0.9950041652780258
2026-03-01T00:00:10 0.14943813247359922 0 0 0.9887710779360422
DATA_STOP
";

/// Returns a circle of 7000 km radius about the Earth in steps of 60 s, one revolution in 5400 s or so.
fn oem(rows: u32, step_s: f64) -> String {
    let (radius_km, rate_rad_s) = (7000.0, 1.1e-3);
    let zero = utc("2026-03-01T00:00:00Z");
    let mut text = String::from(
        "CCSDS_OEM_VERS = 2.0\nCREATION_DATE = 2026-01-01T00:00:00\nORIGINATOR = TEST\nMETA_START\nOBJECT_NAME = SAT\n\
         OBJECT_ID = 2026-001A\nCENTER_NAME = EARTH\nREF_FRAME = ICRF\nTIME_SYSTEM = UTC\nSTART_TIME = \
         2026-03-01T00:00:00\nSTOP_TIME = 2026-03-02T00:00:00\nMETA_STOP\n",
    );
    for i in 0..rows {
        let t_s = f64::from(i) * step_s;
        let (sin, cos) = (rate_rad_s * t_s).sin_cos();
        let at = zero + base::time::Span::from_s(t_s);
        let [x, y, v] = [radius_km * cos, radius_km * sin, radius_km * rate_rad_s];
        text += &format!("{} {x} {y} 0 {} {} 0\n", crate::epoch::utc_text(at), -v * sin, v * cos);
    }
    text
}
