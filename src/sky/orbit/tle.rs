//! Two-line elements -> geocentric state, by SGP4 (crate `sgp4`) and precession.
//!
//! Input: two lines of 69 ASCII characters with checksums. Output: ICRF axes through
//! [`super::precession`], whose doc bounds what is neglected. Gravity constants are those of WGS 72, with which public
//! elements are made (the mode the crate calls AFSPC-compatible). SGP4's own error is km and m/s near the epoch and
//! grows by km per day in low orbit: 1 m/s is 0.7 mas of aberration.

use super::precession::icrf_from_teme;
use crate::ObserverError;
use crate::state::BarycentricState;
use base::time::Tai;
use base::units::DAY_S;
use core::ops::RangeInclusive;
use glam::DVec3;
use sgp4::chrono::Datelike;

/// Polar radius of the Earth, km (WGS 84): nothing flies below it.
const POLAR_RADIUS_KM: f64 = 6_356.752;
/// Years of epochs: the first of an object in orbit; the last before the sidereal time of SGP4 takes 2100 to be a leap
/// year.
const EPOCH_YEARS: RangeInclusive<i32> = 1957..=2099;
/// Furthest from the epoch, days: a century. Orbits in resonance take a step of 12 hours after the other.
const MOST_DAYS: f64 = 36_525.0;
/// Characters of each line.
const LINE_LENGTH: usize = 69;

/// Plain decimal fields: line, first and last column (from 1), name. Columns as in Hoots and Roehrich, Spacetrack
/// Report No. 3 (1980).
const DECIMAL_FIELDS: [(usize, usize, usize, &str); 11] = [
    (1, 19, 20, "epoch year"),
    (1, 21, 32, "epoch day of year"),
    (1, 34, 43, "first derivative of mean motion"),
    (1, 51, 52, "exponent of the second derivative of mean motion"),
    (1, 60, 61, "exponent of the drag term"),
    (2, 9, 16, "inclination"),
    (2, 18, 25, "right ascension of the ascending node"),
    (2, 27, 33, "eccentricity"),
    (2, 35, 42, "argument of perigee"),
    (2, 44, 51, "mean anomaly"),
    (2, 53, 63, "mean motion"),
];

/// An orbit given by two-line elements, ready to be followed.
#[derive(Debug, Clone)]
pub struct TleOrbit {
    norad_id: u64,
    epoch_unix_s: f64,
    constants: sgp4::Constants,
}

impl TleOrbit {
    /// Reads two-line elements. `text` holds the two lines, with or without a title line before them.
    ///
    /// # Errors
    /// When a line is missing, has a wrong length, first character or checksum, or a field is not a number: the error
    /// names line, columns and field; or when SGP4 refuses the elements.
    pub fn parse(text: &str) -> Result<Self, ObserverError> {
        let mut lines = text.lines().map(str::trim_end).filter(|line| !line.is_empty()).rev();
        let (second, first) = (lines.next().unwrap_or(""), lines.next().unwrap_or(""));
        check_line(1, first)?;
        check_line(2, second)?;
        for field in DECIMAL_FIELDS {
            check_field(if field.0 == 1 { first } else { second }, field)?;
        }
        Self::from_checked_lines(first, second)
    }

    /// Reads the object with `norad_id`, or the only one, of a file of many: pairs of lines, with or without a title
    /// before each pair.
    ///
    /// # Errors
    /// When the pair of lines is missing, several have that number, or several are there without a number to choose by,
    /// or as for [`Self::parse`]. Without a number, also when there are other lines than the pair and its title: they
    /// may be an object whose lines are damaged.
    pub fn parse_one_of(text: &str, norad_id: Option<u64>) -> Result<Self, ObserverError> {
        let lines = || text.lines().map(str::trim_end);
        let pairs = || lines().zip(lines().skip(1)).filter(|(a, b)| a.starts_with("1 ") && b.starts_with("2 "));
        let is_it = |first: &str| norad_id.is_none() || first.get(2..7).and_then(number_of) == norad_id;
        let objects = pairs().count();
        let mut found = pairs().filter(|(first, _)| is_it(first));
        let (chosen, others) = (found.next(), found.count());
        if let (Some(norad_id), 1..) = (norad_id, others) {
            return Err(ObserverError::WhichSet { norad_id, sets: 1 + others });
        }
        match chosen {
            Some(_) if norad_id.is_none() && objects > 1 => Err(ObserverError::WhichObject { objects }),
            Some((first, second)) => {
                if norad_id.is_none() {
                    check_alone(lines(), first)?;
                }
                Self::parse(&format!("{first}\n{second}"))
            }
            None => Err(ObserverError::NoSuchObject { norad_id, objects }),
        }
    }

