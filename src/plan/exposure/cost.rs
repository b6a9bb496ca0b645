//! Predicts the time of a frame from a few constants per backend.
//!
//! In: method, number of stars, sizes, steps of planning. Out: ms of planning and drawing. The defaults were measured on
//! two cores of an AMD EPYC with AVX-512, frame after frame without a detector (guide, accuracy_and_speed.md);
//! `starloop calibrate` measures those of the present machine, as in a run. They order the methods, and are the prediction
//! used by `check` and the degradation levels.
//!
//! *Steps.* What planning a path takes is known when it is planned: places of probes at nodes, and what takes as long
//! (a pose, a part of a characteristic function, an edge of a pixel). The planner counts them, the same on every machine;
//! 1,500 steps (a short line) and 100 million (jitter under a rolling shutter) took 10 to 13 ns each
//! beyond `motion_ms`.
//!
//! *Fit.* Fits cost constants to measured times of known frames -> [`CostModel`].
//!
//! The model is linear in its constants, so the coefficients of a time are the model's predictions with one constant
//! set to 1 and all others to 0. Least squares of predicted / measured - 1 with no constant below 0, by projected
//! Gauss-Seidel on the normal equations (convex: it converges from any start). Constants that affect no measured time,
//! the number of threads and the readout keep their values. Tests below: known constants are recovered, wrong times are
//! detected.

use crate::exposure::sampling::{oversampling, table_images};
use crate::{exposure::method::Method, optics::PsfModel};
use serde::{Deserialize, Serialize};

/// Pixels of an image that stays near the processor: 4 MB.
pub const NEAR_PIXELS: usize = 1 << 20;
/// Products in whose time a kernel of a path along a pixel axis is drawn, and one that is drawn from images.
const LEAST_PRODUCTS: f64 = 2.0;
const MOST_PRODUCTS: f64 = 8.5;
/// Furthest that a path is counted to lead from its middle, px: damaged jitter may turn a star behind the camera.
const FURTHEST_PX: f64 = 1e6;

/// Cost constants of one backend.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CostModel {
    /// Constant time per frame, ms.
    pub frame_ms: f64,
    /// Time per pixel of the detector to clear and write it, ns.
    pub pixel_ns: f64,
    /// The same for pixels beyond the first [`NEAR_PIXELS`], ns: those of a large image do not stay near the processor.
    pub far_pixel_ns: f64,
    /// Time per star to place, plan and sort it, ns.
    pub star_ns: f64,
    /// Additional time per frame with motion, ms.
    pub motion_ms: f64,
    /// Time per step of following paths and weighing methods, ns: a step is one star at one node, or what takes as long.
    pub path_step_ns: f64,
    /// Additional time per star with motion, for its mean place, ns.
    pub motion_star_ns: f64,
    /// Time per star and node of an analytic (Gaussian) PSF, ns.
    pub splat_ns: f64,
    /// Time per star and pixel of a kernel's padded rows, ns.
    pub table_pixel_ns: f64,
    /// The same for each of the products that a kernel is the sum of, ns.
    pub product_pixel_ns: f64,
    /// Time per star, node and pixel of the padded rows of a table of the PSF itself (wider, further from the cache),
    /// ns.
    pub base_pixel_ns: f64,
    /// Time per node and grid point to build an effective PSF, ns.
    pub kernel_node_ns: f64,
    /// Time per entry of an effective PSF's images for any number of nodes, ns.
    pub kernel_entry_ns: f64,
    /// Number of kernels that are built in parallel.
    pub threads: f64,
    /// Time per pixel for the detector's noise and conversion, ns.
    pub readout_pixel_ns: f64,
}

/// Properties of the stars to be drawn that determine their cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Load<'a> {
    /// The PSF.
    pub psf: &'a PsfModel,
    /// Footprint half-width, px.
    pub half_px: usize,
    /// Length that the path adds to every side of a kernel, px.
    pub extent_px: f64,
    /// Narrower side of the box about the path, px.
    pub narrow_px: f64,
    /// Stars.
    pub stars: usize,
    /// True when anything moves during the exposure.
    pub moves: bool,
}

impl<'a> Load<'a> {
    /// Returns the load of stars that do not move.
    pub fn still(psf: &'a PsfModel, half_px: usize, stars: usize) -> Self {
        Self { psf, half_px, extent_px: 0.0, narrow_px: 0.0, stars, moves: false }
    }

