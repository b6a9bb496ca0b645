//! A report as one HTML file that needs no other.

use super::junit::complaint;
use super::plots::plots;
use super::{CaseRow, Report};
use crate::assess::Assessment;
use crate::metric::Metric;
use crate::requirements::Verdict;
use core::fmt::Write;
use frames::report::xml::escaped;

const STYLE: &str = "body{font:15px/1.45 Helvetica,Arial,'DejaVu Sans',sans-serif;color:#222;background:#fff;max-width:72em;margin:1.5em auto;padding:0 1em}\
h1{font-size:1.25em;padding:.6em .8em;border-radius:4px;color:#fff}.met{background:#00694e}.broken{background:#a83a00}\
h2{font-size:1.1em;margin:1.8em 0 .4em;border-bottom:1px solid #ccc}table{border-collapse:collapse;font-size:.86em;margin:.4em 0}\
th,td{text-align:left;padding:.22em .7em;border-bottom:1px solid #e3e3e3;vertical-align:top}td.n{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}\
th{background:#f3f3f3}tr.bad td{background:#fff1ea}code{font-size:.92em;word-break:break-all}.how{color:#555;max-width:30em}\
svg{max-width:100%;height:auto;margin:.6em 0}p.small{color:#555;font-size:.86em}@media print{body{max-width:none}h2{break-after:avoid}svg{break-inside:avoid}}";

/// Returns the report as HTML.
#[must_use]
pub fn to_html(report: &Report, assessment: &Assessment) -> String {
    let mut page = Page(String::new());
    let class = if report.is_met { "met" } else { "broken" };
    let verdict = escaped(&report.verdict);
    page.add(&format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{verdict}</title>\n<style>{STYLE}</style></head>\n\
         <body><h1 class=\"{class}\">{verdict}</h1>"
    ));
    page.statement(report);
    page.requirements(report);
    page.metrics("Metrics", report.metrics.iter().filter(|metric| metric.case.is_none()), false);
    page.add("<h2>Plots</h2>");
    plots(report, assessment).iter().for_each(|plot| page.add(plot));
    page.metrics("Metrics of single cases", report.metrics.iter().filter(|metric| metric.case.is_some()), true);
    page.conditions(report);
    page.cases(&report.cases);
    page.provenance(report);
    page.add("</body></html>");
    page.0
}

/// Text under construction.
struct Page(String);

impl Page {
    fn add(&mut self, text: &str) {
        self.0.push_str(text);
        self.0.push('\n');
    }

    fn table(&mut self, heads: &[&str]) {
        let heads = heads.iter().fold(String::new(), |mut all, head| {
            let _ = write!(all, "<th>{}</th>", escaped(head)); // writing to a string does not fail
            all
        });
        self.add(&format!("<table><thead><tr>{heads}</tr></thead><tbody>"));
    }

    fn end_table(&mut self) {
        self.add("</tbody></table>");
    }

    fn statement(&mut self, report: &Report) {
        let settings = &report.settings;
        self.add(&format!(
            "<p>Metrics by the names and definitions of ECSS-E-ST-60-20C. Intervals have a confidence of {:.4} %; performances are \
             stated at a probability of {:.4} %. The error of an attitude is the small turn of the measured frame from the true \
             one at the time that the tracker states: about x and y (directional) and about the boresight (rotational). A \
             solution is false where it is off by more than {} arcsec directionally or {} arcsec rotationally. A requirement is \
             met where the end of the interval nearest to the limit meets it.</p>",
            100.0 * settings.confidence,
            100.0 * settings.probability,
            settings.false_limit.directional_arcsec,
            settings.false_limit.rotational_arcsec,
        ));
    }

    fn requirements(&mut self, report: &Report) {
        self.add("<h2>Requirements</h2>");
        self.table(&["identifier", "requirement", "verdict", "measured"]);
        for judgement in &report.requirements {
            let requirement = &judgement.requirement;
            let class = if judgement.verdict == Verdict::Met { "" } else { " class=\"bad\"" };
            self.add(&format!(
                "<tr{class}><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
                escaped(&requirement.id),
                escaped(&requirement.text),
                judgement.verdict.name(),
                escaped(&complaint(judgement)),
            ));
        }
        self.end_table();
    }

