//! Targets -> point sources of a plan, one for every node in time.
//!
//! A target moves by itself while the camera moves: its place at an instant is that of its script, or of its trajectory
//! on the sky, displaced by the camera's pose of the same instant. It is drawn as weighted Gauss-Legendre nodes in
//! time, `1.5 L / sigma + 2` of them for a trajectory of length L (its own and the camera's together), in pieces
//! between the corners of the camera's path. Each node is one more star of the plan, drawn once, so that every backend
//! draws targets as it draws stars; the reference integrates the trajectory itself instead. Limits: under a rolling
//! shutter a node's instant is that of the row of its position; a target has at most [`MOST_NODES`] nodes: if its
//! trajectory or the corners of the camera's path need more, corners are left out evenly, and the target is marked as
//! coarse. Tests: `tests/physics/targets.rs` against an independent integral.

use crate::exposure::cost::{CostModel, Load};
use crate::exposure::motion::{Motion, Shutter};
use crate::exposure::plan::{Drawing, ExposurePlan, NodeList};
use crate::exposure::pose::{PathNode, PixelPath, Pose};
use crate::exposure::source::{PlannedStar, PlannedTarget};
use crate::exposure::{
    mean_field::Correction, method::Method, share::Share, target::Target, track::StarTrack, whole::WholeDomain,
};
use crate::optics::Illumination;
use crate::optics::quadrature::{Node, gauss_legendre};
use base::time::Span;
use sky::astrometry::CameraGeometry;

/// Number of nodes per sigma of the trajectory.
const NODES_PER_SIGMA: f64 = 1.5;
/// Number of additional nodes of every piece.
const NODES_MORE: usize = 2;
/// Share of the nodes of a long stretch that are not at its pieces' ends.
const PIECE_SHARE: f64 = 1.0 - (NODES_MORE + 1) as f64 / PIECE_NODES as f64;
/// Largest number of nodes of one piece; longer ones are divided.
const PIECE_NODES: usize = 16;
/// Number of nodes per period of the fastest jitter line.
const NODES_PER_PERIOD: f64 = 8.0;
/// Smallest number of nodes of changing light: two for each piece of its curve.
const NODES_OF_FADING: f64 = 32.0;
/// Largest number of nodes of one target.
pub const MOST_NODES: usize = 4096;
/// Smallest number of nodes of a stretch between corners.
const LEAST_NODES: usize = 2 + NODES_MORE;
/// Largest number of stretches between corners: each has its smallest number of nodes, and half of all remain for the
/// trajectory.
const MOST_STRETCHES: usize = MOST_NODES / (2 * LEAST_NODES);
/// Initial capacity for the nodes of all targets together: beyond it a frame may allocate once.
const MOST_RESERVED: usize = 8 * MOST_NODES;
/// Number of steps to find the row, and thereby the instant, of a target under a rolling shutter.
const ROW_STEPS: usize = 3;

/// The targets and the buffers of their nodes.
#[derive(Debug)]
pub(super) struct TargetPlanner {
    /// Scripts, then targets on the sky.
    targets: Vec<Target>,
    pub(super) scripts: usize,
    /// Gauss-Legendre rules of 1 to [`PIECE_NODES`] nodes.
    rules: Vec<Vec<Node>>,
    nodes: Vec<PlannedStar>,
    planned: Vec<PlannedTarget>,
    corners: Vec<f64>,
    /// Share of their light that reaches the detector.
    pub(super) light_share: f64,
}

impl TargetPlanner {
    /// Returns a planner without targets.
    pub(super) fn new() -> Self {
        let (nodes, planned) = (Vec::new(), Vec::new());
        Self {
            targets: Vec::new(),
            scripts: 0,
            rules: Vec::new(),
            nodes,
            planned,
            corners: Vec::new(),
            light_share: 1.0,
        }
    }

    /// Sets the scripts; all memory is allocated now.
    pub(super) fn set(&mut self, scripts: Vec<Target>) {
        self.scripts = scripts.len();
        self.targets = scripts;
        self.reserve(0);
    }

