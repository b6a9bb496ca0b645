//! Share of a star's light that lands on the detector, which the truth table lists as electrons.
//!
//! Inside the detector: the footprint's share. Across an edge: the mean over the path nodes of the share inside.
//! Gaussian: exact products of error functions, within the footprint. Round PSFs: products of the line-spread
//! function's integral, exact at one edge; at a corner the error is the non-separable part of the PSF (Airy: < 3e-3 of
//! the star; zero for a star on the corner). A grid uses the sums of its own samples, separately for each side.

use crate::exposure::pose::{PathNode, mean_pose};
use crate::exposure::{source::PlannedStar, track::StarTrack};
use crate::optics::{PsfField, PsfForm, PsfGrid, PsfModel};
use sky::astrometry::CameraGeometry;
use std::sync::Arc;

/// Step of the sums of a grid, px; half a pixel is a whole number of them.
const GRID_STEP: f64 = 1.0 / 128.0;
/// Number of such steps in half a pixel.
const HALF_PIXEL: usize = 64;
/// Step for a Gaussian, sigma: linear interpolation has an error of `step^2 / 8` of 0.24, 3e-7.
const GAUSSIAN_STEP: f64 = 1.0 / 320.0;

/// Light shares on one detector.
#[derive(Debug, Clone, PartialEq)]
pub struct Share {
    /// Shares of the PSF, or of those at the nodes of its field.
    nodes: Vec<NodeShare>,
    /// Light in a whole footprint over that in an ordinary one, by node.
    whole_gains: Vec<f64>,
    field: Option<Arc<PsfField>>,
}

impl Share {
    /// Returns shares for a PSF drawn in footprints of `half_px`, or of `whole_px` for whole stars, on a detector of
    /// `size_px`.
    pub fn new(psf: &PsfModel, [half_px, whole_px]: [usize; 2], size_px: [usize; 2]) -> Self {
        let nodes = psf.nodes().iter().map(|psf| NodeShare::new(psf, half_px, size_px)).collect();
        let gain = |psf: &PsfModel| within(psf, whole_px) / within(psf, half_px);
        let whole_gains = psf.nodes().iter().map(gain).collect();
        Self { nodes, whole_gains, field: psf.as_field().cloned() }
    }

    /// Returns by how much more light of `star` lies in a whole footprint than in an ordinary one.
    pub fn whole_gain(&self, star: &PlannedStar) -> f64 {
        let gain = |node: usize| self.whole_gains.get(node).copied().unwrap_or(1.0);
        self.field.as_ref().map_or_else(
            || gain(0),
            |field| field.around(star.mean_px).into_iter().map(|(node, share)| share * gain(node)).sum(),
        )
    }

    /// Returns where no edge takes light of a star whose path reaches `extent_px`; `None` for a field of PSFs.
    pub fn clear_of_edges(&self, extent_px: f64) -> Option<Clear> {
        self.only_node().map(|node| node.clear_of_edges(extent_px))
    }

    /// Returns the shares of stars that do not move; `None` for a field of PSFs.
    pub fn of_still(&self) -> Option<Still<'_>> {
        self.only_node().map(|node| Still { clear: node.clear_of_edges(0.0), node })
    }

    fn only_node(&self) -> Option<&NodeShare> {
        self.nodes.first().filter(|_| self.field.is_none())
    }

    /// Returns the share of `star`'s electrons on the detector.
    pub fn on_detector(&self, star: &PlannedStar, camera: &CameraGeometry, nodes: &[PathNode], extent_px: f64) -> f64 {
        let on = |node: usize| self.nodes[node].on_detector(star, camera, nodes, extent_px);
        match &self.field {
            None => on(0),
            Some(field) => {
                let around = field.around(star.mean_px).into_iter().filter(|(_, share)| *share > 0.0);
                around.map(|(node, share)| share * on(node)).sum()
            }
        }
    }
}

/// The places of stars whose footprints no edge cuts, and the share of their light on the detector.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Clear {
    /// By axis, the first place and the last.
    limits_px: [[f64; 2]; 2],
    light: f64,
}

