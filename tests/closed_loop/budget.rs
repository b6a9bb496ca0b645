//! Tests the timing budget: every slot has a record and a cause, load raises the degradation level and back, and the
//! exit status of the program agrees with its table.
//!
//! No wall time is asserted: limits are either far above or far below what any machine needs, and load is injected.

use crate::bench::{built_in, start};
use base::clock::{Clock, Monotonic, Virtual};
use base::time::{Span, Tai};
use config::{Bench, Degrade};
use frames::report::{Fate, FrameRecord, RunLimits};
use frames::sink::{NullSink, SentFrame};
use link::{Port, simulated::simulated_pair};
use plan::attitude::MotionScale;
use run::runtime::virtual_time::{VirtualLoop, World};
use run::runtime::{EventKind, FrameEngine, Head, Ledger, real_head, real_time};
use run::{runtime::receiver::Receiver, wiring::bench_parts};
use std::process::{Command, Output};
use std::{path::Path, sync::Arc, sync::atomic::AtomicBool};
use testbed::flight_computer::FlightComputer;

/// Drawing time ten times the predicted one or more: the estimate is limited there.
const SLOW: Span = Span::from_ms(5_000);
const FAST: Span = Span::from_ms(0);

fn ports(bench: &Bench, clock: &Arc<dyn Clock>) -> [Port; 2] {
    let (bus, format) = bench_parts::bus(bench);
    let (near, far) = simulated_pair(bus, clock);
    let ids = firmware_protocol::can::IdMap::new(0, 0).unwrap();
    [Port::new(Box::new(near), format, ids), Port::new(Box::new(far), format, ids)]
}

/// Returns the degradations of the frames of a bench on the virtual clock, with drawing times `drawn` by frame number,
/// and the ledger of the load. Without `follow` the load is not reported.
fn degradations(bench: &Bench, follow: bool, drawn: impl Fn(u32) -> Span) -> (Vec<&'static str>, Ledger) {
    let start = start(bench);
    let params = bench_parts::run_params(bench, start).unwrap();
    let mut engine = FrameEngine::new(params.clone()).unwrap();
    let mut receiver = Receiver::new(params.attitude).unwrap();
    if follow {
        engine.pace.follow_load();
    }
    let clock = Arc::new(Virtual::new(start));
    let shared: Arc<dyn Clock> = clock.clone();
    let [mut near, mut far] = ports(bench, &shared);
    let mut computer = FlightComputer::new(bench_parts::flight_computer(bench, start));
    let (mut degradations, mut ledger) = (Vec::new(), Ledger::default());
    let mut going = VirtualLoop::new(clock);
    let mut heads = [Head::new(engine, Box::new(NullSink::new()))];
    for number in 0..params.frames {
        let slot = heads[0].engine.exposing.nominal(number);
        let mut world = World {
            port: &mut near,
            receiver: &mut receiver,
            far_end: &mut |now: Tai| Ok(computer.step(now, &mut far).map(|()| computer.next_due())?),
            progress: &mut |_, frame: &mut SentFrame, _| {
                degradations.push(frame.meta.degradation.name());
                true
            },
        };
        going.advance_to(slot.due, &mut heads, &mut world).unwrap();
        heads[0].engine.learn_load(drawn(number), slot.due, slot, &mut ledger);
    }
    (degradations, ledger)
}

#[test]
fn load_degrades_frames_at_once_and_they_come_back_when_it_goes() {
    let mut bench = built_in(8.0);
    bench.camera.radiometry.limiting_mag = Some(12.0);
    // Little enough time for the rest of a load to matter some frames later: a whole frame takes a seventh of it.
    bench.camera.exposure.readout_s = 0.03;
    bench.timing.degrade = Degrade::Always;
    let (begins, ends) = (10, 15);
    let load = |number: u32| if (begins..ends).contains(&number) { SLOW } else { FAST };
    let (found, ledger) = degradations(&bench, true, load);
    let whole = |frames: &[&str]| frames.iter().all(|degradation| *degradation == "full");
    // Frame `begins` is the first slow one: the next is planned for it.
    let after = usize::try_from(begins).unwrap() + 1;
    assert!(whole(&found[..after]), "{found:?}");
    assert!(found[after..after + 5].iter().all(|degradation| *degradation != "full"), "{found:?}");
    assert!(whole(&found[found.len() - 20..]), "recovered: {found:?}");
    let back = found.iter().rposition(|degradation| *degradation != "full").unwrap();
    assert!(back > usize::try_from(ends).unwrap(), "slower down than up: {found:?}");
    assert_eq!((ledger.count(EventKind::Overloaded), ledger.count(EventKind::LoadGone)), (1, 1), "announced");
    assert!(whole(&degradations(&bench, false, load).0), "where it is not followed, load changes nothing");
    assert!(whole(&degradations(&bench, true, |_| FAST).0), "no load, no loss");
    bench.timing.degrade = Degrade::Never;
    assert!(whole(&degradations(&bench, true, load).0), "nor where frames may not be degraded");
}

