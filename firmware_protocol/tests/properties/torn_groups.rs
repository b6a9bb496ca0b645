//! The classic attitude group: only complete groups of one epoch come out.

use firmware_protocol::can::{self, CanFrame, Format, IdMap};
use firmware_protocol::message::{AttitudeFlags, AttitudeRecord};
use firmware_protocol::{Message, Reject};
use proptest::prelude::*;

fn record(seq: u8) -> AttitudeRecord {
    let angle = f32::from(seq) * 0.01;
    AttitudeRecord {
        t_us: u32::from(seq) * 10_000,
        seq,
        flags: AttitudeFlags::ALL,
        q_wxyz: [angle.cos(), 0.6 * angle.sin(), 0.8 * angle.sin(), 0.0],
        rate_rad_s: [angle, 0.0, 0.0],
        acceleration_rad_s2: [0.0, angle, 0.0],
    }
}

fn frames(seq: u8) -> Vec<CanFrame> {
    can::encode(&Message::Attitude(record(seq)), Format::Classic, &IdMap::default()).unwrap().iter().copied().collect()
}

fn read_all(frames: &[CanFrame]) -> Vec<Result<Option<Message>, Reject>> {
    let mut decoder = can::Decoder::new(IdMap::default());
    frames.iter().map(|frame| decoder.read(frame)).collect()
}

fn sequences(outcomes: &[Result<Option<Message>, Reject>]) -> Vec<u8> {
    let messages = outcomes.iter().filter_map(|outcome| outcome.ok().flatten());
    messages
        .filter_map(|message| if let Message::Attitude(record) = message { Some(record.seq) } else { None })
        .collect()
}

#[test]
fn whole_groups_come_out() {
    let outcomes = read_all(&[frames(1), frames(2)].concat());
    assert_eq!(sequences(&outcomes), [1, 2], "negative control for the tests below");
    assert!(outcomes.iter().all(Result::is_ok), "{outcomes:?}");
}

#[test]
fn a_lost_frame_costs_its_group_only() {
    for lost in 0..5 {
        let mut stream = [frames(1), frames(2), frames(3)].concat();
        stream.remove(5 + lost);
        let outcomes = read_all(&stream);
        assert_eq!(sequences(&outcomes), [1, 3], "frame {lost} lost");
        let torn = outcomes.iter().filter(|outcome| **outcome == Err(Reject::TornGroup)).count();
        assert_eq!(torn, 1, "frame {lost} lost: counted once");
    }
}

#[test]
fn interleaved_epochs_are_refused() {
    let (a, b) = (frames(1), frames(2));
    let mixed: Vec<_> = a.iter().zip(&b).flat_map(|(a, b)| [*a, *b]).collect();
    let outcomes = read_all(&[mixed, frames(3)].concat());
    assert_eq!(sequences(&outcomes), [3], "{outcomes:?}");
}

#[test]
fn a_part_swapped_in_from_another_epoch_is_refused() {
    for part in 0..4 {
        let mut stream = frames(1);
        stream[part] = frames(2)[part];
        let outcomes = read_all(&stream);
        assert_eq!(outcomes.last(), Some(&Err(Reject::TornGroup)), "part {part}");
    }
}

#[test]
fn a_replayed_group_is_refused() {
    let outcomes = read_all(&[frames(1), frames(1)].concat());
    assert_eq!(outcomes.last(), Some(&Err(Reject::ReplayedSequence)));
}

proptest! {
    /// Any loss, repetition and reordering of the frames of several epochs: what comes out is what went in.
    #[test]
    fn every_output_is_of_one_epoch(picks in prop::collection::vec((1_u8..6, 0_usize..5), 0..60)) {
        let stream: Vec<_> = picks.iter().map(|(seq, part)| frames(*seq)[*part]).collect();
        for message in read_all(&stream).into_iter().filter_map(|outcome| outcome.ok().flatten()) {
            let Message::Attitude(got) = message else { unreachable!("only attitude was sent") };
            prop_assert_eq!(got.q_wxyz, record(got.seq).q_wxyz);
            prop_assert_eq!(got.t_us, record(got.seq).t_us);
        }
    }
}
