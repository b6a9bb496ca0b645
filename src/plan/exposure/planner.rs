//! The planner: finds the cheapest methods whose error bounds fit the budget, in the available time.
//!
//! In: motion, sources, instrument. Out: [`ExposurePlan`]. After the first frames it allocates nothing. `tests/physics`
//! compares the bounds with the reference.

use crate::attitude::LosPath;
use crate::exposure::method::{Method, MethodChoice};
use crate::exposure::motion::{Instrument, Motion, Shutter};
use crate::exposure::place::{Brightness, Lit, Margins, place_stars};
use crate::exposure::plan::{Assessment, CutOff, ExposurePlan, Verdict};
use crate::exposure::whole::{self, WholeDomain, WholeStars};
use crate::exposure::{
    choice::Chooser, cost::CostModel, cut_off::CutOffCells, mean_field::MeanField, probes::Probes, share::Share,
    smear::SmearField, source::Source, target::Target, target_plan::TargetPlanner,
};
use crate::exposure::{line, lists, nodes};
use base::{accuracy::AccuracyBudget, drawn::Degradation};

/// Share of the budget's flux error that footprint truncation may use.
const TRUNCATION_SHARE: f64 = 0.05;
/// Initial capacity of a frame's buffers, stars.
const STARS_RESERVED: usize = 16_384;

/// Nodes of a star that is drawn whole, at most: for the prediction of its time.
const MOST_WHOLE_NODES: usize = 1024;

/// Smallest number of stars, drawn even when late: a frame without stars is useless and not much faster.
const LEAST_STARS: usize = 32;

/// Chooses methods; owns the buffers of the plan.
#[derive(Debug)]
pub struct Planner {
    instrument: Instrument,
    budget: AccuracyBudget,
    time_budget_ms: Option<f64>,
    last_degradation: Degradation,
    plan: ExposurePlan,
    probes: Probes,
    means: MeanField,
    chooser: Chooser,
    cells: CutOffCells,
    lists: lists::Buffers,
    share: Share,
    targets: TargetPlanner,
    cost: CostModel,
    /// True for a backend that integrates every star's exact path.
    is_exact: bool,
    /// Buffer for the stars' electrons.
    brightness_e: Vec<f64>,
    /// Buffer for the numbers of stars in sight, part by part of the sources.
    seen: Vec<usize>,
}

impl Planner {
    /// Returns a planner for one instrument, budget and backend.
    pub fn new(
        instrument: Instrument,
        budget: AccuracyBudget,
        cost: CostModel,
        choice: MethodChoice,
        los: LosPath,
    ) -> Self {
        let half_px = instrument.psf.half_px(budget.flux_rel * TRUNCATION_SHARE);
        let chooser = Chooser::new(&instrument, budget, cost, choice, half_px);
        let whole_px = chooser.wings.half_px;
        let plan = ExposurePlan {
            camera: instrument.camera,
            shutter: instrument.shutter,
            psf: instrument.psf.clone(),
            sampling: instrument.sampling,
            half_px,
            whole: WholeStars { half_px: whole_px, from_e: f64::INFINITY, stars: 0 },
            chosen: NOTHING_CHOSEN,
            assessed: Vec::with_capacity(16),
            classes: Vec::with_capacity(4),
            cut_off: CutOff::default(),
            degradation: Degradation::Full,
            nodes: Vec::with_capacity(match instrument.shutter {
                Shutter::Global => line::DENSE_RESERVED,
                Shutter::Rolling { .. } => nodes::ROLLING_RESERVED,
            }),
            lists: Vec::with_capacity(256),
            reach_px: 0.0,
            extent_px: 0.0,
            narrow_px: 0.0,
            path_steps: 0,
            smear: SmearField::still(),
            stars: Vec::with_capacity(STARS_RESERVED),
            targets: Vec::new(),
            motion: Motion { los, image_path: None },
        };
        let camera = &instrument.camera;
        let share = Share::new(&instrument.psf, [half_px, whole_px], [camera.width_px(), camera.height_px()]);
        // The shortest path has the most cells.
        let mut cells = CutOffCells::default();
        cells.resize([camera.width_px(), camera.height_px()], light_reach_px(&plan));
        Self {
            probes: Probes::new(camera, instrument.shutter),
            means: MeanField::new(camera),
            chooser,
            cells,
            lists: lists::Buffers::default(),
            time_budget_ms: None,
            last_degradation: Degradation::LAST_BY_DEFAULT,
            instrument,
            budget,
            plan,
            share,
            targets: TargetPlanner::new(),
            cost,
            is_exact: false,
            brightness_e: Vec::with_capacity(STARS_RESERVED),
            seen: Vec::with_capacity(STARS_RESERVED),
        }
    }

