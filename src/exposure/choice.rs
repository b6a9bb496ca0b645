//! Choosing among methods that have been weighed, class of stars by class.

mod weighing;

use crate::base::accuracy::AccuracyBudget;
use crate::exposure::cost::{CostModel, Load};
use crate::exposure::ladder::Rung;
use crate::exposure::lists::fill_nodes;
use crate::exposure::mean_field::MeanField;
use crate::exposure::method::{Method, MethodChoice, MethodName};
use crate::exposure::motion::{Motion, Shutter};
use crate::exposure::nodes::MOST_DENSE_NODES;
use crate::exposure::pixel_path::PixelPath;
use crate::exposure::plan::{Assessment, ExposurePlan, MOTION_SHARE, PlannedStar, StarClass, Verdict};
use crate::exposure::planner::Instrument;
use crate::exposure::pose::PathNode;
use crate::exposure::probes::{Probes, SIDE};
use crate::exposure::sampling::{ANALYTIC_HALF_PX, SamplingError, TABLE_ERROR, sampling_error};
use crate::exposure::weigh::{NodeError, Scales, ShapeOf, WINDOW_PX, light_share, shear_error, stretch_error};
use crate::optics::PsfModel;
use rayon::prelude::*;

/// Centroid error a table of [`TABLE_ERROR`] leaves, px (measured at most 3e-5 for sigma 0.3 to 1.2).
const TABLE_CENTROID_PX: f64 = 1e-4;
/// Rounding of single-precision drawing, px.
const F32_CENTROID_PX: f64 = 5e-6;
/// Bias of the single-precision error function in a star's sum.
const F32_FLUX: f64 = 1e-6;
/// Rounding of one addition in single precision; sums over nodes wander as the root of their number, and a little more:
/// the light of neighbouring nodes is rounded alike (measured 1.1e-7 with 32,768 nodes; doubled).
const F32_ROUNDING: f64 = 2.4e-7;
/// Steepest slope of a Gaussian, peaks per sigma: `exp(-1/2)`.
const STEEPEST: f64 = 0.607;
/// Side of the square that holds a star's core, sigma.
const CORE_SIGMAS: f64 = 2.5;
/// Between probes the mean may be off by more than at the checks.
const BETWEEN_CHECKS: f64 = 2.0;
/// Most nodes it gives to jitter, on the frame path.
const MOST_JITTER_NODES: usize = 1024;
/// Row bands that are tried under a rolling shutter.
const BANDS: [usize; 4] = [1, 4, 16, 64];
/// Share of the budget that the windows of a band's rows may differ by.
const BAND_SHARE: f64 = 0.15;
/// A tracker uses stars whose brightest pixel stands this many sigma above the noise floor.
const TRACKED_SIGMA: f64 = 3.0;
/// Classes of stars differ by this factor in brightness.
const CLASS_STEP: f64 = 8.0;
/// Classes of stars at most.
const CLASSES: usize = 3;
/// Stars one thread counts at a time.
const COUNTED_TOGETHER: usize = 16_384;

/// A method and the error of its nodes, whatever the stars.
#[derive(Debug, Clone, Copy)]
struct Weighed {
    method: Method,
    error: NodeError,
    verdict: Option<Verdict>,
}

/// Weighs and chooses; keeps its buffers.
#[derive(Debug)]
pub(super) struct Chooser {
    instrument: Instrument,
    budget: AccuracyBudget,
    cost: CostModel,
    choice: MethodChoice,
    half_px: usize,
    sampling: SamplingError,
    scales: Scales,
    lists: Vec<Vec<PathNode>>,
    /// Room for the dense nodes of one row.
    dense: Vec<PathNode>,
    weighed: Vec<Weighed>,
    /// Errors that every method has.
    common: NodeError,
    /// Flux error of a rolling shutter.
    rolling_flux: f64,
    bands: usize,
    /// Error of one list for all rows under a rolling shutter.
    one_band: NodeError,
    /// Stars of the frame.
    stars: usize,
    moves: bool,
    /// Weigh every method.
    pub(super) is_thorough: bool,
}

impl Chooser {
    /// For one instrument, budget and backend.
    #[must_use]
    pub(super) fn new(
        instrument: &Instrument,
        budget: AccuracyBudget,
        cost: CostModel,
        choice: MethodChoice,
        half_px: usize,
    ) -> Self {
        Self {
            sampling: sampling_error(&instrument.psf, instrument.sampling),
            scales: Scales::new(instrument.psf.core_sigma_px()),
            instrument: instrument.clone(),
            budget,
            cost,
            choice,
            half_px,
            lists: (0..SIDE).map(|_| Vec::with_capacity(MOST_JITTER_NODES)).collect(),
            dense: Vec::with_capacity(MOST_DENSE_NODES),
            weighed: Vec::with_capacity(64),
            common: NodeError::default(),
            rolling_flux: 0.0,
            bands: 1,
            one_band: NodeError::default(),
            stars: 0,
            moves: false,
            is_thorough: false,
        }
    }

