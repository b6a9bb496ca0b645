//! Tests fault campaigns: the invariants are met over simulated hours, the seed replays, and the witness detects
//! violations.

use crate::pixels::scenario;
use base::axes::Rotation;
use base::drawn::PathOrigin;
use base::time::{Span, Tai};
use batch::campaign::{episode_scenario, run_episode};
use config::{Action, Event};
use frames::sink::{FrameFault, FrameMeta, NullSink, SendingFault};
use link::tap::LinkFault;
use run::wiring::{stepped::SteppedRun, witness::Witness};
use testbed::vehicle::VehicleFault;

/// Episodes of an hour flown here; `starloop campaign --hours 100` flies a hundred.
const SEEDS: core::ops::Range<u64> = 101..105;

#[test]
fn hours_of_random_faults_break_no_invariant() {
    let base = scenario("campaign");
    let mut faults = 0;
    for seed in SEEDS {
        let episode = run_episode(&base, seed).unwrap();
        assert_eq!(episode.violation_lines, Vec::<String>::new(), "seed {seed}");
        assert!(episode.hits > 0 && episode.frames > 6000, "{episode:?}");
        faults += episode.events;
    }
    assert!(faults > 20, "{faults} events in {} hours", SEEDS.count());
}

#[test]
fn the_seed_replays_an_episode() {
    let mut base = scenario("campaign");
    base.bench.timing.duration_s = 1500.0;
    let (first, again, other) =
        (run_episode(&base, 7).unwrap(), run_episode(&base, 7).unwrap(), run_episode(&base, 8).unwrap());
    assert_eq!(first, again);
    assert_ne!(first.frames_crc32, other.frames_crc32);
    assert_eq!(episode_scenario(&base, 7).events, episode_scenario(&base, 7).events);
}

fn quiet() -> config::Scenario {
    let mut quiet = scenario("bus_dropouts");
    quiet.events.clear();
    quiet.bench.timing.duration_s = 60.0;
    quiet.expect.window_s = 10.0;
    quiet
}

fn meta(attitude: &Rotation<base::axes::Sensor, base::axes::Icrf>, origin: PathOrigin) -> FrameMeta {
    let mut meta = FrameMeta::empty("test".into());
    meta.attitude_wxyz = attitude.wxyz();
    meta.origin = origin;
    meta
}

#[test]
fn wrong_frame_without_a_report_is_a_violation() {
    let scenario = quiet();
    let (zero, truth) = (Tai::from_ns(0), Rotation::IDENTITY);
    let off = Rotation::IDENTITY.rotated_by(glam::DVec3::new(0.0, 5e-6, 0.0));
    let violations = |meta: &FrameMeta, rate_rad_s: f64| {
        let mut witness = Witness::new(&scenario, scenario.bench.mountings(), zero, zero + Span::from_s(60.0));
        witness.take_frame(0, meta, Some((truth, rate_rad_s)));
        witness.assessment.violations().0
    };
    assert_eq!(violations(&meta(&Rotation::IDENTITY, PathOrigin::Interpolated), 0.0), 0, "the control itself");
    assert_eq!(violations(&meta(&off, PathOrigin::Interpolated), 0.0), 1, "one arcsecond off");
    assert_eq!(violations(&meta(&off, PathOrigin::Predicted), 0.0), 0, "it says so");
    assert_eq!(violations(&meta(&off, PathOrigin::Interpolated), 0.1), 0, "within 200 us of a fast turn");
}

#[test]
fn fault_without_hits_is_a_violation() {
    let mut scenario = quiet();
    // A share of zero damages no packet.
    let action = Action::Bus(LinkFault::Loss { share: 0.0 });
    scenario.events.push(Event { at: Span::from_s(10.0), on_trigger: None, lasts: Span::from_s(20.0), action });
    let mut going = SteppedRun::new(&scenario, |_| Box::new(NullSink::new())).unwrap();
    going.run_to_end(&mut |_, _, _| true).unwrap();
    let outcome = going.end(None);
    let (count, lines) = outcome.assessment.violations();
    assert!(count == 1 && lines[0].contains("nothing was hit"), "{lines:?}");
}

