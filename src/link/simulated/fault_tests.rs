//! Error frames, bus-off and babbling: counted by hand from the rules of the standard.

use super::arbitration_tests::{Bench, frame, got};
use super::*;
use crate::{Departure, Link, Packet, SerialChunk};
use base::clock::Clock;
use base::time::{Span, Tai};
use firmware_protocol::can::CanId;

const START: Tai = Tai::from_ns(1_000_000_000);
const END: Tai = Tai::from_ns(i64::MAX);
const CAN: BusTiming = BusTiming::CanClassic { bit_rate_bps: 500_000 };
const BIT: Span = Span::from_ns(2000);
const FRAME: Span = bits(135);
/// 128 times 11 recessive bits.
const RECOVERY: Span = bits(1408);

const fn bits(count: i64) -> Span {
    Span::from_ns(count * BIT.ns())
}

fn standard(number: u16) -> CanId {
    CanId::standard(number).unwrap()
}

fn bench(seed: u64) -> Bench {
    Bench::new(CAN, BusModel { seed, ..BusModel::default() })
}

#[test]
fn a_destroyed_frame_is_sent_again_after_an_error_frame() {
    for seed in 0..200 {
        let bench = bench(seed);
        let [mut a, b] = bench.ends();
        let fault = bench.bus.control().add(START, START + Span::from_ns(1), BusFault::BitErrors { share: 1.0 });
        a.send(&frame(1)).unwrap();
        bench.advance(Span::from_ms(5));
        let arrivals = got(&b);
        assert_eq!(arrivals.len(), 1, "once");
        let lost = arrivals[0].0 - FRAME - START;
        // An error within the 132 bits of the frame, then 17 to 23 bits.
        assert!(lost > bits(17) && lost <= bits(132 + 23), "seed {seed}: {lost:?}");
        assert_eq!(a.departure(0), Departure::At(arrivals[0].0));
        assert_eq!((a.error_counters().transmit, b.error_counters().receive), (7, 0), "8 up, 1 down; 1 up, 1 down");
        assert_eq!((a.counters().errors, b.counters().errors, a.counters().sent), (1, 1, 1));
        assert_eq!(bench.bus.control().timed()[fault].hits, 1);
        assert_eq!((bench.bus.statistics().frames, bench.bus.statistics().error_frames), (1, 1));
    }
}

#[test]
fn thirty_two_errors_in_a_row_put_a_controller_off_the_bus() {
    let bench = bench(3);
    let [mut a, mut b, listener] = bench.ends();
    bench.bus.control().add(START, START + Span::from_ms(20), BusFault::BitErrors { share: 1.0 });
    a.send(&frame(1)).unwrap();
    a.send(&frame(2)).unwrap();
    while a.error_counters().state() != ErrorState::BusOff {
        assert!(bench.clock.now() < START + Span::from_ms(20), "32 errors take less than 9 ms");
        bench.advance(Span::from_ns(1000));
    }
    assert_eq!((a.counters().errors, a.counters().bus_off, a.counters().unsent), (32, 1, 2));
    assert_eq!((b.error_counters().receive, b.error_counters().state()), (32, ErrorState::Active));
    a.send(&frame(3)).unwrap();
    assert_eq!((a.counters().unsent, a.departure(2)), (3, Departure::Never));
    // Others go on, and their frames count towards the recovery.
    bench.clock.advance_to(START + Span::from_ms(25));
    assert_eq!(a.error_counters().state(), ErrorState::Active, "2.8 ms of silence are long over");
    b.send(&frame(4)).unwrap();
    a.send(&frame(5)).unwrap();
    bench.advance(Span::from_ms(1));
    let order: Vec<_> = got(&listener).into_iter().map(|(_, packet)| packet).collect();
    assert_eq!(order, [4, 5].map(frame));
}

