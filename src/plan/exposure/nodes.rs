//! Lists of path nodes: samples in time, Gauss-Legendre in time, straight segments, and a Gaussian of the path's
//! covariance. Every function appends to `out`; `delay_s` is the delay of the rows after the frame's exposure.

use crate::exposure::pose::{PathNode, Pose, SHIFT, recentre};
use crate::exposure::{motion::Motion, pose::PixelPath};
use crate::optics::quadrature::{MOST_KEPT_NODES, Node, gauss_legendre_node, with_gauss_legendre};

/// Capacity of a plan's nodes under a rolling shutter: 64 bands with a list of 1,024 nodes each.
pub const ROLLING_RESERVED: usize = 1 << 16;
/// Largest number of Gauss-Legendre nodes of one rule over a whole exposure, which costs the square of its nodes: 512
/// of a method, and the few more of the list that it is compared with.
pub const ONE_RULE_NODES: usize = MOST_KEPT_NODES;
/// Number of nodes of a panel, when more are needed.
pub const PANEL_NODES: usize = 16;
/// Largest number of nodes of a smooth path, a whole number of panels.
pub const MOST_SMOOTH_NODES: usize = 1 << 14;
/// Ratio of the axes of a Gaussian below which the thin one gets a single node.
const THIN_AXIS: f64 = 1e-3;

/// Appends `k` equally weighted samples in time, shifted together so that their mean pose is exactly `mean`: the
/// centroid has no error. Gauss-Legendre pairs (fourth order in the step); midpoints when `k` is odd or the path is
/// itself a list of samples.
pub fn samples(motion: &Motion, k: usize, delay_s: f64, mean: &Pose, out: &mut Vec<PathNode>) {
    let (weight, first) = (1.0 / k as f64, out.len());
    let listed = matches!(motion.image_path, Some(PixelPath::Samples(_)));
    let node = |tau: f64| PathNode { weight, pose: motion.pose_at(tau, delay_s) };
    if listed || k % 2 == 1 {
        out.extend((0..k).map(|i| node((i as f64 + 0.5) * weight - 0.5)));
    } else {
        let taus = (0..k / 2).flat_map(|panel| pair().map(|at| 2.0 * (panel as f64 + at) * weight - 0.5));
        out.extend(taus.map(node));
    }
    recentre(&mut out[first..], mean);
}

/// Appends `n` Gauss-Legendre nodes in time (smooth motion only: jitter between nodes would be missed); more than
/// [`ONE_RULE_NODES`] come in panels of equal time, of at most [`PANEL_NODES`] each.
pub fn gauss_legendre_in_time(motion: &Motion, n: usize, delay_s: f64, out: &mut Vec<PathNode>) {
    if n <= ONE_RULE_NODES {
        return with_gauss_legendre(n, |nodes| {
            out.extend(
                nodes.iter().map(|node| PathNode { weight: node.weight, pose: motion.pose_at(node.x, delay_s) }),
            );
        });
    }
    let panels = n.div_ceil(PANEL_NODES);
    let (each, longer, share) = (n / panels, n % panels, 1.0 / panels as f64);
    let rule = |nodes: usize| -> [Node; PANEL_NODES] {
        core::array::from_fn(|i| if i < nodes { gauss_legendre_node(nodes, i) } else { Node { x: 0.0, weight: 0.0 } })
    };
    let rules = [rule(each), rule((each + 1).min(PANEL_NODES))];
    for panel in 0..panels {
        let middle = (panel as f64 + 0.5) * share - 0.5;
        let is_longer = usize::from(panel < longer);
        out.extend(rules[is_longer][..each + is_longer].iter().map(|node| PathNode {
            weight: node.weight * share,
            pose: motion.pose_at(middle + node.x * share, delay_s),
        }));
    }
}

