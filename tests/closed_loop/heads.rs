//! Tests several camera heads: each shows the sky for its mounting, on both clocks, and none has to wait for another's
//! sink.

use crate::bench::start;
use crate::pixels::{fly_real, scenario};
use crate::sinks::{FRAMES, Trouble, Troubled, bench};
use base::clock::{Clock, Monotonic};
use base::time::Span;
use config::{Bench, Document};
use crossbeam_channel::bounded;
use frames::report::{Fate, MissCause, RunLimits};
use frames::sink::{NullSink, Sink};
use glam::DQuat;
use link::{Port, simulated::simulated_pair};
use run::runtime::real_head::Setting;
use run::runtime::{EventKind, FrameEngine, Head, real_time};
use run::{runtime::receiver::Receiver, wiring::bench_parts};
use std::sync::{Arc, Mutex};
use std::{collections::BTreeMap, path::Path, process::Command, sync::atomic::AtomicBool};

/// Mountings of the heads of `configs/benches/three_heads.toml`, w x y z, written down by hand.
const MOUNTINGS: [[f64; 4]; 3] = [
    [0.92387953, 0.38268343, 0.0, 0.0],
    [0.92387953, -0.19134172, 0.33141357, 0.0],
    [0.92387953, -0.19134172, -0.33141357, 0.0],
];

fn quaternion([w, x, y, z]: [f64; 4]) -> DQuat {
    DQuat::from_xyzw(x, y, z, w).normalize()
}

/// Returns the angle between two attitudes, rad.
fn apart(a: DQuat, b: DQuat) -> f64 {
    2.0 * (a * b.conjugate()).xyz().length().min(1.0).asin()
}

/// Returns the attitude of every frame of one head, by number, from the files of a run.
fn attitudes(run: &Path, head: usize) -> BTreeMap<u32, DQuat> {
    let mut reader = csv::Reader::from_path(run.join(format!("head{head}/frames.csv"))).unwrap();
    let names = reader.headers().unwrap().clone();
    let place = |name: &str| names.iter().position(|other| other == name).unwrap();
    let (number, faults, q) = (place("frame"), place("faults"), ["qw", "qx", "qy", "qz"].map(place));
    let rows = reader.records().map(Result::unwrap).filter(|row| !row[faults].contains("duplicate"));
    rows.map(|row| (row[number].parse().unwrap(), quaternion(q.map(|place| row[place].parse().unwrap())))).collect()
}

#[test]
fn each_head_shows_the_sky_where_it_is_mounted() {
    let folder = tempfile::tempdir().unwrap();
    let bench = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/benches/three_heads.toml");
    for clock in ["virtual", "real"] {
        let out = folder.path().join(clock);
        let arguments = ["run", bench.to_str().unwrap(), "--duration", "1.5", "--sink", "recorder", "--quiet"];
        let mut command = Command::new(env!("CARGO_BIN_EXE_starloop"));
        let done = command.args(arguments).args(["--clock", clock, "--out"]).arg(&out).output().unwrap();
        assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
        let of_heads = [0, 1, 2].map(|head| attitudes(&out, head));
        let mut compared = 0;
        for (number, first) in &of_heads[0] {
            for head in [1, 2] {
                let Some(attitude) = of_heads[head].get(number) else { continue };
                let between = |a: usize| quaternion(MOUNTINGS[a]) * quaternion(MOUNTINGS[0]).conjugate();
                let seen = *attitude * first.conjugate();
                assert!(
                    apart(seen, between(head)) < 1e-8,
                    "frame {number} of head {head}: {}",
                    apart(seen, between(head))
                );
                assert!(apart(seen, between(3 - head)) > 0.5, "control: the other head is mounted elsewhere");
                compared += 1;
            }
        }
        if clock == "virtual" {
            assert_eq!(compared, 30);
        } else if compared < 30 {
            println!("UNJUDGED: {} of 30 frames were held or late on the real clock", 30 - compared);
        }
        let summary: serde_json::Value =
            serde_json::from_slice(&std::fs::read(out.join("summary.json")).unwrap()).unwrap();
        assert_eq!(summary["frames"]["scheduled"], 45);
        let places: Vec<&str> =
            summary["sinks"].as_array().unwrap().iter().map(|s| s["place"].as_str().unwrap()).collect();
        assert_eq!(places, ["head0 sink", "head1 sink", "head2 sink"]);
    }
}