impl Clear {
    /// Returns the share of the light of a star at `px`; `None` near an edge.
    #[inline]
    pub fn light_at(&self, px: [f64; 2]) -> Option<f64> {
        (self.axes(px) == [true; 2]).then_some(self.light)
    }

    /// Returns by axis whether no edge cuts the footprint of a star at `px`.
    #[inline]
    fn axes(&self, px: [f64; 2]) -> [bool; 2] {
        [0, 1].map(|axis| px[axis] >= self.limits_px[axis][0] && px[axis] <= self.limits_px[axis][1])
    }
}

/// Light shares of stars that do not move.
#[derive(Debug, Clone, Copy)]
pub struct Still<'a> {
    clear: Clear,
    node: &'a NodeShare,
}

impl Still<'_> {
    /// Returns the share of the light of a star at `px` that lands on the detector.
    #[inline]
    pub fn at(&self, px: [f64; 2]) -> f64 {
        let near_edge = || self.node.footprint * (self.node.along(0, px[0]) * self.node.along(1, px[1]));
        self.clear.light_at(px).unwrap_or_else(near_edge)
    }
}

/// Light shares of one PSF on one detector.
#[derive(Debug, Clone, PartialEq)]
struct NodeShare {
    half_px: usize,
    size_px: [usize; 2],
    footprint: f64,
    /// By axis, before and after the star: share of the light within a distance, every `step_px` from 0.
    lines: [[Vec<f64>; 2]; 2],
    step_px: f64,
}

impl NodeShare {
    fn new(psf: &PsfModel, half_px: usize, size_px: [usize; 2]) -> Self {
        let round = |footprint, line: Vec<f64>, step_px| {
            let sides = || [line.clone(), line.clone()];
            Self { half_px, size_px, footprint, lines: [sides(), sides()], step_px }
        };
        let footprint = || square_sum(half_px, |x, y| psf.pixel(x, y));
        match psf.form() {
            PsfForm::Gaussian(sigma_px) => {
                let within = gaussian_within(half_px as f64 + 0.5, sigma_px);
                round(within * within, gaussian_line(half_px, sigma_px), GAUSSIAN_STEP * sigma_px)
            }
            PsfForm::Round(psf) => {
                let step_px = psf.line_step_px();
                round(footprint(), line_integral(|r_px| psf.irradiance(r_px), half_px, step_px), step_px)
            }
            PsfForm::Grid(grid) => {
                let (footprint, lines) = grid_lines(grid, half_px);
                Self { half_px, size_px, footprint, lines, step_px: GRID_STEP }
            }
            // A field has one for every node.
            PsfForm::Field(_) => round(0.0, vec![0.0; 2], 1.0),
        }
    }

    fn clear_of_edges(&self, extent_px: f64) -> Clear {
        let margin = self.half_px as f64 + 1.0 + extent_px;
        Clear { limits_px: self.size_px.map(|size| [margin, size as f64 - 1.0 - margin]), light: self.footprint }
    }

    fn on_detector(&self, star: &PlannedStar, camera: &CameraGeometry, nodes: &[PathNode], extent_px: f64) -> f64 {
        let clear = self.clear_of_edges(extent_px).axes(star.mean_px);
        if clear == [true; 2] {
            return self.footprint;
        }
        self.footprint * self.at_edge(star, &StarTrack::new(camera, star.place), nodes, clear)
    }

    /// Returns the mean over all nodes; only nodes with a footprint across an edge need the integral, and no axis with
    /// `clear` edges.
    fn at_edge(&self, star: &PlannedStar, track: &StarTrack, nodes: &[PathNode], clear: [bool; 2]) -> f64 {
        let [mx, my] = track.displacement_px(&mean_pose(nodes));
        let [x, y] = [star.mean_px[0] - mx, star.mean_px[1] - my];
        let on = |node: &PathNode| {
            let [dx, dy] = track.displacement_px(&node.pose);
            let along = |axis: usize, v: f64| if clear[axis] { 1.0 } else { self.along(axis, v) };
            along(0, x + dx) * along(1, y + dy)
        };
        nodes.iter().map(|node| node.weight * on(node)).sum()
    }

