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
use crate::attitude::{AttitudeHistory, AttitudeSegment, Times};
use crate::attitude_methods::{AttitudeInterpolation, AttitudeState};
use crate::error::{HistoryError, Source};
use crate::message::{Kind, Message};
use crate::metadata::{Metadata, Wanted, note, numbers};
use crate::{aem_row::Frames, findings};

/// Keywords of a segment that OEM does not have.
const KEYS: [&str; 9] = [
    "REF_FRAME_A",
    "REF_FRAME_B",
    "ATTITUDE_DIR",
    "ATTITUDE_TYPE",
    "QUATERNION_TYPE",
    "EULER_ROT_SEQ",
    "RATE_FRAME",
    "ANGVEL_FRAME",
    "EULER_DIR",
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
        let (mut notes, mut warnings) = (Vec::new(), Vec::new());
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
            warnings.extend(metadata.unknown_keys(&KEYS)?);
            segments.push(attitudes(&metadata, &frames, is_first, (&mut notes, &mut warnings))?);
        }
        let fit = AttitudeHistory::new(&message.format(Kind::Attitude), Times::Absolute, segments);
        let mut history = fit.map_err(|error| source.whole(error.to_string()))?;
        notes.dedup();
        history.notes.extend(notes);
        history.warnings.extend(findings::first_of(warnings));
        let object = message.segments.first().map(|segment| Metadata { source: *source, segment });
        let object = object.and_then(|metadata| metadata.value("OBJECT_NAME")).unwrap_or("unnamed");
        history.name = body.map(|(body, _)| format!("{object}, {body}"));
        Ok(history)
    })
}

fn attitudes(
    metadata: &Metadata<'_>,
    frames: &Frames<'_>,
    is_first: bool,
    (notes, warnings): (&mut Vec<String>, &mut Vec<String>),
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
    if states.is_empty() {
        return Err(source.refuse(segment.offset, "a segment without rows", "attitudes after the metadata"));
    }
    let times_ns: Vec<i64> = states.iter().map(|state| state.t_ns).collect();
    warnings.extend(metadata.check_times(system, &times_ns)?);
    kind.check_steps(metadata, &rows, &segment.rows)?;
    note(notes, [system.note(), frames.axes.note(), kind.note()].into_iter().flatten());
    let method = method(metadata, kind.has_rates(), notes)?;
    let fit = AttitudeSegment::new(states, method, metadata.usable_ns(system)?);
    fit.map_err(|unfit| metadata.unfit(&unfit))
}

/// Returns the interpolation that the file asks for.
fn method(
    metadata: &Metadata<'_>,
    has_rates: bool,
    notes: &mut Vec<String>,
) -> Result<AttitudeInterpolation, HistoryError> {
    let usual = if has_rates { AttitudeInterpolation::CubicHermite } else { AttitudeInterpolation::Slerp };
    let Some(Wanted { name, degree, entry }) = metadata.interpolation()? else { return Ok(usual) };
    match (name.as_str(), degree) {
        ("LINEAR" | "SLERP", None | Some(1)) => Ok(AttitudeInterpolation::Slerp),
        ("HERMITE", Some(3)) if has_rates => Ok(AttitudeInterpolation::CubicHermite),
        ("HERMITE", Some(degree)) if !has_rates => {
            note(notes, ["HERMITE without rates is a polynomial of its degree through the quaternions"]);
            Ok(AttitudeInterpolation::Lagrange(degree))
        }
        ("LAGRANGE", Some(degree)) => Ok(AttitudeInterpolation::Lagrange(degree)),
        _ => Err(metadata.refuse_method(
            entry,
            degree,
            "LINEAR (of degree 1, or without one), LAGRANGE with a degree, HERMITE of degree 3 with rates or of any degree without them, or no \
             INTERPOLATION_METHOD",
        )),
    }
}
