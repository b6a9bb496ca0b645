//! Moments of node lists, and the effect of a difference in moments on an image.
//!
//! Two traces with the same mean but covariances that differ by `dC` (px^2) give images whose 5 x 5 centroids differ by
//! at most [`window_sensitivity`] times `|dC|`; the third moment enters likewise. `tests/physics` compares these with
//! the reference.
//!
//! *Characteristic functions* of displacements, and the effect of a difference between two on an image. Moments are
//! sufficient to compare short paths. A path longer than the PSF can be sampled with every low moment right and still
//! be a row of dots (sixteen midpoints of ten cycles of a sinusoid): its characteristic function `phi(k) = E[exp(i k .
//! d)]` shows this. Two images of one star differ by the inverse transform of `exp(-sigma^2 k^2 / 2) (phi_a - phi_b)`;
//! a linear functional with weights `W(x)` on pixels (first moment in a 5 x 5 window, one pixel) therefore differs by
//! at most the integral of `|W(k)| exp(-sigma^2 k^2 / 2) |phi_a - phi_b| d^2k / (2 pi)^2`, for any position of the star
//! in its pixel. The integral is a polar sum, `DIRECTIONS` by `RADII` cells, `|W|` averaged over each cell, the
//! difference taken at its centre and the sum doubled (`CELL_SAFETY`). Tests: `tests/physics` compares it with the
//! reference.

use base::{sines::sines_of_turns, vector_level::vector_level};
use core::f64::consts::{PI, TAU};
use pulp::NullaryFnOnce;

/// One instant of a star's path on the detector: weight, displacement about the path's mean along x and y, px.
pub type TracePoint = [f64; 3];

/// Central moments of one star's displacement.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Moments {
    /// Covariance xx, xy, yy, px^2.
    pub covariance_px2: [f64; 3],
    /// Third central moments along x and y, px^3.
    pub third_px3: [f64; 2],
}

/// Writes displacements about their mean; returns the mean.
pub fn trace(points: impl Iterator<Item = TracePoint>, out: &mut Vec<TracePoint>) -> [f64; 2] {
    out.clear();
    out.extend(points);
    let mean = out.iter().fold([0.0; 2], |[x, y], [w, dx, dy]| [x + w * dx, y + w * dy]);
    for point in out {
        point[1] -= mean[0];
        point[2] -= mean[1];
    }
    mean
}

impl Moments {
    /// Returns the central moments of a trace.
    pub fn of(trace: &[TracePoint]) -> Self {
        let mut m = Self::default();
        for &[w, x, y] in trace {
            m.covariance_px2[0] += w * x * x;
            m.covariance_px2[1] += w * x * y;
            m.covariance_px2[2] += w * y * y;
            m.third_px3[0] += w * x * x * x;
            m.third_px3[1] += w * y * y * y;
        }
        m
    }

    /// Adds `share * other`: the moments of a blend of images with one mean.
    pub fn add(&mut self, share: f64, other: &Self) {
        for (sum, v) in self.covariance_px2.iter_mut().zip(other.covariance_px2) {
            *sum += share * v;
        }
        for (sum, v) in self.third_px3.iter_mut().zip(other.third_px3) {
            *sum += share * v;
        }
    }

    /// Returns the Frobenius norm of the difference of covariance from `other`, px^2: at least the largest difference
    /// in any direction.
    pub fn covariance_difference(&self, other: &Self) -> f64 {
        let [xx, xy, yy] = core::array::from_fn(|i| self.covariance_px2[i] - other.covariance_px2[i]);
        (xx * xx + 2.0 * xy * xy + yy * yy).sqrt()
    }

    /// Returns the length of the difference of third moment from `other`, px^3.
    pub fn third_difference(&self, other: &Self) -> f64 {
        (self.third_px3[0] - other.third_px3[0]).hypot(self.third_px3[1] - other.third_px3[1])
    }