    /// Reserves memory for `on_sky` targets in addition to the scripts.
    pub(super) fn reserve(&mut self, on_sky: usize) {
        let most = self.scripts + on_sky;
        if most > 0 && self.rules.is_empty() {
            self.rules = (1..=PIECE_NODES).map(gauss_legendre).collect();
            self.corners = Vec::with_capacity(MOST_STRETCHES);
        }
        self.planned.reserve(most);
        self.targets.reserve(on_sky);
        self.nodes.reserve(self.most_nodes());
    }

    /// Returns the capacity for nodes.
    pub(super) fn most_nodes(&self) -> usize {
        (self.targets.capacity().max(self.targets.len()) * MOST_NODES).min(MOST_RESERVED)
    }

    /// Sets the targets on the sky of the next exposure.
    pub(super) fn set_on_sky(&mut self, targets: &[Target]) {
        if self.rules.is_empty() && !targets.is_empty() {
            self.reserve(targets.len());
        }
        self.targets.truncate(self.scripts);
        self.targets.extend_from_slice(targets);
    }

    /// Returns the predicted time of drawing the nodes of the exposure that was placed last, ms.
    pub(super) fn cost_ms(&self, cost: &CostModel, plan: &ExposurePlan) -> f64 {
        let load = Load::still(&plan.psf, plan.half_px, self.nodes.len());
        if self.nodes.is_empty() { 0.0 } else { cost.stars_ms(Method::Static, &load) }
    }

    /// Computes the nodes of every target that is visible in the plan's exposure.
    /// Those of `whole_from_e` electrons and more may be drawn whole.
    pub(super) fn place(&mut self, plan: &ExposurePlan, illumination: &Illumination, whole_from_e: f64) {
        self.nodes.clear();
        self.planned.clear();
        let Self { targets, rules, nodes, planned, corners, light_share, .. } = self;
        if targets.is_empty() {
            return;
        }
        let lacks_corners = fill_corners(&plan.motion, corners);
        for target in targets {
            let dimmed = Target { e_per_s: target.e_per_s * *light_share, ..*target };
            let found = place(&dimmed, illumination, (plan, whole_from_e), rules, corners, nodes);
            planned.extend(found.map(|found| PlannedTarget { is_coarse: found.is_coarse || lacks_corners, ..found }));
        }
    }

    /// Adds the nodes to the plan's stars, each drawn once, or whole where `domain` takes the target.
    pub(super) fn append(&self, plan: &mut ExposurePlan, share: &Share, domain: &WholeDomain) {
        plan.targets.clear();
        if self.planned.is_empty() {
            return;
        }
        let first_node = plan.nodes.len();
        plan.nodes.push(PathNode { weight: 1.0, pose: Pose::STILL });
        let list = |plan: &mut ExposurePlan, drawing| {
            let (nodes, mean, correction) = (first_node..first_node + 1, Pose::STILL, Correction::none());
            plan.lists.push(NodeList { nodes, mean, correction, drawing, psf_px: [0.0; 2] });
            u32::try_from(plan.lists.len() - 1).unwrap_or(u32::MAX)
        };
        let once = list(plan, Drawing::Once);
        let reach_px = plan.reach_px;
        let is_whole = |planned: &PlannedTarget| {
            domain.takes(planned.electrons, planned.smear.length_px + reach_px, planned.nodes.len())
        };
        let whole = self.planned.iter().any(is_whole).then(|| list(plan, Drawing::Whole));
        let first_star = plan.stars.len();
        for planned in &self.planned {
            let whole = whole.filter(|_| is_whole(planned));
            let mut on_detector = 0.0;
            for node in &self.nodes[planned.nodes.clone()] {
                let still = &plan.nodes[first_node..];
                let gain = if whole.is_some() { share.whole_gain(node) } else { 1.0 };
                let share = gain * share.on_detector(node, &plan.camera, still, plan.extent_px);
                let electrons_on_detector = node.electrons * share;
                on_detector += electrons_on_detector;
                plan.stars.push(PlannedStar { list: whole.unwrap_or(once), electrons_on_detector, ..*node });
            }
            let nodes = first_star + planned.nodes.start..first_star + planned.nodes.end;
            plan.targets.push(PlannedTarget { nodes, electrons_on_detector: on_detector, ..planned.clone() });
        }
    }
}

