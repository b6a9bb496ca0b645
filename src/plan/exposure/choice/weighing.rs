//! Weighs every method that may win, with the number of nodes or zones that the brightest star needs.

use super::{Chooser, MOST_JITTER_NODES, Setting, Weighed};
use crate::exposure::cost::{Load, kernel_bytes, kernel_count};
use crate::exposure::method::{Method, MethodChoice, MethodName};
use crate::exposure::motion::{Motion, Shutter};
use crate::exposure::plan::{LONGEST_KERNEL_PX, MOST_KERNEL_BYTES, MOST_KERNELS, RESERVED_KERNEL_PX, Verdict};
use crate::exposure::probes::{Probes, SIDE, gauss_legendre_count};
use crate::exposure::{lists::fill_nodes, pose::PixelPath, shape_change::NodeError, weigh::ShapeOf};

/// Order of weighing: methods whose number of nodes is needed for others come first.
const ORDER: [MethodName; 7] = [
    MethodName::Gaussian,
    MethodName::GaussLegendre,
    MethodName::Corners,
    MethodName::Samples,
    MethodName::Segments,
    MethodName::EffectivePsf,
    MethodName::ZonalPsf,
];
/// Largest number of nodes for a commanded path.
const MOST_NODES: usize = 16_384;
/// Nodes per sigma of a path, beyond which more do not help.
const NODES_PER_SIGMA: f64 = 4.0;
/// Gauss-Legendre nodes along a straight segment.
const PER_SEGMENT: usize = 2;
/// Numbers of Gauss-Legendre nodes between two corners of a path that are tried.
const PER_STRETCH: [usize; 6] = [2, 3, 4, 5, 6, 8];
/// Numbers of zones along each side that are tried.
const ZONES: [u16; 4] = [1, 2, 4, 8];
/// Share of the budget's centroid error allowed for a finite number of nodes.
const NODE_SHARE: f64 = 0.4;
/// Factor by which a kernel of twice the nodes may cost more.
const DEARER: f64 = 1.1;
/// Share of the budget's pixel error allowed for a finite number of nodes.
const NODE_PIXEL_SHARE: f64 = 0.8;

impl Chooser {
    /// Weighs all methods that suit the motion.
    pub(super) fn weigh(&mut self, motion: &Motion, brightest_e: f64, probes: &Probes) {
        self.weigh_method(Method::Static, ShapeOf::EachStar, motion, probes);
        let wanted = match self.setting.choice {
            MethodChoice::Auto => None,
            MethodChoice::Fixed(name, nodes) => Some((name, nodes)),
        };
        let is_enough = |chooser: &Self| {
            chooser.weighed.last().is_some_and(|last| chooser.is_enough(last.error, brightest_e, probes))
        };
        if wanted.is_none() && (motion.is_still() || (is_enough(self) && !self.is_thorough)) {
            return;
        }
        let listed = matches!(motion.image_path, Some(PixelPath::Samples(_)));
        for name in ORDER {
            // Methods that cannot win, or were not requested, are not weighed on the frame path.
            let needless = match (wanted, name) {
                (
                    Some((MethodName::EffectivePsf | MethodName::ZonalPsf, None)),
                    MethodName::Samples | MethodName::Corners,
                ) => false,
                (Some((wanted, _)), _) => wanted != name,
                (None, MethodName::Segments) => listed,
                // The last one weighed is one kernel: where it is enough, or cannot be made, several are not wanted.
                (None, MethodName::ZonalPsf) => {
                    is_enough(self) || self.weighed.last().is_some_and(|one| one.verdict.is_some())
                }
                (None, _) => false,
            };
            if needless && !self.is_thorough {
                continue;
            }
            let fixed = wanted.filter(|(wanted, _)| *wanted == name).and_then(|(_, nodes)| nodes);
            self.weigh_name(name, fixed, motion, brightest_e, probes);
        }
    }

