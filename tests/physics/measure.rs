//! Measures the error of a drawn image: the CPU's image of a plan against the reference's, star by star.

use crate::scene::{
    FULL_WELL_E, Picture, READ_NOISE_E, Window, centroid_error_px, draw_cpu, draw_reference, flux_error,
};
use plan::exposure::plan::Assessment;
use plan::exposure::{ExposurePlan, PlannedStar};
use std::sync::atomic::{AtomicU32, Ordering};

/// Rounding of a sum of a few hundred single-precision pixels.
pub(crate) const F32_FLUX: f64 = 2e-6;
/// Pixel errors below this share of the brightest star's peak are single-precision rounding.
const F32_PIXEL: f64 = 2e-6;

/// Worst errors over the stars of a plan.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Measured {
    /// 5 x 5 centroid, px.
    pub(crate) centroid_px: f64,
    /// Flux, of stars whose light lies wholly on the detector: across an edge it follows the centroid.
    pub(crate) flux_rel: f64,
    /// Pixel in units of its noise, beyond single precision and what the footprint's rim drops.
    pub(crate) pixel_sigma: f64,
}

impl Measured {
    /// Returns whether nothing is over the bounds of `reported`.
    pub(crate) fn is_within(&self, reported: &Assessment) -> bool {
        self.centroid_px <= reported.centroid_px
            && self.flux_rel <= reported.flux_rel + F32_FLUX
            && self.pixel_sigma <= reported.pixel_sigma
    }
}

/// Draws `plan` and measures it.
pub(crate) fn measure(plan: &ExposurePlan) -> Measured {
    compare(plan, &draw_cpu(plan), &draw_reference(plan))
}

/// Returns errors of `image` where `truth` is due.
pub(crate) fn compare(plan: &ExposurePlan, image: &Picture, truth: &Picture) -> Measured {
    let mut worst = Measured::default();
    for star in &plan.stars {
        let around = around(plan, star.mean_px);
        let window = truth.tracker_window(&around);
        worst.centroid_px = worst.centroid_px.max(centroid_error_px(image, truth, &window));
        if is_whole(plan, &around) {
            worst.flux_rel = worst.flux_rel.max(flux_error(image, truth, &around));
        }
    }
    let brightest_e = plan.stars.iter().map(|star| star.electrons).fold(0.0, f64::max);
    // No pixel outside a footprint is nearer to the star than this.
    let rim = plan.psf.pixel(plan.half_px as f64 + 0.5, 0.0);
    let slack_e = brightest_e * (F32_PIXEL * plan.psf.peak() + rim);
    for (a, b) in image.pixels.iter().zip(&truth.pixels) {
        // Charge beyond a saturated pixel's capacity cannot be seen.
        let error_e = ((a.min(FULL_WELL_E) - b.min(FULL_WELL_E)).abs() - slack_e).max(0.0);
        worst.pixel_sigma = worst.pixel_sigma.max(error_e / b.max(0.0).sqrt().hypot(READ_NOISE_E));
    }
    worst
}

/// Returns the largest pixel error relative to the brightest pixel.
pub(crate) fn peak_error(image: &Picture, truth: &Picture) -> f64 {
    let peak = truth.pixels.iter().copied().fold(0.0, f64::max);
    image.pixels.iter().zip(&truth.pixels).map(|(a, b)| (a - b).abs() / peak).fold(0.0, f64::max)
}

/// Returns the square that holds a star's light.
pub(crate) fn around(plan: &ExposurePlan, px: [f64; 2]) -> Window {
    let reach_px = plan.half_px as f64 + plan.extent_px.ceil() + 1.0;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the detector")]
    let range = |v: f64, size: usize| {
        let clamp = |v: f64| v.clamp(0.0, size as f64) as usize;
        clamp(v.round() - reach_px)..clamp(v.round() + reach_px + 1.0)
    };
    Window { columns: range(px[0], plan.camera.width_px()), rows: range(px[1], plan.camera.height_px()) }
}

/// Returns whether an edge cuts nothing off a square that is [`around`] a star.
fn is_whole(plan: &ExposurePlan, around: &Window) -> bool {
    let sides = [(&around.columns, plan.camera.width_px()), (&around.rows, plan.camera.height_px())];
    sides.iter().all(|(range, size)| range.start > 0 && range.end < *size)
}

/// Returns `plan` with the stars of one of its classes alone.
pub(crate) fn class_alone(plan: &ExposurePlan, class: usize) -> ExposurePlan {
    let (above_e, faintest_e) = plan.brightness_of(class);
    let is_of = |star: &PlannedStar| star.electrons < above_e && star.electrons >= faintest_e;
    let stars = plan.stars.iter().filter(|star| plan.classes.len() == 1 || is_of(star)).copied().collect();
    ExposurePlan { stars, ..plan.clone() }
}

/// Tallies so many cases, by as many threads as there are; each has a tally of its own, which are added up at the end.
pub(crate) fn tally_of<T: Default + Send>(cases: u32, take: impl Fn(&mut T, u32) + Sync, add: impl Fn(&mut T, T)) -> T {
    let next = AtomicU32::new(0);
    let work = || {
        let mut tally = T::default();
        loop {
            let number = next.fetch_add(1, Ordering::Relaxed);
            if number >= cases {
                return tally;
            }
            take(&mut tally, number);
        }
    };
    let mut all = T::default();
    std::thread::scope(|scope| {
        let threads = std::thread::available_parallelism().map_or(2, usize::from);
        let running: Vec<_> = (0..threads).map(|_| scope.spawn(work)).collect();
        running.into_iter().for_each(|thread| add(&mut all, thread.join().unwrap()));
    });
    all
}
