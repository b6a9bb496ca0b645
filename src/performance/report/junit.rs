//! A report as JUnit XML: a test case for each requirement. One that is not met is a failure, one that is not shown an error.

use super::Report;
use super::words::{measured, missing};
use crate::requirements::{Judgement, Verdict};
use base::xml::escaped;
use core::fmt::Write;

/// Returns the document.
pub fn to_junit(report: &Report) -> String {
    let count = |wanted: &[Verdict]| report.requirements.iter().filter(|one| wanted.contains(&one.verdict)).count();
    let mut text = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
    let _ = writeln!(
        text,
        "<testsuites>\n<testsuite name=\"{}\" tests=\"{}\" failures=\"{}\" errors=\"{}\" skipped=\"0\">",
        escaped(&report.title),
        report.requirements.len(),
        count(&[Verdict::NotMet]),
        count(&[Verdict::NotShown, Verdict::NotMeasured])
    );
    report.requirements.iter().for_each(|judgement| write_case(&mut text, judgement));
    text + "</testsuite>\n</testsuites>\n"
}

fn write_case(text: &mut String, judgement: &Judgement) {
    let name = escaped(&format!("{} {}", judgement.requirement.id, judgement.requirement.text));
    let head = format!("<testcase classname=\"tracker\" name=\"{}\"", name.trim());
    let _text_only_grows = if judgement.verdict == Verdict::Met {
        writeln!(text, "{head}/>")
    } else {
        let missing = missing(judgement);
        let separator = if missing.is_empty() { "" } else { "; " };
        let message = escaped(&format!("{}{separator}{missing}", measured(judgement)));
        let element = if judgement.verdict == Verdict::NotMet { "failure" } else { "error" };
        let kind = escaped(judgement.verdict.name());
        writeln!(text, "{head}><{element} type=\"{kind}\" message=\"{message}\"/></testcase>")
    };
}
