//! Rows: errors of an image, their table for a file, their table for a terminal.
//!
//! Rows of the tables, their text, and the check of a row's bounds.

use crate::chart::scenes::Scene;
use crate::chart::stage::{Picture, READ_NOISE_E};
use core::ops::Range;
use plan::exposure::ExposurePlan;
use plan::exposure::plan::{Assessment, Verdict};
use serde::{Deserialize, Serialize};

/// Rounding of a sum of a few hundred single-precision pixels.
const F32_FLUX: f64 = 2e-6;
/// The verdict of a method within the budget.
pub const FITS: &str = "fits";
/// The verdict of a method that a backend refused to draw; the note says why.
pub const NOT_DRAWN: &str = "not-drawn";

/// One method on one scene by one backend: predicted and measured values.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MethodRow {
    /// `cpu` or `gpu`.
    pub backend: String,
    /// Scene; of a PSF sampling, the standard deviation of the PSF, px.
    pub scene: String,
    /// Method, or PSF sampling, by name; `auto`: the planner's choice.
    pub method: String,
    /// Its parameter, if one was requested.
    pub parameter: Option<usize>,
    /// Method that was drawn, with all its parameters.
    pub drawn: String,
    /// Nodes per star or kernel.
    pub nodes: usize,
    /// Verdict of the planner.
    pub verdict: String,
    /// Bound of the centroid error, px.
    pub bound_centroid_px: f64,
    /// Bound of the relative flux error.
    pub bound_flux_rel: f64,
    /// Bound of the largest pixel error, sigma.
    pub bound_pixel_sigma: f64,
    /// Predicted time of a frame, ms.
    pub predicted_ms: f64,
    /// Worst centroid error found, px.
    pub centroid_px: f64,
    /// Worst relative flux error found.
    pub flux_rel: f64,
    /// Worst pixel error found, sigma.
    pub pixel_sigma: f64,
    /// Sum of absolute differences over the sum of the truth.
    pub l1_rel: f64,
    /// Time to plan a frame, ms.
    pub plan_ms: f64,
    /// Time to draw it (electrons), ms.
    pub draw_ms: f64,
    /// Time of the fastest drawing, without other load, ms.
    pub fastest_ms: f64,
    /// Stars in the frame.
    pub stars: usize,
    /// Electrons of the brightest star.
    pub brightest_e: f64,
    /// Read noise, e-.
    pub read_noise_e: f64,
    /// Additional note.
    pub note: String,
}

impl MethodRow {
    /// Returns true when the planner gave bounds and all of them are kept; light beyond the footprint is in the flux
    /// bound, and affects pixels too.
    pub fn holds(&self) -> bool {
        let pixel_sigma = self.bound_pixel_sigma + self.brightest_e * self.bound_flux_rel / self.read_noise_e;
        self.centroid_px <= self.bound_centroid_px
            && self.flux_rel <= self.bound_flux_rel + F32_FLUX
            && self.pixel_sigma <= pixel_sigma
    }

    /// Returns true when the planner would draw with it.
    pub fn fits(&self) -> bool {
        self.verdict == FITS
    }

    /// Returns true when it produced an image.
    pub fn is_drawn(&self) -> bool {
        self.verdict != NOT_DRAWN
    }

    /// Returns true for the planner's own choice.
    pub fn is_choice(&self) -> bool {
        self.method == "auto"
    }

    /// Fills in the bounds given by the planner.
    pub fn promise(&mut self, chosen: &Assessment) {
        self.drawn = chosen.method.to_string();
        self.nodes = chosen.method.nodes();
        self.verdict = verdict_name(chosen.verdict).into();
        self.bound_centroid_px = chosen.centroid_px;
        self.bound_flux_rel = chosen.flux_rel;
        self.bound_pixel_sigma = chosen.pixel_sigma;
        self.predicted_ms = chosen.cost_ms;
    }
}

