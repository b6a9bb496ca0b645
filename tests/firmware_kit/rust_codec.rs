//! The Rust crate against vectors.json, both directions.

use crate::vectors::{Input, Rejected, Vector, messages, rejected};
use firmware_protocol::can::{self, CanFrame, Format, IdMap};
use firmware_protocol::message::{AttitudeRecord, MessageId, Table};
use firmware_protocol::{Message, Reject, serial};

/// Half of 1 urad/s, and the rounding of the decoded value to f32 (2^-24 near 1).
pub(crate) const CLASSIC_RATE_RAD_S: f32 = 0.5e-6 + 6e-8;

fn encoded(vector: &Vector, format: Format) -> Option<Vec<CanFrame>> {
    can::encode(&vector.message, format, &vector.ids()).ok().map(|frames| frames.iter().copied().collect())
}

fn decoded(vector: &Vector, frames: &[CanFrame]) -> Option<Message> {
    let mut decoder = can::Decoder::new(vector.ids());
    frames.iter().map(|frame| decoder.read(frame).unwrap()).last().flatten()
}

fn on_the_line(vector: &Vector) -> Vec<u8> {
    let (mut encoder, mut line) = (serial::Encoder::new(), [0; serial::ENCODED_MAX]);
    for _ in 0..vector.serial_seq {
        encoder.encode(&vector.message, &mut line).unwrap();
    }
    let len = encoder.encode(&vector.message, &mut line).unwrap();
    line[..len].to_vec()
}

/// Returns whether two messages are equal, but for rates that classic CAN rounds to 1 urad/s.
pub(crate) fn agrees(sent: &Message, got: &Message) -> bool {
    let (Message::Attitude(sent), Message::Attitude(got)) = (sent, got) else {
        return sent == got;
    };
    let rates = |record: &AttitudeRecord| [record.rate_rad_s, record.acceleration_rad_s2].concat();
    let bare =
        |record: &AttitudeRecord| AttitudeRecord { rate_rad_s: [0.0; 3], acceleration_rad_s2: [0.0; 3], ..*record };
    let are_near = rates(sent).iter().zip(rates(got)).all(|(a, b)| (a - b).abs() <= CLASSIC_RATE_RAD_S);
    bare(sent) == bare(got) && are_near
}

/// Returns the rules that one vector breaks.
fn breaches(vector: &Vector) -> Vec<&'static str> {
    let mut found = Vec::new();
    let mut check = |holds: bool, what| {
        if !holds {
            found.push(what)
        }
    };
    check(encoded(vector, Format::Fd) == Some(vec![vector.fd]), "encoded for CAN FD");
    check(encoded(vector, Format::Classic) == vector.classic, "encoded for classic CAN");
    check(on_the_line(vector) == vector.serial, "encoded for serial");
    let read = |frames: &[CanFrame]| std::panic::catch_unwind(|| decoded(vector, frames)).ok().flatten();
    check(read(&[vector.fd]) == Some(vector.message), "decoded from CAN FD");
    let classic =
        vector.classic.as_deref().is_none_or(|frames| read(frames).is_some_and(|got| agrees(&vector.message, &got)));
    check(classic, "decoded from classic CAN");
    let read = serial::Decoder::new().read(&mut &vector.serial[..]);
    check(read == Some(Ok(vector.message)), "decoded from serial");
    found
}

#[test]
fn messages_agree_both_ways() {
    for vector in messages() {
        assert!(breaches(&vector).is_empty(), "{}: {:?}", vector.name, breaches(&vector));
    }
}

#[test]
fn every_message_table_column_and_reason_has_a_vector() {
    let all = messages();
    for id in MessageId::ALL.into_iter().filter(|id| id.is_whole()) {
        assert!(all.iter().any(|vector| vector.message.id() == id), "{id:?}");
    }
    for table in Table::ALL {
        let columns = all.iter().filter(|vector| matches!(vector.message, Message::Table(cell) if cell.table == table));
        assert_eq!(columns.count(), usize::from(table.columns()), "{table:?}");
    }
    let reasons: Vec<_> = rejected().iter().map(|input| input.reason).collect();
    for reason in Reject::ALL {
        // These two are found by the stimulator's history, not by a decoder.
        let is_of_the_history = matches!(reason, Reject::StaleTime | Reject::FutureTime);
        assert_eq!(reasons.contains(&reason), !is_of_the_history, "{reason:?}");
    }
}

/// Returns the outcome of each piece.
fn outcomes(input: &Input) -> Vec<Result<(), Reject>> {
    match input {
        Input::Frames(frames) => {
            let mut decoder = can::Decoder::new(IdMap::default());
            frames.iter().map(|frame| decoder.read(frame).map(|_| ())).collect()
        }
        Input::Serial(line) => {
            let (mut decoder, mut rest) = (serial::Decoder::new(), &line[..]);
            std::iter::from_fn(|| decoder.read(&mut rest).map(|outcome| outcome.map(|_| ()))).collect()
        }
    }
}

fn is_refused_at_last(input: &Rejected) -> bool {
    let outcomes = outcomes(&input.input);
    let (last, before) = outcomes.split_last().unwrap();
    *last == Err(input.reason) && before.iter().all(Result::is_ok)
}

#[test]
fn rejected_input_is_refused_for_its_reason() {
    for input in rejected() {
        assert!(
            is_refused_at_last(&input),
            "{}: wanted {:?}, got {:?}",
            input.name,
            input.reason,
            outcomes(&input.input)
        );
    }
}

/// Negative control: each byte of each vector counts.
#[test]
fn a_flipped_byte_in_a_vector_is_noticed() {
    for good in messages() {
        for at in 0..good.fd.data().len() {
            let mut data = good.fd.data().to_vec();
            data[at] ^= 0x10;
            let fd = CanFrame::classic(good.fd.id(), &data).or_else(|| CanFrame::fd(good.fd.id(), &data)).unwrap();
            assert!(
                breaches(&Vector { fd, ..good.clone() }).contains(&"encoded for CAN FD"),
                "{}: byte {at}",
                good.name
            );
        }
        let mut serial = good.serial.clone();
        serial[1] ^= 0x10;
        assert!(breaches(&Vector { serial, ..good.clone() }).contains(&"decoded from serial"), "{}", good.name);
    }
    let mut input = rejected().remove(0);
    input.reason = Reject::Oversize;
    assert!(!is_refused_at_last(&input));
}
