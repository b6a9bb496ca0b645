//! Delays to the bit, order, bounded queues; both clocks.

use super::*;
use crate::{Link, LinkError, Packet, SerialChunk};
use base::clock::{Clock, Monotonic, Virtual};
use base::time::{Span, Tai};
use firmware_protocol::can::CanFrame;
use std::sync::Arc;

const START: Tai = Tai::from_ns(1_000_000_000);
const CAN: BusTiming = BusTiming::CanClassic { bit_rate_bps: 500_000 };
/// 135 bits of 2 us.
const FRAME: Span = Span::from_ns(270_000);
const LATENCY: Span = Span::from_ns(50_000);

fn params(timing: BusTiming) -> BusParams {
    BusParams { name: "test bus".into(), timing, latency: LATENCY, queue_packets: 4 }
}

fn virtual_clock() -> (Arc<Virtual>, Arc<dyn Clock>) {
    let clock = Arc::new(Virtual::new(START));
    (Arc::clone(&clock), clock)
}

fn frame(id: u16) -> Packet {
    Packet::Can(CanFrame::classic(id, &[0; 8]).unwrap())
}

fn received(link: &mut SimulatedLink, until: Tai) -> Option<(Tai, Packet)> {
    link.receive(until).unwrap().map(|packet| (packet.at, packet.value))
}

#[test]
fn a_frame_arrives_after_its_bits_and_the_latency_and_not_before() {
    let (clock, shared) = virtual_clock();
    let (mut a, mut b) = simulated_pair(params(CAN), &shared);
    assert_eq!(a.send(&frame(1)).unwrap(), START + FRAME, "leaves with its last bit");
    let arrival = START + FRAME + LATENCY;
    clock.advance_to(arrival - Span::from_ns(1));
    assert_eq!(received(&mut b, arrival), None, "1 ns early; the virtual clock does not wait");
    clock.advance_to(arrival);
    assert_eq!(received(&mut b, arrival), Some((arrival, frame(1))));
    assert_eq!(received(&mut a, arrival), None, "an end does not receive its own frames");
}

#[test]
fn a_late_look_does_not_change_the_stamp() {
    let (clock, shared) = virtual_clock();
    let (mut a, mut b) = simulated_pair(params(CAN), &shared);
    a.send(&frame(1)).unwrap();
    clock.advance_to(START + Span::from_ms(100));
    assert_eq!(received(&mut b, START).map(|(at, _)| at), Some(START + FRAME + LATENCY));
}

#[test]
fn a_frame_on_the_wire_is_waited_for() {
    let (clock, shared) = virtual_clock();
    let mut ends = simulated_bus(params(CAN), &shared, 3);
    assert_eq!(ends[0].send(&frame(7)).unwrap(), START + FRAME);
    clock.advance_to(START + Span::from_ns(1));
    assert_eq!(ends[1].send(&frame(3)).unwrap(), START + FRAME + FRAME, "waits for the wire");
    clock.advance_to(START + Span::from_ms(5));
    let last = received(&mut ends[2], START).unwrap();
    assert_eq!(last, (START + FRAME + LATENCY, frame(7)));
    assert_eq!(received(&mut ends[2], START).unwrap().1, frame(3));
    assert_eq!(ends[0].send(&frame(1)).unwrap(), START + Span::from_ms(5) + FRAME, "an idle wire starts at once");
}

#[test]
fn serial_directions_do_not_wait_for_each_other() {
    let (_clock, shared) = virtual_clock();
    let (mut a, mut b) = simulated_pair(params(BusTiming::Serial { baud: 1_000_000 }), &shared);
    let chunk = Packet::Serial(SerialChunk::new(&[1; 10]).unwrap());
    let time = Span::from_ns(100_000);
    assert_eq!(a.send(&chunk).unwrap(), START + time);
    assert_eq!(b.send(&chunk).unwrap(), START + time, "the other wire");
    assert_eq!(a.send(&chunk).unwrap(), START + time + time, "the same wire");
}

#[test]
fn a_full_queue_loses_the_newest_and_counts_it() {
    let (clock, shared) = virtual_clock();
    let (mut a, mut b) = simulated_pair(params(CAN), &shared);
    for id in 0..6 {
        a.send(&frame(id)).unwrap();
    }
    clock.advance_to(START + Span::from_ms(10));
    let ids: Vec<_> = core::iter::from_fn(|| received(&mut b, START)).map(|(_, packet)| packet).collect();
    assert_eq!(ids, [0, 1, 2, 3].map(frame));
    assert_eq!((b.counters().overflows, b.counters().received), (2, 4));
    assert_eq!((a.counters().overflows, a.counters().sent), (0, 6));
}

#[test]
fn a_packet_of_another_kind_is_refused_by_name() {
    let (_clock, shared) = virtual_clock();
    let (mut a, _b) = simulated_pair(params(CAN), &shared);
    let error = a.send(&Packet::Serial(SerialChunk::EMPTY)).unwrap_err();
    assert!(matches!(error, LinkError::WrongPacket { wanted: "classic CAN", got: "serial", .. }), "{error}");
    assert!(error.to_string().contains("test bus"), "{error}");
    assert_eq!(a.counters().sent, 0);
}

#[test]
fn the_real_clock_waits_for_a_packet_from_another_thread() {
    let clock: Arc<dyn Clock> = Arc::new(Monotonic::start());
    let (mut a, mut b) = simulated_pair(params(CAN), &clock);
    let sender = std::thread::Builder::new().name("sender".into());
    let pause = clock.now() + Span::from_ms(5);
    let sender_clock = Arc::clone(&clock);
    let sent = sender
        .spawn(move || {
            sender_clock.sleep_until(pause);
            a.send(&frame(5)).unwrap()
        })
        .unwrap();
    let (at, packet) = received(&mut b, clock.now() + Span::from_s(60.0)).expect("within a minute");
    assert_eq!(packet, frame(5));
    assert_eq!(at, sent.join().unwrap() + LATENCY, "stamped when due, however late the thread woke");
    assert!(clock.now() >= at, "not delivered before it was due");
}

#[test]
fn the_real_clock_gives_up_at_the_limit_and_not_before() {
    let clock: Arc<dyn Clock> = Arc::new(Monotonic::start());
    let (_a, mut b) = simulated_pair(params(CAN), &clock);
    let until = clock.now() + Span::from_ms(3);
    assert_eq!(received(&mut b, until), None);
    assert!(clock.now() >= until, "gave up early");
    assert_eq!(received(&mut b, until), None, "a limit in the past does not wait");
}