/// Returns the rows that the planner accepted and whose bounds are exceeded.
pub fn broken(rows: &[MethodRow]) -> Vec<&MethodRow> {
    rows.iter().filter(|row| row.fits() && !row.holds()).collect()
}

/// Returns the word for a verdict in tables.
pub fn verdict_name(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Fits => FITS,
        Verdict::NeedsSmoothMotion => "needs-smooth-motion",
        Verdict::PathTooLong => "path-too-long",
        Verdict::OtherSampling => "other-sampling",
        Verdict::TooManyKernels => "too-many-kernels",
        Verdict::CentroidOverBudget => "centroid-over-budget",
        Verdict::PixelOverBudget => "pixel-over-budget",
        Verdict::FluxOverBudget => "flux-over-budget",
    }
}

/// Returns rows as CSV with a line of names.
///
/// # Errors
/// When a row cannot be written as CSV.
pub fn csv_text<R: Serialize>(rows: &[R]) -> Result<String, csv::Error> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.serialize(row)?;
    }
    let bytes = writer.into_inner().map_err(|error| csv::Error::from(error.into_error()))?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}

// Image, truth -> errors as a tracker would see them.
//
// Centroid: in the 5 x 5 window about the truth's brightest pixel near a star, worst star. Flux: in the window that
// contains the star's footprint and path, worst star. Pixel: worst pixel, in units of its own noise, minus the
// rounding of single precision. L1: sum of absolute differences over the sum of the truth.

/// Half-width of a tracker's window, px.
const TRACKER_HALF_PX: usize = 2;
/// Half-width of the largest flux window: windows of separate stars do not overlap.
const MOST_WINDOW_PX: f64 = 17.0;
/// Share of the brightest star's peak below which pixel errors are single-precision rounding.
const F32_PIXEL: f64 = 2e-6;

/// Errors of one image.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Errors {
    /// Worst 5 x 5 centroid, px.
    pub centroid_px: f64,
    /// Worst flux, relative.
    pub flux_rel: f64,
    /// Worst pixel in units of its noise.
    pub pixel_sigma: f64,
    /// Whole image, relative.
    pub l1_rel: f64,
}

/// A rectangle of pixels.
#[derive(Debug, Clone)]
struct Window {
    columns: Range<usize>,
    rows: Range<usize>,
}

impl Errors {
    /// Returns the errors of `image` over the stars of `plan`.
    pub fn of(image: &Picture, truth: &Picture, plan: &ExposurePlan) -> Self {
        let mut worst = Self { l1_rel: l1_rel(image, truth), ..Self::default() };
        let half_px = (plan.half_px as f64 + plan.extent_px + 1.0).min(MOST_WINDOW_PX);
        for star in &plan.stars {
            let Some(around) = Window::around(truth, star.mean_px, half_px) else { continue };
            let tracker = around.tracker(truth);
            let ([a, b], [c, d]) = (tracker.moments(image).1, tracker.moments(truth).1);
            worst.centroid_px = worst.centroid_px.max((a - c).hypot(b - d));
            let flux = around.moments(image).0 / around.moments(truth).0 - 1.0;
            worst.flux_rel = worst.flux_rel.max(flux.abs());
        }
        worst.pixel_sigma = pixel_sigma(image, truth, F32_PIXEL * brightest_e(plan) * plan.psf.peak());
        worst
    }
}

/// Returns the electrons of the brightest star.
pub fn brightest_e(plan: &ExposurePlan) -> f64 {
    plan.stars.iter().map(|star| star.electrons).fold(0.0, f64::max)
}

fn l1_rel(image: &Picture, truth: &Picture) -> f64 {
    let difference: f64 = image.pixels.iter().zip(&truth.pixels).map(|(a, b)| (a - b).abs()).sum();
    difference / truth.pixels.iter().sum::<f64>()
}

fn pixel_sigma(image: &Picture, truth: &Picture, rounding_e: f64) -> f64 {
    let sigma = |(a, b): (&f64, &f64)| ((a - b).abs() - rounding_e).max(0.0) / b.max(0.0).sqrt().hypot(READ_NOISE_E);
    image.pixels.iter().zip(&truth.pixels).map(sigma).fold(0.0, f64::max)
}

