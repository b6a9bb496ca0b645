//! CCSDS AEM, versions 1 and 2: a message -> attitudes.
//!
//! | fact | version 1 | version 2 |
//! |---|---|---|
//! | direction | ATTITUDE_DIR, A2B or B2A | always from REF_FRAME_A to REF_FRAME_B |
//! | order | QUATERNION_TYPE, FIRST or LAST (scalar) | scalar last |
//! | rates | QUATERNION/DERIVATIVE; those of QUATERNION/RATE are left out | QUATERNION/DERIVATIVE, QUATERNION/ANGVEL (deg/s) |
//!
//! One of the frames is inertial, the other that of the spacecraft. A quaternion from inertial to body axes is the
//! conjugate of this program's: CCSDS's turns the axes, ours rewrites vectors. EULER_ANGLE and SPIN are refused.

use crate::attitude::{AttitudeHistory, AttitudeSegment, AttitudeState, Times};
use crate::attitude_methods::{AttitudeInterpolation, rate_of_derivative};
use crate::epoch::TimeSystem;
use crate::error::{HistoryError, Source};
use crate::message::{Kind, Message, Segment};
use crate::metadata::{Metadata, Wanted, numbers};
use crate::reference_axes::{ReferenceAxes, WANTED_AXES};
use base::axes::{Rotation, WRITTEN_NORM_TOLERANCE};
use glam::{DQuat, DVec3};

/// Beginnings of frame names that are neither inertial nor those of a spacecraft.
const NOT_A_BODY: [&str; 20] = [
    "ITRF", "TEME", "TOD", "MOD", "TNW", "RTN", "RSW", "LVLH", "QSW", "NTW", "PQW", "VNC", "GTOD", "TIRS", "CIRS",
    "GRC", "EFG", "WGS84", "DTRF", "FIXED",
];

/// Reads an AEM.
pub(crate) fn read(source: &Source<'_>) -> Result<AttitudeHistory, HistoryError> {
    Message::with(source, Kind::Attitude, |message| {
        let is_first = match message.version.split('.').next() {
            Some("1") => true,
            Some("2") => false,
            Some(_) | None => {
                let wanted = "AEM version 1.0 or 2.0";
                return Err(source.whole(format!("version \"{}\"; wanted {wanted}", message.version)));
            }
        };
        let mut notes = Vec::new();
        let mut segments = Vec::new();
        let mut body: Option<(&str, Option<&str>)> = None;
        for segment in &message.segments {
            let metadata = Metadata { source: *source, segment };
            let frames = Frames::read(&metadata, is_first)?;
            let who = (frames.body, metadata.value("OBJECT_ID"));
            if body.is_some_and(|body| body != who) {
                let wanted = "one object and one spacecraft frame in all segments: split the file";
                return Err(source.refuse(segment.offset, frames.body, wanted));
            }
            body = Some(who);
            segments.push(attitudes(&metadata, &frames, is_first, &mut notes)?);
        }
        let fit = AttitudeHistory::new(&message.format(Kind::Attitude), Times::Absolute, segments);
        let mut history = fit.map_err(|error| source.whole(error.to_string()))?;
        notes.dedup();
        history.notes = notes;
        let object = message.segments.first().map(|segment| Metadata { source: *source, segment });
        let object = object.and_then(|metadata| metadata.value("OBJECT_NAME")).unwrap_or("unnamed");
        history.name = body.map(|(body, _)| format!("{object}, {body}"));
        Ok(history)
    })
}

/// The frames of a segment, and the direction of its quaternions.
struct Frames<'m> {
    axes: ReferenceAxes,
    body: &'m str,
    /// Quaternions turn the inertial axes into those of the body.
    is_to_body: bool,
}

