//! The C implementation against vectors.json, and against the Rust crate on random and damaged input.

use crate::c_program::{Program, compile, folder, hex};
use crate::vectors::{Input, Vector, messages, rejected};
use crate::{flat::Flat, rust_codec::agrees, samples::Samples};
use firmware_protocol::can::{self, CanFrame, CanId, Format, IdMap};
use firmware_protocol::{EncodeError, Message, Reject, serial};

/// Random inputs of each kind.
const FUZZ_INPUTS: usize = 120_000;

fn frames_text<'a>(frames: impl IntoIterator<Item = &'a CanFrame>) -> String {
    let text = |frame: &CanFrame| {
        let data = if frame.data().is_empty() { String::new() } else { hex(frame.data()) };
        format!("{:X}:{data}", frame.id())
    };
    frames.into_iter().map(text).collect::<Vec<_>>().join(" ")
}

fn frame_question(frame: &CanFrame) -> String {
    format!("frame {:X} {} {}", frame.id().flagged(), u8::from(frame.is_fd()), hex(frame.data()))
}

fn outcome_text(outcome: &Result<Option<Message>, Reject>) -> String {
    match outcome {
        Ok(Some(message)) => format!("message {}", Flat::of(message).line()),
        Ok(None) => "nothing".to_owned(),
        Err(reason) => format!("rejected {}", reason.code()),
    }
}

/// Returns whether two outcomes are equal, messages value by value.
fn same_outcome(wanted: &str, got: &str) -> bool {
    match (wanted.strip_prefix("message "), got.strip_prefix("message ")) {
        (Some(wanted), Some(got)) => Flat::parse(wanted) == Flat::parse(got),
        _ => wanted == got,
    }
}

/// Questions whose answers are known.
#[derive(Default)]
pub(crate) struct Exam {
    questions: Vec<String>,
    wanted: Vec<(String, String)>,
}

impl Exam {
    fn put(&mut self, name: &str, question: String, wanted: String) {
        self.questions.push(question);
        self.wanted.push((name.to_owned(), wanted));
    }

    /// Returns the questions with wrong answers.
    pub(crate) fn failures(&self, program: &Program) -> Vec<String> {
        let answers = program.ask(&self.questions);
        let said = |(answer, (name, wanted)): (&String, &(String, String))| {
            let is_right = wanted.split(';').count() == answer.split(';').count()
                && wanted.split(';').zip(answer.split(';')).all(|(wanted, got)| same_outcome(wanted, got));
            (!is_right).then(|| format!("{name}: wanted `{wanted}`, got `{answer}`"))
        };
        answers.iter().zip(&self.wanted).filter_map(said).collect()
    }

    fn len(&self) -> usize {
        self.questions.len()
    }
}

/// Asks for one vector, both ways, on all three carriers.
fn examine(exam: &mut Exam, vector: &Vector) {
    let (name, flat, place) = (&vector.name, Flat::of(&vector.message).line(), (vector.base.flagged(), vector.node));
    exam.put(name, format!("encode 1 {} {} {flat}", place.0, place.1), frames_text([&vector.fd]));
    let classic = vector.classic.as_ref().map_or("error -2".to_owned(), frames_text);
    exam.put(name, format!("encode 0 {} {} {flat}", place.0, place.1), classic);
    exam.put(name, format!("line {} {flat}", vector.serial_seq), hex(&vector.serial));
    let message = format!("message {flat}");
    let listen = |exam: &mut Exam| exam.put(name, format!("listen {} {}", place.0, place.1), "ok".into());
    listen(exam);
    exam.put(name, frame_question(&vector.fd), message.clone());
    listen(exam);
    exam.put(name, format!("bytes {}", hex(&vector.serial)), message);
    listen(exam);
    if let Some((last, parts)) = vector.classic.as_deref().and_then(<[_]>::split_last) {
        parts.iter().for_each(|part| exam.put(name, frame_question(part), "nothing".into()));
        let mut decoder = can::Decoder::new(vector.ids());
        let got = parts.iter().chain([last]).map(|frame| decoder.read(frame).unwrap()).last().flatten().unwrap();
        assert!(agrees(&vector.message, &got), "{name}: what the Rust crate reads, to half a count");
        exam.put(name, frame_question(last), format!("message {}", Flat::of(&got).line()));
    }
}

