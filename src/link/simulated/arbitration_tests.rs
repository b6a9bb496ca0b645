//! Order of sending: compared with an independent bus that is stepped bit by bit.

use super::*;
use crate::{Departure, Link, Packet};
use base::clock::{Clock, Virtual};
use base::time::{Span, Tai};
use firmware_protocol::can::{CanFrame, CanId};
use rand::rngs::StdRng;
use rand::{RngExt, SeedableRng};
use std::sync::Arc;

const START: Tai = Tai::from_ns(1_000_000_000);
const BIT_NS: i64 = 2000;
const CAN: BusTiming = BusTiming::CanClassic { bit_rate_bps: 500_000 };
/// 135 bits.
const FRAME: Span = Span::from_ns(135 * BIT_NS);

pub(super) struct Bench {
    pub(super) clock: Arc<Virtual>,
    pub(super) bus: SimulatedBus,
}

impl Bench {
    pub(super) fn new(timing: BusTiming, model: BusModel) -> Self {
        let clock = Arc::new(Virtual::new(START));
        let shared: Arc<dyn Clock> = Arc::<Virtual>::clone(&clock);
        let params = BusParams { name: "test bus".into(), timing, latency: Span::ZERO, queue_packets: 10_000 };
        Self { bus: SimulatedBus::with_model(params, model, &shared), clock }
    }

    pub(super) fn ends<const N: usize>(&self) -> [SimulatedLink; N] {
        core::array::from_fn(|_| self.bus.attach())
    }

    pub(super) fn advance(&self, by: Span) {
        self.clock.advance_to(self.clock.now() + by);
    }
}

pub(super) fn frame(id: u16) -> Packet {
    Packet::Can(CanFrame::classic(id, &[0; 8]).unwrap())
}

pub(super) fn got(link: &SimulatedLink) -> Vec<(Tai, Packet)> {
    core::iter::from_fn(|| link.take(START)).map(|packet| (packet.at, packet.value)).collect()
}

#[test]
fn of_frames_queued_at_one_instant_the_lowest_identifier_goes_first() {
    let bench = Bench::new(CAN, BusModel::default());
    let [mut a, mut b, listener] = bench.ends();
    assert_eq!(a.send(&frame(7)).unwrap(), START + FRAME, "the present estimate");
    assert_eq!(b.send(&frame(3)).unwrap(), START + FRAME, "wins");
    bench.advance(Span::from_ms(5));
    assert_eq!(got(&listener), [(START + FRAME, frame(3)), (START + FRAME + FRAME, frame(7))]);
    assert_eq!(a.departure(0), Departure::At(START + FRAME + FRAME), "later than the first estimate");
    assert_eq!(b.departure(0), Departure::At(START + FRAME));
    assert_eq!((a.error_counters(), b.error_counters()), Default::default(), "losing is not an error");
}

#[test]
fn the_head_of_a_queue_hides_what_is_behind_it() {
    let bench = Bench::new(CAN, BusModel::default());
    let [mut a, mut b, listener] = bench.ends();
    a.send(&frame(0x700)).unwrap();
    assert_eq!(a.send(&frame(0x001)).unwrap(), START + FRAME + FRAME);
    assert_eq!(b.send(&frame(0x300)).unwrap(), START + FRAME);
    bench.advance(Span::from_ms(5));
    let order: Vec<_> = got(&listener).into_iter().map(|(_, packet)| packet).collect();
    assert_eq!(order, [0x300, 0x700, 0x001].map(frame));
}

#[test]
fn of_one_identifier_a_classic_frame_goes_before_an_fd_frame() {
    let bench = Bench::new(BusTiming::CanFd { arbitration_bps: 500_000, data_bps: 500_000 }, BusModel::default());
    let [mut a, mut b, listener] = bench.ends();
    let fd = Packet::Can(CanFrame::fd(5, &[0; 8]).unwrap());
    a.send(&fd).unwrap();
    b.send(&frame(5)).unwrap();
    bench.advance(Span::from_ms(5));
    let order: Vec<_> = got(&listener).into_iter().map(|(_, packet)| packet).collect();
    assert_eq!(order, [frame(5), fd]);
}

#[test]
fn of_the_same_first_11_bits_the_shorter_identifier_goes_first() {
    let bench = Bench::new(CAN, BusModel::default());
    let [mut a, mut b, mut c, mut d, listener] = bench.ends();
    let long = |number| Packet::Can(CanFrame::classic(CanId::extended(number).unwrap(), &[]).unwrap());
    // 0x123 begins both; 0x124 is behind all that begin with 0x123, and 0x123 with 29 bits begins with eleven zeros.
    let order = [long(0x123), frame(0x123), long(0x123 << 18), frame(0x124)];
    for (end, packet) in [&mut d, &mut b, &mut c, &mut a].into_iter().zip([order[3], order[1], order[2], order[0]]) {
        end.send(&packet).unwrap();
    }
    bench.advance(Span::from_ms(5));
    assert!(got(&listener).into_iter().map(|(_, packet)| packet).eq(order));
}

/// A send: bit time, end, identifier.
type Sent = (i64, usize, u16);

