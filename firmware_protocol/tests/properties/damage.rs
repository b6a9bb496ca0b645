//! Damage on the line is refused, each with its reason, and does not spread to the next packet.

use crate::samples::message;
use firmware_protocol::can::{self, CanFrame, Format, IdMap};
use firmware_protocol::message::{AttitudeFlags, AttitudeRecord, Sync};
use firmware_protocol::{Message, Reject, serial};
use proptest::prelude::*;

fn attitude() -> AttitudeRecord {
    AttitudeRecord {
        t_us: 123_456,
        seq: 17,
        flags: AttitudeFlags::ALL,
        q_wxyz: [0.5, -0.5, 0.5, -0.5],
        rate_rad_s: [0.01, -0.02, 0.03],
        acceleration_rad_s2: [0.001, 0.002, -0.003],
    }
}

fn packet(message: &Message) -> Vec<u8> {
    let mut line = [0; serial::ENCODED_MAX];
    let len = serial::Encoder::new().encode(message, &mut line).unwrap();
    line[..len].to_vec()
}

/// Positions of the distances and of the delimiter.
fn stuffing(line: &[u8]) -> Vec<usize> {
    let next = |at: &usize| (line[*at] != 0).then(|| at + usize::from(line[*at]));
    core::iter::successors(Some(0), next).collect()
}

fn outcomes(line: &[u8]) -> Vec<Result<Message, Reject>> {
    let mut decoder = serial::Decoder::new();
    let mut bytes = line;
    core::iter::from_fn(|| decoder.read(&mut bytes)).collect()
}

fn after_flip(message: &Message, bit: usize) -> Vec<Result<Message, Reject>> {
    let mut line = packet(message);
    line[bit / 8] ^= 1 << (bit % 8);
    line.push(0);
    outcomes(&line)
}

/// Every single-bit error on the line, stuffing bytes and delimiter included. A flipped delimiter joins the packet to
/// what follows: here only the closing zero, so that the packet is too long by one byte.
#[test]
fn every_single_bit_error_of_a_packet_is_refused() {
    for message in [Message::Attitude(attitude()), Message::Sync(Sync { counter: 0 })] {
        for bit in 0..packet(&message).len() * 8 {
            let outcomes = after_flip(&message, bit);
            assert!(!outcomes.is_empty(), "bit {bit}: lost without a trace");
            assert!(outcomes.iter().all(Result::is_err), "bit {bit} of {message:?} passed: {outcomes:?}");
        }
        assert_eq!(outcomes(&packet(&message)), [Ok(message)], "negative control: undamaged");
    }
}

proptest! {
    /// Guaranteed by the CRC where the error leaves the stuffing as it is; errors in the stuffing itself pass with
    /// probability 2^-16, so they are tried above on fixed packets, not here on random ones.
    #[test]
    fn a_single_bit_error_never_gives_a_message(message in message(), bit in 0_usize..8 * serial::ENCODED_MAX) {
        let line = packet(&message);
        let bit = bit % (line.len() * 8);
        let (at, flipped) = (bit / 8, line[bit / 8] ^ 1 << (bit % 8));
        prop_assume!(flipped != 0 && !stuffing(&line).contains(&at));
        let outcomes = after_flip(&message, bit);
        prop_assert!(!outcomes.is_empty() && outcomes.iter().all(Result::is_err), "{:?}", outcomes);
    }

    #[test]
    fn a_lost_byte_costs_one_packet_only(message in message(), at in any::<prop::sample::Index>()) {
        let mut line = packet(&message);
        line.remove(at.index(line.len() - 1));
        line.extend(packet(&message));
        let outcomes = outcomes(&line);
        prop_assert_eq!(outcomes.last(), Some(&Ok(message)));
        prop_assert!(outcomes[..outcomes.len() - 1].iter().all(Result::is_err));
    }
}

#[test]
fn each_kind_of_damage_has_its_own_reason() {
    let good = packet(&Message::Sync(Sync { counter: 1 }));
    let reason = |line: &[u8]| outcomes(line)[0].unwrap_err();
    let with = |at: usize, value: u8| {
        let mut line = good.clone();
        line[at] = value;
        line
    };
    assert_eq!(reason(&with(6, 0x55)), Reject::BadCrc);
    assert_eq!(reason(&with(0, 0x20)), Reject::BadFraming);
    assert_eq!(reason(&[2, 1, 0]), Reject::WrongLength);
    assert_eq!(reason(&[vec![1; 90], vec![0]].concat()), Reject::Oversize);
}

#[test]
fn damage_inside_an_fd_attitude_is_a_bad_crc() {
    let ids = IdMap::default();
    let frames = can::encode(&Message::Attitude(attitude()), Format::Fd, &ids).unwrap();
    let frame = *frames.iter().next().unwrap();
    for bit in 0..8 * frame.data().len() {
        let mut data = frame.data().to_vec();
        data[bit / 8] ^= 1 << (bit % 8);
        let damaged = CanFrame::fd(frame.id(), &data).unwrap();
        assert_eq!(can::Decoder::new(ids).read(&damaged), Err(Reject::BadCrc), "bit {bit}");
    }
}

#[test]
fn illegal_values_with_a_right_crc_are_refused() {
    let reason = |record: AttitudeRecord, format| {
        let ids = IdMap::default();
        let mut decoder = can::Decoder::new(ids);
        let frames = can::encode(&Message::Attitude(record), format, &ids).unwrap();
        frames.iter().map(|frame| decoder.read(frame)).last().unwrap()
    };
    for format in [Format::Classic, Format::Fd] {
        let with_w = |w| AttitudeRecord { q_wxyz: [w, 0.0, 0.0, 0.0], ..attitude() };
        assert_eq!(reason(with_w(f32::NAN), format), Err(Reject::NotFinite), "{format:?}");
        assert_eq!(reason(with_w(f32::INFINITY), format), Err(Reject::NotFinite), "{format:?}");
        assert_eq!(reason(with_w(1.002), format), Err(Reject::QuaternionNorm), "{format:?}");
        assert_eq!(reason(with_w(0.0), format), Err(Reject::QuaternionNorm), "{format:?}");
        assert!(matches!(reason(with_w(1.0), format), Ok(Some(_))), "negative control: {format:?}");
    }
    let endless = AttitudeRecord { rate_rad_s: [f32::INFINITY, 0.0, 0.0], ..attitude() };
    assert_eq!(reason(endless, Format::Fd), Err(Reject::NotFinite));
}

#[test]
fn frames_of_the_wrong_length_or_node_are_refused() {
    let mut decoder = can::Decoder::new(IdMap::new(0, 1).unwrap());
    let mut reason = |id, data: &[u8]| decoder.read(&CanFrame::classic(id, data).unwrap()).unwrap_err();
    assert_eq!(reason(0x080, &[1, 2]), Reject::WrongLength);
    assert_eq!(reason(0x211, &[0; 7]), Reject::WrongLength);
    assert_eq!(reason(0x251, &[0; 7]), Reject::WrongLength);
    assert_eq!(reason(0x202, &[0; 8]), Reject::UnknownId);
    assert_eq!(reason(0x7FF, &[]), Reject::UnknownId);
    assert_eq!(reason(0x191, &[7, 0, 0, 0, 0, 0, 0, 0]), Reject::UnknownValue);
}
