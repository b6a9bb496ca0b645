//! Errors of an observer.

use crate::{ephemeris::TableError, orbit::CentralBody};
use base::time::Tai;

/// Why an observer's orbit was refused or could not be followed.
#[derive(Debug, thiserror::Error)]
pub enum ObserverError {
    /// A line of a two-line element set has the wrong shape.
    #[error("two-line elements, line {line}: {why}")]
    TleLine {
        /// Line, 1 or 2.
        line: usize,
        /// The problem, with the wanted and the given value.
        why: String,
    },
    /// A field of a two-line element set is not a number.
    #[error("two-line elements, line {line}, columns {first}-{last} ({field}): wanted a number, got \"{got}\"")]
    TleField {
        /// Line, 1 or 2.
        line: usize,
        /// First column, counted from 1 as in the format's description.
        first: usize,
        /// Last column, inclusive.
        last: usize,
        /// The field's name.
        field: &'static str,
        /// The text found there.
        got: String,
    },
    /// The elements are well formed but describe no orbit that SGP4 can follow.
    #[error("two-line elements of object {norad_id}: {why}")]
    Elements {
        /// Catalog number in the elements.
        norad_id: u64,
        /// SGP4's reason.
        why: String,
    },
    /// A file of orbit mean-elements messages is not valid JSON, XML or CSV.
    #[error("orbit mean-elements message, line {line}, column {column}: {why}")]
    OmmText {
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// The error of the reader.
        why: String,
    },
    /// An orbit mean-elements message lacks the object, or the object a key, or a value is impossible for an orbit.
    #[error("orbit mean-elements message: {why}")]
    Omm {
        /// The problem, with the wanted and the given value.
        why: String,
    },
    /// A file of two-line elements has not the object that was asked for.
    #[error(
        "two-line elements: wanted {}, got none among {objects}",
        .norad_id.map_or_else(|| "an object".into(), |id| format!("the object with number {id}"))
    )]
    NoSuchObject {
        /// Catalog number asked for; `None`: any.
        norad_id: Option<u64>,
        /// Objects in the file.
        objects: usize,
    },
    /// A file of two-line elements has several objects, and none was asked for.
    #[error("two-line elements: got {objects} objects, wanted one, or the norad_id of one of them")]
    WhichObject {
        /// Objects in the file.
        objects: usize,
    },
    /// A file from which the only object was to be taken has other lines.
    #[error(
        "two-line elements, line {line} of the file: wanted pairs of lines of one object with at most a title before each, got \"{got}\" besides; \
         give the norad_id of the one that is wanted"
    )]
    TleOther {
        /// Line of the file, from 1.
        line: usize,
        /// That line.
        got: String,
    },
    /// SGP4 gave up at this time, usually because the object has decayed.
    #[error(
        "SGP4 has no position at {at} ({days_from_epoch:.1} days from the elements' epoch): {why}; try newer elements"
    )]
    Propagation {
        /// The time asked for.
        at: Tai,
        /// Days since the elements' epoch.
        days_from_epoch: f64,
        /// SGP4's reason.
        why: String,
    },
    /// A parameter of a circular orbit is out of range.
    #[error("circular orbit: {parameter} wanted {wanted}, got {got}")]
    CircularOrbit {
        /// Name of the parameter, with its unit.
        parameter: &'static str,
        /// Accepted range.
        wanted: &'static str,
        /// Value given.
        got: f64,
    },
    /// A parameter of a two-body orbit is out of range.
    #[error("two-body orbit: {parameter} wanted {wanted}, got {got}")]
    TwoBody {
        /// Name of the parameter, with its unit.
        parameter: &'static str,
        /// Accepted range.
        wanted: &'static str,
        /// Value given.
        got: f64,
    },
    /// The orbit has come down.
    #[error(
        "the orbit about {about} is {distance_km:.1} km from its centre at {at}: wanted {surface_km} km or more; check epoch and units"
    )]
    BelowSurface {
        /// The body it is about.
        about: CentralBody,
        /// The time asked for.
        at: Tai,
        /// Distance from the body's centre.
        distance_km: f64,
        /// Radius of the body.
        surface_km: f64,
    },
    /// The orbit is faster than anything that passes the body.
    #[error("the orbit about {about} has {speed_km_s:.1} km/s at {at}: wanted at most {most_km_s} km/s; check units")]
    TooFast {
        /// The body it is about.
        about: CentralBody,
        /// The time asked for.
        at: Tai,
        /// Its speed.
        speed_km_s: f64,
        /// The largest speed that is accepted.
        most_km_s: f64,
    },
    /// A file of states ends before, or has a gap.
    #[error(
        "the observer's file has no state at {at}: it goes from {first} to {last}; wanted one that covers the run without gaps"
    )]
    NoState {
        /// The time asked for.
        at: Tai,
        /// First state.
        first: Tai,
        /// Last state.
        last: Tai,
    },
    /// Sun, Moon and Earth are seen from an orbit or from the geocentre.
    #[error("Sun, Moon and Earth: wanted an observer near the Earth, got one at rest at the barycentre")]
    NoBodies,
    /// The ephemeris that is part of the program is not what was put there.
    #[error("{0}")]
    Ephemeris(#[from] &'static TableError),
}
