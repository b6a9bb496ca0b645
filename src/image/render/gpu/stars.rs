//! A plan's stars and nodes in the layout of the shaders, with the box each star stays in.

use bytemuck::{Pod, Zeroable};
use plan::exposure::pose::{PathNode, ROLL, SHIFT};
use plan::exposure::{Drawing, ExposurePlan, PlannedStar};
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

/// Returns a star as a list draws it, with its share of the light, its track if it has one, and its box; `None` where it does
/// not reach an image of `size` px.
#[allow(clippy::cast_possible_truncation, reason = "the planner keeps positions within a few detectors of the origin")]
#[inline(always)]
pub(super) fn record(
    plan: &ExposurePlan,
    star: &PlannedStar,
    (list, share): (usize, f64),
    source: Source,
    size: [usize; 2],
) -> Option<(SpotRecord, Option<TrackRecord>, BoxPx)> {
    let list = plan.lists.get(list)?;
    let track = matches!(list.drawing, Drawing::Nodes).then(|| StarTrack::new(&plan.camera, star.place));
    let px = track.map_or(star.mean_px, |track| plan.origin_px(star, &track));
    let whole = px.map(|v| (v + 0.5).floor());
    let (middle, path) = match track {
        Some(_) => (star.mean_px.map(|v| (v + 0.5).floor()), plan.extent_px.ceil() as i64 + SLACK_PX),
        None => (whole, 0),
    };
    let (mut start, mut sides) = ([0; 2], [0; 2]);
    for axis in 0..2 {
        let reach = path + source.half_px[axis] as i64;
        let (first, last) =
            ((middle[axis] as i64 - reach).max(0), (middle[axis] as i64 + reach).min(size[axis] as i64 - 1));
        start[axis] = usize::try_from(first).ok()?;
        // Empty boxes end here; 16 bits hold the longest side of an image the device takes.
        sides[axis] = u16::try_from(last - first + 1).ok().filter(|n| *n > 0)?;
    }
    let spot = SpotRecord {
        origin: whole.map(|v| v as i32),
        fraction: [(px[0] - whole[0]) as f32, (px[1] - whole[1]) as f32],
        electrons: (share * star.drawn_e) as f32,
        layer: source.layer.unwrap_or(0),
        half_px: packed(source.half_px.map(|half| half as u32)),
        track: NO_TRACK,
    };
    let own = track.map(|track| {
        let ([[xu, xv], [yu, yv]], (first_node, nodes)) =
            (track.px_per_tangent.map(|row| row.map(|v| v as f32)), node_range(list));
        TrackRecord {
            px_per_tangent: [xu, xv, yu, yv],
            tangent: star.place.tangent.to_array().map(|v| v as f32),
            from_principal_px: track.from_principal_px.map(|v| v as f32),
            box_start: start.map(|first| first as i32),
            box_size: packed(sides.map(u32::from)),
            first_node,
            nodes,
            padding: [0; 3],
        }
    });
    Some((spot, own, (start, sides.map(usize::from))))
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
