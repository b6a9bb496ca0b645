//! CCSDS AEM and OEM as text. Times are UTC with nanoseconds, axes GCRF (parallel to ICRF), numbers as short as they
//! read back.

use crate::attitude::{AttitudeHistory, AttitudeSegment};
use crate::orbit::{OrbitHistory, OrbitInterpolation, OrbitSegment, OrbitState};
use crate::{
    attitude_methods::AttitudeInterpolation, attitude_state::AttitudeState, epoch::utc_text, write_header::Header,
};
use base::{time::Tai, xml::escaped};
use glam::DVec3;
use std::io::{self, Write};

fn time(t_ns: i64) -> String {
    utc_text(Tai::from_ns(t_ns))
}

/// Returns Q1 Q2 Q3 QC of a turn of axes: the conjugate of this program's quaternion, scalar last, with the sign that
/// continues `last`, for readers that interpolate its components.
pub(crate) fn q1_q2_q3_qc(state: &AttitudeState, last: &mut [f64; 4]) -> [f64; 4] {
    let [w, x, y, z] = state.body_from_icrf.wxyz();
    let quaternion = [-x, -y, -z, w];
    let along: f64 = quaternion.iter().zip(&*last).map(|(a, b)| a * b).sum();
    *last = if along < 0.0 { quaternion.map(|number| -number) } else { quaternion };
    *last
}

fn has_rates(segment: &AttitudeSegment) -> bool {
    segment.states().iter().all(|state| state.rate_rad_s.is_some())
}

pub(crate) fn rate_deg_s(state: &AttitudeState) -> DVec3 {
    state.rate_rad_s.unwrap_or_default().map(f64::to_degrees)
}

/// Returns `KEY, VALUE` of a segment of attitudes.
fn attitude_metadata(segment: &AttitudeSegment, header: &Header, is_first: bool) -> Vec<(&'static str, String)> {
    let [begin, end] = [segment.states().first(), segment.states().last()].map(|state| state.map_or(0, |s| s.t_ns));
    let with_rates = has_rates(segment) && !is_first;
    let mut all = vec![
        ("OBJECT_NAME", header.object_name.clone()),
        ("OBJECT_ID", header.object_id.clone()),
        ("REF_FRAME_A", "GCRF".into()),
        ("REF_FRAME_B", header.body.clone()),
    ];
    if is_first {
        all.push(("ATTITUDE_DIR", "A2B".into()));
    }
    all.push(("TIME_SYSTEM", "UTC".into()));
    all.push(("START_TIME", time(begin)));
    let usable = segment.usable_ns();
    if usable != [begin, end] {
        all.push(("USEABLE_START_TIME", time(usable[0])));
        all.push(("USEABLE_STOP_TIME", time(usable[1])));
    }
    all.push(("STOP_TIME", time(end)));
    all.push(("ATTITUDE_TYPE", if with_rates { "QUATERNION/ANGVEL" } else { "QUATERNION" }.into()));
    if is_first {
        all.push(("QUATERNION_TYPE", "LAST".into()));
    }
    if with_rates {
        all.push(("ANGVEL_FRAME", header.body.clone()));
    }
    let interpolation = match segment.method() {
        AttitudeInterpolation::Slerp => Some(("LINEAR", 1)),
        AttitudeInterpolation::CubicHermite | AttitudeInterpolation::ConstantRate if with_rates => Some(("HERMITE", 3)),
        AttitudeInterpolation::CubicHermite | AttitudeInterpolation::ConstantRate => None,
        AttitudeInterpolation::Lagrange(degree) => Some(("LAGRANGE", degree)),
    };
    if let Some((method, degree)) = interpolation {
        all.push(("INTERPOLATION_METHOD", method.into()));
        all.push(("INTERPOLATION_DEGREE", degree.to_string()));
    }
    all
}

pub(crate) fn aem_kvn(
    out: &mut dyn Write,
    history: &AttitudeHistory,
    header: &Header,
    is_first: bool,
) -> io::Result<()> {
    let version = if is_first { "1.0" } else { "2.0" };
    kvn_header(out, "CCSDS_AEM_VERS", version, header)?;
    for segment in history.segments() {
        writeln!(out, "\nMETA_START")?;
        for (key, value) in attitude_metadata(segment, header, is_first) {
            writeln!(out, "{key} = {value}")?;
        }
        writeln!(out, "META_STOP\n\nDATA_START")?;
        let with_rates = has_rates(segment) && !is_first;
        let mut last = [0.0; 4];
        for state in segment.states() {
            let [a, b, c, d] = q1_q2_q3_qc(state, &mut last);
            write!(out, "{} {a} {b} {c} {d}", time(state.t_ns))?;
            if with_rates {
                let rate = rate_deg_s(state);
                write!(out, " {} {} {}", rate.x, rate.y, rate.z)?;
            }
            writeln!(out)?;
        }
        writeln!(out, "DATA_STOP")?;
    }
    out.flush()
}

