//! Starting, refusing and ending; `hil_scripts/tests/test_gateways.py` tests the frames with python-can.

use super::*;
use crate::simulated::{BusParams, BusTiming};
use crate::{Link, Packet};
use base::clock::{Monotonic, Virtual};
use base::time::Tai;
use firmware_protocol::can::{CanFrame, CanId};
use std::io::{Read, Write};
use std::net::{Ipv4Addr, TcpStream};
use std::time::Duration;

pub(super) const CAN: BusTiming = BusTiming::CanFd { arbitration_bps: 500_000, data_bps: 2_000_000 };
const FREE_PORT: Option<SocketAddr> = Some(SocketAddr::new(std::net::IpAddr::V4(Ipv4Addr::LOCALHOST), 0));
const PATIENCE: Duration = Duration::from_secs(60);

pub(super) fn bus(timing: BusTiming, clock: &Arc<dyn Clock>) -> SimulatedBus {
    let params = BusParams { name: "test bus".into(), timing, latency: Span::ZERO, queue_packets: 64 };
    SimulatedBus::new(params, clock)
}

pub(super) fn real_clock() -> Arc<dyn Clock> {
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
fn dropped_frames_are_watched_without_a_lock() {
    let clock = real_clock();
    let params = GatewayParams { slcan_tcp: FREE_PORT, socketcand: FREE_PORT, ..GatewayParams::default() };
    let gateways = [Gateways::start(&bus(CAN, &clock), &params, &clock).unwrap()];
    let watched = DroppedFrames::of(&gateways);
    assert_eq!(watched.total(), 0, "control");
    let [(_, _, first), (_, _, second)] = &gateways[0].at_work[..] else { panic!("two gateways") };
    let held = first.lock();
    first.dropped.fetch_add(3, Ordering::Relaxed);
    second.dropped.fetch_add(2, Ordering::Relaxed);
    assert_eq!(watched.total(), 5);
    drop(held);
    let dropped: Vec<u64> = gateways[0].counters().iter().map(|(_, counters)| counters.dropped).collect();
    assert_eq!(dropped, [3, 2]);
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
    // The element's time and end.
    daemon.read_exact(&mut [0; "1577836800.000042 AB >".len()]).unwrap();
    let extended = Packet::Can(CanFrame::classic(CanId::extended(0x123).unwrap(), &[0xAB]).unwrap());
    end.send(&extended).unwrap();
    expect(&mut slcan, "T000001231AB\r");
    expect(&mut daemon, "< frame 00000123 ");
    slcan.write_all(b"t1231AB\rT000001231AB\r").unwrap();
    for sent in [frame, extended] {
        let got = end.receive(clock.now() + Span::from_s(60.0)).unwrap().map(|packet| packet.value);
        assert_eq!(got, Some(sent));
    }
    let counters = gateways.counters();
    let of = |wanted| counters.iter().find(|(kind, _)| *kind == wanted).unwrap().1.clone();
    let slcan_counters = of(GatewayKind::SlcanTcp);
    assert_eq!((slcan_counters.clients, slcan_counters.from_clients, slcan_counters.to_clients), (1, 2, 2));
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

/// Returns one gateway of a kind on a bus with an end of ours.
fn one_gateway(kind: GatewayKind, opening_within: Span) -> (Arc<dyn Clock>, crate::simulated::SimulatedLink, Gateways) {
    let clock = real_clock();
    let bus = bus(CAN, &clock);
    let end = bus.attach();
    let on = |wanted| (kind == wanted).then_some(FREE_PORT).flatten();
    let (slcan_tcp, socketcand) = (on(GatewayKind::SlcanTcp), on(GatewayKind::Socketcand));
    let params = GatewayParams { slcan_tcp, socketcand, opening_within, ..GatewayParams::default() };
    let gateways = Gateways::start(&bus, &params, &clock).unwrap();
    (clock, end, gateways)
}

/// Returns everything that comes until the other end closes the connection, which may be by a reset.
fn until_closed(mut stream: TcpStream) -> Vec<u8> {
    let mut said = Vec::new();
    match stream.read_to_end(&mut said) {
        Ok(_) => said,
        Err(error) if error.kind() == std::io::ErrorKind::ConnectionReset => said,
        Err(error) => panic!("{error}"),
    }
}

fn counters_of(gateways: &Gateways) -> GatewayCounters {
    gateways.counters().remove(0).1
}

/// Lines that open the bus and send one frame.
const SLCAN_BODY: &[u8] = b"C\rS6\rO\rt1231AB\r";
const SOCKETCAND_BODY: &[u8] = b"< open can0 >< rawmode >< send 123 1 ab >";
const BODIES: [(GatewayKind, &[u8]); 2] =
    [(GatewayKind::SlcanTcp, SLCAN_BODY), (GatewayKind::Socketcand, SOCKETCAND_BODY)];

#[test]
fn foreign_protocols_are_hung_up_on_and_nothing_behind_them_is_obeyed() {
    let heads: [(&[u8], &str); 6] = [
        (b"POST / HTTP/1.1\r\nHost: 127.0.0.1\r\nContent-Type: text/plain\r\n\r\n", "http_request"),
        (b"GET /chat HTTP/1.1\r\nUpgrade: websocket\r\n\r\n", "http_request"),
        (b"host: localhost\r\n\r\n", "http_request"),
        (b"brew /pot http/1.1\r\n\r\n", "http_request"),
        (b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n", "http_request"),
        (b"\x16\x03\x01\x00\x05\x01\r", "tls_handshake"),
    ];
    for (kind, body) in BODIES {
        for (head, reason) in heads {
            let (clock, end, gateways) = one_gateway(kind, OPENING_WITHIN);
            let mut stream = connect(&gateways, kind);
            let _ = stream.write_all(&[head, body].concat()); // the connection may be closed before the rest
            until_closed(stream);
            assert_eq!(end.take(clock.now() + Span::from_ms(50)), None, "{kind:?} {reason}");
            let counters = counters_of(&gateways);
            assert_eq!((counters.rejects.get(reason), counters.from_clients), (Some(&1), 0), "{counters:?}");
        }
        let (clock, end, gateways) = one_gateway(kind, OPENING_WITHIN);
        let mut stream = connect(&gateways, kind);
        stream.write_all(body).unwrap();
        assert!(end.take(clock.now() + Span::from_s(60.0)).is_some(), "control: {kind:?} obeys the body alone");
    }
}

#[test]
fn too_many_malformed_lines_before_a_valid_one_close_the_connection() {
    for (kind, malformed, valid, body) in [
        (GatewayKind::SlcanTcp, &b"Q\r"[..], &b"V\r"[..], SLCAN_BODY),
        (GatewayKind::Socketcand, b"< dance >", b"< echo >", SOCKETCAND_BODY),
    ] {
        let all = malformed.repeat(usize::try_from(MALFORMED_MAX).unwrap());
        let (clock, end, gateways) = one_gateway(kind, OPENING_WITHIN);
        let mut stream = connect(&gateways, kind);
        let _ = stream.write_all(&[&all, body].concat()); // the connection may be closed before the rest
        until_closed(stream);
        assert_eq!(end.take(clock.now() + Span::from_ms(50)), None, "{kind:?}");
        assert_eq!(counters_of(&gateways).rejects.get("malformed_lines"), Some(&1), "{kind:?}");
        let mut stream = connect(&gateways, kind);
        stream.write_all(&[&all[malformed.len()..], valid, &all, body].concat()).unwrap();
        assert!(end.take(clock.now() + Span::from_s(60.0)).is_some(), "control: {kind:?}: one less");
    }
}

#[test]
fn a_client_that_never_opens_the_bus_loses_its_seat() {
    for (kind, body) in BODIES {
        let seats = if kind == GatewayKind::SlcanTcp { 1 } else { SOCKETCAND_CLIENTS_MAX };
        let (clock, end, gateways) = one_gateway(kind, OPENING_WITHIN);
        let idle: Vec<TcpStream> = (0..seats).map(|_| connect(&gateways, kind)).collect();
        let mut newcomer = connect(&gateways, kind);
        newcomer.write_all(body).unwrap();
        assert!(end.take(clock.now() + Span::from_s(60.0)).is_some(), "{kind:?}: the newcomer is served");
        idle.into_iter().take(1).for_each(|stream| drop(until_closed(stream)));
        let counters = counters_of(&gateways);
        assert_eq!((counters.rejects.get("gave_way"), counters.refused), (Some(&1), 0), "{counters:?}");
        let (_, _, gateways) = one_gateway(kind, Span::from_ms(50));
        until_closed(connect(&gateways, kind));
        assert_eq!(counters_of(&gateways).rejects.get("never_opened"), Some(&1), "without other clients");
    }
}

#[test]
fn a_client_that_has_opened_the_bus_keeps_its_seat_however_quiet_it_is() {
    let (clock, end, gateways) = one_gateway(GatewayKind::SlcanTcp, Span::from_ms(50));
    let mut listener = connect(&gateways, GatewayKind::SlcanTcp);
    listener.write_all(b"L\r").unwrap();
    expect(&mut listener, "\r");
    clock.sleep_until(clock.now() + GRACE + Span::from_ms(100));
    let second = until_closed(connect(&gateways, GatewayKind::SlcanTcp));
    assert_eq!(second, LINE_IN_USE);
    end.put(&Packet::Can(CanFrame::classic(0x123, &[0xAB]).unwrap())).unwrap();
    expect(&mut listener, "t1231AB\r");
    let counters = counters_of(&gateways);
    assert_eq!((counters.refused, counters.clients, counters.rejected()), (1, 1, 0), "{counters:?}");
}

#[test]
fn a_client_reconnects_at_once() {
    let (_, _end, gateways) = one_gateway(GatewayKind::SlcanTcp, OPENING_WITHIN);
    for _ in 0..20 {
        let mut stream = connect(&gateways, GatewayKind::SlcanTcp);
        stream.write_all(b"O\rV\r").unwrap();
        expect(&mut stream, "\rV1013\r");
    }
    let counters = counters_of(&gateways);
    assert_eq!((counters.clients, counters.refused), (20, 0), "{counters:?}");
}
