//! Each form and convention by hand, each refusal by its reason, 42's lines as 42 sends them.

use super::*;
use crate::Datagram;
use proptest::prelude::*;

const ANGLE: f64 = 0.1;

/// Returns a body turned by +0.1 about x, as starloop has it.
fn turned() -> [f64; 4] {
    [(0.5 * ANGLE).cos(), -(0.5 * ANGLE).sin(), 0.0, 0.0]
}

fn fields(names: &str) -> Vec<Field> {
    PlainLayout::fields_of(&names.split(' ').map(String::from).collect::<Vec<_>>()).unwrap()
}

fn read(layout: &PlainLayout, bytes: &[u8]) -> Result<PlainRecord, PlainReject> {
    let mut codec = PlainCodec::new(layout.clone());
    let record = codec.read(bytes);
    let reason = codec.rejects().iter().find(|(_, count)| *count > 0);
    record.ok_or_else(|| reason.unwrap().0)
}

fn packed(numbers: &[f64]) -> Vec<u8> {
    numbers.iter().flat_map(|number| number.to_le_bytes()).collect()
}

fn eight(t: f64, [w, x, y, z]: [f64; 4]) -> Vec<u8> {
    packed(&[t, w, x, y, z, 0.01, -0.02, 0.03])
}

/// Compares numbers; the reader of JSON may err in the last bit.
fn is_near(got: &[f64], wanted: &[f64]) -> bool {
    got.len() == wanted.len() && got.iter().zip(wanted).all(|(got, wanted)| (got - wanted).abs() <= 4e-16)
}

fn attitude(record: PlainRecord) -> PlainAttitude {
    record.attitude.unwrap()
}

#[test]
fn eight_doubles_are_the_default_in_either_byte_order() {
    let record = read(&PlainLayout::default(), &eight(1.5, turned())).unwrap();
    assert_eq!(record.time, PlainTime::Tag(1_500_000_000));
    assert_eq!(read(&PlainLayout::default(), &eight(0.0, turned())).unwrap().time, PlainTime::Arrival);
    assert_eq!(attitude(record).q_wxyz, turned());
    assert_eq!(attitude(record).rate_rad_s, [0.01, -0.02, 0.03]);
    assert_eq!((record.jitter_rad, record.observer), (None, None));
    let mut swapped = eight(1.5, turned());
    swapped.chunks_exact_mut(8).for_each(<[u8]>::reverse);
    let big = PlainLayout { encoding: Encoding::F64Be, ..PlainLayout::default() };
    assert_eq!(read(&big, &swapped), Ok(record));
    assert_eq!(read(&PlainLayout::default(), &swapped), Err(PlainReject::QuaternionNorm), "control");
    assert_eq!(read(&big, &eight(1.5, turned())), Err(PlainReject::QuaternionNorm), "control");
}

#[test]
fn order_sense_and_units_are_those_of_the_layout() {
    let layout = PlainLayout {
        fields: fields("q_x q_y q_z q_w skip w_z w_y w_x t a_x a_y a_z"),
        sense: QuaternionSense::Conjugate,
        angle_unit_rad: 1.0_f64.to_radians(),
        time_unit_ns: 1e6,
        time: TimeMeaning::Tag,
        ..PlainLayout::default()
    };
    let [w, x, ..] = turned();
    // As scipy, ROS and most others have it: scalar last, x positive.
    let bytes = packed(&[-x, 0.0, 0.0, w, f64::NAN, 3.0, 2.0, 1.0, 250.0, 0.0, 0.0, 180.0]);
    let record = read(&layout, &bytes).unwrap();
    assert_eq!(record.time, PlainTime::Tag(250_000_000));
    assert_eq!(attitude(record).q_wxyz, [w, x, -0.0, -0.0]);
    assert_eq!(attitude(record).rate_rad_s, [1.0_f64, 2.0, 3.0].map(f64::to_radians));
    assert!((attitude(record).acceleration_rad_s2[2] - core::f64::consts::PI).abs() < 1e-15);
}