    fn metrics<'a>(&mut self, title: &str, metrics: impl Iterator<Item = &'a Metric>, with_case: bool) {
        let metrics: Vec<&Metric> = metrics.collect();
        if metrics.is_empty() {
            return;
        }
        self.add(&format!("<h2>{title}</h2>"));
        let mut heads = vec!["metric", "value", "low", "high", "unit", "degrees of freedom", "reading", "how"];
        if with_case {
            heads.insert(0, "case");
            heads.pop();
        }
        self.table(&heads);
        for metric in metrics {
            let high = metric.high.map_or_else(|| "unbounded".to_owned(), number);
            let case = metric.case.as_deref().map_or_else(String::new, |case| format!("<td>{}</td>", escaped(case)));
            let how = if with_case { String::new() } else { format!("<td class=\"how\">{}</td>", escaped(metric.how)) };
            self.add(&format!(
                "<tr>{case}<td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{high}</td><td>{}</td>\
                 <td class=\"n\">{:.0}</td><td>{}</td>{how}</tr>",
                escaped(&metric.id),
                number(metric.value),
                number(metric.low),
                metric.unit,
                metric.count,
                metric.reading.name(),
            ));
        }
        self.end_table();
    }

    fn conditions(&mut self, report: &Report) {
        self.add("<h2>Conditions</h2>");
        self.table(&["what", "value"]);
        for (what, value) in &report.conditions {
            self.add(&format!("<tr><td>{}</td><td>{}</td></tr>", escaped(what), escaped(value)));
        }
        self.end_table();
    }

    fn cases(&mut self, cases: &[CaseRow]) {
        self.add("<h2>Cases</h2>");
        self.table(&["case", "use", "frames", "right", "false", "none", "rows without a frame", "conditions"]);
        for case in cases {
            let conditions: Vec<String> =
                case.conditions.iter().map(|(key, value)| format!("{key} {}", number(*value))).collect();
            let nothing = case.frames - case.right - case.wrong;
            self.add(&format!(
                "<tr><td>{}</td><td>{:?}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td>\
                 <td class=\"n\">{nothing}</td><td class=\"n\">{}</td><td>{}</td></tr>",
                escaped(&case.name),
                case.purpose,
                case.frames,
                case.right,
                case.wrong,
                case.stray_rows,
                escaped(&conditions.join("; ")),
            ));
        }
        self.end_table();
    }

    fn provenance(&mut self, report: &Report) {
        let from = &report.provenance;
        self.add("<h2>Provenance</h2>");
        self.table(&["what", "value"]);
        let seeds: Vec<String> = from.seeds.iter().map(|(name, seed)| format!("{name} {seed}")).collect();
        let catalogs: Vec<String> = from.catalogs.iter().map(|(name, what)| format!("{name}: {what}")).collect();
        let rows = [
            ("made", from.made_utc.clone()),
            ("command line", from.command_line.join(" ")),
            ("starloop", format!("{}, SHA-256 {}", from.program_version, from.program_sha256)),
            ("machine", format!("{}, {}, {}", from.host, from.cpu, from.system)),
            ("seeds", seeds.join(", ")),
            ("catalogs", catalogs.join(", ")),
            ("form of this report", report.schema.to_owned()),
        ];
        for (what, value) in rows {
            self.add(&format!("<tr><td>{what}</td><td><code>{}</code></td></tr>", escaped(&value)));
        }
        self.end_table();
        self.table(&["file", "bytes", "SHA-256"]);
        for file in &from.files {
            self.add(&format!(
                "<tr><td>{}</td><td class=\"n\">{}</td><td><code>{}</code></td></tr>",
                escaped(&file.path),
                file.bytes,
                escaped(&file.sha256)
            ));
        }
        self.end_table();
    }
}

/// A number with four digits that count.
fn number(value: f64) -> String {
    if value == 0.0 || !value.is_finite() {
        return if value == 0.0 { "0".into() } else { "-".into() };
    }
    let magnitude = value.abs();
    if (1e-3..1e5).contains(&magnitude) {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to 6")]
        let digits = (3.0 - magnitude.log10().floor()).clamp(0.0, 6.0) as usize;
        let text = format!("{value:.digits$}");
        if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.').to_owned() } else { text }
    } else {
        format!("{value:.3e}")
    }
}
