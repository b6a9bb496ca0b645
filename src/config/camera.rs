//! A camera file.
//!
//! `[[head]]` and `[[extra_head]]`: camera heads, each with its mounting, camera, frame rate and phase.

use crate::background::{Background, BackgroundKeys, Baffle, BaffleKeys};
use crate::band::{BandKeys, check_band};
use crate::check::{Checker, Defaulted};
use crate::detector_effects::{DetectorKeys, tdi_exposure};
use crate::error::{ConfigError, Partly, Result};
use crate::file_kind::{FileKind, must_be};
use crate::key::{listed, section};
use crate::mtf::{MtfKeys, belongs_to_chain};
use crate::optics::{Distortion, DistortionKeys, IlluminationKeys, Optics, OpticsKeys, check_distortion};
use crate::psf::{Psf, PsfKeys};
use crate::radiometry::{Exposure, ExposureKeys, Radiometry, RadiometryKeys, RadiometryModel};
use crate::several::{check_all, check_partly};
use crate::timing::{PHASE_MAX_MS, check_frame_rate};
use crate::{detector::Detector, document::Document};
use base::axes::{Body, Rotation, Sensor, WRITTEN_NORM_TOLERANCE};
use base::time::Span;
use base::units::{ARCSEC, DEG};
use plan::exposure::PsfSampling;
use plan::optics::{Band, BandRadiometry, Illumination, StarLight};
use sky::astrometry::{AstrometryError, CameraGeometry};
use std::path::Path;

/// An exposure that fits every frame rate, s.
const SHORT_S: f64 = 1e-5;

/// A camera, checked. Only the detector's size and the focal length have no default.
#[derive(Debug, Clone, PartialEq)]
pub struct Camera {
    /// Name for people.
    pub name: String,
    /// The detector.
    pub detector: Detector,
    /// The optics.
    pub optics: Optics,
    /// Distortion of the optics.
    pub distortion: Distortion,
    /// Point-spread function.
    pub psf: Psf,
    /// How pixel values are computed from the PSF.
    pub sampling: PsfSampling,
    /// How the image plane is lit.
    pub illumination: Illumination,
    /// Light that is not the stars'.
    pub background: Background,
    /// Stray light of Sun, Moon and Earth.
    pub baffle: Option<Baffle>,
    /// Magnitudes to photons.
    pub radiometry: Radiometry,
    /// Quantum efficiency and transmission over wavelength, in place of mean values.
    pub band: Option<Band>,
    /// Exposure.
    pub exposure: Exposure,
    /// Values that the file does not give.
    pub defaulted: Vec<Defaulted>,
}

section! {
    /// A camera: only the detector's size and the focal length have no default.
    CameraKeys at "" {
        /// Name of the camera.
        name: String = Computed("the file's name"), "text";
        tables:
        /// Geometry, charge and conversion.
        detector: DetectorKeys;
        /// The lens or telescope.
        optics: OpticsKeys;
        /// Distortion of normalised image coordinates.
        distortion: DistortionKeys;
        /// Point-spread function of the optics.
        psf: PsfKeys;
        /// Vignetting, the cosine's fourth power, blocked aperture; without the table the field is even.
        illumination: IlluminationKeys;
        /// Light on the whole detector that is not the stars': uniform, or the sky's.
        background: BackgroundKeys;
        /// Stray light of Sun, Moon and Earth; without the table there is none.
        baffle: Option<BaffleKeys>;
        /// Links of the chain of transfer functions that psf.model = "chain" draws; every key left out is off.
        mtf: Option<MtfKeys>;
        /// Magnitudes to electrons.
        radiometry: RadiometryKeys;
        /// Quantum efficiency and transmission over wavelength, in place of mean values.
        band: Option<BandKeys>;
        /// When the detector collects light, and when its frame is due.
        exposure: ExposureKeys;
    }
}

impl Camera {
    /// Reads and checks a camera file.
    ///
    /// # Errors
    /// The first thing that is wrong with it.
    pub fn load(path: &Path) -> Result<Self> {
        Self::from_document(&Document::open(path)?)
    }

    /// Checks a camera that is already text.
    ///
    /// # Errors
    /// The first thing that is wrong with it.
    pub fn from_document(document: &Document) -> Result<Self> {
        must_be(FileKind::Camera, document)?;
        check_all(document, Self::checked)
    }