impl<'m> Frames<'m> {
    fn read(metadata: &Metadata<'m>, is_first: bool) -> Result<Self, HistoryError> {
        let [a, b] = [metadata.needed("REF_FRAME_A")?, metadata.needed("REF_FRAME_B")?];
        let [axes_a, axes_b] = [a, b].map(|entry| ReferenceAxes::of_name(entry.value));
        let (axes, body, a_is_inertial) = match (axes_a, axes_b) {
            (Some(axes), None) => (axes, b, true),
            (None, Some(axes)) => (axes, a, false),
            (Some(_), Some(_)) => return Err(metadata.refuse(b, "a spacecraft frame, such as SC_BODY_1")),
            (None, None) => return Err(metadata.refuse(a, &format!("one frame with {WANTED_AXES}"))),
        };
        let name = body.value.to_ascii_uppercase();
        if body.value.is_empty() || NOT_A_BODY.iter().any(|known| name.starts_with(known)) {
            return Err(metadata.refuse(body, "a spacecraft frame, such as SC_BODY_1"));
        }
        let is_a_to_b = if is_first { direction(metadata)? } else { true };
        Ok(Self { axes, body: body.value, is_to_body: is_a_to_b == a_is_inertial })
    }

    /// This program's quaternion of the file's.
    fn body_from_axes(&self, quaternion: DQuat) -> DQuat {
        if self.is_to_body { quaternion.conjugate() } else { quaternion }
    }

    /// A rate of the frame B with respect to A, in the axes of one of them, as a rate of the body in its own axes.
    fn body_rate(&self, rate_rad_s: DVec3, is_in_body: bool, body_from_axes: DQuat) -> DVec3 {
        let in_body = if is_in_body { rate_rad_s } else { body_from_axes * rate_rad_s };
        if self.is_to_body { in_body } else { -in_body }
    }
}

/// Whether version 1 goes from A to B.
fn direction(metadata: &Metadata<'_>) -> Result<bool, HistoryError> {
    let entry = metadata.needed("ATTITUDE_DIR")?;
    match entry.value {
        "A2B" => Ok(true),
        "B2A" => Ok(false),
        _ => Err(metadata.refuse(entry, "A2B or B2A")),
    }
}

/// What follows the quaternion in a row.
#[derive(Clone, Copy, PartialEq)]
enum Beside {
    Nothing,
    Derivative,
    /// Rates of three angles, whose meaning version 1 leaves open.
    Unused,
    /// Body rates in deg/s; true: in the axes of the body.
    Rate(bool),
}

fn beside(metadata: &Metadata<'_>, frames: &Frames<'_>, is_first: bool) -> Result<Beside, HistoryError> {
    let entry = metadata.needed("ATTITUDE_TYPE")?;
    let kind = entry.value.to_ascii_uppercase().replace('_', "/");
    match (kind.as_str(), is_first) {
        ("QUATERNION", _) => Ok(Beside::Nothing),
        ("QUATERNION/DERIVATIVE", _) => Ok(Beside::Derivative),
        ("QUATERNION/RATE", true) => Ok(Beside::Unused),
        ("QUATERNION/ANGVEL", false) => {
            let axes = metadata.needed("ANGVEL_FRAME")?;
            let [a, b] = [metadata.value("REF_FRAME_A"), metadata.value("REF_FRAME_B")];
            let is_in_body = match axes.value {
                "REF_FRAME_A" => a == Some(frames.body),
                "REF_FRAME_B" => b == Some(frames.body),
                name if name == frames.body => true,
                name if Some(name) == a || Some(name) == b => false,
                _ => return Err(metadata.refuse(axes, "REF_FRAME_A or REF_FRAME_B, or the name of one of them")),
            };
            Ok(Beside::Rate(is_in_body))
        }
        _ => Err(metadata.refuse(
            entry,
            "attitudes as quaternions (QUATERNION, QUATERNION/DERIVATIVE, QUATERNION/ANGVEL, or QUATERNION/RATE of \
             version 1): write the file so, Euler angles and spin are not read",
        )),
    }
}

fn attitudes(
    metadata: &Metadata<'_>,
    frames: &Frames<'_>,
    is_first: bool,
    notes: &mut Vec<String>,
) -> Result<AttitudeSegment, HistoryError> {
    let (source, segment) = (&metadata.source, metadata.segment);
    let system = metadata.time_system()?;
    let beside = beside(metadata, frames, is_first)?;
    let scalar_first = is_first && is_scalar_first(metadata, segment)?;
    let states = segment.rows.iter().map(|row| {
        let (at, values) = numbers::<8>(source, row, system, counts(beside))?;
        let state = state(at.ns(), values, beside, scalar_first, frames);
        state.ok_or_else(|| source.refuse(row.offset, &row.text, "a quaternion whose norm is 1 within 0.001"))
    });
    let states = states.collect::<Result<Vec<AttitudeState>, _>>()?;
    let (Some(first), Some(last)) = (states.first(), states.last()) else {
        return Err(source.refuse(segment.offset, "a segment without rows", "attitudes after the metadata"));
    };
    let at = |state: &AttitudeState| base::time::Tai::from_ns(state.t_ns);
    metadata.check_times(system, at(first), at(last))?;
    note(notes, system, frames, beside);
    let method = method(metadata, matches!(beside, Beside::Derivative | Beside::Rate(_)))?;
    let fit = AttitudeSegment::new(states, method, metadata.usable_ns(system)?);
    fit.map_err(|error| source.refuse(segment.offset, "this segment", &error.to_string()))
}

