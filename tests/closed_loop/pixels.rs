//! Tests the loop closed over pixels: from lost in space to fine pointing, against theory and against its own control.

use base::clock::Stopwatch;
use config::{Document, Scenario};
use frames::sink::{NullSink, SentFrame, Sink};
use run::wiring::assemble::{OnRow, Outputs, Run, RunOptions};
use run::{runtime::RunRecord, wiring::run_end::RunEnd, wiring::stepped::SteppedRun};
use std::sync::atomic::{AtomicBool, Ordering};
use std::{path::Path, sync::Arc};
use testbed::acs::Mode;

/// Largest error of the closed loop relative to linear theory for the tracker's noise: star places have more errors
/// than noise (pixel phase, neighbours), and the window contains few independent values of a slow loop.
const OVER_PREDICTION: f64 = 1.5;

/// Returns a scenario of `configs/scenarios`.
pub(crate) fn scenario(name: &str) -> Scenario {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs/scenarios").join(name);
    Scenario::load(&path.with_extension("toml")).unwrap()
}

/// Runs a scenario to its end.
pub(crate) fn fly(scenario: &Scenario) -> (RunEnd, Mode) {
    let mut going = SteppedRun::new(scenario, |_| Box::new(NullSink::new())).unwrap();
    going.run_to_end(&mut |_, _, _| true).unwrap();
    let mode = going.with_vehicle(|vehicle| vehicle.mode()).unwrap();
    (going.end(None), mode)
}

/// Runs a scenario on the real clock; `sink` makes the sink of each head.
pub(crate) fn fly_real(
    scenario: &Scenario,
    sink: &mut dyn FnMut(usize) -> Box<dyn Sink>,
    on_row: OnRow,
    progress: &mut dyn FnMut(usize, &SentFrame, &RunRecord),
) -> RunEnd {
    let mut run = Run::assemble(scenario, RunOptions::real(Outputs::Made(sink))).unwrap();
    run.on_row(on_row);
    let end = run.fly(&Arc::new(AtomicBool::new(false)), progress).unwrap();
    assert!(end.error.is_none(), "{:?}", end.error.as_ref().map(ToString::to_string));
    end
}

fn complaints(name: &str, outcome: &RunEnd) -> Vec<String> {
    let predicted = outcome.flown.predicted_pointing_arcsec();
    let verdicts = outcome.assessment.verdicts(predicted, &outcome.record);
    let failed = verdicts.iter().filter(|verdict| !verdict.passed).map(|verdict| format!("{name}: {verdict:?}"));
    let broken = outcome.assessment.violations().1.iter().map(|line| format!("{name}: {line}"));
    failed.chain(broken).collect()
}

#[test]
fn lost_in_space_becomes_fine_pointing_as_theory_predicts() {
    let acquisition = scenario("acquisition");
    let (outcome, mode) = fly(&acquisition);
    assert_eq!(complaints("acquisition", &outcome), Vec::<String>::new());
    assert_eq!(mode, Mode::FinePointing);
    let predicted_arcsec = outcome.flown.predicted_pointing_arcsec().unwrap();
    let pointing_arcsec = outcome.assessment.pointing().boresight_arcsec.unwrap();
    println!("pointing {pointing_arcsec:.3} arcsec rms, predicted {predicted_arcsec:.3}");
    assert!(pointing_arcsec <= OVER_PREDICTION * predicted_arcsec, "{pointing_arcsec} for {predicted_arcsec} arcsec");
    let (frames, worst_arcsec) = outcome.assessment.rendered();
    assert!(frames > 5000 && worst_arcsec < 0.05, "{frames} frames, {worst_arcsec} arcsec from the truth");
    assert_eq!(acquisition.bench.head_count(), 1);
}

#[test]
fn without_the_tracker_the_same_loop_does_not_point() {
    let acquisition = scenario("acquisition");
    let mut blind = scenario("no_tracker");
    // The same flight, except for the tracker and the expectations.
    let (blind_vehicle, seeing) = (blind.vehicle().unwrap(), acquisition.vehicle().unwrap());
    assert_eq!((blind.bench.seed, blind_vehicle.initial), (acquisition.bench.seed, seeing.initial));
    assert_eq!(blind_vehicle.initial_rate_rad_s, seeing.initial_rate_rad_s);
    assert_eq!((blind_vehicle.target, &blind_vehicle.spacecraft), (seeing.target, &seeing.spacecraft));
    // Its frames are not used: they may be small.
    blind.bench = Scenario::from_document(&Document::built_in("scenarios/campaign.toml").unwrap()).unwrap().bench;
    blind.bench.seed = acquisition.bench.seed;
    blind.bench.timing.duration_s = acquisition.bench.timing.duration_s;
    let (outcome, mode) = fly(&blind);
    assert_eq!(complaints("no tracker", &outcome), Vec::<String>::new());
    assert_ne!(mode, Mode::FinePointing);
    assert_eq!(outcome.flown.estimator.used, 0);
}

