//! Rows of the tables, their text, and the check of a row's bounds.

use plan::exposure::plan::{Assessment, Verdict};
use serde::{Deserialize, Serialize};

/// Rounding of a sum of a few hundred single-precision pixels.
const F32_FLUX: f64 = 2e-6;
/// The verdict of a method within the budget.
pub const FITS: &str = "fits";
/// The verdict of a method that a backend refused to draw; the note says why.
pub const NOT_DRAWN: &str = "not-drawn";

/// One method on one scene by one backend: predicted and measured values.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct MethodRow {
    /// `cpu` or `gpu`.
    pub backend: String,
    /// Scene; of a PSF sampling, the standard deviation of the PSF, px.
    pub scene: String,
    /// Method, or PSF sampling, by name; `auto`: the planner's choice.
    pub method: String,
    /// Its parameter, if one was requested.
    pub parameter: Option<usize>,
    /// Method that was drawn, with all its parameters.
    pub drawn: String,
    /// Nodes per star or kernel.
    pub nodes: usize,
    /// Verdict of the planner.
    pub verdict: String,
    /// Bound of the centroid error, px.
    pub bound_centroid_px: f64,
    /// Bound of the relative flux error.
    pub bound_flux_rel: f64,
    /// Bound of the largest pixel error, sigma.
    pub bound_pixel_sigma: f64,
    /// Predicted time of a frame, ms.
    pub predicted_ms: f64,
    /// Worst centroid error found, px.
    pub centroid_px: f64,
    /// Worst relative flux error found.
    pub flux_rel: f64,
    /// Worst pixel error found, sigma.
    pub pixel_sigma: f64,
    /// Sum of absolute differences over the sum of the truth.
    pub l1_rel: f64,
    /// Time to plan a frame, ms.
    pub plan_ms: f64,
    /// Time to draw it (electrons), ms.
    pub draw_ms: f64,
    /// Time of the fastest drawing, without other load, ms.
    pub fastest_ms: f64,
    /// Stars in the frame.
    pub stars: usize,
    /// Electrons of the brightest star.
    pub brightest_e: f64,
    /// Read noise, e-.
    pub read_noise_e: f64,
    /// Additional note.
    pub note: String,
}

impl MethodRow {
    /// Returns true when the planner gave bounds and all of them are kept; light beyond the footprint is in the flux
    /// bound, and affects pixels too.
    pub fn holds(&self) -> bool {
        let pixel_sigma = self.bound_pixel_sigma + self.brightest_e * self.bound_flux_rel / self.read_noise_e;
        self.centroid_px <= self.bound_centroid_px
            && self.flux_rel <= self.bound_flux_rel + F32_FLUX
            && self.pixel_sigma <= pixel_sigma
    }

    /// Returns true when the planner would draw with it.
    pub fn fits(&self) -> bool {
        self.verdict == FITS
    }

    /// Returns true when it produced an image.
    pub fn is_drawn(&self) -> bool {
        self.verdict != NOT_DRAWN
    }

    /// Returns true for the planner's own choice.
    pub fn is_choice(&self) -> bool {
        self.method == "auto"
    }

    /// Fills in the bounds given by the planner.
    pub fn promise(&mut self, chosen: &Assessment) {
        self.drawn = chosen.method.to_string();
        self.nodes = chosen.method.nodes();
        self.verdict = verdict_name(chosen.verdict).into();
        self.bound_centroid_px = chosen.centroid_px;
        self.bound_flux_rel = chosen.flux_rel;
        self.bound_pixel_sigma = chosen.pixel_sigma;
        self.predicted_ms = chosen.cost_ms;
    }
}

/// Returns the rows that the planner accepted and whose bounds are exceeded.
pub fn broken(rows: &[MethodRow]) -> Vec<&MethodRow> {
    rows.iter().filter(|row| row.fits() && !row.holds()).collect()
}

/// Returns the word for a verdict in tables.
pub fn verdict_name(verdict: Verdict) -> &'static str {
    match verdict {
        Verdict::Fits => FITS,
        Verdict::NeedsSmoothMotion => "needs-smooth-motion",
        Verdict::PathTooLong => "path-too-long",
        Verdict::OtherSampling => "other-sampling",
        Verdict::TooManyKernels => "too-many-kernels",
        Verdict::CentroidOverBudget => "centroid-over-budget",
        Verdict::PixelOverBudget => "pixel-over-budget",
        Verdict::FluxOverBudget => "flux-over-budget",
    }
}

/// Returns rows as CSV with a line of names.
///
/// # Errors
/// When a row cannot be written as CSV.
pub fn csv_text<R: Serialize>(rows: &[R]) -> Result<String, csv::Error> {
    let mut writer = csv::Writer::from_writer(Vec::new());
    for row in rows {
        writer.serialize(row)?;
    }
    let bytes = writer.into_inner().map_err(|error| csv::Error::from(error.into_error()))?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}
