//! The exact bytes of protocol major version 1. If this fails, the code is wrong, not the test.
//!
//! The bytes were assembled from the layout tables by a separate program, not by the encoder under test.

#![allow(clippy::unwrap_used, reason = "a test may stop at the first surprise")]

use firmware_protocol::can::{self, CanFrame, Format, IdMap};
use firmware_protocol::message::{
    AttitudeFlags, AttitudeRecord, Command, Exposure, Heartbeat, Identity, Info, JitterBurst, JitterPair, NodeState,
    PointingAngle, Rates, Refusal, Reply, Request, Response, Scet, StatusPage, StimulatorMode, Sync, Table, TableCell,
    TimeFollowUp, Trigger, Triggered, Wheels,
};
use firmware_protocol::tables::{self, Applied, LineRow};
use firmware_protocol::version::Version;
use firmware_protocol::{Message, Reject, serial};

const NODE: u8 = 3;

fn ids() -> IdMap {
    IdMap::new(0, NODE).unwrap()
}

fn bytes(hex: &str) -> Vec<u8> {
    hex.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect()
}

fn frames(message: Message, format: Format) -> Vec<CanFrame> {
    can::encode(&message, format, &ids()).unwrap().iter().copied().collect()
}

/// Asserts that the message is sent as these frames, and read from them.
fn frozen(message: Message, format: Format, wanted: &[(u16, &str)]) {
    let sent = frames(message, format);
    assert_eq!(sent.len(), wanted.len(), "{message:?}");
    let mut decoder = can::Decoder::new(ids());
    let mut read = None;
    for (frame, (id, hex)) in sent.iter().zip(wanted) {
        assert_eq!(frame.id(), *id, "{message:?}");
        assert_eq!(frame.data(), bytes(hex), "{message:?}");
        read = decoder.read(frame).unwrap();
    }
    assert_eq!(read, Some(message));
}

fn single(message: Message, id: u16, hex: &str) {
    frozen(message, Format::Fd, &[(id, hex)]);
}

fn attitude(flags: AttitudeFlags) -> AttitudeRecord {
    AttitudeRecord {
        t_us: 0x0403_0201,
        seq: 0x2A,
        flags,
        q_wxyz: [0.5, -0.5, 0.5, -0.5],
        rate_rad_s: if flags.rate { [0.25, -0.125, 0.0625] } else { [0.0; 3] },
        acceleration_rad_s2: if flags.acceleration { [-0.5, 0.0, 1.0] } else { [0.0; 3] },
    }
}

#[test]
fn time() {
    single(Message::Sync(Sync { counter: 0xFE }), 0x080, "fe");
    let scet = Scet::new(0x1122_3344, 0x0055_6677).unwrap();
    single(Message::TimeFollowUp(TimeFollowUp { scet, counter: 0xFE }), 0x203, "44 33 22 11 77 66 55 fe");
}

#[test]
fn exposure_wheels_heartbeat() {
    let exposure = Exposure::new(9, 0x2A, 0x0403_0201, 46_600);
    single(Message::Exposure(exposure), 0x183, "09 2a 01 02 03 04 34 12");
    let wheels = Wheels { speed_rpm: [6000.0, -6000.0, 0.25, -8191.75] };
    single(Message::Wheels(wheels), 0x283, "c0 5d 40 a2 01 00 01 80");
    let heartbeat = Heartbeat { state: NodeState::Running, major: 1 };
    single(Message::Heartbeat(heartbeat), 0x703, "02 01");
}

