//! Chooses among weighed methods, class of stars by class.

mod weighing;

use crate::exposure::cost::CostModel;
use crate::exposure::method::{Method, MethodChoice, MethodName};
use crate::exposure::motion::{Instrument, Motion, Shutter};
use crate::exposure::plan::{Assessment, ExposurePlan, MOTION_SHARE, StarClass, Verdict};
use crate::exposure::pose::{PathNode, PixelPath};
use crate::exposure::probes::{Probes, SIDE};
use crate::exposure::sampling::{ANALYTIC_HALF_PX, SamplingError, drawn_table_error, sampling_error};
use crate::exposure::trial::{Noise, Trial, TriedError};
use crate::exposure::weigh::{Scales, ShapeOf, WINDOW_PX, light_share, shear_error, stretch_error};
use crate::exposure::whole::{self, Wings};
use crate::exposure::{
    line::DENSE_RESERVED, lists::fill_nodes, mean_field::MeanField, shape_change::NodeError, source::PlannedStar,
};
use base::{accuracy::AccuracyBudget, drawn::Degradation};
use rayon::prelude::*;

/// Rounding of single-precision drawing, px.
const F32_CENTROID_PX: f64 = 5e-6;
/// Flux bias of single-precision shares of light.
const F32_FLUX: f64 = 1e-6;
/// Rounding of one addition in single precision. The error of sums over nodes grows as the root of their number, and
/// slightly more, because neighbouring nodes have similar rounding (measured 1.1e-7 with 32,768 nodes; doubled).
const F32_ROUNDING: f64 = 2.4e-7;
/// Steepest slope of a Gaussian, peaks per sigma: `exp(-1/2)`.
const STEEPEST: f64 = 0.607;
/// Side of the square that contains a star's core, sigma.
const CORE_SIGMAS: f64 = 2.5;
/// Safety factor: the error between probes can exceed the error at the check points.
const BETWEEN_CHECKS: f64 = 2.0;
/// Largest number of nodes for jitter on the frame path.
const MOST_JITTER_NODES: usize = 1024;
/// Numbers of row bands that are tried under a rolling shutter.
const BANDS: [usize; 4] = [1, 4, 16, 64];
/// Share of the budget by which the windows of a band's rows may differ.
const BAND_SHARE: f64 = 0.15;
/// Threshold of a tracker, sigma: it uses stars whose brightest pixel is this far above the noise floor.
const TRACKED_SIGMA: f64 = 3.0;
/// Brightness factor between classes of stars.
const CLASS_STEP: f64 = 8.0;
/// Largest number of classes of stars.
const CLASSES: usize = 3;
/// Number of stars on which methods are tried when no bound is inside the budget and the frame has time.
const TRIED: usize = 9;
const TRIED_IN_TIME: usize = 3;
/// Multiples of the budget: a lower limit for the report of an error whose bound exceeds the budget, and the margin
/// within which a tried error certainly fits, with all additions.
const SURELY_OVER: f64 = 1.2;
const SURELY_INSIDE: f64 = 0.7;
/// Relative flux error of a tried list of nodes: dots lose light between windows.
const TRIED_FLUX: f64 = 1e-4;
/// Number of stars one thread counts at a time.
const COUNTED_TOGETHER: usize = 16_384;

/// A method and the error of its nodes for any star.
#[derive(Debug, Clone, Copy)]
struct Weighed {
    method: Method,
    error: NodeError,
    verdict: Option<Verdict>,
    /// Its error on some of the frame's stars, when no bound was inside the budget.
    tried: Option<TriedError>,
}

/// The light that is drawn, how accurately, and what it costs: the same for all frames.
#[derive(Debug)]
pub(super) struct Setting {
    instrument: Instrument,
    budget: AccuracyBudget,
    cost: CostModel,
    choice: MethodChoice,
    half_px: usize,
    sampling: SamplingError,
    /// Error of tables, where stars are drawn from them.
    table: SamplingError,
    /// True when the backend integrates the exact path with any method.
    is_exact: bool,
}