/// Returns all of vectors.json.
pub(crate) fn exam_of_vectors() -> Exam {
    let mut exam = Exam::default();
    messages().iter().for_each(|vector| examine(&mut exam, vector));
    for input in rejected() {
        exam.put(&input.name, "listen 0 0".into(), "ok".into());
        let reason = format!("rejected {}", input.reason.code());
        match &input.input {
            Input::Frames(frames) => {
                let mut decoder = can::Decoder::new(IdMap::default());
                for frame in frames {
                    exam.put(&input.name, frame_question(frame), outcome_text(&decoder.read(frame)));
                }
                assert_eq!(exam.wanted.last().unwrap().1, reason, "{}", input.name);
            }
            Input::Serial(line) => {
                let outcomes = outcomes_of_line(&mut serial::Decoder::new(), line);
                assert!(outcomes.ends_with(&reason), "{}", input.name);
                exam.put(&input.name, format!("bytes {}", hex(line)), outcomes);
            }
        }
    }
    exam
}

fn outcomes_of_line(decoder: &mut serial::Decoder, line: &[u8]) -> String {
    let mut rest = line;
    let outcomes = std::iter::from_fn(|| decoder.read(&mut rest));
    let outcomes: Vec<_> = outcomes.map(|outcome| outcome_text(&outcome.map(Some))).collect();
    if outcomes.is_empty() { "nothing".to_owned() } else { outcomes.join(";") }
}

/// Returns the random messages as the Rust crate sends them, damaged, and what it makes of them.
pub(crate) fn exam_of_frames(seed: u64, inputs: usize) -> Exam {
    let (mut exam, mut samples) = (Exam::default(), Samples::new(seed));
    for base in [CanId::standard(0x20), CanId::extended(0x18FF_0020)].into_iter().flatten() {
        put_frames(&mut exam, &mut samples, base, inputs / 2);
    }
    exam
}

/// Asks about frames of node 6 at this base.
fn put_frames(exam: &mut Exam, samples: &mut Samples, base: CanId, inputs: usize) {
    let ids = IdMap::of(base, 6).unwrap();
    let mut decoder = can::Decoder::new(ids);
    exam.put("frames", format!("listen {} 6", base.flagged()), "ok".into());
    let inputs = exam.len() + inputs;
    while exam.len() < inputs {
        let format = if samples.below(2) == 0 { Format::Classic } else { Format::Fd };
        let Ok(frames) = can::encode(&samples.strange_message(), format, &ids) else {
            continue;
        };
        for frame in frames.iter() {
            let frame = samples.spoiled(frame);
            for _ in 0..=samples.below(20) / 19 {
                exam.put("frames", frame_question(&frame), outcome_text(&decoder.read(&frame)));
            }
        }
    }
}

/// Returns bytes on a line: packets, damaged ones, noise with many zeros.
pub(crate) fn exam_of_bytes(seed: u64, inputs: usize) -> Exam {
    let (mut exam, mut samples) = (Exam::default(), Samples::new(seed));
    let (mut encoder, mut decoder) = (serial::Encoder::new(), serial::Decoder::new());
    exam.put("bytes", "listen 0 0".into(), "ok".into());
    while exam.len() < inputs {
        let mut line = vec![0; serial::ENCODED_MAX];
        let len = encoder.encode(&samples.strange_message(), &mut line).unwrap();
        line.truncate(len);
        match samples.below(7) {
            0 => drop(line.remove(usize::try_from(samples.below(len as u64)).unwrap())),
            1 => line.insert(usize::try_from(samples.below(len as u64)).unwrap(), samples.u8()),
            2 => line[usize::try_from(samples.below(len as u64)).unwrap()] ^= 1 << samples.below(8),
            3 => line = random_packet(&mut samples),
            4 => line = (0..samples.below(100)).map(|_| samples.u8() & samples.u8() & samples.u8()).collect(),
            _ => {}
        }
        exam.put("bytes", format!("bytes {}", hex(&line)), outcomes_of_line(&mut decoder, &line));
    }
    exam
}

/// Returns a packet that is whole, of any version, type and payload.
fn random_packet(samples: &mut Samples) -> Vec<u8> {
    let ids = firmware_protocol::MessageId::ALL;
    let number = ids[usize::try_from(samples.below(ids.len() as u64)).unwrap()].number();
    let len = [1_u8, 2, 8, 8, 48, 64][usize::try_from(samples.below(6)).unwrap()];
    let major = if samples.below(4) == 0 { samples.u8() } else { 1 };
    let number = if samples.below(4) == 0 { samples.u8() } else { number };
    let mut packet = vec![major, number, samples.u8(), len];
    packet.extend((0..len).map(|_| samples.u8() & samples.u8() & samples.u8()));
    packet.extend(firmware_protocol::crc::crc16(&packet).to_le_bytes());
    let runs = packet.split(|byte| *byte == 0).map(|run| [&[u8::try_from(run.len() + 1).unwrap()], run].concat());
    runs.chain([vec![0]]).flatten().collect()
}

