use super::*;
use crate::assess::assess;
use crate::record::Case;
use crate::requirements::Requirements;
use crate::synthetic::{Dice, Frame, case};
use glam::DVec3;

fn cases() -> Vec<Case> {
    let mut dice = Dice::new(1);
    let mut frame = |i: u32| Frame::still(f64::from(i), i / 10, dice.normals() + DVec3::X);
    let inertial: Vec<Frame> = (0..200).map(&mut frame).collect();
    let mut stress = case(Use::Stress, &inertial);
    stress.name = "rate 0.5".into();
    stress.conditions.insert("rate_deg_s".into(), 0.5);
    vec![case(Use::Inertial, &inertial), case(Use::LostInSpace, &inertial), stress]
}

fn provenance() -> Provenance {
    Provenance {
        schema: crate::provenance::SCHEMA.into(),
        program_version: "1 <x>".into(),
        program_sha256: String::new(),
        command_line: vec!["starloop".into(), "report".into()],
        made_utc: "2026-01-01T00:00:00Z".into(),
        host: "h".into(),
        cpu: "c".into(),
        system: "s".into(),
        seeds: vec![("plan".into(), 1)],
        catalogs: Vec::new(),
        files: vec![crate::provenance::FileHash::of_text("a & b", "x")],
    }
}

fn report(requirements: &str) -> (Report, Assessment) {
    let assessment = assess(&cases(), &Settings::default());
    let judged = Requirements::parse(requirements, "r").unwrap().judge(&assessment.metrics);
    (Report::new("a & b".into(), &assessment, judged, Vec::new(), provenance()), assessment)
}

const MET: &str = "[[requirement]]\nid = \"R<1>\"\nmetric = \"bias.x\"\nmost = 2.0\n";
const BROKEN: &str = "[[requirement]]\nid = \"R2\"\nmetric = \"bias.x\"\nmost = 0.5\n";

#[test]
fn the_verdict_comes_first_and_everything_is_escaped() {
    let (report, assessment) = report(MET);
    let html = to_html(&report, &assessment);
    let heading = html.lines().find(|line| line.contains("<h1")).unwrap();
    assert!(heading.contains("PASSED: a &amp; b: 1 of 1 requirements met"), "{heading}");
    assert!(html.contains("R&lt;1&gt;") && !html.contains("<x>") && html.len() < MOST_HTML_BYTES);
    assert!(
        html.matches("<svg").count() >= 4 && !html.contains("http://") | html.contains("www.w3.org"),
        "self-contained"
    );
    assert!(!html.contains("<script") && !html.contains("src="));
}

#[test]
fn a_broken_requirement_is_a_failure_everywhere() {
    let (report, assessment) = report(&format!("{MET}{BROKEN}"));
    assert!(!report.is_met && report.verdict.starts_with("FAILED"));
    assert!(to_html(&report, &assessment).contains("NOT MET"));
    let junit = to_junit(&report);
    assert!(junit.contains("tests=\"2\" failures=\"1\"") && junit.contains("bias.x: wanted at most 0.5"), "{junit}");
    let json: serde_json::Value = serde_json::from_str(&report.to_json().unwrap()).unwrap();
    assert_eq!(json["schema"], SCHEMA);
    assert_eq!(json["requirements"][1]["verdict"], "not_met");
    assert!(json["metrics"].as_array().unwrap().iter().any(|metric| metric["id"] == "acquisition_confidence"));
}
