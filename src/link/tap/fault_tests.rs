//! Every fault does what it says, as often as it says, and only in its time.

use super::{FaultControl, FaultyLink, LinkFault};
use crate::base::clock::{Clock, Virtual};
use crate::base::time::{Span, Tai};
use crate::link::simulated::{BusParams, BusTiming, SimulatedLink, simulated_pair};
use crate::link::{Link, Packet, Stamped};
use firmware_protocol::can::CanFrame;
use std::sync::Arc;

const START: Tai = Tai::from_ns(1_000_000_000);
const PACKETS: u16 = 1000;
/// Four sigma of a binomial count of 1000 at 0.3: false alarm below 1e-4, once for the fixed seed.
const FOUR_SIGMA: f64 = 4.0 * 14.5;

struct Bench {
    clock: Arc<Virtual>,
    near: FaultyLink,
    far: SimulatedLink,
    control: FaultControl,
}

fn bench(seed: u64) -> Bench {
    let clock = Arc::new(Virtual::new(START));
    let shared: Arc<dyn Clock> = Arc::<Virtual>::clone(&clock);
    let timing = BusTiming::CanClassic { bit_rate_bps: 1_000_000 };
    let bus = BusParams { name: "test".into(), timing, latency: Span::ZERO, queue_packets: 64 };
    let (near, far) = simulated_pair(bus, &shared);
    let control = FaultControl::default();
    Bench { near: FaultyLink::new(Box::new(near), shared, control.clone(), seed), clock, far, control }
}

fn packet(n: u16) -> Packet {
    Packet::Can(CanFrame::classic(n % 0x7FF, &n.to_le_bytes()).unwrap())
}

impl Bench {
    /// Sends a packet each millisecond; what arrives.
    fn run(&mut self, packets: u16) -> Vec<Stamped<Packet>> {
        let mut arrived = Vec::new();
        for n in 0..packets {
            self.clock.advance_to(START + Span::from_ms(i64::from(n)));
            self.far.send(&packet(n)).unwrap();
            while let Some(packet) = self.near.receive(START).unwrap() {
                arrived.push(packet);
            }
        }
        self.clock.advance_to(START + Span::from_s(100.0));
        while let Some(packet) = self.near.receive(START).unwrap() {
            arrived.push(packet);
        }
        arrived
    }

    fn always(&self, fault: LinkFault) {
        self.control.add(START, START + Span::from_s(100.0), fault);
    }

    fn hits(&self) -> u64 {
        self.control.timed()[0].hits
    }
}

#[test]
fn without_a_fault_everything_passes_unchanged() {
    let arrived = bench(1).run(PACKETS);
    let wanted: Vec<Packet> = (0..PACKETS).map(packet).collect();
    assert!(arrived.iter().map(|packet| packet.value).eq(wanted));
}

#[test]
fn a_share_is_lost_or_doubled_and_counted() {
    for (fault, sign) in [(LinkFault::Loss { share: 0.3 }, -1.0), (LinkFault::Duplicate { share: 0.3 }, 1.0)] {
        let mut bench = bench(2);
        bench.always(fault);
        let change = sign * (bench.run(PACKETS).len() as f64 - f64::from(PACKETS));
        assert!((change - 300.0).abs() < FOUR_SIGMA, "{fault:?}: {change}");
        assert_eq!(change, bench.hits() as f64, "what was done is what was counted");
    }
}

#[test]
fn silence_begins_and_ends_in_its_time() {
    let mut bench = bench(3);
    bench.control.add(START + Span::from_ms(100), START + Span::from_ms(200), LinkFault::Silence);
    let arrived = bench.run(PACKETS);
    assert_eq!(arrived.len(), usize::from(PACKETS) - 100);
    let inside =
        |packet: &&Stamped<Packet>| (START + Span::from_ms(100)..START + Span::from_ms(200)).contains(&packet.at);
    assert_eq!(arrived.iter().filter(inside).count(), 0);
    assert_eq!(bench.hits(), 100);
}

#[test]
fn delayed_packets_arrive_later_by_as_much_as_said_and_may_overtake() {
    let mut bench = bench(4);
    let (by, jitter) = (Span::from_ms(20), Span::from_ms(5));
    bench.always(LinkFault::Delay { by, jitter });
    let arrived = bench.run(PACKETS);
    assert_eq!(arrived.len(), usize::from(PACKETS));
    assert!(arrived.is_sorted_by_key(|packet| packet.at), "handed on in order of arrival");
    let number = |packet: &Stamped<Packet>| match packet.value {
        Packet::Can(frame) => i64::from(u16::from_le_bytes([frame.data()[0], frame.data()[1]])),
        Packet::Serial(_) => -1,
    };
    let mut overtaken = 0;
    for pair in arrived.windows(2) {
        overtaken += u32::from(number(&pair[0]) > number(&pair[1]));
    }
    for packet in &arrived {
        let late = packet.at - (START + Span::from_ms(number(packet)));
        assert!(late >= by && late < by + jitter + Span::from_ms(1), "{} ms", late.ms());
    }
    assert!(overtaken > 100, "jitter of five periods reorders: {overtaken}");
}

#[test]
fn wrong_bits_are_one_bit_each() {
    let mut bench = bench(5);
    bench.always(LinkFault::WrongBits { share: 1.0 });
    for (n, packet) in (0..PACKETS).zip(bench.run(PACKETS)) {
        let Packet::Can(frame) = packet.value else { panic!("a CAN frame") };
        let got = u16::from_le_bytes([frame.data()[0], frame.data()[1]]);
        assert_eq!((got ^ n).count_ones(), 1, "{n}: {got}");
    }
}

#[test]
fn the_seed_decides() {
    let run = |seed| {
        let mut bench = bench(seed);
        bench.always(LinkFault::Loss { share: 0.5 });
        bench.run(PACKETS).len()
    };
    let lost: Vec<usize> = [7, 7, 8].into_iter().map(run).collect();
    assert_eq!(lost[0], lost[1]);
    assert_ne!(lost[0], lost[2]);
}
