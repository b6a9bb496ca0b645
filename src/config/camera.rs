//! A camera file.

use crate::base::units::{ARCSEC, DEG};
use crate::config::check::{Checker, Defaulted};
use crate::config::detector::{Detector, DetectorKeys};
use crate::config::document::Document;
use crate::config::error::ConfigError;
use crate::config::optics::{Distortion, DistortionKeys, Optics, OpticsKeys, Psf, PsfKeys};
use crate::config::radiometry::{Exposure, ExposureKeys, Radiometry, RadiometryKeys};
use crate::exposure::PsfSampling;
use serde::Deserialize;
use std::path::Path;

/// A camera, checked. Only the detector's size and the focal length have no default.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// What people call it.
    pub name: String,
    /// The detector.
    pub detector: Detector,
    /// The optics.
    pub optics: Optics,
    /// Distortion of the optics.
    pub distortion: Distortion,
    /// Point-spread function.
    pub psf: Psf,
    /// How pixel values are had from it.
    pub sampling: PsfSampling,
    /// Magnitudes to photons.
    pub radiometry: Radiometry,
    /// Exposure.
    pub exposure: Exposure,
    /// Values nobody gave.
    pub defaulted: Vec<Defaulted>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
struct CameraKeys {
    name: Option<String>,
    detector: DetectorKeys,
    optics: OpticsKeys,
    distortion: DistortionKeys,
    psf: PsfKeys,
    radiometry: RadiometryKeys,
    exposure: ExposureKeys,
}

impl Camera {
    /// Reads and checks a camera file.
    ///
    /// # Errors
    /// The first thing that is wrong with it.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        Self::from_document(&Document::open(path)?)
    }

    /// Checks a camera that is already text.
    ///
    /// # Errors
    /// The first thing that is wrong with it.
    pub fn from_document(document: &Document) -> Result<Self, ConfigError> {
        let keys: CameraKeys = document.read_as()?;
        let mut check = Checker::new(document);
        let name = check.given_or("name", keys.name, document.stem());
        let detector = Detector::check(&keys.detector, &mut check)?;
        let optics = Optics::check(&keys.optics, &detector, &mut check)?;
        let distortion = Distortion::check(&keys.distortion, &check)?;
        let psf = Psf::check(&keys.psf, &detector, &optics, &mut check)?;
        let sampling = Psf::check_sampling(&keys.psf, &mut check)?;
        let radiometry = Radiometry::check(&keys.radiometry, &mut check)?;
        let exposure = Exposure::check(&keys.exposure, &mut check)?;
        let defaulted = check.defaulted;
        Ok(Self { name, detector, optics, distortion, psf, sampling, radiometry, exposure, defaulted })
    }

    /// Angle of one pixel on the boresight, arcsec.
    #[must_use]
    pub fn ifov_arcsec(&self) -> f64 {
        (self.detector.pixel_pitch_um * 1e-3 / self.optics.focal_length_mm).atan() / ARCSEC
    }

    /// Full field of view along columns and rows, deg, without distortion.
    #[must_use]
    pub fn fov_deg(&self) -> [f64; 2] {
        [self.detector.width_px, self.detector.height_px].map(|side_px| {
            let half_mm = 0.5 * f64::from(side_px) * self.detector.pixel_pitch_um * 1e-3;
            2.0 * (half_mm / self.optics.focal_length_mm).atan() / DEG
        })
    }

    /// Electrons per second of a star of instrument magnitude 0, over the whole image of the star.
    #[must_use]
    pub fn zero_point_e_per_s(&self) -> f64 {
        let radius_m = 0.5e-3 * self.optics.aperture_mm;
        let area_m2 = core::f64::consts::PI * radius_m * radius_m * (1.0 - self.optics.obscuration.powi(2));
        self.radiometry.zero_magnitude_photons_per_s_m2
            * area_m2
            * self.optics.transmission
            * self.detector.quantum_efficiency
    }
}