/// Simulates the independent bus, one step per bit. Returns (bit at which the frame is over, identifier).
fn stepped(sends: &[Sent], pick: fn(&[(i64, u16)]) -> usize) -> Vec<(i64, u16)> {
    let mut queues = vec![Vec::<(i64, u16)>::new(); 4];
    let mut over = Vec::new();
    let (mut busy_bits, mut on_the_wire) = (0, None);
    let last = sends.iter().map(|(bit, ..)| *bit).max().unwrap() + 136 * (sends.len() as i64 + 1);
    for bit in 0..last {
        for (_, end, id) in sends.iter().filter(|(sent, ..)| *sent == bit) {
            queues[*end].push((bit, *id));
        }
        if busy_bits == 0 {
            over.extend(on_the_wire.take().map(|id| (bit, id)));
            let ends: Vec<usize> = (0..4).filter(|end| !queues[*end].is_empty()).collect();
            if !ends.is_empty() {
                let heads: Vec<_> = ends.iter().map(|end| queues[*end][0]).collect();
                on_the_wire = Some(queues[ends[pick(&heads)]].remove(0).1);
                busy_bits = 135;
            }
        }
        busy_bits = i64::max(busy_bits - 1, 0);
    }
    over
}

fn lowest(heads: &[(i64, u16)]) -> usize {
    (0..heads.len()).min_by_key(|head| heads[*head].1).unwrap()
}

fn first_come(heads: &[(i64, u16)]) -> usize {
    (0..heads.len()).min_by_key(|head| heads[*head].0).unwrap()
}

/// Returns the same on the simulated bus; `looks` is how often the bus is read in between.
fn simulated(sends: &[Sent], looks: usize) -> Vec<(i64, u16)> {
    let bench = Bench::new(CAN, BusModel::default());
    let ends: [SimulatedLink; 4] = bench.ends();
    let listener = bench.bus.attach();
    let mut all = Vec::new();
    for (number, (bit, end, id)) in sends.iter().enumerate() {
        bench.clock.advance_to(START + Span::from_ns(bit * BIT_NS));
        if looks > 0 && number % looks == 0 {
            all.extend(got(&listener));
        }
        ends[*end].put(&frame(*id)).unwrap();
    }
    bench.advance(FRAME_SPAN_OF_ALL);
    all.extend(got(&listener));
    let id = |packet: &Packet| if let Packet::Can(frame) = packet { frame.id().parts().0 } else { 0 };
    all.iter().map(|(at, packet)| ((*at - START).ns() / BIT_NS, id(packet))).collect()
}

/// 60 frames and more.
const FRAME_SPAN_OF_ALL: Span = Span::from_ms(100);

#[test]
fn random_traffic_is_that_of_a_bus_stepped_bit_by_bit() {
    let mut differs_from_first_come = 0;
    for seed in 0..40 {
        let mut dice = StdRng::seed_from_u64(seed);
        let mut bit = 0;
        let sends: Vec<Sent> = (0..60)
            .map(|number| {
                bit += dice.random_range(0..200);
                // Identifiers are unlike between ends, as on any bus.
                (bit, dice.random_range(0..4), dice.random_range(0..25) * 80 + number)
            })
            .collect();
        let wanted = stepped(&sends, lowest);
        assert_eq!(simulated(&sends, 0), wanted, "seed {seed}");
        assert_eq!(simulated(&sends, 1), wanted, "seed {seed}: whenever the bus is read");
        assert_eq!(simulated(&sends, 7), wanted, "seed {seed}: now and then");
        differs_from_first_come += u32::from(stepped(&sends, first_come) != wanted);
    }
    assert!(differs_from_first_come > 30, "negative control: {differs_from_first_come} of 40");
}

#[test]
fn a_full_transmit_queue_gives_up_the_newest() {
    let bench = Bench::new(CAN, BusModel { transmit_packets: 2, ..BusModel::default() });
    let [mut a, listener] = bench.ends();
    assert_eq!(a.space(), 2);
    for id in 0..3 {
        a.send(&frame(id)).unwrap();
    }
    assert_eq!((a.space(), a.counters().unsent), (0, 1));
    assert_eq!((a.departure(0), a.departure(2)), (Departure::Waiting, Departure::Never));
    bench.advance(Span::from_ms(5));
    assert_eq!(got(&listener).len(), 2);
    assert_eq!((a.departure(0), a.departure(1)), (Departure::At(START + FRAME), Departure::At(START + FRAME + FRAME)));
    assert_eq!(a.departure(3), Departure::AsReported, "never sent");
}

#[test]
fn old_departures_are_forgotten() {
    let bench = Bench::new(CAN, BusModel::default());
    let [mut a, _b] = bench.ends();
    for _ in 0..65 {
        a.send(&frame(1)).unwrap();
        bench.advance(FRAME);
    }
    assert_eq!(a.departure(0), Departure::AsReported);
    assert!(matches!(a.departure(1), Departure::At(_)));
}

#[test]
fn ends_come_and_go() {
    let bench = Bench::new(CAN, BusModel::default());
    let [mut a, b] = bench.ends();
    a.send(&frame(1)).unwrap();
    bench.advance(Span::from_ms(1));
    let late = bench.bus.attach();
    assert_eq!((late.end(), got(&late)), (2, Vec::new()), "receives nothing from before");
    a.send(&frame(2)).unwrap();
    drop(a);
    assert_eq!(bench.bus.statistics().ends, 2);
    let not_yet = bench.bus.attach();
    assert_eq!(not_yet.end(), 3, "the place of one with a frame to send is not given away");
    bench.advance(Span::from_ms(1));
    assert_eq!(got(&b).len(), 2, "what was queued still goes out");
    assert_eq!(got(&late).len(), 1);
    assert_eq!(bench.bus.attach().end(), 0, "a place that is free");
}