#[test]
fn every_scenario_holds() {
    let mut complained = Vec::new();
    for name in [
        "slew_and_settle",
        "sun_avoidance",
        "stray_light",
        "bus_dropouts",
        "bus_faults",
        "three_heads",
        "wheel_sweep",
        "fine_pointing",
    ] {
        let (outcome, _) = fly(&scenario(name));
        complained.extend(complaints(name, &outcome));
        let slews = outcome.assessment.mode_lines.iter().filter(|line| line.to == "slew").count();
        let wanted = usize::from(matches!(name, "slew_and_settle" | "sun_avoidance"));
        assert_eq!(slews, wanted, "{name}: a scenario that slews has slewed");
        assert!(outcome.faults.iter().all(|fault| fault.hits > 0), "{name}: {:?}", outcome.faults);
    }
    assert_eq!(complained, Vec::<String>::new());
}

#[test]
fn stray_light_takes_the_stars_and_gives_them_back() {
    let mut light = scenario("stray_light");
    light.events.retain(|event| event.at.s() > 190.0);
    let mut going = SteppedRun::new(&light, |_| Box::new(NullSink::new())).unwrap();
    let zero = going.times().zero;
    let mut stars_at = |seconds: f64| {
        going.advance_to(zero + base::time::Span::from_s(seconds), &mut |_, _, _| true).unwrap();
        let reports: Vec<_> = going.with_vehicle(|v| v.heads.reports().copied().collect::<Vec<_>>()).unwrap();
        match reports[0].last {
            Some(testbed::tracker::Outcome::Solved(solution)) => solution.stars,
            _ => 0,
        }
    };
    let (before, during, after) = (stars_at(195.0), stars_at(250.0), stars_at(275.0));
    assert!(before > 10 && after > 10, "{before} before, {after} after");
    assert_eq!(during, 0, "saturated");
}

#[test]
fn wheels_shake_the_line_of_sight_where_the_mode_is() {
    let sweep = scenario("wheel_sweep");
    let (outcome, _) = fly(&sweep);
    let (arcsec, wheel_hz) = outcome.assessment.vibration().unwrap();
    // With a free body a mode has more than its cantilever frequency: f / sqrt(1 - d J^-1 d), about 43 Hz here.
    let params = &sweep.vehicle().unwrap().spacecraft.params;
    let mode = &params.modes[0];
    let stiffening = 1.0 - mode.coupling.dot(params.inertia_kg_m2.inverse() * mode.coupling);
    let free_hz = mode.frequency_hz / stiffening.sqrt();
    assert!((wheel_hz / free_hz - 1.0).abs() < 0.03, "loudest at {wheel_hz} Hz, mode at {free_hz} Hz");
    // The rigid body alone: imbalance over inertia for each of four wheels at most.
    let rigid_arcsec = 4.0 * 5e-6 / 9.0 / base::units::ARCSEC;
    assert!(arcsec > 3.0 * rigid_arcsec, "{arcsec} arcsec against {rigid_arcsec} without the mode");
}

/// Returns the CRCs of a short flight, run through or advanced in odd steps.
fn crcs(seed: u64, step_s: Option<f64>) -> (Vec<u32>, u32) {
    let mut short = scenario("bus_dropouts");
    short.bench.seed = seed;
    short.bench.timing.duration_s = 130.0;
    short.expect.window_s = 10.0;
    let mut going = SteppedRun::new(&short, |_| Box::new(NullSink::new())).unwrap();
    if let Some(step_s) = step_s {
        let mut at = going.now();
        while at < going.times().end {
            at = at + base::time::Span::from_s(step_s);
            going.advance_to(at.min(going.times().end), &mut |_, _, _| true).unwrap();
        }
    }
    going.run_to_end(&mut |_, _, _| true).unwrap();
    let outcome = going.end(None);
    (outcome.summaries.iter().flatten().map(|sink| sink.run_crc32).collect(), outcome.assessment.telemetry_crc32())
}

#[test]
fn one_seed_one_hash_whatever_the_other_core_does() {
    let idle = crcs(11, None);
    let over = Arc::new(AtomicBool::new(false));
    let neighbours: Vec<_> = (0..2)
        .map(|i| {
            let over = Arc::clone(&over);
            let spin = move || {
                let mut turns = 0_u64;
                while !over.load(Ordering::Relaxed) {
                    turns = turns.wrapping_add(1);
                }
                turns
            };
            std::thread::Builder::new().name(format!("neighbour {i}")).spawn(spin).unwrap()
        })
        .collect();
    let mut watch = Stopwatch::start();
    let loaded = crcs(11, None);
    println!("beside two busy threads: {:.1} s", watch.lap().s());
    over.store(true, Ordering::Relaxed);
    for neighbour in neighbours {
        assert!(neighbour.join().unwrap() > 0);
    }
    assert_eq!(idle, loaded, "frames and telemetry");
    let other = crcs(12, None);
    assert_ne!(idle.0, other.0, "another seed, other frames");
    assert_ne!(idle.1, other.1, "another seed, other telemetry");
}

#[test]
fn steps_of_any_length_lead_to_the_same_bits() {
    let through = crcs(11, None);
    assert_eq!(through, crcs(11, Some(0.777)));
    assert_eq!(through, crcs(11, Some(13.0)));
}
