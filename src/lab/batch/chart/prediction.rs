//! Error of the attitude methods against the time since the sample, on two motions.

use base::axes::Rotation;
use base::units::{ARCSEC, DEG};
use core::f64::consts::PI;
use frames::report::plot::{Axis, Chart, Series, Style};
use glam::DVec3;
use plan::attitude::{AnalyticMotion, MeasuredError, Sinusoid, SinusoidTurn, measured_prediction_errors};
use serde::{Deserialize, Serialize};

/// One method over one horizon.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PredictionRow {
    /// The motion.
    pub motion: String,
    /// The method.
    pub method: String,
    /// Time since the sample; for the interpolation, between the samples, ms.
    pub horizon_ms: f64,
    /// Largest error found, arcsec.
    pub error_arcsec: f64,
    /// Its bound, arcsec (half a turn: outside the method's domain).
    pub bound_arcsec: f64,
}

/// Returns names, titles and motions: jitter about a fixed axis, and a slew with acceleration and jerk.
fn motions() -> [(&'static str, &'static str, AnalyticMotion); 2] {
    let rest = AnalyticMotion {
        initial: Rotation::from_rotation_vector(DVec3::new(0.4, -1.0, 0.9)),
        slew_axis: DVec3::Y,
        rate_rad_s: 0.0,
        acceleration_rad_s2: 0.0,
        jerk_rad_s3: 0.0,
        sinusoids: Vec::new(),
    };
    let sinusoid = Sinusoid { frequency_hz: 7.0, amplitude_rad: 10.0 * ARCSEC };
    let jitter = AnalyticMotion {
        sinusoids: vec![SinusoidTurn { axis: DVec3::new(0.6, 0.0, 0.8), sinusoid, phase_rad: 0.3 }],
        ..rest.clone()
    };
    let slew = AnalyticMotion { rate_rad_s: DEG, acceleration_rad_s2: 0.5 * DEG, jerk_rad_s3: 0.5 * DEG, ..rest };
    [
        ("sinusoid", "sinusoid of 10 arcsec at 7 Hz", jitter),
        ("slew", "slew of 1 deg/s, 0.5 deg/s2 and 0.5 deg/s3", slew),
    ]
}

/// Measures every method over a range of horizons on both motions.
pub fn measure(quick: bool) -> Vec<PredictionRow> {
    let per_decade = if quick { 4 } else { 10 };
    let horizons_s: Vec<f64> =
        (0..=2 * per_decade).map(|i| 2e-3 * 10_f64.powf(f64::from(i) / f64::from(per_decade))).collect();
    let rows = |(name, _, motion): &(&str, &str, AnalyticMotion)| {
        let row = |found: &MeasuredError| PredictionRow {
            motion: (*name).into(),
            method: found.method.name().into(),
            horizon_ms: found.horizon_s * 1e3,
            error_arcsec: found.error_rad / ARCSEC,
            bound_arcsec: found.bound_rad / ARCSEC,
        };
        measured_prediction_errors(motion, &horizons_s).iter().map(row).collect::<Vec<_>>()
    };
    motions().iter().flat_map(rows).collect()
}

/// Returns a chart for each motion, with its file name.
pub fn charts(rows: &[PredictionRow]) -> Vec<(String, Chart)> {
    let file = |i: usize, name: &str| if i == 0 { "prediction".into() } else { format!("prediction_{name}") };
    motions().iter().enumerate().map(|(i, (name, title, _))| (file(i, name), chart(rows, name, title))).collect()
}

fn chart(rows: &[PredictionRow], motion: &str, title: &str) -> Chart {
    let rows: Vec<&PredictionRow> = rows.iter().filter(|row| row.motion == motion).collect();
    let mut names: Vec<&str> = rows.iter().map(|row| row.method.as_str()).collect();
    names.dedup();
    // Half a turn means "no bound", and values of rounding size are left out.
    let has_place = |arcsec: f64| arcsec < 0.99 * PI / ARCSEC && arcsec > 1e-8;
    let unseen = rows.iter().filter(|row| !has_place(row.error_arcsec)).count();
    let unbound = rows.iter().filter(|row| !has_place(row.bound_arcsec)).count();
    let mut series = Vec::new();
    for (group, name) in names.into_iter().enumerate() {
        let points = |value: fn(&PredictionRow) -> f64| {
            let of_name = rows.iter().filter(|row| row.method == name && has_place(value(row)));
            of_name.map(|row| [row.horizon_ms, value(row)]).collect::<Vec<[f64; 2]>>()
        };
        series.push(Series::new(name, Style::Points, group, points(|row| row.error_arcsec)));
        series.push(Series::new(format!("{name}, bound"), Style::DashedLine, group, points(|row| row.bound_arcsec)));
    }
    let x = Axis::log("time since the sample (interpolation: between samples), ms");
    let title = format!("Attitude between samples: {title}");
    Chart::new(title, x, Axis::log("largest error, arcsec"), series).noted(format!(
        "Perfect samples, worst of 96 starts; dashed: the bound. Left out: {unseen} errors below 1e-8 arcsec, which \
         are rounding, and {unbound} bounds outside a method's domain (interpolation: sinusoids below half the \
         sample rate)."
    ))
}
