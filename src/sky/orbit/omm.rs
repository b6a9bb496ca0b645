//! Orbit mean-elements messages (CCSDS 502.0-B) -> an orbit that SGP4 follows.
//!
//! In: messages in one of the forms of [`super::omm_forms`], numbers with or without quotes. Out: [`TleOrbit`]s, of the
//! one object or the one with a catalog number. The elements are those that two lines carry, with more digits and
//! longer numbers. Limits: the theory must be SGP4 about the Earth in TEME, and units those of the standard, where the
//! message says so. Tests: below; elements in all forms are one orbit.

use super::TleOrbit;
use super::omm_forms::{Form, Message, form_of, messages};
use super::tle::{LINE_LENGTH, is_line, no_such_object};
use base::{refused::Refused, time::Tai};
use sgp4::chrono::NaiveDateTime;

/// Words that are known, where the message has the key.
const THEORY: [(&str, &[&str]); 4] = [
    ("CENTER_NAME", &["EARTH"]),
    ("REF_FRAME", &["TEME"]),
    ("MEAN_ELEMENT_THEORY", &["SGP4", "SGP/SGP4"]),
    ("TIME_SYSTEM", &["UTC"]),
];
/// Numbers that orbits are made of: key, unit of the standard, range.
const NUMBERS: [(&str, &str, f64, f64); 7] = [
    ("MEAN_MOTION", "rev/day", 1e-3, 20.0),
    ("ECCENTRICITY", "", 0.0, 0.999_999_9),
    ("INCLINATION", "deg", 0.0, 180.0),
    ("RA_OF_ASC_NODE", "deg", -720.0, 720.0),
    ("ARG_OF_PERICENTER", "deg", -720.0, 720.0),
    ("MEAN_ANOMALY", "deg", -720.0, 720.0),
    ("BSTAR", "1/ER", -10.0, 10.0),
];
/// Forms of an instant: day of the month, and day of the year.
const EPOCHS: [&str; 2] = ["%Y-%m-%dT%H:%M:%S%.f", "%Y-%jT%H:%M:%S%.f"];

/// Returns every set of the object with `norad_id`, or of the only object.
pub(super) fn sets(text: &str, form: Form, norad_id: Option<u64>) -> Result<Vec<TleOrbit>, Refused> {
    let all = messages(text, form)?;
    let count = all.len();
    let numbers = all.iter().map(number_of).collect::<Result<Vec<_>, _>>()?;
    if norad_id.is_none() && count > 1 {
        let is_one = numbers[0].is_some() && numbers.iter().all(|number| *number == numbers[0]);
        if !is_one {
            return Err(refuse(format!("{count} objects: wanted the norad_id of one of them")));
        }
    }
    let is_it = |number: &Option<u64>| norad_id.is_none() || *number == norad_id;
    let found = all.iter().zip(numbers).filter(|(_, number)| is_it(number));
    let found = found.map(|(message, number)| orbit_of(message, number)).collect::<Result<Vec<_>, _>>()?;
    match norad_id {
        _ if !found.is_empty() => Ok(found),
        Some(id) => Err(refuse(format!("wanted an object with NORAD_CAT_ID {id} among {count}, got none"))),
        None => Err(refuse("wanted an object, got an empty list".into())),
    }
}

fn refuse(why: String) -> Refused {
    Refused(format!("orbit mean-elements message: {why}"))
}

impl Message {
    /// Returns the error of a key.
    fn refuse(&self, key: &str, wanted: &str) -> Refused {
        let got = self.get(key).map_or_else(|| "nothing".to_owned(), |got| format!("\"{}\"", got.value));
        let place = self.line.map_or_else(String::new, |line| format!("line {line}: "));
        refuse(format!("{place}{key}: wanted {wanted}, got {got}"))
    }

    /// Returns a whole number, or `None` where the message lacks the key.
    fn whole(&self, key: &str, most: u64) -> Result<Option<u64>, Refused> {
        let Some(got) = self.get(key) else { return Ok(None) };
        let number = got.value.parse().ok().filter(|number| *number <= most);
        number.map(Some).ok_or_else(|| self.refuse(key, &format!("a number from 0 to {most}")))
    }