    /// Sets the time in which drawing must be done, ms; without one, frames are never degraded.
    #[must_use]
    pub fn within_ms(mut self, time_budget_ms: f64) -> Self {
        self.time_budget_ms = Some(time_budget_ms);
        self
    }

    /// Sets another limit of degradation than [`Degradation::LAST_BY_DEFAULT`].
    #[must_use]
    pub fn down_to(mut self, last_degradation: Degradation) -> Self {
        self.last_degradation = last_degradation;
        self
    }

    /// Sets another drawing time from the next plan on.
    pub fn set_time_budget_ms(&mut self, time_budget_ms: f64) {
        self.time_budget_ms = Some(time_budget_ms);
    }

    /// Prepares plans for the reference: every star, however faint, and as much of each as the reference draws; only
    /// light beyond the furthest footprint can exceed the budget.
    #[must_use]
    pub fn exact(mut self) -> Self {
        self.is_exact = true;
        let camera = &self.instrument.camera;
        let half_px = self.plan.half_px.max(self.instrument.psf.whole_half_px());
        self.plan.half_px = half_px;
        self.plan.whole.half_px = half_px;
        self.share = Share::new(&self.instrument.psf, [half_px; 2], [camera.width_px(), camera.height_px()]);
        self.chooser.draw_exactly(half_px);
        self
    }

    /// Weighs every method, even when a cheaper one already fits: for reports.
    #[must_use]
    pub fn thorough(mut self) -> Self {
        self.chooser.is_thorough = true;
        self
    }

    /// Sets targets that move over the detector by their own script, from the next plan on.
    pub fn set_targets(&mut self, scripts: Vec<Target>) {
        self.plan.targets.reserve(scripts.len());
        self.targets.set(scripts);
        self.plan.stars.reserve(self.targets.most_nodes());
    }

    /// Reserves memory for this many targets on the sky.
    pub fn reserve_targets_on_sky(&mut self, most: usize) {
        self.plan.targets.reserve(self.targets.scripts + most);
        self.targets.reserve(most);
        self.plan.stars.reserve(self.targets.most_nodes());
    }

    /// Sets the targets on the sky for the next exposure.
    pub fn set_targets_on_sky(&mut self, targets: &[Target]) {
        self.targets.set_on_sky(targets);
    }

    /// Sets the share of the targets' light that reaches the detector, from the next plan on.
    pub fn set_target_light(&mut self, share: f64) {
        self.targets.light_share = share;
    }

    /// Returns the motion of the next exposure for the caller to fill before [`Self::plan`].
    pub fn motion_mut(&mut self) -> &mut Motion {
        &mut self.plan.motion
    }

    /// Returns the latest plan.
    pub fn latest(&self) -> &ExposurePlan {
        &self.plan
    }

    /// Plans one exposure.
    pub fn plan(&mut self, sources: &[Source]) -> &ExposurePlan {
        self.measure_path();
        let brightness = self.place(sources);
        self.targets.place(&self.plan, &self.instrument.illumination, self.chooser.wings.limit_e);
        self.choose_whole(brightness.whole);
        self.take_degradations(brightness);
        let domain = self.whole_domain();
        let Self { plan, probes, means, lists, instrument, share, targets, .. } = self;
        lists::fill(plan, probes, &instrument.camera, lists);
        if !(means.is_still() && lists::are_given(plan)) {
            lists::give(plan, share, lists);
        }
        targets.append(plan, share, &domain);
        &self.plan
    }

