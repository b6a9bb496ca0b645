//! Tests latency and jitter injected into the loop over pixels: margins, rejection and errors agree with linear theory.

use base::units::DEG;
use batch::study::point::{
    ACTUATION_DELAY, CROSSOVER, JITTER, PHASE_MARGIN, POINTING_ERROR, REJECTION, TAG, TAG_ERROR,
};
use batch::study::theory::LoopOnPaper;
use batch::study::trial::{CROSSOVER_SHARE, PHASE_MARGIN_DEG, REJECTION_SHARE};
use batch::study::{Agreement, Effort, Studied, Study};
use config::{Document, Scenario};

fn scenario() -> Scenario {
    Scenario::from_document(&Document::built_in("scenarios/study.toml").unwrap()).unwrap()
}

/// Returns the measured values of one kind, over the varied quantity.
fn measured(studied: &Studied, kind: &str, varied: &str) -> Vec<[f64; 2]> {
    let points = studied.points.iter().filter(|point| point.kind == kind && point.varied == varied);
    points.map(|point| [point.value, point.measured]).collect()
}

#[test]
fn the_loop_over_pixels_is_as_theory_predicts_and_not_as_a_wrong_theory() {
    let study = Study::new(&scenario(), Effort::quick()).unwrap();
    let studied = study.run(&|_, _, _| {}).unwrap();
    assert!(studied.is_met(), "{}", studied.summary);
    for kind in [PHASE_MARGIN, CROSSOVER, REJECTION, POINTING_ERROR, TAG_ERROR] {
        assert!(studied.points.iter().any(|point| point.kind == kind && point.verdict == Agreement::Met), "{kind}");
    }
    let names: Vec<&str> = studied.files.iter().map(|file| file.name.as_str()).collect();
    assert_eq!(names, ["study.csv", "phase_margin.svg", "jitter_rejection.svg", "pointing_error.svg"]);
    assert_eq!(studied.files[0].text.lines().count(), studied.points.len() + 1, "a row for every point");

    // Negative controls: the same measurements against the theory of another loop.
    let paper = study.paper;
    let margins = measured(&studied, PHASE_MARGIN, ACTUATION_DELAY);
    assert!(margins.len() > 2);
    for [delay_ms, margin_deg] in margins {
        let hasty = paper.with_delay(delay_ms * 1e-3 + 0.1).phase_margin_rad().unwrap() / DEG;
        assert!((margin_deg - hasty).abs() > PHASE_MARGIN_DEG, "100 ms more must show: {margin_deg} for {hasty}");
    }
    let mut heavy: LoopOnPaper = paper;
    heavy.textbook.inertia_ratio = 1.1;
    let crossover_hz = heavy.crossover_rad_s().unwrap() / core::f64::consts::TAU;
    for [_, hz] in measured(&studied, CROSSOVER, ACTUATION_DELAY) {
        assert!((hz / crossover_hz - 1.0).abs() > CROSSOVER_SHARE, "a tenth more inertia must show: {hz}");
    }
    let far = measured(&studied, REJECTION, JITTER).into_iter().filter(|[hz, left]| {
        let wanted = heavy.sensitivity(core::f64::consts::TAU * hz).modulus();
        (left / wanted - 1.0).abs() > REJECTION_SHARE
    });
    assert!(far.count() > 0, "and in what is left of jitter");
    let [[tag_ms, behind]] = measured(&studied, TAG_ERROR, TAG)[..] else { panic!("one time tag error") };
    assert!(tag_ms * behind > 0.0, "tags that are late leave the estimate behind: {behind} for {tag_ms} ms");
}

#[test]
fn a_bench_without_a_crossover_is_refused() {
    let mut scenario = scenario();
    // Natural frequency above half the control frequency.
    scenario.vehicle_mut().unwrap().spacecraft.control.fine_bandwidth_hz = 20.0;
    let refused = Study::new(&scenario, Effort::quick()).unwrap_err().to_string();
    assert!(refused.contains("gain is one at no frequency"), "{refused}");
}
