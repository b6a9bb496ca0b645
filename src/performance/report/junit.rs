//! A report as JUnit XML: a test case for each requirement.

use super::Report;
use crate::requirements::{Judgement, Verdict};
use core::fmt::Write;
use frames::report::xml::escaped;

/// Returns the document.
#[must_use]
pub fn to_junit(report: &Report) -> String {
    let count = |wanted: &[Verdict]| report.requirements.iter().filter(|one| wanted.contains(&one.verdict)).count();
    let mut text = String::from("<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n");
    let _ = writeln!(
        text,
        "<testsuites>\n<testsuite name=\"{}\" tests=\"{}\" failures=\"{}\" errors=\"0\" skipped=\"0\">",
        escaped(&report.title),
        report.requirements.len(),
        count(&[Verdict::NotMet, Verdict::NotShown, Verdict::NotMeasured])
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
        let complaint = escaped(&complaint(judgement));
        writeln!(
            text,
            "{head}><failure type=\"{}\" message=\"{complaint}\"/></testcase>",
            escaped(judgement.verdict.name())
        )
    };
}

/// Returns why a requirement is not met, in words.
#[must_use]
pub(super) fn complaint(judgement: &Judgement) -> String {
    let requirement = &judgement.requirement;
    let limit = match (requirement.most, requirement.least) {
        (Some(most), _) => format!("at most {most}"),
        (None, Some(least)) => format!("at least {least}"),
        (None, None) => String::new(),
    };
    match &judgement.measured {
        None => format!("{}: wanted {limit}, and nothing was measured", requirement.metric),
        Some(metric) => {
            let high = metric.high.map_or_else(|| "more".to_owned(), |high| format!("{high:.6}"));
            format!(
                "{}: wanted {limit}, got {:.6} ({:.6} to {high}) {}",
                metric.id, metric.value, metric.low, metric.unit
            )
        }
    }
}
