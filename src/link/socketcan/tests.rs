//! Byte layouts, filters and error frames, compared with the socketcan crate's own types and with bytes made by hand.

use super::socket::{CLASSIC_BYTES, FD_BYTES, RawFrame, Receives, bytes_of, filters, frame_of};
use super::{socket::ErrorReport, *};
use crate::LinkError;
use base::clock::{Clock, Monotonic};
use firmware_protocol::MessageId;
use firmware_protocol::can::{CanFrame, CanId};
use std::sync::Arc;

fn ids(node: u8) -> IdMap {
    IdMap::new(0, node).unwrap()
}

/// Returns a kernel frame written by hand.
fn raw(id: u32, len: u8, data: &[u8], size: usize) -> Vec<u8> {
    let mut bytes = vec![0; size];
    bytes[..4].copy_from_slice(&id.to_ne_bytes());
    bytes[4] = len;
    bytes[8..8 + data.len()].copy_from_slice(data);
    bytes
}

#[test]
fn frames_have_the_kernels_layout() {
    let mut buffer = [0xEE; FD_BYTES];
    let classic = CanFrame::classic(0x123, &[1, 2, 3]).unwrap();
    let bytes = bytes_of(&classic, true, &mut buffer);
    assert_eq!(bytes, raw(0x123, 3, &[1, 2, 3], 16), "nothing of what was in the buffer before");
    let fd = CanFrame::fd(0x7FF, &[7; 48]).unwrap();
    let mut wanted = raw(0x7FF, 48, &[7; 48], 72);
    assert_eq!(bytes_of(&fd, false, &mut buffer), wanted);
    wanted[5] = 1; // CANFD_BRS
    assert_eq!(bytes_of(&fd, true, &mut buffer), wanted);
    let extended = CanFrame::classic(CanId::extended(0x123).unwrap(), &[1, 2, 3]).unwrap();
    assert_eq!(bytes_of(&extended, true, &mut buffer), raw(0x8000_0123, 3, &[1, 2, 3], 16), "CAN_EFF_FLAG");
    assert_eq!((CLASSIC_BYTES, FD_BYTES), (socketcan::socket::CAN_MTU, socketcan::socket::CANFD_MTU));
}

#[test]
fn every_frame_comes_back() {
    let data: Vec<u8> = (1..=64).collect();
    for len in 0..=64 {
        // One number, and a long one.
        let ids = [CanId::standard(0x30F), CanId::extended(0x30F), CanId::extended(0x1FFF_FFFF)].map(Option::unwrap);
        let frames = ids.map(|id| [CanFrame::classic(id, &data[..len]), CanFrame::fd(id, &data[..len])]);
        for frame in frames.into_iter().flatten().flatten() {
            let mut buffer = [0; FD_BYTES];
            assert_eq!(frame_of(bytes_of(&frame, true, &mut buffer)), RawFrame::Data(frame));
        }
    }
}

#[test]
fn frames_other_than_data_frames_are_foreign() {
    let foreign = [
        raw(0x123 | 0xC000_0000, 1, &[1], 16), // extended, remote
        raw(0x123 | 0x4000_0000, 1, &[1], 16), // remote
        raw(0x800, 1, &[1], 16),               // 12 bits
        raw(0x123, 9, &[], 16),                // longer than its data
        raw(0x123, 9, &[], 72),                // no such FD length
        raw(0x123, 65, &[], 72),
        raw(0x123, 1, &[], 40), // neither size
        vec![1; 7],
        vec![],
    ];
    for bytes in foreign {
        assert_eq!(frame_of(&bytes), RawFrame::Foreign, "{bytes:?}");
    }
}

#[test]
fn error_frames_are_counted_by_what_they_say() {
    let report = |class: u32, data: [u8; 8]| match frame_of(&raw(0x2000_0000 | class, 8, &data, 16)) {
        RawFrame::Report(report) => report,
        other @ (RawFrame::Data(_) | RawFrame::Foreign) => panic!("{other:?}"),
    };
    let none = ErrorReport::default();
    let error = ErrorReport { error: true, ..none };
    let with_problem = |problem| [0, problem, 0, 0, 0, 0, 0, 0];
    // Classes of linux/can/error.h, written out.
    assert_eq!(report(0x001, [0; 8]), error, "transmit timeout");
    assert_eq!(report(0x008, [0; 8]), error, "protocol violation");
    assert_eq!(report(0x020, [0; 8]), error, "no acknowledge");
    assert_eq!(report(0x040, [0; 8]), ErrorReport { bus_off: true, ..error }, "bus-off");
    assert_eq!(report(0x080, [0; 8]), error, "bus error");
    assert_eq!(report(0x100, [0; 8]), ErrorReport { restarted: true, ..none }, "restarted is not an error");
    assert_eq!(report(0x200, [0; 8]), none, "counters alone are not an error");
    assert_eq!(report(0x208, [0; 8]), error, "counters with a violation");
    assert_eq!(report(0x004, with_problem(0x01)), ErrorReport { overflow: true, ..error }, "controller overflow");
    assert_eq!(report(0x004, with_problem(0x0C)), error, "error warning");
    assert_eq!(report(0x004, with_problem(0x40)), none, "back to error-active");
    assert_eq!(report(0x1000_0000, [0; 8]), error, "a class of a later kernel");
}