/// Weighs and chooses methods; keeps its buffers.
#[derive(Debug)]
pub(super) struct Chooser {
    pub(super) setting: Setting,
    scales: Scales,
    lists: Vec<Vec<PathNode>>,
    /// Buffer for the dense nodes of one row.
    dense: Vec<PathNode>,
    weighed: Vec<Weighed>,
    /// Errors common to all methods.
    common: NodeError,
    /// Flux error of a rolling shutter.
    rolling_flux: f64,
    bands: usize,
    /// Error of one list for all rows under a rolling shutter.
    one_band: NodeError,
    /// Steps of the nodes of all lists, and of the probes (see `cost`).
    listed_steps: usize,
    /// Number of stars of the frame.
    stars: usize,
    moves: bool,
    /// Extent and narrower side of the path, px.
    box_px: [f64; 2],
    trial: Trial,
    /// Methods in the order of trials.
    order: Vec<usize>,
    /// True when the methods have been tried on some of the frame's stars.
    is_tried: bool,
    /// True when results on a few stars count for all, because the motion is smooth and the planner chooses. A method
    /// selected by the user, and any method for another motion, must be inside the budget by its bound.
    accepts_tried: bool,
    /// Errors in the wings of stars.
    pub(super) wings: Wings,
    /// True when every method is weighed.
    pub(super) is_thorough: bool,
    /// Time for drawing, ms (infinite: no limit).
    pub(super) limit_ms: f64,
}

impl Chooser {
    /// Returns a chooser for one instrument, budget and backend.
    pub(super) fn new(
        instrument: &Instrument,
        budget: AccuracyBudget,
        cost: CostModel,
        choice: MethodChoice,
        half_px: usize,
    ) -> Self {
        let setting = Setting {
            sampling: sampling_error(&instrument.psf, instrument.sampling),
            table: drawn_table_error(&instrument.psf),
            instrument: instrument.clone(),
            budget,
            cost,
            choice,
            half_px,
            is_exact: false,
        };
        Self {
            setting,
            scales: Scales::new(instrument.psf.core_sigma_px()),
            lists: (0..SIDE).map(|_| Vec::with_capacity(MOST_JITTER_NODES)).collect(),
            dense: Vec::with_capacity(DENSE_RESERVED),
            weighed: Vec::with_capacity(64),
            common: NodeError::default(),
            rolling_flux: 0.0,
            bands: 1,
            one_band: NodeError::default(),
            listed_steps: 0,
            stars: 0,
            moves: false,
            box_px: [0.0; 2],
            trial: Trial::new(),
            order: Vec::with_capacity(64),
            is_tried: false,
            accepts_tried: false,
            wings: Wings::new(instrument, half_px, budget.pixel_sigma),
            is_thorough: false,
            limit_ms: f64::INFINITY,
        }
    }

    /// Sets a backend that integrates every star's exact path in footprints of `half_px`.
    pub(super) fn draw_exactly(&mut self, half_px: usize) {
        self.setting.is_exact = true;
        self.setting.half_px = half_px;
        self.wings = self.wings.all_whole(half_px);
    }

    /// Measures the errors common to all methods: of the mean field, of the dense list, of a rolling shutter.
    pub(super) fn measure(&mut self, motion: &Motion, probes: &Probes, means: &MeanField) {
        self.common = NodeError::default();
        self.rolling_flux = 0.0;
        self.bands = 1;
        self.is_tried = false;
        self.accepts_tried = motion.is_smooth() && !self.setting.is_fixed();
        self.weighed.clear();
        self.moves = !motion.is_still();
        self.box_px = [probes.extent_px, probes.narrow_px];
        if !self.moves {
            return;
        }
        self.scales.watch(probes);
        self.listed_steps = probes.steps(motion);
        let sigma_px = self.setting.instrument.psf.core_sigma_px();
        let mean_px = |track: &_| means.displacement_px(track);
        let mean_px = BETWEEN_CHECKS * probes.mean_error_px(motion, sigma_px, &mut self.dense, mean_px);
        let dense = dense_error(motion, probes, sigma_px);
        self.common =
            NodeError { centroid_px: mean_px + dense * sigma_px, peak: STEEPEST * mean_px / sigma_px + dense };
        if let Shutter::Rolling { line_s } = self.setting.instrument.shutter {
            let speed_px_s = probes.reach_px / motion.los.exposure_s;
            self.common = self.common.plus(shear_error(speed_px_s, line_s, sigma_px));
            self.rolling_flux = stretch_error(speed_px_s, line_s, sigma_px, motion.is_smooth());
            self.choose_bands(motion, probes);
        }
    }