    fn weigh_name(
        &mut self,
        name: MethodName,
        fixed: Option<usize>,
        motion: &Motion,
        brightest_e: f64,
        probes: &Probes,
    ) {
        match name {
            MethodName::Static => {}
            MethodName::Gaussian => self.weigh_method(Method::Gaussian, ShapeOf::Centre, motion, probes),
            MethodName::GaussLegendre if !motion.is_smooth() && matches!(self.setting.choice, MethodChoice::Auto) => {
                // Needed for reports only: where it is never chosen it is not weighed.
                if self.is_thorough {
                    let method = Method::GaussLegendre { nodes: 0 };
                    let error = NodeError { centroid_px: f64::NAN, peak: f64::NAN };
                    self.weighed.push(Weighed {
                        method,
                        error,
                        verdict: Some(Verdict::NeedsSmoothMotion),
                        tried: None,
                    });
                }
            }
            MethodName::GaussLegendre => {
                let nodes = fixed.unwrap_or_else(|| self.setting.smooth_count(probes));
                self.weigh_method(Method::GaussLegendre { nodes }, ShapeOf::EachStar, motion, probes);
            }
            MethodName::Segments => {
                let method = |segments| Method::Segments { segments, per_segment: PER_SEGMENT };
                self.weigh_growing(method, ShapeOf::EachStar, fixed, 1, motion, brightest_e, probes);
            }
            MethodName::Corners => self.weigh_corners(fixed, motion, brightest_e, probes),
            MethodName::Samples => {
                let method = |nodes| Method::Samples { nodes };
                self.weigh_growing(method, ShapeOf::EachStar, fixed, 2, motion, brightest_e, probes);
            }
            MethodName::EffectivePsf => {
                let [nodes, stretches] = self.kernel_nodes(fixed, motion, brightest_e, probes);
                self.weigh_method(Method::EffectivePsf { nodes, stretches }, ShapeOf::Centre, motion, probes);
            }
            MethodName::ZonalPsf => {
                let list = self.kernel_nodes(fixed, motion, brightest_e, probes);
                self.weigh_zones(list, motion, brightest_e, probes);
            }
        }
    }

    /// Weighs nodes between the corners of a path, more and more, until their error is small enough for the brightest star;
    /// none where the path has no corners, or too many, unless the user fixed the method.
    fn weigh_corners(&mut self, fixed: Option<usize>, motion: &Motion, brightest_e: f64, probes: &Probes) {
        // A long path is not counted to its end: it has too many.
        let most = if self.setting.is_fixed() { usize::MAX } else { MOST_JITTER_NODES };
        let stretches = motion.stretches(0.0).take(most).count();
        let wanted = match &fixed {
            Some(per_stretch) => core::slice::from_ref(per_stretch),
            None if stretches < 2 && !self.setting.is_fixed() => &[],
            None => &PER_STRETCH,
        };
        for &per_stretch in wanted {
            let method = Method::Corners { stretches, per_stretch };
            // Rows of a rolling shutter that are exposed later may see one stretch more.
            if method.nodes() + per_stretch > MOST_JITTER_NODES && !self.setting.is_fixed() {
                return;
            }
            if self.weigh_as_enough(method, ShapeOf::EachStar, motion, brightest_e, probes) {
                return;
            }
        }
    }

    /// Weighs a method, and returns true when its error is small enough for the brightest star.
    fn weigh_as_enough(
        &mut self,
        method: Method,
        shape: ShapeOf,
        motion: &Motion,
        brightest_e: f64,
        probes: &Probes,
    ) -> bool {
        self.weigh_method(method, shape, motion, probes);
        let error = self.weighed.last().map_or(NodeError::default(), |weighed| weighed.error);
        self.is_enough(error, brightest_e, probes)
    }