/// Appends `count` straight segments of equal time between points of the path, `per_segment` Gauss-Legendre nodes along
/// each, shifted together to `mean`. Domain: a path that is nearly straight between the points.
pub fn segments(motion: &Motion, count: usize, per_segment: usize, delay_s: f64, mean: &Pose, out: &mut Vec<PathNode>) {
    let (share, first) = (1.0 / count as f64, out.len());
    let mut from = motion.pose_at(-0.5, delay_s);
    with_gauss_legendre(per_segment.clamp(1, MOST_KEPT_NODES), |rule| {
        for segment in 1..=count {
            let to = motion.pose_at(segment as f64 * share - 0.5, delay_s);
            let node = |node: &Node| PathNode { weight: node.weight * share, pose: from.towards(&to, node.x + 0.5) };
            out.extend(rule.iter().map(node));
            from = to;
        }
    });
    recentre(&mut out[first..], mean);
}

/// Appends `per_stretch` Gauss-Legendre nodes in time between every two corners of the path, shifted together to `mean`.
/// Domain: points of jitter or rows of a path, between which it is smooth.
pub fn between_corners(motion: &Motion, per_stretch: usize, delay_s: f64, mean: &Pose, out: &mut Vec<PathNode>) {
    let first = out.len();
    // A rule has so many nodes at most: where more are wanted, each stretch is cut into equal pieces.
    let pieces = per_stretch.div_ceil(MOST_KEPT_NODES).max(1);
    for piece in 0..pieces {
        let count = per_stretch / pieces + usize::from(piece < per_stretch % pieces);
        with_gauss_legendre(count.max(1), |rule| {
            for (start, length) in motion.stretches(delay_s) {
                let share = length / pieces as f64;
                let from = start + piece as f64 * share;
                out.extend(rule.iter().map(|node| {
                    let pose = motion.pose_at(from + (node.x + 0.5) * share, delay_s);
                    PathNode { weight: node.weight * share, pose }
                }));
            }
        });
    }
    recentre(&mut out[first..], mean);
}

/// Appends a Gaussian of the path's own covariance (xx, xy, yy, px^2) about `mean`: three Gauss-Hermite nodes along
/// each of its axes, the same shift for all stars. Domain: paths that look like noise, short relative to the PSF or
/// crossed many times.
pub fn gaussian(covariance_px2: [f64; 3], mean: &Pose, out: &mut Vec<PathNode>) {
    let [xx, xy, yy] = covariance_px2;
    let (middle, half) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
    let (sin, cos) = (0.5 * xy.atan2(0.5 * (xx - yy))).sin_cos();
    let long = (middle + half).max(0.0).sqrt();
    let thin = (middle - half).max(0.0).sqrt();
    for (wa, a) in hermite(long, long) {
        for (wb, b) in hermite(thin, long) {
            if wa * wb > 0.0 {
                let mut pose = *mean;
                pose.0[SHIFT] += a * cos - b * sin;
                pose.0[SHIFT + 1] += a * sin + b * cos;
                out.push(PathNode { weight: wa * wb, pose });
            }
        }
    }
}

/// Returns a three-point Gauss-Hermite rule for a normal of this deviation; one point when it is thin relative to
/// `widest`.
fn hermite(deviation: f64, widest: f64) -> [(f64, f64); 3] {
    if deviation <= THIN_AXIS * widest || deviation == 0.0 {
        return [(1.0, 0.0), (0.0, 0.0), (0.0, 0.0)];
    }
    let at = 3.0_f64.sqrt() * deviation;
    [(1.0 / 6.0, -at), (2.0 / 3.0, 0.0), (1.0 / 6.0, at)]
}

/// Appends one node at the mean of the path.
pub fn single(mean: &Pose, out: &mut Vec<PathNode>) {
    out.push(PathNode { weight: 1.0, pose: *mean });
}

/// Returns the two Gauss-Legendre nodes of a piece, as shares of it.
pub(super) fn pair() -> [f64; 2] {
    const OFF: f64 = 0.288_675_134_594_812_9; // 1 / (2 sqrt 3)
    [0.5 - OFF, 0.5 + OFF]
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to usize bounds first")]
pub(super) fn clamped(wanted: f64, least: usize, most: usize) -> usize {
    wanted.ceil().clamp(least as f64, most.max(least) as f64) as usize
}