#[test]
fn heads_have_patterns_and_noise_of_their_own() {
    let folder = tempfile::tempdir().unwrap();
    let bench = folder.path().join("bench.toml");
    // All have the same mounting.
    std::fs::write(&bench, "[[extra_head]]\nsensor_from_body = [1.0, 0.0, 0.0, 0.0]\n").unwrap();
    let mut command = Command::new(env!("CARGO_BIN_EXE_starloop"));
    let arguments = ["run", "bench.toml", "--clock", "virtual", "--duration", "0.3", "--out", "out", "--quiet"];
    let done = command.args(arguments).current_dir(folder.path()).output().unwrap();
    assert!(done.status.success(), "{}", String::from_utf8_lossy(&done.stderr));
    let read = |name: &str| std::fs::read(folder.path().join("out").join(name)).unwrap();
    let stars = |head: usize| read(&format!("head{head}/frame_000001.truth.csv"));
    assert_eq!(stars(0), stars(1), "the same stars at the same places");
    assert_ne!(read("head0/frame_000001.fits"), read("head1/frame_000001.fits"));
}

/// Returns the bench of [`bench`] with three heads.
fn three() -> Bench {
    let mut bench = bench();
    bench.extra_heads = vec![bench.first_head(); 2];
    bench
}

#[test]
fn a_head_whose_sink_is_stuck_costs_the_others_nothing() {
    let (at_end, gate) = bounded(0);
    let bench = three();
    let start = start(&bench);
    let clock: Arc<dyn Clock> = Arc::new(Monotonic::start_at(start));
    let (bus, format) = bench_parts::bus(&bench);
    let (near, _far) = simulated_pair(bus, &clock);
    let port = Port::new(Box::new(near), format, firmware_protocol::can::IdMap::new(0, 0).unwrap());
    let stop = Arc::new(AtomicBool::new(false));
    let setting = Setting {
        clock: &clock,
        stop: &stop,
        hygiene: None,
        ring_frames: FRAMES as usize,
        limits: RunLimits::default(),
        orders: None,
    };
    let mut gate = Some(gate);
    let head = |number: usize| {
        let sink: Box<dyn Sink> = match (number == 1).then(|| gate.take()).flatten() {
            Some(gate) => Box::new(Troubled { inner: NullSink::new(), trouble: Trouble::Slow(gate) }),
            None => Box::new(NullSink::new()),
        };
        let params = bench_parts::run_params(&bench.of_head(number), start).unwrap();
        Head::new(FrameEngine::new(params).unwrap().of_head(number), sink)
    };
    let mut heads: Vec<Head> = (0..bench.head_count()).map(head).collect();
    let attitude = |head: &Head| head.engine.params.attitude.clone();
    let mut receiver = Receiver::new(attitude(&heads[0])).unwrap();
    heads[1..].iter().for_each(|head| receiver.add_head(&attitude(head)).unwrap());
    let mut at_end = Some(at_end);
    let outcome = real_time::run_in(&setting, &mut heads, &mut receiver, port.into(), &mut |head, frame, _| {
        if head == 2 && u64::from(frame.meta.number) + 1 == FRAMES {
            at_end = None;
        }
    });
    assert!(outcome.error.is_none(), "{:?}", outcome.error.as_ref().map(ToString::to_string));
    let frames = outcome.record.frames;
    assert_eq!((frames.scheduled, frames.delivered + frames.dropped), (3 * FRAMES, 3 * FRAMES), "{frames:?}");
    let of = |head: usize| outcome.record.ring.last().filter(move |record| record.head == head);
    for head in 0..3 {
        assert_eq!(of(head).count() as u64, FRAMES, "head {head}: a record of every slot");
        let busy = of(head).filter(|record| record.cause == Some(MissCause::SinkBusy)).count() as u64;
        let wanted = if head == 1 { outcome.record.ledger.count(EventKind::SinkBusy) } else { 0 };
        assert_eq!(busy, wanted, "head {head}");
    }
    let stuck = of(1).filter(|record| record.fate == Fate::Dropped).count();
    assert!(stuck >= FRAMES as usize - 5, "control: head 1 has four buffers, all of them stuck: {stuck} dropped");
}

