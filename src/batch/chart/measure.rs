//! Image, truth -> errors as a tracker would see them.
//!
//! Centroid: in the 5 x 5 window about the truth's brightest pixel near a star, worst star. Flux: in the window that
//! contains the star's footprint and path, worst star. Pixel: worst pixel, in units of its own noise, minus the
//! rounding of single precision. L1: sum of absolute differences over the sum of the truth.

use crate::chart::{drawer::Picture, stage::READ_NOISE_E};
use core::ops::Range;
use plan::exposure::ExposurePlan;

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
