//! Histories as text: CCSDS AEM and OEM, STK `.a` and `.e`, CSV. What is written here is read back to 1e-12 (tests).
//!
//! Times of CCSDS messages are UTC with nanoseconds, axes GCRF (parallel to ICRF), numbers as short as they read back. One
//! block of STK has no gaps: segments follow each other in it, which a remark says.

use crate::attitude::{AttitudeHistory, AttitudeSegment, Times};
use crate::attitude_methods::{AttitudeInterpolation, AttitudeState};
use crate::epoch::{stk_date, utc_text};
use crate::orbit::{OrbitHistory, OrbitInterpolation, OrbitSegment, OrbitState};
use base::{time::Tai, units::NS_PER_S, xml::escaped};
use glam::DVec3;
use std::io::{self, Write};

/// A format of attitudes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum AttitudeFormat {
    /// CCSDS AEM, version 1, KVN: quaternions only.
    Aem1,
    /// CCSDS AEM, version 2, KVN.
    Aem2,
    /// CCSDS AEM, version 2, XML.
    Aem2Xml,
    /// STK `.a`.
    Stk,
    /// CSV with named columns.
    Csv,
}

/// A format of orbits.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OrbitFormat {
    /// CCSDS OEM, version 2, KVN.
    Oem,
    /// CCSDS OEM, version 2, XML.
    OemXml,
    /// STK `.e`.
    Stk,
    /// CSV with named columns.
    Csv,
}

/// Writes a history with absolute times.
///
/// # Errors
/// When the output fails.
pub fn attitudes(
    out: &mut dyn Write,
    format: AttitudeFormat,
    history: &AttitudeHistory,
    header: &Header,
) -> io::Result<()> {
    match format {
        AttitudeFormat::Aem1 => aem_kvn(out, history, header, true),
        AttitudeFormat::Aem2 => aem_kvn(out, history, header, false),
        AttitudeFormat::Aem2Xml => aem_xml(out, history, header),
        AttitudeFormat::Stk => stk_attitude(out, history),
        AttitudeFormat::Csv => csv_attitude(out, history, header),
    }
}

/// Writes an orbit.
///
/// # Errors
/// When the output fails.
pub fn orbit(out: &mut dyn Write, format: OrbitFormat, history: &OrbitHistory, header: &Header) -> io::Result<()> {
    match format {
        OrbitFormat::Oem => oem_kvn(out, history, header),
        OrbitFormat::OemXml => oem_xml(out, history, header),
        OrbitFormat::Stk => stk_ephemeris(out, history),
        OrbitFormat::Csv => csv_orbit(out, history),
    }
}

/// Values of the header of a written file.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    /// Name of the object.
    pub object_name: String,
    /// International designator of the object, or UNKNOWN.
    pub object_id: String,
    /// Name of the axes whose attitude it is, such as SC_BODY_1.
    pub body: String,
    /// When the file is made.
    pub created: Tai,
}

fn csv_attitude(out: &mut dyn Write, history: &AttitudeHistory, header: &Header) -> io::Result<()> {
    let states = || history.segments().iter().flat_map(|segment| segment.states());
    let has_rates = states().all(|state| state.rate_rad_s.is_some());
    writeln!(out, "# attitude of {} ({}); v_body = q v_icrf q*", header.object_name, header.body)?;
    writeln!(out, "# sense: body_from_icrf\n# axes: ICRF")?;
    let is_absolute = history.times == Times::Absolute;
    let time = if is_absolute { "utc,tai_ns" } else { "t_s" };
    let rates = if has_rates { ",w_x_rad_s,w_y_rad_s,w_z_rad_s" } else { "" };
    writeln!(out, "{time},q_w,q_x,q_y,q_z{rates},segment")?;
    for (segment, number) in history.segments().iter().zip(1..) {
        for state in segment.states() {
            if is_absolute {
                write!(out, "{},{}", utc_text(Tai::from_ns(state.t_ns)), state.t_ns)?;
            } else {
                write!(out, "{}", state.t_ns as f64 * 1e-9)?;
            }
            let [w, x, y, z] = state.body_from_icrf.wxyz();
            write!(out, ",{w},{x},{y},{z}")?;
            if let Some(rate) = state.rate_rad_s.filter(|_| has_rates) {
                write!(out, ",{},{},{}", rate.x, rate.y, rate.z)?;
            }
            writeln!(out, ",{number}")?;
        }
    }
    out.flush()
}

fn csv_orbit(out: &mut dyn Write, history: &OrbitHistory) -> io::Result<()> {
    writeln!(out, "# centre: {}\n# axes: ICRF", history.centre.name())?;
    writeln!(out, "utc,tai_ns,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s,segment")?;
    for (segment, number) in history.segments().iter().zip(1..) {
        for state in segment.states() {
            let (p, v) = (state.position_km, state.velocity_km_s);
            write!(out, "{},{}", utc_text(Tai::from_ns(state.t_ns)), state.t_ns)?;
            writeln!(out, ",{},{},{},{},{},{},{number}", p.x, p.y, p.z, v.x, v.y, v.z)?;
        }
    }
    out.flush()
}

/// Returns seconds from the epoch, exact to the nanosecond.
fn seconds(t_ns: i64, epoch_ns: i64) -> String {
    let off_ns = t_ns.saturating_sub(epoch_ns);
    format!("{}.{:09}", off_ns / NS_PER_S, off_ns % NS_PER_S)
}

fn stk_begin(out: &mut dyn Write, name: &str, rows: usize, epoch_ns: i64, segments: usize) -> io::Result<()> {
    writeln!(out, "stk.v.11.0")?;
    if segments > 1 {
        writeln!(out, "# {segments} segments in one block: the gaps between them are not marked")?;
    }
    writeln!(out, "BEGIN {name}\nNumberOf{name}Points {rows}\nScenarioEpoch {}", stk_date(Tai::from_ns(epoch_ns)))
}

