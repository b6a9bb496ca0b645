//! Error of a method's node list relative to the true paths of the probes, before any pixel is drawn.
//!
//! In: node lists, probes. Out: bounds of the centroid error (px) and of the pixel error (of the star's peak). Each
//! star is drawn about its own exact mean, so the lists only have errors in the shape of the path: moments show them
//! for short paths, characteristic functions for long ones.

use crate::exposure::moments::{Moments, NOTHING, Sensitivity, Spectrum, TracePoint, trace};
use crate::exposure::probes::{Probe, Probes, SIDE};
use crate::exposure::shape_change::{NodeError, ShapeChange};
use crate::exposure::track::{StarPlace, StarTrack};
use crate::exposure::{line::DENSE_RESERVED, pose::PathNode};
use sky::astrometry::CameraGeometry;

/// Side of the window in which a tracker measures, px.
pub const WINDOW_PX: f64 = 5.0;

/// Steps of a node's share of a characteristic function.
const SPECTRUM_STEPS: usize = 2;
/// Traces that differ by less are the same, px.
const SAME_PX: f64 = 1e-9;
/// Nodes may lie this far outside the path that the probes follow, px.
const EXTENT_MARGIN_PX: f64 = 0.25;

/// Origin of the shape in which a list is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ShapeOf {
    /// The shape of each star's own path.
    EachStar,
    /// The shape of each star's own path, with the whole of a lens's distortion.
    EachStarExactly,
    /// The shape for a star at the detector's centre.
    Centre,
}

/// Weighs lists; keeps its buffers.
#[derive(Debug)]
pub struct Scales {
    sensitivity: Sensitivity,
    change: ShapeChange,
    sigma_px: f64,
    scratch: [Vec<TracePoint>; 2],
    watched: [(usize, Spectrum); 2],
    /// Steps since the probes are watched (see `cost`).
    pub(super) steps: usize,
}

impl Scales {
    /// Returns scales for a PSF with a core of `sigma_px`.
    pub fn new(sigma_px: f64) -> Self {
        Self {
            sensitivity: Sensitivity::new(sigma_px),
            change: ShapeChange::new(sigma_px),
            sigma_px,
            scratch: [(); 2].map(|()| Vec::with_capacity(DENSE_RESERVED)),
            watched: [(0, NOTHING); 2],
            steps: 0,
        }
    }

    /// Stores the true characteristic functions of the centre and the widest probe.
    pub fn watch(&mut self, probes: &Probes) {
        let (centre, widest) = (probes.centre_index(), probes.widest_index());
        self.steps = 2 * SPECTRUM_STEPS * probes.dense().len();
        for (watched, i) in self.watched.iter_mut().zip([centre, widest]) {
            let truth = probes.probes.get(i).map_or(NOTHING, |probe| self.sensitivity.spectrum(&probe.trace));
            *watched = (i, truth);
        }
    }

    /// Returns the largest error of `lists` (one per row of probes, or one for all) over all probes.
    pub fn error(&mut self, lists: &[Vec<PathNode>], shape: ShapeOf, probes: &Probes) -> NodeError {
        let mut worst = NodeError::default();
        let centre_track = probes.centre().map(|probe| probe.track);
        for (i, probe) in probes.probes.iter().enumerate() {
            let Some(nodes) = lists.get((i / SIDE).min(lists.len() - 1)) else { continue };
            let drawn = &mut self.scratch[0];
            match (shape, &centre_track) {
                (ShapeOf::Centre, Some(centre)) => exact_trace(&probes.camera, centre, nodes, drawn),
                (ShapeOf::EachStarExactly, _) => exact_trace(&probes.camera, &probe.track, nodes, drawn),
                (ShapeOf::Centre | ShapeOf::EachStar, _) => {
                    let points = nodes.iter().map(|node| point(node, probe.track.displacement_px(&node.pose)));
                    trace(points, drawn);
                }
            }
            self.steps += nodes.len();
            worst = worst.worst(self.moment_error(&Moments::of(&self.scratch[0]), &probe.moments));
            if let Some((_, truth)) = self.watched.iter().find(|(watched, _)| *watched == i) {
                self.steps += SPECTRUM_STEPS * nodes.len();
                let spectrum = self.sensitivity.spectrum(&self.scratch[0]);
                worst = worst.worst(self.spectrum_error(&spectrum, truth, probes));
            }
        }
        worst
    }