    /// Chooses the smallest number of bands of rows whose stars may share a list.
    fn choose_bands(&mut self, motion: &Motion, probes: &Probes) {
        let mut error = NodeError::default();
        for bands in BANDS {
            self.bands = bands;
            error = self.band_error(motion, probes, bands);
            if bands == 1 {
                self.one_band = error;
            }
            let limit = BAND_SHARE * self.setting.budget.centroid_px;
            if error.centroid_px <= limit
                && error.peak <= STEEPEST * limit / self.setting.instrument.psf.core_sigma_px()
            {
                break;
            }
        }
        self.common = self.common.plus(error);
    }

    /// Returns the error of drawing rows at the edge of a band with the path of the band's middle.
    fn band_error(&mut self, motion: &Motion, probes: &Probes, bands: usize) -> NodeError {
        let height = self.setting.instrument.camera.height_px();
        let half_s = 0.5 * self.setting.instrument.shutter.line_s() * height as f64 / bands as f64;
        // Listed positions are complete; for other paths this number of samples is enough for the comparison.
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
                self.listed_steps += self.lists[row].len() * motion.pose_steps();
            }
            worst = worst.worst(self.scales.error(&self.lists, ShapeOf::EachStar, probes));
        }
        worst
    }

    /// Chooses a method for every class of stars of `plan`, at a degradation level.
    pub(super) fn choose(
        &mut self,
        plan: &mut ExposurePlan,
        degradation: Degradation,
        brightest_e: f64,
        probes: &Probes,
    ) {
        self.stars = plan.stars.len();
        if self.weighed.is_empty() {
            self.weigh(&plan.motion, brightest_e, probes);
        }
        let budget = degradation.loosened(&self.setting.budget);
        let pixels = self.setting.instrument.camera.width_px() * self.setting.instrument.camera.height_px();
        let empty_ms = self.setting.cost.empty_frame_ms(pixels);
        let left_ms = |chooser: &Self| chooser.limit_ms - empty_ms - chooser.path_ms();
        let all = StarClass { brightest_e, stars: plan.stars.len(), ..StarClass::none(plan.chosen) };
        let from_e = plan.whole.from_e;
        let mut together = self.best(&all, &budget, degradation, left_ms(self), probes);
        let may_help = !self.setting.is_exact && (degradation < Degradation::MotionOut || self.setting.is_fixed());
        if self.moves && may_help && !self.is_tried && !together.chosen.verdict.keeps_shape() {
            self.try_methods(plan, &all, &budget, probes);
            together = self.best(&all, &budget, degradation, left_ms(self), probes);
        }
        plan.path_steps = self.path_steps();
        let empty_ms = empty_ms + self.path_ms();
        plan.assessed.clear();
        plan.assessed.extend(self.weighed.iter().map(|weighed| {
            let (assessment, _) = self.assess(weighed, &all, &budget, probes);
            let assessment = self.wings.added_to(assessment, all.brightest_e, from_e, &budget);
            Assessment { cost_ms: assessment.cost_ms + empty_ms, ..assessment }
        }));
        plan.assessed.sort_by(|a, b| a.cost_ms.total_cmp(&b.cost_ms));
        plan.classes.clear();
        if matches!(self.setting.choice, MethodChoice::Auto)
            && degradation < Degradation::MotionOut
            && self.weighed.len() > 1
        {
            self.choose_by_class(plan, brightest_e, &budget, degradation, probes);
        }
        let apart_ms: f64 = plan.classes.iter().map(|class| class.chosen.cost_ms).sum();
        if plan.classes.is_empty() || together.chosen.cost_ms <= apart_ms || !together.chosen.verdict.keeps_shape() {
            plan.classes.clear();
            plan.classes.push(together);
        }
        split_whole(plan, self.bands);
        for class in &mut plan.classes {
            class.chosen = self.wings.added_to(class.chosen, class.brightest_e, from_e, &budget);
        }
        let stars_ms: f64 = plan.classes.iter().map(|class| class.chosen.cost_ms).sum();
        plan.chosen = Assessment { cost_ms: empty_ms + stars_ms, ..plan.classes[0].chosen };
        if self.setting.is_exact {
            let flux_rel = self.setting.instrument.psf.lost_flux(self.setting.half_px);
            let verdict = if flux_rel > budget.flux_rel { Verdict::FluxOverBudget } else { Verdict::Fits };
            plan.chosen = Assessment { centroid_px: 0.0, pixel_sigma: 0.0, flux_rel, verdict, ..plan.chosen };
        }
    }

    /// Tries the methods on some of the plan's stars, cheapest first, until one is inside the budget or no time is
    /// left; a method that cannot be the best keeps its bound.
    fn try_methods(&mut self, plan: &ExposurePlan, all: &StarClass, budget: &AccuracyBudget, probes: &Probes) {
        self.is_tried = true;
        let Self { setting, trial, order, weighed, limit_ms, .. } = self;
        let (steps, limit_ms) = (self.listed_steps + self.scales.steps, *limit_ms);
        let Instrument { psf, full_well_e, read_noise_e_rms, .. } = &setting.instrument;
        let sigma_px = psf.core_sigma_px();
        let noise = Noise { full_well_e: *full_well_e, read_noise_e_rms: *read_noise_e_rms, sigma_px };
        trial.prepare(plan, probes, sigma_px, if limit_ms.is_finite() { TRIED_IN_TIME } else { TRIED });
        order.clear();
        let one_psf = psf.blended() == 1;
        order.extend((0..weighed.len()).filter(|i| one_psf && weighed[*i].can_be_tried()));
        let load = setting.load(all.stars, self.box_px, self.moves);
        let cost_ms = |i: &usize| setting.cost.stars_ms(weighed[*i].method, &load);
        order.sort_unstable_by(|a, b| cost_ms(a).total_cmp(&cost_ms(b)).then(a.cmp(b)));
        let (is_tracked, shows_all) = (setting.is_tracked(all.brightest_e), self.is_thorough || setting.is_fixed());
        let mut least = f64::INFINITY;
        for &i in &*order {
            let is_late = setting.cost.path_ms(steps + trial.steps) > limit_ms;
            if is_late || least <= SURELY_INSIDE && !shows_all {
                break;
            }
            let method = weighed[i].method;
            let bands = if method.kernels() > 0 { 1 } else { self.bands };
            let excess = |tried: &TriedError| tried.excess(budget, is_tracked);
            let tried =
                trial.error(plan, probes, (method, bands), noise, |tried| !shows_all && excess(tried) > least.max(1.0));
            weighed[i].tried = tried;
            least = tried.map_or(least, |tried| least.min(excess(&tried)));
        }
    }

    fn choose_by_class(
        &self,
        plan: &mut ExposurePlan,
        brightest_e: f64,
        budget: &AccuracyBudget,
        degradation: Degradation,
        probes: &Probes,
    ) {
        let begin_e = brightest_e.min(self.setting.saturating_e());
        let faintest_e: [f64; CLASSES] =
            core::array::from_fn(|i| if i + 1 == CLASSES { 0.0 } else { begin_e * CLASS_STEP.powi(-(i as i32 + 1)) });
        let counted = count_classes(&plan.stars, faintest_e);
        for ((stars, brightest_e), faintest_e) in counted.into_iter().zip(faintest_e) {
            let class = StarClass { brightest_e, faintest_e, stars, ..StarClass::none(plan.chosen) };
            if class.stars == 0 {
                continue;
            }
            let class = self.best(&class, budget, degradation, f64::INFINITY, probes);
            match plan.classes.last_mut() {
                Some(before) if before.chosen.method == class.chosen.method => {
                    before.stars += class.stars;
                    before.faintest_e = class.faintest_e;
                    let load = self.load(before.stars);
                    before.chosen.cost_ms = self.setting.cost.stars_ms(before.chosen.method, &load);
                }
                _ => plan.classes.push(class),
            }
        }
    }

    /// Returns the cheapest method for one class that is inside the budget; without one, the most accurate one of those
    /// that fit the time, or of all. Its cost is that of its stars.
    fn best(
        &self,
        class: &StarClass,
        budget: &AccuracyBudget,
        degradation: Degradation,
        limit_ms: f64,
        probes: &Probes,
    ) -> StarClass {
        let wanted = match self.setting.choice {
            MethodChoice::Fixed(name, _) => Some(name),
            MethodChoice::Auto if degradation >= Degradation::MotionOut => Some(MethodName::Static),
            MethodChoice::Auto => None,
        };
        let of_wanted = |weighed: &&Weighed| wanted.is_none_or(|name| weighed.method.name() == name);
        let weighed = || self.weighed.iter().filter(of_wanted);
        let assessed = || weighed().map(|weighed| self.assess(weighed, class, budget, probes));
        let of_shape = assessed().map(|(a, _)| a).filter(|a| a.verdict.keeps_shape());
        let cheapest = of_shape.min_by(|a, b| a.cost_ms.total_cmp(&b.cost_ms));
        let least_wrong = |limit_ms: f64| {
            let in_time = assessed().filter(|(a, _)| a.verdict.is_drawable() && a.cost_ms <= limit_ms);
            let order = |(a, x): &(Assessment, f64), (b, y): &(Assessment, f64)| {
                x.total_cmp(y).then(a.cost_ms.total_cmp(&b.cost_ms))
            };
            in_time.min_by(order).map(|(a, _)| a)
        };
        let least_wrong = || least_wrong(limit_ms).or_else(|| least_wrong(f64::INFINITY));
        let first = || assessed().next().map(|(a, _)| a);
        let chosen = cheapest.or_else(least_wrong).or_else(first).unwrap_or(class.chosen);
        StarClass { chosen, bands: if chosen.method.kernels() > 0 { 1 } else { self.bands }, ..*class }
    }

    /// Returns how many of the plan's stars fit `limit_ms` with the present method of the plan.
    pub(super) fn stars_within(&self, plan: &ExposurePlan, limit_ms: f64) -> usize {
        let pixels = self.setting.instrument.camera.width_px() * self.setting.instrument.camera.height_px();
        let left_ms = limit_ms - self.setting.cost.empty_frame_ms(pixels) - self.path_ms();
        let method = plan.chosen.method;
        let ms = |stars| self.setting.cost.stars_ms(method, &self.load(stars));
        let (kernels_ms, each_ms) = (ms(0), (ms(1000) - ms(0)) * 1e-3);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the stars there are")]
        let keep = ((left_ms - kernels_ms) / each_ms).clamp(0.0, plan.stars.len() as f64) as usize;
        keep
    }

    /// Returns the bounds, or the tried errors, of a method for one class of stars; its cost is that of the class's
    /// stars. Returns with it the largest error as a multiple of the budget, including pixels beyond a star's peak.
    fn assess(
        &self,
        weighed: &Weighed,
        class: &StarClass,
        budget: &AccuracyBudget,
        probes: &Probes,
    ) -> (Assessment, f64) {
        let Weighed { method, error, verdict, tried } = *weighed;
        let psf = &self.setting.instrument.psf;
        let tabulated = method.kernels() > 0 || !psf.is_gaussian() || self.setting.half_px > ANALYTIC_HALF_PX;
        let (drawn_px, drawn_peak) =
            if tabulated { (self.setting.table.centroid_px, self.setting.table.peak) } else { (F32_CENTROID_PX, 0.0) };
        // Without probes the motion is unknown, so no bound can be given.
        let unknown_px = if probes.probes.len() < SIDE * SIDE { f64::INFINITY } else { 0.0 };
        let rim_px = self.setting.rim_error_px(probes.extent_px);
        let mut centroid_px = error.centroid_px
            + self.common.centroid_px
            + self.setting.sampling.centroid_px
            + rim_px
            + drawn_px
            + unknown_px;
        let whole_peak = error.peak + self.common.peak + self.setting.sampling.peak;
        let sigma_of = |peak: f64| self.setting.pixel_sigma(peak, class.brightest_e, probes);
        let (mut pixel_sigma, mut whole_sigma) = (sigma_of(whole_peak.min(1.0) + drawn_peak), sigma_of(whole_peak));
        if let Some(tried) = tried {
            let found = tried.reported();
            let found_px = found.centroid_px + self.setting.sampling.centroid_px + rim_px + drawn_px + unknown_px;
            let found_sigma = found.pixel_sigma + sigma_of(self.setting.sampling.peak + drawn_peak);
            // Where samples do not replace bounds, an error with its bound over the budget stays over it.
            let least = if self.accepts_tried { 0.0 } else { SURELY_OVER };
            centroid_px = centroid_px.min(found_px.max(least * MOTION_SHARE * budget.centroid_px));
            pixel_sigma = pixel_sigma.min(found_sigma.max(least * budget.pixel_sigma));
            whole_sigma = pixel_sigma;
        }
        let drawn_flux = F32_FLUX + F32_ROUNDING * (method.nodes() as f64).sqrt() + tried.map_or(0.0, |_| TRIED_FLUX);
        let flux_rel = psf.lost_flux(self.setting.half_px) + drawn_flux + self.rolling_flux;
        let cost_ms = match verdict {
            Some(Verdict::NeedsSmoothMotion) => f64::INFINITY,
            _ => self.setting.cost.stars_ms(method, &self.load(class.stars)),
        };
        let tracked = self.setting.is_tracked(class.brightest_e);
        let verdict = verdict.unwrap_or(if tracked && centroid_px > MOTION_SHARE * budget.centroid_px {
            Verdict::CentroidOverBudget
        } else if pixel_sigma > budget.pixel_sigma {
            Verdict::PixelOverBudget
        } else if flux_rel > budget.flux_rel {
            Verdict::FluxOverBudget
        } else {
            Verdict::Fits
        });
        let of_centroid = if tracked { centroid_px / (MOTION_SHARE * budget.centroid_px) } else { 0.0 };
        let excess = of_centroid.max(whole_sigma / budget.pixel_sigma).max(flux_rel / budget.flux_rel);
        (Assessment { method, centroid_px, flux_rel, pixel_sigma, cost_ms, verdict }, excess)
    }
}

