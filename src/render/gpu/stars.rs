//! A plan's stars and nodes in the layout of the shaders, with the box each star stays in.

use crate::exposure::features::FEATURES;
use crate::exposure::{ExposurePlan, Method, PlannedStar};
use bytemuck::{Pod, Zeroable};

/// `Star` of `place.wgsl`.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct StarRecord {
    origin: [i32; 2],
    fraction: [f32; 2],
    box_start: [i32; 2],
    box_size: u32,
    pub(super) electrons: f32,
    along_x: [f32; 4],
    along_y: [f32; 4],
    along_xy: [f32; 4],
}

/// `Node` of `place.wgsl`.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct NodeRecord {
    phi: [f32; 4],
    rest: [f32; 4],
}

/// Pixels that two ends of a displacement may be off by rounding, and the share of its terms that may be.
const SLACK_PX: f32 = 0.01;
const SLACK_REL: f32 = 1e-5;

impl StarRecord {
    /// First pixel and size of the star's box.
    pub(super) fn box_px(&self) -> ([usize; 2], [usize; 2]) {
        let start = self.box_start.map(|v| usize::try_from(v).unwrap_or(0));
        (start, [(self.box_size & 0xffff) as usize, (self.box_size >> 16) as usize])
    }
}

impl NodeRecord {
    fn new(weight: f64, phi: &[f64; FEATURES]) -> Self {
        let [a, b, c, d, e, f] = phi.map(|v| v as f32);
        Self { phi: [a, b, c, d], rest: [e, f, weight as f32, 0.0] }
    }

    fn feature(&self, i: usize) -> f32 {
        if i < 4 { self.phi[i] } else { self.rest[i - 4] }
    }
}

/// True when all stars are drawn about their mean with one node: the path is in the PSF, or there is none.
fn is_shared(method: Method) -> bool {
    matches!(method, Method::EffectivePsf { .. } | Method::Static)
}

/// Nodes of a plan.
pub(super) fn fill_nodes(plan: &ExposurePlan, nodes: &mut Vec<NodeRecord>) {
    nodes.clear();
    if is_shared(plan.chosen.method) {
        nodes.push(NodeRecord::new(1.0, &[0.0; FEATURES]));
    } else {
        nodes.extend(plan.nodes.iter().map(|node| NodeRecord::new(node.weight, &node.phi)));
    }
}

/// Stars of a plan that touch an image of `size` px when drawn in footprints of `half_px`.
pub(super) fn fill_stars(
    plan: &ExposurePlan,
    nodes: &[NodeRecord],
    half_px: usize,
    size: [usize; 2],
    stars: &mut Vec<StarRecord>,
) {
    let shared = is_shared(plan.chosen.method);
    let extent = core::array::from_fn(|i| {
        nodes.iter().map(|node| node.feature(i)).fold((f32::MAX, f32::MIN), |(low, high), v| (low.min(v), high.max(v)))
    });
    stars.clear();
    stars.extend(plan.stars.iter().filter_map(|star| record(star, shared, &extent, half_px, size)));
}

#[allow(clippy::cast_possible_truncation, reason = "the planner keeps positions within a few detectors of the origin")]
fn record(
    star: &PlannedStar,
    shared: bool,
    extent: &[(f32, f32); FEATURES],
    half_px: usize,
    size: [usize; 2],
) -> Option<StarRecord> {
    let px = if shared { star.mean_px } else { star.track.mid_px };
    let whole = px.map(|v| (v + 0.5).floor());
    let origin = whole.map(|v| v as i32);
    let fraction = [(px[0] - whole[0]) as f32, (px[1] - whole[1]) as f32];
    let response = star.track.response.map(|row| row.map(|v| v as f32));
    let mut start = [0; 2];
    let mut box_size = 0;
    for axis in 0..2 {
        let (low, high) = span(fraction[axis], &response[axis], extent);
        let reach = half_px as i64;
        let first = (i64::from(origin[axis]) + low - reach).max(0);
        let last = (i64::from(origin[axis]) + high + reach).min(size[axis] as i64 - 1);
        start[axis] = i32::try_from(first).ok()?;
        // Empty boxes end here; 16 bits hold the longest side of an image the device takes.
        box_size |= u32::from(u16::try_from(last - first + 1).ok().filter(|n| *n > 0)?) << (16 * axis);
    }
    let [rx, ry] = response;
    Some(StarRecord {
        origin,
        fraction,
        box_start: start,
        box_size,
        electrons: star.electrons as f32,
        along_x: [rx[0], rx[1], rx[2], rx[3]],
        along_y: [ry[0], ry[1], ry[2], ry[3]],
        along_xy: [rx[4], rx[5], ry[4], ry[5]],
    })
}

/// Lowest and highest pixel, from the origin, in which any node can stand.
#[allow(clippy::cast_possible_truncation, reason = "the planner keeps displacements within a few detectors")]
fn span(fraction: f32, response: &[f32; FEATURES], extent: &[(f32, f32); FEATURES]) -> (i64, i64) {
    let (mut low, mut high, mut terms) = (fraction, fraction, 0.0_f32);
    for (r, (least, most)) in response.iter().zip(extent) {
        let (a, b) = (r * least, r * most);
        low += a.min(b);
        high += a.max(b);
        terms += a.abs().max(b.abs());
    }
    let slack = SLACK_PX + SLACK_REL * terms;
    ((low - slack + 0.5).floor() as i64, (high + slack + 0.5).floor() as i64)
}