    fn from_checked_lines(first: &str, second: &str) -> Result<Self, ObserverError> {
        let elements = sgp4::Elements::from_tle(None, first.as_bytes(), second.as_bytes())
            .map_err(|e| ObserverError::TleLine { line: 1, why: e.to_string() })?;
        Self::from_elements(&elements)
    }

    /// Returns an orbit of elements that were read already.
    pub(super) fn from_elements(elements: &sgp4::Elements) -> Result<Self, ObserverError> {
        let norad_id = elements.norad_id;
        let refuse = |why: String| ObserverError::Elements { norad_id, why };
        if ![0, 2].contains(&elements.ephemeris_type) {
            let got = elements.ephemeris_type;
            return Err(refuse(format!(
                "ephemeris type wanted 0 or 2 (SGP4), got {got}: 4 is of another theory, SGP4-XP"
            )));
        }
        let (year, years) = (elements.datetime.year(), EPOCH_YEARS);
        if !years.contains(&year) {
            return Err(refuse(format!("epoch wanted in the years {} to {}, got {year}", years.start(), years.end())));
        }
        let constants =
            sgp4::Constants::from_elements_afspc_compatibility_mode(elements).map_err(|e| refuse(e.to_string()))?;
        let epoch = elements.datetime.and_utc();
        let epoch_unix_s = epoch.timestamp() as f64 + f64::from(epoch.timestamp_subsec_nanos()) * 1e-9;
        Ok(Self { norad_id, epoch_unix_s, constants })
    }

    /// Returns the number of the object in the elements.
    #[must_use]
    pub fn norad_id(&self) -> u64 {
        self.norad_id
    }

    /// Days from the elements' epoch to `at`; positive after it.
    #[must_use]
    pub fn days_from_epoch(&self, at: Tai) -> f64 {
        (at.unix_s() - self.epoch_unix_s) / DAY_S
    }

    /// Returns the state from the geocentre at `at`.
    ///
    /// # Errors
    /// When SGP4 cannot follow the elements that far.
    pub fn geocentric_state(&self, at: Tai) -> Result<BarycentricState, ObserverError> {
        let days_from_epoch = self.days_from_epoch(at);
        let refuse = |why: String| ObserverError::Propagation { at, days_from_epoch, why };
        if days_from_epoch.abs() > MOST_DAYS {
            return Err(refuse(format!("wanted a time within {MOST_DAYS} days of their epoch")));
        }
        let [position_km, velocity_km_s] = self.teme_state(days_from_epoch * 1440.0).map_err(refuse)?;
        let icrf_from_teme = icrf_from_teme(at);
        let state = BarycentricState {
            position_km: icrf_from_teme * position_km,
            velocity_km_s: icrf_from_teme * velocity_km_s,
        };
        if !(state.position_km.is_finite() && state.velocity_km_s.is_finite()) {
            return Err(refuse("the prediction is not finite".into()));
        }
        // SGP4 follows what has decayed underground for weeks without a word.
        let radius_km = state.position_km.length();
        if radius_km < POLAR_RADIUS_KM {
            return Err(refuse(format!("decayed: {radius_km:.0} km from the Earth's centre")));
        }
        Ok(state)
    }
}

impl TleOrbit {
    /// Returns position, km, and velocity, km/s, in SGP4's own axes.
    pub(super) fn teme_state(&self, minutes_from_epoch: f64) -> Result<[DVec3; 2], String> {
        let minutes = sgp4::MinutesSinceEpoch(minutes_from_epoch);
        let teme = self.constants.propagate_afspc_compatibility_mode(minutes).map_err(|error| error.to_string())?;
        Ok([teme.position, teme.velocity].map(DVec3::from_array))
    }
}

/// Returns a catalog number of five characters; the first may be a letter without I and O for 10 to 33 (Alpha-5).
fn number_of(text: &str) -> Option<u64> {
    let letter = text.chars().next().filter(char::is_ascii_uppercase);
    let Some(letter) = letter else { return text.trim().parse().ok() };
    let tens = "ABCDEFGHJKLMNPQRSTUVWXYZ".find(letter)? as u64 + 10;
    Some(10_000 * tens + text.get(1..)?.parse::<u64>().ok()?)
}

