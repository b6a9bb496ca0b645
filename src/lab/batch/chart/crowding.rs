//! Time of a frame against the number of its stars: planning and drawing, with jitter, on every backend.
//!
//! In: fields of 1e2 to 1e6 stars of decreasing brightness, a sinusoid of 0.5 px in every exposure. Out:
//! `crowding.csv`, a chart and a verdict: between two numbers of stars the time grows as their ratio to some power,
//! which must be at most 1 (a frame has a part that all stars share). A frame's own part is measured without stars.

use crate::chart::scenes::{Movement, STILL, Scene, Stars};
use crate::chart::stage::{Drawer, Effort, Stage};
use crate::chart::{Settings, stage};
use base::refused::Refused;
use core::fmt::Write;
use frames::report::plot::{Axis, Chart, Series, Style};
use plan::exposure::MethodChoice;
use serde::{Deserialize, Serialize};

/// Numbers of stars.
const STARS: [usize; 9] = [100, 300, 1_000, 3_000, 10_000, 30_000, 100_000, 300_000, 1_000_000];
/// Largest number of stars on a software GPU.
const MOST_ON_SOFTWARE: usize = 30_000;
/// Largest number of stars in a quick run.
const MOST_QUICK: usize = 30_000;

/// One number of stars on one backend.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CrowdingRow {
    /// `cpu` or `gpu`.
    pub backend: String,
    /// Stars on the detector.
    pub stars: usize,
    /// The planner's choice.
    pub method: String,
    /// Planning, median ms.
    pub plan_ms: f64,
    /// Drawing, median ms.
    pub draw_ms: f64,
    /// Sum of both as predicted by the planner, ms.
    pub predicted_ms: f64,
}

impl CrowdingRow {
    /// Returns the time of planning and drawing, ms.
    pub fn total_ms(&self) -> f64 {
        self.plan_ms + self.draw_ms
    }
}

fn scene(stars: usize, quick: bool) -> Scene {
    Scene {
        name: "crowding",
        title: "jitter of 0.5 px",
        size_px: if quick { 1024 } else { 2048 },
        motion: Movement::Sinusoid { amplitude_px: 0.5, cycles: 2.25 },
        stars: Stars::Field(stars),
        ..STILL
    }
}

/// Measures all numbers of stars on all backends.
///
/// # Errors
/// When a backend fails.
pub fn measure(settings: &Settings, drawers: &mut [Drawer], effort: Effort) -> Result<Vec<CrowdingRow>, Refused> {
    let mut rows = Vec::new();
    for drawer in drawers {
        let most = match (settings.quick, drawer.is_software_gpu()) {
            (true, _) => MOST_QUICK,
            (false, true) => MOST_ON_SOFTWARE,
            (false, false) => usize::MAX,
        };
        for stars in STARS.into_iter().filter(|stars| *stars <= most) {
            let stage = Stage::new(&scene(stars, settings.quick), settings.seed).map_err(stage::camera_refused)?;
            let mut planner = stage.planner(drawer.cost(), MethodChoice::Auto);
            let plan_ms = effort.time(|| -> Result<(), Refused> {
                planner.plan(&stage.sources);
                Ok(())
            })?;
            let plan = planner.latest();
            let drawn = effort.time(|| drawer.draw(plan));
            let failed =
                |source| Refused(format!("scene crowding, {backend} backend: {source}", backend = drawer.name()));
            let draw_ms = drawn.map_err(failed)?;
            rows.push(CrowdingRow {
                backend: drawer.name().into(),
                stars,
                method: plan.chosen.method.to_string(),
                plan_ms: plan_ms.median_ms,
                draw_ms: draw_ms.median_ms,
                predicted_ms: plan.chosen.cost_ms,
            });
        }
    }
    Ok(rows)
}

/// Returns, for neighbouring numbers of stars of one backend, the power with which the time grows, and the larger
/// number of the two.
pub fn growth(rows: &[CrowdingRow]) -> Vec<(&str, usize, f64)> {
    let of_pair = |pair: &[CrowdingRow]| {
        let power = (pair[1].total_ms() / pair[0].total_ms()).ln() / (pair[1].stars as f64 / pair[0].stars as f64).ln();
        (pair[0].backend == pair[1].backend).then_some((pair[1].stars, power))
    };
    rows.windows(2)
        .filter_map(|pair| of_pair(pair).map(|(stars, power)| (pair[0].backend.as_str(), stars, power)))
        .collect()
}

/// Returns the chart.
pub fn chart(rows: &[CrowdingRow]) -> Chart {
    let mut series = Vec::new();
    let mut backends: Vec<&str> = rows.iter().map(|row| row.backend.as_str()).collect();
    backends.dedup();
    for (group, backend) in backends.iter().enumerate() {
        let of = |value: fn(&CrowdingRow) -> f64| {
            let rows = rows.iter().filter(|row| row.backend == *backend);
            rows.map(|row| [row.stars as f64, value(row)]).collect::<Vec<_>>()
        };
        series.push(Series::new(format!("{backend}, measured"), Style::Points, group, of(CrowdingRow::total_ms)));
        series.push(Series::new(format!("{backend}, predicted"), Style::DashedLine, group, of(|row| row.predicted_ms)));
    }
    let (x, y) = (Axis::log("stars on the detector"), Axis::log("planning and drawing, ms"));
    Chart::new("Time of a frame by its stars, jitter of 0.5 px", x, y, series)
        .noted("Gaussian PSF of 0.8 px; medians. The planner's prediction is of planning and drawing.")
}

/// Returns lines for a terminal.
pub fn summary(rows: &[CrowdingRow]) -> String {
    let mut text = String::from(
        "\ntime by number of stars (jitter of 0.5 px)\n  backend     stars   plan ms   draw ms  ns a star  method\n",
    );
    for row in rows {
        let CrowdingRow { backend, stars, method, plan_ms, draw_ms, .. } = row;
        let ns = row.total_ms() * 1e6 / *stars as f64;
        let _ = writeln!(text, "  {backend:<7} {stars:>9} {plan_ms:>9.3} {draw_ms:>9.3} {ns:>10.0}  {method}");
    }
    let steepest = growth(rows).into_iter().max_by(|a, b| a.2.total_cmp(&b.2));
    if let Some((backend, stars, power)) = steepest {
        let _ = writeln!(
            text,
            "  steepest on the {backend} up to {stars} stars: the time grows as their number to the power {power:.2}"
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    fn row(backend: &str, stars: usize, draw_ms: f64) -> CrowdingRow {
        let (backend, method) = (backend.into(), String::new());
        CrowdingRow { backend, stars, method, plan_ms: 1.0, draw_ms, predicted_ms: 1.0 }
    }

    #[test]
    fn growth_is_a_power_and_backends_are_apart() {
        let rows = [row("cpu", 100, 1.0), row("cpu", 400, 3.0), row("cpu", 800, 31.0), row("gpu", 100, 1.0)];
        let powers = growth(&rows);
        assert_eq!(powers.len(), 2);
        assert!((powers[0].2 - 0.5).abs() < 1e-12, "twice the time for four times the stars: {powers:?}");
        assert!((powers[1].2 - 3.0).abs() < 1e-12, "{powers:?}");
        let reported = summary(&rows);
        assert!(reported.contains("up to 800 stars") && reported.contains("power 3.00"), "{reported}");
        assert_eq!(chart(&rows).series.len(), 4);
    }
}
