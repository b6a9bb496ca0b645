//! Two-line elements and orbit mean-elements messages: an orbit whose states can be trusted, or an error; no object is
//! passed over.

#![no_main]

use base::refused::Refused;
use base::time::{Span, Tai};
use libfuzzer_sys::fuzz_target;
use sky::orbit::TleOrbit;
use starloop_fuzz::{Input, control};

/// Elements of the documentation of the two-line format (International Space Station, 2008).
const LINES: [&[u8; 68]; 2] = [
    b"1 25544U 98067A   08264.51782528 -.00002182  00000-0 -11606-4 0  292",
    b"2 25544  51.6416 247.4627 0006703 130.5360 325.0288 15.7212539156353",
];
/// Keys of a message and values of the same elements.
const KEYS: [(&str, &str); 17] = [
    ("OBJECT_NAME", "\"ISS\""),
    ("OBJECT_ID", "\"1998-067A\""),
    ("EPOCH", "\"2008-09-20T12:25:40.104192\""),
    ("MEAN_MOTION", "15.72125391"),
    ("ECCENTRICITY", "0.0006703"),
    ("INCLINATION", "51.6416"),
    ("RA_OF_ASC_NODE", "247.4627"),
    ("ARG_OF_PERICENTER", "130.5360"),
    ("MEAN_ANOMALY", "325.0288"),
    ("EPHEMERIS_TYPE", "0"),
    ("CLASSIFICATION_TYPE", "\"U\""),
    ("NORAD_CAT_ID", "25544"),
    ("ELEMENT_SET_NO", "292"),
    ("REV_AT_EPOCH", "56353"),
    ("BSTAR", "-0.000011606"),
    ("MEAN_MOTION_DOT", "-0.00002182"),
    ("MEAN_MOTION_DDOT", "0"),
];
/// The Earth's polar radius, km.
const POLAR_RADIUS_KM: f64 = 6_356.75;
/// Memory for a byte of text, and beside: JSON makes the most of it of a list in a list.
const MEMORY_PER_BYTE: u64 = 200;
const MEMORY_BESIDE: u64 = 1 << 16;

fuzz_target!(|bytes: &[u8]| {
    let mut input = Input::new(bytes);
    let (kind, hours, norad_id) = (input.u8() % 4, input.finite(), u64::from(input.u32()));
    let at = Tai::from_unix_ns(1_221_913_540_000_000_000) + Span::from_s(f64::from(hours.clamp(-1e6, 1e6)) * 3_600.0);
    match kind {
        0 => read_lines(&String::from_utf8_lossy(input.rest()), norad_id, at),
        1 => read_lines(&lines(&mut input), norad_id, at),
        2 => read_message(&String::from_utf8_lossy(input.rest()), norad_id, at),
        _ => read_message(&message(&mut input), norad_id, at),
    }
});

/// Returns the orbit or the error of a reader, and a state of the orbit.
fn read(text: &str, at: Tai, parse: impl Fn(&str) -> Result<TleOrbit, Refused>) -> Option<TleOrbit> {
    let mut parsed = None;
    let memory = allocation_counter::measure(|| parsed = Some(parse(text)));
    let most = MEMORY_PER_BYTE * text.len() as u64 + MEMORY_BESIDE;
    assert!(memory.bytes_max < most, "{} bytes of memory for {}", memory.bytes_max, text.len());
    let orbit = match parsed.expect("it was read or refused") {
        Ok(orbit) => orbit.within_days(1e9),
        Err(error) => {
            let shown = error.to_string();
            assert!(shown.contains("elements"), "{shown}");
            return None;
        }
    };
    match orbit.geocentric_state(at) {
        Ok(state) => {
            assert!(state.position_km.is_finite() && state.velocity_km_s.is_finite(), "{state:?}");
            assert!(state.position_km.length() > POLAR_RADIUS_KM, "{state:?}");
        }
        Err(error) => assert!(error.to_string().contains("SGP4 has no position"), "{error}"),
    }
    Some(orbit)
}

// --- two-line elements -----------------------------------------------------------------------------------------------

