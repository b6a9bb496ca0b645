//! Figures of the statistical tracker in a plan: those of `[tracker_out.model]`, by the same names.

use anyhow::{Result, bail};
use base::time::Span;
use base::units::{ARCSEC, DEG};
use glam::DVec3;
use serde::Deserialize;
use testbed::tracker_model::ModelParams;

/// `[tracker.model]` of a plan; about x, y and z (boresight), 1 sigma.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ModelFigures {
    /// Constant error.
    pub bias_arcsec: [f64; 3],
    /// Error that grows with time.
    pub drift_arcsec_per_h: [f64; 3],
    /// Error of the period of the field.
    pub fov_spatial_arcsec: [f64; 3],
    /// Error of the period of a pixel.
    pub pixel_spatial_arcsec: [f64; 3],
    /// Temporal noise at rest.
    pub noise_arcsec: [f64; 3],
    /// Temporal noise that a rate adds, in squares.
    pub noise_arcsec_per_deg_s: f64,
    /// How long conditions must hold before an attitude is found.
    pub acquisition_s: f64,
    /// Chance of a frame after that.
    pub acquisition_probability: f64,
    /// Chance of a frame while it tracks.
    pub tracking_probability: f64,
    /// Rate up to which it finds an attitude.
    pub acquires_below_deg_s: f64,
    /// Rate from which it loses it.
    pub lost_above_deg_s: f64,
    /// Half-angle of the Sun's cone.
    pub sun_exclusion_deg: f64,
    /// Half-angle of the Moon's cone.
    pub moon_exclusion_deg: f64,
}

impl Default for ModelFigures {
    fn default() -> Self {
        Self {
            bias_arcsec: [0.0; 3],
            drift_arcsec_per_h: [0.0; 3],
            fov_spatial_arcsec: [0.0; 3],
            pixel_spatial_arcsec: [0.0; 3],
            noise_arcsec: [1.0, 1.0, 8.0],
            noise_arcsec_per_deg_s: 0.0,
            acquisition_s: 0.0,
            acquisition_probability: 1.0,
            tracking_probability: 1.0,
            acquires_below_deg_s: 3.0,
            lost_above_deg_s: 5.0,
            sun_exclusion_deg: 0.0,
            moon_exclusion_deg: 0.0,
        }
    }
}

impl ModelFigures {
    /// Refuses figures that no tracker has.
    ///
    /// # Errors
    /// With the first of them.
    pub fn check(&self) -> Result<()> {
        let vectors = [
            ("bias_arcsec", self.bias_arcsec),
            ("drift_arcsec_per_h", self.drift_arcsec_per_h),
            ("fov_spatial_arcsec", self.fov_spatial_arcsec),
            ("pixel_spatial_arcsec", self.pixel_spatial_arcsec),
            ("noise_arcsec", self.noise_arcsec),
        ];
        for (name, vector) in vectors {
            if !vector.iter().all(|value| value.abs() <= 1e5) {
                bail!("tracker.model.{name}: got {vector:?}, wanted numbers up to 1e5");
            }
        }
        let ranges = [
            ("noise_arcsec_per_deg_s", self.noise_arcsec_per_deg_s, 1e5),
            ("acquisition_s", self.acquisition_s, 1e5),
            ("acquisition_probability", self.acquisition_probability, 1.0),
            ("tracking_probability", self.tracking_probability, 1.0),
            ("acquires_below_deg_s", self.acquires_below_deg_s, 1e3),
            ("lost_above_deg_s", self.lost_above_deg_s, 1e3),
            ("sun_exclusion_deg", self.sun_exclusion_deg, 180.0),
            ("moon_exclusion_deg", self.moon_exclusion_deg, 180.0),
        ];
        match ranges.iter().find(|(_, got, most)| !(0.0..=*most).contains(got)) {
            Some((name, got, most)) => bail!("tracker.model.{name}: got {got}, wanted 0 to {most}"),
            None => Ok(()),
        }
    }

    /// Returns the figures in radians; the periods of spatial errors are those of the field and of a pixel.
    #[must_use]
    pub fn params(&self, field_rad: f64, pixel_rad: f64) -> ModelParams {
        let radians = |arcsec: [f64; 3]| DVec3::from_array(arcsec) * ARCSEC;
        ModelParams {
            bias_rad: radians(self.bias_arcsec),
            drift_rad_h: radians(self.drift_arcsec_per_h),
            fov_spatial_rad: radians(self.fov_spatial_arcsec),
            field_rad,
            pixel_spatial_rad: radians(self.pixel_spatial_arcsec),
            pixel_rad,
            noise_rad: radians(self.noise_arcsec),
            noise_rate_s: self.noise_arcsec_per_deg_s * ARCSEC / DEG,
            acquisition: Span::from_s(self.acquisition_s),
            acquisition_probability: self.acquisition_probability,
            tracking_probability: self.tracking_probability,
            acquires_below_rad_s: self.acquires_below_deg_s * DEG,
            lost_above_rad_s: self.lost_above_deg_s * DEG,
            sun_exclusion_rad: self.sun_exclusion_deg * DEG,
            moon_exclusion_rad: self.moon_exclusion_deg * DEG,
            stars: 20,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn figures_out_of_range_are_refused_by_name() {
        assert!(ModelFigures::default().check().is_ok());
        let refused = |figures: ModelFigures| figures.check().unwrap_err().to_string();
        let share = ModelFigures { tracking_probability: 1.5, ..ModelFigures::default() };
        assert!(refused(share).contains("tracking_probability: got 1.5"));
        let none = ModelFigures { noise_arcsec: [f64::NAN, 1.0, 1.0], ..ModelFigures::default() };
        assert!(refused(none).contains("noise_arcsec"));
    }
}