    /// Weighs a method with 1, 2, 4 ... nodes until its error is small enough for the brightest star.
    #[allow(clippy::too_many_arguments, reason = "one loop for two methods")]
    fn weigh_growing(
        &mut self,
        method: impl Fn(usize) -> Method,
        shape: ShapeOf,
        fixed: Option<usize>,
        least: usize,
        motion: &Motion,
        brightest_e: f64,
        probes: &Probes,
    ) {
        let own = match &motion.image_path {
            Some(PixelPath::Samples(points)) => points.len(),
            Some(PixelPath::Line(_)) => MOST_NODES,
            None => self.setting.most_nodes(motion, probes, self.limit_ms),
        };
        let mut count = fixed.unwrap_or(least.min(own));
        // Using as many nodes as another method is not an advantage.
        let star_by_star = |weighed: &&Weighed| weighed.method.kernels() == 0 && weighed.verdict.is_none();
        let enough = self.weighed.iter().filter(star_by_star);
        let enough = enough.filter(|weighed| self.is_enough(weighed.error, brightest_e, probes));
        let most = enough.map(|weighed| weighed.method.nodes()).min().unwrap_or(usize::MAX);
        loop {
            if method(count).nodes() > most && fixed.is_none() && !self.is_thorough {
                return;
            }
            if self.weigh_as_enough(method(count), shape, motion, brightest_e, probes)
                || fixed.is_some()
                || count >= own
            {
                return;
            }
            count = (2 * count).min(own);
        }
    }

    /// Returns true when the error is within the part of the budget that the other errors leave, so that more nodes do
    /// not help.
    fn is_enough(&self, error: NodeError, brightest_e: f64, probes: &Probes) -> bool {
        const LEAST_LEFT: f64 = 0.3;
        let taken = self.setting.pixel_sigma(self.common.peak.min(1.0), brightest_e, probes);
        let left = (self.setting.budget.pixel_sigma - taken).max(LEAST_LEFT * self.setting.budget.pixel_sigma);
        error.centroid_px <= NODE_SHARE * self.setting.budget.centroid_px
            && self.setting.pixel_sigma(error.peak.min(1.0), brightest_e, probes) <= NODE_PIXEL_SHARE * left
    }

    /// Returns the number of nodes of a kernel and the stretches that share them: Gauss-Legendre's for smooth motion, as many as
    /// samples need, or those between corners where samples are not enough.
    fn kernel_nodes(&self, fixed: Option<usize>, motion: &Motion, brightest_e: f64, probes: &Probes) -> [usize; 2] {
        const USUAL: usize = 64;
        if let Some(nodes) = fixed {
            return [nodes, 0];
        }
        if motion.is_smooth() {
            return [self.setting.smooth_count(probes), 0];
        }
        let last = |name| self.weighed.iter().rev().find(|weighed| weighed.method.name() == name);
        let is_enough = |weighed: &&Weighed| self.is_enough(weighed.error, brightest_e, probes);
        let corners = last(MethodName::Corners).filter(is_enough).map(|weighed| weighed.method);
        let nodes = match last(MethodName::Samples) {
            Some(samples) if is_enough(&samples) => {
                // Twice the nodes have a sixteenth of the error, and cost little beside many stars.
                let listed = matches!(motion.image_path, Some(PixelPath::Samples(_)));
                let nodes = samples.method.nodes();
                let more = (2 * nodes).min(MOST_JITTER_NODES).max(nodes);
                let ms = |nodes| self.stars_ms(Method::EffectivePsf { nodes, stretches: 0 });
                if !listed && ms(more) < DEARER * ms(nodes) { more } else { nodes }
            }
            samples => {
                if let Some(method @ Method::Corners { stretches, .. }) = corners {
                    return [method.nodes(), stretches];
                }
                samples.map_or(USUAL, |samples| USUAL.max(2 * samples.method.nodes()))
            }
        };
        [nodes, 0]
    }

