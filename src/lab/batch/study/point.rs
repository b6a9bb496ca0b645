//! Points of a study, and the charts and tables made of them.
//!
//! One point of a study: measured value, theoretical value, and whether they agree.

use crate::{chart::File, chart::rows::csv_text, study::Study};
use base::{refused::Refused, units::DEG};
use core::f64::consts::TAU;
use frames::report::plot::{Axis, Chart, Series, Style, to_svg};
use serde::Serialize;

/// Verdict on a point.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Agreement {
    /// Within the tolerance.
    Met,
    /// Outside it.
    NotMet,
    /// Beyond the range in which theory is checked: shown only.
    Reported,
}

/// One row of `study.csv`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StudyPoint {
    /// Measured quantity, with its unit.
    pub kind: &'static str,
    /// Varied quantity, with its unit.
    pub varied: &'static str,
    /// Value of the varied quantity.
    pub value: f64,
    /// Value measured on the true attitude; NaN when the loop did not stay in fine pointing.
    pub measured: f64,
    /// Theoretical value.
    pub predicted: f64,
    /// Measured over predicted.
    pub ratio: f64,
    /// Largest difference that is accepted.
    pub allowed: f64,
    /// Verdict.
    pub verdict: Agreement,
}

/// Phase margin, deg.
pub const PHASE_MARGIN: &str = "phase_margin_deg";
/// Frequency at which the open loop has gain one, Hz.
pub const CROSSOVER: &str = "crossover_hz";
/// Delay at which the phase margin is used up, ms.
pub const DELAY_MARGIN: &str = "delay_margin_ms";
/// Jitter that the loop leaves, relative to the motion of a free body.
pub const REJECTION: &str = "jitter_left";
/// Rms of the boresight's direction about its mean, arcsec.
pub const POINTING_ERROR: &str = "pointing_error_arcsec";
/// Error of the estimate in a turn by wrong time tags, arcsec.
pub const TAG_ERROR: &str = "estimate_behind_arcsec";
/// Largest pointing error beyond the delay margin, arcsec.
pub const LARGEST_ERROR: &str = "largest_error_arcsec";

/// Delay from control step to torque.
pub const ACTUATION_DELAY: &str = "actuation_delay_ms";
/// Delay from the last pixel to the attitude, known by its time tag.
pub const TRACKER_DELAY: &str = "tracker_delay_ms";
/// Error of the time tags.
pub const TAG: &str = "tag_error_ms";
/// Frequency of base jitter.
pub const JITTER: &str = "jitter_hz";

impl StudyPoint {
    /// Returns a point that passes when it is within `allowed` of the prediction.
    pub fn judged(kind: &'static str, (varied, value): (&'static str, f64), got: [f64; 2], allowed: f64) -> Self {
        let [measured, predicted] = got;
        let is_met = (measured - predicted).abs() <= allowed;
        let verdict = if is_met { Agreement::Met } else { Agreement::NotMet };
        Self { kind, varied, value, measured, predicted, ratio: measured / predicted, allowed, verdict }
    }

    /// Returns the point as shown but not judged.
    #[must_use]
    pub fn reported(self) -> Self {
        Self { verdict: Agreement::Reported, ..self }
    }
}

// Points -> `study.csv`, charts as SVG, a table for a terminal.

/// Number of points of a theoretical curve.
const CURVE_POINTS: u32 = 200;

/// Returns the table and every chart.
///
/// # Errors
/// When the table cannot be written.
pub(super) fn files(study: &Study, points: &[StudyPoint]) -> Result<Vec<File>, Refused> {
    let svg = |name: &str, chart: Chart| File { name: format!("{name}.svg"), text: to_svg(&chart) };
    Ok(vec![
        File { name: "study.csv".into(), text: csv_text(points).map_err(|why| Refused(format!("study.csv: {why}")))? },
        svg("phase_margin", phase_margin(study, points)),
        svg("jitter_rejection", rejection(study, points)),
        svg("pointing_error", pointing_error(points)),
    ])
}

fn of<'a>(points: &'a [StudyPoint], kind: &'a str, varied: &'a str) -> impl Iterator<Item = &'a StudyPoint> {
    points.iter().filter(move |point| point.kind == kind && point.varied == varied)
}

fn measured<'a>(points: impl Iterator<Item = &'a StudyPoint>) -> Vec<[f64; 2]> {
    points.map(|point| [point.value, point.measured]).collect()
}

