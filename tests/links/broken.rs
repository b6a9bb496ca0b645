//! Links that break one promise each: the suite must refuse every one, for the right reason.

use crate::ends::{clock, simulated};
use base::clock::Clock;
use base::time::{Span, Tai};
use starloop_link::conformance::{Ends, check_link};
use starloop_link::{Datagram, Link, LinkCounters, LinkError, Packet, SerialChunk, Stamped, WireFormat};
use std::sync::Arc;

#[derive(Debug, Clone, Copy, PartialEq)]
enum Fault {
    None,
    Reorders,
    Drops,
    Duplicates,
    Alters,
    Truncates,
    StampsTheFuture,
    StampsThePast,
    StampsGoBack,
    GivesUpEarly,
    KeepsWaitingPackets,
    TakesEveryKind,
    CountsTwice,
    RepairsNothingAndSaysSent,
}

struct Broken {
    inner: Box<dyn Link>,
    clock: Arc<dyn Clock>,
    fault: Fault,
    packets: u64,
    held: Option<Stamped<Packet>>,
}

/// Returns the same packet with its last byte gone, or altered.
fn spoilt(packet: Packet, alter: bool) -> Packet {
    let spoil = |bytes: &[u8]| -> Vec<u8> {
        let mut bytes = bytes.to_vec();
        if alter {
            bytes.iter_mut().last().into_iter().for_each(|byte| *byte ^= 1);
        } else {
            bytes.pop();
        }
        bytes
    };
    match packet {
        Packet::Can(frame) => {
            let bytes = spoil(frame.data());
            let made = firmware_protocol::can::CanFrame::classic(frame.id(), &bytes);
            Packet::Can(made.unwrap())
        }
        Packet::Serial(chunk) => Packet::Serial(SerialChunk::new(&spoil(chunk.as_slice())).unwrap()),
        Packet::Datagram(datagram) => Packet::Datagram(Datagram::new(&spoil(datagram.as_slice())).unwrap()),
    }
}

impl Broken {
    fn spoil(&mut self, mut packet: Stamped<Packet>) -> Option<Stamped<Packet>> {
        self.packets += 1;
        // Faults wait a little: the first packets of a pair are good.
        let due = self.packets % 20 == 19;
        match self.fault {
            Fault::Drops if due => return None,
            Fault::Alters if due => packet.value = spoilt(packet.value, true),
            Fault::Truncates if due => packet.value = spoilt(packet.value, false),
            Fault::Duplicates if due => self.held = Some(packet),
            Fault::StampsTheFuture if due => packet.at = self.clock.now() + Span::from_ms(1000),
            Fault::StampsThePast if due => packet.at = packet.at - Span::from_ms(1000),
            // Within the uncertainty of a stamp, but out of order.
            Fault::StampsGoBack => packet.at = Tai::from_ns(packet.at.ns() - i64::from(due) * 1_000_000),
            _ => {}
        }
        Some(packet)
    }
}

impl Link for Broken {
    fn receive(&mut self, until: Tai) -> Result<Option<Stamped<Packet>>, LinkError> {
        if let Some(held) = self.held.take() {
            return Ok(Some(held));
        }
        let until = match self.fault {
            Fault::GivesUpEarly => until - Span::from_ms(3),
            Fault::KeepsWaitingPackets if until < self.clock.now() => return Ok(None),
            _ => until,
        };
        loop {
            let Some(packet) = self.inner.receive(until)? else { return Ok(None) };
            let Some(packet) = self.spoil(packet) else { continue };
            if self.fault == Fault::Reorders && self.packets % 20 == 10 {
                let next = self.inner.receive(self.clock.now() + Span::from_ms(100))?;
                self.held = next.is_some().then_some(packet);
                return Ok(next.or(Some(packet)));
            }
            return Ok(Some(packet));
        }
    }

    fn send(&mut self, packet: &Packet) -> Result<Tai, LinkError> {
        match (self.fault, self.inner.send(packet)) {
            (Fault::TakesEveryKind, Err(LinkError::WrongPacket { .. })) => Ok(self.clock.now()),
            (_, sent) => sent,
        }
    }

    fn counters(&self) -> LinkCounters {
        let mut counters = self.inner.counters();
        counters.sent *= if self.fault == Fault::CountsTwice { 2 } else { 1 };
        counters.unsent += u64::from(self.fault == Fault::RepairsNothingAndSaysSent);
        counters
    }
}

fn check(fault: Fault, format: WireFormat) -> Result<(), String> {
    let clock = clock();
    let make = || -> Result<Ends, LinkError> {
        let broken = |inner| Broken { inner, clock: Arc::clone(&clock), fault, packets: 0, held: None };
        let (near, far) = simulated(format, &clock)?;
        Ok((Box::new(broken(near)), Box::new(broken(far))))
    };
    check_link("broken", format, &clock, make).map(|_| ())
}

#[test]
fn the_wrapper_itself_breaks_nothing() {
    check(Fault::None, WireFormat::CanClassic).unwrap();
    check(Fault::None, WireFormat::Serial).unwrap();
}

#[test]
fn every_broken_link_is_refused_for_what_it_does() {
    let cases = [
        (Fault::Reorders, "in order"),
        (Fault::Drops, "wanted"),
        (Fault::Duplicates, "wanted"),
        (Fault::Alters, "wanted"),
        (Fault::Truncates, "wanted"),
        (Fault::StampsTheFuture, "after it was received"),
        (Fault::StampsThePast, "before it was sent"),
        (Fault::GivesUpEarly, "early"),
        (Fault::KeepsWaitingPackets, "waits"),
        (Fault::TakesEveryKind, "wanted a refusal"),
        (Fault::CountsTwice, "count"),
        (Fault::RepairsNothingAndSaysSent, "sender"),
    ];
    for (fault, said) in cases {
        let error = check(fault, WireFormat::CanClassic).expect_err(&format!("{fault:?} passed"));
        assert!(error.contains(said), "{fault:?}: wanted \"{said}\" in: {error}");
    }
}

#[test]
fn broken_serial_lines_are_refused_too() {
    for (fault, said) in [
        (Fault::Drops, "bytes"),
        (Fault::Duplicates, "bytes"),
        (Fault::Alters, "other bytes"),
        (Fault::Truncates, "bytes"),
        (Fault::StampsTheFuture, "after it was received"),
        (Fault::StampsGoBack, "before"),
    ] {
        let error = check(fault, WireFormat::Serial).expect_err(&format!("{fault:?} passed"));
        assert!(error.contains(said), "{fault:?}: wanted \"{said}\" in: {error}");
    }
}
