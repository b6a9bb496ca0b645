//! Packets through a serial port, over a pseudo terminal, and through SocketCAN where there is a vcan0.

use crate::{complaints, counting::allocations_in};
use base::clock::{Clock, Monotonic};
use base::time::Span;
use firmware_protocol::can::{CanFrame, CanId, IdMap};
use link::serial::{PseudoTerminal, SerialLink, SerialParams};
use link::simulated::{BusParams, BusTiming, simulated_pair};
use link::socketcan::{Receives, SocketCanLink, SocketCanParams};
use link::{Link, Packet, SerialChunk};
use std::{path::Path, sync::Arc};

const PACKETS: usize = 200;

/// Returns the allocations of sending and receiving.
pub(crate) fn complaints_of_links() -> Vec<String> {
    let clock: Arc<dyn Clock> = Arc::new(Monotonic::start());
    let terminal = PseudoTerminal::open().unwrap();
    let near = SerialLink::open(SerialParams::new(terminal.path(), 115_200), &clock).unwrap();
    let far = SerialLink::of_terminal(terminal, 115_200, &clock);
    let chunk = Packet::Serial(SerialChunk::new(&[0xFF; 64]).unwrap());
    let mut wrong = exchange("serial port", [Box::new(near), Box::new(far)], &chunk, &*clock);
    if Path::new("/sys/class/net/vcan0").exists() {
        let open = || SocketCanLink::open(vcan0(), &clock).unwrap();
        let frame = Packet::Can(CanFrame::fd(0x305, &[5; 48]).unwrap());
        wrong.extend(exchange("SocketCAN", [Box::new(open()), Box::new(open())], &frame, &*clock));
        wrong.extend(exchange("SocketCAN, 29 bits", [Box::new(open()), Box::new(open())], &extended(), &*clock));
    }
    let (near, far) = simulated_pair(bus(), &clock);
    wrong.extend(exchange("simulated bus, 29 bits", [Box::new(near), Box::new(far)], &extended(), &*clock));
    wrong
}

fn extended() -> Packet {
    Packet::Can(CanFrame::fd(CanId::extended(0x18FF_0305).unwrap(), &[5; 48]).unwrap())
}

fn bus() -> BusParams {
    let timing = BusTiming::CanFd { arbitration_bps: 1_000_000, data_bps: 8_000_000 };
    BusParams { name: "simulated".into(), timing, latency: Span::ZERO, queue_packets: 64 }
}

fn vcan0() -> SocketCanParams {
    let ids = IdMap::new(0, 5).unwrap();
    SocketCanParams { interface: "vcan0".into(), ids, receives: Receives::Everything, fd: true, bit_rate_switch: true }
}

fn exchange(case: &str, [mut near, mut far]: [Box<dyn Link>; 2], packet: &Packet, clock: &dyn Clock) -> Vec<String> {
    let mut received = 0;
    let found = allocations_in(|| {
        for _ in 0..PACKETS {
            near.send(packet).unwrap();
            received += usize::from(far.receive(clock.now() + Span::from_s(10.0)).unwrap().is_some());
            far.send(packet).unwrap();
            received += usize::from(near.receive(clock.now() + Span::from_s(10.0)).unwrap().is_some());
            // Also test a wait without a packet.
            near.receive(clock.now() + Span::from_ns(10_000)).unwrap();
        }
    });
    assert!(received >= 2 * PACKETS, "{case}: {received} received");
    complaints(case, &found)
}