    /// Returns in the time of about how many products a kernel of the path is drawn: one more for each sigma of the path's
    /// narrower side; a kernel of more than [`MOST_PRODUCTS`] is drawn from images, which take as long.
    fn products(&self) -> f64 {
        (LEAST_PRODUCTS + self.narrow_px / self.psf.core_sigma_px()).min(MOST_PRODUCTS)
    }
}

impl CostModel {
    /// Constants of the CPU backend, two cores.
    pub const CPU: Self = Self {
        frame_ms: 0.003,
        pixel_ns: 0.03,
        far_pixel_ns: 0.1,
        star_ns: 5.0,
        motion_ms: 0.02,
        path_step_ns: 11.0,
        motion_star_ns: 80.0,
        splat_ns: 37.0,
        table_pixel_ns: 0.01,
        product_pixel_ns: 0.1,
        base_pixel_ns: 1.0,
        kernel_node_ns: 0.07,
        kernel_entry_ns: 0.45,
        threads: 2.0,
        readout_pixel_ns: 2.6,
    };
    /// Constants of the GPU backend on software Vulkan, two cores.
    pub const SOFTWARE_GPU: Self = Self {
        frame_ms: 0.3,
        pixel_ns: 0.08,
        far_pixel_ns: 0.08,
        star_ns: 1200.0,
        motion_ms: 0.2,
        path_step_ns: 11.0,
        motion_star_ns: 40.0,
        splat_ns: 170.0,
        table_pixel_ns: 18.0,
        product_pixel_ns: 0.0,
        base_pixel_ns: 30.0,
        kernel_node_ns: 0.08,
        kernel_entry_ns: 1.2,
        threads: 2.0,
        readout_pixel_ns: 10.0,
    };
    /// Constants of the GPU backend on a hardware adapter: about the mean of the two quieter of three runs of `calibrate` on an
    /// NVIDIA H200 beside 16 threads; the third found twice as much for a star and a splat.
    pub const GPU: Self = Self {
        frame_ms: 0.25,
        pixel_ns: 0.005,
        far_pixel_ns: 0.005,
        star_ns: 42.0,
        motion_ms: 0.5,
        path_step_ns: 11.0,
        motion_star_ns: 5.0,
        splat_ns: 1.2,
        table_pixel_ns: 0.01,
        product_pixel_ns: 0.0,
        base_pixel_ns: 0.2,
        kernel_node_ns: 0.33,
        kernel_entry_ns: 0.6,
        threads: 16.0,
        readout_pixel_ns: 0.22,
    };
    /// Constants of the reference backend.
    pub const REFERENCE: Self = Self {
        frame_ms: 5.0,
        pixel_ns: 0.5,
        far_pixel_ns: 0.5,
        star_ns: 1000.0,
        motion_ms: 0.2,
        path_step_ns: 11.0,
        motion_star_ns: 40.0,
        splat_ns: 8_000.0,
        table_pixel_ns: 1e5,
        product_pixel_ns: 0.0,
        base_pixel_ns: 1e5,
        kernel_node_ns: 1e3,
        kernel_entry_ns: 1e3,
        threads: 1.0,
        readout_pixel_ns: 4.0,
    };

    /// Returns true when every constant is finite and not negative, and drawing takes time.
    pub fn is_sound(&self) -> bool {
        // Every constant by name, so that a new one cannot be forgotten.
        let Self { frame_ms, pixel_ns, far_pixel_ns, star_ns, motion_ms, path_step_ns, motion_star_ns, .. } = *self;
        let Self { splat_ns, table_pixel_ns, product_pixel_ns, base_pixel_ns, kernel_node_ns, .. } = *self;
        let Self { kernel_entry_ns, threads, readout_pixel_ns, .. } = *self;
        let constants = [frame_ms, pixel_ns, far_pixel_ns, star_ns, motion_ms, path_step_ns, motion_star_ns, splat_ns];
        let kernels = [table_pixel_ns, product_pixel_ns, base_pixel_ns, kernel_node_ns, kernel_entry_ns];
        let rest = [threads - 1.0, readout_pixel_ns];
        constants.into_iter().chain(kernels).chain(rest).all(|constant| constant.is_finite() && constant >= 0.0)
    }

    /// Returns the time of a frame of `pixels` without stars and without motion, ms.
    pub fn empty_frame_ms(&self, pixels: usize) -> f64 {
        let near = pixels.min(NEAR_PIXELS);
        self.frame_ms + (near as f64 * self.pixel_ns + (pixels - near) as f64 * self.far_pixel_ns) * 1e-6
    }