/// Returns bounds of every frame's pointing error, rad, on the virtual clock, for a body with this motion.
fn bounds(bench: &Bench, motion: Option<MotionScale>) -> Vec<Option<f64>> {
    let start = start(bench);
    let params = bench_parts::run_params(bench, start).unwrap();
    let mut engine = FrameEngine::new(params.clone()).unwrap();
    if let Some(motion) = motion {
        engine.pointing.motion = Some(motion);
    }
    let mut receiver = Receiver::new(params.attitude).unwrap();
    let clock = Arc::new(Virtual::new(start));
    let shared: Arc<dyn Clock> = clock.clone();
    let [mut near, mut far] = ports(bench, &shared);
    let mut computer = FlightComputer::new(bench_parts::flight_computer(bench, start));
    let mut going = VirtualLoop::new(clock);
    let mut heads = [Head::new(engine, Box::new(NullSink::new()))];
    let mut bounds = Vec::new();
    for number in 0..params.frames {
        let slot = heads[0].engine.exposing.nominal(number);
        let mut far_end = |now: Tai| Ok(computer.step(now, &mut far).map(|()| computer.next_due())?);
        let (port, receiver) = (&mut near, &mut receiver);
        let mut world = World { port, receiver, far_end: &mut far_end, progress: &mut |_, _, _| true };
        going.advance_to(slot.release, &mut heads, &mut world).unwrap();
        bounds.push(heads[0].engine.pointing.bound_rad);
    }
    bounds
}

#[test]
fn the_attitude_has_a_bound_where_the_motion_is_known_and_none_where_it_is_not() {
    let mut bench = built_in(1.0);
    let motion = |jerk_rad_s3| MotionScale { rate_rad_s: 0.01, jerk_rad_s3, ..MotionScale::default() };
    let worst = |bench: &Bench, jerk| {
        let bounds: Option<Vec<f64>> = bounds(bench, Some(motion(jerk))).into_iter().collect();
        bounds.expect("every frame has a bound").into_iter().fold(0.0, f64::max)
    };
    // Interpolated between records 10 ms apart: `j H^3 / 96`, here 1 rad/s^3.
    let interpolated = worst(&bench, 1.0);
    assert!((interpolated / (1e-6 / 96.0) - 1.0).abs() < 0.05, "{interpolated} rad");
    // The exposure ends 1 ms before the next record: predicted over half of it, `j T^3 / 6`.
    bench.camera.exposure.exposure_s = 9e-3;
    let predicted = worst(&bench, 1.0);
    assert!((predicted / (4.5e-3_f64.powi(3) / 6.0) - 1.0).abs() < 0.05, "{predicted} rad");
    assert!((worst(&bench, 2.0) / predicted - 2.0).abs() < 0.05, "the bound follows the motion");
    assert!(bounds(&bench, None).iter().all(Option::is_none), "nothing is made up");
    bench.attitude.estimate.max_horizon = Span::ZERO;
    assert!(bounds(&bench, Some(motion(1.0))).iter().all(Option::is_none), "nor beyond the acceleration's horizon");
}

/// Returns the records and outcome of a bench on the real clock without another end of the bus.
fn alone(bench: &Bench, ring_frames: usize) -> (Vec<FrameRecord>, run::runtime::RunOutcome) {
    let start = start(bench);
    let params = bench_parts::run_params(bench, start).unwrap();
    let mut head = Head::new(FrameEngine::new(params.clone()).unwrap(), Box::new(NullSink::new()));
    let mut receiver = Receiver::new(params.attitude).unwrap();
    let clock: Arc<dyn Clock> = Arc::new(Monotonic::start_at(start));
    let [near, _far] = ports(bench, &clock);
    let stop = Arc::new(AtomicBool::new(false));
    let setting = real_head::Setting {
        clock: &clock,
        stop: &stop,
        hygiene: None,
        ring_frames,
        limits: RunLimits::default(),
        orders: None,
    };
    let heads = core::slice::from_mut(&mut head);
    let outcome = real_time::run_in(&setting, heads, &mut receiver, near.into(), &mut |_, _, _| {});
    (outcome.record.ring.last().copied().collect(), outcome)
}