    /// Returns the share of the light of a star at `v` px that lies on the pixels of one axis.
    #[inline]
    fn along(&self, axis: usize, v: f64) -> f64 {
        let size = self.size_px[axis];
        let clear_px = self.half_px as f64 + 1.0;
        let (to_first, to_last) = (v + 0.5, size as f64 - 0.5 - v);
        if to_first.min(to_last) > clear_px {
            1.0
        } else if to_first.min(to_last) < -clear_px {
            0.0
        } else {
            self.within(axis, to_last) - self.within(axis, -to_first)
        }
    }

    /// Returns the signed share of the footprint's light between the star and a line `px` away.
    #[inline]
    fn within(&self, axis: usize, px: f64) -> f64 {
        let line = &self.lines[axis][usize::from(px > 0.0)];
        let last = line.len() - 1;
        if px.abs() >= self.step_px * (last + 1) as f64 {
            // Beyond the table, without a division: of two edges, one is far away.
            return (line[last - 1] + (line[last] - line[last - 1])).copysign(px);
        }
        let at = px.abs() / self.step_px;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the table")]
        let i = (at as usize).min(line.len() - 2);
        let share = line[i] + (line[i + 1] - line[i]) * (at - i as f64).min(1.0);
        share.copysign(px)
    }
}

/// Returns the share of the light in a footprint: of a Gaussian in its middle, of another PSF at its worst place.
fn within(psf: &PsfModel, half_px: usize) -> f64 {
    match psf.form() {
        PsfForm::Gaussian(sigma_px) => gaussian_within(half_px as f64 + 0.5, sigma_px).powi(2),
        PsfForm::Round(_) | PsfForm::Grid(_) | PsfForm::Field(_) => 1.0 - psf.lost_flux(half_px),
    }
}

/// Returns the share of a Gaussian's light within `px` from its middle, one axis.
fn gaussian_within(px: f64, sigma_px: f64) -> f64 {
    libm::erf(px / sigma_px * core::f64::consts::FRAC_1_SQRT_2)
}

/// Returns the share of the footprint's light of a Gaussian between its middle and every step, one axis.
fn gaussian_line(half_px: usize, sigma_px: f64) -> Vec<f64> {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a footprint is small")]
    let steps = ((half_px as f64 + 2.0) / (GAUSSIAN_STEP * sigma_px)).ceil() as usize;
    let rim_px = half_px as f64 + 0.5;
    let all = gaussian_within(rim_px, sigma_px);
    let within = |px: f64| 0.5 * gaussian_within(px.min(rim_px), sigma_px) / all;
    (0..=steps).map(|i| within(i as f64 * GAUSSIAN_STEP * sigma_px)).collect()
}

/// Returns the cumulative line-spread function of a round profile within its footprint, from 0, normalised to 1/2 at
/// the rim.
fn line_integral(irradiance: impl Fn(f64) -> f64 + Sync, half_px: usize, step_px: f64) -> Vec<f64> {
    let reach_px = half_px as f64 + 0.5;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a footprint is small")]
    let steps = (reach_px / step_px).ceil() as usize;
    let panels: Vec<f64> = {
        use rayon::prelude::*;
        // Midpoints are sufficient: the pattern is band-limited far below 1 / step.
        let across = |x: f64| (0..steps).map(|j| irradiance(x.hypot((j as f64 + 0.5) * step_px))).sum::<f64>();
        (0..steps).into_par_iter().map(|i| across((i as f64 + 0.5) * step_px)).collect()
    };
    let total: f64 = 2.0 * panels.iter().sum::<f64>();
    let mut sum = 0.0;
    let mut line = vec![0.0];
    line.extend(panels.iter().map(|panel| {
        sum += panel / total;
        sum
    }));
    line
}