    /// Returns the error of one kernel for all stars, drawn at the nodes of `lists`: that of the nodes themselves, and that
    /// of the centre's path in place of each star's own.
    pub fn kernel_error(&mut self, lists: &[Vec<PathNode>], probes: &Probes) -> NodeError {
        let Some(change) = self.change_error(lists, probes) else { return UNKNOWN };
        self.error(lists, ShapeOf::EachStarExactly, probes).plus(change)
    }

    /// Returns the largest error of drawing the path of a star at the detector's centre in place of each probe's own, at
    /// the same nodes (`lists`: one per row of probes, or one for all); `None` if that is too much work.
    fn change_error(&mut self, lists: &[Vec<PathNode>], probes: &Probes) -> Option<NodeError> {
        let centre = probes.centre()?.track;
        let most = lists.iter().map(Vec::len).max()?;
        let mut worst = NodeError::default();
        let mut kept = None;
        for (i, probe) in probes.probes.iter().enumerate() {
            let row = (i / SIDE).min(lists.len() - 1);
            let nodes = lists.get(row)?;
            let [drawn, own] = &mut self.scratch;
            if kept != Some(row) {
                exact_trace(&probes.camera, &centre, nodes, drawn);
            }
            exact_trace(&probes.camera, &probe.track, nodes, own);
            let apart = |([_, ax, ay], [_, bx, by]): (&TracePoint, &TracePoint)| (ax - bx).abs().max((ay - by).abs());
            if drawn.iter().zip(&*own).map(apart).fold(0.0, f64::max) < SAME_PX {
                continue;
            }
            if kept != Some(row) {
                if !self.change.size(most, probes.extent_px + EXTENT_MARGIN_PX) {
                    return None;
                }
                self.change.keep(drawn);
                kept = Some(row);
            }
            worst = worst.worst(self.change.error(own));
            self.steps += self.change.steps(nodes.len());
        }
        Some(worst)
    }

    /// Returns the largest error of drawing stars in a cell of `size_px` about `probe` (moved inside the detector) with
    /// a blend of the paths at its corners: at the cell's middle and the middles of its sides, where it is largest. If
    /// the PSF varies over the cell too, a blend of products is not the product of blends: they differ by the
    /// covariance of both over the cell, at most the difference of the corners' paths from the middle's (`psf_varies`).
    pub fn cell_error(
        &mut self,
        nodes: &[PathNode],
        probe: &Probe,
        size_px: [f64; 2],
        psf_varies: bool,
        probes: &Probes,
    ) -> NodeError {
        let camera = &probes.camera;
        let last = [camera.width_px(), camera.height_px()].map(|side| side as f64 - 0.5);
        let origin: [f64; 2] = core::array::from_fn(|i| {
            let most = (last[i] - size_px[i]).max(-0.5);
            (probe.track.place.mid_px[i] - 0.5 * size_px[i]).clamp(-0.5, most)
        });
        let mut corners = [(Moments::default(), NOTHING); 4];
        for (i, corner) in corners.iter_mut().enumerate() {
            let px = [origin[0] + size_px[0] * (i % 2) as f64, origin[1] + size_px[1] * (i / 2) as f64];
            let Some(shape) = self.shape_at(camera, px, nodes) else { return UNKNOWN };
            *corner = shape;
        }
        let mut worst = NodeError::default();
        for [x, y] in [[0.5, 0.5], [0.5, 0.0], [0.0, 0.5]] {
            let shares = [(1.0 - x) * (1.0 - y), x * (1.0 - y), (1.0 - x) * y, x * y];
            let px = [origin[0] + size_px[0] * x, origin[1] + size_px[1] * y];
            let Some((moments, spectrum)) = self.shape_at(camera, px, nodes) else { return UNKNOWN };
            let mut drawn = (Moments::default(), NOTHING);
            for (share, corner) in shares.iter().zip(&corners) {
                drawn.0.add(*share, &corner.0);
                add_spectrum(&mut drawn.1, *share, &corner.1);
            }
            let by_moments = self.moment_error(&drawn.0, &moments);
            let mut error = by_moments.worst(self.spectrum_error(&drawn.1, &spectrum, probes));
            if psf_varies {
                let from_middle = corners.iter().map(|corner| {
                    let by_moments = self.moment_error(&corner.0, &moments);
                    by_moments.worst(self.spectrum_error(&corner.1, &spectrum, probes))
                });
                error = error.plus(from_middle.fold(NodeError::default(), NodeError::worst));
            }
            worst = worst.worst(error);
        }
        worst
    }