    /// Returns a number of the table.
    fn number(&self, (key, unit, least, most): (&str, &str, f64, f64)) -> Result<f64, Refused> {
        let stated = self.get(key);
        if let Some(got) =
            stated.and_then(|stated| stated.unit.as_deref()).filter(|got| !got.eq_ignore_ascii_case(unit))
        {
            return Err(self.refuse(key, &format!("the unit \"{unit}\" of the standard instead of \"{got}\"")));
        }
        let number = stated.and_then(|stated| stated.value.parse().ok());
        let is_in = |number: &f64| (least..=most).contains(number);
        number.filter(is_in).ok_or_else(|| self.refuse(key, &format!("a number from {least} to {most}")))
    }

    fn epoch(&self) -> Result<NaiveDateTime, Refused> {
        let text = self.get("EPOCH").map_or("", |epoch| epoch.value.as_str());
        let text = text.strip_suffix('Z').unwrap_or(text);
        let read = EPOCHS.iter().find_map(|form| NaiveDateTime::parse_from_str(text, form).ok());
        read.ok_or_else(|| {
            let wanted = "a time in UTC as in CCSDS 502.0-B, such as 2026-03-01T12:00:00.5";
            self.refuse("EPOCH", wanted)
        })
    }

    /// Refuses another theory than SGP4 about the Earth, and two values of one key.
    fn check_theory(&self) -> Result<(), Refused> {
        let is_read = |key: &str| {
            ["EPOCH", "NORAD_CAT_ID", "EPHEMERIS_TYPE"].contains(&key)
                || THEORY.iter().any(|(known, _)| *known == key)
                || NUMBERS.iter().any(|(known, ..)| *known == key)
        };
        if let Some(key) = self.twice.iter().find(|key| is_read(key)) {
            return Err(self.refuse(key, "one value instead of two"));
        }
        for (key, words) in THEORY {
            let Some(got) = self.get(key) else { continue };
            if !words.iter().any(|word| got.value.eq_ignore_ascii_case(word)) {
                return Err(self.refuse(key, &words.join(" or ")));
            }
        }
        for key in ["BTERM", "AGOM"] {
            let is_zero = |value: &str| value.parse::<f64>().is_ok_and(|number| number.abs() <= 0.0);
            if self.get(key).is_some_and(|got| !is_zero(&got.value)) {
                return Err(self.refuse(key, "BSTAR alone: this is a number of SGP4-XP, which is not followed"));
            }
        }
        Ok(())
    }
}

/// Returns the catalog number of an object, where it has one.
fn number_of(message: &Message) -> Result<Option<u64>, Refused> {
    message.whole("NORAD_CAT_ID", u64::MAX)
}

fn orbit_of(message: &Message, norad_id: Option<u64>) -> Result<TleOrbit, Refused> {
    message.check_theory()?;
    let mut numbers = [0.0; NUMBERS.len()];
    for (number, range) in numbers.iter_mut().zip(NUMBERS) {
        *number = message.number(range)?;
    }
    let [mean_motion, eccentricity, inclination, right_ascension, argument_of_perigee, mean_anomaly, drag_term] =
        numbers;
    let ephemeris_type = message.whole("EPHEMERIS_TYPE", u64::from(u8::MAX))?.and_then(|number| number.try_into().ok());
    TleOrbit::from_elements(&sgp4::Elements {
        object_name: None,
        international_designator: None,
        norad_id: norad_id.unwrap_or(0),
        classification: sgp4::Classification::Unclassified,
        datetime: message.epoch()?,
        // SGP4 does not use the derivatives.
        mean_motion_dot: 0.0,
        mean_motion_ddot: 0.0,
        drag_term,
        element_set_number: 0,
        inclination,
        right_ascension,
        eccentricity,
        argument_of_perigee,
        mean_anomaly,
        mean_motion,
        revolution_number: 0,
        ephemeris_type: ephemeris_type.unwrap_or(0),
    })
}

/// Mark of UTF-8, with which some programs begin a file.
const BYTE_ORDER_MARK: char = '\u{feff}';

