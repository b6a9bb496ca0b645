//! A report as one HTML file that needs no other.

use super::plots::plots;
use super::words::{data_of, measured, missing, number, percent, rule};
use super::{CaseRow, Report};
use crate::requirements::{Outcome, Verdict};
use crate::{assess::Assessment, metric::Metric, provenance::FileHash};
use base::xml::escaped;
use core::fmt::Write;

const STYLE: &str = "body{font:15px/1.45 Helvetica,Arial,'DejaVu Sans',sans-serif;color:#222;background:#fff;max-width:72em;margin:1.5em auto;padding:0 1em}\
h1{font-size:1.25em;padding:.6em .8em;border-radius:4px;color:#fff}.met{background:#00694e}.open{background:#7a5a00}.broken{background:#a83a00}\
h2{font-size:1.1em;margin:1.8em 0 .4em;border-bottom:1px solid #ccc}table{border-collapse:collapse;font-size:.86em;margin:.4em 0}\
th,td{text-align:left;padding:.22em .7em;border-bottom:1px solid #e3e3e3;vertical-align:top}td.n{text-align:right;font-variant-numeric:tabular-nums;white-space:nowrap}\
th{background:#f3f3f3}tr.bad td{background:#fff1ea}tr.open td{background:#fff8dc;color:inherit}code{font-size:.92em;word-break:break-all}.how{display:block;color:#555;min-width:20em;max-width:44em}td.sign{min-width:14em;height:2.2em}\
svg{max-width:100%;height:auto;margin:.6em 0}p.small{color:#555;font-size:.86em}@media print{body{max-width:none}table{width:100%}h1{print-color-adjust:exact;-webkit-print-color-adjust:exact}h2{break-after:avoid}svg{break-inside:avoid}}";

