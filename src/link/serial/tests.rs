//! Settings refused, ports absent or taken, full lines, unplugging; over pseudo terminals.

use super::*;
use crate::{CHUNK_MAX, Link, LinkError, Packet, SerialChunk};
use base::clock::{Clock, Monotonic};
use base::time::{Span, Tai};
use std::{path::Path, sync::Arc};

fn clock() -> Arc<dyn Clock> {
    Arc::new(Monotonic::start())
}

fn chunk(bytes: &[u8]) -> Packet {
    Packet::Serial(SerialChunk::new(bytes).unwrap())
}

fn open(path: &Path, clock: &Arc<dyn Clock>) -> SerialLink {
    SerialLink::open(SerialParams::new(path, 3_000_000), clock).unwrap()
}

/// Returns everything that arrives until `count` bytes are there.
fn bytes(link: &mut SerialLink, count: usize, until: Tai) -> Vec<u8> {
    let mut got = Vec::new();
    while got.len() < count {
        match link.receive(until).unwrap().map(|chunk| chunk.value) {
            Some(Packet::Serial(chunk)) => got.extend_from_slice(chunk.as_slice()),
            other => panic!("{} of {count} bytes, then {other:?}", got.len()),
        }
    }
    got
}

fn refusal(params: SerialParams) -> String {
    let error = SerialLink::open(params, &clock()).err().expect("refused");
    assert!(matches!(error, LinkError::System { .. }), "{error}");
    error.to_string()
}

#[test]
fn an_absent_port_is_reported_with_those_that_exist() {
    let text = refusal(SerialParams::new("/dev/ttyNone9", 115_200));
    assert!(text.contains("/dev/ttyNone9") && text.contains("ports here:") && text.contains("cable"), "{text}");
}

#[test]
fn a_port_is_opened_once() {
    let terminal = PseudoTerminal::open().unwrap();
    let first = open(terminal.path(), &clock());
    let text = refusal(SerialParams::new(terminal.path(), 115_200));
    assert!(text.contains("another program"), "{text}");
    drop(first);
    open(terminal.path(), &clock());
}

#[test]
fn settings_the_driver_drops_are_refused() {
    let terminal = PseudoTerminal::open().unwrap();
    let wanted = SerialParams::new(terminal.path(), 921_600);
    let text = refusal(SerialParams { parity: Parity::Even, ..wanted.clone() });
    assert!(text.contains("did not take the parity"), "a pseudo terminal has none: {text}");
    let text = refusal(SerialParams { flow: FlowControl::Software, ..wanted.clone() });
    assert!(text.contains("0x11"), "{text}");
    let text = refusal(SerialParams { baud: 0, ..wanted.clone() });
    assert!(text.contains("set the port"), "{text}");
    let text = refusal(SerialParams::new("/dev/null", 921_600));
    assert!(text.contains("/dev/null"), "no terminal at all: {text}");
    SerialLink::open(SerialParams { stop_bits: StopBits::Two, ..wanted }, &clock()).unwrap();
}

#[test]
fn bits_per_byte_count_start_parity_and_stop() {
    let plain = SerialParams::new("", 9600);
    assert_eq!(plain.bits_per_byte(), 10);
    assert_eq!(SerialParams { parity: Parity::Odd, stop_bits: StopBits::Two, ..plain }.bits_per_byte(), 12);
}

#[test]
fn a_full_line_gives_up_counts_and_ends_the_torn_packet() {
    let clock = clock();
    let terminal = PseudoTerminal::open().unwrap();
    let mut near = open(terminal.path(), &clock);
    let mut far = SerialLink::of_terminal(terminal, 3_000_000, &clock);
    // The other end does not read: the line fills up, in the middle of a packet unless by chance.
    let packet = chunk(&[7; CHUNK_MAX - 3]);
    let mut accepted = 0;
    while near.counters().unsent < 3 {
        near.send(&packet).unwrap();
        accepted = near.counters().sent;
        assert!(accepted < 10_000, "a line that never fills up");
    }
    let until = clock.now() + Span::from_s(10.0);
    let whole = usize::try_from(accepted).unwrap() * (CHUNK_MAX - 3);
    let mut got = bytes(&mut far, whole, until);
    near.send(&chunk(&[9; 4])).unwrap();
    while !got.ends_with(&[9; 4]) {
        got.extend(bytes(&mut far, 1, until));
    }
    got.truncate(got.len() - 4);
    // The system may make space between two packets: each torn one ends with a delimiter, and what follows is whole.
    let parts: Vec<&[u8]> = got.split(|byte| *byte == 0).collect();
    assert!(parts.iter().all(|part| part.iter().all(|byte| *byte == 7)), "nothing but packets and delimiters");
    let whole_packets: usize = parts.iter().map(|part| part.len() / (CHUNK_MAX - 3)).sum();
    assert_eq!(whole_packets as u64, accepted, "what was accepted arrives, and at most a part of what was not");
    let torn = parts.iter().filter(|part| part.len() % (CHUNK_MAX - 3) != 0).count();
    assert_eq!(torn, parts.len() - 1, "a delimiter ends a torn packet, and only that");
    assert_eq!((near.counters().sent, near.counters().lost), (accepted + 1, 0));
}

#[test]
fn an_unplugged_port_is_lost_and_comes_back() {
    let clock = clock();
    let folder = tempfile::tempdir().unwrap();
    let name = folder.path().join("port");
    let plug = |terminal: &PseudoTerminal| {
        let _ = std::fs::remove_file(&name);
        std::os::unix::fs::symlink(terminal.path(), &name).unwrap();
    };
    let terminal = PseudoTerminal::open().unwrap();
    plug(&terminal);
    let mut near = open(&name, &clock);
    let mut far = SerialLink::of_terminal(terminal, 3_000_000, &clock);
    far.send(&chunk(&[1, 2])).unwrap();
    assert_eq!(bytes(&mut near, 2, clock.now() + Span::from_s(10.0)), [1, 2]);

    drop(far);
    std::fs::remove_file(&name).unwrap();
    assert!(near.receive(clock.now() + Span::from_ms(20)).unwrap().is_none(), "no error");
    near.send(&chunk(&[3])).unwrap();
    let counters = near.counters();
    assert_eq!((counters.lost, counters.regained, counters.sent, counters.unsent), (1, 0, 0, 1));

    let terminal = PseudoTerminal::open().unwrap();
    plug(&terminal);
    let limit = clock.now() + Span::from_s(30.0);
    while !near.is_up() {
        assert!(near.receive(clock.now() + Span::from_ms(50)).unwrap().is_none());
        assert!(clock.now() < limit, "never comes back");
    }
    let mut far = SerialLink::of_terminal(terminal, 3_000_000, &clock);
    near.send(&chunk(&[4])).unwrap();
    assert_eq!(bytes(&mut far, 1, limit), [4]);
    assert_eq!((near.counters().lost, near.counters().regained), (1, 1));
}