impl Window {
    /// Returns the part of the image within `half_px` of a place; `None` outside the image.
    fn around(image: &Picture, [x, y]: [f64; 2], half_px: f64) -> Option<Self> {
        let height = image.pixels.len() / image.width.max(1);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the image")]
        let range = |v: f64, side: usize| {
            let clamped = |v: f64| v.clamp(0.0, side as f64) as usize;
            clamped((v - half_px).round())..clamped((v + half_px).round() + 1.0)
        };
        let window = Self { columns: range(x, image.width), rows: range(y, height) };
        (!window.columns.is_empty() && !window.rows.is_empty()).then_some(window)
    }

    /// Returns the 5 x 5 window about the brightest pixel.
    fn tracker(&self, image: &Picture) -> Self {
        let at = |[x, y]: [usize; 2]| image.pixels[y * image.width + x];
        let places = self.rows.clone().flat_map(|y| self.columns.clone().map(move |x| [x, y]));
        let [x, y] = places.max_by(|a, b| at(*a).total_cmp(&at(*b))).unwrap_or([self.columns.start, self.rows.start]);
        let height = image.pixels.len() / image.width.max(1);
        let about = |v: usize, side: usize| v.saturating_sub(TRACKER_HALF_PX)..(v + TRACKER_HALF_PX + 1).min(side);
        Self { columns: about(x, image.width), rows: about(y, height) }
    }

    /// Returns the flux and centroid.
    fn moments(&self, image: &Picture) -> (f64, [f64; 2]) {
        let (mut flux, mut first) = (0.0, [0.0, 0.0]);
        for y in self.rows.clone() {
            for x in self.columns.clone() {
                let value = image.pixels[y * image.width + x];
                flux += value;
                first[0] += value * x as f64;
                first[1] += value * y as f64;
            }
        }
        (flux, first.map(|v| v / flux))
    }
}

// The table for a terminal: the planner's choice on every scene, with its predictions and the measured values.

/// Largest factor between predicted and measured times.
const COST_FACTOR: f64 = 1.2;

/// Returns lines of text; `notes` name the backends.
pub(super) fn summary(methods: &[MethodRow], samplings: &[MethodRow], scenes: &[Scene], notes: &[String]) -> String {
    let mut lines = notes.to_vec();
    lines.push(String::new());
    lines.push(format!(
        "{:<16} {:<4} {:<34} {:>8} {:>8}   {:>8} {:>8} {:>10} {:>12} {:>7} {:>9}",
        "scene",
        "",
        "the planner's choice",
        "bound px",
        "error px",
        "plan ms",
        "draw ms",
        "fastest ms",
        "predicted ms",
        "ratio",
        "fastest"
    ));
    for scene in scenes {
        lines.extend(
            methods.iter().filter(|row| row.scene == scene.name && row.is_choice()).map(|row| line(row, scene)),
        );
    }
    lines.push(String::new());
    lines.push(cost_verdict(methods, scenes));
    lines.extend(bound_verdict(methods, "methods"));
    lines.extend(bound_verdict(samplings, "PSF samplings"));
    lines.join("\n") + "\n"
}

fn line(row: &MethodRow, scene: &Scene) -> String {
    let ratio =
        if is_judged(scene) { format!("{:>7.2} {:>9.2}", to_median(row), to_fastest(row)) } else { String::new() };
    let line = format!(
        "{:<16} {:<4} {:<34} {:>8.1e} {:>8.1e} {} {:>8.3} {:>8.3} {:>10.3} {:>12.3} {ratio}",
        row.scene,
        row.backend,
        row.drawn,
        row.bound_centroid_px,
        row.centroid_px,
        if row.fits() { ' ' } else { '*' },
        row.plan_ms,
        row.draw_ms,
        row.fastest_ms,
        row.predicted_ms
    );
    let note = if row.fits() { String::new() } else { format!("  * {}", row.verdict) };
    line.trim_end().to_owned() + &note
}

