//! CCSDS AEM, versions 1 and 2: a message -> attitudes.
//!
//! | fact | version 1 | version 2 |
//! |---|---|---|
//! | direction | ATTITUDE_DIR, A2B or B2A | always from REF_FRAME_A to REF_FRAME_B |
//! | order | QUATERNION_TYPE, FIRST or LAST (scalar) | scalar last |
//! | rates | QUATERNION/DERIVATIVE; those of QUATERNION/RATE are left out | QUATERNION/DERIVATIVE, QUATERNION/ANGVEL (deg/s) |
//!
//! One of the frames is inertial, the other that of the spacecraft. A quaternion from inertial to body axes is the
//! conjugate of this program's: CCSDS's turns the axes, ours rewrites vectors. Types of attitudes: `aem_row`.

use crate::aem_row::{MOST_NUMBERS, RowKind};
use crate::attitude::{AttitudeHistory, AttitudeSegment, AttitudeState, Times};
use crate::attitude_methods::AttitudeInterpolation;
use crate::error::{HistoryError, Source};
use crate::message::{Kind, Message};
use crate::metadata::{Metadata, Wanted, numbers};
use crate::reference_axes::{ReferenceAxes, WANTED_AXES};
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
pub(crate) struct Frames<'m> {
    pub(crate) axes: ReferenceAxes,
    pub(crate) body: &'m str,
    /// Attitudes turn the inertial axes into those of the body.
    pub(crate) is_to_body: bool,
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

    /// Returns this program's quaternion for one of the file.
    pub(crate) fn body_from_axes(&self, quaternion: DQuat) -> DQuat {
        if self.is_to_body { quaternion.conjugate() } else { quaternion }
    }

    /// Returns a rate of the frame B with respect to A, in the axes of one of them, as a rate of the body in its own
    /// axes.
    pub(crate) fn body_rate(&self, rate_rad_s: DVec3, is_in_body: bool, body_from_axes: DQuat) -> DVec3 {
        let in_body = if is_in_body { rate_rad_s } else { body_from_axes * rate_rad_s };
        if self.is_to_body { in_body } else { -in_body }
    }
}

/// Returns whether version 1 goes from A to B.
fn direction(metadata: &Metadata<'_>) -> Result<bool, HistoryError> {
    let entry = metadata.needed("ATTITUDE_DIR")?;
    match entry.value {
        "A2B" => Ok(true),
        "B2A" => Ok(false),
        _ => Err(metadata.refuse(entry, "A2B or B2A")),
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
    let is_named = segment.rows.first().is_some_and(|row| matches!(row.text, std::borrow::Cow::Owned(_)));
    let kind = RowKind::read(metadata, frames, is_first, is_named)?;
    let numbers =
        |row| numbers::<MOST_NUMBERS>(source, row, system, &[kind.count()]).map(|(at, values)| (at.ns(), values));
    let rows = segment.rows.iter().map(numbers).collect::<Result<Vec<_>, _>>()?;
    let states = rows.iter().zip(&segment.rows).map(|((t_ns, values), row)| {
        let state = kind.state(*t_ns, *values, frames);
        state.ok_or_else(|| source.refuse(row.offset, &row.text, "a quaternion whose norm is 1 within 0.001"))
    });
    let states = states.collect::<Result<Vec<AttitudeState>, _>>()?;
    let (Some(first), Some(last)) = (states.first(), states.last()) else {
        return Err(source.refuse(segment.offset, "a segment without rows", "attitudes after the metadata"));
    };
    let at = |state: &AttitudeState| base::time::Tai::from_ns(state.t_ns);
    metadata.check_times(system, at(first), at(last))?;
    kind.check_steps(metadata, &rows, &segment.rows)?;
    note(notes, [system.note(), frames.axes.note(), kind.note()]);
    let method = method(metadata, kind.has_rates())?;
    let fit = AttitudeSegment::new(states, method, metadata.usable_ns(system)?);
    fit.map_err(|error| source.refuse(segment.offset, "this segment", &error.to_string()))
}

fn note(notes: &mut Vec<String>, said: [Option<&str>; 3]) {
    for sentence in said.into_iter().flatten() {
        if !notes.iter().any(|known| known == sentence) {
            notes.push(sentence.into());
        }
    }
}

/// Returns the interpolation that the file asks for.
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
