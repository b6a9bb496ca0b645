//! CAN frames: what is accepted is sent again as the same bytes; groups are judged as a model says; damage is refused.

#![no_main]

use firmware_protocol::can::{CanFrame, CanId, Decoder, Format, IdMap, encode};
use firmware_protocol::message::AttitudeRecord;
use firmware_protocol::{Message, MessageId, Reject, RejectCounters};
use libfuzzer_sys::fuzz_target;
use starloop_fuzz::damage::{self, crc16};
use starloop_fuzz::{Input, control, samples};

/// Of the attitude record: where flags, CRC and values begin.
const FLAGS: usize = 5;
const CRC: usize = 6;
const VALUES: usize = 8;

fuzz_target!(|bytes: &[u8]| {
    let mut input = Input::new(bytes);
    let kind = input.u8();
    let form = input.u8();
    let (base, node) = (u16::from(form & 0xF) << 4, kind >> 4);
    // The upper half of the bases has 29 bits.
    let extended = |base: u16| IdMap::extended(0x18FF_0000 + u32::from(base), node);
    let ids = if form & 0x80 == 0 { IdMap::new(base, node) } else { extended(base) }.expect("legal base and node");
    match kind % 4 {
        0 => damage_a_record(ids, &mut input),
        1 => damage_a_group(ids, &mut input),
        _ => read_stream(ids, &mut input),
    }
});

// --- any frames ------------------------------------------------------------------------------------------------------

/// The parts of the classic group, as this file understands them: w x, y z, rate, acceleration.
type Parts = [Option<[u8; 8]>; 4];

fn read_stream(ids: IdMap, input: &mut Input<'_>) {
    let (mut decoder, mut parts) = (Decoder::new(ids), Parts::default());
    let (mut rejects, mut waiting, mut accepted, mut frames) = (RejectCounters::default(), 0, 0, 0);
    while !input.is_empty() {
        let Some(frame) = frame(ids, &parts, input) else { continue };
        frames += 1;
        let outcome = decoder.read(&frame);
        match &outcome {
            Ok(None) => waiting += 1,
            Ok(Some(_)) => accepted += 1,
            Err(reason) => rejects.count(*reason),
        }
        judge(ids, &frame, &mut parts, outcome);
    }
    assert_eq!(waiting + accepted + rejects.total(), frames, "every frame is counted once");
    assert_eq!(rejects.total(), rejects.iter().map(|(_, count)| count).sum::<u32>());
}

/// Returns a frame of a known message or of any identifier. Some are sealed, that is made legal where chance never
/// would.
fn frame(ids: IdMap, parts: &Parts, input: &mut Input<'_>) -> Option<CanFrame> {
    let (choice, form) = (input.u8(), input.u8());
    let message = MessageId::ALL.get(usize::from(choice >> 3)).copied();
    let id = message.map_or_else(|| any_id(ids, choice & 7, input.u8()), |message| ids.id(message));
    let length = message.filter(|_| form & 1 == 0).map_or(usize::from(form >> 2), MessageId::len_bytes);
    let mut data = [0; 64];
    let taken = input.take(length);
    data[..taken.len()].copy_from_slice(taken);
    let data = &mut data[..length];
    match message {
        Some(MessageId::AttitudeCommit) if form & 2 == 0 && length == 8 => {
            let crc = crc16(parts.iter().flatten().flatten().chain(&data[..CRC]));
            data[CRC..].copy_from_slice(&crc.to_le_bytes());
        }
        Some(MessageId::AttitudeQ01 | MessageId::AttitudeQ23) if form & 2 == 0 && length == 8 => {
            let values = [0.5_f32.copysign(f32::from(i8::from_le_bytes([data[0]]))), 0.5];
            data.copy_from_slice(values.map(f32::to_le_bytes).as_flattened());
        }
        Some(MessageId::Attitude) if form & 2 == 0 && length == 48 => {
            let q_wxyz = samples::quaternion(&mut Input::new(&data[VALUES..16]));
            data[VALUES..24].copy_from_slice(q_wxyz.map(f32::to_le_bytes).as_flattened());
            seal(data);
        }
        _ => {}
    }
    if choice & 1 == 0 {
        CanFrame::classic(id, data).or_else(|| CanFrame::fd(id, data))
    } else {
        CanFrame::fd(id, data)
    }
}