/// Returns the ratio of the predicted time to the medians of planning and drawing.
fn to_median(row: &MethodRow) -> f64 {
    row.predicted_ms / (row.plan_ms + row.draw_ms)
}

/// Returns the ratio of the predicted time to planning and the fastest drawing.
fn to_fastest(row: &MethodRow) -> f64 {
    row.predicted_ms / (row.plan_ms + row.fastest_ms)
}

/// Returns true when the predicted time of a scene is compared with the measured one.
fn is_judged(scene: &Scene) -> bool {
    scene.is_charted || scene.is_for_speed()
}

fn cost_verdict(methods: &[MethodRow], scenes: &[Scene]) -> String {
    let names: Vec<&str> = scenes.iter().filter(|scene| is_judged(scene)).map(|scene| scene.name).collect();
    let choices: Vec<&MethodRow> =
        methods.iter().filter(|row| row.is_choice() && names.contains(&&*row.scene)).collect();
    let near = |ratio: fn(&MethodRow) -> f64| {
        choices.iter().filter(|row| (1.0 / COST_FACTOR..=COST_FACTOR).contains(&ratio(row))).count()
    };
    let (drawn, fastest, all) = (near(to_median), near(to_fastest), choices.len());
    format!(
        "predicted times of {names} within a factor of {COST_FACTOR}: {drawn} of {all} against the median of planning and \
         drawing, {fastest} of {all} with the fastest drawing",
        names = names.join(", ")
    )
}

fn bound_verdict(rows: &[MethodRow], what: &str) -> Vec<String> {
    let fit = rows.iter().filter(|row| row.fits()).count();
    let broken = broken(rows);
    let mut lines = vec![format!("{what}: {} of {fit} rows that fit the budget are beyond their bounds", broken.len())];
    lines.extend(broken.iter().map(|row| {
        format!(
            "  {} {} {} ({}): bounds {:.1e} px {:.1e} flux {:.1e} sigma, found {:.1e} px {:.1e} flux {:.1e} sigma",
            row.scene,
            row.backend,
            row.method,
            row.drawn,
            row.bound_centroid_px,
            row.bound_flux_rel,
            row.bound_pixel_sigma,
            row.centroid_px,
            row.flux_rel,
            row.pixel_sigma
        )
    }));
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    fn spot() -> Picture {
        let mut picture = Picture { width: 16, pixels: vec![0.0; 256] };
        for (at, value) in [(7 * 16 + 8, 100.0), (7 * 16 + 9, 50.0), (8 * 16 + 8, 50.0)] {
            picture.pixels[at] = value;
        }
        picture
    }

    #[test]
    fn a_window_finds_its_star_and_its_centroid() {
        let picture = spot();
        let around = Window::around(&picture, [6.0, 6.0], 5.0).unwrap();
        let tracker = around.tracker(&picture);
        assert_eq!((tracker.columns.clone(), tracker.rows.clone()), (6..11, 5..10));
        assert_eq!(tracker.moments(&picture), (200.0, [8.25, 7.25]));
        assert!(Window::around(&picture, [-30.0, 6.0], 5.0).is_none());
    }

    #[test]
    fn one_pixel_off_is_seen_by_every_measure() {
        let (truth, mut image) = (spot(), spot());
        assert_eq!((l1_rel(&image, &truth), pixel_sigma(&image, &truth, 0.0)), (0.0, 0.0));
        image.pixels[7 * 16 + 9] += 2.0;
        assert_eq!(l1_rel(&image, &truth), 0.01);
        let noise = 50.0_f64.sqrt().hypot(READ_NOISE_E);
        assert!((pixel_sigma(&image, &truth, 0.0) - 2.0 / noise).abs() < 1e-12);
        assert_eq!(pixel_sigma(&image, &truth, 3.0), 0.0, "below rounding");
    }
}
