//! No input panics, and whatever comes out is legal.

use crate::samples::message;
use firmware_protocol::can::{self, CanFrame, CanId, IdMap};
use firmware_protocol::{Message, MessageId, RejectCounters, serial};
use proptest::prelude::*;

/// Returns frames that mostly have identifiers of these messages, and sometimes any of either length.
fn frame(ids: IdMap) -> impl Strategy<Value = CanFrame> {
    let known = prop::sample::select(&MessageId::ALL[..]).prop_map(move |id| ids.id(id));
    let standard = (0_u16..0x800).prop_map(|number| CanId::standard(number).unwrap());
    let extended = (0_u32..0x2000_0000).prop_map(|number| CanId::extended(number).unwrap());
    let id = prop_oneof![8 => known, 1 => standard, 1 => extended];
    let classic = prop::collection::vec(any::<u8>(), 0..=8);
    let fd = prop::sample::select(vec![12_usize, 48, 64]).prop_flat_map(|len| prop::collection::vec(any::<u8>(), len));
    (id, prop_oneof![classic, fd])
        .prop_map(|(id, data)| CanFrame::classic(id, &data).or_else(|| CanFrame::fd(id, &data)).unwrap())
}

/// Asserts that a decoder's output can be sent again: every value is finite and in range.
fn assert_legal(message: &Message) {
    assert!(message.payload().is_ok(), "{message:?}");
    if let Message::Attitude(record) = message {
        let norm = record.q_wxyz.iter().map(|value| f64::from(*value).powi(2)).sum::<f64>().sqrt();
        assert!((norm - 1.0).abs() <= 1.000_001e-3, "norm {norm}");
        assert!(record.rate_rad_s.iter().chain(&record.acceleration_rad_s2).all(|value| value.is_finite()));
    }
}

fn extended() -> IdMap {
    IdMap::extended(0x18FF_0000, 0).unwrap()
}

/// Reads the frames; returns how many were refused.
fn rejected(ids: IdMap, frames: &[CanFrame]) -> usize {
    let mut decoder = can::Decoder::new(ids);
    let mut rejects = RejectCounters::default();
    for frame in frames {
        match decoder.read(frame) {
            Ok(message) => message.iter().for_each(assert_legal),
            Err(reject) => rejects.count(reject),
        }
    }
    rejects.total() as usize
}

proptest! {
    #[test]
    fn frames(frames in prop::collection::vec(frame(IdMap::default()), 0..64)) {
        prop_assert!(rejected(IdMap::default(), &frames) <= frames.len());
    }

    #[test]
    fn extended_frames(frames in prop::collection::vec(frame(extended()), 0..64)) {
        prop_assert!(rejected(extended(), &frames) <= frames.len());
    }

    #[test]
    fn streams(noise in prop::collection::vec(prop_oneof![9 => any::<u8>(), 1 => Just(0)], 0..600), sent in message()) {
        let mut decoder = serial::Decoder::new();
        let mut bytes = &noise[..];
        while let Some(outcome) = decoder.read(&mut bytes) {
            outcome.iter().for_each(assert_legal);
        }
        // Whatever came before, a delimiter brings the decoder back in step.
        let _ = decoder.read_byte(0);
        let mut line = [0; serial::ENCODED_MAX];
        let len = serial::Encoder::new().encode(&sent, &mut line).unwrap();
        prop_assert_eq!(decoder.read(&mut &line[..len]), Some(Ok(sent)));
    }
}