    /// Computes the true paths of the probes, and mean positions all over the field.
    fn measure_path(&mut self) {
        let Self { plan, probes, means, instrument, chooser, .. } = self;
        probes.measure(&plan.motion, instrument.psf.core_sigma_px());
        means.measure(&plan.motion, instrument.shutter, probes);
        plan.reach_px = probes.reach_px;
        (plan.extent_px, plan.narrow_px) = (probes.extent_px, probes.narrow_px);
        plan.smear = SmearField::measured(&plan.motion, probes);
        chooser.measure(&plan.motion, probes, means);
    }

    fn place(&mut self, sources: &[Source]) -> Brightness {
        let Self { plan, means, instrument, seen, chooser, share, .. } = self;
        let further_px = (plan.whole.half_px - plan.half_px) as f64;
        let ordinary_px = light_reach_px(plan);
        let margins = Margins { ordinary_px, whole_px: ordinary_px + further_px, from_e: chooser.wings.limit_e };
        let still = if means.is_still() { share.of_still() } else { None };
        let lit = Lit { camera: &instrument.camera, illumination: &instrument.illumination, still };
        place_stars(sources, lit, &plan.motion.los, means, margins, (&mut plan.stars, seen))
    }

    /// Chooses the stars of this exposure that are drawn whole: all whose wings would be over the budget, or the brightest
    /// of them that the domain allows.
    fn choose_whole(&mut self, over_limit: usize) {
        let domain = self.whole_domain();
        let Self { plan, probes, brightness_e, .. } = self;
        let limit_e = domain.limit_e;
        (plan.whole.from_e, plan.whole.stars) = (f64::INFINITY, 0);
        if over_limit == 0 {
            return;
        }
        let nodes = if plan.motion.is_still() { 1 } else { probes.dense().len().min(MOST_WHOLE_NODES) };
        let most = domain.most_stars(plan.reach_px, nodes);
        if over_limit <= most {
            (plan.whole.from_e, plan.whole.stars) = (limit_e, over_limit);
            return;
        }
        brightness_e.clear();
        brightness_e.extend(plan.stars.iter().map(|star| star.electrons).filter(|electrons| *electrons >= limit_e));
        // A disc has many cells of similar light: none of them is drawn whole, only stars that are far brighter.
        let (brighter, first_left_e, _) = brightness_e.select_nth_unstable_by(most, |a, b| b.total_cmp(a));
        let from_e = whole::BEYOND_A_DISC * *first_left_e;
        (plan.whole.from_e, plan.whole.stars) = (from_e, brighter.iter().filter(|e| **e >= from_e).count());
    }

    fn whole_domain(&self) -> WholeDomain {
        let Self { plan, chooser, time_budget_ms, .. } = self;
        WholeDomain {
            half_px: plan.whole.half_px,
            limit_e: chooser.wings.limit_e,
            limit_ms: time_budget_ms.unwrap_or(f64::INFINITY),
        }
    }

