//! Times of plain messages: tags of any epoch, arrival; jumps and repeats.

use super::{tests::params, *};

const START: Tai = Tai::from_ns(1_800_000_000_000_000_000);
const RATE: f64 = 0.01;

struct Bench {
    receiver: Receiver,
    ledger: Ledger,
}

fn bench() -> Bench {
    Bench { receiver: Receiver::new(params()).unwrap(), ledger: Ledger::default() }
}

fn record(time: PlainTime, turned_rad: f64) -> Stamped<Input> {
    let half = 0.5 * turned_rad;
    let attitude = PlainAttitude {
        q_wxyz: [half.cos(), -half.sin(), 0.0, 0.0],
        rate_rad_s: [RATE, 0.0, 0.0],
        acceleration_rad_s2: [0.0; 3],
    };
    let value = PlainRecord { time, attitude: Some(attitude), jitter_rad: None, observer: None };
    Stamped { at: START, value: Input::Plain(value) }
}

impl Bench {
    /// Sends an attitude of a steadily rotating body; it arrives this many milliseconds after the start.
    fn send(&mut self, arrives_ms: i64, time: impl Fn(Tai) -> PlainTime) {
        let arrives = START + Span::from_ms(arrives_ms);
        let input = record(time(arrives), RATE * (arrives - START).s());
        let input = Stamped { at: arrives, ..input };
        assert_eq!(self.receiver.accept_input(0, &input, &mut self.ledger), None);
    }

    fn accepted(&self) -> u64 {
        self.receiver.attitudes.history.counts().accepted
    }

    fn newest(&self) -> Tai {
        self.receiver.attitudes.history.newest().unwrap().at
    }

    fn count(&self, kind: EventKind) -> u64 {
        self.ledger.count(kind)
    }
}

#[test]
fn without_a_time_an_attitude_holds_when_it_arrives() {
    let mut bench = bench();
    bench.send(200, |_| PlainTime::Arrival);
    assert_eq!((bench.newest(), bench.accepted()), (START + Span::from_ms(200), 1));
    assert_eq!(bench.receiver.messages.iter().sum::<u64>(), 1);
}

#[test]
fn tag_of_any_epoch_is_placed_by_its_estimated_clock() {
    for epoch_ns in [0, -7_000_000_000_000, 1_700_000_000_000_000_000] {
        let mut bench = bench();
        for i in 0..200 {
            // Delays are 1 ms and more; the smallest delay is taken as the time of sending.
            let late = Span::from_ms(1 + i % 7);
            let tag = |at: Tai| PlainTime::Tag((at - late - START).ns() + epoch_ns);
            bench.send(10 * i + late.ns() / 1_000_000, tag);
        }
        let error = bench.newest() - (START + Span::from_ms(1990 + 1));
        assert!(error.ns().abs() < 200_000, "epoch {epoch_ns}: {} ns", error.ns());
        assert_eq!((bench.accepted(), bench.count(EventKind::ClockStepped)), (200, 0));
    }
}

#[test]
fn jump_of_the_tags_is_an_event_and_no_old_attitude_is_shown_as_new() {
    for (jump_ms, kind) in [(60_000, EventKind::ClockStepped), (-100_000, EventKind::ClockRestarted)] {
        let mut bench = bench();
        let tag = |offset_ms: i64| move |at: Tai| PlainTime::Tag((at - START).ns() + (offset_ms + 100_000) * 1_000_000);
        (0..50).for_each(|i| bench.send(10 * i, tag(0)));
        assert_eq!(bench.count(kind), 0, "control");
        (50..100).for_each(|i| bench.send(10 * i, tag(jump_ms)));
        assert_eq!(bench.count(kind), 1, "{jump_ms} ms");
        let error = bench.newest() - (START + Span::from_ms(990));
        assert!(error.ns().abs() < 1_000_000, "{jump_ms} ms: {} ns", error.ns());
    }
}

#[test]
fn sender_that_does_not_keep_real_time_is_an_event() {
    for (percent, wanted) in [(97, 2), (100, 0)] {
        let mut bench = bench();
        (0..2000).for_each(|i| bench.send(10 * i, |at| PlainTime::Tag((at - START).ns() / 100 * percent + 5)));
        assert_eq!(bench.count(EventKind::ClockRunsOff), wanted, "{percent} %");
    }
}

#[test]
fn overtaken_message_is_taken_and_its_tag_is_not_used_as_a_mark() {
    let mut bench = bench();
    let tag = |late_ms: i64| move |at: Tai| PlainTime::Tag((at - START).ns() + 5 - late_ms * 1_000_000);
    for i in 0..50 {
        // Of every ten messages two arrive after a newer one.
        let late_ms = match i % 10 {
            7 | 8 => 25,
            _ => 0,
        };
        bench.send(10 * i, tag(late_ms));
    }
    assert_eq!((bench.accepted(), bench.count(EventKind::ClockStepped)), (50, 0));
    assert_eq!(bench.receiver.attitudes.history.counts().out_of_order, 10);
}

#[test]
fn repeated_message_is_refused_and_its_attitude_stays_as_old_as_it_is() {
    let mut bench = bench();
    let tag = |at: Tai| PlainTime::Tag((at - START).ns() + 5);
    (0..50).for_each(|i| bench.send(10 * i, tag));
    let newest = bench.newest();
    // The sender hangs and repeats the same message.
    let hung = tag(START + Span::from_ms(490));
    (50..250).for_each(|i| bench.send(10 * i, |_| hung));
    assert_eq!((bench.accepted(), bench.count(EventKind::SampleRefused)), (50, 200));
    assert_eq!(bench.count(EventKind::ClockStepped), 0, "nothing of it is a mark");
    assert_eq!(bench.newest(), newest);
}

#[test]
fn jitter_beyond_a_degree_is_refused_and_counted() {
    let mut bench = bench();
    let send = |bench: &mut Bench, ms: i64, jitter_rad: f64| {
        let time = PlainTime::Arrival;
        let value = PlainRecord { time, attitude: None, jitter_rad: Some([0.0, jitter_rad, 0.0]), observer: None };
        let input = Stamped { at: START + Span::from_ms(ms), value: Input::Plain(value) };
        bench.receiver.accept_input(0, &input, &mut bench.ledger);
    };
    for (ms, rad) in [(0, 0.01745), (1, 0.01746), (2, 1e9), (3, 1e300), (4, -0.01745)] {
        send(&mut bench, ms, rad);
    }
    let counts = bench.receiver.mountings.of(0).jitter.counts();
    assert_eq!((counts.accepted, counts.too_fast, bench.count(EventKind::SampleRefused)), (2, 3, 3));
}

#[test]
fn rates_that_contradict_the_attitudes_are_an_event_a_second() {
    for (factor, wanted) in [(1.0, 0), (57.3, 5), (-1.0, 5)] {
        let mut bench = bench();
        for i in 0..=500 {
            let arrives = START + Span::from_ms(10 * i);
            let mut input = record(PlainTime::Arrival, RATE * (arrives - START).s());
            if let Input::Plain(PlainRecord { attitude: Some(attitude), .. }) = &mut input.value {
                attitude.rate_rad_s[0] *= factor;
            }
            bench.receiver.accept_input(0, &Stamped { at: arrives, ..input }, &mut bench.ledger);
        }
        assert_eq!((bench.accepted(), bench.count(EventKind::RatesContradict)), (501, wanted), "{factor}");
    }
}
