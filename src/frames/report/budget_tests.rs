//! Verdicts from made-up records: met, each line broken in its turn; the report read back as JSON and JUnit.

use super::*;
use crate::report::frame_record::{Fate, FrameRecord, MissCause, sample_record};
use crate::report::to_junit;
use crate::report::verdict::{RunVerdict, RunWord};
use base::time::Span;

const FRAMES: u32 = 200;
/// Time of every stage of the made-up run.
const STAGE_MS: i64 = 4;

/// Returns the measurements of a run of made-up frames; one stage may take longer.
fn measured(longer: Option<(Stage, i64)>) -> (StageHistograms, FrameRing) {
    let (mut stages, mut ring) = (StageHistograms::default(), FrameRing::with_capacity(16, 1));
    for number in 0..FRAMES {
        for stage in Stage::ALL {
            let ms = longer.filter(|(longer, _)| *longer == stage).map_or(STAGE_MS, |(_, ms)| ms);
            stages.record_stage(stage, Span::from_ms(ms));
        }
        ring.push(sample_record(number));
        ring.complete(sample_record(number));
    }
    (stages, ring)
}

/// Returns limits for every line that the made-up frames keep.
fn limits() -> BudgetLimits {
    BudgetLimits { stage_p99_ms: [Some(5.0); Stage::COUNT], latency_p99_ms: Some(80.0), missed_frames: 0 }
}

fn report(lines: Vec<BudgetLine>, ring: &FrameRing) -> BudgetReport {
    BudgetReport {
        verdict: RunVerdict { word: RunWord::Ok, reasons: Vec::new(), limits_used: Vec::new() },
        starloop_version: "0".into(),
        bench: "a <bench> & \"more\"".into(),
        camera: "camera".into(),
        backend: "cpu".into(),
        adapter: "AVX2".into(),
        machine: Machine { cpu: "Example".into(), cores: 2, system: "linux".into() },
        duration_s: 20.0,
        load_threads: 2,
        frames: FrameCounts { scheduled: 200, rendered: 200, delivered: 200, ..FrameCounts::default() },
        latency: ring.latency(),
        misses: ring.misses(),
        lines,
        degraded: BTreeMap::new(),
        hygiene: vec![HygieneLine { what: "locked memory".into(), got: false, detail: "limit of 8 MiB".into() }],
        advice: vec!["static would <do>".into()],
    }
}

fn judged(limits: &BudgetLimits, longer: Option<(Stage, i64)>) -> BudgetReport {
    let (stages, ring) = measured(longer);
    report(budget_lines(limits, &stages, &ring), &ring)
}

fn broken(report: &BudgetReport) -> Vec<&'static str> {
    report.broken().map(|line| line.name).collect()
}

#[test]
fn a_run_inside_its_budget_passes() {
    let report = judged(&limits(), None);
    assert_eq!((broken(&report), report.culprit()), (vec![], None));
    let text = budget_table(&report);
    assert!(text.contains("the budget is met") && text.contains("0 of 1 requested settings obtained"), "{text}");
    assert!(text.contains("unavailable: locked memory: limit of 8 MiB"), "{text}");
}

#[test]
fn slow_stage_breaks_only_its_own_line() {
    for stage in Stage::ALL.into_iter().filter(|stage| *stage != Stage::Wait) {
        let report = judged(&limits(), Some((stage, 6)));
        assert_eq!(broken(&report), [stage.name()]);
        let text = budget_table(&report);
        let start = format!("{}: p99 ", stage.name());
        let said = text.lines().find_map(|line| line.split_once(&start)?.1.split_whitespace().next()?.parse().ok());
        let said: f64 = said.unwrap_or_else(|| panic!("no line with \"{start}\":\n{text}"));
        assert!((said - 6.0).abs() < 0.02, "histograms keep two digits: {said}");
        if stage != Stage::ReleaseToDelivered {
            assert_eq!(report.culprit().as_deref(), Some(stage.name()));
        }
        let mut without = limits();
        without.stage_p99_ms[stage as usize] = None;
        assert!(broken(&judged(&without, Some((stage, 6)))).is_empty(), "{}: no limit, no complaint", stage.name());
    }
}

