//! Borders of messages in a stream, one client at a time, connections that are lost, the answer of 42's receiver.

use super::{Reassembly, *};
use crate::{DATAGRAM_MAX, Link, LinkCounters, Packet};
use base::clock::{Clock, Monotonic};
use base::time::Span;
use proptest::prelude::*;
use std::io::{Read, Write};
use std::net::{TcpListener, TcpStream};
use std::{sync::Arc, time::Duration};

const LOOPBACK: &str = "127.0.0.1:0";

fn clock() -> Arc<dyn Clock> {
    Arc::new(Monotonic::start())
}

fn server(framing: Framing, acknowledges: bool, clock: &Arc<dyn Clock>) -> TcpLink {
    let role = TcpRole::Server(LOOPBACK.parse().unwrap());
    TcpLink::open(TcpParams { role, framing, acknowledges }, clock).unwrap()
}

fn next(link: &mut TcpLink, clock: &Arc<dyn Clock>) -> Option<Vec<u8>> {
    let packet = link.receive(clock.now() + Span::from_ms(300)).unwrap()?;
    Some(packet.value.data().to_vec())
}

fn client(link: &TcpLink) -> TcpStream {
    let stream = TcpStream::connect(link.address()).unwrap();
    stream.set_read_timeout(Some(Duration::from_secs(5))).unwrap();
    stream
}

#[test]
fn records_and_lines_are_found_in_any_pieces() {
    let clock = clock();
    let mut records = server(Framing::Records(3), false, &clock);
    let mut stream = client(&records);
    stream.write_all(b"abcde").unwrap();
    assert_eq!(next(&mut records, &clock), Some(b"abc".to_vec()));
    assert_eq!(next(&mut records, &clock), None, "half a record");
    stream.write_all(b"f").unwrap();
    assert_eq!(next(&mut records, &clock), Some(b"def".to_vec()));

    let mut lines = server(Framing::Lines, false, &clock);
    let mut stream = client(&lines);
    stream.write_all(b"one\r\n\n\ntwo").unwrap();
    assert_eq!(next(&mut lines, &clock), Some(b"one".to_vec()));
    assert_eq!(next(&mut lines, &clock), None, "half a line");
    stream.write_all(b"three\n").unwrap();
    stream.write_all(&[b'x'; DATAGRAM_MAX + 1]).unwrap();
    stream.write_all(b"\nfour\n").unwrap();
    assert_eq!(next(&mut lines, &clock), Some(b"twothree".to_vec()));
    assert_eq!(next(&mut lines, &clock), Some(b"four".to_vec()));
    assert_eq!((lines.counters().received, lines.counters().oversize), (3, 1));
}

#[test]
fn second_client_is_refused_and_a_lost_one_may_come_again() {
    let clock = clock();
    let mut link = server(Framing::Lines, false, &clock);
    let mut first = client(&link);
    first.write_all(b"one\n").unwrap();
    assert!(next(&mut link, &clock).is_some());
    let mut second = client(&link);
    let _ = second.write_all(b"two\n"); // the link may have closed it already
    assert_eq!(next(&mut link, &clock), None);
    assert!(matches!(second.read(&mut [0; 4]), Ok(0) | Err(_)), "closed");
    first.write_all(b"half").unwrap();
    drop(first);
    assert_eq!(next(&mut link, &clock), None);
    let mut third = client(&link);
    third.write_all(b"three\n").unwrap();
    assert_eq!(next(&mut link, &clock), Some(b"three".to_vec()), "without the half of the lost one");
    let wanted = LinkCounters { received: 2, foreign: 1, lost: 1, regained: 1, ..LinkCounters::default() };
    assert_eq!(link.counters(), wanted);
}

