//! Every fault does what it says, as often as it says, and only in its time.

use super::{Arrival, FaultControl, FaultyLink, LinkFault};
use crate::simulated::{BusParams, BusTiming, SimulatedLink, simulated_pair};
use crate::{Link, Packet, Stamped};
use base::clock::{Clock, Virtual};
use base::time::{Span, Tai};
use firmware_protocol::can::{CanFrame, CanId};
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

fn standard(number: u16) -> CanId {
    CanId::standard(number).unwrap()
}

fn packet(n: u16) -> Packet {
    Packet::Can(CanFrame::classic(n % 0x7FF, &n.to_le_bytes()).unwrap())
}

impl Bench {
    /// Sends a packet each millisecond and returns those that arrive.
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
        Packet::Serial(_) | Packet::Datagram(_) => -1,
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

fn number_of(packet: &Stamped<Packet>) -> u16 {
    match packet.value {
        Packet::Can(frame) => u16::from_le_bytes([frame.data()[0], frame.data()[1]]),
        Packet::Serial(_) | Packet::Datagram(_) => panic!("a CAN frame"),
    }
}

#[test]
fn packets_that_are_held_back_are_overtaken_and_none_is_lost() {
    let mut bench = bench(8);
    let by = Span::from_ns(2_500_000);
    bench.always(LinkFault::Reorder { share: 0.3, by });
    let arrived = bench.run(PACKETS);
    assert!(arrived.is_sorted_by_key(|packet| packet.at), "stamped when they arrive");
    let mut numbers: Vec<u16> = arrived.iter().map(number_of).collect();
    // Sent each millisecond: a packet held back for 2.5 ms follows the next two, unless they are held back too.
    let overtaken = numbers.windows(2).filter(|pair| pair[0] > pair[1]).count();
    assert!(overtaken > 100, "{overtaken}");
    let late = arrived.iter().filter(|packet| packet.at - (START + Span::from_ms(i64::from(number_of(packet)))) >= by);
    assert_eq!(late.count() as u64, bench.hits());
    assert!((bench.hits() as f64 - 300.0).abs() < FOUR_SIGMA, "{}", bench.hits());
    numbers.sort_unstable();
    assert!(numbers.into_iter().eq(0..PACKETS), "each once");
}

#[test]
fn cut_packets_are_shorter_and_begin_as_they_were() {
    let mut bench = bench(9);
    bench.always(LinkFault::Truncate { share: 1.0 });
    let mut lengths = [0; 3];
    for (n, arrived) in (0..PACKETS).zip(bench.run(PACKETS)) {
        let (Packet::Can(got), Packet::Can(whole)) = (arrived.value, packet(n)) else { panic!("CAN frames") };
        assert!(got.id() == whole.id() && whole.data().starts_with(got.data()), "{n}");
        lengths[got.data().len()] += 1;
    }
    assert!(lengths[0] > 400 && lengths[1] > 400 && lengths[2] == 0, "of two bytes none or one is left: {lengths:?}");
    assert_eq!(bench.hits(), u64::from(PACKETS));
    // An FD frame has only some lengths; a chunk any; an empty one cannot be cut.
    let mut dice = rand::SeedableRng::seed_from_u64(1);
    for _ in 0..1000 {
        let whole = CanFrame::fd(1, &[7; 48]).unwrap();
        let mut cut = Packet::Can(whole);
        assert!(super::damage::cut_the_tail(&mut cut, &mut dice));
        let Packet::Can(frame) = cut else { panic!("CAN") };
        assert!(frame.is_fd() && frame.data().len() < 48 && CanFrame::fd(1, frame.data()).is_some());
    }
    assert!(!super::damage::cut_the_tail(&mut Packet::Can(CanFrame::classic(1, &[]).unwrap()), &mut dice));
}

#[test]
fn babble_comes_each_period_in_its_time_between_the_others() {
    let mut bench = bench(10);
    let (from, until) = (START + Span::from_ms(100), START + Span::from_ms(200));
    let period = Span::from_ns(300_000);
    bench.control.add(from, until, LinkFault::Babble { id: standard(0x7FF), period, bytes: 8 });
    let arrived = bench.run(1000);
    let is_babble = |packet: &&Stamped<Packet>| matches!(packet.value, Packet::Can(frame) if frame.id() == 0x7FF);
    let babble: Vec<_> = arrived.iter().filter(is_babble).collect();
    assert_eq!(babble.len(), 334, "each 0.3 ms of 100 ms, the first at once");
    assert_eq!(bench.hits(), 334);
    assert_eq!((babble[0].at, babble[1].at), (from, from + period));
    assert!(babble.iter().all(|packet| from <= packet.at && packet.at < until));
    assert_ne!(babble[0].value, babble[1].value, "random content");
    assert!(arrived.is_sorted_by_key(|packet| packet.at));
    assert_eq!(arrived.len(), 1334, "other packets are not delayed");
}

#[test]
fn how_often_the_receiver_looks_changes_nothing() {
    let run = |looks_per_ms: i64| {
        let mut bench = bench(11);
        bench.always(LinkFault::Loss { share: 0.2 });
        bench.always(LinkFault::Babble { id: standard(1), period: Span::from_ns(700_000), bytes: 5 });
        bench.always(LinkFault::Reorder { share: 0.3, by: Span::from_ns(1_700_000) });
        bench.always(LinkFault::WrongBits { share: 0.3 });
        let mut arrived = Vec::new();
        for step in 0..400 * looks_per_ms {
            bench.clock.advance_to(START + Span::from_ns(step * 1_000_000 / looks_per_ms));
            if step % (4 * looks_per_ms) == 0 {
                bench.far.send(&packet(u16::try_from(step / looks_per_ms).unwrap())).unwrap();
            }
            arrived.extend(core::iter::from_fn(|| bench.near.receive(START).unwrap()));
        }
        bench.clock.advance_to(START + Span::from_ms(500));
        arrived.extend(core::iter::from_fn(|| bench.near.receive(START).unwrap()));
        arrived
    };
    let often = run(10);
    assert!(often.len() > 500, "{}", often.len());
    assert_eq!(often, run(1));
}

#[test]
fn a_clock_that_steps_or_drifts_changes_stamps_and_not_the_time_of_arrival() {
    let (begin, end) = (START + Span::from_ms(100), START + Span::from_ms(300));
    for by in [Span::from_ms(7), Span::from_ms(-7)] {
        let mut bench = bench(12);
        bench.control.add(begin, end, LinkFault::ClockStep { by });
        for (n, packet) in (0..1000).zip(bench.run(1000)) {
            assert_eq!(i64::from(number_of(&packet)), n, "in order of arrival, whatever the stamps say");
            let off = packet.at - (START + Span::from_ms(n));
            let wanted = if (100..300).contains(&n) { by } else { Span::ZERO };
            assert!((off.ns() - wanted.ns()).abs() < 300_000, "{n}: {} ms", off.ms());
        }
        assert_eq!(bench.hits(), 200);
    }
    let mut bench = bench(13);
    bench.control.add(begin, end, LinkFault::ClockDrift { ppm: 10_000.0 });
    let arrived = bench.run(1000);
    let off_ms = |n: usize| (arrived[n].at - (START + Span::from_ms(n as i64))).ms();
    let on_the_wire_ms = off_ms(50);
    // One per cent of the time since the start of the fault.
    for (n, wanted_ms) in [(99, 0.0), (110, 0.1), (200, 1.0), (299, 1.99), (300, 0.0)] {
        let got_ms = off_ms(n) - on_the_wire_ms;
        assert!((got_ms - wanted_ms).abs() < 0.005, "{n}: {got_ms} ms");
    }
}

#[test]
fn off_the_bus_nothing_comes_and_nothing_goes() {
    let mut bench = bench(14);
    let (from, until) = (START + Span::from_ms(100), START + Span::from_ms(200));
    bench.control.add(from, until, LinkFault::Off);
    let mut went = 0;
    for n in 0..300 {
        bench.clock.advance_to(START + Span::from_ms(n));
        bench.far.send(&packet(1)).unwrap();
        bench.near.send(&packet(2)).unwrap();
        bench.clock.advance_to(START + Span::from_ms(n) + Span::from_ns(500_000));
        let came = bench.near.receive(START).unwrap().is_some();
        went += usize::from(bench.far.receive(START).unwrap().is_some());
        assert_eq!(came, !(100..200).contains(&n), "{n}");
    }
    assert_eq!(went, 200);
    assert_eq!(bench.hits(), 200, "each way");
    let counters = bench.near.counters();
    assert_eq!((counters.unsent, counters.bus_off), (100, 1));
}

#[test]
fn waiting_packets_are_bounded_and_counted() {
    let mut bench = bench(15);
    let period = Span::from_ns(50_000);
    bench.control.add(START, START + Span::from_s(10.0), LinkFault::Babble { id: standard(1), period, bytes: 8 });
    bench.clock.advance_to(START + Span::from_s(20.0));
    let arrived = core::iter::from_fn(|| bench.near.receive(START).unwrap()).count() as u64;
    assert_eq!(arrived, 65_536);
    assert_eq!(arrived + bench.near.counters().overflows, 200_000);
}

#[test]
fn a_fault_says_how_much_of_it_there_is_and_when_packets_come() {
    let ms = Span::from_ms;
    let delay = LinkFault::Delay { by: ms(20), jitter: ms(5) };
    let babble = LinkFault::Babble { id: standard(0x12), period: ms(2), bytes: 8 };
    for (fault, text, arrival) in [
        (LinkFault::Loss { share: 0.25 }, "25 % of the packets", Arrival::AsSent),
        (delay, "20 ms, jitter 5 ms", Arrival::Late(ms(25))),
        (babble, "identifier 0x012, 8 bytes, each 2 ms", Arrival::AsSent),
        (LinkFault::ClockStep { by: ms(-20) }, "-20 ms", Arrival::Misstamped(ms(-20))),
        (LinkFault::ClockDrift { ppm: 50.0 }, "50 ppm", Arrival::Misstamped(ms(1))),
        (LinkFault::Off, "", Arrival::AsSent),
    ] {
        assert_eq!((fault.to_string().as_str(), fault.arrival(ms(20_000))), (text, arrival));
    }
}

#[test]
fn damage_keeps_the_length_of_the_identifier() {
    use super::damage::{babble, cut_the_tail, flip_a_bit};
    use crate::WireFormat;
    let mut dice = rand::SeedableRng::seed_from_u64(2);
    for id in [standard(0x123), CanId::extended(0x123).unwrap()] {
        for frame in [CanFrame::classic(id, &[7; 8]), CanFrame::fd(id, &[7; 48])] {
            let (mut flipped, mut cut) = (Packet::Can(frame.unwrap()), Packet::Can(frame.unwrap()));
            flip_a_bit(&mut flipped, &mut dice);
            assert!(cut_the_tail(&mut cut, &mut dice));
            let kind = if frame.unwrap().is_fd() { WireFormat::CanFd } else { WireFormat::CanClassic };
            let noise = babble(kind, id, 8, &mut dice).unwrap();
            for packet in [flipped, cut, noise] {
                let Packet::Can(spoilt) = packet else { panic!("CAN") };
                assert_eq!((spoilt.id(), spoilt.is_fd()), (id, frame.unwrap().is_fd()));
            }
        }
    }
    let [short, long] = [standard(0x123), CanId::extended(0x123).unwrap()]
        .map(|id| LinkFault::Babble { id, period: Span::from_ms(1), bytes: 8 }.to_string());
    assert!(short.contains("identifier 0x123,") && long.contains("identifier 0x00000123,"), "{short}; {long}");
}

#[test]
fn datagrams_are_damaged_as_other_packets_are() {
    use super::damage::{babble, cut_the_tail, flip_a_bit};
    use crate::{Datagram, WireFormat};
    use rand::{SeedableRng, rngs::StdRng};
    let mut dice = StdRng::seed_from_u64(1);
    let whole = Packet::Datagram(Datagram::new(&[0; 64]).unwrap());
    let mut flipped = whole;
    flip_a_bit(&mut flipped, &mut dice);
    let ones: u32 = flipped.data().iter().map(|byte| byte.count_ones()).sum();
    assert_eq!((flipped.data().len(), ones), (64, 1));
    let mut cut = whole;
    assert!(cut_the_tail(&mut cut, &mut dice) && cut.data().len() < 64);
    let noise = babble(WireFormat::Plain, standard(0), 20, &mut dice).unwrap();
    assert!(matches!(noise, Packet::Datagram(_)) && noise.data().len() == 20);
}
