//! How much the image of a star changes when another star's path is drawn in place of its own: by drawing both.
//!
//! In: the traces of one list of nodes at two places of the field. Out: bounds of the centroid error (px) and of the
//! pixel error (of the star's peak). Both traces are drawn with the PSF's core, `m` points per pixel, summed over
//! pixels for every phase of a star on its pixel, and compared: the largest difference of a pixel, and of the centroids
//! of the 5 x 5 windows about the brightest pixels. Moments and characteristic functions bound the same differences by
//! sums of absolute values, which is safe but 10 to 1,000 times too much where parts cancel; this is within a factor of
//! three. Limits: phases and places between those compared differ by less than a safety factor; a PSF that is not a
//! Gaussian is replaced by one of its core, as in the other bounds; long lists on wide grids are not drawn
//! ([`MOST_WORK`]). Multiplications and additions are not fused, so all vector levels find the same numbers. Tests:
//! below, `tests/physics/bounds.rs`.

use crate::{exposure::moments::TracePoint, optics::gaussian};
use base::vector_level::vector_level;
use pulp::NullaryFnOnce;

/// Safety factor for stars between the probes and phases between those compared.
const SAFETY: f64 = 1.4;
/// Single-precision rounding of two images, shares of the peak, and its effect on a centroid, px.
const ROUNDING: NodeError = NodeError { centroid_px: 5e-6, peak: 1e-6 };
/// Largest number of nodes times grid points that is drawn.
pub const MOST_WORK: usize = 3_000_000;
/// Grid points per sigma, at least, and limits of those per pixel.
const PER_SIGMA: f64 = 2.5;
const PER_PIXEL: [usize; 2] = [4, 8];
/// Light beyond so many sigma is not drawn.
const REACH_SIGMA: f64 = 4.0;
/// Pixels from the middle of a window to its edge.
const WINDOW_HALF: usize = 2;
/// Pixels this close to the brightest may be the brightest in another phase: their windows are compared too.
const AS_BRIGHT: f32 = 0.85;
/// Phases along an axis.
const PHASES: usize = 4;
/// Capacity from the start: points of an image, and of the profiles of all nodes.
const POINTS_RESERVED: usize = 1 << 14;
const PROFILES_RESERVED: usize = 1 << 16;
/// Points of a node's image that are drawn in the time of a step, and the nodes whose image takes as long as summing over pixels.
const POINTS_PER_STEP: usize = 100;
const SUMMED: usize = 50;
/// Columns of a vector.
const LANES: usize = 16;

/// Draws and compares; keeps its buffers.
#[derive(Debug, Clone)]
pub struct ShapeChange {
    sigma_px: f64,
    /// Light of a star at rest in its brightest pixel.
    peak: f64,
    per_px: usize,
    /// The image that others are compared with, and another.
    images: [Vec<f32>; 2],
    /// Points from the middle of the grid to its edge; columns with padding.
    half: usize,
    stride: usize,
    /// Profiles of all nodes along x, one after the other, and along y.
    across: Vec<f32>,
    down: Vec<f32>,
    sums: Vec<f32>,
}

impl ShapeChange {
    /// Returns a comparison for a PSF with a core of `sigma_px`.
    pub fn new(sigma_px: f64) -> Self {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a small number of points")]
        let wanted = (PER_SIGMA / sigma_px).ceil() as usize;
        Self {
            sigma_px,
            peak: gaussian::cell(0.0, sigma_px).powi(2),
            per_px: if wanted <= PER_PIXEL[0] { PER_PIXEL[0] } else { PER_PIXEL[1] },
            images: [(); 2].map(|()| Vec::with_capacity(POINTS_RESERVED)),
            half: 0,
            stride: 0,
            across: Vec::with_capacity(PROFILES_RESERVED),
            down: Vec::with_capacity(PROFILES_RESERVED),
            sums: Vec::with_capacity(POINTS_RESERVED),
        }
    }

