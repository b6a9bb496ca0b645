//! Lists of path nodes: samples in time, Gauss-Legendre in time, and the dense list the planner trusts.

use crate::exposure::features::{FEATURES, Features, PathNode, features};
use crate::exposure::motion::Motion;
use crate::exposure::pixel_path::{PixelPath, PixelPoint};
use crate::optics::quadrature::gauss_legendre_node;

/// Mean distance of dense nodes, share of the PSF's sigma. They come in Gauss-Legendre pairs: variance along a straight
/// piece is exact, and the characteristic function errs by `(k h)^4 / 270`.
const DENSE_STEP_SIGMA: f64 = 0.1;
/// Dense nodes per period of the fastest jitter line.
const DENSE_PER_PERIOD: f64 = 24.0;
/// Most dense nodes of a path with jitter (the frame path's buffers hold this many).
pub const MOST_DENSE_NODES: usize = 4096;
/// Most dense nodes of a commanded image path.
pub const MOST_PATH_NODES: usize = 1 << 18;

/// `k` equally weighted samples in time, moved together so that their mean features are exactly `mean`: no centroid
/// error is left. Gauss-Legendre pairs (fourth order in the step); midpoints when `k` is odd or the path is itself a
/// list of samples.
pub fn samples(motion: &Motion, k: usize, mean: &Features, out: &mut Vec<PathNode>) {
    out.clear();
    let weight = 1.0 / k as f64;
    let listed = matches!(motion.image_path, Some(PixelPath::Samples(_)));
    let node = |tau: f64| PathNode { weight, phi: motion.features_at(tau) };
    if listed || k % 2 == 1 {
        out.extend((0..k).map(|i| node((i as f64 + 0.5) * weight - 0.5)));
    } else {
        let taus = (0..k / 2).flat_map(|panel| pair().map(|at| 2.0 * (panel as f64 + at) * weight - 0.5));
        out.extend(taus.map(node));
    }
    recentre(out, mean);
}

/// `n` Gauss-Legendre nodes in time (smooth motion only: jitter between nodes would be missed).
pub fn gauss_legendre_in_time(motion: &Motion, n: usize, out: &mut Vec<PathNode>) {
    out.clear();
    out.extend((0..n).map(|i| {
        let node = gauss_legendre_node(n, i);
        PathNode { weight: node.weight, phi: motion.features_at(node.x) }
    }));
}

/// One node at the mean of the path.
pub fn single(mean: &Features, out: &mut Vec<PathNode>) {
    out.clear();
    out.push(PathNode { weight: 1.0, phi: *mean });
}

/// The list the planner measures other lists against. `reach_px`: length of the jittered path on the detector,
/// `radius_px`: furthest star from the principal point.
pub fn dense(motion: &Motion, sigma_px: f64, reach_px: f64, radius_px: f64, out: &mut Vec<PathNode>) {
    out.clear();
    let step_px = DENSE_STEP_SIGMA * sigma_px;
    let exposure_s = motion.los.exposure_s;
    match &motion.image_path {
        None => {
            let by_period = motion.los.jitter.highest_line_hz() * exposure_s * DENSE_PER_PERIOD;
            let by_samples = 4.0 * motion.los.jitter.points.len() as f64;
            let wanted = (reach_px / step_px).max(by_period).max(by_samples);
            let panels = clamped(0.5 * wanted, 8, MOST_DENSE_NODES / 2) as f64;
            // Panels end at the samples: the track has corners there.
            let (mut from, mid) = (-0.5, motion.los.mid_exposure());
            let corners = motion.los.jitter.points.iter().map(|point| (point.at - mid).s() / exposure_s);
            for to in corners.chain([0.5]) {
                let to = to.clamp(from, 0.5);
                let share = to - from;
                if share > 0.0 {
                    let count = clamped(panels * share, 1, MOST_DENSE_NODES / 2);
                    let step = share / count as f64;
                    let taus = (0..count).flat_map(|panel| pair().map(|at| from + (panel as f64 + at) * step));
                    out.extend(taus.map(|tau| PathNode { weight: 0.5 * step, phi: motion.features_at(tau) }));
                }
                from = to;
            }
        }
        Some(PixelPath::Samples(points)) => {
            let weight = 1.0 / points.len() as f64;
            out.extend(points.iter().enumerate().map(|(i, point)| {
                let tau = (i as f64 + 0.5) * weight - 0.5;
                PathNode { weight, phi: features(tau, point.shared()) }
            }));
        }
        Some(PixelPath::Line(points)) => along_line(points, exposure_s, step_px, radius_px, out),
    }
}

/// The two Gauss-Legendre nodes of a piece, as shares of it.
fn pair() -> [f64; 2] {
    const OFF: f64 = 0.288_675_134_594_812_9; // 1 / (2 sqrt 3)
    [0.5 - OFF, 0.5 + OFF]
}

/// Node pairs of short pieces of every segment, weighted by their time.
fn along_line(points: &[PixelPoint], exposure_s: f64, step_px: f64, radius_px: f64, out: &mut Vec<PathNode>) {
    for_each_segment(points, exposure_s, |a, b| {
        let left = (MOST_PATH_NODES.saturating_sub(out.len()) / 2).max(1);
        let pieces = clamped(0.5 * a.distance_px(b, radius_px) / step_px, 1, left);
        let weight = 0.5 * (b.t_s - a.t_s) / exposure_s / pieces as f64;
        for share in (0..pieces).flat_map(|piece| pair().map(|at| (piece as f64 + at) / pieces as f64)) {
            let point = a.towards(b, share);
            out.push(PathNode { weight, phi: features(point.t_s / exposure_s - 0.5, point.shared()) });
        }
    });
}

/// Calls `visit(from, to)` for every stretch of an exposure with positive duration, the held ends included.
pub fn for_each_segment(points: &[PixelPoint], exposure_s: f64, mut visit: impl FnMut(&PixelPoint, &PixelPoint)) {
    let (Some(first), Some(last)) = (points.first(), points.last()) else { return };
    let start = PixelPoint { t_s: 0.0, ..*first };
    let end = PixelPoint { t_s: exposure_s, ..*last };
    let mut from = start;
    for to in points.iter().chain([&end]) {
        let to = PixelPoint { t_s: to.t_s.clamp(0.0, exposure_s), ..*to };
        if to.t_s > from.t_s {
            visit(&from, &to);
        }
        from = to;
    }
}

fn recentre(nodes: &mut [PathNode], mean: &Features) {
    let mut off: Features = *mean;
    for node in nodes.iter() {
        for i in 0..FEATURES {
            off[i] -= node.weight * node.phi[i];
        }
    }
    for node in nodes {
        for i in 0..FEATURES {
            node.phi[i] += off[i];
        }
    }
}

#[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to usize bounds first")]
fn clamped(wanted: f64, least: usize, most: usize) -> usize {
    wanted.ceil().clamp(least as f64, most.max(least) as f64) as usize
}