#[test]
fn json_is_an_object_by_name_or_by_vector_or_an_array() {
    let layout = PlainLayout { encoding: Encoding::Json, ..PlainLayout::default() };
    let [w, x, ..] = turned();
    let texts = [
        format!(
            "{{\"t\":1.5,\"q_w\":{w},\"q_x\":{x},\"q_y\":0,\"q_z\":0,\"w_x\":0.01,\"w_y\":-0.02,\"w_z\":0.03,\"more\":[]}}"
        ),
        format!("{{\"q\":[{w},{x},0,0],\"w\":[0.01,-0.02,0.03],\"t\":1.5}}\n"),
        format!("[1.5,{w},{x},0,0,0.01,-0.02,0.03]"),
    ];
    for text in texts {
        let record = read(&layout, text.as_bytes()).unwrap();
        assert_eq!(record.time, PlainTime::Tag(1_500_000_000));
        assert!(is_near(&attitude(record).q_wxyz, &turned()), "{text}: {record:?}");
        assert!(is_near(&attitude(record).rate_rad_s, &[0.01, -0.02, 0.03]), "{text}: {record:?}");
    }
    for (text, reason) in [
        ("{", PlainReject::Json),
        ("7", PlainReject::Json),
        ("[1,2]", PlainReject::Length),
        ("{\"t\":1}", PlainReject::FieldMissing),
        ("{\"t\":1,\"q\":[1,0,0],\"w\":[0,0,0]}", PlainReject::FieldMissing),
        ("{\"t\":\"now\",\"q\":[1,0,0,0],\"w\":[0,0,0]}", PlainReject::Number),
        ("{\"t\":1,\"q\":[1,1,0,0],\"w\":[0,0,0]}", PlainReject::QuaternionNorm),
    ] {
        assert_eq!(read(&layout, text.as_bytes()), Err(reason), "{text}");
    }
}

#[test]
fn text_has_its_numbers_between_blanks_or_commas() {
    let layout = PlainLayout { encoding: Encoding::Text, ..PlainLayout::default() };
    for text in ["0 1 0 0 0 0.5 0 0\n", "0, 1.0,0,0,0 ; 5e-1\t0 0"] {
        let record = read(&layout, text.as_bytes()).unwrap();
        assert_eq!((record.time, attitude(record).rate_rad_s[0]), (PlainTime::Arrival, 0.5), "{text}");
    }
    for (text, reason) in [
        (&b"0 1 0 0 0 0 0"[..], PlainReject::Length),
        (b"0 1 0 0 0 0 0 0 0", PlainReject::Length),
        (b"0 1 0 0 0 0 0 zero", PlainReject::Number),
        (b"0 1 0 0 0 0 0 \xFF", PlainReject::Text),
        (b"0 1 0 0 0 0 0 inf", PlainReject::NotFinite),
    ] {
        assert_eq!(read(&layout, text), Err(reason));
    }
}

#[test]
fn refusals_of_packed_numbers_have_their_reasons() {
    let layout = PlainLayout::default();
    let good = eight(0.0, turned());
    assert!(read(&layout, &good).is_ok(), "control");
    for (bytes, reason) in [
        (good[..63].to_vec(), PlainReject::Length),
        ([&good[..], &[0]].concat(), PlainReject::Length),
        (Vec::new(), PlainReject::Length),
        (eight(f64::NAN, turned()), PlainReject::NotFinite),
        (eight(1e12, turned()), PlainReject::Time),
        (eight(0.0, [1.0015, 0.0, 0.0, 0.0]), PlainReject::QuaternionNorm),
        (eight(0.0, [0.0; 4]), PlainReject::QuaternionNorm),
    ] {
        assert_eq!(read(&layout, &bytes), Err(reason));
    }
    assert!(read(&layout, &eight(0.0, [1.0005, 0.0, 0.0, 0.0])).is_ok(), "within the tolerance");
}

