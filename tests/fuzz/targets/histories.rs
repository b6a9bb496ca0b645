//! Files of attitudes and orbits: a history whose times rise and whose attitudes can be trusted, or an error that names
//! the file; what is accepted is written and read again in every format. Rows that this target makes are accepted if
//! and only if their times rise and their quaternions are of unit length.

#![no_main]

use base::time::Tai;
use histories::write::{self, AttitudeFormat, Header, OrbitFormat};
use histories::{AttitudeHistory, HistoryError, OrbitHistory, Times, read};
use libfuzzer_sys::fuzz_target;
use starloop_fuzz::{Input, control};

/// Memory for a byte of text, and beside: XML makes the most of it of empty elements.
const MEMORY_PER_BYTE: u64 = 400;
const MEMORY_BESIDE: u64 = 1 << 16;
/// Through text, and turned from other axes.
const AGAIN_RAD: f64 = 1e-9;

fuzz_target!(|bytes: &[u8]| {
    let mut input = Input::new(bytes);
    match input.u8() % 4 {
        0 => attitudes(&String::from_utf8_lossy(input.rest())),
        1 => orbit(&String::from_utf8_lossy(input.rest())),
        kind => made(kind == 2, &mut input),
    }
});

fn measured<T>(text: &str, read: impl Fn() -> Result<T, HistoryError>) -> Option<T> {
    let mut result = None;
    let memory = allocation_counter::measure(|| result = Some(read()));
    let most = MEMORY_PER_BYTE * text.len() as u64 + MEMORY_BESIDE;
    assert!(memory.bytes_max < most, "{} bytes of memory for {}", memory.bytes_max, text.len());
    match result.expect("it was read or refused") {
        Ok(found) => Some(found),
        Err(error) => {
            assert!(error.to_string().starts_with("file"), "{error}");
            None
        }
    }
}

fn header() -> Header {
    let name = || "X".to_owned();
    Header { object_name: name(), object_id: name(), body: "SC_BODY_1".into(), created: Tai::from_ns(0) }
}

fn attitudes(text: &str) {
    let Some(history) = measured(text, || read::attitudes("file", text, None)) else { return };
    check(&history);
    if history.times == Times::FromZero {
        return;
    }
    for format in [AttitudeFormat::Aem1, AttitudeFormat::Aem2, AttitudeFormat::Aem2Xml, AttitudeFormat::Csv] {
        let mut out = Vec::new();
        write::attitudes(&mut out, format, &history, &header()).expect("memory can be written");
        let out = String::from_utf8(out).expect("text");
        let again =
            read::attitudes("file", &out, None).unwrap_or_else(|error| panic!("{format:?}: {error}\n{text}\n{out}"));
        // All rows are written, also those outside the usable times, which CSV does not have.
        let rows =
            |history: &AttitudeHistory| history.segments().iter().map(|segment| segment.states().len()).sum::<usize>();
        assert_eq!(rows(&again), rows(&history));
        for (a, b) in again.segments().iter().zip(history.segments()) {
            for (a, b) in a.states().iter().zip(b.states()) {
                assert_eq!(a.t_ns, b.t_ns);
                assert!(
                    a.body_from_icrf.rotation_vector_to(&b.body_from_icrf).length() < AGAIN_RAD,
                    "{format:?}: {text}"
                );
            }
        }
    }
}

/// Times rise, attitudes are unit quaternions, and there is one wherever the history says so.
fn check(history: &AttitudeHistory) {
    for segment in history.segments() {
        assert!(segment.states().windows(2).all(|pair| pair[0].t_ns < pair[1].t_ns));
        let [first, last] = segment.usable_ns();
        for t_ns in [first, first + last.saturating_sub(first) / 2, last] {
            let motion = history.at_ns(t_ns).expect("a usable instant has an attitude");
            let norm: f64 = motion.body_from_icrf.wxyz().iter().map(|number| number * number).sum();
            assert!((norm - 1.0).abs() < 1e-9, "{norm}");
        }
        for state in segment.states() {
            assert!((state.body_from_icrf.quat().length() - 1.0).abs() < 1e-9);
        }
    }
    let [first, last] = history.span_ns();
    assert!(history.at_ns(first.saturating_sub(1)).is_none() || first == i64::MIN);
    assert!(history.at_ns(last.saturating_add(1)).is_none() || last == i64::MAX);
    assert!(history.interpolation_error_rad().is_none_or(|error| error >= 0.0));
}

fn orbit(text: &str) {
    let Some(history) = measured(text, || read::orbit("file", text)) else { return };
    let all = |history: &OrbitHistory| {
        history.segments().iter().flat_map(|segment| segment.states().to_vec()).collect::<Vec<_>>()
    };
    assert!(
        history.segments().iter().all(|segment| segment.states().windows(2).all(|pair| pair[0].t_ns < pair[1].t_ns))
    );
    for format in [OrbitFormat::Oem, OrbitFormat::OemXml, OrbitFormat::Csv] {
        let mut out = Vec::new();
        write::orbit(&mut out, format, &history, &header()).expect("memory can be written");
        let out = String::from_utf8(out).expect("text");
        let again = read::orbit("file", &out).unwrap_or_else(|error| panic!("{format:?}: {error}\n{text}\n{out}"));
        assert_eq!(all(&again), all(&history), "{format:?}");
    }
    let _ = history.interpolation_error();
}

/// Makes rows of whole seconds and quaternions of whole numbers, as a table or as a message.
fn made(is_table: bool, input: &mut Input<'_>) {
    let (mut rows, mut t_s, mut is_sound) = (String::new(), 0_u32, true);
    let count = 1 + input.u8() % 6;
    for row in 0..count {
        let step_s = u32::from(input.u8() % 8);
        // Broken: a row at the time of the one before it is taken.
        is_sound &= row == 0 || step_s > 0 || control::is_broken();
        t_s += step_s;
        let quaternion: [f64; 4] = core::array::from_fn(|_| f64::from(input.u8() % 3) - 1.0);
        let norm = quaternion.iter().map(|number| number * number).sum::<f64>().sqrt();
        is_sound &= norm > 0.0;
        let [a, b, c, d] = quaternion.map(|number| number / norm.max(1.0));
        let time = if is_table { t_s.to_string() } else { format!("2026-03-01T00:00:{t_s:02}") };
        rows += &format!("{time} {a} {b} {c} {d}\n");
    }
    let text = if is_table {
        rows
    } else {
        format!(
            "CCSDS_AEM_VERS = 2.0\nMETA_START\nREF_FRAME_A = ICRF\nREF_FRAME_B = SC_BODY_1\nTIME_SYSTEM = UTC\nSTART_TIME = \
             2026-03-01T00:00:00\nSTOP_TIME = 2026-03-01T00:01:00\nATTITUDE_TYPE = QUATERNION\nMETA_STOP\nDATA_START\n{rows}DATA_STOP\n"
        )
    };
    let read = measured(&text, || read::attitudes("file", &text, None));
    assert_eq!(read.is_some(), is_sound, "{text}");
    if read.is_some() {
        attitudes(&text);
    }
}
