//! Plain messages: any bytes are read or refused by a reason, in any form and any pieces of a stream; good ones are
//! read.

#![no_main]

use base::axes::WRITTEN_NORM_TOLERANCE;
use libfuzzer_sys::fuzz_target;
use link::plain::{
    Encoding, FIELD_NAMES, PlainAttitude, PlainCodec, PlainLayout, PlainRecord, PlainTime, QuaternionSense, TimeMeaning,
};
use starloop_fuzz::{Input, control};

/// Copies of the text, JSON values of it, and what the parser keeps.
const MEMORY_PER_BYTE: u64 = 256;

fuzz_target!(|bytes: &[u8]| {
    let mut input = Input::new(bytes);
    let layout = layout(&mut input);
    let good = good(&mut input);
    read_any(&layout, input.rest());
    read_lines(&layout, input.rest());
    read_good(&layout, &good, input.rest());
});

fn layout(input: &mut Input<'_>) -> PlainLayout {
    let encoding = match input.u8() % 5 {
        0 => Encoding::F64Le,
        1 => Encoding::F64Be,
        2 => Encoding::Json,
        3 => Encoding::Text,
        _ => Encoding::FortyTwo(0),
    };
    let time = [TimeMeaning::Tag, TimeMeaning::Arrival][usize::from(input.u8() % 2)];
    let sense = [QuaternionSense::Starloop, QuaternionSense::Conjugate][usize::from(input.u8() % 2)];
    let usual = PlainLayout { encoding, time, sense, ..PlainLayout::default() };
    let chosen: Vec<String> =
        (0..input.u8() % 24).map(|_| FIELD_NAMES[usize::from(input.u8()) % FIELD_NAMES.len()].0.into()).collect();
    let other = PlainLayout::fields_of(&chosen).map(|fields| PlainLayout { fields, ..usual.clone() });
    other.ok().filter(|other| other.check().is_ok()).unwrap_or(usual)
}

/// Returns a unit quaternion about one axis.
fn good(input: &mut Input<'_>) -> PlainRecord {
    let half = f64::from(input.u16()) * 1e-4;
    let rate = f64::from(input.u16()) * 1e-4;
    let attitude = PlainAttitude {
        q_wxyz: [half.cos(), -half.sin(), 0.0, 0.0],
        rate_rad_s: [rate, 0.0, -rate],
        acceleration_rad_s2: [0.0; 3],
    };
    PlainRecord { time: PlainTime::Tag(1_000_000_000), attitude: Some(attitude), jitter_rad: None, observer: None }
}

fn read_any(layout: &PlainLayout, bytes: &[u8]) {
    let mut codec = PlainCodec::new(layout.clone());
    let mut record = None;
    let memory = allocation_counter::measure(|| record = codec.read(bytes));
    let most = MEMORY_PER_BYTE * bytes.len() as u64 + 4096;
    assert!(memory.bytes_max < most, "{} bytes of memory for {}", memory.bytes_max, bytes.len());
    assert_eq!(memory.bytes_current, 0, "nothing is kept");
    assert_legal(record.as_ref());
    let is_lines = matches!(layout.encoding, Encoding::FortyTwo(_));
    assert_eq!(
        u64::from(record.is_none() && !is_lines),
        codec.rejects().total().min(u64::from(!is_lines)),
        "one outcome"
    );
    assert!(is_lines || layout.is_message(bytes) == record.is_some(), "known by its messages");
    let is_packed = matches!(layout.encoding, Encoding::F64Le | Encoding::F64Be);
    assert!(!is_packed || memory.count_total == 0, "packed numbers take no memory");
}

fn read_lines(layout: &PlainLayout, bytes: &[u8]) {
    let mut codec = PlainCodec::new(layout.clone());
    let lines = bytes.split(|byte| *byte == b'\n');
    let records =
        lines.clone().filter_map(|line| codec.read(line)).inspect(|record| assert_legal(Some(record))).count();
    assert!(records <= lines.count());
}

/// Asserts that a good message is read after any bytes, exactly but for the last bits of JSON.
fn read_good(layout: &PlainLayout, good: &PlainRecord, noise: &[u8]) {
    let mut codec = PlainCodec::new(layout.clone());
    let _ = codec.read(noise);
    let Some(datagram) = codec.write(good) else { return };
    let has_attitude = layout.fields.iter().any(|field| field.name() == "q_w");
    let got = codec.read(datagram.as_slice());
    // A number of the noise may be that of the message.
    let Some(got) = got else {
        assert!(codec.rejects().get(link::plain::PlainReject::Repeated) > 0, "{good:?} as {datagram:?}");
        return;
    };
    let mut wanted = if has_attitude { good.attitude } else { None };
    if control::is_broken() {
        // Broken: another sense of the quaternion is wanted.
        wanted = wanted.map(|a| PlainAttitude { q_wxyz: [a.q_wxyz[0], -a.q_wxyz[1], 0.0, 0.0], ..a });
    }
    match (got.attitude, wanted) {
        (None, None) => {}
        (Some(got), Some(wanted)) => {
            let pairs = got.q_wxyz.iter().zip(wanted.q_wxyz).chain(got.rate_rad_s.iter().zip(wanted.rate_rad_s));
            pairs.for_each(|(got, wanted)| assert!((got - wanted).abs() <= 4e-15, "{got} for {wanted}"));
        }
        (got, wanted) => panic!("{got:?} for {wanted:?}"),
    }
}

fn assert_legal(record: Option<&PlainRecord>) {
    let Some(record) = record else { return };
    assert!(record.attitude.is_some() || record.jitter_rad.is_some() || record.observer.is_some());
    if let Some(attitude) = &record.attitude {
        let norm = attitude.q_wxyz.iter().map(|part| part * part).sum::<f64>().sqrt();
        assert!((norm - 1.0).abs() <= WRITTEN_NORM_TOLERANCE, "norm {norm}");
        assert!(attitude.rate_rad_s.iter().chain(&attitude.acceleration_rad_s2).all(|value| value.is_finite()));
    }
}