impl Setting {
    /// Returns the electrons of a star that saturates its brightest pixel: errors of brighter stars are not larger.
    fn saturating_e(&self) -> f64 {
        self.instrument.full_well_e / self.instrument.psf.peak()
    }

    /// Returns true when the user fixed the method.
    pub(super) fn is_fixed(&self) -> bool {
        matches!(self.choice, MethodChoice::Fixed(..))
    }

    /// Returns the largest pixel error in units of its own noise when it is `peak` of the peak of a star of
    /// `brightest_e`.
    fn pixel_sigma(&self, peak: f64, brightest_e: f64, probes: &Probes) -> f64 {
        let psf = &self.instrument.psf;
        let whole_e = brightest_e * psf.peak();
        let peak_e = whole_e.min(self.instrument.full_well_e);
        // Errors are largest on the flanks, which have at least a quarter of the smeared peak's light.
        let light_e = 0.25 * peak_e * light_share(CORE_SIGMAS * psf.core_sigma_px(), probes);
        let noise_e = light_e.sqrt().hypot(self.instrument.read_noise_e_rms).max(1.0);
        // At the edge of its saturated core an overexposed star is steeper than near its peak.
        let steeper = (0.5 * (whole_e / peak_e).ln()).max(1.0);
        peak * peak_e * steeper / noise_e
    }