fn phase_margin(study: &Study, points: &[StudyPoint]) -> Chart {
    let margin_ms = study.paper.delay_margin_s().unwrap_or(0.0) * 1e3;
    let curve = |at: &dyn Fn(f64) -> Option<f64>| -> Vec<[f64; 2]> {
        let point = |k: u32| {
            let delay_s = 1.1e-3 * margin_ms * f64::from(k) / f64::from(CURVE_POINTS);
            at(delay_s).map(|rad| [delay_s * 1e3, rad / DEG])
        };
        (0..=CURVE_POINTS).filter_map(point).collect()
    };
    let built = |delay_s: f64| study.paper.with_delay(delay_s).phase_margin_rad();
    let textbook = |delay_s: f64| study.paper.with_delay(delay_s).textbook.phase_margin_rad();
    let series = vec![
        Series::new("theory", Style::Line, 0, curve(&built)),
        Series::new("theory without the gyro's mean", Style::DashedLine, 6, curve(&textbook)),
        Series::new("delay of the torque", Style::Points, 1, measured(of(points, PHASE_MARGIN, ACTUATION_DELAY))),
        Series::new("delay of the tracker", Style::Points, 2, measured(of(points, PHASE_MARGIN, TRACKER_DELAY))),
    ];
    let (x, y) = (Axis::linear("latency injected, ms"), Axis::linear("phase margin, deg"));
    Chart::new("Phase margin against latency, measured over pixels", x, y, series).noted(format!(
        "Sines of torque about the crossover of {:.3} Hz; 1/S - 1 on the true attitude. Zero at {margin_ms:.0} ms on \
         paper. The tracker's delay is known by its time tags and costs no margin.",
        study.bandwidth_hz()
    ))
}

fn rejection(study: &Study, points: &[StudyPoint]) -> Chart {
    let split = |verdict: fn(Agreement) -> bool| {
        measured(of(points, REJECTION, JITTER).filter(move |point| verdict(point.verdict)))
    };
    let shown: Vec<f64> = of(points, REJECTION, JITTER).map(|point| point.value).collect();
    let (low, high) = shown.iter().fold((f64::INFINITY, 0.0_f64), |(low, high), hz| (low.min(*hz), high.max(*hz)));
    let left = |hz: f64| study.paper.sensitivity(TAU * hz).modulus();
    let curve = |k: u32| {
        let hz = low * (high / low).powf(f64::from(k) / f64::from(CURVE_POINTS));
        [hz, left(hz)]
    };
    let bandwidth_hz = study.bandwidth_hz();
    let series = vec![
        Series::new("theory |S|", Style::Line, 0, (0..=CURVE_POINTS).map(curve).collect()),
        Series::new("bandwidth", Style::DashedLine, 6, vec![[bandwidth_hz, left(low)], [bandwidth_hz, 2.0]]),
        Series::new("measured, judged", Style::Points, 1, split(|verdict| verdict != Agreement::Reported)),
        Series::new("measured above the bandwidth", Style::Points, 4, split(|verdict| verdict == Agreement::Reported)),
    ];
    let x = Axis::log("frequency of the jitter, Hz");
    let y = Axis::log("pointing error over the jitter of a free body");
    Chart::new("What the loop leaves of base jitter, measured over pixels", x, y, series).noted(
        "Torque J A w^2 sin(w t) from outside; true attitude. Theory is a rigid body: near a flexible mode the body \
         itself turns more or less.",
    )
}

fn pointing_error(points: &[StudyPoint]) -> Chart {
    let predicted = |varied: &'static str| {
        let mut line: Vec<[f64; 2]> =
            of(points, POINTING_ERROR, varied).map(|point| [point.value, point.predicted]).collect();
        line.sort_by(|a, b| a[0].total_cmp(&b[0]));
        line
    };
    let found = |varied: &'static str| measured(of(points, POINTING_ERROR, varied));
    let series = vec![
        Series::new("theory, delay of the torque", Style::Line, 1, predicted(ACTUATION_DELAY)),
        Series::new("measured, delay of the torque", Style::Points, 1, found(ACTUATION_DELAY)),
        Series::new("theory, delay of the tracker", Style::Line, 2, predicted(TRACKER_DELAY)),
        Series::new("measured, delay of the tracker", Style::Points, 2, found(TRACKER_DELAY)),
    ];
    let (x, y) = (Axis::linear("latency injected, ms"), Axis::log("rms of the boresight about its mean, arcsec"));
    Chart::new("Pointing error at rest against latency, measured over pixels", x, y, series).noted(
        "Both axes together. Theory: tracker and gyro noise through estimator and loop. All points have the same seeds, so \
         they share their scatter of some percent.",
    )
}

/// Returns lines for a terminal.
pub(super) fn table(points: &[StudyPoint]) -> String {
    let head = ["measured", "predicted", "ratio", "allowed"];
    let mut lines = vec![format!(
        "{:<24} {:<20} {:>9}   {:>11} {:>11} {:>8} {:>11}",
        "what", "varied", "to", head[0], head[1], head[2], head[3]
    )];
    for point in points {
        let verdict = match point.verdict {
            Agreement::Met => "",
            Agreement::NotMet => "  NOT MET",
            Agreement::Reported => "  (not judged)",
        };
        let allowed = if point.allowed.is_finite() { format!("{:.4}", point.allowed) } else { "above".into() };
        lines.push(format!(
            "{:<24} {:<20} {:>9.4}   {:>11.4} {:>11.4} {:>8.4} {allowed:>11}{verdict}",
            point.kind, point.varied, point.value, point.measured, point.predicted, point.ratio
        ));
    }
    let outside = points.iter().filter(|point| point.verdict == Agreement::NotMet).count();
    let judged = points.iter().filter(|point| point.verdict != Agreement::Reported).count();
    lines.push(format!("{} of {judged} points as predicted", judged - outside));
    lines.join("\n") + "\n"
}