    /// Returns the bound of the 5 x 5 centroid error of an image drawn with these moments instead of `truth`, px.
    pub fn centroid_error_px(&self, truth: &Self, sigma_px: f64) -> f64 {
        window_sensitivity(sigma_px) * (self.covariance_difference(truth) + self.third_difference(truth) / sigma_px)
    }

    /// Returns the bound of the largest pixel error relative to the star's peak: `|dC| / sigma^2` (twice the
    /// second-order Taylor term at the peak, to cover the higher ones).
    pub fn peak_error(&self, truth: &Self, sigma_px: f64) -> f64 {
        let variance = sigma_px * sigma_px;
        (self.covariance_difference(truth) + self.third_difference(truth) / sigma_px) / variance
    }
}

/// Returns the centroid error in a 5 x 5 window per px^2 of covariance error. Measured 0.14 at sigma 0.8 (light that
/// leaves the window); an undersampled PSF adds the slope of its S-curve, `2 pi^2 exp(-2 pi^2 sigma^2) / pi`. Both are
/// doubled.
pub fn window_sensitivity(sigma_px: f64) -> f64 {
    0.3 + 13.0 * (-2.0 * PI.powi(2) * sigma_px * sigma_px).exp()
}

/// Number of directions over half a turn (the other half is conjugate).
const DIRECTIONS: usize = 4;
/// Number of radii: up to `RADII * STEP_SIGMA / sigma`, where the Gaussian has fallen to 3e-4.
const RADII: usize = 8;
/// Step of the radii times sigma.
const STEP_SIGMA: f64 = 0.5;
/// Safety factor for differences between the centres of the cells.
const CELL_SAFETY: f64 = 2.0;
/// Number of points per side over which `|W|` is averaged in a cell.
const CELL_POINTS: usize = 12;
/// Window of a tracker: pixels from its middle to its edge.
const WINDOW_HALF: f64 = 2.0;
/// Largest distance of a window's centroid from its middle, px: light lost at an edge shifts it by this much.
const OFF_MIDDLE_PX: f64 = 0.5;

/// Characteristic function on the polar grid, real and imaginary parts.
pub type Spectrum = [[[f64; 2]; RADII]; DIRECTIONS];

/// Characteristic function of zero.
pub const NOTHING: Spectrum = [[[0.0; 2]; RADII]; DIRECTIONS];

/// Weights of the polar sums for one PSF.
#[derive(Debug, Clone, PartialEq)]
pub struct Sensitivity {
    step: f64,
    centroid: [[f64; RADII]; DIRECTIONS],
    peak: [f64; RADII],
}

impl Sensitivity {
    /// Returns the weights for a PSF with a core of `sigma_px`.
    pub fn new(sigma_px: f64) -> Self {
        let step = STEP_SIGMA / sigma_px;
        let area = |j: usize| (j + 1) as f64 * step * step * PI / DIRECTIONS as f64;
        let gauss = |k: f64| (-0.5 * (sigma_px * k).powi(2)).exp();
        // Both halves of the plane; the peak's own value is 1 / (2 pi sigma^2).
        let scale = |j: usize| CELL_SAFETY * 2.0 * area(j) / (4.0 * PI * PI);
        let centroid = core::array::from_fn(|d| {
            core::array::from_fn(|j| scale(j) * cell_mean(d, j, step, |kx, ky| gauss(kx.hypot(ky)) * window(kx, ky)))
        });
        let peak = core::array::from_fn(|j| scale(j) * gauss((j + 1) as f64 * step) * 2.0 * PI * sigma_px * sigma_px);
        Self { step, centroid, peak }
    }

    /// Returns the characteristic function of a trace.
    pub fn spectrum(&self, trace: &[TracePoint]) -> Spectrum {
        vector_level().dispatch(Transform { step: self.step, trace })
    }