#[test]
fn status_pages() {
    let page = |page, hex| single(Message::Status(page), 0x193, hex);
    page(
        StatusPage::State { mode: StimulatorMode::Running, frames: 0x1234, latency_us: 0x00AB_CDEF },
        "00 01 34 12 ef cd ab 00",
    );
    page(StatusPage::Prediction { horizon_10us: -300, error_arcsec: 0.75 }, "01 00 d4 fe 00 00 40 3f");
    page(StatusPage::Clock { drift_0_1ppm: -25, residual_ns: -123_456 }, "02 00 e7 ff c0 1d fe ff");
    page(StatusPage::Rejects { reason: Reject::TornGroup, count: 70_000 }, "03 04 00 00 70 11 01 00");
    for (angle, turns_2_32, hex) in [
        (PointingAngle::RightAscension, 0x4000_0000, "04 c8 00 00 00 00 00 40"),
        (PointingAngle::Declination, 0xE000_0000, "05 c8 00 00 00 00 00 e0"),
        (PointingAngle::Roll, 0x1234_5678, "06 c8 00 00 78 56 34 12"),
    ] {
        page(StatusPage::Pointing { angle, frame: 200, flags: 0, turns_2_32 }, hex);
    }
}

#[test]
fn commands() {
    let command = |token, request, hex| single(Message::Command(Command { token, request }), 0x603, hex);
    command(5, Request::Hello(Version { major: 1, minor: 0 }), "01 05 01 00 00 00 00 00");
    command(6, Request::Info { page: 1 }, "02 06 01 00 00 00 00 00");
    command(8, Request::Run, "03 08 00 00 00 00 00 00");
    command(9, Request::Stop, "04 09 00 00 00 00 00 00");
    let apply = Request::Apply { table: 2, rows: 32, crc: 0xBEEF, seed: 0x1234 };
    command(10, apply, "05 0a 02 20 ef be 34 12");
    let trigger = |number, at_us| Request::Trigger(Trigger { number, at_us });
    command(11, trigger(0x1234, 0x0403_0201), "06 0b 34 12 01 02 03 04");
    command(12, trigger(65_535, 0), "06 0c ff ff 00 00 00 00");
    command(9, Request::Unknown { opcode: 200 }, "c8 09 00 00 00 00 00 00");
}

#[test]
fn responses() {
    let response = |token, reply, hex| single(Message::Response(Response { token, reply }), 0x583, hex);
    let version = Version { major: 1, minor: 0 };
    let identity = Identity { version, capabilities: 0x1234, attitude_convention: 1 };
    response(5, Reply::Hello(identity), "01 05 00 01 00 34 12 01");
    response(6, Reply::Info(Info::DbcCrc32(0xDEAD_BEEF)), "02 06 00 00 ef be ad de");
    let rates = Rates { attitude_hz: 100, jitter_hz: 1000 };
    response(7, Reply::Info(Info::Rates(rates)), "02 07 00 01 64 00 e8 03");
    response(8, Reply::Run, "03 08 00 00 00 00 00 00");
    response(10, Reply::Applied(Applied { table: Table::Psd, rows: 32 }), "05 0a 00 02 20 00 00 00");
    let triggered = |number, is_late| Reply::Triggered(Triggered { number, is_late });
    response(11, triggered(0x1234, false), "06 0b 00 34 12 00 00 00");
    response(12, triggered(65_535, true), "06 0c 00 ff ff 01 00 00");
    let full = Reply::Refused { opcode: 6, reason: Refusal::TriggersFull };
    response(12, full, "06 0c 0a 00 00 00 00 00");
    let incomplete = Reply::Refused { opcode: 5, reason: Refusal::TableIncomplete };
    response(10, incomplete, "05 0a 05 00 00 00 00 00");
    let refused = Reply::Refused { opcode: 3, reason: Refusal::NoHandshake };
    response(9, refused, "03 09 03 00 00 00 00 00");
}

#[test]
fn table_cells() {
    for (table, row, column, value, hex) in [
        (Table::Lines, 31, 4, -0.5, "01 1f 04 00 00 00 00 bf"),
        (Table::Psd, 0, 0, 10.0, "02 00 00 00 00 00 20 41"),
        (Table::WheelHarmonics, 63, 6, 1.0, "03 3f 06 00 00 00 80 3f"),
    ] {
        single(Message::Table(TableCell { table, row, column, value }), 0x483, hex);
    }
}