    fn shape_at(&mut self, camera: &CameraGeometry, px: [f64; 2], nodes: &[PathNode]) -> Option<(Moments, Spectrum)> {
        let place = StarPlace::of_pixel(camera, px)?;
        self.steps += (1 + SPECTRUM_STEPS) * nodes.len();
        exact_trace(camera, &StarTrack::new(camera, place), nodes, &mut self.scratch[1]);
        Some((Moments::of(&self.scratch[1]), self.sensitivity.spectrum(&self.scratch[1])))
    }

    fn moment_error(&self, drawn: &Moments, truth: &Moments) -> NodeError {
        NodeError {
            centroid_px: drawn.centroid_error_px(truth, self.sigma_px),
            peak: drawn.peak_error(truth, self.sigma_px),
        }
    }

    fn spectrum_error(&self, drawn: &Spectrum, truth: &Spectrum, probes: &Probes) -> NodeError {
        let (moment, peak) = self.sensitivity.error(drawn, truth);
        NodeError { centroid_px: moment / light_share(WINDOW_PX, probes), peak }
    }
}

/// Adds `share * other` to `sum`.
fn add_spectrum(sum: &mut Spectrum, share: f64, other: &Spectrum) {
    for (sum, other) in sum.iter_mut().flatten().zip(other.iter().flatten()) {
        sum[0] += share * other[0];
        sum[1] += share * other[1];
    }
}

/// Error of an unknown motion, for which no bound can be given.
const UNKNOWN: NodeError = NodeError { centroid_px: f64::INFINITY, peak: f64::INFINITY };

/// Returns the smallest share of a star's light in the brightest square of `side_px`: along the path's length, or all
/// over the square that contains the path.
pub fn light_share(side_px: f64, probes: &Probes) -> f64 {
    let along = side_px / (side_px + probes.reach_px);
    let square = (side_px / (side_px + 2.0 * probes.extent_px)).powi(2);
    along.max(square)
}

fn point(node: &PathNode, [x, y]: [f64; 2]) -> TracePoint {
    [node.weight, x, y]
}

fn exact_trace(camera: &CameraGeometry, track: &StarTrack, nodes: &[PathNode], out: &mut Vec<TracePoint>) {
    trace(nodes.iter().map(|node| point(node, track.exact_px(camera, &node.pose))), out);
}

/// Returns the bound of the shear of a star's image by a rolling shutter within its own footprint, which no method
/// draws: a path of `speed_px_s` moves by `speed_px_s * line_s` from row to row, and covariance with the rows is
/// `sigma^2` times that.
pub fn shear_error(speed_px_s: f64, line_s: f64, sigma_px: f64) -> NodeError {
    let per_row = speed_px_s * line_s;
    let sheared = Moments {
        covariance_px2: [0.0, per_row * sigma_px * sigma_px, per_row * sigma_px * sigma_px],
        third_px3: [0.0; 2],
    };
    let straight = Moments::default();
    NodeError {
        centroid_px: sheared.centroid_error_px(&straight, sigma_px) + per_row * sigma_px,
        peak: sheared.peak_error(&straight, sigma_px),
    }
}

/// Returns the bound of the relative flux error of a star that moves along the rows of a rolling shutter: its light is
/// multiplied by `1 / (1 - v)`, `v = speed_px_s * line_s`, for its mean velocity; the remaining error is of second
/// order where the velocity changes, the S-curve of an undersampled star, `2 exp(-2 pi^2 sigma^2) v`, and a share of
/// `v` where the path is not smooth (largest measured: 0.1).
pub fn stretch_error(speed_px_s: f64, line_s: f64, sigma_px: f64, is_smooth: bool) -> f64 {
    const ROUGH: f64 = 0.25;
    let per_row = speed_px_s * line_s;
    let s_curve = 2.0 * (-2.0 * (core::f64::consts::PI * sigma_px).powi(2)).exp();
    let rough = if is_smooth { 0.0 } else { ROUGH };
    per_row * (rough + s_curve + 2.0 * per_row)
}
