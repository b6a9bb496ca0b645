//! A report as one HTML file that needs no other, with its plots, and as JUnit XML.

use crate::provenance::FileHash;
use crate::record::{Judged, JudgedCase, Use};
use crate::report::{CaseRow, Report, data_of, measured, missing, number, percent, rule};
use crate::requirements::{Judgement, Outcome, Verdict};
use crate::{assess::Assessment, metric::Metric, noise::SINE};
use base::{units::ARCSEC, xml::escaped};
use core::fmt::Write;
use frames::report::plot::{Axis, Scale, Series, Style};
use frames::report::{Chart, Page, junit, to_svg};

/// Returns the report as HTML; `data` is the hash of the report as JSON beside it.
pub fn to_html(report: &Report, assessment: &Assessment, data: &FileHash) -> String {
    let class = match report.outcome {
        Outcome::Passed => "met",
        Outcome::NotShown => "open",
        Outcome::Failed => "broken",
    };
    let mut page = Page::begun(&report.verdict, class, "");
    paperwork(&mut page, report, data);
    statement(&mut page, report);
    requirements(&mut page, report);
    metrics(&mut page, "Metrics", report.metrics.iter().filter(|metric| metric.case.is_none()), false);
    page.heading("Plots");
    plots(report, assessment).iter().for_each(|plot| page.add(plot));
    metrics(&mut page, "Metrics of single cases", report.metrics.iter().filter(|metric| metric.case.is_some()), true);
    meanings(&mut page, report.metrics.iter().filter(|metric| metric.case.is_some()));
    conditions(&mut page, report);
    cases(&mut page, &report.cases);
    report.provenance.write(&mut page, usize::MAX);
    page.end()
}

/// Unit, author, date, hash of the data, and the place to sign.
fn paperwork(page: &mut Page, report: &Report, data: &FileHash) {
    let document = &report.document;
    page.table(&[]);
    for (what, text) in [
        ("unit under test", &document.unit),
        ("serial number", &document.serial_number),
        ("author", &document.author),
        ("date of test", &document.date_of_test),
    ] {
        page.row(&[what, text.as_deref().unwrap_or("-")]);
    }
    page.row(&["data of this report", &format!("{}, SHA-256 {}", data.path, data.sha256)]);
    page.row(&["form of this report", report.schema]);
    page.add("<tr><td>approved by, date, signature</td><td class=\"sign\"></td></tr>");
    page.end_table();
}