/// Checks that a file has no other lines than a title, `first` and the line after it.
fn check_alone<'a>(lines: impl Iterator<Item = &'a str>, first: &str) -> Result<(), ObserverError> {
    let mut lines = (1..).zip(lines).filter(|(_, line)| !line.is_empty()).peekable();
    lines.next_if(|(_, line)| *line != first);
    let pair = [lines.next(), lines.next()];
    let is_pair = pair[0].is_some_and(|(_, line)| line == first);
    match if is_pair { lines.next() } else { pair[0] } {
        Some((line, got)) => Err(ObserverError::TleOther { line, got: got.chars().take(LINE_LENGTH).collect() }),
        None => Ok(()),
    }
}

fn check_line(line: usize, text: &str) -> Result<(), ObserverError> {
    let refuse = |why: String| Err(ObserverError::TleLine { line, why });
    if !text.is_ascii() || text.len() != LINE_LENGTH {
        return refuse(format!("wanted {LINE_LENGTH} ASCII characters, got {}: \"{text}\"", text.chars().count()));
    }
    if !text.starts_with(if line == 1 { "1 " } else { "2 " }) {
        return refuse(format!("wanted it to begin with \"{line} \", got \"{}\"", &text[..2]));
    }
    let (wanted, got) = (checksum(text), &text[LINE_LENGTH - 1..]);
    if got != wanted.to_string() {
        return refuse(format!("wanted checksum {wanted} in column {LINE_LENGTH}, got \"{got}\""));
    }
    Ok(())
}

/// Returns the sum of the digits, a minus sign counting 1, modulo 10.
fn checksum(text: &str) -> u32 {
    let value = |c: char| if c == '-' { 1 } else { c.to_digit(10).unwrap_or(0) };
    text.chars().take(LINE_LENGTH - 1).map(value).sum::<u32>() % 10
}