#[test]
fn loop_without_recovery_is_a_violation() {
    let mut scenario = quiet();
    scenario.bench.timing.duration_s = 400.0;
    scenario.expect.recovery_s = 100.0;
    // The trackers stay blind after the tested fault: a bias jump then carries the pointing away.
    let event = |at_s: f64, for_s: f64, action| Event {
        at: Span::from_s(at_s),
        on_trigger: None,
        lasts: Span::from_s(for_s),
        action,
    };
    let jump = glam::DVec3::new(0.0, 2e-5, 0.0);
    scenario.events = vec![
        event(100.0, 5.0, Action::Frame { head: None, fault: FrameFault::Sending(SendingFault::Drop) }),
        event(110.0, 0.0, Action::Aboard(VehicleFault::GyroBiasJump(jump))),
    ];
    let control = {
        let mut going = SteppedRun::new(&scenario, |_| Box::new(NullSink::new())).unwrap();
        going.run_to_end(&mut |_, _, _| true).unwrap();
        going.end(None)
    };
    assert_eq!(control.assessment.violations().1, Vec::<String>::new(), "with its tracker it recovers");
    scenario.vehicle_mut().unwrap().spacecraft.gyro.initial_bias_rad_s = glam::DVec3::new(0.0, 3e-5, 0.0);
    scenario.events[0] = event(100.0, 0.0, Action::Aboard(VehicleFault::TrackerOff(None)));
    let mut going = SteppedRun::new(&scenario, |_| Box::new(NullSink::new())).unwrap();
    going.run_to_end(&mut |_, _, _| true).unwrap();
    let (count, lines) = (going.end(None).assessment.violations().0, "");
    assert!(count > 0, "the tracker never comes back{lines}");
}

#[test]
fn events_that_name_what_is_not_there_are_refused() {
    for (action, wanted) in [
        (Action::Aboard(VehicleFault::TrackerOff(Some(3))), "head 3: there are 1"),
        (Action::Aboard(VehicleFault::WheelFailure(4)), "wheel 4: there are 4"),
    ] {
        let mut scenario = quiet();
        scenario.events.push(Event { at: Span::from_s(1.0), on_trigger: None, lasts: Span::from_s(1.0), action });
        let refused = SteppedRun::new(&scenario, |_| Box::new(NullSink::new())).err().unwrap().to_string();
        assert!(refused.contains(wanted), "{refused}");
    }
}

/// Flies a quiet scenario of `seconds` with these events and small frames.
fn flown(seconds: f64, events: Vec<Event>) -> (run::wiring::run_end::RunEnd, testbed::acs::Mode) {
    let mut scenario = quiet();
    scenario.bench.timing.duration_s = seconds;
    scenario.events = events;
    crate::pixels::fly(&scenario)
}

fn event(at_s: f64, for_s: f64, action: Action) -> Event {
    Event { at: Span::from_s(at_s), on_trigger: None, lasts: Span::from_s(for_s), action }
}

#[test]
fn a_commanded_safe_mode_stays_until_it_is_left_by_command() {
    use testbed::acs::Mode;
    let (_, mode) = flown(120.0, vec![event(40.0, 0.0, Action::Safe)]);
    assert_eq!(mode, Mode::Safe, "no RESUME was sent");
    let (outcome, mode) = flown(300.0, vec![event(40.0, 0.0, Action::Safe), event(45.0, 0.0, Action::Resume)]);
    assert_ne!(mode, Mode::Safe, "{:?}", outcome.assessment.mode_lines);
}

#[test]
fn overlapping_faults_aboard_end_one_by_one_whatever_is_added_later() {
    let off = || Action::Aboard(VehicleFault::TrackerOff(None));
    let dropout = Action::Aboard(VehicleFault::GyroDropout);
    let stuck = Action::Aboard(VehicleFault::GyroStuck);
    let events = vec![
        event(20.0, 20.0, off()),
        event(40.0, 10.0, off()),
        event(30.0, 5.0, off()),
        event(60.0, 4.0, dropout),
        event(62.0, 1.0, stuck),
        event(70.0, 0.0, Action::Resume),
    ];
    let (outcome, _) = flown(90.0, events);
    // At 2 Hz and 10 Hz: 20 s, 10 s, 5 s of frames, 4 s and 1 s of gyro samples.
    let hits: Vec<u64> = outcome.faults.iter().map(|fault| fault.hits).collect();
    for (got, wanted) in hits.iter().zip([40_u64, 20, 10, 40, 10]) {
        assert!(got.abs_diff(wanted) <= 1, "{hits:?}");
    }
    assert_eq!(outcome.assessment.violations().1, Vec::<String>::new());
}

#[test]
fn refused_command_is_not_a_success() {
    use config::Pointing;
    let mut scenario = scenario("sun_avoidance");
    scenario.bench.timing.duration_s = 130.0;
    scenario.expect.window_s = 10.0;
    scenario.expect.final_mode = None;
    // The Sun is near RA 342, Dec -7.6 on that day.
    let to_the_sun = Pointing { ra_deg: 342.0, dec_deg: -7.6, roll_deg: 0.0 };
    scenario.events = vec![event(100.0, 0.0, Action::Slew(to_the_sun))];
    let (outcome, _) = crate::pixels::fly(&scenario);
    let verdicts = outcome.assessment.verdicts(None, &outcome.record);
    assert!(
        verdicts.iter().any(|v| v.name == "commands" && !v.passed && v.got.contains("from the Sun")),
        "{verdicts:?}"
    );
    scenario.events.clear();
    scenario.vehicle_mut().unwrap().target = to_the_sun;
    let refused = SteppedRun::new(&scenario, |_| Box::new(NullSink::new())).err().unwrap().to_string();
    assert!(refused.contains("deg from the Sun"), "the first target, too: {refused}");
}