    /// Errors that every method has: the mean field's, the dense list's own, a rolling shutter's.
    pub(super) fn measure(&mut self, motion: &Motion, probes: &Probes, means: &MeanField) {
        self.common = NodeError::default();
        self.rolling_flux = 0.0;
        self.bands = 1;
        self.weighed.clear();
        self.moves = !motion.is_still();
        if !self.moves {
            return;
        }
        self.scales.watch(probes);
        let sigma_px = self.instrument.psf.core_sigma_px();
        let mean_px = |track: &_| means.displacement_px(track);
        let mean_px = BETWEEN_CHECKS * probes.mean_error_px(motion, sigma_px, &mut self.dense, mean_px);
        let dense = dense_error(motion, probes, sigma_px);
        self.common =
            NodeError { centroid_px: mean_px + dense * sigma_px, peak: STEEPEST * mean_px / sigma_px + dense };
        if let Shutter::Rolling { line_s } = self.instrument.shutter {
            let speed_px_s = probes.reach_px / motion.los.exposure_s;
            self.common = self.common.plus(shear_error(speed_px_s, line_s, sigma_px));
            self.rolling_flux = stretch_error(speed_px_s, line_s, sigma_px);
            self.choose_bands(motion, probes);
        }
    }

    /// The fewest bands of rows whose stars may share a list.
    fn choose_bands(&mut self, motion: &Motion, probes: &Probes) {
        let mut error = NodeError::default();
        for bands in BANDS {
            self.bands = bands;
            error = self.band_error(motion, probes, bands);
            if bands == 1 {
                self.one_band = error;
            }
            let limit = BAND_SHARE * self.budget.centroid_px;
            if error.centroid_px <= limit && error.peak <= STEEPEST * limit / self.instrument.psf.core_sigma_px() {
                break;
            }
        }
        self.common = self.common.plus(error);
    }

    /// Error of drawing rows at the edge of a band with the path of the band's middle.
    fn band_error(&mut self, motion: &Motion, probes: &Probes, bands: usize) -> NodeError {
        let height = self.instrument.camera.height_px();
        let half_s = 0.5 * self.instrument.shutter.line_s() * height as f64 / bands as f64;
        // Listed positions are all there is; other paths are compared well enough by so many samples.
        let listed = matches!(motion.image_path, Some(PixelPath::Samples(_)));
        let count = if listed { probes.dense().len() } else { probes.dense().len().clamp(64, 1024) };
        let mut worst = NodeError::default();
        for side in [-half_s, half_s] {
            for row in 0..SIDE {
                self.lists[row].clear();
                let delay_s = probes.delay_s(row)
                    + if row == 0 {
                        half_s
                    } else if row + 1 == SIDE {
                        -half_s
                    } else {
                        side
                    };
                fill_nodes(motion, Method::Samples { nodes: count }, delay_s, probes, &mut self.lists[row]);
            }
            worst = worst.worst(self.scales.error(&self.lists, ShapeOf::EachStar, probes));
        }
        worst
    }

    /// Chooses a method for every class of stars of `plan`, on a rung of the ladder.
    pub(super) fn choose(&mut self, plan: &mut ExposurePlan, rung: Rung, brightest_e: f64, probes: &Probes) {
        self.stars = plan.stars.len();
        if self.weighed.is_empty() {
            self.weigh(&plan.motion, brightest_e, probes);
        }
        let budget = rung.loosened(&self.budget);
        let pixels = self.instrument.camera.width_px() * self.instrument.camera.height_px();
        let empty_ms = self.cost.empty_frame_ms(pixels, self.moves);
        let all = StarClass { brightest_e, faintest_e: 0.0, stars: plan.stars.len(), bands: 1, chosen: plan.chosen };
        plan.assessed.clear();
        plan.assessed.extend(self.weighed.iter().map(|weighed| {
            let mut assessment = self.assess(weighed, &all, &budget, plan.extent_px, probes);
            assessment.cost_ms += empty_ms;
            assessment
        }));
        plan.assessed.sort_by(|a, b| a.cost_ms.total_cmp(&b.cost_ms));
        let together = self.best(&all, &budget, rung, plan.extent_px, probes);
        plan.classes.clear();
        if matches!(self.choice, MethodChoice::Auto) && rung < Rung::MotionOut && self.weighed.len() > 1 {
            self.choose_by_class(plan, brightest_e, &budget, rung, probes);
        }
        let apart_ms: f64 = plan.classes.iter().map(|class| class.chosen.cost_ms).sum();
        if plan.classes.is_empty() || together.chosen.cost_ms <= apart_ms || !together.chosen.verdict.is_met() {
            plan.classes.clear();
            plan.classes.push(together);
        }
        let stars_ms: f64 = plan.classes.iter().map(|class| class.chosen.cost_ms).sum();
        plan.chosen = Assessment { cost_ms: empty_ms + stars_ms, ..plan.classes[0].chosen };
    }