#[test]
fn number_that_came_lately_is_refused_and_a_restart_is_not() {
    let layout = PlainLayout { fields: fields("seq t q_w q_x q_y q_z w_x w_y w_z"), ..PlainLayout::default() };
    let mut codec = PlainCodec::new(layout);
    let mut take = |seq: f64| codec.read(&packed(&[seq, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0])).is_some();
    assert!((500..600).all(|seq| take(f64::from(seq))));
    assert!(!take(599.0) && !take(550.0), "received already");
    assert!((0..100).all(|seq| take(f64::from(seq))), "a sender that starts again");
    assert_eq!(codec.rejects().get(PlainReject::Repeated), 2);
}

#[test]
fn layouts_that_cannot_be_are_refused() {
    let of = |names: &str| PlainLayout::fields_of(&names.split(' ').map(String::from).collect::<Vec<_>>());
    assert_eq!(of("t quaternion"), Err((1, LayoutError::Unknown)));
    assert_eq!(of("t q_w t"), Err((2, LayoutError::Twice("t"))));
    assert_eq!(of(&["skip"; FIELDS_MAX + 1].join(" ")), Err((FIELDS_MAX, LayoutError::TooLong)));
    let check = |names: &str, time| PlainLayout { fields: fields(names), time, ..PlainLayout::default() }.check();
    assert_eq!(check("t q_w q_x q_y q_z", TimeMeaning::Tag), Err(LayoutError::Torn("w_x")));
    assert_eq!(check("t j_x j_y", TimeMeaning::Tag), Err(LayoutError::Torn("j_z")));
    assert_eq!(check("t j_x j_y j_z a_x a_y a_z", TimeMeaning::Tag), Err(LayoutError::Torn("q_w")));
    assert_eq!(check("t seq skip", TimeMeaning::Tag), Err(LayoutError::Empty));
    assert_eq!(check("j_x j_y j_z", TimeMeaning::Tag), Err(LayoutError::NoTime));
    assert_eq!(check("j_x j_y j_z", TimeMeaning::Arrival), Ok(()));
    assert_eq!(PlainLayout::default().check(), Ok(()));
}

const MESSAGE: &str = "TIME 2025-079-12:00:00.010000000\n\
    SC[0].qn = [ 4.997916927068e-02 0.000000000000e+00 0.000000000000e+00 9.987502603950e-01]\n\
    SC[1].qn = [ 0 0 0 5 ]\n\
    SC[0].wn = [ 1.0e-02 -2.0e-02 3.0e-02]\n\
    SC[0].PosR = [ 1.0e+03 0.0 0.0]\nSC[0].VelR = [0.0 0.0 1.0]\n\
    Orb[0].PosN = [ 6.999e+06 0.0 0.0]\nOrb[0].VelN = [ 0.0 7.5e+03 0.0]\n\
    SC[0].svb = [ 1 0 0 ]\n[ENDMSG]\n";

fn take_42(text: &str, time: TimeMeaning) -> (Option<PlainRecord>, PlainRejectCounters) {
    let mut codec = PlainCodec::new(PlainLayout { encoding: Encoding::FortyTwo(0), time, ..PlainLayout::default() });
    let record = text.lines().filter_map(|line| codec.read(line.as_bytes())).last();
    (record, *codec.rejects())
}

#[test]
fn lines_of_42_are_read_in_its_conventions() {
    let (record, rejects) = take_42(MESSAGE, TimeMeaning::Tag);
    let record = record.unwrap();
    // 2025-03-20T12:00:00.010 UTC.
    assert_eq!(record.time, PlainTime::Tag(1_742_472_000_010_000_000));
    let q_wxyz = attitude(record).q_wxyz;
    let error = q_wxyz.iter().zip(turned()).map(|(got, wanted)| (got - wanted).abs());
    assert!(error.fold(0.0, f64::max) < 1e-12, "{record:?}");
    assert_eq!(attitude(record).rate_rad_s, [0.01, -0.02, 0.03]);
    let state = record.observer.unwrap();
    assert_eq!((state.position_km, state.velocity_km_s), ([7000.0, 0.0, 0.0], [0.0, 7.5, 0.001]));
    assert_eq!(rejects.total(), 0);
    assert_eq!(take_42(MESSAGE, TimeMeaning::Arrival).0.unwrap().time, PlainTime::Arrival);
}