    /// Returns the time to follow paths and weigh methods in so many steps (0: nothing moves), ms.
    pub fn path_ms(&self, steps: usize) -> f64 {
        if steps == 0 { 0.0 } else { self.motion_ms + steps as f64 * self.path_step_ns * 1e-6 }
    }

    /// Returns the detector's time for `pixels`, ms.
    pub fn readout_ms(&self, pixels: usize) -> f64 {
        pixels as f64 * self.readout_pixel_ns * 1e-6
    }

    /// Returns the time of `method` for the stars of `load`, beyond an empty frame, ms.
    pub fn stars_ms(&self, method: Method, load: &Load<'_>) -> f64 {
        let stars = load.stars as f64;
        let star_node_ns =
            if load.psf.is_gaussian() { self.splat_ns } else { self.base_pixel_ns * padded_pixels(load.half_px) };
        let drawing_ns = if method.kernels() > 0 {
            let half_px = kernel_half_px(load.half_px, load.extent_px);
            let stamp_ns = (self.table_pixel_ns + load.products() * self.product_pixel_ns) * padded_pixels(half_px);
            let stamps = method.stamps().max(load.psf.blended());
            self.kernels_ns(method, load.psf, half_px) + stars * stamps as f64 * stamp_ns
        } else {
            stars * load.psf.blended() as f64 * method.nodes() as f64 * star_node_ns
        };
        let moved_ns = if load.moves { stars * self.motion_star_ns } else { 0.0 };
        (drawing_ns + stars * self.star_ns + moved_ns) * 1e-6
    }

    /// Returns the time to build the kernels of `method`, ns.
    fn kernels_ns(&self, method: Method, psf: &PsfModel, half_px: usize) -> f64 {
        let s = oversampling(psf);
        let grid = ((2 * half_px + 1) * s) as f64;
        // A shifted table needs 16 taps; a Gaussian is an outer product.
        let per_node = if psf.is_gaussian() { 1.0 } else { 16.0 };
        let entries = (table_images(s) as f64) * padded_pixels(half_px);
        let each =
            grid * grid * per_node * method.nodes() as f64 * self.kernel_node_ns + entries * self.kernel_entry_ns;
        let kernels = kernel_count(method, psf) as f64;
        each * (kernels / self.threads).max(1.0)
    }
}

/// Returns the memory of all kernels of `method`, bytes: images by phase, the grid they are taken from, and both axes
/// of every node.
pub fn kernel_bytes(method: Method, psf: &PsfModel, half_px: usize, extent_px: f64) -> usize {
    let (side, s) = (2 * kernel_half_px(half_px, extent_px) + 1, oversampling(psf));
    let grid = (side * s + s + 5).next_multiple_of(64);
    let images = table_images(s) * side * side.next_multiple_of(16);
    let each = images + grid * grid + 2 * grid * method.nodes();
    kernel_count(method, psf).saturating_mul(each).saturating_mul(size_of::<f32>())
}

/// Returns the number of kernels that `method` builds: in a field of PSFs one for every node, unless it is zonal
/// itself.
pub fn kernel_count(method: Method, psf: &PsfModel) -> usize {
    let is_zonal = matches!(method, Method::ZonalPsf { .. });
    method.kernels() * if is_zonal { 1 } else { psf.nodes().len() }
}

/// Returns the half-width of a kernel's footprint, px; a path that leads further than `FURTHEST_PX` counts as that far.
pub fn kernel_half_px(half_px: usize, extent_px: f64) -> usize {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a path on a detector, px")]
    let extent = extent_px.ceil().clamp(0.0, FURTHEST_PX) as usize;
    half_px + extent
}

/// Returns the pixels of a footprint whose rows are padded to whole vectors of 16.
fn padded_pixels(half_px: usize) -> f64 {
    let side = 2 * half_px + 1;
    (side * side.next_multiple_of(16)) as f64
}

/// Number of constants that are fitted.
const FITTED: usize = 13;
/// Number of Gauss-Seidel sweeps: enough for constants to 1e-3 on exact times of [`FITTED`] unknowns.
const SWEEPS: usize = 100_000;

/// Measured time of one frame.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timing<'a> {
    /// Pixels of the detector.
    pub pixels: usize,
    /// Method that drew its stars.
    pub method: Method,
    /// Its stars.
    pub load: Load<'a>,
    /// Steps of planning its motion.
    pub path_steps: usize,
    /// Measured time of drawing, ms.
    pub ms: f64,
}

