//! `[optics]`, `[distortion]`, `[psf]`.

use crate::check::{Checker, Rule};
use crate::detector::Detector;
use crate::distortion::{Terms, check_polynomial};
use crate::error::ConfigError;
use crate::mtf::{Chain, LensKeys, MtfKeys};
use crate::psf::{self, LevelOrWord, NodeKeys, PlaceOrWord};
use plan::exposure::PsfSampling;
use plan::optics::PsfModel;
use serde::Deserialize;
use sky::astrometry::PolynomialDistortion;

/// Shortest focal length, mm: a tenth of that, and one pixel sees most of the sky.
const LEAST_FOCAL_MM: f64 = 0.1;
/// Default f-number: a fast star-tracker lens.
const DEFAULT_F_NUMBER: f64 = 2.0;
/// Default PSF: the width at which centroids of 5 x 5 windows are near their best.
const DEFAULT_SIGMA_PX: f64 = 0.7;
/// Default wavelength, nm: near the pivot of the Gaia G band (622 nm).
pub(super) const DEFAULT_WAVELENGTH_NM: f64 = 620.0;
/// Largest obscuration: more leaves no aperture worth the name.
pub(super) const LARGEST_OBSCURATION: f64 = 0.95;

/// The optics, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Optics {
    /// Focal length, mm.
    pub focal_length_mm: f64,
    /// Diameter of the entrance pupil, mm.
    pub aperture_mm: f64,
    /// Diameter of the central obscuration over that of the aperture.
    pub obscuration: f64,
    /// Fraction of the light that the optics pass, band average.
    pub transmission: f64,
    /// Where the boresight meets the detector, px (x, y); the centre of the first pixel is (0, 0).
    pub principal_point_px: [f64; 2],
}

/// Brown-Conrady distortion coefficients of normalised image coordinates (x / z, y / z), or a polynomial of them, checked.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Distortion {
    /// Radial, r^2.
    pub k1: f64,
    /// Radial, r^4.
    pub k2: f64,
    /// Radial, r^6.
    pub k3: f64,
    /// Tangential.
    pub p1: f64,
    /// Tangential.
    pub p2: f64,
    /// In place of all these.
    pub polynomial: Option<PolynomialDistortion>,
}

