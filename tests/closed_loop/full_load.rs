//! Tests a full 1 Mbit/s bus and a full 3 Mbaud line at once, on the real clock: nothing is lost.
//!
//! `STARLOOP_FULL_LOAD_S=60 cargo test --release --test closed_loop -- full_load --nocapture` is the long run; without
//! it two seconds are flown. Times are printed and not asserted.

use crate::bench::built_in;
use base::clock::{Clock, Monotonic};
use base::time::{Span, Tai};
use firmware_protocol::message::{JitterBurst, Scet, Sync as TimeMark, TimeFollowUp, Wheels};
use firmware_protocol::{Message, can::IdMap};
use frames::{report::RunLimits, sink::NullSink};
use link::gateway::DroppedFrames;
use link::simulated::{BusParams, BusTiming, SimulatedBus};
use link::{Port, WireFormat};
use run::runtime::real_head::{Setting, Sources};
use run::runtime::{FrameEngine, Head, RunParams, real_time};
use run::{runtime::receiver::Receiver, wiring::bench_parts};
use std::sync::atomic::{AtomicBool, Ordering};
use std::{sync::Arc, thread::JoinHandle};

/// Data that a sender queues ahead: the wire stays full on a machine that sleeps up to this long.
const AHEAD: Span = Span::from_ms(4);

/// A wire kept full by a thread.
struct FullWire {
    bus: SimulatedBus,
    sender: JoinHandle<u64>,
}

fn full_wire(
    clock: &Arc<dyn Clock>,
    timing: BusTiming,
    format: WireFormat,
    over: &Arc<AtomicBool>,
    mut message: impl FnMut(u64, Tai) -> Message + Send + 'static,
) -> (FullWire, Port) {
    let params = BusParams { name: "full".into(), timing, latency: Span::ZERO, queue_packets: 4096 };
    let bus = SimulatedBus::new(params, clock);
    let port = |bus: &SimulatedBus| Port::new(Box::new(bus.attach()), format, IdMap::new(0, 0).unwrap());
    let (near, mut far) = (port(&bus), port(&bus));
    let (clock, over) = (Arc::clone(clock), Arc::clone(over));
    let send = move || {
        let mut sent = 0;
        while !over.load(Ordering::Relaxed) {
            let leaves = far.send(&message(sent, clock.now())).unwrap();
            sent += 1;
            clock.sleep_until(leaves - AHEAD);
        }
        // The last ones are still in flight.
        clock.sleep_until(clock.now() + Span::from_ms(50));
        assert_eq!(far.counters().unsent, 0, "the sender's own queue");
        sent
    };
    let sender = std::thread::Builder::new().name("sender".into()).spawn(send).unwrap();
    (FullWire { bus, sender }, near)
}

fn seconds() -> f64 {
    std::env::var("STARLOOP_FULL_LOAD_S").map_or(2.0, |seconds| seconds.parse().expect("seconds, such as 60"))
}

fn run_params(seconds: f64, start: Tai) -> RunParams {
    let mut bench = built_in(seconds);
    bench.timing.frame_rate_hz = 10.0;
    bench_parts::run_params(&bench, start).unwrap()
}

/// Returns the time marks every 1,000 messages, wheel speeds in between.
fn on_the_bus(number: u64, now: Tai, boot: Tai) -> Message {
    let counter = u8::try_from(number / 1000 % 256).unwrap();
    match number % 1000 {
        0 => Message::Sync(TimeMark { counter }),
        1 => {
            let scet = Scet::from_ns(u64::try_from((now - boot).ns()).unwrap());
            Message::TimeFollowUp(TimeFollowUp { scet, counter })
        }
        _ => Message::Wheels(Wheels { speed_rpm: [1000.0, 2000.0, -1500.0, 0.25] }),
    }
}

#[test]
fn a_full_bus_and_a_full_line_lose_nothing() {
    let start = Tai::from_rfc3339("2026-03-01T00:00:00Z").unwrap();
    let seconds = seconds();
    let params = run_params(seconds, start);
    let mut head = Head::new(FrameEngine::new(params.clone()).unwrap(), Box::new(NullSink::new()));
    let mut receiver = Receiver::new(params.attitude.clone()).unwrap();
    let clock: Arc<dyn Clock> = Arc::new(Monotonic::start_at(start));
    let over = Arc::new(AtomicBool::new(false));
    let can = BusTiming::CanClassic { bit_rate_bps: 1_000_000 };
    let (bus, bus_port) =
        full_wire(&clock, can, WireFormat::CanClassic, &over, move |number, now| on_the_bus(number, now, start));
    let burst = move |number: u64, now: Tai| {
        let t_us = u32::try_from((now - start).ns() / 1000).unwrap();
        let seq = u8::try_from(number % 256).unwrap();
        Message::Jitter(JitterBurst::new(t_us, 100, seq, &[[0.1, 0.1]; 14]).unwrap())
    };
    let (line, line_port) = full_wire(&clock, BusTiming::Serial { baud: 3_000_000 }, WireFormat::Serial, &over, burst);
    let stop = Arc::new(AtomicBool::new(false));
    // The senders end before the run does, so that everything sent is received.
    let ender = {
        let (clock, over) = (Arc::clone(&clock), Arc::clone(&over));
        let end = params.exposure_start(params.frames.saturating_sub(5));
        std::thread::Builder::new().spawn(move || {
            clock.sleep_until(end);
            over.store(true, Ordering::Relaxed);
        })
    };
    let setting = Setting {
        clock: &clock,
        stop: &stop,
        hygiene: None,
        ring_frames: 64,
        limits: RunLimits::default(),
        orders: None,
    };
    let sources = Sources {
        ports: vec![bus_port, line_port],
        pulses: None,
        samples: None,
        chips: Vec::new(),
        dropped: DroppedFrames::default(),
    };
    let heads = core::slice::from_mut(&mut head);
    let outcome = real_time::run_in(&setting, heads, &mut receiver, sources, &mut |_, _, _| {});
    ender.unwrap().join().unwrap();
    assert!(outcome.error.is_none(), "{:?}", outcome.error.map(|error| error.to_string()));
    let load = bus.bus.statistics().load();
    // The line's statistics are of both directions; one is used.
    let line_load = line.bus.statistics().load();
    let sent = [bus.sender.join().unwrap(), line.sender.join().unwrap()];
    let summary = outcome.record.summary(&head.engine, &receiver, &outcome.ports, None);
    println!(
        "{seconds} s: {sent:?} messages sent, bus load {:.1} %, line load {:.1} %",
        100.0 * load,
        100.0 * line_load
    );
    if std::env::var_os("STARLOOP_FULL_LOAD_S").is_some() {
        assert!(load > 0.9 && line_load > 0.9, "the long run is for a machine that has the time: {load}, {line_load}");
    }
    println!("bus to history: {:?}", summary.intake);
    println!("{:?}", summary.link);
    for (port, sent) in outcome.ports.iter().zip(sent) {
        assert_eq!(port.counters.received, sent, "every packet is one message here");
        assert_eq!((port.counters.overflows, port.queue_overflows), (0, 0));
        assert_eq!(port.rejects.iter().sum::<u32>(), 0);
    }
    assert_eq!(summary.intake.count, sent.iter().sum::<u64>(), "every message came as far as the history");
}