fn note(notes: &mut Vec<String>, system: TimeSystem, frames: &Frames<'_>, beside: Beside) {
    let unused = "the rates of QUATERNION/RATE are left out: version 1 does not fix what they are";
    let said = [system.note(), frames.axes.note(), (beside == Beside::Unused).then_some(unused)];
    for sentence in said.into_iter().flatten() {
        if !notes.iter().any(|known| known == sentence) {
            notes.push(sentence.into());
        }
    }
}

/// How many numbers a row may have.
fn counts(beside: Beside) -> &'static [usize] {
    match beside {
        Beside::Nothing => &[4],
        Beside::Derivative => &[8],
        Beside::Unused | Beside::Rate(_) => &[7],
    }
}

/// XML names its components, so only lines have an order.
fn is_scalar_first(metadata: &Metadata<'_>, segment: &Segment<'_>) -> Result<bool, HistoryError> {
    let is_named = segment.rows.first().is_some_and(|row| matches!(row.text, std::borrow::Cow::Owned(_)));
    if is_named {
        return Ok(false);
    }
    let entry = metadata.needed("QUATERNION_TYPE")?;
    match entry.value {
        "FIRST" => Ok(true),
        "LAST" => Ok(false),
        _ => Err(metadata.refuse(entry, "FIRST or LAST: where the scalar is")),
    }
}

fn state(
    t_ns: i64,
    values: [f64; 8],
    beside: Beside,
    scalar_first: bool,
    frames: &Frames<'_>,
) -> Option<AttitudeState> {
    let [a, b, c, d, e, f, g, h] = values;
    let ordered = |a, b, c, d| if scalar_first { DQuat::from_xyzw(b, c, d, a) } else { DQuat::from_xyzw(a, b, c, d) };
    let quaternion = frames.body_from_axes(ordered(a, b, c, d));
    let norm = quaternion.length();
    if (norm - 1.0).abs() > WRITTEN_NORM_TOLERANCE || !norm.is_finite() {
        return None;
    }
    let rate_rad_s = match beside {
        Beside::Nothing | Beside::Unused => None,
        Beside::Derivative => Some(rate_of_derivative(quaternion, frames.body_from_axes(ordered(e, f, g, h)))),
        Beside::Rate(is_in_body) => {
            let rate_rad_s = DVec3::new(e, f, g).map(f64::to_radians);
            Some(frames.body_rate(rate_rad_s, is_in_body, quaternion.normalize()))
        }
    };
    let body_from_icrf = Rotation::from_quat(quaternion.normalize() * frames.axes.rotation_from_icrf());
    Some(AttitudeState { t_ns, body_from_icrf, rate_rad_s })
}

/// The interpolation that the file asks for.
fn method(metadata: &Metadata<'_>, has_rates: bool) -> Result<AttitudeInterpolation, HistoryError> {
    let usual = if has_rates { AttitudeInterpolation::CubicHermite } else { AttitudeInterpolation::Slerp };
    let Some(Wanted { name, degree, entry }) = metadata.interpolation()? else { return Ok(usual) };
    match (name.as_str(), degree) {
        ("LINEAR" | "SLERP", None | Some(1)) => Ok(AttitudeInterpolation::Slerp),
        ("HERMITE", Some(3)) if has_rates => Ok(AttitudeInterpolation::CubicHermite),
        ("LAGRANGE", Some(degree)) => Ok(AttitudeInterpolation::Lagrange(degree)),
        _ => Err(metadata.refuse(
            entry,
            "LINEAR, LAGRANGE with a degree, HERMITE of degree 3 in a file with rates, or no INTERPOLATION_METHOD",
        )),
    }
}
