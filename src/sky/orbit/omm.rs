//! Orbit mean-elements messages (CCSDS 502.0-B) in JSON -> an orbit that SGP4 follows.
//!
//! In: an object or a list of objects with the keys of the standard (`EPOCH`, `MEAN_MOTION`, ..., numbers or numbers in
//! quotes), as catalogs on the net give them. Out: [`TleOrbit`], of the one object or the one with a catalog number.
//! The elements are those that two lines carry, with more digits and longer numbers. Limits: JSON alone; the theory
//! must be SGP4 in TEME, where the message says so. Tests: below; elements in both forms are one orbit.

use super::TleOrbit;
use crate::ObserverError;
use serde_json::Value;

/// Most objects of one file.
const MOST_OBJECTS: usize = 100_000;

/// Keys that are text; all others that are looked at are numbers.
const THEORY: [(&str, &[&str]); 3] =
    [("REF_FRAME", &["TEME"]), ("MEAN_ELEMENT_THEORY", &["SGP4", "SGP/SGP4"]), ("TIME_SYSTEM", &["UTC"])];
/// Numbers that orbits are made of, with their range.
const RANGES: [(&str, f64, f64); 8] = [
    ("MEAN_MOTION", 1e-3, 20.0),
    ("ECCENTRICITY", 0.0, 0.999_999_9),
    ("INCLINATION", 0.0, 180.0),
    ("RA_OF_ASC_NODE", -360.0, 360.0),
    ("ARG_OF_PERICENTER", -360.0, 360.0),
    ("MEAN_ANOMALY", -360.0, 360.0),
    ("BSTAR", -10.0, 10.0),
    // The reader of messages takes it modulo 256.
    ("EPHEMERIS_TYPE", 0.0, 255.0),
];

impl TleOrbit {
    /// Reads the object with `norad_id`, or the only one, of an OMM in JSON.
    ///
    /// # Errors
    /// When the text is not JSON (with line and column), lacks that object or has several sets of its elements, or the
    /// object lacks a key or has a value that no orbit has; or when SGP4 refuses the elements.
    pub fn parse_omm(text: &str, norad_id: Option<u64>) -> Result<Self, ObserverError> {
        let whole: Value = serde_json::from_str(text).map_err(|error| ObserverError::OmmText {
            line: error.line(),
            column: error.column(),
            why: error.to_string(),
        })?;
        let objects = if let Value::Array(objects) = whole { objects } else { vec![whole] };
        if objects.len() > MOST_OBJECTS {
            return Err(refuse(format!("wanted at most {MOST_OBJECTS} objects, got {}", objects.len())));
        }
        let object = chosen(objects, norad_id)?;
        check_theory(&object)?;
        check_ranges(&object)?;
        let elements: sgp4::Elements =
            serde_json::from_value(object).map_err(|error| refuse(format!("{error}; keys as in CCSDS 502.0-B")))?;
        Self::from_elements(&elements)
    }
}

fn refuse(why: String) -> ObserverError {
    ObserverError::Omm { why }
}

/// Returns the catalog number of an object, where it has one.
fn number_of(object: &Value) -> Option<u64> {
    let number = object.get("NORAD_CAT_ID")?;
    number.as_str().map_or_else(|| number.as_u64(), |text| text.trim().parse().ok())
}

fn chosen(objects: Vec<Value>, norad_id: Option<u64>) -> Result<Value, ObserverError> {
    let count = objects.len();
    let mut found = objects.into_iter().filter(|object| norad_id.is_none() || number_of(object) == norad_id);
    match (found.next(), found.next(), norad_id) {
        (Some(object), None, _) => Ok(object),
        (Some(_), Some(_), Some(norad_id)) => Err(ObserverError::WhichSet { norad_id, sets: 2 + found.count() }),
        (Some(_), Some(_), None) => Err(refuse(format!("{count} objects: wanted the norad_id of one of them"))),
        (None, _, Some(id)) => Err(refuse(format!("wanted an object with NORAD_CAT_ID {id} among {count}, got none"))),
        (None, _, None) => Err(refuse("wanted an object, got an empty list".into())),
    }
}

fn check_theory(object: &Value) -> Result<(), ObserverError> {
    for (key, words) in THEORY {
        let Some(got) = object.get(key) else { continue };
        if !got.as_str().is_some_and(|got| words.contains(&got)) {
            return Err(refuse(format!("{key}: wanted {}, got {got}", words.join(" or "))));
        }
    }
    Ok(())
}