#[test]
fn every_slot_has_a_record_in_order_and_what_is_missed_has_a_cause() {
    let bench = built_in(0.5);
    let (records, outcome) = alone(&bench, 64);
    assert!(outcome.error.is_none());
    let ring = &outcome.record.ring;
    assert_eq!(records.iter().map(|record| record.number).collect::<Vec<_>>(), [0, 1, 2, 3, 4]);
    let fates: u64 = Fate::ALL.iter().map(|fate| ring.count(*fate)).sum();
    assert_eq!((fates, ring.total()), (5, outcome.record.frames.scheduled));
    assert_eq!(ring.missed(), 5, "a frame without attitude is missed, however early it is");
    for record in &records {
        assert!(record.is_missed() && record.commanded.is_none() && record.pointing_bound_rad.is_none(), "{record:?}");
        assert!(record.woken >= record.release && record.due > record.release, "{record:?}");
        if let (Some(finished), Some(submitted), Some(delivered)) =
            (record.finished, record.submitted, record.delivered)
        {
            assert!(record.woken <= finished && finished <= submitted && submitted <= delivered, "{record:?}");
        }
        assert_eq!(record.submitted.is_some(), record.fate != Fate::Dropped, "{record:?}");
    }
    let latency = ring.latency();
    assert_eq!(latency.submitted_to_delivered.count, outcome.record.frames.delivered);
    assert_eq!(latency.epoch_to_delivered.count, 0, "no attitude, no latency");
    let (short, again) = alone(&bench, 2);
    assert_eq!((short.len(), again.record.ring.total()), (2, 5), "counts survive");
}

/// Runs `starloop budget` in `folder` on a bench with this budget.
fn budget(folder: &Path, limits: &str, extra: &[&str]) -> Output {
    let bench = format!("[timing]\nduration_s = 0.5\n[render]\nbackend = \"cpu\"\n[sink]\nkind = \"null\"\n{limits}\n");
    std::fs::write(folder.join("bench.toml"), bench).unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_starloop"));
    command.arg("budget").arg("bench.toml").arg("--built-in-costs").args(extra);
    command.current_dir(folder).output().unwrap()
}

/// Limits above what any machine needs.
const ROOMY: &str = "[budget]\ntotal_ms = 1e8\nrender_ms = 1e8\nmissed_frames = 1000\nlatency_ms = 1e8";

#[test]
fn exit_status_agrees_with_the_table() {
    let folder = tempfile::tempdir().unwrap();
    let text = |bytes: &[u8]| String::from_utf8_lossy(bytes).into_owned();
    let met = budget(folder.path(), ROOMY, &["--report", "met", "--load", "1"]);
    let said = text(&met.stdout);
    assert_eq!(met.status.code(), Some(0), "{said}{}", text(&met.stderr));
    assert!(said.contains("the budget is met") && said.contains("busy threads beside the run: 1"), "{said}");
    // Below what any machine needs.
    let limits = ROOMY.replace("render_ms = 1e8", "render_ms = 1e-5");
    let broken = budget(folder.path(), &limits, &["--report", "broken"]);
    let said = text(&broken.stdout);
    assert_eq!(broken.status.code(), Some(3), "{said}{}", text(&broken.stderr));
    assert!(said.contains("BROKEN: render") && said.contains("predicted"), "names the stage, asks the planner: {said}");
    for (name, failures) in [("met", "0"), ("broken", "1")] {
        let read = |file: &str| std::fs::read_to_string(folder.path().join(name).join(file)).unwrap();
        let junit = read("junit.xml");
        let junit = roxmltree::Document::parse(&junit).unwrap();
        let suite = junit.descendants().find(|node| node.has_tag_name("testsuite")).unwrap();
        assert_eq!(suite.attribute("failures"), Some(failures), "{name}");
        let json: serde_json::Value = serde_json::from_str(&read("budget.json")).unwrap();
        assert!(json["lines"].as_array().is_some_and(|lines| lines.len() > 15), "{json}");
        assert_eq!(read("frames_timing.csv").lines().count(), 6, "a heading and five frames");
        roxmltree::Document::parse(&read("worst.svg")).unwrap();
    }
}

#[test]
fn a_report_of_simulated_time_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_starloop"));
    let output =
        command.args(["run", "--clock", "virtual", "--report", "r"]).current_dir(folder.path()).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("--clock real"));
    assert!(!folder.path().join("r").exists());
}