    /// Sets the grid for traces of so many nodes that lead at most `extent_px` from their mean; false if that is too
    /// much work.
    pub fn size(&mut self, nodes: usize, extent_px: f64) -> bool {
        let half_px = extent_px + (REACH_SIGMA * self.sigma_px + 0.5).max(WINDOW_HALF as f64 + 1.5);
        let half = (half_px * self.per_px as f64).ceil();
        let points = 2.0 * half + 1.0;
        // False for an unknown motion, whose extent is not a number.
        let is_little_work = points * points * nodes as f64 <= MOST_WORK as f64;
        if !is_little_work {
            return false;
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "limited above")]
        let half = half as usize;
        (self.half, self.stride) = (half, (2 * half + 1).next_multiple_of(LANES));
        true
    }

    /// Returns the steps of drawing a trace of so many nodes (see `cost`).
    pub fn steps(&self, nodes: usize) -> usize {
        (nodes + SUMMED) * self.stride * (2 * self.half + 1) / POINTS_PER_STEP
    }

    /// Draws the trace that others are compared with.
    pub fn keep(&mut self, trace: &[TracePoint]) {
        self.draw(trace, 0);
    }

    /// Returns the error of drawing the kept trace in place of `truth`.
    pub fn error(&mut self, truth: &[TracePoint]) -> NodeError {
        self.draw(truth, 1);
        let [drawn, truth] = &self.images;
        let apart = drawn.iter().zip(truth).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        NodeError {
            centroid_px: SAFETY * self.centroids_apart_px() + ROUNDING.centroid_px,
            peak: SAFETY * f64::from(apart) / self.peak + ROUNDING.peak,
        }
    }

    fn draw(&mut self, trace: &[TracePoint], image: usize) {
        vector_level().dispatch(Draw { change: self, trace, image });
    }

    /// Returns the largest distance of the centroids in the windows about the brightest pixels, over all phases.
    fn centroids_apart_px(&self) -> f64 {
        let (m, [drawn, truth]) = (self.per_px, &self.images);
        let pixels = (2 * self.half + 1) / m;
        let mut worst = 0.0_f64;
        for phase in 0..PHASES * PHASES {
            let from = [phase % PHASES, phase / PHASES].map(|k| k * m / PHASES);
            let at = |x: usize, y: usize| (from[1] + y * m) * self.stride + from[0] + x * m;
            let inside = WINDOW_HALF..pixels - WINDOW_HALF - 1;
            let places = || inside.clone().flat_map(|y| inside.clone().map(move |x| (x, y)));
            let brightest = places().map(|(x, y)| truth[at(x, y)]).fold(0.0, f32::max);
            for (x, y) in places().filter(|(x, y)| truth[at(*x, *y)] >= AS_BRIGHT * brightest) {
                let first = at(x - WINDOW_HALF, y - WINDOW_HALF);
                let [a, b] = [drawn, truth].map(|image| centroid(&image[first..], m, self.stride));
                worst = worst.max((a[0] - b[0]).hypot(a[1] - b[1]));
            }
        }
        worst
    }
}

/// Returns the centroid of a window of pixels `m` points apart, px from its first.
fn centroid(image: &[f32], m: usize, stride: usize) -> [f64; 2] {
    let mut moments = [0.0_f64; 3];
    for y in 0..=2 * WINDOW_HALF {
        for x in 0..=2 * WINDOW_HALF {
            let value = f64::from(image[(y * stride + x) * m]);
            moments[0] += value;
            moments[1] += value * x as f64;
            moments[2] += value * y as f64;
        }
    }
    [moments[1] / moments[0], moments[2] / moments[0]]
}

/// One image, in the shape `pulp` compiles once per vector level.
struct Draw<'a> {
    change: &'a mut ShapeChange,
    trace: &'a [TracePoint],
    image: usize,
}