    fn choose_by_class(
        &self,
        plan: &mut ExposurePlan,
        brightest_e: f64,
        budget: &AccuracyBudget,
        rung: Rung,
        probes: &Probes,
    ) {
        let begin_e = brightest_e.min(self.saturating_e());
        let faintest_e: [f64; CLASSES] =
            core::array::from_fn(|i| if i + 1 == CLASSES { 0.0 } else { begin_e * CLASS_STEP.powi(-(i as i32 + 1)) });
        let counted = count_classes(&plan.stars, faintest_e);
        for ((stars, brightest_e), faintest_e) in counted.into_iter().zip(faintest_e) {
            let class = StarClass { brightest_e, faintest_e, stars, bands: 1, chosen: plan.chosen };
            if class.stars == 0 {
                continue;
            }
            let class = self.best(&class, budget, rung, plan.extent_px, probes);
            match plan.classes.last_mut() {
                Some(before) if before.chosen.method == class.chosen.method => {
                    before.stars += class.stars;
                    before.faintest_e = class.faintest_e;
                    let load = self.load(before.stars, plan.extent_px);
                    before.chosen.cost_ms = self.cost.stars_ms(before.chosen.method, &load);
                }
                _ => plan.classes.push(class),
            }
        }
    }

    /// Electrons of a star that fills its brightest pixel: errors of brighter ones are no larger.
    fn saturating_e(&self) -> f64 {
        self.instrument.full_well_e / self.instrument.psf.peak()
    }

    /// The cheapest method for one class; its cost is that of its stars.
    fn best(
        &self,
        class: &StarClass,
        budget: &AccuracyBudget,
        rung: Rung,
        extent_px: f64,
        probes: &Probes,
    ) -> StarClass {
        let wanted = match self.choice {
            MethodChoice::Fixed(name, _) => Some(name),
            MethodChoice::Auto if rung >= Rung::MotionOut => Some(MethodName::Static),
            MethodChoice::Auto => None,
        };
        let of_wanted = |weighed: &&Weighed| wanted.is_none_or(|name| weighed.method.name() == name);
        let weighed = || self.weighed.iter().filter(of_wanted);
        let assessed = || weighed().map(|weighed| self.assess(weighed, class, budget, extent_px, probes));
        let cheapest = assessed().filter(|a| a.verdict.is_met()).min_by(|a, b| a.cost_ms.total_cmp(&b.cost_ms));
        let least_wrong =
            || assessed().filter(|a| a.verdict.is_drawable()).min_by(|a, b| a.centroid_px.total_cmp(&b.centroid_px));
        let chosen = cheapest.or_else(least_wrong).or_else(|| assessed().next()).unwrap_or(class.chosen);
        StarClass { chosen, bands: if chosen.method.kernels() > 0 { 1 } else { self.bands }, ..*class }
    }

    /// True when the user fixed the method.
    pub(super) fn is_fixed(&self) -> bool {
        matches!(self.choice, MethodChoice::Fixed(..))
    }

    /// How many of the plan's stars fit `limit_ms` with the method that the plan has now.
    #[must_use]
    pub(super) fn stars_within(&self, plan: &ExposurePlan, limit_ms: f64) -> usize {
        let pixels = self.instrument.camera.width_px() * self.instrument.camera.height_px();
        let left_ms = limit_ms - self.cost.empty_frame_ms(pixels, self.moves);
        let method = plan.chosen.method;
        let ms = |stars| self.cost.stars_ms(method, &self.load(stars, plan.extent_px));
        let (kernels_ms, each_ms) = (ms(0), (ms(1000) - ms(0)) * 1e-3);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the stars there are")]
        let keep = ((left_ms - kernels_ms) / each_ms).clamp(0.0, plan.stars.len() as f64) as usize;
        keep
    }

    /// Largest pixel error in units of its own noise when it is `peak` of the peak of a star of `brightest_e`.
    fn pixel_sigma(&self, peak: f64, brightest_e: f64, probes: &Probes) -> f64 {
        let psf = &self.instrument.psf;
        let peak_e = (brightest_e * psf.peak()).min(self.instrument.full_well_e);
        // Errors are largest on the flanks: a quarter of the smeared peak's light is there at least.
        let light_e = 0.25 * peak_e * light_share(CORE_SIGMAS * psf.core_sigma_px(), probes);
        let noise_e = light_e.sqrt().hypot(self.instrument.read_noise_e_rms).max(1.0);
        peak * peak_e / noise_e
    }