#[test]
fn client_connects_when_its_server_is_there_and_again() {
    let clock = clock();
    let address = TcpListener::bind(LOOPBACK).unwrap().local_addr().unwrap();
    let params = TcpParams { role: TcpRole::Client(address), framing: Framing::Lines, acknowledges: false };
    let mut link = TcpLink::open(params, &clock).unwrap();
    assert_eq!(next(&mut link, &clock), None, "no client is connected");
    for round in 0..2 {
        let listener = TcpListener::bind(address).unwrap();
        let until = clock.now() + Span::from_ms(5000);
        while !link.is_connected() && clock.now() < until {
            assert_eq!(link.receive(clock.now() + Span::from_ms(50)).unwrap(), None);
        }
        let (mut stream, _) = listener.accept().unwrap();
        stream.write_all(b"hello\n").unwrap();
        assert_eq!(next(&mut link, &clock), Some(b"hello".to_vec()), "round {round}");
        drop((stream, listener));
        assert_eq!(next(&mut link, &clock), None);
    }
    assert_eq!((link.counters().lost, link.counters().regained), (2, 1));
}

#[test]
fn message_of_42_is_answered_and_other_lines_are_not() {
    let clock = clock();
    let mut link = server(Framing::Lines, true, &clock);
    let mut stream = client(&link);
    stream.write_all(b"TIME 2025-079-12:00:00.0\n[ENDMSG]\n").unwrap();
    assert_eq!(next(&mut link, &clock).unwrap(), b"TIME 2025-079-12:00:00.0");
    stream.set_nonblocking(true).unwrap();
    assert!(stream.read(&mut [0; 4]).is_err(), "control: nothing before the end");
    assert_eq!(next(&mut link, &clock).unwrap(), b"[ENDMSG]");
    stream.set_nonblocking(false).unwrap();
    let mut answer = [0; 4];
    stream.read_exact(&mut answer).unwrap();
    assert_eq!(&answer, b"Ack\0");
}

#[test]
fn only_records_of_the_stream_go_out() {
    let clock = clock();
    let mut link = server(Framing::Records(3), false, &clock);
    let _stream = client(&link);
    let packet = |bytes| Packet::Datagram(Datagram::new(bytes).unwrap());
    assert_eq!(next(&mut link, &clock), None);
    assert!(link.send(&packet(b"four")).is_err());
    link.send(&packet(b"abc")).unwrap();
    assert_eq!(link.counters().sent, 1);
}

proptest! {
    #[test]
    fn pieces_of_a_stream_do_not_change_its_messages(
        lines in prop::collection::vec(prop::collection::vec(1_u8..=255, 0..700), 0..8),
        cuts in prop::collection::vec(1_usize..200, 1..20),
    ) {
        let lines: Vec<Vec<u8>> =
            lines.into_iter().map(|line| line.into_iter().filter(|byte| !b"\r\n".contains(byte)).collect()).collect();
        let stream: Vec<u8> = lines.iter().flat_map(|line| line.iter().copied().chain([b'\n'])).collect();
        let (mut reassembly, mut got, mut rest) = (Reassembly::new(Framing::Lines), Vec::new(), &stream[..]);
        for cut in cuts.iter().cycle() {
            let (mut piece, left) = rest.split_at((*cut).min(rest.len()));
            while let Some(line) = reassembly.next(&mut piece) {
                got.push(line.as_slice().to_vec());
            }
            prop_assert!(piece.is_empty());
            rest = left;
            if rest.is_empty() {
                break;
            }
        }
        let wanted = |line: &&Vec<u8>| !line.is_empty() && line.len() <= DATAGRAM_MAX;
        prop_assert_eq!(got, lines.iter().filter(wanted).cloned().collect::<Vec<_>>());
        prop_assert_eq!(reassembly.oversize, lines.iter().filter(|line| line.len() > DATAGRAM_MAX).count() as u64);
    }
}

