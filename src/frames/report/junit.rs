//! JUnit XML, for the systems that collect test results; of a budget: one test case per line.
//!
//! The form is the common one (testsuite, testcase, failure, skipped). A line without a limit is skipped, as is one
//! whose stage did not run.

use crate::report::budget::{BudgetLine, BudgetReport, LineVerdict};
use crate::report::verdict::{RunVerdict, RunWord};
use base::xml::escaped;

/// Returns a suite of test cases: of each the attributes, and what its element holds, which is nothing where it passed.
pub fn document(suite: &str, time_s: Option<f64>, cases: &[(String, String)]) -> String {
    let count = |element: &str| cases.iter().filter(|(_, body)| body.starts_with(element)).count();
    let time = time_s.map_or_else(String::new, |s| format!(" time=\"{s:.3}\""));
    let mut text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites>\n\
         <testsuite name=\"{}\" tests=\"{}\" failures=\"{}\" errors=\"{}\" skipped=\"{}\"{time}>\n",
        escaped(suite),
        cases.len(),
        count("<failure"),
        count("<error"),
        count("<skipped")
    );
    for (attributes, body) in cases {
        let end = if body.is_empty() { "/>".to_owned() } else { format!(">{body}</testcase>") };
        text += &format!("<testcase {attributes}{end}\n");
    }
    text + "</testsuite>\n</testsuites>\n"
}

/// Returns a budget as a document.
pub fn to_junit(report: &BudgetReport) -> String {
    let lines = report.lines.iter().map(|line| of_line(line, &report.advice));
    let cases: Vec<_> = core::iter::once(of_verdict(&report.verdict)).chain(lines).collect();
    document(&format!("timing budget of {}", report.bench), Some(report.duration_s), &cases)
}

/// Returns the case of the run itself, whatever its times.
fn of_verdict(verdict: &RunVerdict) -> (String, String) {
    let (word, reasons) = (verdict.word, escaped(&verdict.reasons_line()));
    let failure = format!("<failure type=\"{word}\" message=\"{reasons}\">{word}: {reasons}</failure>");
    let body = if word == RunWord::Ok { String::new() } else { failure };
    ("classname=\"run\" name=\"verdict\" time=\"0\"".into(), body)
}

fn of_line(line: &BudgetLine, advice: &[String]) -> (String, String) {
    let seconds = line.times.map_or(0.0, |times| times.p99_ms * 1e-3);
    let body = match (line.verdict, line.complaint()) {
        (LineVerdict::NoLimit, _) => "<skipped message=\"no limit\"/>".to_owned(),
        (LineVerdict::NotRun, _) => "<skipped message=\"the stage did not run\"/>".to_owned(),
        (_, Some(complaint)) => {
            let (complaint, advice) = (escaped(&complaint), escaped(&advice.join("; ")));
            format!("<failure type=\"over budget\" message=\"{complaint}\">{complaint}. {advice}</failure>")
        }
        (_, None) => String::new(),
    };
    (format!("classname=\"timing_budget\" name=\"{}\" time=\"{seconds:.6}\"", escaped(line.name)), body)
}