fn check_ranges(object: &Value) -> Result<(), ObserverError> {
    for (key, least, most) in RANGES {
        let got = object.get(key).unwrap_or(&Value::Null);
        let number = got.as_str().map_or_else(|| got.as_f64(), |text| text.trim().parse().ok());
        if !number.is_some_and(|number| (least..=most).contains(&number)) {
            return Err(refuse(format!("{key}: wanted a number from {least} to {most}, got {got}")));
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::time::{Span, Tai};

    /// Elements of the documentation of the two-line format (International Space Station, 2008), in both forms.
    const LINES: &str = "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927\n\
                         2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537";
    const OBJECT: &str = r#"{"OBJECT_NAME": "ISS", "OBJECT_ID": "1998-067A", "EPOCH": "2008-09-20T12:25:40.104192",
 "MEAN_MOTION": 15.72125391, "ECCENTRICITY": 0.0006703, "INCLINATION": "51.6416", "RA_OF_ASC_NODE": 247.4627,
 "ARG_OF_PERICENTER": 130.5360, "MEAN_ANOMALY": 325.0288, "EPHEMERIS_TYPE": 0, "CLASSIFICATION_TYPE": "U",
 "NORAD_CAT_ID": 25544, "ELEMENT_SET_NO": 292, "REV_AT_EPOCH": 56353, "BSTAR": -0.000011606,
 "MEAN_MOTION_DOT": -0.00002182, "MEAN_MOTION_DDOT": 0}"#;

    #[test]
    fn both_forms_are_one_orbit() {
        let (lines, message) = (TleOrbit::parse(LINES).unwrap(), TleOrbit::parse_omm(OBJECT, None).unwrap());
        assert_eq!((lines.norad_id(), message.norad_id()), (25_544, 25_544));
        let epoch = Tai::from_rfc3339("2008-09-20T12:25:40.104192Z").unwrap();
        for hours in [0.0, 7.3, 100.0] {
            let at = epoch + Span::from_s(3_600.0 * hours);
            let [a, b] = [&lines, &message].map(|orbit| orbit.geocentric_state(at).unwrap().position_km);
            // Epochs to a microsecond.
            assert!(a.distance(b) < 1e-4, "{a} {b}");
        }
    }

    #[test]
    fn one_of_many_is_chosen_by_its_number() {
        let other = OBJECT.replace("25544", "\"123456789\"").replace("51.6416", "63.4");
        let list = format!("[{OBJECT}, {other}]");
        assert_eq!(TleOrbit::parse_omm(&list, Some(123_456_789)).unwrap().norad_id(), 123_456_789);
        assert_eq!(TleOrbit::parse_omm(&list, Some(25_544)).unwrap().norad_id(), 25_544);
        let message = |text: &str, id| TleOrbit::parse_omm(text, id).unwrap_err().to_string();
        assert!(message(&list, None).contains("2 objects"), "{}", message(&list, None));
        assert!(message(&list, Some(7)).contains("NORAD_CAT_ID 7"), "{}", message(&list, Some(7)));
        assert!(message("[]", None).contains("empty list"));
        let newer = OBJECT.replace("2008-09-20T12", "2008-09-25T12");
        let sets = message(&format!("[{OBJECT}, {other}, {newer}, {newer}]"), Some(25_544));
        assert!(sets.contains("object 25544: got 3 sets of elements, wanted one"), "{sets}");
    }

    #[test]
    fn errors_name_their_place() {
        let message = |text: &str| TleOrbit::parse_omm(text, None).unwrap_err().to_string();
        let cut = message(&OBJECT[..200]);
        assert!(cut.contains("line 3, column 2"), "{cut}");
        for (from, to, wanted) in [
            ("\"ECCENTRICITY\": 0.0006703", "\"ECCENTRICITY\": 1.5", "ECCENTRICITY: wanted a number from 0 to"),
            ("\"MEAN_MOTION\": 15.72125391", "\"MEAN_MOTION\": null", "MEAN_MOTION: wanted a number"),
            ("\"INCLINATION\": \"51.6416\"", "\"INCLINATION\": \"fifty\"", "INCLINATION"),
            ("2008-09-20T12", "2008-19-20T12", "502.0-B"),
            ("2008-09-20T12", "-2008-09-20T12", "epoch wanted in the years 1957 to 2099, got -2008"),
            ("2008-09-20T12", "1956-09-20T12", "got 1956"),
            ("2008-09-20T12", "2100-01-01T12", "got 2100"),
            ("\"EPHEMERIS_TYPE\": 0", "\"EPHEMERIS_TYPE\": 256", "EPHEMERIS_TYPE: wanted a number from 0 to 255"),
            ("\"BSTAR\": -0.000011606,", "", "BSTAR"),
            ("\"EPHEMERIS_TYPE\": 0", "\"REF_FRAME\": \"GCRF\"", "REF_FRAME: wanted TEME, got \"GCRF\""),
        ] {
            assert!(OBJECT.contains(from), "control: {from}");
            let got = message(&OBJECT.replace(from, to));
            assert!(got.contains(wanted), "{got}");
        }
        for epoch in ["1957-01-01T00", "2099-12-31T23"] {
            TleOrbit::parse_omm(&OBJECT.replace("2008-09-20T12", epoch), None).expect("the ends of the years");
        }
    }

    /// Every byte changed in turn, by a fixed rule: an orbit or an error, never a panic; an orbit's states are finite.
    #[test]
    fn no_mutation_goes_through_unnoticed_or_panics() {
        let at = Tai::from_rfc3339("2008-09-21T00:00:00Z").unwrap();
        let (mut refused, mut taken) = (0, 0);
        let texts = [(OBJECT, true), (LINES, false)];
        for (text, is_omm) in texts {
            for place in 0..text.len() {
                for change in [1_u8, 2, 7, 16, 64] {
                    let mut bytes = text.as_bytes().to_vec();
                    bytes[place] ^= change;
                    let Ok(changed) = core::str::from_utf8(&bytes) else { continue };
                    let read = if is_omm { TleOrbit::parse_omm(changed, None) } else { TleOrbit::parse(changed) };
                    match read {
                        Err(error) => refused += usize::from(!error.to_string().is_empty()),
                        Ok(orbit) => {
                            taken += 1;
                            let state = orbit.geocentric_state(at);
                            assert!(state.is_err() || state.is_ok_and(|state| state.position_km.is_finite()));
                        }
                    }
                }
            }
        }
        // Digits of numbers change elements; only two lines have checksums.
        assert!(refused > 1_500 && taken > 100, "{refused} refused, {taken} taken");
    }
}