/// Returns the light of a grid within its footprint, and by axis the share of it between the star and a line before or
/// after it: light comes by whole pixels, so the light before a line is the sum over the columns before it.
fn grid_lines(grid: &PsfGrid, half_px: usize) -> (f64, [[Vec<f64>; 2]; 2]) {
    let reach = (2 * half_px + 1) * HALF_PIXEL;
    let s = grid.oversampling();
    let across = (2 * half_px + 1) * s;
    let trapezoid = |i: usize, last: usize| if i == 0 || i == last { 0.5 } else { 1.0 };
    // Light of the column (or row) whose middle lies `i` steps from the star.
    let column = |axis: usize, i: usize| {
        let at = (i as f64 - reach as f64) * GRID_STEP;
        let place = |j: usize| j as f64 / s as f64 - (half_px as f64 + 0.5);
        let value = |j: usize| if axis == 0 { grid.pixel(at, place(j)) } else { grid.pixel(place(j), at) };
        (0..=across).map(|j| trapezoid(j, across) * value(j)).sum::<f64>() / s as f64
    };
    let mut footprint = 0.0;
    let lines = core::array::from_fn(|axis| {
        let columns: Vec<f64> = {
            use rayon::prelude::*;
            (0..=2 * reach).into_par_iter().map(|i| column(axis, i)).collect()
        };
        let total: f64 = columns.iter().enumerate().map(|(i, v)| trapezoid(i, 2 * reach) * v).sum::<f64>() * GRID_STEP;
        footprint = total;
        // Before a line: the column half a pixel before it, and all columns before the line one pixel further.
        let end = 2 * (reach + HALF_PIXEL);
        let mut before = vec![0.0; end + 1];
        for i in HALF_PIXEL..=end {
            let own = columns.get(i.wrapping_sub(2 * HALF_PIXEL)).copied().unwrap_or(0.0);
            before[i] = own + i.checked_sub(2 * HALF_PIXEL).map_or(0.0, |earlier| before[earlier]);
        }
        let star = reach + HALF_PIXEL;
        let from_star = |i: usize| (before[i] - before[star]) / total;
        [(0..=star).map(|k| -from_star(star - k)).collect(), (0..=star).map(|k| from_star(star + k)).collect()]
    });
    (footprint, lines)
}

fn square_sum(half_px: usize, value: impl Fn(f64, f64) -> f64) -> f64 {
    let half = half_px as f64;
    let side = 2 * half_px + 1;
    (0..side * side).map(|i| value((i % side) as f64 - half, (i / side) as f64 - half)).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::exposure::{pose::Pose, track::StarPlace};
    use sky::astrometry::{BrownConrady, CameraParameters};

    #[test]
    fn a_long_path_across_an_edge_leaves_its_share_on_the_detector() {
        let share = Share::new(&PsfModel::gaussian(0.8), [4, 4], [100, 100]);
        let camera = CameraGeometry::new(CameraParameters {
            width_px: 100,
            height_px: 100,
            focal_px: [1000.0; 2],
            principal_point_px: [49.5; 2],
            distortion: BrownConrady::default(),
        })
        .unwrap();
        let place = StarPlace::of_pixel(&camera, [10.0, 50.0]).unwrap();
        let star = PlannedStar {
            id: 0,
            mag: 0.0,
            electrons: 1.0,
            drawn_e: 1.0,
            electrons_on_detector: 0.0,
            place,
            mean_px: [10.0, 50.0],
            list: 0,
        };
        let node = |i: u32| {
            let tau = (f64::from(i) + 0.5) / 1024.0 - 0.5;
            PathNode { weight: 1.0 / 1024.0, pose: Pose::new(glam::DQuat::IDENTITY, 0.0, [60.0 * tau, 0.0]) }
        };
        let nodes: Vec<PathNode> = (0..1024).map(node).collect();
        // From x = -20 to 40: 40.5 of 60 px lie on the detector.
        let on = share.on_detector(&star, &camera, &nodes, 30.0);
        assert!((on - 40.5 / 60.0).abs() < 1e-6, "{on}");
    }
}