    /// Raises the degradation level until the frame fits its time.
    fn take_degradations(&mut self, brightness: Brightness) {
        let mut degradation = Degradation::Full;
        // Targets are drawn even when time is short: they are the purpose of the frame.
        let targets_ms = self.targets.cost_ms(&self.cost, &self.plan);
        self.plan.cut_off = CutOff::default();
        self.leave_out_faint(degradation, brightness.least_e);
        loop {
            self.plan.degradation = degradation;
            self.chooser.limit_ms = self.time_budget_ms.map_or(f64::INFINITY, |limit_ms| limit_ms - targets_ms);
            self.chooser.choose(&mut self.plan, degradation, brightness.most_e, &self.probes);
            self.plan.chosen.cost_ms += targets_ms;
            let Some(limit_ms) = self.time_budget_ms else { return };
            if self.plan.chosen.cost_ms <= limit_ms {
                return;
            }
            let Some(mut next) = degradation.next() else { return };
            if next == Degradation::MotionOut && self.chooser.setting.is_fixed() {
                // A method fixed by the user is kept.
                next = Degradation::BrightStarsOnly;
            }
            if next > self.last_degradation {
                return;
            }
            if next.cut_off_sigma(&self.budget) > degradation.cut_off_sigma(&self.budget) {
                self.leave_out_faint(next, brightness.least_e);
            }
            if next == Degradation::BrightStarsOnly {
                self.keep_brightest(limit_ms - targets_ms);
            }
            degradation = next;
        }
    }

    /// Leaves out the stars that stay below the level's share of the noise.
    fn leave_out_faint(&mut self, degradation: Degradation, least_e: f64) {
        let Self { plan, cells, instrument, budget, is_exact, .. } = self;
        let reach_px = light_reach_px(plan);
        let camera = &instrument.camera;
        if *is_exact {
            return;
        }
        // Losses of an earlier level count too.
        let allowed_e = degradation.cut_off_sigma(budget) * instrument.read_noise_e_rms - plan.cut_off.most_in_pixel_e;
        let peak = plan.psf.peak();
        if least_e * peak >= allowed_e {
            return;
        }
        cells.resize([camera.width_px(), camera.height_px()], reach_px);
        let places = plan.stars.iter().map(|star| (star.electrons, star.mean_px));
        let (limit_e, cut) = cells.choose(allowed_e, peak, places);
        if cut.stars > 0 {
            plan.stars.retain(|star| star.electrons >= limit_e);
            plan.cut_off.add(&cut);
        }
    }

    /// Keeps as many of the brightest stars as fit the time.
    fn keep_brightest(&mut self, limit_ms: f64) {
        let Self { plan, chooser, brightness_e, cells, instrument, .. } = self;
        let keep = chooser.stars_within(plan, limit_ms).max(LEAST_STARS);
        if keep >= plan.stars.len() {
            return;
        }
        brightness_e.clear();
        brightness_e.extend(plan.stars.iter().map(|star| star.electrons));
        let limit_e = *brightness_e.select_nth_unstable_by(keep - 1, |a, b| b.total_cmp(a)).1;
        // Among stars as bright as the last one kept, the first in order are kept.
        let mut ties = keep - brightness_e.iter().filter(|electrons| **electrons > limit_e).count();
        for star in &mut plan.stars {
            let ties_left = star.electrons == limit_e && ties > 0;
            ties -= usize::from(ties_left);
            star.list = if star.electrons > limit_e || ties_left { STAYS } else { GOES };
        }
        let camera = &instrument.camera;
        let reach_px = light_reach_px(plan);
        cells.resize([camera.width_px(), camera.height_px()], reach_px);
        let gone = plan.stars.iter().filter(|star| star.list == GOES);
        let cut = cells.left_out(plan.psf.peak(), gone.map(|star| (star.electrons, star.mean_px)));
        plan.stars.retain(|star| star.list == STAYS);
        plan.cut_off.add(&cut);
    }
}

/// Returns the distance from its mean place at which a star leaves light, px.
fn light_reach_px(plan: &ExposurePlan) -> f64 {
    plan.half_px as f64 + 1.0 + plan.extent_px
}

/// Mark of a star that is kept while others are left out; lists are assigned afterwards.
const STAYS: u32 = 0;
const GOES: u32 = 1;

const NOTHING_CHOSEN: Assessment = Assessment {
    method: Method::Static,
    centroid_px: 0.0,
    flux_rel: 0.0,
    pixel_sigma: 0.0,
    cost_ms: 0.0,
    verdict: Verdict::Fits,
};