/// Point-spread function of the optics, checked.
#[derive(Debug, Clone, PartialEq)]
pub enum Psf {
    /// A round Gaussian.
    Gaussian {
        /// Standard deviation on one axis, px.
        sigma_px: f64,
    },
    /// Diffraction by a circular aperture.
    Airy {
        /// Focal length over aperture.
        f_number: f64,
        /// Wavelength, nm.
        wavelength_nm: f64,
        /// Linear central obscuration.
        obscuration: f64,
    },
    /// A chain of transfer functions.
    Chain(Box<Chain>),
    /// A Moffat profile, a measured PSF, or a field of PSFs, as it is drawn.
    Made(PsfModel),
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct OpticsKeys {
    focal_length_mm: Option<f64>,
    aperture_mm: Option<f64>,
    obscuration: Option<f64>,
    transmission: Option<f64>,
    principal_point_px: Option<[f64; 2]>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DistortionKeys {
    k1: Option<f64>,
    k2: Option<f64>,
    k3: Option<f64>,
    p1: Option<f64>,
    p2: Option<f64>,
    model: Option<String>,
    #[serde(default)]
    x: Terms,
    #[serde(default)]
    y: Terms,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct PsfKeys {
    model: Option<String>,
    sigma_px: Option<f64>,
    f_number: Option<f64>,
    wavelength_nm: Option<f64>,
    obscuration: Option<f64>,
    bp_rp: Option<f64>,
    pub(super) sampling: Option<String>,
    fwhm_px: Option<f64>,
    beta: Option<f64>,
    file: Option<String>,
    samples_per_px: Option<i64>,
    holds: Option<String>,
    background: Option<LevelOrWord>,
    star_at: Option<PlaceOrWord>,
    light_inside: Option<f64>,
    nodes: Option<[i64; 2]>,
    #[serde(default)]
    node: Vec<NodeKeys>,
}

impl PsfKeys {
    /// Those of a PSF that may also stand at a node.
    fn of_node(&self) -> NodeKeys {
        NodeKeys {
            model: self.model.clone(),
            sigma_px: self.sigma_px,
            fwhm_px: self.fwhm_px,
            beta: self.beta,
            file: self.file.clone(),
            samples_per_px: self.samples_per_px,
            holds: self.holds.clone(),
            background: self.background.clone(),
            star_at: self.star_at.clone(),
            light_inside: self.light_inside,
        }
    }
}

impl Optics {
    pub(super) fn check(keys: &OpticsKeys, detector: &Detector, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        let focal = "give the focal length in millimetres, such as 50.0; it sets the scale of the image";
        let focal_length_mm =
            check.required("optics.focal_length_mm", keys.focal_length_mm, Rule::Within(LEAST_FOCAL_MM, 1e6), focal)?;
        let mut number = |key: &str, given, default, rule, advice| {
            check.number(&format!("optics.{key}"), given, default, rule, advice)
        };
        let aperture_mm = number(
            "aperture_mm",
            keys.aperture_mm,
            focal_length_mm / DEFAULT_F_NUMBER,
            Rule::PositiveUpTo(1e5),
            "diameter of the entrance pupil in millimetres",
        )?;
        let obscuration = number(
            "obscuration",
            keys.obscuration,
            0.0,
            Rule::Within(0.0, LARGEST_OBSCURATION),
            "a ratio of diameters; 0 for a lens",
        )?;
        let transmission =
            number("transmission", keys.transmission, 0.8, Rule::PositiveUpTo(1.0), "a fraction: 80 % is 0.8")?;
        let centre = [detector.width_px, detector.height_px].map(|side| (f64::from(side) - 1.0) / 2.0);
        Ok(Self {
            focal_length_mm,
            aperture_mm,
            obscuration,
            transmission,
            principal_point_px: principal_point(keys.principal_point_px, centre, check)?,
        })
    }
}

/// The principal point, not further outside the detector than its own size.
fn principal_point(
    given: Option<[f64; 2]>,
    centre: [f64; 2],
    check: &mut Checker<'_>,
) -> Result<[f64; 2], ConfigError> {
    let key = "optics.principal_point_px";
    let Some(point) = given else {
        check.given_or(key, None, format!("[{}, {}]", centre[0], centre[1]));
        return Ok(centre);
    };
    for (coordinate, centre) in point.into_iter().zip(centre) {
        let side = 2.0 * centre + 1.0;
        let advice = "pixels from the centre of the first pixel; leave it out for the centre of the detector";
        check.meets(key, coordinate, Rule::Within(-side, 2.0 * side), advice)?;
    }
    Ok(point)
}

impl Distortion {
    /// None given: none. What is given must be finite and small enough to be a lens.
    pub(super) fn check(keys: &DistortionKeys, check: &Checker<'_>) -> Result<Self, ConfigError> {
        let polynomial = match keys.model.as_deref() {
            None | Some("brown-conrady") => {
                check.unused("distortion.x", !keys.x.is_empty(), "model = \"polynomial\"")?;
                check.unused("distortion.y", !keys.y.is_empty(), "model = \"polynomial\"")?;
                None
            }
            Some("polynomial") => {
                let brown = [("k1", keys.k1), ("k2", keys.k2), ("k3", keys.k3), ("p1", keys.p1), ("p2", keys.p2)];
                for (key, given) in brown {
                    check.unused(&format!("distortion.{key}"), given.is_some(), "model = \"brown-conrady\"")?;
                }
                Some(check_polynomial([&keys.x, &keys.y], check)?)
            }
            Some(word) => {
                let (wanted, advice) = ("\"brown-conrady\" or \"polynomial\"", "without it: brown-conrady");
                return Err(check.invalid("distortion.model", format!("\"{word}\""), wanted, advice));
            }
        };
        let coefficient = |key: &str, given: Option<f64>| {
            let advice = "a coefficient for normalised image coordinates, such as -0.05";
            check.meets(&format!("distortion.{key}"), given.unwrap_or(0.0), Rule::Within(-100.0, 100.0), advice)
        };
        Ok(Self {
            k1: coefficient("k1", keys.k1)?,
            k2: coefficient("k2", keys.k2)?,
            k3: coefficient("k3", keys.k3)?,
            p1: coefficient("p1", keys.p1)?,
            p2: coefficient("p2", keys.p2)?,
            polynomial,
        })
    }
}

#[derive(Clone, Copy)]
enum Model {
    Gaussian,
    Airy,
    Chain,
    Moffat,
    Measured,
    Field,
}

impl Psf {
    pub(super) fn check(
        keys: &PsfKeys,
        mtf: Option<&MtfKeys>,
        detector: &Detector,
        optics: &Optics,
        check: &mut Checker<'_>,
    ) -> Result<Self, ConfigError> {
        let models = [
            ("gaussian", Model::Gaussian),
            ("airy", Model::Airy),
            ("moffat", Model::Moffat),
            ("measured", Model::Measured),
            ("field", Model::Field),
            ("chain", Model::Chain),
        ];
        let advice = "gaussian takes sigma_px; airy takes f_number, wavelength_nm, obscuration; moffat takes fwhm_px, beta; \
                      measured takes file, samples_per_px; field takes nodes and [[psf.node]]; chain takes what airy does, bp_rp and [mtf]";
        let model = check.choice("psf.model", keys.model.as_deref(), &models, advice)?;
        let is_chain = matches!(model, Model::Chain);
        check.unused("psf.bp_rp", keys.bp_rp.is_some() && !is_chain, "model = \"chain\"")?;
        if !matches!(model, Model::Airy | Model::Chain) {
            for (key, given) in [
                ("psf.f_number", keys.f_number),
                ("psf.wavelength_nm", keys.wavelength_nm),
                ("psf.obscuration", keys.obscuration),
            ] {
                check.unused(key, given.is_some(), "model = \"airy\"")?;
            }
        }
        if !matches!(model, Model::Gaussian) {
            check.unused("psf.sigma_px", keys.sigma_px.is_some(), "model = \"gaussian\"")?;
        }
        let is_field = matches!(model, Model::Field);
        check.unused("psf.nodes", keys.nodes.is_some() && !is_field, "model = \"field\"")?;
        check.unused("psf.node", !keys.node.is_empty() && !is_field, "model = \"field\"")?;
        let own = keys.of_node();
        if !matches!(model, Model::Moffat | Model::Measured) {
            own.unused_by("", "psf", check)?;
        }
        match model {
            Model::Moffat => Ok(Self::Made(own.moffat("psf", check)?)),
            Model::Measured => Ok(Self::Made(own.measured("psf", check)?)),
            Model::Field => {
                let size_px = [detector.width_px, detector.height_px];
                Ok(Self::Made(psf::field(keys.nodes, &keys.node, size_px, check)?))
            }
            Model::Gaussian => {
                let advice = "standard deviation in pixels, such as 0.7; a star must spread over a few pixels";
                let rule = Rule::Within(0.05, 20.0);
                let sigma_px = check.number("psf.sigma_px", keys.sigma_px, DEFAULT_SIGMA_PX, rule, advice)?;
                Ok(Self::Gaussian { sigma_px })
            }
            Model::Chain => {
                let lens = LensKeys {
                    f_number: keys.f_number,
                    wavelength_nm: keys.wavelength_nm,
                    obscuration: keys.obscuration,
                    bp_rp: keys.bp_rp,
                };
                Ok(Self::Chain(Box::new(Chain::check(&lens, mtf, optics, detector, check)?)))
            }
            Model::Airy => Self::check_airy(keys, optics, check),
        }
    }

    /// How pixel values are had from the PSF.
    pub(super) fn check_sampling(keys: &PsfKeys, check: &mut Checker<'_>) -> Result<PsfSampling, ConfigError> {
        let word = check.given_or("psf.sampling", keys.sampling.clone(), "auto".to_owned());
        let refuse = |wanted: &str| {
            check.invalid("psf.sampling", format!("\"{word}\""), wanted, "auto is exact, and right for most cameras")
        };
        let sampling: PsfSampling =
            word.parse().map_err(|_| refuse("auto, table:S, supersampled:N, point or bicubic"))?;
        let tabled = keys.model.as_deref().is_some_and(|model| ["moffat", "measured", "field"].contains(&model));
        if tabled && !sampling.is_exact() {
            return Err(refuse("auto or table:S for this model (the others take points of a Gaussian)"));
        }
        Ok(sampling)
    }

    fn check_airy(keys: &PsfKeys, optics: &Optics, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        let own_f_number = optics.focal_length_mm / optics.aperture_mm;
        let mut number =
            |key: &str, given, default, rule, advice| check.number(&format!("psf.{key}"), given, default, rule, advice);
        Ok(Self::Airy {
            f_number: number(
                "f_number",
                keys.f_number,
                own_f_number,
                Rule::Within(0.3, 1000.0),
                "focal length over aperture; leave it out to take that of [optics]",
            )?,
            wavelength_nm: number(
                "wavelength_nm",
                keys.wavelength_nm,
                DEFAULT_WAVELENGTH_NM,
                Rule::Within(100.0, 20_000.0),
                "effective wavelength in nanometres, such as 620",
            )?,
            obscuration: number(
                "obscuration",
                keys.obscuration,
                optics.obscuration,
                Rule::Within(0.0, LARGEST_OBSCURATION),
                "a ratio of diameters; leave it out to take that of [optics]",
            )?,
        })
    }
}