/// Returns an identifier of the length of these, or of the other length.
fn any_id(ids: IdMap, high: u8, low: u8) -> CanId {
    let of_ours = ids.id(MessageId::Sync);
    let number = u16::from(high) << 8 | u16::from(low);
    let is_extended = of_ours.is_extended() != (low & 0xF0 == 0xF0);
    let id = if is_extended { CanId::extended(0x18FF_0000 + u32::from(number)) } else { CanId::standard(number) };
    id.expect("at most 11 bits of number")
}

fn seal(record: &mut [u8]) {
    let crc = crc16(record[..CRC].iter().chain(&record[VALUES..]));
    record[CRC..VALUES].copy_from_slice(&crc.to_le_bytes());
}

/// Holds one outcome against the wire's rules.
fn judge(ids: IdMap, frame: &CanFrame, parts: &mut Parts, outcome: Result<Option<Message>, Reject>) {
    let (id, data) = (frame.id(), frame.data());
    let Some(kind) = MessageId::ALL.into_iter().find(|kind| ids.id(*kind) == id) else {
        assert_eq!(outcome, Err(Reject::UnknownId));
        return;
    };
    let place =
        [MessageId::AttitudeQ01, MessageId::AttitudeQ23, MessageId::AttitudeRate, MessageId::AttitudeAcceleration];
    if let Some(place) = place.iter().position(|part| *part == kind) {
        judge_part(place, data, parts, outcome);
    } else if kind == MessageId::AttitudeCommit {
        judge_commit(ids, data, core::mem::take(parts), outcome);
    } else if data.len() != kind.len_bytes() {
        assert_eq!(outcome, Err(Reject::WrongLength));
    } else if let Ok(message) = outcome {
        judge_message(&message.expect("a whole message"), kind, data);
    }
}

fn judge_part(place: usize, data: &[u8], parts: &mut Parts, outcome: Result<Option<Message>, Reject>) {
    let Ok(bytes) = <[u8; 8]>::try_from(data) else {
        assert_eq!(outcome, Err(Reject::WrongLength));
        return;
    };
    let wanted = if parts[place].is_some() { Err(Reject::TornGroup) } else { Ok(None) };
    if wanted.is_err() {
        *parts = Parts::default();
    }
    parts[place] = Some(bytes);
    assert_eq!(outcome, wanted, "part {place}");
}

fn judge_commit(ids: IdMap, data: &[u8], parts: Parts, outcome: Result<Option<Message>, Reject>) {
    if data.len() != 8 {
        assert_eq!(outcome, Err(Reject::WrongLength));
        return;
    }
    let holds = parts.map(|part| part.is_some());
    let is_complete = holds == [true, true, data[FLAGS] & 1 != 0, data[FLAGS] & 2 != 0];
    let crc = crc16(parts.iter().flatten().flatten().chain(&data[..CRC]));
    let is_whole = is_complete && data[CRC..] == crc.to_le_bytes();
    assert_eq!(outcome == Err(Reject::TornGroup), !is_whole, "{outcome:?} for {parts:02X?} and {data:02X?}");
    let Ok(Some(message)) = outcome else { return };
    let mut sent: Vec<[u8; 8]> = parts.into_iter().flatten().collect();
    // Bit 63 of rate and acceleration is reserved, as are bits 2 to 7 of the flags.
    sent[2..].iter_mut().for_each(|part| part[7] &= 0x7F);
    let head = [&data[..FLAGS], &[data[FLAGS] & 3]].concat();
    let crc = crc16(sent.as_flattened().iter().chain(&head)).to_le_bytes();
    sent.push([head.as_slice(), &crc].concat().try_into().expect("8 bytes"));
    let frames = encode(&message, Format::Classic, &ids).expect("what is accepted can be sent again");
    assert!(frames.iter().map(CanFrame::data).eq(sent.iter().map(<[u8; 8]>::as_slice)));
}

/// Asserts that a message in one piece is legal, and sent as the same bytes, reserved ones zero.
fn judge_message(message: &Message, kind: MessageId, data: &[u8]) {
    let wanted = with_reserved_zero(kind, data);
    let payload = message.payload().expect("what is accepted can be sent again");
    assert_eq!(payload.as_slice(), wanted, "{message:?}");
    assert_eq!(Message::from_payload(kind, &wanted), Ok(*message), "reserved bytes mean nothing");
    if let Message::Attitude(record) = message {
        let norm = record.q_wxyz.iter().map(|part| f64::from(*part).powi(2)).sum::<f64>().sqrt();
        assert!((norm - 1.0).abs() <= 1.000_001e-3, "norm {norm}");
    }
}