    /// Returns bounds for an image drawn with `drawn` instead of `truth`: first moment of the 5 x 5 window, px times
    /// the star's flux, and the largest pixel error relative to the star's peak.
    pub fn error(&self, drawn: &Spectrum, truth: &Spectrum) -> (f64, f64) {
        let (mut centroid, mut peak) = (0.0, 0.0);
        for (weights, (a, b)) in self.centroid.iter().zip(drawn.iter().zip(truth)) {
            for j in 0..RADII {
                let [re, im] = [a[j][0] - b[j][0], a[j][1] - b[j][1]];
                let difference = (re * re + im * im).sqrt();
                centroid += weights[j] * difference;
                peak += self.peak[j] * difference;
            }
        }
        (centroid, peak)
    }
}

/// Number of instants whose waves are summed side by side.
const LANES: usize = 8;

/// Characteristic function of a trace, in the shape `pulp` compiles once per vector level. Multiplications and additions
/// are not fused, so all levels find the same numbers.
struct Transform<'a> {
    step: f64,
    trace: &'a [TracePoint],
}

impl NullaryFnOnce for Transform<'_> {
    type Output = Spectrum;
    #[inline(always)]
    fn call(self) -> Spectrum {
        let mut spectrum = NOTHING;
        for (d, radii) in spectrum.iter_mut().enumerate() {
            let (sin, cos) = angle(d as f64).sin_cos();
            let [kx, ky] = [cos, sin].map(|along| self.step * along / TAU);
            let mut sums = [[[0.0; LANES]; 2]; RADII];
            for instants in self.trace.chunks(LANES) {
                let (mut re, mut im, mut turns) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
                for (i, [weight, x, y]) in instants.iter().enumerate() {
                    (re[i], turns[i]) = (*weight, kx * x + ky * y);
                }
                let (sin, cos) = (sines_of_turns(turns), sines_of_turns(turns.map(|turns| turns + 0.25)));
                for [a, b] in &mut sums {
                    for i in 0..LANES {
                        (re[i], im[i]) = (re[i] * cos[i] - im[i] * sin[i], re[i] * sin[i] + im[i] * cos[i]);
                        a[i] += re[i];
                        b[i] += im[i];
                    }
                }
            }
            *radii = sums.map(|parts| parts.map(|lanes| lanes.iter().sum()));
        }
        spectrum
    }
}

/// Returns the angle of direction `d`.
fn angle(d: f64) -> f64 {
    PI * d / DIRECTIONS as f64
}

/// Returns the mean of `value` over the polar cell about direction `d` and radius `j`.
fn cell_mean(d: usize, j: usize, step: f64, value: impl Fn(f64, f64) -> f64) -> f64 {
    let offset = |i: usize| (i as f64 + 0.5) / CELL_POINTS as f64 - 0.5;
    let points = (0..CELL_POINTS * CELL_POINTS).map(|i| (offset(i / CELL_POINTS), offset(i % CELL_POINTS)));
    let sum: f64 = points
        .map(|(a, b)| {
            let (sin, cos) = angle(d as f64 + a).sin_cos();
            let k = (j as f64 + 1.0 + b) * step;
            value(k * cos, k * sin)
        })
        .sum();
    sum / (CELL_POINTS * CELL_POINTS) as f64
}

/// Returns the modulus of the transform of the first moments of a 5 x 5 window of pixels, both axes together.
fn window(kx: f64, ky: f64) -> f64 {
    let pixel = |k: f64| if k.abs() < 1e-9 { 1.0 } else { (0.5 * k).sin() / (0.5 * k) };
    let wide = |k: f64| {
        let small = (0.5 * k).sin();
        if small.abs() < 1e-9 { 2.0 * WINDOW_HALF + 1.0 } else { ((WINDOW_HALF + 0.5) * k).sin() / small }
    };
    let ramp = |k: f64| 2.0 * (k.sin() + 2.0 * (2.0 * k).sin());
    let moment = |k: f64| ramp(k).hypot(OFF_MIDDLE_PX * wide(k));
    (pixel(kx) * pixel(ky)).abs() * (moment(kx) * wide(ky)).hypot(wide(kx) * moment(ky))
}