#[test]
fn messages_of_42_before_2024_are_read_too() {
    let old = "TIME 2025-079-12:00:00.010000000\n\
        SC[0].B[0].wn =  1.0e-02 -2.0e-02 3.0e-02\n\
        SC[0].B[0].qn =  4.997916927068e-02 0.000000000000e+00 0.000000000000e+00 9.987502603950e-01\n\
        SC[0].B[1].qn =  0 0 0 5\nOrb[0].PosN =  6.999e+06 0.0 0.0\nOrb[0].VelN =  0.0 7.5e+03 0.0\n[EOF]\n\n";
    let (record, rejects) = take_42(old, TimeMeaning::Tag);
    let new = take_42(MESSAGE, TimeMeaning::Tag).0.unwrap();
    let record = record.unwrap();
    assert_eq!((record.time, attitude(record)), (new.time, attitude(new)));
    assert_eq!(rejects.total(), 0);
    let turned = old.replace("9.987502603950e-01", "-9.987502603950e-01");
    assert_ne!(attitude(take_42(&turned, TimeMeaning::Tag).0.unwrap()), attitude(new), "control");
}

#[test]
fn a_line_that_42_does_not_send_is_counted_and_quoted_and_the_message_is_whole() {
    let text = MESSAGE.replace("SC[0].svb = [ 1 0 0 ]", "hello\tworld");
    let (record, rejects) = take_42(&text, TimeMeaning::Tag);
    assert!(record.is_some(), "other lines do no damage");
    assert_eq!((rejects.get(PlainReject::Unread), rejects.total()), (1, 1));
    let mut codec = PlainCodec::new(PlainLayout { encoding: Encoding::FortyTwo(0), ..PlainLayout::default() });
    text.lines().chain(["more"]).for_each(|line| {
        let _ = codec.read(line.as_bytes()); // counted
    });
    assert_eq!(codec.first_refused().unwrap().to_string(), "\"hello.world\" (plain_unread_line)");
}

#[test]
fn refused_message_of_42_is_quoted_by_its_attitude_or_by_the_spacecraft_that_it_is_about() {
    let other = MESSAGE.replace("SC[0]", "SC[3]");
    let zero = MESSAGE.replacen("SC[0].qn =", "SC[0].qn = [ 0 0 0 0 ] #", 1).replace("] #", "]\nSC[0].svn = #");
    for (text, quoted) in
        [(other.as_str(), "\"SC[3]."), (zero.as_str(), "\"SC[0].qn = [ 0 0 0 0 ]\" (plain_quaternion_norm)")]
    {
        let mut codec = PlainCodec::new(PlainLayout { encoding: Encoding::FortyTwo(0), ..PlainLayout::default() });
        text.lines().for_each(|line| {
            let _ = codec.read(line.as_bytes()); // counted
        });
        let refused = codec.first_refused().unwrap().to_string();
        assert!(refused.starts_with(quoted), "{refused}");
    }
}

