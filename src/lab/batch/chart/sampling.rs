//! Errors that come from the PSF alone: its sampling, and light outside a footprint.
//!
//! PSF sampling: error of every method against the width of the PSF, without motion.

use crate::chart::stage::{Drawer, Effort, Stage};
use crate::chart::sweep::{blank_row, measure, refuse};
use crate::chart::{Settings, stage};
use crate::chart::{rows::MethodRow, scenes::Scene};
use base::refused::Refused;
use frames::report::plot::{Axis, Chart, Series, Style};
use plan::exposure::{MethodChoice, PsfSampling};
use plan::{exposure::method::MethodName, optics::PsfModel, optics::psf::LARGEST_HALF_PX};
use serde::{Deserialize, Serialize};

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
    let mut stage = Stage::new(&Scene::still(sigma_px), settings.seed).map_err(stage::camera_refused)?;
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
    let (x, y) = (Axis::linear("standard deviation of the PSF, px"), Axis::log("5 x 5 centroid error, px"));
    Chart::new(format!("PSF sampling without motion, {backend} backend"), x, y, series).noted(
        "Worst of twelve stars against the f64 reference; dashed: the bound known before drawing. auto draws a \
         Gaussian's exact pixel integrals. More samplings in sampling.csv.",
    )
}

// Light outside a square footprint, against its half-width: summed pixel by pixel, and the bound.

/// Positions of the star in its pixel: in the middle, on an edge, on a corner.
const PLACES: [[f64; 2]; 3] = [[0.0, 0.0], [0.5, 0.0], [0.5, 0.5]];
/// Rounding error of sums of pixels, as a share of the light.
const ROUNDING: f64 = 1e-13;

/// One footprint of one PSF.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct FootprintRow {
    /// The PSF.
    pub psf: String,
    /// Half-width: the side is twice this and one pixel more.
    pub half_px: usize,
    /// Share of the light outside; the worst of three places in the pixel.
    pub lost_flux: f64,
    /// Its bound.
    pub bound: f64,
}

/// Measures footprints of three PSFs.
pub fn measure_footprints() -> Vec<FootprintRow> {
    let gaussian = |sigma_px: f64| (format!("Gaussian, sigma {sigma_px} px"), PsfModel::gaussian(sigma_px), 12);
    let airy = ("Airy, L 0.979 px, obscuration 0.3".to_owned(), PsfModel::airy(0.978_909, 0.3), LARGEST_HALF_PX);
    [gaussian(0.5), gaussian(0.8), airy].iter().flat_map(|(name, psf, most)| rows_of(name, psf, *most)).collect()
}

fn rows_of(name: &str, psf: &PsfModel, most_half_px: usize) -> Vec<FootprintRow> {
    let by_place = PLACES.map(|place| lost_by_half_width(psf, place, most_half_px));
    let row = |half_px: usize| FootprintRow {
        psf: name.into(),
        half_px,
        lost_flux: by_place.iter().map(|lost| lost[half_px]).fold(0.0, f64::max),
        bound: psf.lost_flux(half_px),
    };
    (1..=most_half_px).map(row).collect()
}

/// Returns the light outside footprints of half-widths 0, 1, 2 .. of a star at `place` in its pixel.
fn lost_by_half_width(psf: &PsfModel, [fx, fy]: [f64; 2], most_half_px: usize) -> Vec<f64> {
    let mut lost = 1.0;
    let mut out = Vec::with_capacity(most_half_px + 1);
    for ring in 0..=most_half_px as i32 {
        for y in -ring..=ring {
            for x in -ring..=ring {
                if x.abs().max(y.abs()) == ring {
                    lost -= psf.pixel(f64::from(x) - fx, f64::from(y) - fy);
                }
            }
        }
        out.push(if lost.abs() < ROUNDING { 0.0 } else { lost });
    }
    out
}

/// Returns a chart of the lost light against half-width.
pub fn footprint_chart(rows: &[FootprintRow]) -> Chart {
    let mut names: Vec<&str> = rows.iter().map(|row| row.psf.as_str()).collect();
    names.dedup();
    let unseen = rows.iter().filter(|row| row.lost_flux < ROUNDING).count();
    let mut series = Vec::new();
    for (group, name) in names.into_iter().enumerate() {
        let points = |value: fn(&FootprintRow) -> f64| {
            let of_name = rows.iter().filter(|row| row.psf == name);
            of_name.map(|row| [row.half_px as f64, value(row)]).collect::<Vec<[f64; 2]>>()
        };
        let is_seen = |point: &[f64; 2]| point[1] >= ROUNDING;
        let found: Vec<_> = points(|row| row.lost_flux).into_iter().filter(is_seen).collect();
        let bounds: Vec<_> = points(|row| row.bound).into_iter().filter(is_seen).collect();
        series.push(Series::new(name, Style::Points, group, found));
        series.push(Series::new(format!("{name}, bound"), Style::DashedLine, group, bounds));
    }
    let (x, y) = (Axis::log("half-width of the footprint, px"), Axis::log("share of the star's light that is lost"));
    Chart::new("Light beyond the footprint", x, y, series).noted(format!(
        "Pixels summed in f64, worst of a star in the middle, on an edge and on a corner of its pixel; {unseen} \
         footprints that lose less than 1e-13 are left out."
    ))
}