/// Returns the bytes as a sender of this version writes them. Broken: the reserved byte of table cells is forgotten.
fn with_reserved_zero(kind: MessageId, data: &[u8]) -> Vec<u8> {
    let mut bytes = data.to_vec();
    match (kind, data[0]) {
        (MessageId::Table, _) if !control::is_broken() => bytes[3] = 0,
        (MessageId::Status, 1 | 2) => bytes[1] = 0,
        (MessageId::Status, 3) => bytes[2..4].fill(0),
        (MessageId::Jitter, _) => bytes[8 + 4 * usize::from(data[7])..].fill(0),
        (MessageId::Command, 1) => bytes[4..].fill(0),
        (MessageId::Command, 2) => bytes[3..].fill(0),
        (MessageId::Command, 5..=7) => {}
        (MessageId::Command, 8) => bytes[3] = 0,
        (MessageId::Command, _) => bytes[2..].fill(0),
        (MessageId::CameraStatus, 2) => bytes[3] = 0,
        (MessageId::Response, opcode) => match (data[2], opcode) {
            (0, 1 | 2) => {}
            (0, 5 | 7) => bytes[5..].fill(0),
            (0, 6) => {
                bytes[5] &= 1;
                bytes[6..].fill(0);
            }
            (0, 8) => {
                bytes[4] &= 1;
                bytes[5..].fill(0);
            }
            _ => bytes[3..].fill(0),
        },
        (MessageId::Attitude, _) => {
            bytes[FLAGS] &= 3;
            for (bit, values) in [(1, 24..36), (2, 36..48)] {
                if data[FLAGS] & bit == 0 {
                    bytes[values].fill(0);
                }
            }
            seal(&mut bytes);
        }
        _ => {}
    }
    bytes
}

// --- damage ----------------------------------------------------------------------------------------------------------

/// Puts the CRC behind everything else, high byte first: the order in which it detects bursts.
fn damaged(head: &[u8], crc: [u8; 2], input: &mut Input<'_>) -> (Vec<u8>, bool) {
    let mut codeword = [head, &[crc[1], crc[0]]].concat();
    let is_damaged = damage::flip(&mut codeword, input);
    (codeword, is_damaged)
}

fn damage_a_record(ids: IdMap, input: &mut Input<'_>) {
    let record = samples::attitude(input);
    let frames = encode(&Message::Attitude(record), Format::Fd, &ids).expect("a legal record");
    let frame = frames.iter().next().expect("one frame");
    let data = frame.data();
    let (codeword, is_damaged) = damaged(&[&data[..CRC], &data[VALUES..]].concat(), [data[CRC], data[CRC + 1]], input);
    let (values, crc) = codeword[CRC..].split_at(data.len() - VALUES);
    let data = [&codeword[..CRC], &[crc[1], crc[0]], values].concat();
    let frame = CanFrame::fd(frame.id(), &data).expect("48 bytes");
    assert_only_undamaged(&record, is_damaged, Decoder::new(ids).read(&frame));
}

fn damage_a_group(ids: IdMap, input: &mut Input<'_>) {
    let record = samples::attitude(input);
    let frames = encode(&Message::Attitude(record), Format::Classic, &ids).expect("rates on the grid");
    let bytes: Vec<u8> = frames.iter().flat_map(|frame| frame.data()).copied().collect();
    let (head, crc) = bytes.split_at(bytes.len() - 2);
    let (mut codeword, is_damaged) = damaged(head, [crc[0], crc[1]], input);
    let end = codeword.len();
    codeword[end - 2..].reverse();
    let mut decoder = Decoder::new(ids);
    let send = |(frame, data): (&CanFrame, &[u8])| decoder.read(&CanFrame::classic(frame.id(), data).expect("8 bytes"));
    let outcomes: Vec<_> = frames.iter().zip(codeword.chunks(8)).map(send).collect();
    let (last, parts) = outcomes.split_last().expect("three frames at least");
    assert!(parts.iter().all(|outcome| *outcome == Ok(None)), "{parts:?}");
    assert_only_undamaged(&record, is_damaged, *last);
}

fn assert_only_undamaged(record: &AttitudeRecord, is_damaged: bool, outcome: Result<Option<Message>, Reject>) {
    if is_damaged {
        assert!(outcome.is_err(), "damage was accepted: {outcome:?} for {record:?}");
    } else {
        assert_eq!(outcome, Ok(Some(Message::Attitude(*record))), "undamaged");
    }
}