/// Payloads of random bytes behind a right CRC: what lies beyond the framing.
pub(crate) fn exam_of_payloads(seed: u64, inputs: usize) -> Exam {
    let (mut exam, mut samples) = (Exam::default(), Samples::new(seed));
    let mut decoder = can::Decoder::new(IdMap::default());
    exam.put("payloads", "listen 0 0".into(), "ok".into());
    let ids: Vec<_> = firmware_protocol::MessageId::ALL.iter().map(|id| IdMap::default().id(*id)).collect();
    while exam.len() < inputs {
        let id = ids[usize::try_from(samples.below(ids.len() as u64)).unwrap()];
        let len = [1, 2, 8, 8, 8, 8, 48, 64][usize::try_from(samples.below(8)).unwrap()];
        let mut data: Vec<u8> = (0..len).map(|_| samples.u8()).collect();
        data[0] %= 11;
        if samples.below(2) == 0 {
            data.iter_mut().skip(1).take(3).for_each(|byte| *byte %= 6);
        }
        if samples.below(4) == 0 {
            // An infinity, or a NaN, in the place of the value of a cell and of a STATUS page.
            data.iter_mut().skip(6).take(2).for_each(|byte| *byte = 0xFF);
        }
        let frame = CanFrame::classic(id, &data).or_else(|| CanFrame::fd(id, &data)).unwrap();
        exam.put("payloads", frame_question(&frame), outcome_text(&decoder.read(&frame)));
    }
    exam
}

/// Asks about restarts: a sequence number 16 behind the newest is that of a sender which has restarted; 15 behind is a
/// replay.
fn examine_restart(exam: &mut Exam) {
    let mut decoder = can::Decoder::new(IdMap::default());
    exam.put("restart", "listen 0 0".into(), "ok".into());
    for seq in [42, 42 - 15, 42 - 16] {
        let burst = firmware_protocol::message::JitterBurst::new(0, 1, seq, &[[0.0, 0.0]]).unwrap();
        for frame in can::encode(&Message::Jitter(burst), Format::Fd, &IdMap::default()).unwrap().iter() {
            exam.put("restart", frame_question(frame), outcome_text(&decoder.read(frame)));
        }
    }
}

/// Returns values at and beyond the edges of scaled fields, and NaN: the same frames, or refused by both.
fn exam_of_edges() -> Exam {
    let mut exam = Exam::default();
    let limits = [8191.75_f32, 8191.87, 8191.88, 8192.0, 163.82, 163.829, 163.831, 1.048_575, 1.048_575_4, 1.048_576];
    let more = [327.67, 327.674, 327.676, f32::MIN_POSITIVE, 0.125, 0.005, f32::NAN, f32::INFINITY, 1e30];
    // The sign of a NaN does not survive as text.
    let both_signs = limits.into_iter().chain(more).flat_map(|value| [value, -value]);
    for value in both_signs.filter(|value| !value.is_nan() || value.is_sign_positive()) {
        let wheels = firmware_protocol::message::Wheels { speed_rpm: [0.0, value, 0.0, -0.25] };
        let pair = firmware_protocol::message::JitterPair { slot: 1, samples_arcsec: [[0.0, value], [0.02, 0.0]] };
        let burst = firmware_protocol::message::JitterBurst::new(0, 1, 0, &[[value, 0.0]]).unwrap();
        let attitude = firmware_protocol::message::AttitudeRecord {
            t_us: 0,
            seq: 0,
            flags: firmware_protocol::message::AttitudeFlags::ALL,
            q_wxyz: [value, 0.0, 0.0, 1.0],
            rate_rad_s: [0.0, 0.0, value],
            acceleration_rad_s2: [0.0; 3],
        };
        let all =
            [Message::Wheels(wheels), Message::JitterPair(pair), Message::Jitter(burst), Message::Attitude(attitude)];
        for message in all {
            for (fd, format) in [(0, Format::Classic), (1, Format::Fd)] {
                let wanted = match can::encode(&message, format, &IdMap::default()) {
                    Ok(frames) => frames_text(frames.iter()),
                    Err(EncodeError::NotCarried { .. }) => "error -2".into(),
                    Err(_) => "error -1".into(),
                };
                exam.put("edges", format!("encode {fd} 0 0 {}", Flat::of(&message).line()), wanted);
            }
        }
    }
    let [extended, beyond] = [0x8000_0000_u32, 0x9FFF_F900];
    for (base, node) in [(8, 0), (256, 0), (0, 16), (extended + 8, 0), (extended, 16), (beyond, 0), (0x2000_0000, 0)] {
        exam.put("address", format!("listen {base} {node}"), "error -1".into());
        exam.put("address", format!("encode 1 {base} {node} 8 1"), "error -1".into());
    }
    examine_restart(&mut exam);
    // Illegal enumerations and counts, which the Rust types cannot express.
    for illegal in
        ["25 0 5 0 0", "25 3 13 0", "25 7 0 0", "88 9 0 0", "88 5 0 16", "88 2 0 0 2", "88 5 0 0 4", "112 4 1"]
    {
        exam.put("illegal", format!("encode 1 0 0 {illegal}"), "error -1".into());
    }
    for illegal in ["26 3 0 0 0", "26 0 0 0 6 0", "26 1 0 0 0 16777216"] {
        exam.put("illegal", format!("encode 1 0 0 {illegal}"), "error -1".into());
    }
    for illegal in
        ["32 0 16777216 0", "49 0 0 0 1", "49 0 1 0 0", "49 0 1 0 15", "72 0 0 0 1", "72 1 32 0 1", "72 2 0 4 1", "9 0"]
    {
        exam.put("illegal", format!("encode 1 0 0 {illegal}"), "error -1".into());
    }
    exam
}

