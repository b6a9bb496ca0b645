//! Tests that bad input leads to an error or a count, never to a panic, and that nothing finished before is lost.

use crate::bench::{built_in, run_changed, start};
use base::time::Span;
use firmware_protocol::message::{StatusPage, StimulatorMode};
use frames::sink::FaultFlags;
use plan::attitude::StalePolicy;
use run::runtime::{EventKind, RunError};
use testbed::flight_computer::{CorruptRecord, Corruption};

#[test]
fn broken_quaternions_are_rejected_and_counted() {
    for corruption in [Corruption::NotANumber, Corruption::NotUnit] {
        let run = run_changed(
            &built_in(1.0),
            |computer| computer.faults.corrupt_record = Some(CorruptRecord { record: 130, corruption }),
            usize::MAX,
        );
        assert!(run.outcome.error.is_none(), "{corruption:?}");
        let rejected: u32 = run.outcome.ports[0].rejects.iter().sum();
        assert_eq!(rejected, 1, "{corruption:?}: one record was broken, one is rejected");
        assert_eq!(run.frames.len(), 10, "{corruption:?}: frames go on");
    }
}

#[test]
fn a_stopped_stream_blanks_frames_when_the_policy_says_so() {
    let mut bench = built_in(3.0);
    bench.attitude.estimate.policy = StalePolicy::Blank;
    let stop = start(&bench) + Span::from_ms(2000);
    let run = run_changed(&bench, |computer| computer.faults.stop_stream_at = Some(stop), usize::MAX);
    let last = run.frames.last().unwrap();
    assert!(last.meta.faults.contains(FaultFlags::BLANK), "{}", last.meta.faults);
    assert_eq!(last.stars, 0, "no stars in a blank frame");
    assert!(run.outcome.record.ledger.count(EventKind::Blank) > 0, "and it is counted");
}

/// Tests that frames are left out from the time at which the stream counts as stopped, each with an event and a
/// message.
#[test]
fn stopped_stream_leaves_frames_out_when_the_policy_says_so() {
    let mut bench = built_in(3.0);
    bench.attitude.estimate.policy = StalePolicy::Drop;
    let stop = start(&bench) + Span::from_ms(2000);
    let run = run_changed(&bench, |computer| computer.faults.stop_stream_at = Some(stop), usize::MAX);
    assert!(run.outcome.error.is_none());
    let record = &run.outcome.record;
    let missing = record.ledger.count(EventKind::AttitudeMissing);
    assert!(missing > 5, "{missing} frames");
    assert_eq!(
        (record.frames.dropped, record.frames.delivered + missing),
        (missing, 30),
        "every slot is accounted for"
    );
    assert_eq!(run.frames.len() as u64 + missing, 30);
    assert!(run.frames.iter().all(|frame| frame.meta.origin.name() != "held"), "never a held sky");
    assert_eq!(record.ledger.count(EventKind::AttitudeHeld), 0);
    let reported = run.computer.received.last_status.unwrap().value;
    assert!(matches!(reported, StatusPage::State { mode: StimulatorMode::Stopped, .. }), "{reported:?}");
}

#[test]
fn a_stopped_stream_ends_the_run_when_the_policy_says_so() {
    let mut bench = built_in(3.0);
    bench.attitude.estimate.policy = StalePolicy::Stop;
    let stop = start(&bench) + Span::from_ms(2000);
    let run = run_changed(&bench, |computer| computer.faults.stop_stream_at = Some(stop), usize::MAX);
    assert!(matches!(run.outcome.error, Some(RunError::AttitudeStopped { .. })));
    assert!(run.frames.len() >= 10, "frames before are kept: {}", run.frames.len());
}

#[test]
fn no_attitude_at_all_is_a_blank_frame_and_an_event() {
    let bench = built_in(1.0);
    let never = start(&bench) - Span::from_ms(1);
    let run = run_changed(&bench, |computer| computer.faults.stop_stream_at = Some(never), usize::MAX);
    assert_eq!(run.outcome.record.ledger.count(EventKind::NoAttitude), 10);
    assert!(run.frames.iter().all(|frame| frame.stars == 0));
}

#[test]
fn failing_sink_ends_the_run_with_what_it_wrote() {
    let run = run_changed(&built_in(2.0), |_| {}, 7);
    assert!(matches!(run.outcome.error, Some(RunError::Sink(_))));
    assert_eq!((run.frames.len(), run.outcome.record.frames.delivered), (7, 7));
}
