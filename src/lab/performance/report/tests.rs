use super::*;
use crate::synthetic::{Dice, Frame, case};
use crate::{assess::assess, record::Case, requirements::Requirements};
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
    let judged = Requirements::parse(requirements, "r").unwrap().judge(&assessment.metrics, &assessment.settings);
    let document = Paperwork { serial_number: Some("SN <7>".into()), ..Paperwork::default() };
    (Report::new("a & b".into(), &assessment, judged, Vec::new(), (document, provenance())), assessment)
}

fn page(report: &Report, assessment: &Assessment) -> String {
    to_html(report, assessment, &crate::provenance::FileHash::of_text("report.json", &report.to_json().unwrap()))
}

const MET: &str = "[[requirement]]\nid = \"R<1>\"\nmetric = \"bias.x\"\nmost = 2.0\n";
const BROKEN: &str = "[[requirement]]\nid = \"R2\"\nmetric = \"bias.x\"\nmost = 0.5\n";

#[test]
fn the_verdict_comes_first_and_everything_is_escaped() {
    let (report, assessment) = report(MET);
    let html = page(&report, &assessment);
    let heading = html.lines().find(|line| line.contains("<h1")).unwrap();
    assert!(heading.contains("PASSED: a &amp; b: 1 of 1 requirement met, 3 cases"), "{heading}");
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
    assert!(page(&report, &assessment).contains("NOT MET"));
    let junit = to_junit(&report);
    assert!(
        junit.contains("tests=\"2\" failures=\"1\" errors=\"0\"") && junit.contains("bias.x: wanted at most 0.5"),
        "{junit}"
    );
    let json: serde_json::Value = serde_json::from_str(&report.to_json().unwrap()).unwrap();
    assert_eq!(json["schema"], SCHEMA);
    assert_eq!(json["requirements"][1]["verdict"], "not_met");
    assert!(json["metrics"].as_array().unwrap().iter().any(|metric| metric["id"] == "acquisition_confidence"));
}

#[test]
fn a_verdict_by_value_says_so_in_its_row_and_in_the_verdict_line() {
    let (by_interval, assessment) = report(MET);
    assert!(
        !by_interval.verdict.contains("by value") && page(&by_interval, &assessment).contains("<td>by interval</td>")
    );
    let (by_value, assessment) = report(&format!("{}by = \"value\"\n", MET.replace("2.0", "1.05")));
    assert!(by_value.verdict.contains("1 compared by value, not by interval"), "{}", by_value.verdict);
    let html = page(&by_value, &assessment);
    assert!(html.contains("<td>by value</td>") && html.contains("; compared by value"), "row");
    assert!(to_junit(&report(&format!("{BROKEN}by = \"value\"\n")).0).contains("compared by value"));
}

#[test]
fn what_is_not_shown_is_no_failure_and_names_what_it_needs() {
    let open = "[[requirement]]\nid = \"R3\"\nmetric = \"acquisition_probability\"\nleast = 0.997\n";
    let (report, assessment) = report(&format!("{MET}{open}"));
    assert!(report.verdict.starts_with("NOT SHOWN: a & b: 1 of 2 requirements met, 1 not shown"), "{}", report.verdict);
    assert!(!report.is_met);
    let html = page(&report, &assessment);
    assert!(html.contains("<h1 class=\"open\">") && html.contains("needs 1228 attitudes, has 20"), "colour and count");
    let junit = to_junit(&report);
    assert!(junit.contains("failures=\"0\" errors=\"1\"") && junit.contains("needs 1228 attitudes, has 20"), "{junit}");
    let json: serde_json::Value = serde_json::from_str(&report.to_json().unwrap()).unwrap();
    assert_eq!((&json["outcome"], &json["requirements"][1]["needs"]["needed"]), (&"not_shown".into(), &1228.into()));
}

#[test]
fn the_page_names_the_unit_and_the_hash_of_its_data() {
    let (report, assessment) = report(MET);
    let html = page(&report, &assessment);
    let hash = crate::provenance::FileHash::of_text("", &report.to_json().unwrap()).sha256;
    assert!(html.contains("<td>SN &lt;7&gt;</td>") && html.contains("approved by, date, signature"));
    assert!(html.contains(&hash) && !html.contains("<td>1 <x>"), "hash of report.json");
    assert!(html.contains("95 %") && html.contains("99.7 %") && !html.contains("95.0000 %"), "no zeros");
    assert!(html.contains("<td>LostInSpace</td><td>lost in space</td>"), "name, and the use in plain words");
}

#[test]
fn missing_frames_are_counted_and_times_are_those_of_the_frames() {
    let mut one = cases().remove(0);
    let rows = CaseRow::of(&one.judged(&crate::synthetic::LIMIT));
    assert_eq!(rows.missing_frames, 0, "control");
    assert!((rows.duration_s - 199.1).abs() < 1e-6, "{}", rows.duration_s);
    one.truth.drain(50..80);
    let rows = CaseRow::of(&one.judged(&crate::synthetic::LIMIT));
    assert_eq!((rows.frames, rows.missing_frames), (170, 30));
}

#[test]
fn a_loss_is_a_gap_and_a_fault_is_marked() {
    let mut dice = Dice::new(9);
    let mut frames: Vec<Frame> = (0..60).map(|i| Frame::still(f64::from(i), 0, dice.normals())).collect();
    frames[20..30].iter_mut().for_each(|frame| frame.error_arcsec = None);
    let mut run = case(Use::Run, &frames);
    let lines = |run: &Case| {
        let assessment = assess(std::slice::from_ref(run), &Settings::default());
        let report = Report::new("r".into(), &assessment, Vec::new(), Vec::new(), (Paperwork::default(), provenance()));
        let plots = forms::plots(&report, &assessment);
        let plot = plots.iter().find(|plot| plot.contains("Error in time")).unwrap().clone();
        (plot.matches("<polyline").count(), plot.contains("commanded fault"), plot.contains("left out"))
    };
    assert_eq!(lines(&run), (6, false, false), "two parts of each of three lines");
    run.truth[20..30].iter_mut().for_each(|row| row.has_fault = true);
    assert_eq!(lines(&run), (7, true, false));
    run.truth.drain(40..45);
    assert_eq!(lines(&run).0, 10, "frames that are not there are a gap too");
}