/// Returns all exams, of any implementation of the header.
pub(crate) fn failures(program: &Program, seed: u64, inputs: usize) -> Vec<String> {
    let exams = [
        exam_of_vectors(),
        exam_of_edges(),
        exam_of_frames(seed, inputs),
        exam_of_bytes(seed, inputs),
        exam_of_payloads(seed, inputs),
    ];
    exams.iter().flat_map(|exam| exam.failures(program)).collect()
}

#[test]
fn c_agrees_with_the_vectors_and_with_rust() {
    let failures = failures(&Program::of_c_sources("c"), 1, FUZZ_INPUTS);
    assert!(failures.is_empty(), "{} differ:\n{}", failures.len(), failures[..failures.len().min(10)].join("\n"));
}

/// The inputs reach every reason and every kind of message, and mostly not the same one.
#[test]
fn random_input_reaches_all_there_is_to_reach() {
    let exams = [exam_of_frames(1, 20_000), exam_of_bytes(1, 20_000), exam_of_payloads(1, 20_000)];
    let wanted: Vec<_> = exams.iter().flat_map(|exam| &exam.wanted).flat_map(|(_, text)| text.split(';')).collect();
    for reason in Reject::ALL.into_iter().filter(|reason| !matches!(reason, Reject::StaleTime | Reject::FutureTime)) {
        let text = format!("rejected {}", reason.code());
        assert!(wanted.contains(&text.as_str()), "{reason:?} never comes");
    }
    for id in firmware_protocol::MessageId::ALL.into_iter().filter(|id| id.is_whole()) {
        let start = format!("message {} ", id.number());
        assert!(wanted.iter().filter(|text| text.starts_with(&start)).count() > 100, "{id:?} hardly comes");
    }
}

/// Negative control: one wrong bit in what is wanted, one wrong line in the C sources.
#[test]
fn differences_are_noticed() {
    let program = Program::of_c_sources("control");
    let mut exam = exam_of_vectors();
    assert!(exam.failures(&program).is_empty());
    let at = exam.wanted.iter().position(|(_, wanted)| wanted.starts_with("300:")).unwrap();
    exam.wanted[at].1.replace_range(4..5, "f");
    assert_eq!(exam.failures(&program).len(), 1);

    let source = crate::text("c/starloop_protocol.c");
    for (right, wrong) in [
        ("to[6] = burst->seq;", "to[5] = burst->seq;"),
        ("< REPLAY_WINDOW", "< REPLAY_WINDOW + 1"),
        ("RATE_BITS 21", "RATE_BITS 20"),
        ("seconds < *scet_s", "seconds > *scet_s"),
    ] {
        assert_eq!(source.matches(right).count(), 1, "{right}");
        let folder = folder("wrong");
        let path = folder.join("starloop_protocol.c");
        std::fs::write(&path, source.replace(right, wrong)).unwrap();
        compile(&[&crate::c_program::driver_source(), &path], &folder.join("driver"), &[]);
        assert!(!failures(&Program::at(folder.join("driver")), 2, 5_000).is_empty(), "{wrong} went unnoticed");
    }
}

#[test]
fn the_sources_and_the_example_compile_optimised() {
    let (kit, objects) = (crate::kit().join("c"), folder("objects"));
    compile(&[&kit.join("starloop_protocol.c")], &objects.join("library.o"), &["-c", "-O2", "-Wconversion"]);
    compile(&[&kit.join("example.c")], &objects.join("example.o"), &["-c", "-O2", "-Wconversion"]);
}