    fn weigh_method(&mut self, method: Method, shape: ShapeOf, motion: &Motion, probes: &Probes) {
        let error = if motion.is_still() {
            NodeError::default()
        } else {
            self.fill_lists(method, motion, probes);
            let lists =
                if self.setting.instrument.shutter == Shutter::Global { &self.lists[..1] } else { &self.lists[..] };
            let mut error = self.scales.error(lists, shape, probes);
            if self.is_drawn_to_weigh(method, probes) {
                error = error.least(self.scales.kernel_error(lists, probes));
            }
            if shape == ShapeOf::Centre && self.bands > 1 {
                // One kernel for all rows has the error of rows that differ by more than a band.
                error = error.plus(self.one_band);
            }
            error
        };
        let is_too_rough = matches!(method, Method::GaussLegendre { .. }) && !motion.is_smooth();
        let verdict = if is_too_rough { Some(Verdict::NeedsSmoothMotion) } else { self.kernel_verdict(method, probes) };
        self.weighed.push(Weighed { method, error, verdict, tried: None });
    }

    /// Returns true when the error of a kernel is worth drawing it: it can be chosen, or is reported.
    fn is_drawn_to_weigh(&self, method: Method, probes: &Probes) -> bool {
        if !matches!(method, Method::EffectivePsf { .. }) || self.kernel_verdict(method, probes).is_some() {
            return false;
        }
        let star_by_star = self.weighed.iter().filter(|weighed| weighed.method.kernels() == 0);
        let nodes = star_by_star.map(|weighed| weighed.method.nodes()).max().unwrap_or(1);
        let most_ms = self.stars_ms(Method::Samples { nodes });
        self.is_thorough || self.setting.is_fixed() || self.stars_ms(method) < most_ms
    }

    /// Fills the nodes of `method` for every row of probes.
    fn fill_lists(&mut self, method: Method, motion: &Motion, probes: &Probes) {
        let rows = if self.setting.instrument.shutter == Shutter::Global { 1 } else { SIDE };
        for row in 0..rows {
            self.lists[row].clear();
            fill_nodes(motion, method, probes.delay_s(row), probes, &mut self.lists[row]);
            self.listed_steps += self.lists[row].len() * motion.pose_steps();
        }
    }

    /// Weighs grids of zones, coarse to fine, until one is fine enough for the brightest star.
    fn weigh_zones(&mut self, [nodes, stretches]: [usize; 2], motion: &Motion, brightest_e: f64, probes: &Probes) {
        let one = Method::EffectivePsf { nodes, stretches };
        self.fill_lists(one, motion, probes);
        let rolling = self.setting.instrument.shutter != Shutter::Global;
        let lists = if rolling { &self.lists[..] } else { &self.lists[..1] };
        // Sampling error of the nodes themselves, with each star on its own path.
        let sampled =
            if motion.is_still() { NodeError::default() } else { self.scales.error(lists, ShapeOf::EachStar, probes) };
        let camera = &self.setting.instrument.camera;
        let size = [camera.width_px() as f64, camera.height_px() as f64];
        let enough = self.weighed.iter().filter(|weighed| self.is_enough(weighed.error, brightest_e, probes));
        let cheapest_ms = enough.map(|weighed| self.stars_ms(weighed.method)).fold(f64::INFINITY, f64::min);
        let field = self.setting.instrument.psf.as_field().map_or([1; 2], |field| field.cells());
        let field = field.map(|n| u16::try_from(n).unwrap_or(u16::MAX));
        for zones in ZONES {
            let [columns, rows] = field.map(|cells| cells * zones);
            let bands = if rolling { u16::try_from(self.bands).unwrap_or(u16::MAX) } else { 1 };
            // At least as fine as the bands, with corners where the field of PSFs has its own.
            let rows = rows.max(bands.next_multiple_of(field[1]));
            let method = Method::ZonalPsf { zones: [columns, rows], nodes, stretches };
            if !self.is_thorough && !self.setting.is_fixed() && self.stars_ms(method) >= cheapest_ms {
                return;
            }
            let cell_px = [size[0] / f64::from(columns), size[1] / f64::from(rows)];
            let mut error = NodeError::default();
            if !motion.is_still() {
                for i in [probes.centre_index(), probes.widest_index()] {
                    let (Some(probe), Some(list)) = (probes.probes.get(i), self.lists.first()) else { continue };
                    let varies = self.setting.instrument.psf.as_field().is_some();
                    error = error.worst(self.scales.cell_error(list, probe, cell_px, varies, probes));
                }
            }
            let error = error.plus(sampled);
            let verdict = self.kernel_verdict(method, probes);
            self.weighed.push(Weighed { method, error, verdict, tried: None });
            if self.is_enough(error, brightest_e, probes) {
                return;
            }
        }
    }