#[test]
fn damaged_message_of_42_gives_nothing_and_the_next_one_is_whole() {
    for (from, to, reason) in [
        ("TIME 2025-079", "TIME 2025-400", PlainReject::Time),
        ("TIME 2025-079", "TIME 2025--9223372036854775808", PlainReject::Time),
        ("-12:00:00.01", "--5555555555555555:00:00.01", PlainReject::Time),
        ("SC[0].wn", "SC[7].wn", PlainReject::Incomplete),
        ("9.987502603950e-01]", "]", PlainReject::Length),
        ("-2.0e-02", "two", PlainReject::Number),
        ("9.987502603950e-01]", "8.0e-01]", PlainReject::QuaternionNorm),
    ] {
        let damaged = MESSAGE.replace(from, to);
        let (record, rejects) = take_42(&damaged, TimeMeaning::Tag);
        assert_eq!((record, rejects.get(reason), rejects.total()), (None, 1, 1), "{to}");
        assert!(take_42(&[&damaged, MESSAGE].concat(), TimeMeaning::Tag).0.is_some(), "{to}");
    }
}

proptest! {
    #[test]
    fn written_messages_read_back(
        axis in prop::array::uniform3(-1.0_f64..1.0),
        rate in prop::array::uniform3(-0.1_f64..0.1),
        t_ns in 1_i64..4_000_000_000,
        form in 0_usize..4,
    ) {
        let encoding = [Encoding::F64Le, Encoding::F64Be, Encoding::Json, Encoding::Text][form];
        let norm = (1.0 + axis.iter().map(|a| a * a).sum::<f64>()).sqrt();
        let q_wxyz = [1.0 / norm, axis[0] / norm, axis[1] / norm, axis[2] / norm];
        let wanted = PlainAttitude { q_wxyz, rate_rad_s: rate, acceleration_rad_s2: [0.0; 3] };
        let time = PlainTime::Tag(t_ns);
        let record = PlainRecord { time, attitude: Some(wanted), jitter_rad: None, observer: None };
        let mut codec = PlainCodec::new(PlainLayout { encoding, ..PlainLayout::default() });
        let datagram: Datagram = codec.write(&record).unwrap();
        let got = codec.read(datagram.as_slice()).unwrap();
        prop_assert_eq!((got.time, got.jitter_rad, got.observer), (time, None, None));
        let got = attitude(got);
        prop_assert!(is_near(&got.q_wxyz, &wanted.q_wxyz) && is_near(&got.rate_rad_s, &wanted.rate_rad_s));
        let is_exact = (got.q_wxyz, got.rate_rad_s) == (wanted.q_wxyz, wanted.rate_rad_s);
        prop_assert!(is_exact || encoding == Encoding::Json);
    }

    #[test]
    fn any_bytes_are_read_or_refused(bytes in prop::collection::vec(any::<u8>(), 0..600), form in 0_usize..5) {
        let encoding =
            [Encoding::F64Le, Encoding::F64Be, Encoding::Json, Encoding::Text, Encoding::FortyTwo(0)][form];
        let mut codec = PlainCodec::new(PlainLayout { encoding, ..PlainLayout::default() });
        let record = codec.read(&bytes);
        prop_assert!(record.is_some() || codec.rejects().total() == 1 || encoding == Encoding::FortyTwo(0));
    }
}

#[test]
fn a_json_vector_of_another_length_is_refused() {
    let layout = PlainLayout { encoding: Encoding::Json, ..PlainLayout::default() };
    for (q, w, wanted) in [
        ("[1,0,0,0]", "[0,0,0]", None),
        ("[1,0,0,0,9]", "[0,0,0]", Some(PlainReject::Length)),
        ("[1,0,0]", "[0,0,0]", Some(PlainReject::FieldMissing)),
        ("[1,0,0,0]", "[0,0,0,0]", Some(PlainReject::Length)),
        ("1", "[0,0,0]", Some(PlainReject::FieldMissing)),
    ] {
        let mut codec = PlainCodec::new(layout.clone());
        let line = format!("{{\"t\":1,\"q\":{q},\"w\":{w}}}");
        assert_eq!(codec.read(line.as_bytes()).is_some(), wanted.is_none(), "{line}");
        assert!(wanted.is_none_or(|reject| codec.rejects().get(reject) == 1), "{line}: {:?}", codec.rejects());
    }
}