#[test]
fn web_page_cannot_send_messages_in_the_body_of_a_request() {
    let clock = clock();
    let mut link = server(Framing::Lines, false, &clock);
    let mut page = client(&link);
    page.write_all(b"POST / HTTP/1.1\r\nHost: x\r\n\r\n1.5, 1 0 0 0\n").unwrap();
    assert_eq!(next(&mut link, &clock), None, "not even the lines of its body");
    assert_eq!(link.counters().foreign, 1);
    let mut simulator = client(&link);
    simulator.write_all(b"1.5, 1 0 0 0\n").unwrap();
    assert_eq!(next(&mut link, &clock).as_deref(), Some(&b"1.5, 1 0 0 0"[..]), "control: a client of ours");
    // In pieces, the first too short to recognise the protocol.
    drop(simulator);
    assert_eq!(next(&mut link, &clock), None);
    let mut page = client(&link);
    page.set_nodelay(true).unwrap();
    page.write_all(b"GE").unwrap();
    assert_eq!(next(&mut link, &clock), None);
    page.write_all(b"T / HTTP/1.1\r\n\r\n1.5, 1 0 0 0\n").unwrap();
    assert_eq!(next(&mut link, &clock), None);
    assert_eq!(link.counters().foreign, 2);
}

#[test]
fn a_silent_client_gives_way_and_is_no_lost_link() {
    let clock = clock();
    let mut link = server(Framing::Lines, false, &clock);
    let silent = client(&link);
    assert_eq!(next(&mut link, &clock), None);
    let mut speaks = client(&link);
    speaks.write_all(b"one\n").unwrap();
    let until = clock.now() + Span::from_ms(20_000);
    let mut got = None;
    while got.is_none() && clock.now() < until {
        got = next(&mut link, &clock);
    }
    assert_eq!(got, Some(b"one".to_vec()), "after the grace");
    let counters = link.counters();
    assert_eq!((counters.foreign, counters.lost, counters.regained), (1, 0, 0));
    drop(silent);
}

#[test]
fn records_that_are_no_messages_end_the_connection() {
    let clock = clock();
    let reader = |bytes: &[u8]| bytes == b"abc";
    let mut link = server(Framing::Records(3), false, &clock).with_reader(Box::new(reader));
    let mut stream = client(&link);
    // A stray byte shifts all records.
    stream.write_all(&[b"x".as_slice(), &b"abc".repeat(100)].concat()).unwrap();
    let refused = core::iter::from_fn(|| next(&mut link, &clock)).count();
    assert_eq!(refused, REFUSED_MAX as usize);
    assert!(!link.is_connected());
    let mut stream = client(&link);
    stream.write_all(&b"xxx".repeat(REFUSED_MAX as usize - 1)).unwrap();
    stream.write_all(b"abc").unwrap();
    stream.write_all(&b"xxx".repeat(REFUSED_MAX as usize - 1)).unwrap();
    stream.write_all(b"abc").unwrap();
    let got: Vec<Vec<u8>> = core::iter::from_fn(|| next(&mut link, &clock)).collect();
    assert_eq!(got.iter().filter(|record| *record == b"abc").count(), 2, "control: one short of the limit");
    assert!(link.is_connected());
}

#[test]
fn tries_to_connect_that_fail_are_counted() {
    let clock = clock();
    let address = TcpListener::bind(LOOPBACK).unwrap().local_addr().unwrap();
    let params = TcpParams { role: TcpRole::Client(address), framing: Framing::Lines, acknowledges: false };
    let mut link = TcpLink::open(params, &clock).unwrap();
    let until = clock.now() + RETRY + RETRY + RETRY;
    while clock.now() < until {
        assert_eq!(next(&mut link, &clock), None);
    }
    let tries = link.counters().unreached;
    assert!(tries >= 2 && link.counters().refused == tries, "{tries}");
    let _listener = TcpListener::bind(address).unwrap();
    let until = clock.now() + Span::from_ms(5000);
    while !link.is_connected() && clock.now() < until {
        assert_eq!(next(&mut link, &clock), None);
    }
    assert!(link.is_connected() && link.counters().unreached <= tries + 2, "control: somebody listens");
}
