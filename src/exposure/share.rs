//! Share of a star's light that lands on the detector: what the truth table calls its electrons.
//!
//! Inside the detector: the footprint's share. Across an edge: the mean over the path nodes of the share inside.
//! Gaussian: exact products of error functions. Airy: products of its line-spread function's integral, exact at one
//! edge, at a corner off by what the pattern is not separable (< 3e-3 of the star; none for a star on the corner).

use crate::exposure::features::PathNode;
use crate::exposure::plan::PlannedStar;
use crate::optics::PsfModel;
use crate::optics::airy::Airy;

/// Step of the integral of an Airy line-spread function, px.
const LINE_STEP: f64 = 1.0 / 16.0;
/// Nodes used for a star at an edge (a path is averaged with no more than this many).
const EDGE_NODES: usize = 64;

/// Light on one detector.
#[derive(Debug, Clone, PartialEq)]
pub struct Share {
    psf: PsfModel,
    half_px: usize,
    size_px: [usize; 2],
    footprint: f64,
    /// Airy: share of the light within a distance along one axis, every [`LINE_STEP`] px from 0.
    line: Vec<f64>,
}

impl Share {
    /// For a PSF drawn in footprints of `half_px` on a detector of `size_px`.
    #[must_use]
    pub fn new(psf: &PsfModel, half_px: usize, size_px: [usize; 2]) -> Self {
        let footprint = match psf {
            PsfModel::Gaussian { .. } => 1.0,
            PsfModel::Airy(_) => square_sum(half_px, |x, y| psf.pixel(x, y)),
        };
        let line = match psf {
            PsfModel::Gaussian { .. } => Vec::new(),
            PsfModel::Airy(airy) => line_integral(airy, half_px),
        };
        Self { psf: psf.clone(), half_px, size_px, footprint, line }
    }

    /// Share of `star`'s electrons on the detector.
    #[must_use]
    pub fn on_detector(&self, star: &PlannedStar, nodes: &[PathNode], extent_px: f64) -> f64 {
        let margin = self.half_px as f64 + 1.0 + extent_px;
        let well_inside = |v: f64, size: usize| v >= margin && v <= size as f64 - 1.0 - margin;
        if well_inside(star.mean_px[0], self.size_px[0]) && well_inside(star.mean_px[1], self.size_px[1]) {
            return self.footprint;
        }
        self.footprint * self.at_edge(star, nodes)
    }

    fn at_edge(&self, star: &PlannedStar, nodes: &[PathNode]) -> f64 {
        let stride = nodes.len().div_ceil(EDGE_NODES).max(1);
        let (mut sum, mut weights) = (0.0, 0.0);
        for node in nodes.iter().step_by(stride) {
            let shift = star.track.displacement_px(&node.phi);
            let inside: f64 = (0..2)
                .map(|axis| {
                    let v = star.track.mid_px[axis] + shift[axis];
                    self.between(-0.5 - v, self.size_px[axis] as f64 - 0.5 - v)
                })
                .product();
            sum += node.weight * inside;
            weights += node.weight;
        }
        sum / weights
    }

    /// Share of the footprint's light between two distances along one axis.
    fn between(&self, low_px: f64, high_px: f64) -> f64 {
        match &self.psf {
            PsfModel::Gaussian { sigma_px } => between(low_px, high_px, *sigma_px),
            PsfModel::Airy(_) => self.within(high_px) - self.within(low_px),
        }
    }

    /// Airy: signed share of the light between the star and a line `px` away.
    fn within(&self, px: f64) -> f64 {
        let at = px.abs() / LINE_STEP;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the table")]
        let i = (at as usize).min(self.line.len() - 2);
        let share = self.line[i] + (self.line[i + 1] - self.line[i]) * (at - i as f64).min(1.0);
        share.copysign(px)
    }
}

/// Cumulative line-spread function of an Airy pattern within its footprint, from 0, normalised to 1/2 at the rim.
fn line_integral(airy: &Airy, half_px: usize) -> Vec<f64> {
    let reach_px = half_px as f64 + 0.5;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a footprint is small")]
    let steps = (reach_px / LINE_STEP).ceil() as usize;
    let panels: Vec<f64> = {
        use rayon::prelude::*;
        // Midpoints serve: the pattern is band-limited far below 1 / LINE_STEP.
        let across = |x: f64| (0..steps).map(|j| airy.irradiance(x.hypot((j as f64 + 0.5) * LINE_STEP))).sum::<f64>();
        (0..steps).into_par_iter().map(|i| across((i as f64 + 0.5) * LINE_STEP)).collect()
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

/// Probability of a centred normal between two bounds.
fn between(low: f64, high: f64, sigma: f64) -> f64 {
    let scale = core::f64::consts::FRAC_1_SQRT_2 / sigma;
    0.5 * (libm::erf(high * scale) - libm::erf(low * scale))
}

fn square_sum(half_px: usize, value: impl Fn(f64, f64) -> f64) -> f64 {
    let half = half_px as f64;
    let side = 2 * half_px + 1;
    (0..side * side).map(|i| value((i % side) as f64 - half, (i / side) as f64 - half)).sum()
}