/// Returns whether a text is meant as elements: a message of mean elements, or lines that begin with 1 and 2, whatever
/// else is wrong with them, or one of the two with its whole length.
pub fn is_elements(text: &str) -> bool {
    let text = text.trim_start_matches(BYTE_ORDER_MARK);
    let has_line = |number: char| text.lines().any(|line| is_line(number, line) && !line.contains(','));
    let is_whole = |line: &str| {
        line.trim_end().len() == LINE_LENGTH && !line.contains(',') && (is_line('1', line) || is_line('2', line))
    };
    form_of(text).is_some() || (has_line('1') && has_line('2')) || text.lines().any(is_whole)
}

impl TleOrbit {
    /// Reads the object with `norad_id`, or the only one, of a text: pairs of element lines, or an OMM as JSON, KVN, XML
    /// or CSV. Of several sets of the object the one whose epoch is nearest to `near` is taken.
    ///
    /// # Errors
    /// When the text has no such object, or several and none is asked for, or other lines than pairs and their titles;
    /// or when a set of the object is damaged or no orbit that SGP4 follows, with its place.
    pub fn read(text: &str, norad_id: Option<u64>, near: Tai) -> Result<Self, Refused> {
        let text = text.trim_start_matches(BYTE_ORDER_MARK);
        let sets = match form_of(text) {
            Some(form) => sets(text, form, norad_id)?,
            None => Self::sets_of_lines(text, norad_id)?,
        };
        let days = |set: &Self| set.days_from_epoch(near).abs();
        let nearest = sets.into_iter().min_by(|a, b| days(a).total_cmp(&days(b)));
        nearest.ok_or_else(|| no_such_object(norad_id, 0))
    }
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

    /// Reads the set nearest to the elements' own day.
    fn read(text: &str, norad_id: Option<u64>) -> Result<TleOrbit, Refused> {
        TleOrbit::read(text, norad_id, Tai::from_rfc3339("2008-09-20T12:00:00Z").unwrap())
    }

    #[test]
    fn both_forms_are_one_orbit() {
        let (lines, message) = (TleOrbit::parse(LINES).unwrap(), read(OBJECT, None).unwrap());
        assert_eq!((lines.norad_id, message.norad_id), (25_544, 25_544));
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
        assert_eq!(read(&list, Some(123_456_789)).unwrap().norad_id, 123_456_789);
        assert_eq!(read(&list, Some(25_544)).unwrap().norad_id, 25_544);
        let message = |text: &str, id| read(text, id).unwrap_err().to_string();
        assert!(message(&list, None).contains("2 objects"), "{}", message(&list, None));
        assert!(message(&list, Some(7)).contains("NORAD_CAT_ID 7"), "{}", message(&list, Some(7)));
        assert!(message("[]", None).contains("empty list"));
        assert!(message("{}", None).contains("MEAN_MOTION: wanted a number from 0.001 to 20, got nothing"));
    }

    #[test]
    fn of_several_sets_the_nearest_in_time_is_taken() {
        let [older, newer] = ["2008-09-10T12", "2008-09-25T12"].map(|day| OBJECT.replace("2008-09-20T12", day));
        let list = format!("[{older}, {OBJECT}, {newer}]");
        for (day, wanted) in
            [("01", &older), ("14", &older), ("16", &OBJECT.to_owned()), ("22", &OBJECT.to_owned()), ("24", &newer)]
        {
            let at = Tai::from_rfc3339(&format!("2008-09-{day}T12:25:00Z")).unwrap();
            for norad_id in [None, Some(25_544)] {
                let found = TleOrbit::read(&list, norad_id, at).unwrap().days_from_epoch(at);
                let wanted = TleOrbit::read(wanted, None, at).unwrap().days_from_epoch(at);
                assert!((found - wanted).abs() < 1e-9, "day {day}: {found} {wanted}");
            }
        }
    }

    /// Returns the object as a message of another form.
    fn as_form(line: impl Fn(&str, &str) -> String) -> String {
        let object: serde_json::Value = serde_json::from_str(OBJECT).unwrap();
        let text = |value: &serde_json::Value| value.as_str().map_or_else(|| value.to_string(), str::to_owned);
        object.as_object().unwrap().iter().map(|(key, value)| line(key, &text(value))).collect()
    }

