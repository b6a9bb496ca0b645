//! The owner of the link, refused datagrams, and the counts.

use super::*;
use crate::{DATAGRAM_MAX, Link, LinkCounters};
use base::clock::{Clock, Monotonic};
use base::time::Span;
use std::{net::UdpSocket, sync::Arc};

struct Bench {
    clock: Arc<dyn Clock>,
    link: UdpLink,
    senders: [UdpSocket; 2],
}

fn bench(sender_timeout: Span) -> Bench {
    let clock: Arc<dyn Clock> = Arc::new(Monotonic::start());
    let loopback = "127.0.0.1:0".parse().unwrap();
    let is_message: IsMessage = Box::new(|bytes| bytes.first() == Some(&b'!'));
    let params = UdpParams { sender_timeout, is_message, ..UdpParams::new(loopback) };
    let link = UdpLink::open(params, &clock).unwrap();
    let sender = || {
        let socket = UdpSocket::bind(loopback).unwrap();
        socket.connect(link.address()).unwrap();
        socket
    };
    Bench { senders: [sender(), sender()], clock, link }
}

impl Bench {
    /// Sends bytes, and returns the packet that the link makes of them.
    fn pass(&mut self, sender: usize, bytes: &[u8]) -> Option<Vec<u8>> {
        self.senders[sender].send(bytes).unwrap();
        let until = self.clock.now() + Span::from_ms(100);
        let packet = self.link.receive(until).unwrap()?;
        Some(packet.value.data().to_vec())
    }

    fn counters(&self) -> LinkCounters {
        LinkCounters { unstamped: 0, ..self.link.counters() }
    }
}

#[test]
fn first_sender_of_a_message_has_the_link() {
    let mut bench = bench(Span::from_ms(3_600_000));
    assert_eq!(bench.pass(0, b"noise"), Some(b"noise".to_vec()), "the port counts it by its reason");
    assert_eq!(bench.pass(1, b"!one"), Some(b"!one".to_vec()), "noise has taken nothing");
    assert_eq!(bench.pass(0, b"!two"), None, "a second sender");
    assert_eq!(bench.pass(1, b"noise"), Some(b"noise".to_vec()), "the first one's, whatever it is");
    assert_eq!(bench.counters(), LinkCounters { received: 3, foreign: 1, ..LinkCounters::default() });
}

#[test]
fn silent_sender_loses_the_link_to_the_next_one() {
    let mut bench = bench(Span::from_ms(200));
    assert!(bench.pass(0, b"!one").is_some());
    assert_eq!(bench.pass(1, b"!two"), None, "control: not yet");
    bench.clock.sleep_until(bench.clock.now() + Span::from_ms(250));
    assert!(bench.pass(1, b"noise").is_some_and(|bytes| bytes == b"noise"), "takes nothing");
    assert!(bench.pass(1, b"!three").is_some());
    assert_eq!(bench.pass(0, b"!four"), None, "it has gone over");
    let wanted = LinkCounters { received: 3, foreign: 2, lost: 1, regained: 1, ..LinkCounters::default() };
    assert_eq!(bench.counters(), wanted);
}

#[test]
fn datagram_longer_than_any_message_is_refused() {
    let mut bench = bench(Span::from_ms(1000));
    assert_eq!(bench.pass(0, &[b'!'; DATAGRAM_MAX + 1]), None);
    assert_eq!(bench.counters(), LinkCounters { oversize: 1, ..LinkCounters::default() });
    assert_eq!(bench.pass(0, &[b'!'; DATAGRAM_MAX]).map(|bytes| bytes.len()), Some(DATAGRAM_MAX), "control");
}

#[test]
fn address_that_is_taken_is_refused_with_what_to_do() {
    let bench = bench(Span::from_ms(1000));
    let error = UdpLink::open(UdpParams::new(bench.link.address()), &bench.clock).err().unwrap().to_string();
    assert!(error.contains(&bench.link.address().to_string()) && error.contains("ss -ulpn"), "{error}");
}