#[test]
fn three_heads_fly_on_the_real_clock() {
    let mut scenario = scenario("three_heads");
    scenario.bench.timing.duration_s = 5.0;
    scenario.events.clear();
    let mut sink = |_| Box::new(NullSink::new()) as Box<dyn Sink>;
    let most_solved = Arc::new(Mutex::new(0));
    let seen = Arc::clone(&most_solved);
    let on_row = Box::new(move |row: &testbed::vehicle::TelemetryRow| {
        let mut most = seen.lock().unwrap();
        *most = row.heads_solved.max(*most);
    });
    let mut interpolated = 0;
    let mut count = |_: usize, frame: &frames::sink::SentFrame, _: &run::runtime::RunRecord| {
        interpolated += u64::from(frame.meta.origin.name() == "interpolated");
    };
    let outcome = fly_real(&scenario, &mut sink, on_row, &mut count);
    let frames = &outcome.record.frames;
    assert_eq!((frames.scheduled, frames.delivered + frames.dropped), (30, 30), "{frames:?}");
    assert_eq!(outcome.summaries.iter().flatten().count(), 3);
    let most = *most_solved.lock().unwrap();
    if interpolated > 0 {
        assert!(outcome.assessment.rendered().0 > 0, "{interpolated} frames claim to show the truth");
    } else {
        println!("UNJUDGED: on this busy machine every attitude was predicted, so no frame shows the truth");
    }
    if frames.late == 0 {
        assert_eq!(outcome.assessment.violations().0, 0, "{:?}", outcome.assessment.violations());
        assert_eq!(most, 3, "heads that solved: {frames:?}");
    } else {
        println!("UNJUDGED: this machine is too busy to draw in time, so the trackers see held frames: {frames:?}");
    }
    println!("{most} heads solved, {interpolated} frames interpolated, {frames:?}");
}

#[test]
fn benches_with_heads_are_refused_what_they_cannot_have() {
    let refused = |text: &str| {
        let document = Document::from_text(text, Path::new("bench.toml"));
        Bench::from_document(&document).unwrap_err().to_string()
    };
    let head = "[[extra_head]]\nsensor_from_body = [1.0, 0.0, 0.0, 0.0]\n";
    let error = refused("[[extra_head]]\n");
    assert!(error.contains("extra_head[0].sensor_from_body") && error.contains("missing"), "{error}");
    let error = refused(&head.repeat(8));
    assert!(error.contains("extra_head") && error.contains("at most 7"), "{error}");
    let error = refused(&format!("{head}[sink]\nkind = \"display\"\n"));
    let why = if cfg!(feature = "display") { "one head" } else { "--features display" };
    assert!(error.contains("sink.kind") && error.contains(why), "{error}");
    let most = Document::from_text(&head.repeat(7), Path::new("bench.toml"));
    assert_eq!(Bench::from_document(&most).unwrap().head_count(), 8, "this side of the edge");
    let params = |text: &str| {
        let bench = Bench::from_document(&Document::from_text(text, Path::new("bench.toml"))).unwrap();
        bench_parts::run_params(&bench, start(&bench)).unwrap()
    };
    let (one, eight) = (params(""), params(&head.repeat(7)));
    let cost = plan::exposure::cost::CostModel::CPU;
    let detector_ms = one.camera.predicted_readout_ms(&cost);
    let whole = one.drawing_budget_ms(&cost) + detector_ms;
    assert!((eight.drawing_budget_ms(&cost) + detector_ms - whole / 8.0).abs() < 1e-9, "an eighth of the time each");
    assert_eq!(one.frame_period, Span::from_ms(100));
}
