//! Share of a star's light that lands on the detector: what the truth table calls its electrons.
//!
//! Inside the detector: the footprint's share. Across an edge: the mean over the path nodes of the share inside.
//! Gaussian: exact products of error functions. Airy: pixel-centre sums about the mean position (error < 1e-3 of the
//! star, only for stars cut by an edge).

use crate::exposure::features::PathNode;
use crate::exposure::plan::PlannedStar;
use crate::optics::PsfModel;

/// Nodes used for a star at an edge (a path is averaged with no more than this many).
const EDGE_NODES: usize = 64;

/// Light on one detector.
#[derive(Debug, Clone, PartialEq)]
pub struct Share {
    psf: PsfModel,
    half_px: usize,
    size_px: [usize; 2],
    footprint: f64,
}

impl Share {
    /// For a PSF drawn in footprints of `half_px` on a detector of `size_px`.
    #[must_use]
    pub fn new(psf: &PsfModel, half_px: usize, size_px: [usize; 2]) -> Self {
        let footprint = match psf {
            PsfModel::Gaussian { .. } => 1.0,
            PsfModel::Airy(_) => square_sum(half_px, |x, y| psf.pixel(x, y)),
        };
        Self { psf: psf.clone(), half_px, size_px, footprint }
    }

    /// Share of `star`'s electrons on the detector.
    #[must_use]
    pub fn on_detector(&self, star: &PlannedStar, nodes: &[PathNode], extent_px: f64) -> f64 {
        let margin = self.half_px as f64 + 1.0 + extent_px;
        let well_inside = |v: f64, size: usize| v >= margin && v <= size as f64 - 1.0 - margin;
        if well_inside(star.mean_px[0], self.size_px[0]) && well_inside(star.mean_px[1], self.size_px[1]) {
            return self.footprint;
        }
        match &self.psf {
            PsfModel::Gaussian { sigma_px } => self.gaussian_at_edge(star, nodes, *sigma_px),
            PsfModel::Airy(airy) => {
                let [x0, y0] = star.mean_px;
                let (cx, cy) = (x0.round(), y0.round());
                let inside = |v: f64, size: usize| v > -0.5 && v < size as f64 - 0.5;
                let total = square_sum(self.half_px, |x, y| airy.irradiance((cx + x - x0).hypot(cy + y - y0)));
                let kept = square_sum(self.half_px, |x, y| {
                    let on = inside(cx + x, self.size_px[0]) && inside(cy + y, self.size_px[1]);
                    if on { airy.irradiance((cx + x - x0).hypot(cy + y - y0)) } else { 0.0 }
                });
                self.footprint * kept / total
            }
        }
    }

    fn gaussian_at_edge(&self, star: &PlannedStar, nodes: &[PathNode], sigma_px: f64) -> f64 {
        let stride = nodes.len().div_ceil(EDGE_NODES).max(1);
        let (mut sum, mut weights) = (0.0, 0.0);
        for node in nodes.iter().step_by(stride) {
            let shift = star.track.displacement_px(&node.phi);
            let inside: f64 = (0..2)
                .map(|axis| {
                    let v = star.track.mid_px[axis] + shift[axis];
                    between(-0.5 - v, self.size_px[axis] as f64 - 0.5 - v, sigma_px)
                })
                .product();
            sum += node.weight * inside;
            weights += node.weight;
        }
        sum / weights
    }
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
