//! The report's plots: errors in time, across the boresight, their spread, acquisition, and what sweeps did.

use super::Report;
use crate::record::{Judged, JudgedCase, Use};
use crate::{assess::Assessment, bandwidth::SINE, metric::Metric};
use base::units::ARCSEC;
use frames::report::plot::{Axis, Scale, Series, Style};
use frames::report::{Chart, to_svg};

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

fn chart(title: impl Into<String>, x: Axis, y: Axis, series: Vec<Series>) -> Chart {
    Chart { title: title.into(), x, y, series, ring: String::new(), notes: Vec::new() }
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
    chart(format!("Error in time: {}", case.name), Axis::linear("time, s"), Axis::linear("error, arcsec"), all)
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
    chart("Errors across the boresight", axis("x"), axis("y"), shown)
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
    chart("Share of attitudes with a smaller error", Axis::log("error, arcsec"), Axis::share("share"), all)
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
    Some(chart("Acquisition from lost in space", x, y, all))
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
    Some(chart("Amplitude ratio", x, y, all))
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
            let value = |case: &super::CaseRow| Some([swept(case)?.2, metric(report, id, &case.name)?.value]);
            cases.filter_map(value).collect()
        };
        let tracking = vec![Series::new("tracking probability", Style::Line, 0, of("tracking_probability"))];
        charts.push(chart(format!("{stem}: tracking"), Axis::linear(key), Axis::share("share of frames"), tracking));
        let noise = [
            ("across, per axis", "temporal_noise.directional_per_axis"),
            ("about the boresight", "temporal_noise.rotational"),
        ];
        let noise =
            noise.into_iter().enumerate().map(|(group, (name, id))| Series::new(name, Style::Line, group, of(id)));
        let y = Axis { label: "1 sigma, arcsec".into(), scale: Scale::Log };
        charts.push(chart(format!("{stem}: temporal noise"), Axis::linear(key), y, noise.collect()));
    }
    charts
}

/// Begin of a swept case's name, the key of its value, and the value.
fn swept(case: &super::CaseRow) -> Option<(&str, &str, f64)> {
    let (stem, last) = case.name.rsplit_once(' ')?;
    let value: f64 = last.parse().ok()?;
    let (key, value) =
        case.conditions.iter().filter(|(key, _)| !key.starts_with("total_")).find(|(_, v)| **v == value)?;
    Some((stem, key, *value))
}

fn metric<'a>(report: &'a Report, id: &str, case: &str) -> Option<&'a Metric> {
    report.metrics.iter().find(|metric| metric.id == id && metric.case.as_deref() == Some(case))
}