#[test]
fn an_error_passive_controller_pauses_for_eight_bits() {
    // First run: when is the counter at 128? Second run: no error from then on.
    let passive_at = |until: Tai| {
        let bench = bench(8);
        let [mut a, b] = bench.ends();
        bench.bus.control().add(START, until, BusFault::BitErrors { share: 1.0 });
        a.send(&frame(1)).unwrap();
        while a.error_counters().state() == ErrorState::Active {
            bench.advance(Span::from_ns(100));
        }
        let passive_at = bench.clock.now();
        bench.advance(Span::from_ms(1));
        (passive_at, got(&b).first().map(|(at, _)| *at))
    };
    let (passive, none) = passive_at(END);
    assert_eq!(none, None);
    let (_, arrival) = passive_at(passive);
    let pause = arrival.expect("sent without errors") - FRAME - passive;
    assert!(pause.ns() > bits(8).ns() - 100 && pause <= bits(8), "{pause:?}");
}

#[test]
fn a_share_of_the_frames_is_destroyed_and_none_is_lost() {
    let bench = bench(5);
    let [mut a, b] = bench.ends();
    let control = bench.bus.control();
    control.add(START, END, BusFault::BitErrors { share: 0.1 });
    for id in 0..5000 {
        a.send(&frame(id % 0x700)).unwrap();
        bench.advance(FRAME + FRAME);
    }
    bench.advance(Span::from_s(1.0));
    assert_eq!(got(&b).len(), 5000);
    let destroyed = control.timed()[0].hits;
    assert_eq!(destroyed, bench.bus.statistics().error_frames);
    // Geometric: 5000 * 0.1 / 0.9 = 556 expected, standard deviation sqrt(5000 * 0.1) / 0.9 = 25; 5 of them.
    assert!((430..=682).contains(&destroyed), "{destroyed}");
}

#[test]
fn a_controller_put_off_comes_back_after_128_times_11_recessive_bits() {
    let bench = bench(0);
    let [mut a, mut b] = bench.ends();
    let (from, until) = (START + Span::from_ms(1), START + Span::from_ms(3));
    bench.bus.control().add(from, until, BusFault::BusOff { end: a.end() });
    let mut send_at = |at: Tai| {
        bench.clock.advance_to(at);
        a.send(&frame(1)).unwrap();
        a.counters().unsent
    };
    assert_eq!(send_at(from - FRAME), 0, "over just before");
    assert_eq!(send_at(from), 1);
    assert_eq!(send_at(until), 2);
    assert_eq!(send_at(until + RECOVERY - Span::from_ns(1)), 3);
    assert_eq!(send_at(until + RECOVERY), 3, "back");
    bench.advance(FRAME);
    assert_eq!(got(&b).len(), 2);
    assert_eq!((a.counters().bus_off, bench.bus.control().timed()[0].hits), (1, 1));
    b.send(&frame(2)).unwrap();
    bench.advance(FRAME);
    assert_eq!(got(&a).len(), 1, "and receives");
}

#[test]
fn a_controller_that_is_off_receives_nothing_and_counts_frames_on_its_way_back() {
    let bench = bench(0);
    let [a, mut b] = bench.ends();
    bench.bus.control().add(START, START + Span::from_ns(1), BusFault::BusOff { end: a.end() });
    // Back to back, each frame ends with one run of 11 recessive bits: 128 frames.
    let mut frames = 0;
    while a.error_counters().state() == ErrorState::BusOff {
        b.send(&frame(1)).unwrap();
        bench.advance(FRAME);
        frames += 1;
    }
    assert_eq!(frames, 128);
    assert_eq!(got(&a).len(), 0);
    assert_eq!(b.counters().sent, 128, "the others go on");
}

#[test]
fn a_babbling_node_with_a_low_identifier_keeps_everyone_else_waiting() {
    let bench = bench(0);
    let [mut a, b] = bench.ends();
    let until = START + Span::from_ms(10);
    bench.bus.control().add(START, until, BusFault::Babble { id: standard(0), share_of_bandwidth: 1.0 });
    a.send(&frame(1)).unwrap();
    bench.clock.advance_to(until);
    assert_eq!(a.departure(0), Departure::Waiting);
    let load = bench.bus.statistics().load();
    assert!((load - 1.0).abs() < 1e-12, "back to back: {load}");
    bench.advance(Span::from_ms(1));
    // 38 frames of 0.27 ms start within 10 ms, the last at 9.99 ms.
    assert_eq!(a.departure(0), Departure::At(START + bits(39 * 135)));
    assert_eq!((got(&a).len(), got(&b).len(), bench.bus.control().timed()[0].hits), (38, 39, 38));
    assert_eq!(bench.bus.statistics().babbled, 38);
}