    /// Checks a camera that a bench names: the camera without what is wrong, and what is wrong.
    pub(super) fn partly(document: &Document) -> Result<Partly<Self>> {
        must_be(FileKind::Camera, document)?;
        let (mut camera, errors) = check_partly(document, Self::checked)?;
        if errors.iter().filter_map(ConfigError::key).any(|key| key.starts_with("exposure.")) {
            // So that no frame rate is refused for an exposure that no file asks for.
            camera.exposure.exposure_s = SHORT_S;
        }
        Ok((camera, errors))
    }

    fn checked(document: &Document) -> Result<Partly<Self>> {
        let keys: CameraKeys = document.read_as()?;
        let mut check = Checker::new(document);
        let name = check.label(keys.name().raw().cloned())?;
        let detector = Detector::check(&keys.detector, &mut check)?;
        let optics = Optics::check(&keys.optics, &detector, &mut check)?;
        let distortion = Distortion::check(&keys.distortion, &mut check)?;
        check_distortion(&detector, &optics, &distortion, &check)?;
        let mut psf = Psf::check(&keys.psf, keys.mtf.as_ref(), &detector, &optics, &mut check)?;
        belongs_to_chain(keys.mtf.as_ref(), &psf, &check)?;
        let sampling = Psf::check_sampling(&keys.psf, &mut check)?;
        let illumination = keys.illumination.check(&optics, &mut check)?;
        let background = keys.background.check(&mut check)?;
        let baffle = keys.baffle.as_ref().map(|keys| keys.check(&mut check)).transpose()?;
        let radiometry = Radiometry::check(&keys.radiometry, &detector, &mut check)?;
        let band = check_band(keys.band.as_ref(), optics.transmission, radiometry.model, &psf, &mut check)?;
        let exposure = Exposure::check(&keys.exposure, &mut check)?;
        let exposure = tdi_exposure(exposure, &detector.params.spatial, &check)?;
        if let Psf::Chain(chain) = &mut psf {
            chain.take_light(band.as_ref(), &check)?;
        }
        let Checker { defaulted, named_errors, .. } = check;
        let camera = Self {
            name,
            detector,
            optics,
            distortion,
            psf,
            sampling,
            illumination,
            background,
            baffle,
            radiometry,
            band,
            exposure,
            defaulted,
        };
        Ok((camera, named_errors))
    }

    /// Returns the geometry of its image.
    ///
    /// # Errors
    /// When the distortion folds the image.
    pub fn geometry(&self) -> Result<CameraGeometry, AstrometryError> {
        self.distortion.geometry(&self.detector, &self.optics)
    }

    /// Returns columns and rows of its images.
    pub fn image_px(&self) -> [u32; 2] {
        let detector = &self.detector;
        let output = detector.params.spatial.output([detector.width_px as usize, detector.height_px as usize]);
        output.size_px.map(|side| u32::try_from(side).unwrap_or(u32::MAX))
    }

    /// Returns the angle of one pixel on the boresight, arcsec.
    pub fn ifov_arcsec(&self) -> f64 {
        (self.detector.pixel_pitch_um * 1e-3 / self.optics.focal_length_mm).atan() / ARCSEC
    }

    /// Returns the full field of view along columns and rows, deg, without distortion.
    pub fn fov_deg(&self) -> [f64; 2] {
        [self.detector.width_px, self.detector.height_px].map(|side_px| {
            let half_mm = 0.5 * f64::from(side_px) * self.detector.pixel_pitch_um * 1e-3;
            2.0 * (half_mm / self.optics.focal_length_mm).atan() / DEG
        })
    }

    /// Returns the magnitude and colour to electrons, as the file says.
    pub fn star_light(&self) -> StarLight {
        let parametric = plan::optics::Radiometry {
            zero_magnitude_photons_per_s_m2: self.radiometry.zero_magnitude_photons_per_s_m2,
            aperture_mm: self.optics.aperture_mm,
            obscuration: self.optics.obscuration,
            transmission: self.optics.transmission,
            quantum_efficiency: self.detector.quantum_efficiency,
            color_c1: self.radiometry.color_c1,
            color_c2: self.radiometry.color_c2,
        };
        match (&self.band, self.radiometry.model) {
            (Some(band), _) => StarLight::Band(BandRadiometry::new(band, parametric.clear_aperture_m2())),
            (None, RadiometryModel::LinearGrey(map)) => StarLight::Grey(map),
            (None, RadiometryModel::PhotonsG) => StarLight::Parametric(parametric),
            (None, RadiometryModel::PhotonsV) => StarLight::ParametricV(parametric),
        }
    }