impl NullaryFnOnce for Draw<'_> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        let Self { change, trace, image } = self;
        let ShapeChange { sigma_px, per_px, images, half, stride, across, down, sums, .. } = change;
        let (m, half, stride) = (*per_px, *half, *stride);
        across.resize(trace.len() * stride, 0.0);
        down.resize(trace.len() * stride, 0.0);
        // Light per pixel is the mean of its points.
        let scale = 1.0 / (core::f64::consts::TAU * *sigma_px * *sigma_px * (m * m) as f64);
        let per_sigma = (1.0 / (m as f64 * *sigma_px)) as f32;
        let lines = across.chunks_exact_mut(stride).zip(down.chunks_exact_mut(stride));
        for (&[weight, x, y], (across, down)) in trace.iter().zip(lines) {
            let first = |v: f64| (-(half as f64) / m as f64 - v) / *sigma_px;
            profile(first(x) as f32, per_sigma, (weight * scale) as f32, across);
            profile(first(y) as f32, per_sigma, 1.0, down);
        }
        let rows = 2 * half + 1;
        sums.resize((rows + m) * stride, 0.0);
        for row in 0..rows {
            for c in (0..stride).step_by(LANES) {
                let mut sum = [0.0_f32; LANES];
                for (across, down) in across.chunks_exact(stride).zip(down.chunks_exact(stride)) {
                    let gain = down[row];
                    let Some(values) = across.get(c..c + LANES) else { continue };
                    for (sum, value) in sum.iter_mut().zip(values) {
                        *sum += gain * value;
                    }
                }
                sums[row * stride + c..row * stride + c + LANES].copy_from_slice(&sum);
            }
        }
        sums[rows * stride..].fill(0.0);
        over_pixels(sums, m, stride, &mut images[image]);
    }
}

/// Fills a Gaussian: `gain exp(-z^2 / 2)`, `z` from `first` on in steps of `step`.
#[inline(always)]
fn profile(first: f32, step: f32, gain: f32, out: &mut [f32]) {
    /// Beyond this exponent nothing is left (2e-9).
    const FURTHEST: f32 = 20.0;
    for (i, value) in out.iter_mut().enumerate() {
        let z = first + i as f32 * step;
        let half_square = 0.5 * z * z;
        let clamped = if half_square < FURTHEST { half_square } else { FURTHEST };
        // exp(-q) as the 32nd power of exp(-q / 32).
        let t = clamped * (1.0 / 32.0);
        let mut e = 1.0 - t * (1.0 - t * (0.5 - t * (1.0 / 6.0 - t * (1.0 / 24.0 - t * (1.0 / 120.0 - t / 720.0)))));
        for _ in 0..5 {
            e *= e;
        }
        *value = if half_square < FURTHEST { gain * e } else { 0.0 };
    }
}

/// Points -> sums over the pixel whose first point each is.
#[inline(always)]
fn over_pixels(points: &mut [f32], m: usize, stride: usize, out: &mut Vec<f32>) {
    let end = points.len() - m * stride;
    out.resize(end, 0.0);
    // Along rows: a point's sum reads points that are not summed yet.
    for line in points.chunks_exact_mut(stride) {
        for x in 0..stride {
            let mut sum = 0.0;
            for k in 0..m {
                sum += if x + k < stride { line[x + k] } else { 0.0 };
            }
            line[x] = sum;
        }
    }
    out.copy_from_slice(&points[..end]);
    for k in 1..m {
        for (sum, value) in out.iter_mut().zip(&points[k * stride..k * stride + end]) {
            *sum += value;
        }
    }
}

/// Errors of a node list.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct NodeError {
    /// 5 x 5 centroid, px.
    pub centroid_px: f64,
    /// Largest pixel error relative to the star's peak.
    pub peak: f64,
}

impl NodeError {
    /// Returns the larger of each error.
    #[must_use]
    pub fn worst(self, other: Self) -> Self {
        Self { centroid_px: self.centroid_px.max(other.centroid_px), peak: self.peak.max(other.peak) }
    }

    /// Returns the smaller of each error: of two bounds of the same error, each is one.
    #[must_use]
    pub fn least(self, other: Self) -> Self {
        Self { centroid_px: self.centroid_px.min(other.centroid_px), peak: self.peak.min(other.peak) }
    }