/// The bytes of APPLY for a table: 10 Hz, amplitudes 1, 2, 3 arcsec, phase 0.5 rad.
#[test]
fn table_crc() {
    let row = LineRow { frequency_hz: 10.0, amplitude_xyz_arcsec: [1.0, 2.0, 3.0], phase_rad: 0.5 };
    assert_eq!(tables::crc(&[row]), 0x256C);
}

const ATTITUDE_48: &str = "01 02 03 04 2a 03 6e 4a 00 00 00 3f 00 00 00 bf 00 00 00 3f 00 00 00 bf \
     00 00 80 3e 00 00 00 be 00 00 80 3d 00 00 00 bf 00 00 00 00 00 00 80 3f";

#[test]
fn attitude_in_one_frame() {
    single(Message::Attitude(attitude(AttitudeFlags::ALL)), 0x303, ATTITUDE_48);
}

#[test]
fn attitude_as_classic_group() {
    let q = [(0x213, "00 00 00 3f 00 00 00 bf"), (0x223, "00 00 00 3f 00 00 00 bf")];
    let whole = [
        q[0],
        q[1],
        (0x233, "90 d0 03 f7 c2 93 d0 03"),
        (0x243, "e0 5e 18 00 00 00 09 3d"),
        (0x253, "01 02 03 04 2a 03 cc 4a"),
    ];
    frozen(Message::Attitude(attitude(AttitudeFlags::ALL)), Format::Classic, &whole);
    let bare = [q[0], q[1], (0x253, "01 02 03 04 2a 00 d7 1e")];
    let flags = AttitudeFlags { rate: false, acceleration: false };
    frozen(Message::Attitude(attitude(flags)), Format::Classic, &bare);
}

#[test]
fn jitter() {
    let pair = JitterPair { slot: 0x80, samples_arcsec: [[1.0, -1.0], [163.82, -163.82]] };
    single(Message::JitterPair(pair), 0x2A3, "80 32 80 f3 ff ff 05 80");
    let samples = [[1.0, -1.0], [327.67, -327.67], [0.0, 0.01]];
    let burst = JitterBurst::new(0xFFFF_FF00, 1000, 7, &samples).unwrap();
    let wanted = format!("00 ff ff ff e8 03 07 03 64 00 9c ff ff 7f 01 80 00 00 01 00{}", " 00".repeat(44));
    single(Message::Jitter(burst), 0x313, &wanted);
}

#[test]
fn serial_packets() {
    let mut encoder = serial::Encoder::new();
    let mut decoder = serial::Decoder::new();
    let run = Command { token: 8, request: Request::Run };
    for (message, hex) in [
        (Message::Sync(Sync { counter: 0xFE }), "03 01 08 05 01 fe 7e 03 00"),
        (
            Message::Attitude(attitude(AttitudeFlags::ALL)),
            "0d 01 30 01 30 01 02 03 04 2a 03 6e 4a 01 01 02 3f 01 01 02 bf 01 01 02 3f 01 01 02 bf \
             01 03 80 3e 01 01 02 be 01 03 80 3d 01 01 02 bf 01 01 01 01 01 05 80 3f 39 7e 00",
        ),
        (Message::Command(run), "07 01 60 02 08 03 08 01 01 01 01 01 03 8e c5 00"),
    ] {
        let mut line = [0xEE; serial::ENCODED_MAX];
        let len = encoder.encode(&message, &mut line).unwrap();
        assert_eq!(line[..len], bytes(hex), "{message:?}");
        assert_eq!(decoder.read(&mut &line[..len]), Some(Ok(message)));
    }
}

/// Negative control: the comparison notices one wrong bit.
#[test]
#[should_panic(expected = "Sync")]
fn a_wrong_byte_is_noticed() {
    single(Message::Sync(Sync { counter: 0xFE }), 0x080, "ff");
}