    /// Returns electrons per second of a star of instrument magnitude 0, over the whole image of the star; 0 under a
    /// grey mapping, which knows no seconds.
    pub fn zero_point_e_per_s(&self) -> f64 {
        self.star_light().zero_point_e_per_s().unwrap_or(0.0)
    }
}

/// Returns whether a document describes a camera by itself, rather than a bench that names one.
pub fn is_camera(document: &Document) -> bool {
    document.has_key("detector")
}

/// Most camera heads of one bench or spacecraft.
pub(super) const HEADS_MAX: usize = 8;

/// A camera head, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Head {
    /// How it is mounted.
    pub sensor_from_body: Rotation<Sensor, Body>,
    /// Its camera.
    pub camera: Camera,
    /// Frames per second.
    pub frame_rate_hz: f64,
    /// By how much its exposures begin after the whole frame periods of the run.
    pub phase: Span,
}

section! {
    /// A camera head.
    HeadKeys at "head" {
        /// How the head is mounted: a unit quaternion [w, x, y, z], scalar first.
        sensor_from_body: [f64; 4] = Needed, Within(-1.0, 1.0), "how the head is mounted";
        /// Camera file; left out, the bench's camera.
        camera: String = Optional, "path";
        /// Frames per second, such as 10.0; left out, as in [timing].
        frame_rate_hz: f64 = Computed("timing.frame_rate_hz"), PositiveUpTo(10_000.0);
        /// Milliseconds after the run's first exposure at which this head begins its own.
        phase_ms: f64 = Optional, Within(0.0, PHASE_MAX_MS);
    }
}

/// Returns the heads listed under `name`, at most `most`; keys that a head leaves out are as in `usual`.
pub(super) fn check_heads(
    name: &str,
    keys: &[HeadKeys],
    most: usize,
    usual: &Head,
    check: &mut Checker<'_>,
) -> Result<Vec<Head>> {
    if keys.len() > most {
        return Err(check.invalid(name, keys.len(), format!("at most {most}"), "leave some out"));
    }
    listed(keys, name).iter().map(|keys| keys.head(usual, check)).collect()
}

impl HeadKeys {
    fn head(&self, usual: &Head, check: &mut Checker<'_>) -> Result<Head> {
        let mounting = self.sensor_from_body();
        let wxyz = mounting.raw().ok_or_else(|| mounting.missing("a unit quaternion [w, x, y, z]", check))?;
        let sensor_from_body = quaternion(&mounting.key(), *wxyz, check)?;
        let camera = match self.camera().raw() {
            Some(path) => {
                let camera = Camera::partly(&check.document.named(&self.camera().key(), path)?)?;
                check.take(camera)
            }
            None => usual.camera.clone(),
        };
        let frame_rate_hz = self.frame_rate_hz().or_silently(usual.frame_rate_hz);
        let frame_rate_hz = check_frame_rate(frame_rate_hz, Some(camera.exposure.exposure_s), check)?;
        let phase = if self.phase_ms().is_given() { self.phase_ms().ms(check)? } else { usual.phase };
        Ok(Head { sensor_from_body, camera, frame_rate_hz, phase })
    }
}

/// Returns a quaternion of numbers from a file.
pub(super) fn quaternion(key: &str, wxyz: [f64; 4], check: &Checker<'_>) -> Result<Rotation<Sensor, Body>> {
    Rotation::from_wxyz(wxyz, WRITTEN_NORM_TOLERANCE).ok_or_else(|| {
        let wanted = "a unit quaternion [w, x, y, z], norm within 0.001 of 1";
        let advice = "scalar first; [1.0, 0.0, 0.0, 0.0] when sensor and body axes are the same";
        check.invalid(key, format!("{wxyz:?}"), wanted, advice)
    })
}