pub(crate) fn aem_xml(out: &mut dyn Write, history: &AttitudeHistory, header: &Header) -> io::Result<()> {
    xml_header(out, "aem", "CCSDS_AEM_VERS", header)?;
    for segment in history.segments() {
        xml_metadata(out, attitude_metadata(segment, header, false))?;
        let with_rates = has_rates(segment);
        let state_name = if with_rates { "quaternionAngVel" } else { "quaternionEphemeris" };
        let mut last = [0.0; 4];
        for state in segment.states() {
            let [a, b, c, d] = q1_q2_q3_qc(state, &mut last);
            write!(out, "<attitudeState><{state_name}><EPOCH>{}</EPOCH>", time(state.t_ns))?;
            write!(out, "<quaternion><Q1>{a}</Q1><Q2>{b}</Q2><Q3>{c}</Q3><QC>{d}</QC></quaternion>")?;
            if with_rates {
                write!(out, "<angVel>")?;
                for (axis, value) in ["X", "Y", "Z"].iter().zip(rate_deg_s(state).to_array()) {
                    write!(out, "<ANGVEL_{axis} units=\"deg/s\">{value}</ANGVEL_{axis}>")?;
                }
                write!(out, "</angVel>")?;
            }
            writeln!(out, "</{state_name}></attitudeState>")?;
        }
        writeln!(out, "</data>\n</segment>")?;
    }
    writeln!(out, "</body>\n</aem>")?;
    out.flush()
}

/// Returns `KEY, VALUE` of a segment of an orbit.
fn orbit_metadata(history: &OrbitHistory, segment: &OrbitSegment, header: &Header) -> Vec<(&'static str, String)> {
    let [begin, end] = [segment.states().first(), segment.states().last()].map(|state| state.map_or(0, |s| s.t_ns));
    let (method, degree) = match segment.method() {
        OrbitInterpolation::Hermite { rows } => ("HERMITE", 2 * rows - 1),
        OrbitInterpolation::Lagrange(degree) => ("LAGRANGE", degree),
        OrbitInterpolation::Chebyshev => ("HERMITE", 3),
    };
    vec![
        ("OBJECT_NAME", header.object_name.clone()),
        ("OBJECT_ID", header.object_id.clone()),
        ("CENTER_NAME", history.centre.name().into()),
        ("REF_FRAME", "GCRF".into()),
        ("TIME_SYSTEM", "UTC".into()),
        ("START_TIME", time(begin)),
        ("STOP_TIME", time(end)),
        ("INTERPOLATION", method.into()),
        ("INTERPOLATION_DEGREE", degree.to_string()),
    ]
}

pub(crate) fn oem_kvn(out: &mut dyn Write, history: &OrbitHistory, header: &Header) -> io::Result<()> {
    kvn_header(out, "CCSDS_OEM_VERS", "2.0", header)?;
    for segment in history.segments() {
        writeln!(out, "\nMETA_START")?;
        for (key, value) in orbit_metadata(history, segment, header) {
            writeln!(out, "{key} = {value}")?;
        }
        writeln!(out, "META_STOP\n")?;
        for OrbitState { t_ns, position_km: p, velocity_km_s: v } in segment.states() {
            writeln!(out, "{} {} {} {} {} {} {}", time(*t_ns), p.x, p.y, p.z, v.x, v.y, v.z)?;
        }
    }
    out.flush()
}

pub(crate) fn oem_xml(out: &mut dyn Write, history: &OrbitHistory, header: &Header) -> io::Result<()> {
    xml_header(out, "oem", "CCSDS_OEM_VERS", header)?;
    for segment in history.segments() {
        xml_metadata(out, orbit_metadata(history, segment, header))?;
        for OrbitState { t_ns, position_km: p, velocity_km_s: v } in segment.states() {
            write!(out, "<stateVector><EPOCH>{}</EPOCH>", time(*t_ns))?;
            for (axis, p) in ["X", "Y", "Z"].iter().zip(p.to_array()) {
                write!(out, "<{axis}>{p}</{axis}>")?;
            }
            for (axis, v) in ["X", "Y", "Z"].iter().zip(v.to_array()) {
                write!(out, "<{axis}_DOT>{v}</{axis}_DOT>")?;
            }
            writeln!(out, "</stateVector>")?;
        }
        writeln!(out, "</data>\n</segment>")?;
    }
    writeln!(out, "</body>\n</oem>")?;
    out.flush()
}

fn kvn_header(out: &mut dyn Write, key: &str, version: &str, header: &Header) -> io::Result<()> {
    writeln!(out, "{key} = {version}\nCREATION_DATE = {}\nORIGINATOR = STARLOOP", utc_text(header.created))
}

fn xml_header(out: &mut dyn Write, root: &str, key: &str, header: &Header) -> io::Result<()> {
    writeln!(out, "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<{root} id=\"{key}\" version=\"2.0\">")?;
    writeln!(out, "<header>\n<CREATION_DATE>{}</CREATION_DATE>", utc_text(header.created))?;
    writeln!(out, "<ORIGINATOR>STARLOOP</ORIGINATOR>\n</header>\n<body>")
}

fn xml_metadata(out: &mut dyn Write, entries: Vec<(&'static str, String)>) -> io::Result<()> {
    writeln!(out, "<segment>\n<metadata>")?;
    for (key, value) in entries {
        writeln!(out, "<{key}>{}</{key}>", escaped(&value))?;
    }
    writeln!(out, "</metadata>\n<data>")
}
