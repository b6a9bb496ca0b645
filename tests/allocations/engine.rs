//! The built-in bench's frame engine in its slew, fed over its simulated bus; only `expose` is checked.

use crate::complaints;
use crate::counting::{Found, allocations_in};
use base::clock::{Clock, Virtual};
use base::time::{Span, Tai};
use config::{Backend, Bench, Setting, StartTime};
use firmware_protocol::Message;
use firmware_protocol::message::{Command, Request, Trigger};
use frames::report::{FrameRecord, NEWEST_MAX};
use frames::sink::SentFrame;
use link::{Port, simulated::simulated_pair};
use run::runtime::{EventKind, FrameEngine, Ledger, RunRecord, Slot};
use run::{runtime::receiver::Receiver, wiring::bench_parts};
use std::sync::Arc;
use testbed::flight_computer::FlightComputer;

const WARM_UP: u32 = 10;

/// Returns the allocations of exposing the bench's frames, and those of a camera whose field has light of every kind.
pub(crate) fn complaints_of_the_bench() -> Vec<String> {
    let lit = [
        "observer={ kind = \"circular_orbit\", altitude_km = 500.0, inclination_deg = 97.0 }",
        "camera.illumination={ cos4 = true, window_radius_mm = 20.0, window_distance_mm = 60.0 }",
        "camera.background={ uniform_e_per_s = 30.0, gradient = [0.2, 0.1], sky = [\"zodiacal\", \"galactic\"] }",
        "camera.baffle={ transmittance = [[10, 1e-6], [80, 1e-12]], gradient = 0.2, exclusion_sun_deg = 180 }",
    ];
    let lit = lit.map(|setting| Setting::parse(setting).unwrap()).to_vec();
    let lit = Bench::from_document(&Bench::built_in_document().unwrap().with_settings(lit)).unwrap();
    [Bench::built_in().unwrap(), lit].into_iter().flat_map(complaints_of).collect()
}

fn complaints_of(mut bench: Bench) -> Vec<String> {
    bench.render.backend = Backend::Cpu;
    let StartTime::At(start) = bench.timing.start else { panic!("the built-in bench starts at a fixed time") };
    let params = bench_parts::run_params(&bench, start).unwrap();
    let mut engine = FrameEngine::new(params.clone()).unwrap();
    let mut receiver = Receiver::new(params.attitude).unwrap();
    receiver.session.expect_trigger(7);
    let mut ledger = Ledger::default();
    let camera = &params.camera;
    let (width, height) = (camera.geometry.width_px(), camera.geometry.height_px());
    let mut frame = SentFrame::with_capacity(width, height, 16_384, camera.name.clone());
    engine.warm_up(&mut frame).unwrap();
    // Fewer records than frames, so that records are overwritten too.
    let mut record = RunRecord::with_ring(16, 1);
    engine.pace.follow_load();
    let mut cable = Cable::new(&bench, start);
    let (mut wrong, mut watched) = (Vec::new(), 0);
    for number in 0..params.frames {
        let slot = engine.exposing.nominal(number);
        cable.carry_until(slot.release, &mut receiver, &mut ledger);
        let mut expose = || {
            fire(slot, &mut receiver, &mut ledger);
            let times = engine.expose(slot, &mut receiver, &mut ledger, &mut frame).unwrap().unwrap();
            engine.learn_load(Span::from_ms(i64::from(number % 40)), slot.due, slot, &mut ledger);
            let at = [slot.exposure_start, slot.release, slot.due];
            let mut timed = FrameRecord::released(number, at, [slot.release, slot.release]);
            timed.times.merge(&times);
            timed.cause = Some(timed.cause_of_lateness(&record.stages));
            record.count_rendered(&frame, &times);
            record.ring.push(timed);
            timed.delivered = Some(slot.due);
            record.complete(&timed);
            record.note(EventKind::Late, slot.due, number, Span::ZERO);
            // The live view is given these numbers after every frame.
            watched = record.numbers(None).newest.iter().count();
        };
        let found: Vec<Found> = if number < WARM_UP { (expose(), Vec::new()).1 } else { allocations_in(expose) };
        wrong.extend(complaints(&format!("bench, frame {number}"), &found));
        assert!(!frame.truth.is_empty(), "frame {number} has stars");
    }
    assert_eq!(watched, NEWEST_MAX.min(params.frames as usize), "events are reported");
    let fired = receiver.session.triggers.of(0).counts().fired;
    assert!(fired > u64::from(params.frames), "{fired} triggers, at once and ahead");
    wrong
}

/// Sends a trigger that acts at once and one three frames ahead; takes out those that are due.
fn fire(slot: Slot, receiver: &mut Receiver, ledger: &mut Ledger) {
    let Some(now_us) = receiver.attitudes.remote_us_at(slot.release, &receiver.clock.remote) else { return };
    for (token, at_us) in [(1, 0), (2, now_us.wrapping_add(300_000))] {
        let request = Request::Trigger(Trigger { number: 7, at_us });
        let value = Message::Command(Command { token, request });
        assert!(receiver.accept(0, &value, slot.release, ledger).is_some(), "is answered");
    }
    receiver.session.fire_triggers(0, slot, ledger, &mut |_| {});
}

/// The flight computer, the bus and the clock.
struct Cable {
    clock: Arc<Virtual>,
    near: Port,
    far: Port,
    computer: FlightComputer,
    next_due: Tai,
}

impl Cable {
    fn new(bench: &Bench, start: Tai) -> Self {
        let clock = Arc::new(Virtual::new(start));
        let shared: Arc<dyn Clock> = clock.clone();
        let (bus, format) = bench_parts::bus(bench);
        let (near, far) = simulated_pair(bus, &shared);
        let ids = firmware_protocol::can::IdMap::new(0, 0).unwrap();
        let port = |link| Port::new(link, format, ids);
        let computer = FlightComputer::new(bench_parts::flight_computer(bench, start));
        Self { clock, near: port(Box::new(near)), far: port(Box::new(far)), computer, next_due: start }
    }

    fn carry_until(&mut self, at: Tai, receiver: &mut Receiver, ledger: &mut Ledger) {
        loop {
            let now = self.next_due.min(at);
            self.clock.advance_to(now);
            while let Some(message) = self.near.receive(now).unwrap() {
                if let Some(answer) = receiver.accept(0, &message.value, message.at, ledger) {
                    self.near.send(&answer).unwrap();
                }
            }
            if self.next_due > at {
                break;
            }
            self.computer.step(now, &mut self.far).unwrap();
            self.next_due = self.computer.next_due();
        }
    }
}
