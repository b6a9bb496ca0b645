//! The exact bytes that protocol version 1.3 added; `frozen_v1.rs` has those of 1.0 to 1.2. If this fails, the code is
//! wrong, not the test.
//!
//! The bytes were assembled from the layout tables by hand, not by the encoder under test.

#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use firmware_protocol::can::{self, CanFrame, CanId, Decoder, Format, IdMap};
use firmware_protocol::message::{Command, PointingAngle, Refusal, Reply, Request, Response, StatusPage, frame_flag};
use firmware_protocol::{Message, version::Version};

const COMMAND_ID: u16 = 0x603;
const RESPONSE_ID: u16 = 0x583;
const STATUS_ID: u16 = 0x193;

fn ids() -> IdMap {
    IdMap::new(0, 3).unwrap()
}

/// Asserts that the message is sent as this frame, and read from it.
fn frozen(message: Message, id: u16, bytes: [u8; 8]) {
    for format in [Format::Classic, Format::Fd] {
        let frames = can::encode(&message, format, &ids()).unwrap();
        let sent: Vec<_> = frames.iter().map(|frame| (frame.id(), frame.data())).collect();
        assert_eq!(sent, [(CanId::standard(id).unwrap(), &bytes[..])], "{message:?}");
    }
    let frame = CanFrame::classic(id, &bytes).unwrap();
    assert_eq!(Decoder::new(ids()).read(&frame), Ok(Some(message)));
}

fn refused(reason: Refusal) -> Message {
    Message::Response(Response { token: 12, reply: Reply::Refused { opcode: 6, reason } })
}

#[test]
fn hello_of_1_3_has_its_minor() {
    let request = Request::Hello(Version { major: 1, minor: 3 });
    frozen(Message::Command(Command { token: 5, request }), COMMAND_ID, [1, 5, 1, 3, 0, 0, 0, 0]);
}

#[test]
fn trigger_that_nothing_waits_for_is_refused_with_code_11() {
    frozen(refused(Refusal::UnknownTrigger), RESPONSE_ID, [6, 12, 11, 0, 0, 0, 0, 0]);
}

#[test]
fn pointing_pages_carry_flags_of_their_frame() {
    let both = frame_flag::JITTER_MISSING | frame_flag::PARTLY_EXTRAPOLATED;
    for (angle, flags, bytes) in [
        (PointingAngle::RightAscension, frame_flag::JITTER_MISSING, [4, 200, 1, 0, 0, 0, 0, 0x40]),
        (PointingAngle::Declination, frame_flag::PARTLY_EXTRAPOLATED, [5, 200, 2, 0, 0, 0, 0, 0x40]),
        (PointingAngle::Roll, both, [6, 200, 3, 0, 0, 0, 0, 0x40]),
        // Bits of a later version are read as they are.
        (PointingAngle::Roll, 0x8001, [6, 200, 1, 0x80, 0, 0, 0, 0x40]),
    ] {
        let page = StatusPage::Pointing { angle, frame: 200, flags, turns_2_32: 0x4000_0000 };
        frozen(Message::Status(page), STATUS_ID, bytes);
    }
}

/// Negative control: the comparison notices another code.
#[test]
#[should_panic(expected = "UnknownTrigger")]
fn a_wrong_code_is_noticed() {
    frozen(refused(Refusal::UnknownTrigger), RESPONSE_ID, [6, 12, 10, 0, 0, 0, 0, 0]);
}