#[test]
fn filters_let_through_one_side_of_one_node() {
    check_filters(ids);
    check_filters(|node| IdMap::extended(0x18FF_0000, node).unwrap());
}

fn check_filters(ids: impl Fn(u8) -> IdMap) {
    let passes = |receives, node, id: u32| {
        filters(&ids(node), receives).iter().any(|filter| {
            let filter = filter.as_ref();
            id & filter.can_mask == filter.can_id & filter.can_mask
        })
    };
    let either = [Receives::FlightComputer, Receives::Stimulator];
    for message in MessageId::ALL {
        let id = ids(3).id(message).flagged();
        let got = either.map(|receives| passes(receives, 3, id));
        assert!(got.contains(&true), "{message:?} has no sender");
        assert_eq!(got == [true, true], message == MessageId::Heartbeat, "{message:?}: one sender");
        for receives in either {
            let other = passes(receives, 4, id);
            assert_eq!(
                other,
                message == MessageId::Sync && receives == Receives::FlightComputer,
                "{message:?}: node 4"
            );
            assert!(!passes(receives, 3, id ^ 0x8000_0000), "{message:?}: the other length");
        }
        assert!(passes(Receives::Everything, 3, id), "{message:?}");
    }
    assert!(passes(Receives::Everything, 3, 0x123) && passes(Receives::Everything, 3, 0x8000_0123), "either length");
    assert!(!passes(Receives::Everything, 3, 0x4000_0123), "remote");
}

#[test]
fn a_canopen_node_receives_its_master_and_its_own_requests() {
    let passes = |id: u32| {
        filters(&ids(0), Receives::CanOpenNode(0x60)).iter().any(|filter| {
            let filter = filter.as_ref();
            id & filter.can_mask == filter.can_id & filter.can_mask
        })
    };
    assert!([0x000, 0x080, 0x660].into_iter().all(passes));
    assert!(![0x661, 0x5E0, 0x1E0, 0x760, 0x8000_0000, 0x4000_0660].into_iter().any(passes), "control");
}

#[test]
fn an_absent_interface_is_a_clear_error() {
    let clock: Arc<dyn Clock> = Arc::new(Monotonic::start());
    let params = SocketCanParams {
        interface: "can_none".into(),
        ids: ids(0),
        receives: Receives::FlightComputer,
        fd: false,
        bit_rate_switch: false,
    };
    let error = SocketCanLink::open(params, &clock).err().expect("the interface does not exist");
    assert!(matches!(error, LinkError::System { .. }), "{error}");
    let text = error.to_string();
    assert!(text.contains("can_none") && (text.contains("modprobe") || text.contains("ip link")), "{text}");
}

#[test]
fn no_bytes_of_the_kernel_upset_the_reader() {
    use rand::{RngExt, SeedableRng};
    let mut dice = rand::rngs::StdRng::seed_from_u64(11);
    let mut counts = [0; 3];
    for _ in 0..200_000 {
        let len = [16, 72, dice.random_range(0..100)][dice.random_range(0..3)];
        let mut bytes: Vec<u8> = (0..len).map(|_| dice.random()).collect();
        if let [_, high, top, flags, length, ..] = &mut bytes[..] {
            // Often enough a standard identifier and a possible length.
            if dice.random::<bool>() {
                (*high, *top, *flags, *length) = (*high & 7, 0, 0, *length % 9);
            }
        }
        counts[match frame_of(&bytes) {
            RawFrame::Data(frame) => {
                assert_eq!(frame.data(), &bytes[8..8 + usize::from(bytes[4])], "{bytes:?}");
                assert_eq!(frame.is_fd(), len == 72, "{bytes:?}");
                0
            }
            RawFrame::Report(_) => 1,
            RawFrame::Foreign => 2,
        }] += 1;
    }
    assert!(counts.iter().all(|count| *count > 1000), "each kind is reached: {counts:?}");
}
