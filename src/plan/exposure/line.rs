//! A commanded path in time -> dense nodes: every straight segment in pairs, many short segments together in one pair.
//!
//! A table of 20,001 rows has far more corners than a star's image can show. Consecutive segments that together are no
//! longer than a piece of a long one (a fifth of the PSF's sigma) are merged: the pair has their mean exactly, and
//! their covariance as far as they lead straight from their first point to their last. What the covariance lacks is
//! summed up and returned: the planner adds it to its errors. Tests below.
//!
//! *Dense.* The dense list of path nodes that serves as truth: other lists are compared with it. `delay_s` is the delay
//! of the rows after the frame's exposure.

use crate::exposure::nodes::{clamped, pair};
use crate::exposure::pose::{PixelPath, PixelPoint};
use crate::exposure::{motion::Motion, pose::PathNode};

/// Largest number of dense nodes of a commanded image path.
pub const MOST_PATH_NODES: usize = 1 << 18;

/// Rows of a path that were merged.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Merged {
    /// Bound of the error of the covariance of the path, px^2.
    pub covariance_px2: f64,
    /// Length of the path through all rows, and through the ends of what was merged, px.
    pub length_px: [f64; 2],
}

/// Several segments, one after the other.
#[derive(Debug, Clone, Copy)]
struct Piece {
    first: PixelPoint,
    last: PixelPoint,
    segments: usize,
    /// Bound of its length for any star, and the length of its shift, px.
    length_px: f64,
    shift_px: f64,
    /// Sums over time of place and its products, from the first point, px s and px^2 s; of the roll, rad s.
    sums: [f64; 3],
    squares: [f64; 3],
}

/// Appends node pairs of short pieces of the path, weighted by their time, and the end of each to `ends_s`; returns what
/// was merged. Pieces are two `step_px` long; `radius_px`: furthest star from the principal point.
pub(super) fn along(
    motion: &Motion,
    points: &[PixelPoint],
    [step_px, radius_px]: [f64; 2],
    delay_s: f64,
    ends_s: &mut Vec<f64>,
    out: &mut Vec<PathNode>,
) -> Merged {
    let exposure_s = motion.los.exposure_s;
    let (first, most_px) = (out.len(), 2.0 * step_px);
    let mut merged = Merged::default();
    let mut piece: Option<Piece> = None;
    let mut flush = |piece: &Piece| {
        ends_s.push(piece.last.t_s);
        piece.append(motion, step_px, first, &mut merged, out);
    };
    for_each_segment(points, exposure_s, delay_s, |a, b| {
        let next = Piece::of(a, b, radius_px);
        match &mut piece {
            Some(piece) if piece.length_px + next.length_px <= most_px => piece.add(&next),
            held @ (Some(_) | None) => {
                if let Some(done) = held.replace(next) {
                    flush(&done);
                }
            }
        }
    });
    if let Some(last) = &piece {
        flush(last);
    }
    merged
}

impl Piece {
    /// Returns one straight segment.
    fn of(a: &PixelPoint, b: &PixelPoint, radius_px: f64) -> Self {
        let time_s = b.t_s - a.t_s;
        let step = [b.dx_px - a.dx_px, b.dy_px - a.dy_px];
        let third = time_s / 3.0;
        Self {
            first: *a,
            last: *b,
            segments: 1,
            length_px: a.distance_px(b, radius_px),
            shift_px: (step[0] * step[0] + step[1] * step[1]).sqrt(),
            sums: [step[0], step[1], b.roll_rad - a.roll_rad].map(|v| 0.5 * time_s * v),
            squares: [step[0] * step[0], step[0] * step[1], step[1] * step[1]].map(|v| third * v),
        }
    }

    /// Adds the segment that follows.
    fn add(&mut self, next: &Self) {
        let time_s = next.last.t_s - next.first.t_s;
        let from = [
            next.first.dx_px - self.first.dx_px,
            next.first.dy_px - self.first.dy_px,
            next.first.roll_rad - self.first.roll_rad,
        ];
        let [x, y] = [0, 1].map(|i| next.sums[i] + 0.5 * time_s * from[i]);
        self.squares[0] += next.squares[0] + 2.0 * from[0] * x;
        self.squares[1] += next.squares[1] + from[0] * y + from[1] * x;
        self.squares[2] += next.squares[2] + 2.0 * from[1] * y;
        for ((sum, from), next) in self.sums.iter_mut().zip(from).zip(next.sums) {
            *sum += next + time_s * from;
        }
        self.last = next.last;
        self.segments += 1;
        self.length_px += next.length_px;
        self.shift_px += next.shift_px;
    }

