//! Tests triggers of the flight computer: each acts once, in the frame that contains its instant, and again in a
//! replay.

use crate::bench::{built_in, fly_head, start};
use base::clock::{Clock, Virtual};
use base::time::{Span, Tai};
use config::Bench;
use firmware_protocol::can::{Decoder, IdMap};
use frames::sink::NullSink;
use link::capture::{CaptureFormat, CaptureReader, CapturedPacket, Direction};
use link::{Packet, Port, Stamped};
use link::{simulated::simulated_pair, tap::Capture};
use run::runtime::{EventKind, FrameEngine, Head, Ledger, RunOutcome};
use run::{runtime::ledger::Event, runtime::receiver::Receiver, wiring::bench_parts};
use std::sync::Arc;
use testbed::flight_computer::{FlightComputer, TriggerAnswers};

/// Accuracy of an instant of the far clock after two seconds of time marks.
const CLOCK: Span = Span::from_ns(100_000);

/// Time of sending, number, time of action; seconds after the start.
type Sent = (f64, u16, Option<f64>);

/// Triggers at once and ahead, in another order than that in which they act; the last but one comes after its instant,
/// the last acts after the run.
const SENT: [Sent; 6] = [
    (1.52, 7, None),
    (1.60, 40_000, Some(3.02)),
    (1.61, 3, Some(2.33)),
    (1.62, 3, Some(2.33)),
    (2.55, 9, Some(1.25)),
    (2.60, 10, Some(60.0)),
];

/// The numbers of [`SENT`].
const NUMBERS: [u16; 5] = [3, 7, 9, 10, 40_000];

struct Flown {
    pixels_crc32: u32,
    outcome: RunOutcome,
    answers: TriggerAnswers,
    captured: Vec<CapturedPacket>,
    engine: FrameEngine,
    start: Tai,
}

/// Returns a receiver of a run whose faults wait for these numbers.
fn receiver(bench: &Bench, start: Tai, numbers: &[u16]) -> Receiver {
    let params = bench_parts::run_params(bench, start).unwrap();
    let mut receiver = Receiver::new(params.attitude).unwrap().with_session(bench.session);
    numbers.iter().for_each(|number| receiver.session.expect_trigger(*number));
    receiver
}

fn fly(bench: &Bench, sent: &[Sent], numbers: &[u16]) -> Flown {
    let start = start(bench);
    let engine = FrameEngine::new(bench_parts::run_params(bench, start).unwrap()).unwrap();
    let mut head = Head::new(engine, Box::new(NullSink::new()));
    let mut receiver = receiver(bench, start, numbers);
    let clock = Arc::new(Virtual::new(start));
    let shared: Arc<dyn Clock> = clock.clone();
    let (bus, format) = bench_parts::bus(bench);
    let ids = IdMap::new(0, 0).unwrap();
    let (near, far) = simulated_pair(bus, &shared);
    let file = tempfile::NamedTempFile::new().unwrap();
    let capture = Capture::start(Box::new(file.reopen().unwrap()), CaptureFormat::Pcapng, true).unwrap();
    let mut near = Port::new(Box::new(capture.tap(Box::new(near), 0)), format, ids);
    let mut far = Port::new(Box::new(far), format, ids);
    let mut computer = FlightComputer::new(bench_parts::flight_computer(bench, start));
    let mut left = sent.iter();
    let mut next = left.next();
    let outcome = fly_head(
        &mut head,
        &mut receiver,
        &mut near,
        &clock,
        &mut |now| {
            while let Some((_, number, at_s)) = next.filter(|(s, ..)| start + Span::from_s(*s) <= now) {
                computer.send_trigger(*number, at_s.map(|s| start + Span::from_s(s)), now).unwrap();
                next = left.next();
            }
            computer.step(now, &mut far)?;
            Ok(computer.next_due())
        },
        &mut |_, _| true,
    );
    assert!(outcome.error.is_none(), "{:?}", outcome.error.map(|error| error.to_string()));
    assert_eq!(capture.finish().lost, 0);
    let mut reader = CaptureReader::new(file.reopen().unwrap()).unwrap();
    let captured = core::iter::from_fn(|| reader.read().unwrap()).collect();
    let pixels_crc32 = outcome.summaries[0].as_ref().unwrap().run_crc32;
    Flown { pixels_crc32, outcome, answers: computer.trigger_answers(), captured, engine: head.engine, start }
}

/// Returns the instant and frame of the triggers that acted.
fn fired(ledger: &Ledger) -> Vec<(Tai, u32)> {
    let is_fired = |event: &&Event| event.kind == EventKind::TriggerFired;
    ledger.last().filter(is_fired).map(|event| (event.at, event.frame.unwrap())).collect()
}

