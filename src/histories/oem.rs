//! CCSDS OEM, versions 1 to 3: a message -> an orbit. Kilometres and kilometres per second; covariances are passed
//! over.

use crate::error::{HistoryError, Source};
use crate::message::{Encoding, Kind, Message, Row};
use crate::metadata::{Metadata, Wanted, note, numbers};
use crate::orbit::{Centre, OrbitHistory, OrbitInterpolation, OrbitSegment, OrbitState, WANTED_CENTRE};
use crate::reference_axes::{ReferenceAxes, WANTED_AXES};
use crate::{epoch::TimeSystem, findings};
use glam::DVec3;

/// Reads an OEM.
pub(crate) fn read(source: &Source<'_>) -> Result<OrbitHistory, HistoryError> {
    Message::with(source, Kind::Orbit, |message| {
        if !matches!(message.version.split('.').next(), Some("1" | "2" | "3")) {
            return Err(source.whole(format!("version \"{}\"; wanted OEM version 1.0 to 3.0", message.version)));
        }
        let (mut notes, mut segments): (Vec<String>, Vec<OrbitSegment>) = (Vec::new(), Vec::new());
        let mut warnings: Vec<String> = Vec::new();
        let mut who: Option<(Centre, Option<&str>)> = None;
        for segment in &message.segments {
            let metadata = Metadata { source: *source, segment };
            let centre = centre(&metadata)?;
            let this = (centre, metadata.value("OBJECT_ID"));
            if who.is_some_and(|who| who != this) {
                let wanted = "one object and one centre in all segments: split the file";
                return Err(source.refuse(segment.offset, centre.name(), wanted));
            }
            who = Some(this);
            warnings.extend(metadata.unknown_keys(&["REF_FRAME", "REF_FRAME_EPOCH"])?);
            segments.push(states(&metadata, &mut notes, &mut warnings)?);
        }
        let centre = who.map_or(Centre::Earth, |(centre, _)| centre);
        let fit = OrbitHistory::new(&message.format(Kind::Orbit), centre, segments);
        let mut history = fit.map_err(|error| source.whole(error.to_string()))?;
        history.notes.extend(notes);
        if message.encoding == Encoding::Kvn {
            let rows = message.segments.last().map_or(&[][..], |segment| segment.rows.as_slice());
            warnings.extend(cut_in_a_number(source.text, rows));
        }
        history.warnings.extend(findings::first_of(warnings));
        let first = message.segments.first().map(|segment| Metadata { source: *source, segment });
        history.name = first.and_then(|metadata| metadata.value("OBJECT_NAME")).map(Into::into);
        Ok(history)
    })
}

fn centre(metadata: &Metadata<'_>) -> Result<Centre, HistoryError> {
    let entry = metadata.needed("CENTER_NAME")?;
    Centre::of_name(entry.value).ok_or_else(|| metadata.refuse(entry, WANTED_CENTRE))
}

/// Returns a warning of a last row without an end of its line, whose last number is shorter than in any other row: a
/// message of lines has no mark of its end.
fn cut_in_a_number(text: &str, rows: &[Row<'_>]) -> Option<String> {
    let (last, others) = rows.split_last()?;
    let length =
        |row: &Row<'_>| row.text.split_whitespace().next_back().map_or(0, |word| word.trim_start_matches('-').len());
    let shortest = others.iter().map(length).min()?;
    let is_cut = !text.ends_with(['\n', '\r']) && length(last) < shortest;
    is_cut.then(|| {
        format!("the file ends in \"{}\", without an end of the line: it may be cut short in a number", last.text)
    })
}

fn states(
    metadata: &Metadata<'_>,
    notes: &mut Vec<String>,
    warnings: &mut Vec<String>,
) -> Result<OrbitSegment, HistoryError> {
    let (source, segment) = (&metadata.source, metadata.segment);
    let system: TimeSystem = metadata.time_system()?;
    let entry = metadata.needed("REF_FRAME")?;
    let axes = ReferenceAxes::of_name(entry.value).ok_or_else(|| metadata.refuse(entry, WANTED_AXES))?;
    note(notes, [system.note(), axes.note()].into_iter().flatten());
    let states = segment.rows.iter().map(|row| {
        // Nine numbers: with accelerations, which are not needed.
        let (at, [x, y, z, vx, vy, vz, ..]) = numbers::<9>(source, row, system, &[6, 9])?;
        let [position_km, velocity_km_s] = [DVec3::new(x, y, z), DVec3::new(vx, vy, vz)].map(|v| axes.to_icrf(v));
        Ok(OrbitState { t_ns: at.ns(), position_km, velocity_km_s })
    });
    let states = states.collect::<Result<Vec<OrbitState>, _>>()?;
    let times_ns: Vec<i64> = states.iter().map(|state| state.t_ns).collect();
    if !times_ns.is_empty() {
        warnings.extend(metadata.check_times(system, &times_ns)?);
    }
    let fit = OrbitSegment::new(states, method(metadata)?, metadata.usable_ns(system)?);
    fit.map_err(|unfit| metadata.unfit(&unfit))
}

/// Returns the interpolation that the file asks for.
fn method(metadata: &Metadata<'_>) -> Result<OrbitInterpolation, HistoryError> {
    let Some(Wanted { name, degree, entry }) = metadata.interpolation()? else { return Ok(OrbitInterpolation::CUBIC) };
    match (name.as_str(), degree) {
        ("HERMITE", Some(degree)) if degree % 2 == 1 && degree > 1 => {
            Ok(OrbitInterpolation::Hermite { rows: degree.div_ceil(2) })
        }
        ("LAGRANGE", Some(degree)) => Ok(OrbitInterpolation::Lagrange(degree)),
        ("LINEAR", None | Some(1)) => Ok(OrbitInterpolation::Lagrange(1)),
        _ => Err(metadata
            .refuse_method(entry, degree, "LINEAR (of degree 1, or without one), LAGRANGE with a degree, HERMITE with an odd degree from 3, or no INTERPOLATION")),
    }
}