    /// Returns true when a tracker uses stars of this brightness.
    fn is_tracked(&self, brightest_e: f64) -> bool {
        brightest_e * self.instrument.psf.peak() >= TRACKED_SIGMA * self.instrument.read_noise_e_rms.max(1.0)
    }

    /// Returns the centroid error by the light outside the footprint, px: none while the footprint's rim stays outside
    /// the window.
    fn rim_error_px(&self, extent_px: f64) -> f64 {
        let rim_px = self.half_px as f64 - 0.5 - extent_px;
        if rim_px > 0.5 * WINDOW_PX + 0.5 { 0.0 } else { 0.5 * self.instrument.psf.lost_flux(self.half_px) }
    }
}

impl Wings {
    /// Adds the error in the wings of a star if it is larger. It is the same for all methods: light outside the
    /// footprint, and single precision. Both grow with all of the star's light, though an overexposed star's core
    /// saturates; from `from_e` on, stars are drawn whole.
    fn added_to(&self, assessment: Assessment, brightest_e: f64, from_e: f64, budget: &AccuracyBudget) -> Assessment {
        let pixel_sigma = assessment.pixel_sigma.max(self.sigma(brightest_e, from_e));
        let may_be_over = matches!(assessment.verdict, Verdict::Fits | Verdict::FluxOverBudget);
        let is_over = may_be_over && pixel_sigma > budget.pixel_sigma;
        let verdict = if is_over { Verdict::PixelOverBudget } else { assessment.verdict };
        Assessment { pixel_sigma, verdict, ..assessment }
    }
}