fn check_field(text: &str, field: (usize, usize, usize, &'static str)) -> Result<(), ObserverError> {
    let (line, first, last, name) = field;
    let got = &text[first - 1..last];
    if got.trim().parse::<f64>().is_ok_and(f64::is_finite) {
        return Ok(());
    }
    Err(ObserverError::TleField { line, first, last, field: name, got: got.into() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::time::Span;

    // The verification set of "Revisiting Spacetrack Report #3" (AIAA 2006-6753): object 5.
    const FIRST: &str = "1 00005U 58002B   00179.78495062  .00000023  00000-0  28098-4 0  4753";
    const SECOND: &str = "2 00005  34.2682 348.7242 1859667 331.7664  19.3264 10.82419157413667";

    fn orbit() -> TleOrbit {
        TleOrbit::parse(&format!("VANGUARD 1\n{FIRST}\n{SECOND}\n")).expect("published elements")
    }

    #[test]
    fn published_state_at_epoch_survives_the_turn_to_icrf() {
        // tcppver.out of the same paper, t = 0: 7022.46529266 -1400.08296755 0.03995155 km (TEME).
        let orbit = orbit();
        let at = Tai::from_rfc3339("2000-06-27T18:50:19.733568Z").expect("a valid instant");
        assert!(orbit.days_from_epoch(at).abs() * DAY_S < 1e-4, "{} d", orbit.days_from_epoch(at));
        let state = orbit.geocentric_state(at).expect("at epoch");
        let wanted_km = icrf_from_teme(at) * DVec3::new(7_022.465_292_66, -1_400.082_967_55, 0.039_951_55);
        // Printed to 1e-8 km; the epoch's text resolves 1e-8 day, 6 m. Gravity constants are WGS 72 in both.
        assert!((state.position_km - wanted_km).length() < 1e-2, "{} for {wanted_km}", state.position_km);
    }

    #[test]
    fn velocity_is_the_rate_of_position() {
        let orbit = orbit();
        let at = Tai::from_rfc3339("2000-06-28T00:00:00Z").expect("a valid instant");
        let half = Span::from_ms(500);
        let position = |at| orbit.geocentric_state(at).expect("near epoch").position_km;
        let wanted = position(at + half) - position(at - half);
        let got = orbit.geocentric_state(at).expect("near epoch").velocity_km_s;
        // SGP4's velocity omits short-periodic terms: the theory's reference code shows the same 0.85 m/s here, which
        // is
        // 0.6 mas of aberration.
        assert!((got - wanted).length() < 1e-3, "{got} for {wanted}");
        assert!((got - wanted).length() > 1e-5, "control: a comparison at this level sees the omission");
    }

    #[test]
    fn errors_name_line_columns_and_field() {
        let message = |first: &str, second: &str| {
            TleOrbit::parse(&format!("{first}\n{second}")).expect_err("bad elements").to_string()
        };
        let short = message(&FIRST[..60], SECOND);
        assert!(short.contains("line 1") && short.contains("69"), "{short}");
        let swapped = message(SECOND, FIRST);
        assert!(swapped.contains("line 1") && swapped.contains("begin"), "{swapped}");
        let flipped = message(FIRST, &SECOND.replace("34.2682", "34.2683"));
        assert!(flipped.contains("line 2") && flipped.contains("checksum 8"), "{flipped}");
        // "34.2682" -> "3x.2682" lowers the digit sum by 4: the checksum digit 7 becomes 3.
        let letter = message(FIRST, &format!("{}3", &SECOND.replace("34.2682", "3x.2682")[..68]));
        assert!(letter.contains("columns 9-16 (inclination)") && letter.contains("3x.2682"), "{letter}");
        assert!(TleOrbit::parse("").is_err() && TleOrbit::parse("1 é").is_err(), "empty and non-ASCII text");
    }

    #[test]
    fn an_object_whose_lines_are_damaged_is_not_passed_over() {
        let pair = format!("{FIRST}\n{SECOND}\n");
        for (text, line) in [
            (format!("x{}\n{SECOND}\n{pair}", &FIRST[1..]), 2),
            (format!("{FIRST}\nx{}\n{pair}", &SECOND[1..]), 3),
            (format!("{pair}{FIRST}\n"), 3),
            (format!("{pair}ANOTHER\n"), 3),
            (format!("FILE OF JUNE\nVANGUARD 1\n{pair}"), 2),
        ] {
            let reported = TleOrbit::parse_one_of(&text, None).expect_err("damaged").to_string();
            assert!(reported.contains(&format!("line {line} of the file")), "{text}: {reported}");
            assert_eq!(TleOrbit::parse_one_of(&text, Some(5)).expect("asked for").norad_id(), 5);
        }
    }

    #[test]
    fn a_century_is_the_end() {
        let (orbit, epoch) = (orbit(), Tai::from_rfc3339("2000-06-27T18:50:19.733568Z").expect("a valid instant"));
        let days_later = |days: f64| orbit.geocentric_state(epoch + Span::from_s(days * DAY_S));
        let reported = |days: f64| days_later(days).err().map(|error| error.to_string()).unwrap_or_default();
        for sign in [-1.0, 1.0] {
            assert!(!reported(sign * (MOST_DAYS - 1.0)).contains("36525"), "SGP4's own word");
            let reported = reported(sign * (MOST_DAYS + 1.0));
            assert!(reported.contains("wanted a time within 36525 days"), "{reported}");
        }
    }

    #[test]
    fn one_of_a_file_is_chosen_by_its_number() {
        const OTHER: [&str; 2] = [
            "1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  2927",
            "2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.72125391563537",
        ];
        let file = format!("VANGUARD 1\r\n{FIRST}\r\n{SECOND}\r\n0 ISS\n{}\n{}\n", OTHER[0], OTHER[1]);
        for id in [5, 25_544] {
            assert_eq!(TleOrbit::parse_one_of(&file, Some(id)).expect("in the file").norad_id(), id);
        }
        let message = |text: &str, id| TleOrbit::parse_one_of(text, id).expect_err("no choice").to_string();
        assert!(
            message(&file, None).contains("2 objects")
                && message(&file, Some(6)).contains("number 6, got none among 2")
        );
        assert!(message("", None).contains("among 0"), "{}", message("", None));
        assert_eq!(TleOrbit::parse_one_of(&format!("{FIRST}\n{SECOND}"), None).expect("the only one").norad_id(), 5);
        let titled = format!("\nVANGUARD 1\n\n{FIRST}\n{SECOND}\n\n");
        assert_eq!(TleOrbit::parse_one_of(&titled, None).expect("the only one").norad_id(), 5);
        let short = message(&file.replace(OTHER[1], &OTHER[1][..60]), Some(25_544));
        assert!(short.contains("line 2") && short.contains("69"), "{short}");
        assert_eq!((number_of("A0001"), number_of("Z9999"), number_of("I0001")), (Some(100_001), Some(339_999), None));
    }
}