/// Returns the report as HTML; `data` is the hash of the report as JSON beside it.
pub fn to_html(report: &Report, assessment: &Assessment, data: &FileHash) -> String {
    let mut page = Page(String::new());
    let class = match report.outcome {
        Outcome::Passed => "met",
        Outcome::NotShown => "open",
        Outcome::Failed => "broken",
    };
    let verdict = escaped(&report.verdict);
    page.add(&format!(
        "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{verdict}</title>\n<style>{STYLE}</style></head>\n\
         <body><h1 class=\"{class}\">{verdict}</h1>"
    ));
    page.paperwork(report, data);
    page.statement(report);
    page.requirements(report);
    page.metrics("Metrics", report.metrics.iter().filter(|metric| metric.case.is_none()), false);
    page.add("<h2>Plots</h2>");
    plots(report, assessment).iter().for_each(|plot| page.add(plot));
    page.metrics("Metrics of single cases", report.metrics.iter().filter(|metric| metric.case.is_some()), true);
    page.meanings(report.metrics.iter().filter(|metric| metric.case.is_some()));
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

    /// Unit, author, date, hash of the data, and the place to sign.
    fn paperwork(&mut self, report: &Report, data: &FileHash) {
        let document = &report.document;
        let given = |text: &Option<String>| text.as_deref().map_or_else(|| "-".to_owned(), escaped);
        self.add("<table><tbody>");
        for (what, text) in [
            ("unit under test", &document.unit),
            ("serial number", &document.serial_number),
            ("author", &document.author),
            ("date of test", &document.date_of_test),
        ] {
            self.add(&format!("<tr><td>{what}</td><td>{}</td></tr>", given(text)));
        }
        self.add(&format!(
            "<tr><td>data of this report</td><td>{}, SHA-256 <code>{}</code></td></tr>",
            escaped(&data.path),
            data.sha256
        ));
        self.add("<tr><td>approved by, date, signature</td><td class=\"sign\"></td></tr>");
        self.end_table();
    }

    fn statement(&mut self, report: &Report) {
        let settings = &report.settings;
        self.add(&format!(
            "<p>Metrics by the names and definitions of ECSS-E-ST-60-20C. Intervals are two-sided and have a confidence of {}; \
             performances are stated at a probability of {}. The error of an attitude is the small turn of the measured frame from the true \
             one at the time that the tracker states: about x and y (directional) and about the boresight (rotational). A \
             solution is false where it is off by more than {} arcsec directionally or {} arcsec rotationally. A requirement \
             that is compared by interval is met where the whole interval meets the limit, not met where none of it does, and \
             not shown in between; one that is compared by value is met where the measured value meets it, whatever its interval. \
             The report has failed where a requirement is not met; \
             where none is broken and not all are shown, more data are needed.</p>",
            percent(settings.confidence),
            percent(settings.probability),
            settings.false_limit.directional_arcsec,
            settings.false_limit.rotational_arcsec,
        ));
    }

    fn requirements(&mut self, report: &Report) {
        self.add("<h2>Requirements</h2>");
        self.table(&["identifier", "requirement", "verdict", "compared", "measured", "missing"]);
        for judgement in &report.requirements {
            let requirement = &judgement.requirement;
            let class = match judgement.verdict {
                Verdict::Met => "",
                Verdict::NotMet => " class=\"bad\"",
                Verdict::NotShown | Verdict::NotMeasured => " class=\"open\"",
            };
            self.add(&format!(
                "<tr{class}><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td><td>{}</td></tr>",
                escaped(&requirement.id),
                escaped(&requirement.text),
                judgement.verdict.name(),
                rule(judgement),
                escaped(&measured(judgement)),
                escaped(&missing(judgement)),
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
        let mut heads = vec!["metric", "value", "low", "high", "unit", "data", "reading"];
        if with_case {
            heads.insert(0, "case");
        }
        self.table(&heads);
        for metric in metrics {
            let high = metric.high.map_or_else(|| "unbounded".to_owned(), number);
            let case = metric.case.as_deref().map_or_else(String::new, |case| format!("<td>{}</td>", escaped(case)));
            let how =
                if with_case { String::new() } else { format!("<span class=\"how\">{}</span>", escaped(metric.how)) };
            self.add(&format!(
                "<tr>{case}<td>{}{how}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{high}</td><td>{}</td>\
                 <td>{}</td><td>{}</td></tr>",
                escaped(&metric.id),
                number(metric.value),
                number(metric.low),
                metric.unit,
                data_of(metric),
                metric.reading.name(),
            ));
        }
        self.end_table();
    }

    /// How metrics of single cases are computed, each once.
    fn meanings<'a>(&mut self, metrics: impl Iterator<Item = &'a Metric>) {
        let mut known: Vec<&str> = Vec::new();
        let mut list = String::new();
        for metric in metrics {
            let id = metric.id.split('.').next().unwrap_or_default();
            if !known.contains(&id) {
                known.push(id);
                let _ = write!(list, "<li>{}: {}</li>", escaped(id), escaped(metric.how)); // writing to a string does not fail
            }
        }
        if !list.is_empty() {
            self.add(&format!("<ul>{list}</ul>"));
        }
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
        self.table(&[
            "case",
            "use",
            "duration, s",
            "frames",
            "missing frames",
            "right",
            "false",
            "none",
            "rows without a frame",
            "conditions",
        ]);
        for case in cases {
            let conditions: Vec<String> =
                case.conditions.iter().map(|(key, value)| format!("{key} {}", number(*value))).collect();
            let nothing = case.frames - case.right - case.wrong;
            self.add(&format!(
                "<tr><td>{}</td><td>{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{}</td>\
                 <td class=\"n\">{}</td><td class=\"n\">{}</td><td class=\"n\">{nothing}</td><td class=\"n\">{}</td><td>{}</td></tr>",
                escaped(&case.name),
                case.purpose.words(),
                number(case.duration_s),
                case.frames,
                case.missing_frames,
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
