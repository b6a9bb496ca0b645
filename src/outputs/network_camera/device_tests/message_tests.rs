//! Events on the message channel: their receivers, their times, and losses.

use super::commanded_tests::{BENCH, commanded};
use super::*;
use frames::camera_control::{CameraEvent, CameraEventKind, DeskEnd};

/// The client's message port.
const PORT: u16 = 4_444;

fn report(end: &DeskEnd, kind: CameraEventKind, frame: u32) {
    assert!(end.report(CameraEvent { kind, at: BENCH, frame }));
}

/// Opens the channel, with a timeout of so many ms.
fn open(bench: &mut Bench, timeout_ms: u32) {
    for (address, value) in [
        (at::MESSAGE_PORT, PORT.into()),
        (at::MESSAGE_ADDRESS, A.ip().to_bits()),
        (at::MESSAGE_TIMEOUT, timeout_ms),
        (at::MESSAGE_RETRIES, 1),
    ] {
        assert_eq!(bench.write(A, address, value), OK, "{address:x}");
    }
}

/// Returns messages that leave now: event and frame of each.
fn messages(bench: &mut Bench) -> Vec<(u16, u8)> {
    bench.device.tick(bench.now);
    let (mut out, mut all) = (Vec::new(), Vec::new());
    while let Some(to) = bench.device.message(bench.now, &mut out) {
        assert_eq!((to, out.len()), (SocketAddrV4::new(*A.ip(), PORT), 32));
        all.push((u16::from_be_bytes([out[10], out[11]]), out[31]));
    }
    all
}

#[test]
fn events_that_are_on_go_to_the_client() {
    let (mut bench, end) = commanded();
    open(&mut bench, 0);
    let all = [
        CameraEventKind::FrameTrigger,
        CameraEventKind::ExposureStart,
        CameraEventKind::ExposureEnd,
        CameraEventKind::FrameTriggerMissed,
    ];
    all.iter().for_each(|kind| report(&end, *kind, 1));
    assert_eq!(messages(&mut bench), [], "none is on");
    for (selector, id) in [(2, 0x0004), (0, 0x0002), (3, 0x9001), (1, 0x0003)] {
        assert_eq!(bench.write(A, own::EVENT_SELECTOR, selector), OK);
        assert_eq!(bench.read(A, own::EVENT_NOTIFICATION), Ok(0));
        assert_eq!(bench.write(A, own::EVENT_NOTIFICATION, 1), OK);
        all.iter().for_each(|kind| report(&end, *kind, 7));
        assert_eq!(messages(&mut bench), [(id, 7)]);
        assert_eq!(bench.write(A, own::EVENT_NOTIFICATION, 0), OK);
    }
    assert_eq!(bench.write(A, own::EVENT_SELECTOR, 4), 0x8002);
    assert_eq!(bench.write(A, own::EVENT_NOTIFICATION, 2), 0x8002);
    assert_eq!(bench.device.counters().events_sent, 4);
}

#[test]
fn message_waits_for_the_answer_of_its_receiver() {
    let (mut bench, end) = commanded();
    open(&mut bench, 100);
    assert_eq!((bench.write(A, own::EVENT_SELECTOR, 2), bench.write(A, own::EVENT_NOTIFICATION, 1)), (OK, OK));
    (1..=3).for_each(|frame| report(&end, CameraEventKind::ExposureEnd, frame));
    assert_eq!(messages(&mut bench), [(4, 1)]);
    assert_eq!(messages(&mut bench), [], "the first is not answered");
    bench.now = bench.now + Span::from_ms(100);
    assert_eq!(messages(&mut bench), [(4, 1)], "again");
    let answer = |id| [0, 0, 0, 0xC3, 0, 0, 0, id];
    bench.device.answer_to_message(B, &answer(1));
    assert_eq!(messages(&mut bench), [], "of another client");
    bench.device.answer_to_message(A, &answer(1));
    assert_eq!(messages(&mut bench), [(4, 2)]);
    bench.now = bench.now + Span::from_ms(100);
    assert_eq!(messages(&mut bench), [(4, 2)]);
    bench.now = bench.now + Span::from_ms(100);
    assert_eq!(messages(&mut bench), [(4, 3)], "the second is given up");
    let counters = bench.device.counters();
    assert_eq!((counters.events_sent, counters.events_lost), (3, 1));
}

#[test]
fn messages_go_to_the_controller_alone_and_end_with_control() {
    let (mut bench, end) = commanded();
    assert_eq!(bench.write(B, at::MESSAGE_PORT, 1), 0x8006);
    open(&mut bench, 0);
    assert_eq!(bench.write(A, at::MESSAGE_ADDRESS, B.ip().to_bits()), 0x8002, "not to a third party");
    assert_eq!(bench.write(A, at::MESSAGE_SOURCE_PORT, 1), 0x8004);
    assert_eq!(bench.read(A, at::MESSAGE_SOURCE_PORT), Ok(50_001));
    assert_eq!((bench.write(A, own::EVENT_SELECTOR, 2), bench.write(A, own::EVENT_NOTIFICATION, 1)), (OK, OK));
    assert!(bench.device.has_messages());
    report(&end, CameraEventKind::ExposureEnd, 1);
    assert_eq!(bench.write(A, at::CONTROL, 0), OK);
    assert_eq!((messages(&mut bench), bench.read(A, at::MESSAGE_PORT)), (vec![], Ok(0)));
    assert_eq!(bench.write(A, at::CONTROL, 2), OK);
    open(&mut bench, 0);
    report(&end, CameraEventKind::ExposureEnd, 1);
    assert_eq!(messages(&mut bench), [], "notifications ended too");
}

#[test]
fn read_only_camera_sends_no_events() {
    let mut bench = bench();
    bench.control();
    assert_eq!(bench.write(A, own::EVENT_SELECTOR, 0), 0x8004);
    assert_eq!(bench.read(A, at::GVCP_CAPABILITY).unwrap() & 0x18, 0);
    let (mut commanded, _end) = commanded();
    assert_eq!(commanded.read(A, at::GVCP_CAPABILITY).unwrap() & 0x2_0018, 0x2_0018, "control");
}