#[test]
fn latency_and_missed_slots_have_lines_of_their_own() {
    let tight = BudgetLimits { latency_p99_ms: Some(70.0), ..limits() };
    assert_eq!(broken(&judged(&tight, None)), [LATENCY], "76 ms from epoch to delivery");
    let (stages, mut ring) = measured(None);
    let cause = Some(MissCause::Stage(Stage::Sky));
    ring.push(FrameRecord { fate: Fate::Dropped, cause, ..sample_record(FRAMES) });
    let one_missed = report(budget_lines(&limits(), &stages, &ring), &ring);
    assert_eq!((broken(&one_missed), one_missed.culprit().as_deref()), (vec![MISSED], Some("sky")));
    let allowed = BudgetLimits { missed_frames: 1, ..limits() };
    assert!(report(budget_lines(&allowed, &stages, &ring), &ring).culprit().is_none());
}

#[test]
fn a_stage_that_did_not_run_is_reported_and_a_run_without_frames_fails() {
    let (stages, ring) = (StageHistograms::default(), FrameRing::default());
    let report = report(budget_lines(&limits(), &stages, &ring), &ring);
    assert_eq!(broken(&report), [Stage::ReleaseToDelivered.name(), LATENCY]);
    let upload = report.lines.iter().find(|line| line.name == "upload").unwrap();
    assert_eq!(upload.verdict, LineVerdict::NotRun);
    assert!(budget_table(&report).contains("nothing was delivered"));
}

#[test]
fn without_a_broken_stage_the_longest_one_is_named() {
    let mut only_total = BudgetLimits::default();
    only_total.stage_p99_ms[Stage::ReleaseToDelivered as usize] = Some(3.0);
    let report = judged(&only_total, Some((Stage::Detector, 90)));
    assert_eq!(report.culprit().as_deref(), Some("detector"));
}

#[test]
fn junit_says_the_same_as_the_lines() {
    let report = judged(&limits(), Some((Stage::Render, 6)));
    let text = to_junit(&report);
    let document = roxmltree::Document::parse(&text).expect("valid XML");
    let suite = document.descendants().find(|node| node.has_tag_name("testsuite")).unwrap();
    assert_eq!(suite.attribute("name"), Some("timing budget of a <bench> & \"more\""), "escaped");
    assert_eq!(suite.attribute("failures"), Some("1"));
    assert_eq!(
        suite.attribute("tests").unwrap(),
        (1 + report.lines.len()).to_string(),
        "the verdict of the run comes first"
    );
    let cases: Vec<_> = suite.children().filter(|node| node.has_tag_name("testcase")).collect();
    assert_eq!((cases.len(), cases[0].attribute("name")), (1 + report.lines.len(), Some("verdict")));
    for (case, line) in cases[1..].iter().zip(&report.lines) {
        assert_eq!(case.attribute("name"), Some(line.name));
        let failure = case.children().find(|node| node.has_tag_name("failure"));
        assert_eq!(failure.is_some(), line.verdict == LineVerdict::Broken, "{}", line.name);
        if let Some(failure) = failure {
            assert!(failure.attribute("message").unwrap().contains("render: p99"), "says what");
            assert!(failure.text().unwrap().contains("static would <do>"), "and what to do");
        }
    }
    assert!(roxmltree::Document::parse(&text.replace("&amp;", "&")).is_err(), "the comparison can fail");
}

#[test]
fn json_holds_every_part() {
    let report = judged(&limits(), Some((Stage::Plan, 9)));
    let json: serde_json::Value = serde_json::from_str(&report.to_json_pretty().unwrap()).unwrap();
    let line = |name: &str| json["lines"].as_array().unwrap().iter().find(|line| line["name"] == name).unwrap().clone();
    assert_eq!((&line("plan")["verdict"], &line("render")["verdict"]), (&"broken".into(), &"met".into()));
    assert_eq!(line("plan")["times"]["max_ms"], 9.0);
    assert_eq!(line(MISSED)["slots"], 0);
    for key in ["p50_ms", "p99_ms", "p999_ms", "max_ms"] {
        assert_eq!(json["latency"]["epoch_to_delivered"][key], 76.0, "{key}");
    }
    assert_eq!((&json["hygiene"][0]["got"], &json["load_threads"]), (&false.into(), &2.into()));
}
