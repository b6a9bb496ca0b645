//! The suite on plain links: UDP with datagrams of any length, TCP with records of one.

use crate::ends::clock;
use base::{clock::Clock, time::Span};
use starloop_link::conformance::{Ends, check_link, check_records};
use starloop_link::simulated::{BusParams, BusTiming, simulated_pair};
use starloop_link::tcp::{Framing, TcpLink, TcpParams, TcpRole};
use starloop_link::udp::{UdpLink, UdpParams};
use starloop_link::{Link, LinkError, WireFormat};
use std::sync::Arc;

const RECORD: usize = 64;

fn udp(clock: &Arc<dyn Clock>) -> Result<Ends, LinkError> {
    let open = || UdpLink::open(UdpParams::new("127.0.0.1:0".parse().unwrap()), clock);
    let (near, far) = (open()?, open()?);
    let (near_at, far_at) = (near.address(), far.address());
    Ok((Box::new(near.with_peer(far_at)), Box::new(far.with_peer(near_at))))
}

fn tcp(clock: &Arc<dyn Clock>) -> Result<Ends, LinkError> {
    let params = |role| TcpParams { role, framing: Framing::Records(RECORD), acknowledges: false };
    let mut near = TcpLink::open(params(TcpRole::Server("127.0.0.1:0".parse().unwrap())), clock)?;
    let mut far = TcpLink::open(params(TcpRole::Client(near.address())), clock)?;
    while !(near.is_connected() && far.is_connected()) {
        far.receive(clock.now())?;
        near.receive(clock.now())?;
    }
    Ok((Box::new(near), Box::new(far)))
}

fn simulated(clock: &Arc<dyn Clock>) -> Ends {
    let timing = BusTiming::Datagram { bit_rate_bps: 100_000_000 };
    let params = BusParams { name: "simulated".into(), timing, latency: Span::ZERO, queue_packets: 2048 };
    let (near, far) = simulated_pair(params, clock);
    (Box::new(near), Box::new(far))
}

#[test]
fn udp_keeps_every_promise() {
    let clock = clock();
    check_link("udp", WireFormat::Plain, &clock, || udp(&clock)).unwrap();
}

#[test]
fn tcp_records_keep_every_promise() {
    let clock = clock();
    check_records("tcp", RECORD, &clock, || tcp(&clock)).unwrap();
}

#[test]
fn simulated_datagrams_keep_every_promise() {
    let clock = clock();
    check_link("simulated", WireFormat::Plain, &clock, || Ok(simulated(&clock))).unwrap();
}
