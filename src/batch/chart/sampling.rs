//! PSF sampling: error of every method against the width of the PSF, without motion.

use super::error;
use crate::chart::Settings;
use crate::chart::sweep::{blank_row, measure, refuse};
use crate::chart::{drawer::Drawer, rows::MethodRow, scenes::Scene, stage::Stage, timing::Effort};
use base::refused::Refused;
use frames::report::plot::{Axis, Chart, Series, Style};
use plan::exposure::method::MethodName;
use plan::exposure::{MethodChoice, PsfSampling};

/// Samplings shown in the chart; the table has all.
const SHOWN: [&str; 7] = ["auto", "table:8", "table:2", "supersampled:5", "supersampled:3", "point", "bicubic"];

/// Returns the standard deviations of the PSFs, px.
pub fn sigmas_px(quick: bool) -> &'static [f64] {
    if quick { &[0.3, 0.5, 0.8] } else { &[0.3, 0.4, 0.5, 0.65, 0.8, 1.0, 1.25] }
}

/// Measures all samplings of a Gaussian of `sigma_px`.
///
/// # Errors
/// When a scene's camera is refused.
pub fn measure_all(
    sigma_px: f64,
    settings: &Settings,
    drawers: &mut [Drawer],
    effort: Effort,
    rows: &mut Vec<MethodRow>,
) -> Result<(), Refused> {
    let mut stage = Stage::new(&Scene::still(sigma_px), settings.seed).map_err(error::camera)?;
    let mut known = None;
    for drawer in drawers {
        for sampling in PsfSampling::CHARTED {
            stage.instrument.sampling = sampling;
            let choice = MethodChoice::Fixed(MethodName::Static, None);
            let mut row = blank_row(&sigma_px.to_string(), drawer.name(), choice);
            let measured = measure(&stage, stage.planner(drawer.cost(), choice), drawer, effort, &mut known, &mut row);
            row.method = sampling.to_string();
            if let Err(error) = measured {
                refuse(&mut row, &error);
            }
            rows.push(row);
        }
    }
    Ok(())
}

/// Returns the centroid error against the PSF's width, with bounds; by the first backend.
pub fn chart(rows: &[MethodRow]) -> Chart {
    let backend = rows.first().map_or("", |row| row.backend.as_str());
    let mut series = Vec::new();
    for (group, name) in SHOWN.into_iter().enumerate() {
        let of_name = || rows.iter().filter(move |row| row.backend == backend && row.method == name && row.is_drawn());
        let points = |value: fn(&MethodRow) -> f64| {
            of_name().filter_map(|row| Some([row.scene.parse().ok()?, value(row)])).collect::<Vec<[f64; 2]>>()
        };
        if of_name().next().is_none() {
            continue;
        }
        series.push(Series::new(name, Style::Points, group, points(|row| row.centroid_px)));
        series.push(Series::new("", Style::Line, group, points(|row| row.centroid_px)));
        series.push(Series::new("", Style::DashedLine, group, points(|row| row.bound_centroid_px)));
    }
    Chart {
        title: format!("PSF sampling without motion, {backend} backend"),
        x: Axis::linear("standard deviation of the PSF, px"),
        y: Axis::log("5 x 5 centroid error, px"),
        series,
        ring: String::new(),
        notes: vec![
            "Worst of twelve stars against the f64 reference; dashed: the bound known before drawing. auto draws a \
             Gaussian's exact pixel integrals. More samplings in sampling.csv."
                .into(),
        ],
    }
}