#[test]
fn a_babbling_node_with_a_high_identifier_costs_one_frame_at_most() {
    let bench = bench(0);
    let [mut a, _b] = bench.ends();
    bench.bus.control().add(START, END, BusFault::Babble { id: standard(0x7FF), share_of_bandwidth: 1.0 });
    for number in 0..100 {
        bench.advance(Span::from_ns(1_234_567));
        a.send(&frame(1)).unwrap();
        let sent_at = bench.clock.now();
        bench.advance(FRAME + FRAME);
        let Departure::At(left) = a.departure(number) else { panic!("has not left") };
        assert!(left - sent_at <= FRAME + FRAME, "{:?}", left - sent_at);
    }
}

#[test]
fn half_the_bandwidth_is_half_the_load() {
    let bench = bench(0);
    let _ends: [SimulatedLink; 2] = bench.ends();
    bench.bus.control().add(START, END, BusFault::Babble { id: standard(9), share_of_bandwidth: 0.5 });
    bench.advance(bits(270 * 100));
    assert_eq!(bench.bus.statistics().frames, 100);
    let load = bench.bus.statistics().load();
    assert!((load - 0.5).abs() < 1e-6, "{load}");
}

#[test]
fn the_seed_decides_and_looking_does_not() {
    let run = |seed: u64, look: Span| {
        let bench = bench(seed);
        let [mut a, mut b, listener] = bench.ends();
        let control = bench.bus.control();
        control.add(START, END, BusFault::BitErrors { share: 0.3 });
        control.add(
            START + Span::from_ms(3),
            START + Span::from_ms(4),
            BusFault::Babble { id: standard(2), share_of_bandwidth: 0.7 },
        );
        // Mostly in the middle of a frame.
        let off = START + Span::from_ns(5_000_000 + 41_000 * i64::try_from(seed).unwrap());
        control.add(off, off + Span::from_ms(1), BusFault::BusOff { end: 1 });
        let mut all = Vec::new();
        for step in 0..40 {
            let next = START + bits(150 * step);
            while look > Span::ZERO && bench.clock.now() + look < next {
                bench.advance(look);
                all.extend(got(&listener));
            }
            bench.clock.advance_to(next);
            a.send(&frame(3)).unwrap();
            if step % 3 == 0 {
                b.send(&frame(1)).unwrap();
            }
        }
        bench.advance(Span::from_ms(50));
        all.extend(got(&listener));
        let counters = (a.counters(), b.counters(), a.error_counters(), b.error_counters());
        (all, got(&a), got(&b), counters)
    };
    for seed in 0..30 {
        let wanted = run(seed, Span::ZERO);
        let (all, _, _, (a, b, ..)) = &wanted;
        assert!(all.len() > 40 && a.errors > 0 && b.unsent > 0, "{wanted:?}");
        for look_ns in [777, 25_000, 111_111] {
            assert_eq!(run(seed, Span::from_ns(look_ns)), wanted, "seed {seed}, looked every {look_ns} ns");
        }
        assert_ne!(run(seed + 1, Span::ZERO).0, wanted.0, "another seed");
    }
}

#[test]
fn serial_line_ignores_can_faults() {
    let bench = Bench::new(BusTiming::Serial { baud: 1_000_000 }, BusModel::default());
    let [mut a, b] = bench.ends();
    let control = bench.bus.control();
    control.add(START, END, BusFault::BitErrors { share: 1.0 });
    control.add(START, END, BusFault::Babble { id: standard(1), share_of_bandwidth: 1.0 });
    control.add(START, END, BusFault::BusOff { end: 0 });
    a.send(&Packet::Serial(SerialChunk::new(&[7; 10]).unwrap())).unwrap();
    bench.advance(Span::from_ms(1));
    assert_eq!(got(&b).len(), 1);
    assert!(control.timed().iter().all(|timed| timed.hits == 0));
}