fn only_triggers(ledger: &Ledger) -> [u64; 4] {
    let kinds = [EventKind::TriggerTaken, EventKind::TriggerLate, EventKind::TriggerFired, EventKind::TriggerForgotten];
    kinds.map(|kind| ledger.count(kind))
}

#[test]
fn triggers_act_once_each_in_the_frame_of_their_instant() {
    let flown = fly(&built_in(4.0), &SENT, &NUMBERS);
    assert_eq!(flown.answers, TriggerAnswers { taken: 6, late: 1, refused: 0 });
    assert_eq!(only_triggers(&flown.outcome.record.ledger), [5, 1, 5, 0]);
    let reported = fired(&flown.outcome.record.ledger);
    // Frames are exposed from 1 s on, every 0.1 s.
    for ((at, frame), wanted_s) in reported.iter().zip([1.52, 2.33, 2.33, 2.55, 3.02]) {
        let off = *at - (flown.start + Span::from_s(wanted_s));
        // At once and late act on arrival: after the sending step, and the bus.
        let most = if [1.52, 2.55].contains(&wanted_s) { Span::from_ms(11) } else { CLOCK };
        assert!(off.ns().abs() < most.ns(), "{wanted_s} s: {} us off", off.ns() / 1000);
        let slot = flown.engine.exposing.nominal(*frame);
        assert!(*at <= slot.release, "frame {frame} ends before {wanted_s} s");
        assert!(
            *frame == 0 || *at > flown.engine.exposing.nominal(frame - 1).release,
            "{wanted_s} s: an earlier one than {frame}"
        );
    }
    assert_eq!(reported.len(), 5, "the last one still waits");
}

#[test]
fn a_captured_run_has_the_same_triggers_when_it_is_replayed() {
    let bench = built_in(4.0);
    let flown = fly(&bench, &SENT, &NUMBERS);
    let replay = |packets: &[CapturedPacket]| {
        let mut receiver = receiver(&bench, flown.start, &NUMBERS);
        let (mut decoder, mut ledger) = (Decoder::new(IdMap::default()), Ledger::default());
        let received = packets.iter().filter(|packet| packet.direction == Direction::Received);
        let mut messages = received.filter_map(|captured| match captured.packet {
            Packet::Can(frame) => decoder.read(&frame).unwrap().map(|value| Stamped { at: captured.at, value }),
            Packet::Serial(_) | Packet::Datagram(_) => None,
        });
        let mut next = messages.next();
        let mut numbers = Vec::new();
        for slot in (0..flown.engine.params.frames).map(|number| flown.engine.exposing.nominal(number)) {
            while let Some(message) = next.filter(|message| message.at <= slot.release) {
                receiver.accept(0, &message.value, message.at, &mut ledger);
                next = messages.next();
            }
            receiver.session.fire_triggers(0, slot, &mut ledger, &mut |fired| numbers.push(fired.number));
        }
        (numbers, fired(&ledger))
    };
    let (numbers, reported) = replay(&flown.captured);
    assert_eq!(numbers, [7, 3, 3, 9, 40_000]);
    assert_eq!(
        reported,
        fired(&flown.outcome.record.ledger),
        "the same instants to the nanosecond, in the same frames"
    );
    // Negative control: the first trigger's frame is missing (6 is its opcode, at node 0).
    let is_trigger = |captured: &CapturedPacket| matches!(captured.packet, Packet::Can(frame) if frame.id() == 0x600 && frame.data()[0] == 6);
    let mut missing = flown.captured.clone();
    missing.remove(missing.iter().position(is_trigger).unwrap());
    assert_eq!(replay(&missing).0, [3, 3, 9, 40_000]);
}

/// Tests that a capture of protocol 1.2, which took every trigger, has the same pixels now that they are refused: on a
/// bench no fault waits for them.
#[test]
fn refused_triggers_leave_pixels_as_they_were_when_every_trigger_was_taken() {
    let bench = built_in(4.0);
    let (taken, refused) = (fly(&bench, &SENT, &NUMBERS), fly(&bench, &SENT, &[]));
    assert_eq!(taken.answers, TriggerAnswers { taken: 6, late: 1, refused: 0 });
    assert_eq!(refused.answers, TriggerAnswers { taken: 0, late: 0, refused: 6 });
    assert_eq!(refused.outcome.record.ledger.count(EventKind::TriggerRefused), 6);
    assert_eq!(only_triggers(&refused.outcome.record.ledger), [0; 4]);
    assert_eq!(refused.pixels_crc32, taken.pixels_crc32);
    // Negative control: another seed has other pixels.
    let mut other = bench.clone();
    other.seed += 1;
    assert_ne!(fly(&other, &SENT, &[]).pixels_crc32, taken.pixels_crc32);
}