fn statement(page: &mut Page, report: &Report) {
    let settings = &report.settings;
    page.add(&format!(
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

fn requirements(page: &mut Page, report: &Report) {
    page.heading("Requirements");
    page.table(&["identifier", "requirement", "verdict", "compared", "measured", "missing"]);
    for judgement in &report.requirements {
        let requirement = &judgement.requirement;
        let class = match judgement.verdict {
            Verdict::Met => "",
            Verdict::NotMet => "bad",
            Verdict::NotShown | Verdict::NotMeasured => "open",
        };
        let (verdict, rule) = (judgement.verdict.name(), rule(judgement));
        let (measured, missing) = (measured(judgement), missing(judgement));
        page.row_of(class, &[requirement.id.as_str(), &requirement.text, verdict, rule, &measured, &missing]);
    }
    page.end_table();
}

fn metrics<'a>(page: &mut Page, title: &str, metrics: impl Iterator<Item = &'a Metric>, with_case: bool) {
    let metrics: Vec<&Metric> = metrics.collect();
    if metrics.is_empty() {
        return;
    }
    page.heading(title);
    let mut heads = vec!["metric", "value", "low", "high", "unit", "data", "reading"];
    if with_case {
        heads.insert(0, "case");
    }
    page.table(&heads);
    for metric in metrics {
        let high = metric.high.map_or_else(|| "unbounded".to_owned(), number);
        let case = metric.case.as_deref().map_or_else(String::new, |case| format!("<td>{}</td>", escaped(case)));
        let how = if with_case { String::new() } else { format!("<span class=\"how\">{}</span>", escaped(metric.how)) };
        page.add(&format!(
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
    page.end_table();
}

/// How metrics of single cases are computed, each once.
fn meanings<'a>(page: &mut Page, metrics: impl Iterator<Item = &'a Metric>) {
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
        page.add(&format!("<ul>{list}</ul>"));
    }
}

fn conditions(page: &mut Page, report: &Report) {
    page.heading("Conditions");
    page.values(report.conditions.iter().cloned());
}

fn cases(page: &mut Page, cases: &[CaseRow]) {
    page.heading("Cases");
    page.table(&[
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
        let counts = [case.frames, case.missing_frames, case.right, case.wrong, nothing, case.stray_rows];
        let mut cells = vec![case.name.clone(), case.purpose.words().to_owned(), number(case.duration_s)];
        cells.extend(counts.iter().map(usize::to_string));
        cells.push(conditions.join("; "));
        page.row(&cells);
    }
    page.end_table();
}

// The report's plots: errors in time, across the boresight, their spread, acquisition, and what sweeps did.

/// Interrupts a line.
const GAP: [f64; 2] = [f64::NAN; 2];
/// Most points of one series: a report stays small.
const MOST_POINTS: usize = 1500;
/// Points of a curve.
const CURVE_POINTS: u32 = 60;
/// Most plots of errors in time.
const MOST_IN_TIME: usize = 4;

/// Returns the plots as SVG.
pub(super) fn plots(report: &Report, assessment: &Assessment) -> Vec<String> {
    let cases = &assessment.cases;
    let mut charts: Vec<Chart> = vec![across(cases), cumulative(cases)];
    charts.extend(acquisition(cases));
    let in_time = cases.iter().filter(|case| matches!(case.purpose, Use::Run | Use::Drift));
    charts.extend(in_time.take(MOST_IN_TIME).map(errors_in_time));
    charts.extend(ratios(report, cases));
    charts.extend(sweeps(report));
    charts.iter().filter(|chart| chart.series.iter().any(|series| !series.points.is_empty())).map(to_svg).collect()
}

/// Every n-th point, so that at most [`MOST_POINTS`] are left, and all gaps.
fn thinned(points: Vec<[f64; 2]>) -> Vec<[f64; 2]> {
    let step = points.len().div_ceil(MOST_POINTS).max(1);
    let is_kept = |(i, point): &(usize, [f64; 2])| i.is_multiple_of(step) || point[0].is_nan();
    points.into_iter().enumerate().filter(is_kept).map(|(_, point)| point).collect()
}

/// Points of some frames, with a gap where a frame has none, and where frames are missing.
fn with_gaps(case: &JudgedCase, point: impl Fn(&Judged) -> Option<[f64; 2]>) -> Vec<[f64; 2]> {
    let mut points: Vec<[f64; 2]> = Vec::new();
    let mut last: Option<u32> = None;
    for frame in &case.frames {
        let is_next = last.is_none_or(|last| frame.truth.frame == last + 1);
        let found = point(frame);
        if (!is_next || found.is_none()) && points.last().is_some_and(|point| !point[0].is_nan()) {
            points.push(GAP);
        }
        points.extend(found);
        last = Some(frame.truth.frame);
    }
    points
}

fn errors_in_time(case: &JudgedCase) -> Chart {
    let zero_ns = case.frames.first().map_or(0, |frame| frame.truth.mid_ns);
    let t_s = |frame: &Judged| (frame.truth.mid_ns - zero_ns) as f64 * 1e-9;
    let of = |axis: usize| thinned(with_gaps(case, |frame| Some([t_s(frame), frame.error_rad()?[axis] / ARCSEC])));
    let names = ["about x", "about y", "about the boresight"].into_iter().enumerate();
    // The boresight's error is the largest: behind the others.
    let mut all: Vec<Series> = names.rev().map(|(axis, name)| Series::new(name, Style::Line, axis, of(axis))).collect();
    let half_s = case.frames.first().map_or(0.0, |frame| 0.5 * frame.truth.exposure_s);
    let faults = with_gaps(case, |frame| frame.truth.has_fault.then(|| [t_s(frame), 0.0]));
    let faults: Vec<[f64; 2]> =
        faults.into_iter().flat_map(|[t_s, y]| [[t_s - half_s, y], [t_s + half_s, y]]).collect();
    if !faults.is_empty() {
        all.push(Series::new("commanded fault", Style::Front, 0, faults));
    }
    Chart::new(format!("Error in time: {}", case.name), Axis::linear("time, s"), Axis::linear("error, arcsec"), all)
}

fn across(cases: &[JudgedCase]) -> Chart {
    let of = |wanted: &[Use]| {
        let frames = cases.iter().filter(|case| wanted.contains(&case.purpose)).flat_map(|case| &case.frames);
        thinned(
            frames.filter_map(|frame| frame.error_rad()).map(|error| [error.x / ARCSEC, error.y / ARCSEC]).collect(),
        )
    };
    let all = vec![
        Series::new("lost in space", Style::Points, 1, of(&[Use::LostInSpace])),
        Series::new(
            "inertial and grids",
            Style::Points,
            0,
            of(&[Use::Inertial, Use::FovGrid, Use::PixelGrid, Use::Run, Use::Drift]),
        ),
    ];
    let shown = all.into_iter().filter(|series| !series.points.is_empty()).collect();
    let axis = |name: &str| Axis::linear(format!("error about {name}, arcsec"));
    Chart::new("Errors across the boresight", axis("x"), axis("y"), shown)
}

fn cumulative(cases: &[JudgedCase]) -> Chart {
    let frames = cases
        .iter()
        .filter(|case| !matches!(case.purpose, Use::Slew | Use::Stress | Use::Bandwidth))
        .flat_map(|case| &case.frames);
    let errors: Vec<_> = frames.filter_map(|frame| frame.error_rad()).collect();
    let of = |measure: fn(&glam::DVec3) -> f64| {
        let mut values: Vec<f64> = errors.iter().map(|error| measure(error) / ARCSEC).collect();
        values.sort_by(f64::total_cmp);
        let n = values.len() as f64;
        thinned(values.into_iter().enumerate().map(|(i, value)| [value, (i + 1) as f64 / n]).collect())
    };
    let all = vec![
        Series::new("directional", Style::Line, 0, of(|error| error.x.hypot(error.y))),
        Series::new("rotational", Style::Line, 1, of(|error| error.z.abs())),
    ];
    Chart::new("Share of attitudes with a smaller error", Axis::log("error, arcsec"), Axis::share("share"), all)
}

fn acquisition(cases: &[JudgedCase]) -> Option<Chart> {
    let lost: Vec<&JudgedCase> = cases.iter().filter(|case| case.purpose == Use::LostInSpace).collect();
    let groups = lost.iter().flat_map(|case| case.frames.chunk_by(|a, b| a.truth.group == b.truth.group));
    let groups: Vec<_> = groups.collect();
    let mut found: Vec<usize> =
        groups.iter().filter_map(|group| group.iter().position(|frame| frame.is_right())).collect();
    found.sort_unstable();
    let longest = groups.iter().map(|group| group.len()).max()?;
    let share = |frames: usize| found.partition_point(|at| *at < frames) as f64 / groups.len() as f64;
    let points = (0..=longest).map(|frames| [frames as f64, share(frames)]).collect();
    let all = vec![Series::new("found", Style::Line, 2, points)];
    let (x, y) = (Axis::linear("frames"), Axis::share("share of attitudes"));
    Some(Chart::new("Acquisition from lost in space", x, y, all))
}

/// The amplitude ratio over the frequency, and that of the exposure alone.
fn ratios(report: &Report, cases: &[JudgedCase]) -> Option<Chart> {
    let swept = cases.iter().filter(|case| case.purpose == Use::Bandwidth);
    let point =
        |case: &JudgedCase| Some([*case.conditions.get(SINE)?, metric(report, "amplitude_ratio", &case.name)?.value]);
    let mut measured: Vec<[f64; 2]> = swept.filter_map(point).collect();
    measured.sort_by(|a, b| a[0].total_cmp(&b[0]));
    let last = measured.last()?[0];
    let exposure_s = cases.iter().find(|case| case.purpose == Use::Bandwidth)?.frames.first()?.truth.exposure_s;
    let sinc = |hz: f64| {
        let x = core::f64::consts::PI * hz * exposure_s;
        if x == 0.0 { 1.0 } else { (x.sin() / x).abs() }
    };
    let exposure = (0..=CURVE_POINTS).map(|i| last * f64::from(i) / f64::from(CURVE_POINTS)).map(|hz| [hz, sinc(hz)]);
    let all = vec![
        Series::new("measured", Style::Points, 0, measured),
        Series::new("exposure alone", Style::Line, 1, exposure.collect()),
    ];
    let (x, y) = (Axis::linear("frequency, Hz"), Axis::linear("output over line of sight"));
    Some(Chart::new("Amplitude ratio", x, y, all))
}

/// A sweep: cases that share what their names begin with and the key of a value.
fn sweeps(report: &Report) -> Vec<Chart> {
    let mut stems: Vec<(&str, String)> = Vec::new();
    for case in report.cases.iter().filter(|case| case.purpose != Use::Bandwidth) {
        if let Some((stem, key, _)) = swept(case) {
            let known = (stem, key.to_owned());
            if !stems.contains(&known) {
                stems.push(known);
            }
        }
    }
    let mut charts = Vec::new();
    for (stem, key) in &stems {
        let of = |id: &str| -> Vec<[f64; 2]> {
            let cases = report.cases.iter().filter(|case| swept(case).is_some_and(|(s, k, _)| s == *stem && k == key));
            let value = |case: &CaseRow| Some([swept(case)?.2, metric(report, id, &case.name)?.value]);
            cases.filter_map(value).collect()
        };
        let tracking = vec![Series::new("tracking probability", Style::Line, 0, of("tracking_probability"))];
        let share = Axis::share("share of frames");
        charts.push(Chart::new(format!("{stem}: tracking"), Axis::linear(key), share, tracking));
        let noise = [
            ("across, per axis", "temporal_noise.directional_per_axis"),
            ("about the boresight", "temporal_noise.rotational"),
        ];
        let noise =
            noise.into_iter().enumerate().map(|(group, (name, id))| Series::new(name, Style::Line, group, of(id)));
        let y = Axis { label: "1 sigma, arcsec".into(), scale: Scale::Log };
        charts.push(Chart::new(format!("{stem}: temporal noise"), Axis::linear(key), y, noise.collect()));
    }
    charts
}

/// Begin of a swept case's name, the key of its value, and the value.
fn swept(case: &CaseRow) -> Option<(&str, &str, f64)> {
    let (stem, last) = case.name.rsplit_once(' ')?;
    let value: f64 = last.parse().ok()?;
    let (key, value) =
        case.conditions.iter().filter(|(key, _)| !key.starts_with("total_")).find(|(_, v)| **v == value)?;
    Some((stem, key, *value))
}

fn metric<'a>(report: &'a Report, id: &str, case: &str) -> Option<&'a Metric> {
    report.metrics.iter().find(|metric| metric.id == id && metric.case.as_deref() == Some(case))
}

// A report as JUnit XML: a test case for each requirement. One that is not met is a failure, one that is not shown an error.

/// Returns the document.
pub fn to_junit(report: &Report) -> String {
    junit::document(&report.title, None, &report.requirements.iter().map(test_case).collect::<Vec<_>>())
}

fn test_case(judgement: &Judgement) -> (String, String) {
    let name = escaped(&format!("{} {}", judgement.requirement.id, judgement.requirement.text));
    let body = if judgement.verdict == Verdict::Met {
        String::new()
    } else {
        let missing = missing(judgement);
        let separator = if missing.is_empty() { "" } else { "; " };
        let message = escaped(&format!("{}{separator}{missing}", measured(judgement)));
        let element = if judgement.verdict == Verdict::NotMet { "failure" } else { "error" };
        format!("<{element} type=\"{}\" message=\"{message}\"/>", escaped(judgement.verdict.name()))
    };
    (format!("classname=\"tracker\" name=\"{}\"", name.trim()), body)
}
