//! The budget as JUnit XML: one test case per line, for the systems that collect test results.
//!
//! The form is the common one (testsuite, testcase, failure, skipped). A line without a limit is skipped, as is one
//! whose stage did not run.

use crate::report::budget::{BudgetLine, BudgetReport, LineVerdict};
use crate::report::verdict::{RunVerdict, RunWord};
use base::xml::escaped;
use core::fmt::Write;

/// Returns the report as an XML document.
pub fn to_junit(report: &BudgetReport) -> String {
    let count = |wanted: &[LineVerdict]| report.lines.iter().filter(|line| wanted.contains(&line.verdict)).count();
    let mut text = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "<testsuites>\n<testsuite name=\"{}\" tests=\"{}\" failures=\"{}\" errors=\"0\" skipped=\"{}\" time=\"{:.3}\">",
        escaped(&format!("timing budget of {}", report.bench)),
        report.lines.len() + 1,
        count(&[LineVerdict::Broken]) + usize::from(report.verdict.word != RunWord::Ok),
        count(&[LineVerdict::NoLimit, LineVerdict::NotRun]),
        report.duration_s
    );
    write_verdict(&mut text, &report.verdict);
    report.lines.iter().for_each(|line| write_case(&mut text, line, &report.advice));
    text + "</testsuite>\n</testsuites>\n"
}

/// Writes the case of the run itself, whatever its times.
fn write_verdict(text: &mut String, verdict: &RunVerdict) {
    let head = "<testcase classname=\"run\" name=\"verdict\" time=\"0\"";
    let reasons = escaped(&verdict.reasons_line());
    // Writing to a string cannot fail.
    let _ = match verdict.word {
        RunWord::Ok => writeln!(text, "{head}/>"),
        word @ (RunWord::Late | RunWord::Incomplete | RunWord::Lost | RunWord::Failed) => writeln!(
            text,
            "{head}><failure type=\"{word}\" message=\"{reasons}\">{word}: {reasons}</failure></testcase>"
        ),
    };
}

fn write_case(text: &mut String, line: &BudgetLine, advice: &[String]) {
    let seconds = line.times.map_or(0.0, |times| times.p99_ms * 1e-3);
    let head = format!("<testcase classname=\"timing_budget\" name=\"{}\" time=\"{seconds:.6}\"", escaped(line.name));
    let body = match (line.verdict, line.complaint()) {
        (LineVerdict::NoLimit, _) => "<skipped message=\"no limit\"/>".to_owned(),
        (LineVerdict::NotRun, _) => "<skipped message=\"the stage did not run\"/>".to_owned(),
        (_, Some(complaint)) => {
            let (complaint, advice) = (escaped(&complaint), escaped(&advice.join("; ")));
            format!("<failure type=\"over budget\" message=\"{complaint}\">{complaint}. {advice}</failure>")
        }
        (_, None) => String::new(),
    };
    // Writing to a string cannot fail.
    let _ = if body.is_empty() { writeln!(text, "{head}/>") } else { writeln!(text, "{head}>{body}</testcase>") };
}