fn read_lines(text: &str, norad_id: u64, at: Tai) {
    let lines: Vec<&str> =
        text.trim_start_matches('\u{feff}').lines().map(str::trim_end).filter(|line| !line.is_empty()).collect();
    if read(text, at, TleOrbit::parse).is_some() {
        assert!(is_pair(&lines[lines.len() - 2..]), "{text}");
    }
    if read(text, at, |text| TleOrbit::read(text, None, at)).is_some() {
        let firsts: Vec<_> = lines.iter().filter(|line| line.starts_with("1 ")).map(|line| line.get(2..7)).collect();
        let is_one = firsts.iter().all(|number| *number == firsts[0]) && lines.len() <= 3 * firsts.len();
        assert!(is_one && is_pair(&lines[lines.len() - 2..]), "others are passed over: {text}");
    }
    for id in [norad_id, 25_544] {
        let orbit = read(text, at, |text| TleOrbit::read(text, Some(id), at));
        assert!(orbit.is_none_or(|orbit| orbit.norad_id == id), "{id}: {text}");
    }
}

/// Returns two lines of one object, whose checksums fit.
fn is_pair(lines: &[&str]) -> bool {
    let checksum = |line: &str| {
        let value = |byte: u8| match byte {
            b'0'..=b'9' => u32::from(byte - b'0'),
            b'-' => 1,
            // Broken: a plus sign counts as a minus sign does.
            b'+' if control::is_broken() => 1,
            _ => 0,
        };
        line.bytes().take(68).map(value).sum::<u32>() % 10
    };
    let fits = |line: &str| line.len() == 69 && line.is_ascii() && line[68..] == checksum(line).to_string();
    let [first, second] = lines else { return false };
    first.starts_with("1 ") && second.starts_with("2 ") && fits(first) && fits(second)
}

/// Pairs of lines with any changes and checksums that fit, mostly; any text between them.
fn lines(input: &mut Input<'_>) -> String {
    let mut text = Vec::new();
    for _ in 0..=input.u8() % 3 {
        let flags = input.u8();
        for (number, line) in LINES.iter().enumerate() {
            let mut line = line.to_vec();
            for _ in 0..input.u8() % 5 {
                let (place, changed) = (input.u8(), input.take(5));
                let begin = usize::from(place) % line.len();
                let end = (begin + changed.len()).min(line.len());
                line[begin..end].copy_from_slice(&changed[..end - begin]);
            }
            let sum = line.iter().map(|byte| if *byte == b'-' { 1 } else { u32::from(byte.wrapping_sub(b'0')) });
            let sum: u32 = sum.filter(|value| *value < 10).sum();
            line.extend((sum % 10).to_string().bytes());
            if flags >> number & 1 == 0 {
                text.extend(line);
                text.push(b'\n');
            }
        }
        if flags & 4 != 0 {
            let length = usize::from(input.u8() % 32);
            text.extend(input.take(length));
            text.push(b'\n');
        }
    }
    String::from_utf8_lossy(&text).into_owned()
}

// --- messages --------------------------------------------------------------------------------------------------------

fn read_message(text: &str, norad_id: u64, at: Tai) {
    let only = read(text, at, |text| TleOrbit::read(text, None, at));
    for id in [norad_id, 25_544] {
        let Some(orbit) = read(text, at, |text| TleOrbit::read(text, Some(id), at)) else { continue };
        assert_eq!(orbit.norad_id, id, "{text}");
        assert!(only.as_ref().is_none_or(|only| only.norad_id == id), "one of several was taken: {text}");
    }
}

/// Returns a list of objects with all keys, and any text in the place of some values.
fn message(input: &mut Input<'_>) -> String {
    let mut objects = Vec::new();
    for _ in 0..=input.u8() % 2 {
        let mut values = KEYS;
        let changed: Vec<(usize, String)> = (0..input.u8() % 4)
            .map(|_| {
                let (place, length) = (input.u8(), input.u8() % 32);
                let value = String::from_utf8_lossy(input.take(usize::from(length))).into_owned();
                (usize::from(place) % KEYS.len(), value)
            })
            .collect();
        for (place, value) in &changed {
            values[*place].1 = value;
        }
        objects.push(values.map(|(key, value)| format!("\"{key}\": {value}")).join(", "));
    }
    format!("[{{{}}}]", objects.join("}, {"))
}
