//! The accuracy budget: how wrong a frame may be, and so how little must be modelled.

/// Largest errors a bench accepts; the planner picks the cheapest methods whose bounds fit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AccuracyBudget {
    /// Bias of a star's centroid against truth, in the 5 x 5 window a tracker uses, px.
    pub centroid_px: f64,
    /// Relative error of a star's flux.
    pub flux_rel: f64,
    /// Largest pixel error in units of that pixel's own noise sigma.
    pub pixel_sigma: f64,
    /// Attitude to image: line-of-sight error, arcsec.
    pub los_arcsec: f64,
}

impl Default for AccuracyBudget {
    fn default() -> Self {
        Self { centroid_px: 0.002, flux_rel: 1e-3, pixel_sigma: 0.1, los_arcsec: 0.1 }
    }
}