/// Fills the instants at which the camera's path has corners, s after mid-exposure, ascending; returns true when there
/// are more than [`MOST_STRETCHES`] within the exposure, so that only an even selection is used.
fn fill_corners(motion: &Motion, corners: &mut Vec<f64>) -> bool {
    let exposure_s = motion.los.exposure_s;
    match &motion.image_path {
        None => {
            let mid = motion.los.mid_exposure();
            let points = motion.los.jitter.points.iter().map(|point| (point.at - mid).s());
            take_corners(points.filter(|t_s| t_s.abs() < 0.5 * exposure_s), corners)
        }
        Some(PixelPath::Line(points)) => take_corners(points.iter().map(|point| point.t_s - 0.5 * exposure_s), corners),
        Some(PixelPath::Samples(points)) => {
            let at = |i: usize| (i as f64 / points.len() as f64 - 0.5) * exposure_s;
            take_corners((1..points.len()).map(at), corners)
        }
    }
}

/// Takes corners, an even selection of them when there are too many; then returns true.
fn take_corners(all: impl Iterator<Item = f64> + Clone, corners: &mut Vec<f64>) -> bool {
    corners.clear();
    let every = all.clone().count().div_ceil(MOST_STRETCHES - 1).max(1);
    corners.extend(all.step_by(every));
    every > 1
}

/// Returns the position of a target `t_s` after mid-exposure, px, including the camera's motion; rows there are
/// `delay_s` late. `None` when no direction is imaged there.
pub fn target_px(
    target: &Target,
    camera: &CameraGeometry,
    motion: &Motion,
    t_s: f64,
    delay_s: f64,
) -> Option<[f64; 2]> {
    if motion.is_still() {
        return target.own_px(camera, &motion.los, t_s);
    }
    let place = target.own_place(camera, &motion.los, t_s)?;
    let track = StarTrack::new(camera, place);
    let [dx, dy] = track.exact_px(camera, &motion.pose_at((t_s - delay_s) / motion.los.exposure_s, delay_s));
    Some([place.mid_px[0] + dx, place.mid_px[1] + dy])
}

/// Returns the times of a target's appearance in an exposure that is `delay_s` late: s after mid-exposure.
pub fn seen_after_mid_s(target: &Target, motion: &Motion, delay_s: f64) -> Option<[f64; 2]> {
    let mid = motion.los.mid_exposure();
    let half = Span::from_s(0.5 * motion.los.exposure_s);
    let late = Span::from_s(delay_s);
    let seen = target.seen_s(mid + late - half, mid + late + half)?;
    let mid_s = (mid - target.begin).s();
    Some(seen.map(|t_s| t_s - mid_s))
}

