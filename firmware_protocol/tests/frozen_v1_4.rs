//! The exact bytes that protocol version 1.4 added; `frozen_v1.rs` and `frozen_v1_3.rs` have those before. If this
//! fails, the code is wrong, not the test.
//!
//! The bytes were assembled from the layout tables by hand, not by the encoder under test.

#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use firmware_protocol::can::{self, CanFrame, CanId, Decoder, Format, IdMap};
use firmware_protocol::message::{
    CameraKind, CameraPage, CameraSet, CameraSetting, CameraStatus, CameraTrigger, CameraTriggered, Command, Refusal,
    Reply, Request, Response, StartedBy, capability,
};
use firmware_protocol::version::{self, Version};
use firmware_protocol::{EncodeError, Message, Reject};

const COMMAND_ID: u16 = 0x603;
const RESPONSE_ID: u16 = 0x583;
const CAMERA_STATUS_ID: u16 = 0x1A3;

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

fn command(request: Request) -> Message {
    Message::Command(Command { token: 12, request })
}

fn response(reply: Reply) -> Message {
    Message::Response(Response { token: 12, reply })
}

fn refused(opcode: u8, reason: Refusal) -> Message {
    response(Reply::Refused { opcode, reason })
}

#[test]
fn version_is_1_4() {
    assert_eq!((version::MAJOR, version::MINOR), (1, 4));
    assert_eq!(capability::CAMERA, 0x10);
}

#[test]
fn hello_of_1_4_has_its_minor() {
    frozen(command(Request::Hello(version::CURRENT)), COMMAND_ID, [1, 12, 1, 4, 0, 0, 0, 0]);
    assert_eq!(version::CURRENT, Version { major: 1, minor: 4 });
}

#[test]
fn camera_carries_kind_head_and_value() {
    for (number, kind) in (1..).zip(CameraKind::ALL) {
        assert_eq!((kind.number(), CameraKind::from_number(number)), (number, Some(kind)));
        let setting = CameraSetting { kind: number, head: 5, value: 0x0403_0201 };
        frozen(command(Request::Camera(setting)), COMMAND_ID, [7, 12, number, 5, 1, 2, 3, 4]);
    }
    assert_eq!((CameraKind::from_number(0), CameraKind::from_number(13)), (None, None));
    // A kind of a later version is read as it is.
    let later = CameraSetting { kind: 200, head: 255, value: 1 };
    frozen(command(Request::Camera(later)), COMMAND_ID, [7, 12, 200, 255, 1, 0, 0, 0]);
    let set = Reply::CameraSet(CameraSet { kind: 2, head: 255 });
    frozen(response(set), RESPONSE_ID, [7, 12, 0, 2, 255, 0, 0, 0]);
}

#[test]
fn camera_trigger_carries_head_and_instant() {
    let trigger = |head, at_us| command(Request::CameraTrigger(CameraTrigger { head, at_us }));
    frozen(trigger(1, 0x0403_0201), COMMAND_ID, [8, 12, 1, 0, 1, 2, 3, 4]);
    frozen(trigger(255, 0), COMMAND_ID, [8, 12, 255, 0, 0, 0, 0, 0]);
    let triggered = |head, is_late| response(Reply::CameraTriggered(CameraTriggered { head, is_late }));
    frozen(triggered(1, false), RESPONSE_ID, [8, 12, 0, 1, 0, 0, 0, 0]);
    frozen(triggered(255, true), RESPONSE_ID, [8, 12, 0, 255, 1, 0, 0, 0]);
}

#[test]
fn refusals_of_cameras_have_codes_12_to_15() {
    frozen(refused(7, Refusal::CameraRange), RESPONSE_ID, [7, 12, 12, 0, 0, 0, 0, 0]);
    frozen(refused(7, Refusal::CameraUnsupported), RESPONSE_ID, [7, 12, 13, 0, 0, 0, 0, 0]);
    frozen(refused(8, Refusal::UnknownHead), RESPONSE_ID, [8, 12, 14, 0, 0, 0, 0, 0]);
    frozen(refused(8, Refusal::CameraFull), RESPONSE_ID, [8, 12, 15, 0, 0, 0, 0, 0]);
}

#[test]
fn camera_status_has_three_pages() {
    let status = |page| Message::Camera(CameraStatus { head: 2, frame: 200, page });
    for (code, started_by) in (0..).zip(StartedBy::ALL) {
        let page = CameraPage::Exposure { started_by, exposure_us: 0x0403_0201 };
        frozen(status(page), CAMERA_STATUS_ID, [0, 2, 200, code, 1, 2, 3, 4]);
    }
    let levels = |black_level_dn_16| CameraPage::Levels { gain_cdb: 0x0201, black_level_dn_16 };
    frozen(status(levels(0x0005_0403)), CAMERA_STATUS_ID, [1, 2, 200, 1, 2, 3, 4, 5]);
    let trigger = CameraPage::Trigger { delay_us: 0x0403_0201 };
    frozen(status(trigger), CAMERA_STATUS_ID, [2, 2, 200, 0, 1, 2, 3, 4]);
    let beyond = can::encode(&status(levels(1 << 24)), Format::Classic, &ids());
    assert!(matches!(beyond, Err(EncodeError::OutOfRange { .. })), "{beyond:?}");
}

/// A flight computer that meets a code of a later version counts one rejection and reads on.
#[test]
fn refusal_code_of_a_later_version_is_rejected_and_the_next_answer_is_read() {
    let mut decoder = Decoder::new(ids());
    let later = CanFrame::classic(RESPONSE_ID, &[7, 12, 16, 0, 0, 0, 0, 0]).unwrap();
    assert_eq!(decoder.read(&later), Err(Reject::UnknownValue));
    let known = CanFrame::classic(RESPONSE_ID, &[7, 12, 15, 0, 0, 0, 0, 0]).unwrap();
    assert_eq!(decoder.read(&known), Ok(Some(refused(7, Refusal::CameraFull))));
}

/// Negative control: the comparison notices another code.
#[test]
#[should_panic(expected = "CameraRange")]
fn a_wrong_code_is_noticed() {
    frozen(refused(7, Refusal::CameraRange), RESPONSE_ID, [7, 12, 11, 0, 0, 0, 0, 0]);
}