fn stk_attitude(out: &mut dyn Write, history: &AttitudeHistory) -> io::Result<()> {
    let states = || history.segments().iter().flat_map(|segment| segment.states());
    let epoch_ns = states().next().map_or(0, |state| state.t_ns);
    let has_rates = states().all(|state| state.rate_rad_s.is_some());
    stk_begin(out, "Attitude", history.rows(), epoch_ns, history.segments().len())?;
    let rows_are = if has_rates { "AttitudeTimeQuatAngVels" } else { "AttitudeTimeQuaternions" };
    writeln!(out, "CentralBody Earth\nCoordinateAxes ICRF\n{rows_are}")?;
    let mut last = [0.0; 4];
    for state in states() {
        attitude_row(out, &seconds(state.t_ns, epoch_ns), state, &mut last, has_rates)?;
    }
    writeln!(out, "END Attitude")?;
    out.flush()
}

fn stk_ephemeris(out: &mut dyn Write, history: &OrbitHistory) -> io::Result<()> {
    let states = || history.segments().iter().flat_map(|segment| segment.states());
    let epoch_ns = states().next().map_or(0, |state| state.t_ns);
    stk_begin(out, "Ephemeris", history.rows(), epoch_ns, history.segments().len())?;
    let mut name = history.centre.name().to_ascii_lowercase();
    name.get_mut(..1).into_iter().for_each(str::make_ascii_uppercase);
    writeln!(out, "CentralBody {name}\nCoordinateSystem ICRF\nDistanceUnit Kilometers")?;
    writeln!(out, "InterpolationMethod Hermite\nInterpolationSamplesM1 1\nEphemerisTimePosVel")?;
    for state in states() {
        orbit_row(out, &seconds(state.t_ns, epoch_ns), state)?;
    }
    writeln!(out, "END Ephemeris")?;
    out.flush()
}

fn time(t_ns: i64) -> String {
    utc_text(Tai::from_ns(t_ns))
}

/// Returns Q1 Q2 Q3 QC of a turn of axes: the conjugate of this program's quaternion, scalar last, with the sign that
/// continues `last`, for readers that interpolate its components.
fn q1_q2_q3_qc(state: &AttitudeState, last: &mut [f64; 4]) -> [f64; 4] {
    let [w, x, y, z] = state.body_from_icrf.wxyz();
    let quaternion = [-x, -y, -z, w];
    let along: f64 = quaternion.iter().zip(&*last).map(|(a, b)| a * b).sum();
    *last = if along < 0.0 { quaternion.map(|number| -number) } else { quaternion };
    *last
}

fn has_rates(segment: &AttitudeSegment) -> bool {
    segment.states().iter().all(|state| state.rate_rad_s.is_some())
}

fn rate_deg_s(state: &AttitudeState) -> DVec3 {
    state.rate_rad_s.unwrap_or_default().map(f64::to_degrees)
}

/// Writes a row of an attitude: its time, Q1 Q2 Q3 QC and, where it is wanted, its rate.
fn attitude_row(
    out: &mut dyn Write,
    time: &str,
    state: &AttitudeState,
    last: &mut [f64; 4],
    with_rate: bool,
) -> io::Result<()> {
    let [a, b, c, d] = q1_q2_q3_qc(state, last);
    write!(out, "{time} {a} {b} {c} {d}")?;
    if with_rate {
        let rate = rate_deg_s(state);
        write!(out, " {} {} {}", rate.x, rate.y, rate.z)?;
    }
    writeln!(out)
}

/// Writes a row of an orbit: its time, position and velocity.
fn orbit_row(out: &mut dyn Write, time: &str, state: &OrbitState) -> io::Result<()> {
    let (p, v) = (state.position_km, state.velocity_km_s);
    writeln!(out, "{time} {} {} {} {} {} {}", p.x, p.y, p.z, v.x, v.y, v.z)
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

fn aem_kvn(out: &mut dyn Write, history: &AttitudeHistory, header: &Header, is_first: bool) -> io::Result<()> {
    let version = if is_first { "1.0" } else { "2.0" };
    kvn_header(out, "CCSDS_AEM_VERS", version, header)?;
    for segment in history.segments() {
        kvn_metadata(out, attitude_metadata(segment, header, is_first))?;
        writeln!(out, "DATA_START")?;
        let with_rates = has_rates(segment) && !is_first;
        let mut last = [0.0; 4];
        for state in segment.states() {
            attitude_row(out, &time(state.t_ns), state, &mut last, with_rates)?;
        }
        writeln!(out, "DATA_STOP")?;
    }
    out.flush()
}

fn aem_xml(out: &mut dyn Write, history: &AttitudeHistory, header: &Header) -> io::Result<()> {
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

fn oem_kvn(out: &mut dyn Write, history: &OrbitHistory, header: &Header) -> io::Result<()> {
    kvn_header(out, "CCSDS_OEM_VERS", "2.0", header)?;
    for segment in history.segments() {
        kvn_metadata(out, orbit_metadata(history, segment, header))?;
        for state in segment.states() {
            orbit_row(out, &time(state.t_ns), state)?;
        }
    }
    out.flush()
}

fn oem_xml(out: &mut dyn Write, history: &OrbitHistory, header: &Header) -> io::Result<()> {
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

fn kvn_metadata(out: &mut dyn Write, entries: Vec<(&'static str, String)>) -> io::Result<()> {
    writeln!(out, "\nMETA_START")?;
    for (key, value) in entries {
        writeln!(out, "{key} = {value}")?;
    }
    writeln!(out, "META_STOP\n")
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
