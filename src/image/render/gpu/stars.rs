//! A plan's stars and nodes in the layout of the shaders, with the box each star stays in.

use crate::render::spots::pixel_and_fraction;
use bytemuck::{Pod, Zeroable};
use plan::exposure::pose::{PathNode, ROLL, SHIFT};
use plan::exposure::{ExposurePlan, PlannedStar};
use plan::exposure::{plan::NodeList, track::StarTrack};

/// `Spot` of `place.wgsl`: all there is of a star that is drawn once.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct SpotRecord {
    origin: [i32; 2],
    fraction: [f32; 2],
    pub(super) electrons: f32,
    layer: u32,
    half_px: u32,
    /// Number of its track, or [`NO_TRACK`].
    pub(super) track: u32,
}

/// `Track` of `place.wgsl`: the motion of a star that is drawn node by node.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct TrackRecord {
    px_per_tangent: [f32; 4],
    tangent: [f32; 2],
    from_principal_px: [f32; 2],
    box_start: [i32; 2],
    box_size: u32,
    first_node: u32,
    pub(super) nodes: u32,
    padding: [u32; 3],
}

/// Marks a star that is drawn once.
pub(super) const NO_TRACK: u32 = u32::MAX;

/// The part of the image that a star's light stays in: first pixel and size.
pub(super) type BoxPx = ([usize; 2], [usize; 2]);

/// `Node` of `place.wgsl`: rows of the turn with sine, cosine less one and shift x; then weight and shift y.
#[derive(Debug, Clone, Copy, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub(super) struct NodeRecord {
    rows: [[f32; 4]; 3],
    rest: [f32; 4],
}

/// Source of a star's image: a layer of the table (or none: analytically) and its half-width, px.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Source {
    pub(super) layer: Option<u32>,
    pub(super) half_px: [usize; 2],
}

/// Rows and columns beyond the probes' extent of the path that a star may be led, px.
const SLACK_PX: i64 = 2;
/// Extent of a path that counts, px: more than any detector.
const FURTHEST_PX: f64 = 1e9;

impl NodeRecord {
    /// The node of a star that is drawn once.
    const ONCE: Self = Self { rows: [[0.0; 4]; 3], rest: [1.0, 0.0, 0.0, 0.0] };

    fn new(node: &PathNode) -> Self {
        let p = node.pose.0.map(|v| v as f32);
        Self {
            rows: [[p[0], p[1], p[2], p[ROLL]], [p[3], p[4], p[5], p[ROLL + 1]], [p[6], p[7], p[8], p[SHIFT]]],
            rest: [node.weight as f32, p[SHIFT + 1], 0.0, 0.0],
        }
    }
}

/// Writes the nodes of a plan: one for stars that are drawn once, then those of the lists that are drawn node by node.
pub(super) fn fill_nodes(plan: &ExposurePlan, nodes: &mut Vec<NodeRecord>) {
    nodes.clear();
    nodes.push(NodeRecord::ONCE);
    nodes.extend(plan.nodes.iter().map(NodeRecord::new));
}

/// Returns a star that is drawn once, at `px`, and its box; `None` where it does not reach an image of `size` px.
#[inline(always)]
pub(super) fn spot(px: [f64; 2], electrons: f64, source: Source, size: [usize; 2]) -> Option<(SpotRecord, BoxPx)> {
    let (origin, fraction) = pixel_and_fraction(px);
    let box_px = box_about(origin, source.half_px.map(|half| half as i64), size)?;
    let half_px = packed(source.half_px.map(|half| half as u32));
    let layer = source.layer.unwrap_or(0);
    Some((SpotRecord { origin, fraction, electrons: electrons as f32, layer, half_px, track: NO_TRACK }, box_px))
}

/// Returns a star that is drawn at every node of a list, with its track and its box; `None` where it does not reach an image
/// of `size` px.
#[allow(clippy::cast_possible_truncation, reason = "the planner keeps paths within a few detectors")]
#[inline(always)]
pub(super) fn trail(
    plan: &ExposurePlan,
    star: &PlannedStar,
    (list, electrons): (&NodeList, f64),
    source: Source,
    size: [usize; 2],
) -> Option<(SpotRecord, TrackRecord, BoxPx)> {
    let track = StarTrack::new(&plan.camera, star.place);
    let (middle, _) = pixel_and_fraction(star.mean_px);
    let path_px = plan.extent_px.ceil().min(FURTHEST_PX) as i64 + SLACK_PX;
    let box_px = box_about(middle, source.half_px.map(|half| half as i64 + path_px), size)?;
    let (origin, fraction) = pixel_and_fraction(plan.origin_px(star, &track));
    let layer = source.layer.unwrap_or(0);
    let half_px = packed(source.half_px.map(|half| half as u32));
    // Its track gets a number when all tracks are there.
    let spot = SpotRecord { origin, fraction, electrons: electrons as f32, layer, half_px, track: 0 };
    let ([[xu, xv], [yu, yv]], (first_node, nodes)) =
        (track.px_per_tangent.map(|row| row.map(|v| v as f32)), node_range(list));
    let track = TrackRecord {
        px_per_tangent: [xu, xv, yu, yv],
        tangent: star.place.tangent.to_array().map(|v| v as f32),
        from_principal_px: track.from_principal_px.map(|v| v as f32),
        box_start: box_px.0.map(|first| first as i32),
        box_size: packed(box_px.1.map(|side| side as u32)),
        first_node,
        nodes,
        padding: [0; 3],
    };
    Some((spot, track, box_px))
}

/// Returns the pixels of an image of `size` px that are not further from `middle` than `reach`; `None` where there are none.
#[inline(always)]
fn box_about(middle: [i32; 2], reach: [i64; 2], size: [usize; 2]) -> Option<BoxPx> {
    let (mut start, mut sides) = ([0; 2], [0; 2]);
    for axis in 0..2 {
        let middle = i64::from(middle[axis]);
        let (first, end) = ((middle - reach[axis]).max(0), (middle + reach[axis] + 1).min(size[axis] as i64));
        if first >= end {
            return None;
        }
        (start[axis], sides[axis]) = (first as usize, (end - first) as usize);
    }
    Some((start, sides))
}

/// Returns two numbers of 16 bits in one.
fn packed([x, y]: [u32; 2]) -> u32 {
    x | y << 16
}

/// Returns the first node and number of nodes of a list; the node of stars drawn once comes before all.
fn node_range(list: &NodeList) -> (u32, u32) {
    let count = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    (count(list.nodes.start + 1), count(list.nodes.len()))
}