    /// Returns the steps of planning this frame (see `cost`); 0 where nothing moves.
    pub(super) fn path_steps(&self) -> usize {
        let tried = if self.is_tried { self.trial.steps } else { 0 };
        if self.moves { self.listed_steps + self.scales.steps + tried } else { 0 }
    }

    /// Returns the time of planning this frame, ms.
    pub(super) fn path_ms(&self) -> f64 {
        self.setting.cost.path_ms(self.path_steps())
    }

    /// Returns the load of so many stars on this path.
    pub(super) fn load(&self, stars: usize) -> Load<'_> {
        self.setting.load(stars, self.box_px, self.moves)
    }

    /// Returns the reason why the kernels of a method cannot be made, if there is one.
    fn kernel_verdict(&self, method: Method, probes: &Probes) -> Option<Verdict> {
        // No memory is taken while a frame's time runs, unless the user chose the method.
        let takes_reserved = self.limit_ms.is_finite() && !self.setting.is_fixed();
        let longest_px = if takes_reserved { RESERVED_KERNEL_PX } else { LONGEST_KERNEL_PX };
        if method.kernels() == 0 {
            None
        } else if !self.setting.instrument.sampling.is_exact() {
            Some(Verdict::OtherSampling)
        } else if probes.extent_px > longest_px {
            Some(Verdict::PathTooLong)
        } else {
            let psf = &self.setting.instrument.psf;
            let bytes = kernel_bytes(method, psf, self.setting.half_px, probes.extent_px);
            // The PSFs' own tables need layers too.
            let most = (MOST_KERNELS + 1).saturating_sub(psf.nodes().len());
            (kernel_count(method, psf) > most || bytes > MOST_KERNEL_BYTES).then_some(Verdict::TooManyKernels)
        }
    }

    /// Returns the predicted time of all stars by `method`.
    fn stars_ms(&self, method: Method) -> f64 {
        self.setting.cost.stars_ms(method, &self.load(self.stars))
    }
}

impl Setting {
    /// Returns the load of so many stars on a path of this extent and narrower side, px.
    pub(super) fn load(&self, stars: usize, [extent_px, narrow_px]: [f64; 2], moves: bool) -> Load<'_> {
        let Self { instrument, half_px, .. } = self;
        Load { psf: &instrument.psf, half_px: *half_px, extent_px, narrow_px, stars, moves }
    }

    /// Returns the number of Gauss-Legendre nodes of smooth motion.
    fn smooth_count(&self, probes: &Probes) -> usize {
        gauss_legendre_count(probes.reach_px, self.instrument.psf.core_sigma_px())
    }

    /// Returns the largest number of nodes of a path that is not commanded: as many as its length needs, if there is
    /// time for them.
    fn most_nodes(&self, motion: &Motion, probes: &Probes, limit_ms: f64) -> usize {
        // Smooth motion uses Gauss-Legendre nodes.
        if motion.is_smooth() || limit_ms.is_finite() {
            return MOST_JITTER_NODES;
        }
        let wanted = NODES_PER_SIGMA * probes.reach_px / self.instrument.psf.core_sigma_px();
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to MOST_NODES")]
        let most = wanted.clamp(MOST_JITTER_NODES as f64, MOST_NODES as f64) as usize;
        most.next_power_of_two()
    }
}