impl Weighed {
    /// Returns true when it is drawn from nodes that are known before the plan is made.
    fn can_be_tried(&self) -> bool {
        self.verdict.is_none() && !matches!(self.method, Method::ZonalPsf { .. })
    }
}

impl TriedError {
    /// Returns the larger of both errors as a multiple of the budget; centroids count for stars that are tracked.
    fn excess(&self, budget: &AccuracyBudget, is_tracked: bool) -> f64 {
        let Self { centroid_px, pixel_sigma } = self.reported();
        let of_centroid = if is_tracked { centroid_px / (MOTION_SHARE * budget.centroid_px) } else { 0.0 };
        of_centroid.max(pixel_sigma / budget.pixel_sigma)
    }
}

/// Moves the stars that are drawn whole from the brightest classes to one of their own, which keeps the nodes of the
/// first; the methods of the other stars stay as they are.
fn split_whole(plan: &mut ExposurePlan, bands: usize) {
    let (from_e, half_px) = (plan.whole.from_e, plan.whole.half_px);
    let Some(first) = plan.classes.first().copied().filter(|class| class.brightest_e >= from_e) else { return };
    // Those that are left out for want of time are the faintest.
    let stars = plan.whole.stars.min(plan.stars.len());
    let mut left = stars;
    for class in &mut plan.classes {
        let taken = left.min(class.stars);
        (class.stars, left) = (class.stars - taken, left - taken);
        class.brightest_e = class.brightest_e.min(from_e);
    }
    plan.classes.retain(|class| class.stars > 0);
    let cost_ms = whole::cost_ms(half_px, first.chosen.method.nodes(), stars);
    let chosen = Assessment { cost_ms, ..first.chosen };
    plan.classes.insert(0, StarClass { faintest_e: from_e, stars, bands, chosen, is_whole: true, ..first });
}

/// Returns for every class, brightest first, its stars and the electrons of the brightest; each starts at its
/// `faintest_e`.
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

/// Returns the error of the planner's own list of nodes, relative to its PSF: pairs `h` apart on average and up to `pi
/// / 2` times further where a sinusoid is fast have an error of `(h / sigma)^4 / 270`. Merged rows of a path add what
/// their covariance lacks.
fn dense_error(motion: &Motion, probes: &Probes, sigma_px: f64) -> f64 {
    if motion.is_smooth() || matches!(motion.image_path, Some(PixelPath::Samples(_))) {
        return 0.0;
    }
    let step_px = core::f64::consts::FRAC_PI_2 * probes.reach_px / probes.dense().len() as f64;
    (step_px / sigma_px).powi(4) / 270.0 + probes.merged_px2() / (sigma_px * sigma_px)
}