    fn kvn() -> String {
        format!("CCSDS_OMM_VERS = 2.0\nCOMMENT a remark\n{}", as_form(|key, value| format!("{key} = {value}\n")))
    }

    fn xml() -> String {
        let keys = as_form(|key, value| format!("<{key}>{value}</{key}>\n"));
        format!(
            "<?xml version=\"1.0\"?>\n<ndm><omm id=\"CCSDS_OMM_VERS\" version=\"2.0\"><body>{keys}</body></omm></ndm>"
        )
    }

    fn csv() -> String {
        let row = |part: fn(&str, &str) -> String| as_form(part).trim_end_matches(',').to_owned();
        format!("{}\n{}\n", row(|key, _| format!("{key},")), row(|_, value| format!("{value},")))
    }

    #[test]
    fn every_form_is_the_same_orbit() {
        let at = Tai::from_rfc3339("2008-09-21T00:00:00Z").unwrap();
        let position = |text: &str| read(text, None).and_then(|orbit| orbit.geocentric_state(at)).unwrap().position_km;
        let wanted = position(OBJECT);
        let by_day_of_year = OBJECT.replace("2008-09-20T", "2008-264T");
        let zulu = OBJECT.replace("40.104192", "40.104192Z");
        let marked = format!("\u{feff}{OBJECT}");
        let with_units = kvn().replace("= 51.6416", "= 51.6416 [deg]");
        for text in [&kvn(), &xml(), &csv(), &by_day_of_year, &zulu, &marked, &with_units] {
            assert_eq!(position(text), wanted, "{text}");
        }
        for (from, to) in [("247.4627", "607.4627"), ("130.5360", "-229.4640"), ("325.0288", "685.0288")] {
            let turned = OBJECT.replace(from, to);
            assert!(turned != OBJECT && position(&turned).distance(wanted) < 1e-6, "{to}: a whole turn more");
        }
        let changed = kvn().replace("51.6416", "51.6417");
        assert!(position(&changed).distance(wanted) > 1e-3, "control: a changed digit is seen");
    }

    #[test]
    fn statements_of_other_orbits_are_refused() {
        let message = |text: &str| read(text, None).unwrap_err().to_string();
        for (text, wanted) in [
            (
                OBJECT.replace("\"EPHEMERIS_TYPE\": 0", "\"CENTER_NAME\": \"MOON\""),
                "CENTER_NAME: wanted EARTH, got \"MOON\"",
            ),
            (kvn().replace("= 51.6416", "= 0.9013 [rad]"), "line 1: INCLINATION: wanted the unit \"deg\""),
            (xml().replace("<INCLINATION>", "<INCLINATION units=\"rad\">"), "line 2: INCLINATION: wanted the unit"),
            (csv().replace(",51.6416", ""), "line 2, column 1: wanted"),
            (xml().replace("</body>", ""), "line"),
            (format!("{}INCLINATION = 12.5\n", kvn()), "line 1: INCLINATION: wanted one value instead of two"),
            (format!("{}BTERM = 0.01\n", kvn()), "BTERM: wanted BSTAR alone"),
        ] {
            assert!(message(&text).contains(wanted), "{wanted}: {}", message(&text));
        }
        let earth = xml().replace("<INCLINATION>", "<CENTER_NAME>Earth</CENTER_NAME><INCLINATION units=\"deg\">");
        read(&earth, None).expect("control: a right message is read");
        read(&format!("{}BTERM = 0\n", kvn()), None).expect("control: no drag by another number");
    }

    #[test]
    fn another_message_beside_the_elements_is_named() {
        let both = xml().replace("</ndm>", "<oem></oem></ndm>");
        let refused = read(&both, None).unwrap_err().to_string();
        assert!(refused.contains("line 19: wanted OMMs alone, got an OEM besides"), "{refused}");
        assert!(read(&xml(), None).is_ok(), "control");
    }

    #[test]
    fn errors_name_their_place() {
        let message = |text: &str| read(text, None).unwrap_err().to_string();
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
            read(&OBJECT.replace("2008-09-20T12", epoch), None).expect("the ends of the years");
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
                    let read = if is_omm { read(changed, None) } else { TleOrbit::parse(changed) };
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
