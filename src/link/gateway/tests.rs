//! Starting, refusing and ending; what passes is held by `hil_scripts/test_gateways.py` with python-can.

use super::*;
use crate::base::clock::{Monotonic, Virtual};
use crate::base::time::Tai;
use crate::link::simulated::{BusParams, BusTiming};
use crate::link::{Link, Packet};
use firmware_protocol::can::CanFrame;
use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpStream};
use std::time::Duration;

const CAN: BusTiming = BusTiming::CanFd { arbitration_bps: 500_000, data_bps: 2_000_000 };
const FREE_PORT: Option<SocketAddr> = Some(SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::LOCALHOST), 0));
const PATIENCE: Duration = Duration::from_secs(60);

fn bus(timing: BusTiming, clock: &Arc<dyn Clock>) -> SimulatedBus {
    let params = BusParams { name: "test bus".into(), timing, latency: Span::ZERO, queue_packets: 64 };
    SimulatedBus::new(params, clock)
}

fn real_clock() -> Arc<dyn Clock> {
    Arc::new(Monotonic::start())
}

fn connect(gateways: &Gateways, kind: GatewayKind) -> TcpStream {
    let found = gateways.addresses().into_iter().find(|(found, _)| *found == kind);
    let Some((_, GatewayAddress::Tcp(address))) = found else { panic!("{kind:?} does not listen") };
    let stream = TcpStream::connect(address).unwrap();
    stream.set_read_timeout(Some(PATIENCE)).unwrap();
    stream
}

fn expect(stream: &mut TcpStream, wanted: &str) {
    let mut said = vec![0; wanted.len()];
    stream.read_exact(&mut said).unwrap();
    assert_eq!(String::from_utf8_lossy(&said), wanted);
}

#[test]
fn a_virtual_clock_and_a_serial_line_are_refused() {
    let clock: Arc<dyn Clock> = Arc::new(Virtual::new(Tai::from_ns(0)));
    let refused = Gateways::start(&bus(CAN, &clock), &GatewayParams::default(), &clock).err().unwrap().to_string();
    assert!(refused.contains("virtual") && refused.contains("real clock"), "{refused}");
    let clock = real_clock();
    let line = bus(BusTiming::Serial { baud: 9600 }, &clock);
    let refused = Gateways::start(&line, &GatewayParams::default(), &clock).err().unwrap().to_string();
    assert!(refused.contains("serial"), "{refused}");
}

#[test]
fn frames_pass_both_ways_and_are_counted() {
    let clock = real_clock();
    let bus = bus(CAN, &clock);
    let mut end = bus.attach();
    let params = GatewayParams { slcan_tcp: FREE_PORT, socketcand: FREE_PORT, ..GatewayParams::default() };
    let gateways = Gateways::start(&bus, &params, &clock).unwrap();
    let mut slcan = connect(&gateways, GatewayKind::SlcanTcp);
    slcan.write_all(b"O\r").unwrap();
    expect(&mut slcan, "\r");
    let mut daemon = connect(&gateways, GatewayKind::Socketcand);
    for (said, answer) in [("", "< hi >"), ("< open can0 >", "< ok >"), ("< rawmode >", "< ok >")] {
        daemon.write_all(said.as_bytes()).unwrap();
        expect(&mut daemon, answer);
    }
    let frame = Packet::Can(CanFrame::classic(0x123, &[0xAB]).unwrap());
    end.send(&frame).unwrap();
    expect(&mut slcan, "t1231AB\r");
    expect(&mut daemon, "< frame 123 ");
    slcan.write_all(b"t1231AB\r").unwrap();
    let got = end.receive(clock.now() + Span::from_s(60.0)).unwrap().map(|packet| packet.value);
    assert_eq!(got, Some(frame));
    let counters = gateways.counters();
    let of = |wanted| counters.iter().find(|(kind, _)| *kind == wanted).unwrap().1.clone();
    let slcan_counters = of(GatewayKind::SlcanTcp);
    assert_eq!((slcan_counters.clients, slcan_counters.from_clients, slcan_counters.to_clients), (1, 1, 1));
    drop(gateways);
    assert_eq!(bus.statistics().ends, 1, "they have left the bus");
    slcan.read_to_end(&mut Vec::new()).unwrap();
}

#[test]
fn a_path_that_is_taken_is_refused_and_left_alone() {
    let clock = real_clock();
    let bus = bus(CAN, &clock);
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("line");
    let params = GatewayParams { slcan_pty: Some(path.clone()), ..GatewayParams::default() };
    std::fs::write(&path, "mine").unwrap();
    let refused = Gateways::start(&bus, &params, &clock).err().unwrap().to_string();
    assert!(refused.contains("line") && refused.contains("nothing at it"), "{refused}");
    assert_eq!(std::fs::read(&path).unwrap(), b"mine");
    std::fs::remove_file(&path).unwrap();
    let gateways = Gateways::start(&bus, &params, &clock).unwrap();
    assert!(std::fs::read_link(&path).unwrap().starts_with("/dev/pts"));
    drop(gateways);
    assert!(std::fs::symlink_metadata(&path).is_err(), "taken away");
    let gateways = Gateways::start(&bus, &params, &clock).unwrap();
    std::fs::remove_file(&path).unwrap();
    std::fs::write(&path, "mine").unwrap();
    drop(gateways);
    assert_eq!(std::fs::read(&path).unwrap(), b"mine", "not ours any more");
}

#[test]
fn a_port_that_is_taken_is_refused_and_nothing_is_left_running() {
    let clock = real_clock();
    let bus = bus(CAN, &clock);
    let taken = std::net::TcpListener::bind((Ipv4Addr::LOCALHOST, 0)).unwrap();
    let params = GatewayParams {
        slcan_tcp: FREE_PORT,
        socketcand: Some(taken.local_addr().unwrap()),
        ..GatewayParams::default()
    };
    let refused = Gateways::start(&bus, &params, &clock).err().unwrap().to_string();
    assert!(refused.contains("socketcand") && refused.contains("port 0"), "{refused}");
    assert_eq!(bus.statistics().ends, 0);
}