    /// Appends the piece's nodes.
    fn append(&self, motion: &Motion, step_px: f64, first: usize, merged: &mut Merged, out: &mut Vec<PathNode>) {
        let (exposure_s, time_s) = (motion.los.exposure_s, self.last.t_s - self.first.t_s);
        let step = [self.last.dx_px - self.first.dx_px, self.last.dy_px - self.first.dy_px];
        merged.length_px[0] += self.shift_px;
        merged.length_px[1] += step[0].hypot(step[1]);
        let left = (MOST_PATH_NODES.saturating_sub(out.len() - first) / 2).max(1);
        let mut push = |weight: f64, point: &PixelPoint| {
            out.push(PathNode { weight, pose: motion.pose_on_path(point.t_s - 0.5 * exposure_s, point) });
        };
        if self.segments == 1 {
            let pieces = clamped(0.5 * self.length_px / step_px, 1, left);
            let weight = 0.5 * time_s / exposure_s / pieces as f64;
            for share in (0..pieces).flat_map(|piece| pair().map(|at| (piece as f64 + at) / pieces as f64)) {
                push(weight, &self.first.towards(&self.last, share));
            }
            return;
        }
        let [x, y, roll] = self.sums.map(|sum| sum / time_s);
        let lacks = [
            self.squares[0] / time_s - x * x - step[0] * step[0] / 12.0,
            self.squares[1] / time_s - x * y - step[0] * step[1] / 12.0,
            self.squares[2] / time_s - y * y - step[1] * step[1] / 12.0,
        ];
        let [xx, xy, yy] = lacks;
        merged.covariance_px2 += time_s / exposure_s * (xx * xx + 2.0 * xy * xy + yy * yy).sqrt();
        for share in pair() {
            // The pair lies about the mean, along the line from the first point to the last.
            let off = share - 0.5;
            let point = PixelPoint {
                t_s: self.first.t_s + share * time_s,
                dx_px: self.first.dx_px + x + off * step[0],
                dy_px: self.first.dy_px + y + off * step[1],
                roll_rad: self.first.roll_rad + roll + off * (self.last.roll_rad - self.first.roll_rad),
            };
            push(0.5 * time_s / exposure_s, &point);
        }
    }
}

/// Calls `visit(from, to)` for every stretch with positive duration of an exposure that is `delay_s` late, including
/// the constant ends; times count from the start of the frame's own exposure.
pub fn for_each_segment(
    points: &[PixelPoint],
    exposure_s: f64,
    delay_s: f64,
    mut visit: impl FnMut(&PixelPoint, &PixelPoint),
) {
    let (Some(first), Some(last)) = (points.first(), points.last()) else { return };
    let (begin_s, end_s) = (delay_s, delay_s + exposure_s);
    let ends = [PixelPoint { t_s: begin_s.min(first.t_s), ..*first }, PixelPoint { t_s: end_s.max(last.t_s), ..*last }];
    let mut from = ends[0];
    for to in points.iter().chain([&ends[1]]) {
        let (a, b) = (from.t_s.max(begin_s), to.t_s.min(end_s));
        if b > a {
            if a == from.t_s && b == to.t_s {
                visit(&from, to);
            } else {
                let at = |t_s: f64| PixelPoint { t_s, ..from.towards(to, (t_s - from.t_s) / (to.t_s - from.t_s)) };
                visit(&at(a), &at(b));
            }
        }
        from = *to;
    }
}

/// Mean distance of dense nodes, share of the PSF's sigma. They come in Gauss-Legendre pairs: variance along a straight
/// piece is exact, and the characteristic function errs by `(k h)^4 / 270`.
const DENSE_STEP_SIGMA: f64 = 0.1;
/// Dense nodes per period of the fastest jitter line.
const DENSE_PER_PERIOD: f64 = 24.0;
/// Largest number of dense nodes of a path with jitter, when they are even.
pub const MOST_DENSE_NODES: usize = 4096;
/// Capacity of buffers for dense nodes: every stretch between two jitter samples may have a pair more.
pub const DENSE_RESERVED: usize = 2 * MOST_DENSE_NODES;

