//! Tests deadlines on the bench clock: late frames are treated according to the policy, and all are counted.
//!
//! No wall time is asserted: the readout time leaves 1 ms for a frame for which the reference backend needs far more.

use crate::bench::{built_in, fly_real_head, start};
use base::clock::{Clock, Monotonic};
use config::{Backend, Bench, DeadlinePolicy};
use frames::sink::{NullSink, SentFrame};
use link::{Port, simulated::simulated_pair};
use run::runtime::{EventKind, FrameEngine, Head, RunOutcome, RunRecord};
use run::{runtime::receiver::Receiver, wiring::bench_parts};
use std::sync::Arc;

const FRAMES: u64 = 4;

/// Runs frames that are all late, without another end of the bus.
fn run_late(policy: DeadlinePolicy) -> RunOutcome {
    let mut bench = built_in(0.1 * FRAMES as f64);
    bench.render.backend = Backend::Reference;
    bench.camera.exposure.readout_s = 1e-3;
    bench.timing.deadline_policy = policy;
    run(&bench, &mut |_, _| {})
}

/// Runs a bench on the bench clock without another end of the bus.
fn run(bench: &Bench, progress: &mut dyn FnMut(&SentFrame, &RunRecord)) -> RunOutcome {
    let start = start(bench);
    let params = bench_parts::run_params(bench, start).unwrap();
    let mut receiver = Receiver::new(params.attitude.clone()).unwrap();
    let clock: Arc<dyn Clock> = Arc::new(Monotonic::start_at(start));
    let (bus, format) = bench_parts::bus(bench);
    let (near, _far) = simulated_pair(bus, &clock);
    let port = Port::new(Box::new(near), format, firmware_protocol::can::IdMap::new(0, 0).unwrap());
    let mut head = Head::new(FrameEngine::new(params).unwrap(), Box::new(NullSink::new()));
    fly_real_head(&mut head, &mut receiver, port, &clock, progress)
}

#[test]
fn late_frames_go_out_late_or_not_at_all_and_are_counted() {
    for policy in [DeadlinePolicy::Late, DeadlinePolicy::Drop, DeadlinePolicy::Hold] {
        let outcome = run_late(policy);
        assert!(outcome.error.is_none(), "{policy:?}");
        let (frames, ledger) = (outcome.record.frames, outcome.record.ledger);
        assert_eq!(frames.scheduled, FRAMES, "{policy:?}");
        assert_eq!(frames.delivered + frames.dropped, FRAMES, "{policy:?}: every slot is accounted for");
        assert_eq!(ledger.count(EventKind::Dropped), frames.dropped, "{policy:?}: and is in the ledger");
        match policy {
            DeadlinePolicy::Late => {
                assert_eq!((frames.late, ledger.count(EventKind::Late)), (frames.delivered, frames.delivered))
            }
            // No frame was in time, so there is none to hold.
            DeadlinePolicy::Drop | DeadlinePolicy::Hold => assert_eq!(frames.delivered, 0, "{policy:?}"),
        }
    }
}

/// Tests a frame thread that is blocked for three frames: the previous image goes out again in their place.
#[test]
fn a_good_frame_is_repeated_while_new_ones_are_missing() {
    // On a machine that stalls for 100 ms at the first frame a good frame to repeat is missing: then the run is flown
    // again.
    let is_judged = (0..5).any(|_| holds_the_first_frame());
    assert!(is_judged, "the first frame was late in each of five runs");
}

/// Flies one run; returns false when its first frame was late, so that the run shows nothing.
fn holds_the_first_frame() -> bool {
    let mut bench = built_in(0.6);
    bench.timing.deadline_policy = DeadlinePolicy::Hold;
    let (mut drawn, mut in_time) = (0, false);
    let outcome = run(&bench, &mut |frame, _| {
        drawn += 1;
        if drawn == 1 {
            in_time = frame.meta.lateness.ns() <= 0;
        } else if drawn == 2 {
            std::thread::sleep(std::time::Duration::from_millis(350));
        }
    });
    let (frames, ledger) = (outcome.record.frames, outcome.record.ledger);
    assert_eq!(frames.delivered + frames.dropped, 6, "every slot is accounted for");
    assert_eq!(ledger.count(EventKind::Held), frames.held);
    if in_time {
        assert!(frames.held >= 1, "{frames:?}");
        assert_eq!(frames.dropped, 0, "hold leaves no gap: {frames:?}");
    }
    in_time
}
