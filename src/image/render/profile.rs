//! One axis of a Gaussian star, by sampling method: positions of pixel edges -> running sums whose differences are the
//! pixel values.
//!
//! Exact: `erf / 2`. Point and supersampled: what a sum of points would give, written as values at pixel centres; the
//! differences of their running sums are those values again, so one drawing loop serves all. Bicubic: the points on
//! whole pixels, convolved with Keys's kernel.

use crate::render::erf::erf;
use plan::exposure::{PsfSampling, sampling::keys};

/// Sampling of one axis.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Profile {
    kind: Kind,
    sigma_px: f32,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Kind {
    Exact,
    Points(usize),
    Bicubic,
}

/// Pixels on each side whose running sum is taken: as many as an analytic footprint has.
const REACH: i32 = 9;

impl Profile {
    pub(super) fn new(sampling: PsfSampling, sigma_px: f64) -> Self {
        let kind = match sampling {
            PsfSampling::Auto | PsfSampling::Table { .. } => Kind::Exact,
            PsfSampling::Point => Kind::Points(1),
            PsfSampling::Supersampled { n } => Kind::Points(n),
            PsfSampling::Bicubic => Kind::Bicubic,
        };
        Self { kind, sigma_px: sigma_px as f32 }
    }

    /// Positions of pixel edges from the star, px -> running sums there.
    #[inline(always)]
    pub(super) fn apply<const FUSED: bool>(&self, edges: &mut [f32]) {
        match self.kind {
            Kind::Exact => {
                let scale = core::f32::consts::FRAC_1_SQRT_2 / self.sigma_px;
                for value in edges {
                    *value = 0.5 * erf::<FUSED>(*value * scale);
                }
            }
            Kind::Points(_) | Kind::Bicubic => edges.iter_mut().for_each(|edge| *edge = self.running_sum(*edge)),
        }
    }

    /// Returns the sum of the values of the pixels that end at or before this edge.
    fn running_sum(&self, edge: f32) -> f32 {
        (1..=2 * REACH).map(|i| self.value(f64::from(edge) + 0.5 - f64::from(i))).sum::<f64>() as f32
    }

    /// Returns the value of the pixel whose centre lies `x` px from the star.
    fn value(&self, x: f64) -> f64 {
        match self.kind {
            Kind::Exact => 0.0,
            Kind::Points(n) => {
                let at = |i: usize| x + (i as f64 + 0.5) / n as f64 - 0.5;
                (0..n).map(|i| self.density(at(i))).sum::<f64>() / n as f64
            }
            Kind::Bicubic => {
                let first = x.floor() - 1.0;
                (0..4).map(|m| first + f64::from(m)).map(|at| self.density(at) * keys(x - at)).sum()
            }
        }
    }

    fn density(&self, x: f64) -> f64 {
        let sigma = f64::from(self.sigma_px);
        (-0.5 * (x / sigma).powi(2)).exp() / (sigma * core::f64::consts::TAU.sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn differences_of_running_sums_are_pixel_values() {
        for (sampling, wanted) in
            [(PsfSampling::Point, 0.498_677_85 * (-0.5_f64 * (0.3 / 0.8_f64).powi(2)).exp()), (PsfSampling::Auto, 0.0)]
        {
            let profile = Profile::new(sampling, 0.8);
            let mut edges = [-0.2_f32, 0.8];
            profile.apply::<true>(&mut edges);
            let exact = 0.5 * (libm::erf(0.8 / 0.8 / 2_f64.sqrt()) - libm::erf(-0.2 / 0.8 / 2_f64.sqrt()));
            let wanted = if sampling == PsfSampling::Auto { exact } else { wanted };
            let got = f64::from(edges[1] - edges[0]);
            assert!((got - wanted).abs() < 1e-6, "{sampling}: {got} {wanted}");
        }
    }

    #[test]
    fn the_bicubic_kernel_passes_constants_and_whole_shifts() {
        for t in [0.0, 0.2, 0.5, 0.9] {
            let sum: f64 = (-2..3).map(|m| keys(t + f64::from(m))).sum();
            assert!((sum - 1.0).abs() < 1e-12, "{t}: {sum}");
        }
        assert!((keys(0.0) - 1.0).abs() < 1e-12 && keys(1.0).abs() < 1e-12);
    }
}
