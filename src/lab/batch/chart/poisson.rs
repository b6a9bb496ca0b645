//! Distance from Poisson's law, its bound and the time per pixel of every Poisson method, over its domain.

use crate::chart::stage::Effort;
use base::image::{DnImage, Image};
use base::refused::Refused;
use core::convert::Infallible;
use frames::report::plot::{Axis, Chart, Series, Style};
use image::detector::poisson::distance::distance;
use image::detector::{Detector, DetectorConditions, DetectorParams, PoissonMethod};
use serde::{Deserialize, Serialize};

/// One method at one mean.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct PoissonRow {
    /// The method.
    pub method: String,
    /// Mean, electrons.
    pub lambda_e: f64,
    /// Kolmogorov distance between the drawn numbers and Poisson's law.
    pub distance: f64,
    /// Its bound.
    pub bound: f64,
    /// Bound that the method guarantees over its domain.
    pub promise: f64,
    /// Time per pixel on one thread, conversion to DN included, ns.
    pub ns_per_pixel: f64,
    /// The same as predicted, ns.
    pub predicted_ns: f64,
}

/// Returns means, electrons: some per decade, and the limits of the domains.
fn lambdas_e(quick: bool) -> Vec<f64> {
    let per_decade = if quick { 1 } else { 4 };
    let spread = (-per_decade..=6 * per_decade).map(|i| 10_f64.powf(f64::from(i) / f64::from(per_decade)).min(1e6));
    let mut lambdas: Vec<f64> = spread.chain([19.9, 20.0]).collect();
    lambdas.sort_by(f64::total_cmp);
    lambdas
}

/// Measures every method at every mean of its domain.
///
/// # Errors
/// When the measuring thread cannot be started.
pub fn measure(quick: bool, effort: Effort) -> Result<Vec<PoissonRow>, Refused> {
    let side_px = if quick { 128 } else { 512 };
    let thread = rayon::ThreadPoolBuilder::new().num_threads(1).build();
    let thread = thread.map_err(|error| Refused(format!("no thread to measure Poisson methods on: {error}")))?;
    let mut rows = Vec::new();
    for method in PoissonMethod::ALL {
        let mut detector = Detector::new(shot_only(method), side_px, side_px, 1);
        for lambda_e in lambdas_e(quick).into_iter().filter(|lambda| method.is_within_domain(*lambda)) {
            let Some(distance) = distance(method, lambda_e) else { continue };
            rows.push(PoissonRow {
                method: method.name().into(),
                lambda_e,
                distance,
                bound: method.error_bound(lambda_e),
                promise: method.promise(),
                ns_per_pixel: thread.install(|| ns_per_pixel(&mut detector, lambda_e, side_px, effort)),
                predicted_ns: method.cost_ns(lambda_e),
            });
        }
    }
    Ok(rows)
}

fn shot_only(poisson: PoissonMethod) -> DetectorParams {
    DetectorParams { gain_e_per_dn: 100.0, poisson, ..DetectorParams::QUIET }
}

fn ns_per_pixel(detector: &mut Detector, lambda_e: f64, side_px: usize, effort: Effort) -> f64 {
    let (mut mean, mut dn) = (Image::new(side_px, side_px), DnImage::new(side_px, side_px));
    #[allow(clippy::cast_possible_truncation, reason = "detectors draw from means in f32")]
    mean.pixels_mut().fill(lambda_e as f32);
    let collected = effort.time(|| {
        detector.collect(&mean, 1, &DetectorConditions::dark(0.1), &mut dn);
        Ok::<_, Infallible>(())
    });
    collected.map_or(f64::NAN, |time| time.median_ms * 1e6 / (side_px * side_px) as f64)
}

/// Returns a chart of the distance against the mean, with bounds; `auto` is inversion and Cornish-Fisher.
pub fn chart(rows: &[PoissonRow]) -> Chart {
    let shown = PoissonMethod::ALL.into_iter().filter(|method| *method != PoissonMethod::Auto);
    let mut series = Vec::new();
    for (group, method) in shown.enumerate() {
        let points = |value: fn(&PoissonRow) -> f64| {
            let of_method = rows.iter().filter(|row| row.method == method.name());
            of_method.map(|row| [row.lambda_e, value(row)]).collect::<Vec<[f64; 2]>>()
        };
        series.push(Series::new(method.name(), Style::Points, group, points(|row| row.distance)));
        series.push(Series::new(format!("{method}, bound"), Style::DashedLine, group, points(|row| row.bound)));
    }
    let cost = |method: PoissonMethod| {
        let of_method = rows.iter().filter(|row| row.method == method.name()).map(|row| row.ns_per_pixel);
        let (least, most) = of_method.fold((f64::INFINITY, 0.0_f64), |(a, b), ns| (a.min(ns), b.max(ns)));
        format!("{method} {least:.1} to {most:.1}")
    };
    let costs: Vec<String> = PoissonMethod::ALL.into_iter().map(cost).collect();
    let (x, y) = (Axis::log("mean, electrons"), Axis::log("Kolmogorov distance"));
    let what = "Computed from the distributions that are drawn, not sampled; dashed: the bound. auto is inversion below 20 \
                electrons and cornish-fisher from there.";
    Chart::new("Poisson methods: distance from the law", x, y, series)
        .noted(what)
        .noted(format!("Time per pixel on one thread, ns: {}.", costs.join(", ")))
}
