//! `run --junit`: the verdict of a run as JUnit XML, which CI systems read: a test case for the verdict, each expectation, and
//! the invariants.

use crate::cli::scenario_report::ScenarioReport;
use base::xml::escaped;
use frames::report::{RunVerdict, RunWord};
use run::wiring::assessment::Verdict;

/// Returns the document; `report` is `None` for a run without expectations, faults and a spacecraft.
pub(super) fn to_junit(name: &str, verdict: &RunVerdict, report: Option<&ScenarioReport>, wall_s: f64) -> String {
    let failure = (verdict.word != RunWord::Ok).then(|| format!("{}: {}", verdict.word, verdict.reasons_line()));
    let mut cases = vec![("verdict".to_owned(), failure)];
    if let Some(report) = report {
        cases.extend(report.verdicts.iter().map(expectation));
        let broken = (report.violations > 0).then(|| report.violation_lines.join("; "));
        cases.push(("invariants".into(), broken));
    }
    document(name, &cases, wall_s)
}

/// Returns name and failure of an expectation.
fn expectation(one: &Verdict) -> (String, Option<String>) {
    let failure = (!one.passed).then(|| format!("wanted {}, got {}", one.wanted, one.got));
    (format!("expect: {}", one.name), failure)
}

fn document(name: &str, cases: &[(String, Option<String>)], wall_s: f64) -> String {
    let failures = cases.iter().filter(|(_, failure)| failure.is_some()).count();
    let mut text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n<testsuites>\n<testsuite name=\"{}\" tests=\"{}\" failures=\"{failures}\" \
         errors=\"0\" skipped=\"0\" time=\"{wall_s:.3}\">\n",
        escaped(name),
        cases.len()
    );
    for (case, failure) in cases {
        let head = format!("<testcase classname=\"run\" name=\"{}\"", escaped(case));
        text += &match failure {
            None => format!("{head}/>\n"),
            Some(failure) => format!("{head}><failure message=\"{}\"/></testcase>\n", escaped(failure)),
        };
    }
    text + "</testsuite>\n</testsuites>\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_met_is_a_failure_with_what_was_wanted() {
        let of = |passed| Verdict { name: "fine pointing", wanted: "< 9 s".into(), got: "12 s".into(), passed };
        let text = document("a & b", &[("verdict".into(), None), expectation(&of(false)), expectation(&of(true))], 1.0);
        assert!(text.contains("name=\"a &amp; b\" tests=\"3\" failures=\"1\""), "{text}");
        assert!(text.contains("<failure message=\"wanted &lt; 9 s, got 12 s\"/>"), "{text}");
        assert_eq!(text.matches("<testcase").count(), 3, "{text}");
    }
}