impl Timing<'_> {
    /// Returns the time that the model predicts for it, ms.
    pub fn predicted_ms(&self, cost: &CostModel) -> f64 {
        let stars_ms = if self.load.stars == 0 { 0.0 } else { cost.stars_ms(self.method, &self.load) };
        cost.empty_frame_ms(self.pixels) + cost.path_ms(self.path_steps) + stars_ms
    }
}

/// Returns the non-negative constants whose predictions are closest to the measured times.
pub fn fit(timings: &[Timing<'_>], usual: &CostModel) -> CostModel {
    let (mut normal, mut right) = ([[0.0; FITTED]; FITTED], [0.0; FITTED]);
    for timing in timings.iter().filter(|timing| timing.ms.is_finite() && timing.ms > 0.0) {
        let row: [f64; FITTED] = core::array::from_fn(|i| {
            let mut unit = [0.0; FITTED];
            unit[i] = 1.0;
            timing.predicted_ms(&with(usual, unit)) / timing.ms
        });
        for i in 0..FITTED {
            right[i] += row[i];
            for j in 0..FITTED {
                normal[i][j] += row[i] * row[j];
            }
        }
    }
    let mut constants = of(usual);
    for _ in 0..SWEEPS {
        for i in 0..FITTED {
            if normal[i][i] > 0.0 {
                let slope: f64 = normal[i].iter().zip(constants).map(|(a, x)| a * x).sum();
                constants[i] = (constants[i] + (right[i] - slope) / normal[i][i]).max(0.0);
            }
        }
    }
    with(usual, constants)
}

/// Returns the constants that are fitted.
fn fitted(cost: &mut CostModel) -> [&mut f64; FITTED] {
    [
        &mut cost.frame_ms,
        &mut cost.pixel_ns,
        &mut cost.far_pixel_ns,
        &mut cost.star_ns,
        &mut cost.motion_ms,
        &mut cost.path_step_ns,
        &mut cost.motion_star_ns,
        &mut cost.splat_ns,
        &mut cost.table_pixel_ns,
        &mut cost.product_pixel_ns,
        &mut cost.base_pixel_ns,
        &mut cost.kernel_node_ns,
        &mut cost.kernel_entry_ns,
    ]
}

fn of(cost: &CostModel) -> [f64; FITTED] {
    fitted(&mut cost.clone()).map(|constant| *constant)
}

fn with(usual: &CostModel, constants: [f64; FITTED]) -> CostModel {
    let mut cost = *usual;
    for (to, constant) in fitted(&mut cost).into_iter().zip(constants) {
        *to = constant;
    }
    cost
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_that_turns_a_star_behind_the_camera_has_a_finite_cost() {
        let psf = PsfModel::gaussian(0.8);
        let method = Method::EffectivePsf { nodes: 64, stretches: 0 };
        let cost = |extent_px: f64| {
            let load = Load { extent_px, moves: true, ..Load::still(&psf, 5, 1000) };
            CostModel::CPU.stars_ms(method, &load)
        };
        assert!(cost(1e18).is_finite() && cost(f64::INFINITY).is_finite());
        assert!(cost(1e18) > cost(100.0) && cost(100.0) > cost(1.0), "control: a longer path costs more");
    }

    #[test]
    fn a_kernel_is_the_sum_of_more_products_the_less_its_path_is_a_line() {
        let psf = PsfModel::gaussian(0.8);
        let ms = |narrow_px: f64| {
            let load = Load { extent_px: 9.0, narrow_px, moves: true, ..Load::still(&psf, 5, 100_000) };
            CostModel::CPU.stars_ms(Method::EffectivePsf { nodes: 64, stretches: 0 }, &load)
        };
        assert!(ms(1.6) > 1.2 * ms(0.0) && ms(4.8) > 1.2 * ms(1.6), "{} {} {}", ms(0.0), ms(1.6), ms(4.8));
        assert!(ms(5.3) == ms(9.0) && ms(f64::INFINITY) == ms(9.0), "beyond so many products images are drawn");
    }

    #[test]
    fn pixels_beyond_those_near_the_processor_cost_more() {
        let ms = |pixels| CostModel::CPU.empty_frame_ms(pixels);
        let [near, far] = [ms(NEAR_PIXELS) - ms(0), ms(2 * NEAR_PIXELS) - ms(NEAR_PIXELS)];
        assert!(near > 0.0 && far > 2.0 * near, "{near} ms and {far} ms");
    }
}

#[cfg(test)]
mod cost_fit_tests {
    use super::*;
    use crate::optics::PsfModel;

    const TRUE: CostModel = CostModel {
        frame_ms: 0.3,
        pixel_ns: 0.2,
        far_pixel_ns: 0.4,
        star_ns: 90.0,
        motion_ms: 0.15,
        path_step_ns: 7.0,
        motion_star_ns: 30.0,
        splat_ns: 12.0,
        table_pixel_ns: 1.5,
        product_pixel_ns: 0.1,
        base_pixel_ns: 3.0,
        kernel_node_ns: 0.08,
        kernel_entry_ns: 0.9,
        threads: 8.0,
        readout_pixel_ns: 2.0,
    };

    fn timed<'a>(timing: Timing<'a>, cost: &CostModel) -> Timing<'a> {
        Timing { ms: timing.predicted_ms(cost), ..timing }
    }

    /// Returns frames like those that are measured, with the times that `cost` predicts.
    fn timings<'a>(cost: &CostModel, psf: &'a PsfModel, airy: &'a PsfModel) -> Vec<Timing<'a>> {
        let samples = |nodes| Method::Samples { nodes };
        let kernel = |nodes| Method::EffectivePsf { nodes, stretches: 0 };
        let frames = [
            (1 << 18, Method::Static, 0, 0),
            (1 << 20, Method::Static, 0, 0),
            (1 << 22, Method::Static, 0, 0),
            (1 << 20, Method::Static, 20_000, 0),
            (1 << 20, Method::Static, 20_000, 1_000),
            (1 << 20, samples(2), 20, 2_000),
            (1 << 20, samples(16), 20, 80_000),
            (1 << 20, samples(16), 5_000, 3_000),
            (1 << 20, samples(64), 5_000, 3_000),
            (1 << 20, kernel(16), 16, 3_000),
            (1 << 20, kernel(256), 16, 3_000),
            (1 << 20, kernel(16), 20_000, 3_000),
        ];
        let timing = |(pixels, method, stars, path_steps)| {
            let load = Load { extent_px: 1.5, narrow_px: 3.0, moves: path_steps > 0, ..Load::still(psf, 5, stars) };
            timed(Timing { pixels, method, load, path_steps, ms: 1.0 }, cost)
        };
        let mut timings: Vec<_> = frames.into_iter().map(timing).collect();
        let kernel = timings[frames.len() - 1];
        let line = Timing { load: Load { narrow_px: 0.0, ..kernel.load }, ..kernel };
        let wide = Timing { load: Load::still(airy, 40, 500), ..timings[3] };
        timings.extend([line, wide].map(|timing| timed(timing, cost)));
        timings
    }

    #[test]
    fn known_constants_are_recovered_from_a_wrong_start() {
        /// Remaining error of Gauss-Seidel.
        const RELATIVE: f64 = 1e-3;
        let (psf, airy) = (PsfModel::gaussian(0.8), PsfModel::airy(1.5, 0.0));
        let timings = timings(&TRUE, &psf, &airy);
        let usual = CostModel { threads: TRUE.threads, readout_pixel_ns: 2.0, ..CostModel::SOFTWARE_GPU };
        let found = fit(&timings, &usual);
        for (found, wanted) in of(&found).into_iter().zip(of(&TRUE)) {
            assert!((found / wanted - 1.0).abs() < RELATIVE, "{found} for {wanted}");
        }
        assert_eq!((found.threads, found.readout_pixel_ns), (8.0, 2.0), "not fitted");
    }

    #[test]
    fn another_machine_has_other_constants_and_a_wrong_timing_is_seen() {
        let (psf, airy) = (PsfModel::gaussian(0.8), PsfModel::airy(1.5, 0.0));
        let slower = CostModel { splat_ns: 24.0, ..TRUE };
        let found = fit(&timings(&slower, &psf, &airy), &CostModel::CPU);
        assert!((found.splat_ns / 24.0 - 1.0).abs() < 0.01, "{found:?}");
        let mut disturbed = timings(&TRUE, &psf, &airy);
        disturbed[2].ms *= 0.1;
        let found = fit(&disturbed, &CostModel::CPU);
        assert!(of(&found).into_iter().all(|constant| constant >= 0.0), "{found:?}");
        let misfit = |timing: &Timing<'_>| (timing.predicted_ms(&found) / timing.ms - 1.0).abs();
        let worst = disturbed.iter().map(misfit).fold(0.0, f64::max);
        assert!(worst > 0.1, "no constants explain these timings: {worst}");
    }
}
