//! Figures of the statistical tracker in a plan: those of `[tracker_out.model]`, by the same names.

use anyhow::{Result, bail};
use base::time::Span;
use base::units::{ARCSEC, DEG};
use glam::DVec3;
use serde::Deserialize;
use testbed::tracker_model::{ModelParams, NoiseMethod};

/// Temporal noise over the sky.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NoiseOverSky {
    /// The same everywhere.
    Even,
    /// By the stars that the field offers.
    Stars,
}

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
    /// Part of the largest displacement by aberration that is left.
    pub aberration_residual_arcsec: f64,
    /// Error of the period of a pixel.
    pub pixel_spatial_arcsec: [f64; 3],
    /// Temporal noise at rest.
    pub noise_arcsec: [f64; 3],
    /// How it depends on where the tracker looks.
    pub noise_over_sky: NoiseOverSky,
    /// Stars that it says it used; by the stars of the field the most that it uses.
    pub stars: u32,
    /// Temporal noise that a rate adds, in squares: about its axis, about the axis across it, about the boresight.
    pub noise_arcsec_per_deg_s: [f64; 3],
    /// By how much the instant of an attitude is before the time that it states.
    pub date_error_ms: f64,
    /// How long conditions must hold before an attitude is found.
    pub acquisition_s: f64,
    /// Chance of a frame after that.
    pub acquisition_probability: f64,
    /// Chance of a frame while it tracks.
    pub tracking_probability: f64,
    /// Chance that an attitude is false.
    pub false_probability: f64,
    /// Rate up to which it finds an attitude.
    pub acquires_below_deg_s: f64,
    /// Rate from which it loses it.
    pub lost_above_deg_s: f64,
    /// Half-angle of the Sun's cone.
    pub sun_exclusion_deg: f64,
    /// Half-angle of the Moon's cone.
    pub moon_exclusion_deg: f64,
    /// Angle from the boresight to the Earth's limb; a figure of plans only.
    pub earth_exclusion_deg: f64,
}

impl Default for ModelFigures {
    fn default() -> Self {
        Self {
            bias_arcsec: [0.0; 3],
            drift_arcsec_per_h: [0.0; 3],
            fov_spatial_arcsec: [0.0; 3],
            aberration_residual_arcsec: 0.0,
            pixel_spatial_arcsec: [0.0; 3],
            noise_arcsec: [1.0, 1.0, 8.0],
            noise_over_sky: NoiseOverSky::Even,
            stars: 20,
            noise_arcsec_per_deg_s: [0.0; 3],
            date_error_ms: 0.0,
            acquisition_s: 0.0,
            acquisition_probability: 1.0,
            tracking_probability: 1.0,
            false_probability: 0.0,
            acquires_below_deg_s: 3.0,
            lost_above_deg_s: 5.0,
            sun_exclusion_deg: 0.0,
            moon_exclusion_deg: 0.0,
            earth_exclusion_deg: 0.0,
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
            ("noise_arcsec_per_deg_s", self.noise_arcsec_per_deg_s),
        ];
        for (name, vector) in vectors {
            if !vector.iter().all(|value| value.abs() <= 1e5) {
                bail!("tracker.model.{name}: got {vector:?}, wanted numbers up to 1e5");
            }
        }
        let signed = [
            ("date_error_ms", self.date_error_ms, 1e3),
            ("aberration_residual_arcsec", self.aberration_residual_arcsec, 1e5),
        ];
        for (name, got, most) in signed {
            if got.is_nan() || got.abs() > most {
                bail!("tracker.model.{name}: got {got}, wanted -{most} to {most}");
            }
        }
        let ranges = [
            ("acquisition_s", self.acquisition_s, 1e5),
            ("acquisition_probability", self.acquisition_probability, 1.0),
            ("tracking_probability", self.tracking_probability, 1.0),
            ("false_probability", self.false_probability, 1.0),
            ("acquires_below_deg_s", self.acquires_below_deg_s, 1e3),
            ("lost_above_deg_s", self.lost_above_deg_s, 1e3),
            ("sun_exclusion_deg", self.sun_exclusion_deg, 180.0),
            ("moon_exclusion_deg", self.moon_exclusion_deg, 180.0),
            ("earth_exclusion_deg", self.earth_exclusion_deg, 180.0),
        ];
        if !(4..=200).contains(&self.stars) {
            bail!("tracker.model.stars: got {}, wanted 4 to 200", self.stars);
        }
        match ranges.iter().find(|(_, got, most)| !(0.0..=*most).contains(got)) {
            Some((name, got, most)) => bail!("tracker.model.{name}: got {got}, wanted 0 to {most}"),
            None => Ok(()),
        }
    }

    /// Returns the figures in radians; the periods of spatial errors are those of the field and of a pixel.
    pub fn params(&self, field_rad: f64, pixel_rad: f64) -> ModelParams {
        let radians = |arcsec: [f64; 3]| DVec3::from_array(arcsec) * ARCSEC;
        ModelParams {
            bias_rad: radians(self.bias_arcsec),
            drift_rad_h: radians(self.drift_arcsec_per_h),
            fov_spatial_rad: radians(self.fov_spatial_arcsec),
            field_rad,
            aberration_residual_rad: self.aberration_residual_arcsec * ARCSEC,
            pixel_spatial_rad: radians(self.pixel_spatial_arcsec),
            pixel_rad,
            noise_rad: radians(self.noise_arcsec),
            noise_method: match self.noise_over_sky {
                NoiseOverSky::Even => NoiseMethod::Even,
                NoiseOverSky::Stars => NoiseMethod::Stars,
            },
            noise_rate_s: radians(self.noise_arcsec_per_deg_s) / DEG,
            date_error: Span::from_s(self.date_error_ms * 1e-3),
            acquisition: Span::from_s(self.acquisition_s),
            acquisition_probability: self.acquisition_probability,
            tracking_probability: self.tracking_probability,
            false_probability: self.false_probability,
            acquires_below_rad_s: self.acquires_below_deg_s * DEG,
            lost_above_rad_s: self.lost_above_deg_s * DEG,
            sun_exclusion_rad: self.sun_exclusion_deg * DEG,
            moon_exclusion_rad: self.moon_exclusion_deg * DEG,
            earth_exclusion_rad: self.earth_exclusion_deg * DEG,
            stars: self.stars,
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
        let few = ModelFigures { stars: 3, ..ModelFigures::default() };
        assert!(refused(few).contains("stars: got 3"));
        let none = ModelFigures { noise_arcsec: [f64::NAN, 1.0, 1.0], ..ModelFigures::default() };
        assert!(refused(none).contains("noise_arcsec"));
    }
}