fn place(
    target: &Target,
    illumination: &Illumination,
    (plan, whole_from_e): (&ExposurePlan, f64),
    rules: &[Vec<Node>],
    corners: &[f64],
    nodes: &mut Vec<PlannedStar>,
) -> Option<PlannedTarget> {
    let (camera, motion) = (&plan.camera, &plan.motion);
    let [from_s, to_s] = seen_after_mid_s(target, motion, 0.0)?;
    let middle = target.own_place(camera, &motion.los, 0.5 * (from_s + to_s))?;
    // As for stars: the illumination at its field position at the middle of its light.
    let target = &Target { e_per_s: target.e_per_s * illumination.at(middle.tangent), ..*target };
    let sigma_px = plan.psf.core_sigma_px();
    let own_px = target.length_px(camera, &motion.los, [from_s, to_s]);
    let exposure_s = motion.los.exposure_s;
    let jittered = motion.image_path.is_none();
    let periods = if jittered { motion.los.jitter.highest_line_hz() * (to_s - from_s) } else { 0.0 };
    let camera_px = plan.reach_px * ((to_s - from_s) / exposure_s);
    let fading = if target.fades() { NODES_OF_FADING } else { 0.0 };
    let wanted = (NODES_PER_SIGMA * (own_px + camera_px) / sigma_px + NODES_PER_PERIOD * periods).max(fading);
    let inside = corners.iter().filter(|at| **at > from_s && **at < to_s).count();
    // Every stretch has its smallest number of nodes in addition to the needed ones.
    let most = (MOST_NODES - LEAST_NODES * (inside + 1)) as f64 * PIECE_SHARE;
    let is_coarse = wanted > most;
    let wanted = wanted.min(most);
    let first = nodes.len();
    let mut sum = [0.0; 3];
    let mut begin_s = from_s;
    let ends = corners.iter().copied().filter(|at| *at > from_s && *at < to_s).chain([to_s]);
    for end_s in ends {
        let share = (end_s - begin_s) / (to_s - from_s);
        pieces(rules, begin_s, end_s, wanted * share, |t_s, weight_s| {
            let Some(px) = seen_by_row(target, plan, t_s) else { return };
            let electrons = target.e_per_s_at(t_s) * weight_s;
            let at = [electrons, electrons * px[0], electrons * px[1]];
            sum = core::array::from_fn(|i| sum[i] + at[i]);
            nodes.push(PlannedStar {
                id: target.id,
                mag: target.mag,
                electrons,
                drawn_e: electrons,
                electrons_on_detector: 0.0,
                place: middle,
                mean_px: px,
                list: 0,
            });
        });
        begin_s = end_s;
    }
    let [electrons, x, y] = sum;
    let half_px = if electrons >= whole_from_e { plan.whole.half_px } else { plan.half_px };
    if !is_near(&nodes[first..], plan, half_px) || electrons <= 0.0 {
        nodes.truncate(first);
        return None;
    }
    let smear = target.smear(camera, &motion.los, [from_s, to_s]);
    Some(PlannedTarget {
        target: *target,
        electrons,
        electrons_on_detector: 0.0,
        mean_px: [x / electrons, y / electrons],
        place: middle,
        smear,
        nodes: first..nodes.len(),
        is_coarse,
    })
}

/// Returns the position at which the rows see a target at the frame's time `t_s` after mid-exposure, px; `None` when no
/// direction is imaged.
pub fn seen_by_row(target: &Target, plan: &ExposurePlan, t_s: f64) -> Option<[f64; 2]> {
    let ExposurePlan { camera, motion, shutter, .. } = plan;
    let mut px = target_px(target, camera, motion, t_s, 0.0)?;
    if *shutter != Shutter::Global {
        for _ in 0..ROW_STEPS {
            let delay_s = shutter.delay_s(px[1], camera.height_px());
            px = target_px(target, camera, motion, t_s + delay_s, delay_s)?;
        }
    }
    Some(px)
}

/// Returns true when any node leaves light on the detector.
fn is_near(nodes: &[PlannedStar], plan: &ExposurePlan, half_px: usize) -> bool {
    let margin = half_px as f64 + 1.0;
    let inside = |v: f64, size: usize| v > -margin && v < size as f64 - 1.0 + margin;
    let size = [plan.camera.width_px(), plan.camera.height_px()];
    nodes.iter().any(|node| inside(node.mean_px[0], size[0]) && inside(node.mean_px[1], size[1]))
}

/// Calls `visit(t_s, weight_s)` for the nodes of one smooth stretch that needs `wanted` of them and a few more.
fn pieces(rules: &[Vec<Node>], begin_s: f64, end_s: f64, wanted: f64, mut visit: impl FnMut(f64, f64)) {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bounded by MOST_NODES")]
    let wanted = wanted.ceil() as usize;
    let count = wanted.div_ceil(PIECE_NODES - NODES_MORE).max(1);
    let each = (wanted.div_ceil(count) + NODES_MORE).min(PIECE_NODES);
    let Some(rule) = rules.get(each - 1) else { return };
    let width_s = (end_s - begin_s) / count as f64;
    for piece in 0..count {
        let middle_s = begin_s + (piece as f64 + 0.5) * width_s;
        for node in rule {
            visit(middle_s + node.x * width_s, node.weight * width_s);
        }
    }
}
