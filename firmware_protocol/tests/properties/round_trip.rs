//! Every message is read back as it was sent.

use crate::samples::{attitude, classic_message, message};
use firmware_protocol::can::{self, Format, IdMap};
use firmware_protocol::message::{AttitudeRecord, Wheels};
use firmware_protocol::{EncodeError, Message, Reject, serial};
use proptest::prelude::*;

/// Half of 1 urad/s, and the rounding of the decoded value to f32 (2^-24 below 1).
const CLASSIC_RATE_RAD_S: f32 = 0.5e-6 + 6e-8;

/// Returns the message as it is read, the same with identifiers of 11 and of 29 bits; neither reader takes frames of the
/// other.
fn over_can(message: &Message, format: Format) -> Message {
    let [standard, extended] = [IdMap::new(0x40, 5).unwrap(), IdMap::extended(0x40, 5).unwrap()];
    let read = [(standard, extended), (extended, standard)].map(|(ids, other)| {
        let (mut decoder, mut stranger) = (can::Decoder::new(ids), can::Decoder::new(other));
        let frames = can::encode(message, format, &ids).unwrap();
        assert!(frames.iter().all(|frame| stranger.read(frame) == Err(Reject::UnknownId)));
        frames.iter().filter_map(|frame| decoder.read(frame).unwrap()).last().unwrap()
    });
    assert_eq!(read[0], read[1]);
    read[0]
}

fn over_serial(message: &Message) -> Message {
    let mut line = [0; serial::ENCODED_MAX];
    let len = serial::Encoder::new().encode(message, &mut line).unwrap();
    serial::Decoder::new().read(&mut &line[..len]).unwrap().unwrap()
}

fn as_attitude(message: Message) -> AttitudeRecord {
    let Message::Attitude(record) = message else { unreachable!("wanted an attitude, got {message:?}") };
    record
}

proptest! {
    #[test]
    fn can_fd_and_serial_are_exact(message in message()) {
        prop_assert_eq!(over_can(&message, Format::Fd), message);
        prop_assert_eq!(over_serial(&message), message);
    }

    #[test]
    fn classic_can_is_exact_but_for_rates(message in classic_message()) {
        if !matches!(message, Message::Attitude(_)) {
            prop_assert_eq!(over_can(&message, Format::Classic), message);
        }
    }

    #[test]
    fn the_classic_group_keeps_rates_to_half_a_count(sent in attitude()) {
        let got = as_attitude(over_can(&Message::Attitude(sent), Format::Classic));
        prop_assert_eq!((got.t_us, got.seq, got.flags, got.q_wxyz), (sent.t_us, sent.seq, sent.flags, sent.q_wxyz));
        let (sent, got) = ((sent.rate_rad_s, sent.acceleration_rad_s2), (got.rate_rad_s, got.acceleration_rad_s2));
        for (a, b) in sent.0.iter().chain(&sent.1).zip(got.0.iter().chain(&got.1)) {
            prop_assert!((a - b).abs() <= CLASSIC_RATE_RAD_S, "sent {a}, got {b}");
        }
    }

    #[test]
    fn a_stream_in_pieces_of_any_size_is_the_same_stream(
        messages in prop::collection::vec(classic_message().prop_filter("no sequence", |m| {
            !matches!(m, Message::Attitude(_) | Message::JitterPair(_))
        }), 1..8),
        piece in 1_usize..40,
    ) {
        let mut encoder = serial::Encoder::new();
        let mut line = Vec::new();
        for message in &messages {
            let mut packet = [0; serial::ENCODED_MAX];
            let len = encoder.encode(message, &mut packet).unwrap();
            line.extend_from_slice(&packet[..len]);
        }
        let mut decoder = serial::Decoder::new();
        let mut read = Vec::new();
        for mut bytes in line.chunks(piece) {
            while let Some(outcome) = decoder.read(&mut bytes) {
                read.push(outcome.unwrap());
            }
        }
        prop_assert_eq!(read, messages);
        prop_assert_eq!(decoder.lost_packets(), 0);
    }
}

#[test]
fn values_out_of_range_are_refused_with_the_field() {
    let ids = IdMap::default();
    let wheels = Message::Wheels(Wheels { speed_rpm: [8192.0, 0.0, 0.0, 0.0] });
    let error = can::encode(&wheels, Format::Fd, &ids).unwrap_err();
    assert!(matches!(error, EncodeError::OutOfRange { got: 8192.0, limit: 8191.75, .. }), "{error}");
    let error = serial::Encoder::new().encode(&wheels, &mut [0; serial::ENCODED_MAX - 1]).unwrap_err();
    assert!(matches!(error, EncodeError::BufferTooShort { .. }), "{error}");
}