    fn load(&self, stars: usize, extent_px: f64) -> Load<'_> {
        Load { psf: &self.instrument.psf, half_px: self.half_px, extent_px, stars, moves: self.moves }
    }

    /// Bounds of a method for one class of stars; its cost is that of the class's stars.
    fn assess(
        &self,
        weighed: &Weighed,
        class: &StarClass,
        budget: &AccuracyBudget,
        extent_px: f64,
        probes: &Probes,
    ) -> Assessment {
        let Weighed { method, error, verdict } = *weighed;
        let psf = &self.instrument.psf;
        let tabulated =
            method.kernels() > 0 || !matches!(psf, PsfModel::Gaussian { .. }) || self.half_px > ANALYTIC_HALF_PX;
        let (drawn_px, drawn_peak) = if tabulated { (TABLE_CENTROID_PX, TABLE_ERROR) } else { (F32_CENTROID_PX, 0.0) };
        // Without probes nothing is known of the motion, and nothing is promised.
        let unknown_px = if probes.probes.len() < SIDE * SIDE { f64::INFINITY } else { 0.0 };
        let rim_px = self.rim_error_px(extent_px);
        let centroid_px =
            error.centroid_px + self.common.centroid_px + self.sampling.centroid_px + rim_px + drawn_px + unknown_px;
        let peak = (error.peak + self.common.peak + self.sampling.peak).min(1.0) + drawn_peak;
        let pixel_sigma = self.pixel_sigma(peak, class.brightest_e, probes);
        let flux_rel =
            psf.lost_flux(self.half_px) + F32_FLUX + F32_ROUNDING * (method.nodes() as f64).sqrt() + self.rolling_flux;
        let cost_ms = match verdict {
            Some(Verdict::NeedsSmoothMotion) => f64::INFINITY,
            _ => self.cost.stars_ms(method, &self.load(class.stars, extent_px)),
        };
        let tracked = class.brightest_e * psf.peak() >= TRACKED_SIGMA * self.instrument.read_noise_e_rms.max(1.0);
        let verdict = verdict.unwrap_or(if tracked && centroid_px > MOTION_SHARE * budget.centroid_px {
            Verdict::CentroidOverBudget
        } else if pixel_sigma > budget.pixel_sigma {
            Verdict::PixelOverBudget
        } else if flux_rel > budget.flux_rel {
            Verdict::FluxOverBudget
        } else {
            Verdict::Fits
        });
        Assessment { method, centroid_px, flux_rel, pixel_sigma, cost_ms, verdict }
    }

    /// Centroid error of light that the footprint drops, px: none while the footprint's rim stays outside the window.
    fn rim_error_px(&self, extent_px: f64) -> f64 {
        let rim_px = self.half_px as f64 - 0.5 - extent_px;
        if rim_px > 0.5 * WINDOW_PX + 0.5 { 0.0 } else { 0.5 * self.instrument.psf.lost_flux(self.half_px) }
    }
}

/// Of every class, brightest first, its stars and the electrons of the brightest; each begins at its `faintest_e`.
fn count_classes(stars: &[PlannedStar], faintest_e: [f64; CLASSES]) -> [(usize, f64); CLASSES] {
    let and = |mut all: [(usize, f64); CLASSES], more: [(usize, f64); CLASSES]| {
        for (class, more) in all.iter_mut().zip(more) {
            *class = (class.0 + more.0, class.1.max(more.1));
        }
        all
    };
    let count = |stars: &[PlannedStar]| {
        stars.iter().fold([(0, 0.0_f64); CLASSES], |mut classes, star| {
            let class = faintest_e[..CLASSES - 1].iter().filter(|faintest_e| star.electrons < **faintest_e).count();
            classes[class] = (classes[class].0 + 1, classes[class].1.max(star.electrons));
            classes
        })
    };
    stars.par_chunks(COUNTED_TOGETHER).map(count).reduce(|| [(0, 0.0); CLASSES], and)
}

/// What the planner's own list of nodes leaves out, relative to its PSF: pairs `h` apart on average and up to `pi / 2`
/// times further where a sinusoid is fast err by `(h / sigma)^4 / 270`.
fn dense_error(motion: &Motion, probes: &Probes, sigma_px: f64) -> f64 {
    if motion.is_smooth() || matches!(motion.image_path, Some(PixelPath::Samples(_))) {
        return 0.0;
    }
    let step_px = core::f64::consts::FRAC_PI_2 * probes.reach_px / probes.dense().len() as f64;
    (step_px / sigma_px).powi(4) / 270.0
}