/// Appends the list with which the planner compares other lists; returns the rows that it merged. `reach_px`: length of
/// the jittered path on the detector, `radius_px`: furthest star from the principal point. `ends_s` gets the ends of a
/// path's stretches, in seconds since the exposure started.
pub fn append(
    motion: &Motion,
    sigma_px: f64,
    [reach_px, radius_px]: [f64; 2],
    delay_s: f64,
    ends_s: &mut Vec<f64>,
    out: &mut Vec<PathNode>,
) -> Merged {
    let step_px = DENSE_STEP_SIGMA * sigma_px;
    let exposure_s = motion.los.exposure_s;
    match &motion.image_path {
        None => {
            let by_period = motion.los.jitter.highest_line_hz() * exposure_s * DENSE_PER_PERIOD;
            let by_samples = 4.0 * motion.los.jitter.points.len() as f64;
            let wanted = (reach_px / step_px).max(by_period).max(by_samples);
            let panels = clamped(0.5 * wanted, 8, MOST_DENSE_NODES / 2) as f64;
            // Panels end at the samples, where the track has corners.
            for (from, share) in motion.stretches(delay_s) {
                let count = clamped(panels * share, 1, MOST_DENSE_NODES / 2);
                let step = share / count as f64;
                let taus = (0..count).flat_map(|panel| pair().map(|at| from + (panel as f64 + at) * step));
                out.extend(taus.map(|tau| PathNode { weight: 0.5 * step, pose: motion.pose_at(tau, delay_s) }));
            }
        }
        Some(PixelPath::Samples(points)) => {
            let weight = 1.0 / points.len() as f64;
            out.extend(points.iter().enumerate().map(|(i, point)| {
                let t_s = ((i as f64 + 0.5) * weight - 0.5) * exposure_s + delay_s;
                PathNode { weight, pose: motion.pose_on_path(t_s, point) }
            }));
        }
        Some(PixelPath::Line(points)) => {
            return along(motion, points, [step_px, radius_px], delay_s, ends_s, out);
        }
    }
    Merged::default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::LosPath;
    use crate::exposure::moments::{Moments, trace};
    use crate::exposure::pose::{PixelPath, SHIFT};
    use base::{axes::Rotation, time::Tai};

    const EXPOSURE_S: f64 = 0.1;
    const STEP_PX: f64 = 0.08;

    fn motion(points: Vec<PixelPoint>) -> Motion {
        let los = LosPath::commanded(Rotation::IDENTITY, Tai::from_ns(0), EXPOSURE_S);
        Motion { los, image_path: Some(PixelPath::line(points, EXPOSURE_S).unwrap()) }
    }

    /// Returns a smooth path of so many rows, with a zigzag of `rough_px` from row to row.
    fn path(rows: u32, rough_px: f64) -> Vec<PixelPoint> {
        let row = |i: u32| {
            let share = f64::from(i) / f64::from(rows - 1);
            let [x, y] = [7.3, 4.1].map(|turns| (core::f64::consts::TAU * turns * share).sin());
            let off = if i.is_multiple_of(2) { rough_px } else { -rough_px };
            PixelPoint { t_s: share * EXPOSURE_S, dx_px: x + off, dy_px: 0.7 * y - off, roll_rad: 0.0 }
        };
        (0..rows).map(row).collect()
    }

    /// Returns nodes, mean, moments and merged rows of a path in pieces of two `step_px`.
    fn measured(points: &[PixelPoint], step_px: f64) -> (usize, [f64; 2], Moments, Merged) {
        let (mut ends_s, mut nodes, mut traced) = (Vec::new(), Vec::new(), Vec::new());
        let merged = along(&motion(points.to_vec()), points, [step_px, 700.0], 0.0, &mut ends_s, &mut nodes);
        let at = |node: &PathNode| [node.weight, node.pose.0[SHIFT], node.pose.0[SHIFT + 1]];
        let mean = trace(nodes.iter().map(at), &mut traced);
        assert!((ends_s.last().unwrap() - EXPOSURE_S).abs() < 1e-12 && ends_s.is_sorted());
        (nodes.len(), mean, Moments::of(&traced), merged)
    }

    #[test]
    fn merged_rows_keep_mean_and_covariance() {
        for rough_px in [0.0, 0.01] {
            let points = path(20_001, rough_px);
            let (count, mean, moments, merged) = measured(&points, STEP_PX);
            // Pieces shorter than any segment merge nothing.
            let (all, true_mean, truth, none) = measured(&points, 1e-6);
            assert!(all >= 40_000 && none.covariance_px2 == 0.0, "control: {all} nodes");
            assert!(count < all / 4, "{count} of {all} nodes");
            let apart = (mean[0] - true_mean[0]).hypot(mean[1] - true_mean[1]);
            assert!(apart < 1e-9, "means {apart:e} px apart");
            let lacks = moments.covariance_difference(&truth);
            assert!(lacks <= merged.covariance_px2 + 1e-9, "{lacks:e} px^2, bound {:e}", merged.covariance_px2);
            let [whole, short] = merged.length_px;
            let wanted: f64 = points.windows(2).map(|p| (p[1].dx_px - p[0].dx_px).hypot(p[1].dy_px - p[0].dy_px)).sum();
            assert!((whole / wanted - 1.0).abs() < 1e-9 && short <= whole, "{whole} {short} {wanted}");
        }
    }

    #[test]
    fn long_segments_are_not_merged() {
        let (count, _, _, merged) = measured(&path(11, 0.0), STEP_PX);
        let (finer, ..) = measured(&path(11, 0.0), 0.5 * STEP_PX);
        assert!(merged.covariance_px2 == 0.0 && finer > 19 * count / 10, "{count} {finer}");
    }
}