    /// Returns the sum of each error.
    #[must_use]
    pub fn plus(self, other: Self) -> Self {
        Self { centroid_px: self.centroid_px + other.centroid_px, peak: self.peak + other.peak }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns a line of `length_px`, in 40 nodes.
    fn line(length_px: [f64; 2]) -> Vec<TracePoint> {
        (0..40)
            .map(|i| (f64::from(i) + 0.5) / 40.0 - 0.5)
            .map(|s| [1.0 / 40.0, s * length_px[0], s * length_px[1]])
            .collect()
    }

    /// Returns the light of a trace in the pixel at (x, y) from a star at (u, v).
    fn pixel(trace: &[TracePoint], sigma_px: f64, [x, y]: [f64; 2], [u, v]: [f64; 2]) -> f64 {
        let light =
            |[w, dx, dy]: &TracePoint| w * gaussian::cell(x - u - dx, sigma_px) * gaussian::cell(y - v - dy, sigma_px);
        trace.iter().map(light).sum()
    }

    /// Returns the largest true errors over many phases: centroid in the window about the brightest pixel, px, and
    /// pixel, share of the peak.
    fn by_brute_force(drawn: &[TracePoint], truth: &[TracePoint], sigma_px: f64) -> NodeError {
        const HALF: usize = 6;
        const SIDE: usize = 2 * HALF + 1;
        let mut worst = NodeError::default();
        for phase in 0..81 {
            let star = [phase % 9, phase / 9].map(|k| f64::from(k) / 9.0 - 0.45);
            let at = |i: usize| [i % SIDE, i / SIDE].map(|k| k as f64 - HALF as f64);
            let [a, b]: [Vec<f64>; 2] =
                [drawn, truth].map(|trace| (0..SIDE * SIDE).map(|i| pixel(trace, sigma_px, at(i), star)).collect());
            let apart = a.iter().zip(&b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            worst.peak = worst.peak.max(apart / gaussian::cell(0.0, sigma_px).powi(2));
            let brightest = (0..SIDE * SIDE).max_by(|i, j| b[*i].total_cmp(&b[*j])).unwrap();
            let first = brightest - WINDOW_HALF * SIDE - WINDOW_HALF;
            let [a, b] = [a, b].map(|image| {
                let image: Vec<f32> = image.iter().map(|v| *v as f32).collect();
                centroid(&image[first..], 1, SIDE)
            });
            worst.centroid_px = worst.centroid_px.max((a[0] - b[0]).hypot(a[1] - b[1]));
        }
        worst
    }

    #[test]
    fn bound_is_above_the_error_and_near_it() {
        for sigma_px in [0.3, 0.5, 0.8, 1.5] {
            for (length_px, stretch) in [([1.5, 0.7], 1.02), ([0.4, 0.1], 1.05), ([2.5, -1.0], 1.004)] {
                let (drawn, truth) = (line(length_px), line(length_px.map(|v| stretch * v)));
                let mut change = ShapeChange::new(sigma_px);
                assert!(change.size(drawn.len(), 2.0), "small enough");
                change.keep(&drawn);
                let (bound, error) = (change.error(&truth), by_brute_force(&drawn, &truth, sigma_px));
                let ratios = [bound.centroid_px / error.centroid_px, bound.peak / error.peak];
                println!("sigma {sigma_px} {length_px:?}: {error:?}, bound / error {ratios:.2?}");
                assert!(bound.centroid_px >= error.centroid_px && bound.peak >= error.peak, "{bound:?} {error:?}");
                let allowed = 3.0 * error.centroid_px + ROUNDING.centroid_px;
                assert!(bound.centroid_px < allowed && bound.peak < 2.0 * error.peak + ROUNDING.peak, "{ratios:?}");
            }
        }
    }

    #[test]
    fn too_much_work_and_unknown_motions_are_refused() {
        let mut change = ShapeChange::new(0.8);
        assert!(change.size(64, 2.0) && !change.size(64, 100.0) && !change.size(100_000, 2.0));
        assert!(!change.size(1, f64::NAN) && !change.size(1, f64::INFINITY));
    }
}
