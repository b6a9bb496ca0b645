//! `[optics]`, `[distortion]`.
//!
//! The polynomial of `[distortion]`, and the refusal of a distortion that folds the image.
//!
//! `[illumination]`: vignetting, the cosine's fourth power, blocked aperture. Without the section the field is even.

use crate::check::{Checker, Rule};
use crate::key::{Given, Section, section, taken};
use crate::key_type::{Any, Numbers, Raw, Shape, Word};
use crate::{detector::Detector, error::Result};
use plan::optics::{Illumination, illumination::Vignetting};
use sky::astrometry::{
    AstrometryError, BrownConrady, CameraGeometry, CameraParameters, DISTORTION_DEGREE, PolynomialDistortion,
};

/// Shortest focal length, mm: a tenth of that, and one pixel sees most of the sky.
const LEAST_FOCAL_MM: f64 = 0.1;
/// Default f-number: a fast star-tracker lens.
const DEFAULT_F_NUMBER: f64 = 2.0;
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

/// Brown-Conrady distortion coefficients of normalised image coordinates (x / z, y / z), or a polynomial of them,
/// checked.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Distortion {
    /// Coefficients; all 0 with a polynomial.
    pub coefficients: BrownConrady,
    /// The polynomial, in place of coefficients.
    pub polynomial: Option<PolynomialDistortion>,
}

section! {
    /// The lens or telescope.
    OpticsKeys at "optics" {
        /// Focal length.
        focal_length_mm: f64 = Needed, Within(LEAST_FOCAL_MM, 1e6),
            "give the focal length in millimetres, such as 50.0; it sets the scale of the image";
        /// Diameter of the entrance pupil in millimetres.
        aperture_mm: f64 = Computed("half of focal_length_mm"), Within(0.1, 1e5);
        /// Diameter of the central obscuration over that of the aperture, a ratio of diameters; 0 for a lens.
        obscuration: f64 = 0.0, Within(0.0, LARGEST_OBSCURATION);
        /// Fraction of the light that the optics pass, band average: 80 % is 0.8.
        transmission: f64 = 0.8, PositiveUpTo(1.0);
        /// Where the boresight meets the detector, pixels from the centre of the first pixel; left out: its own centre.
        principal_point_px: [f64; 2] = Computed("the centre of the detector"), Finite;
    }

    /// Distortion of normalised image coordinates; without the table there is none.
    DistortionKeys at "distortion" {
        /// "brown-conrady" takes k1 to p2, "polynomial" takes x and y.
        model: Word<IsPolynomial> = Silent("brown-conrady"),
            [("brown-conrady", IsPolynomial(false)), ("polynomial", IsPolynomial(true))], "without it: brown-conrady";
        /// Radial coefficient of r^2, for normalised image coordinates, such as -0.05.
        k1: f64 = Silent(0.0), Within(-100.0, 100.0);
        /// Radial coefficient of r^4, for normalised image coordinates, such as -0.05.
        k2: f64 = Silent(0.0), Within(-100.0, 100.0);
        /// Radial coefficient of r^6, for normalised image coordinates, such as -0.05.
        k3: f64 = Silent(0.0), Within(-100.0, 100.0);
        /// First tangential coefficient, for normalised image coordinates, such as -0.05.
        p1: f64 = Silent(0.0), Within(-100.0, 100.0);
        /// Second tangential coefficient, for normalised image coordinates, such as -0.05.
        p2: f64 = Silent(0.0), Within(-100.0, 100.0);
        /// Terms along x of a polynomial: rows of [exponent of x, exponent of y, coefficient].
        x: Raw<Terms> = Optional, Shape::list(Shape::numbers(3));
        /// Terms along y of a polynomial: rows of [exponent of x, exponent of y, coefficient].
        y: Raw<Terms> = Optional, Shape::list(Shape::numbers(3));
    }
}

/// Whether distortion is a polynomial.
#[derive(Debug, Clone, Copy)]
pub(super) struct IsPolynomial(bool);

impl Optics {
    /// Returns the focal length over aperture.
    pub(super) fn f_number(&self) -> f64 {
        self.focal_length_mm / self.aperture_mm
    }

    pub(super) fn check(keys: &OpticsKeys, detector: &Detector, check: &mut Checker<'_>) -> Result<Self> {
        let focal_length_mm = keys.focal_length_mm().check(check)?;
        let aperture_mm = keys.aperture_mm().or(focal_length_mm / DEFAULT_F_NUMBER).check(check)?;
        taken!(check, keys => obscuration, transmission);
        let centre = [detector.width_px, detector.height_px].map(|side| (f64::from(side) - 1.0) / 2.0);
        Ok(Self {
            focal_length_mm,
            aperture_mm,
            obscuration,
            transmission,
            principal_point_px: principal_point(&keys.principal_point_px(), centre, check)?,
        })
    }
}

/// Returns the principal point, not further outside the detector than its own size.
fn principal_point(given: &Given<'_, [f64; 2]>, centre: [f64; 2], check: &mut Checker<'_>) -> Result<[f64; 2]> {
    let Some(point) = given.raw().copied() else {
        check.note(&given.key(), Numbers(centre));
        return Ok(centre);
    };
    for (coordinate, centre) in point.into_iter().zip(centre) {
        let side = 2.0 * centre + 1.0;
        check.meets(&given.key(), coordinate, Rule::Within(-side, 2.0 * side), &given.advice)?;
    }
    Ok(point)
}

impl Distortion {
    /// Returns the geometry of a camera with this distortion.
    ///
    /// # Errors
    /// When the distortion folds the image.
    pub(super) fn geometry(&self, detector: &Detector, optics: &Optics) -> Result<CameraGeometry, AstrometryError> {
        let parameters = CameraParameters {
            width_px: detector.width_px as usize,
            height_px: detector.height_px as usize,
            focal_px: [optics.focal_length_mm * 1e3 / detector.pixel_pitch_um; 2],
            principal_point_px: optics.principal_point_px,
            distortion: self.coefficients,
        };
        match self.polynomial {
            None => CameraGeometry::new(parameters),
            Some(polynomial) => CameraGeometry::with_polynomial(parameters, polynomial),
        }
    }

    /// Reads the distortion; zero without keys. Coefficients must be finite and small enough to be a lens.
    pub(super) fn check(keys: &DistortionKeys, check: &mut Checker<'_>) -> Result<Self> {
        let IsPolynomial(is_polynomial) = keys.model().check(check)?;
        let polynomial = if is_polynomial {
            keys.refuse(&["k1", "k2", "k3", "p1", "p2"], "model = \"brown-conrady\"", check)?;
            Some(check_polynomial([keys.x(), keys.y()], check)?)
        } else {
            keys.refuse(&["x", "y"], "model = \"polynomial\"", check)?;
            None
        };
        taken!(check, keys => k1, k2, k3, p1, p2);
        Ok(Self { coefficients: BrownConrady { k1, k2, k3, p1, p2 }, polynomial })
    }
}

/// Rows of exponents of x and y, and the coefficient of that term.
pub(super) type Terms = Vec<(usize, usize, f64)>;

/// Returns the polynomial of the terms along x and along y.
pub(super) fn check_polynomial(along: [Given<'_, Raw<Terms>>; 2], check: &Checker<'_>) -> Result<PolynomialDistortion> {
    let terms = along.each_ref().map(|key| key.raw().map_or(&[][..], Vec::as_slice));
    if terms.iter().all(|terms| terms.is_empty()) {
        let wanted = "rows of [exponent of x, exponent of y, coefficient]";
        return Err(check.invalid("distortion.x", "none", wanted, "such as x = [[3, 0, -0.05], [1, 2, -0.05]]"));
    }
    let mut model = PolynomialDistortion::default();
    for ((key, terms), axis) in along.iter().zip(terms).zip([[1.0, 0.0], [0.0, 1.0]]) {
        let key = key.key();
        for (i, j, coefficient) in terms {
            let advice = "a coefficient for normalised image coordinates (lengths in focal lengths), such as -0.05";
            let coefficient = check.meets(&key, *coefficient, Rule::Within(-1e6, 1e6), advice)?;
            model = model.with_term(*i, *j, axis[0] * coefficient, axis[1] * coefficient).ok_or_else(|| {
                let wanted = format!("exponents with a sum from 1 to {DISTORTION_DEGREE}");
                let advice = "a constant is optics.principal_point_px";
                check.invalid(&key, format!("x^{i} y^{j}"), wanted, advice)
            })?;
        }
    }
    Ok(model)
}

/// Refuses a distortion that folds the image, so that a pixel has two directions or none.
pub(super) fn check_distortion(
    detector: &Detector,
    optics: &Optics,
    distortion: &Distortion,
    check: &Checker<'_>,
) -> Result<()> {
    match distortion.geometry(detector, optics) {
        Err(AstrometryError::DistortionFolds { limit_deg, x_px, y_px }) => {
            let got = format!("one-to-one only to {limit_deg:.2} deg off axis");
            let wanted = format!("a direction for every pixel, also for the corner at ({x_px}, {y_px}) px");
            let advice = "check signs and units of the coefficients: all are for lengths in focal lengths";
            Err(check.invalid("distortion", got, wanted, advice))
        }
        Ok(_) | Err(AstrometryError::Parameter { .. } | AstrometryError::TwoDistortions) => Ok(()),
    }
}

/// Largest share of the aperture that may be blocked: more leaves no aperture worth the name.
const MOST_BLOCKED: f64 = 0.95;

section! {
    /// How the image plane is lit.
    IlluminationKeys at "illumination" {
        /// Light falls off with the fourth power of the field angle's cosine.
        cos4: bool = Silent(false), Any;
        /// Share of the aperture that a spider or frame blocks, beside the central obscuration: 3 % is 0.03.
        blocked: f64 = Silent(0.0), Within(0.0, MOST_BLOCKED);
        /// Radius of the stop that cuts oblique beams, in millimetres.
        window_radius_mm: f64 = Optional, PositiveUpTo(1e5);
        /// From that stop to the entrance pupil, along the axis.
        window_distance_mm: f64 = Optional, PositiveUpTo(1e5);
        /// Radius of the entrance pupil; leave it out for half of optics.aperture_mm.
        pupil_radius_mm: f64 = Computed("half of optics.aperture_mm"), PositiveUpTo(1e5);
    }
}

impl IlluminationKeys {
    pub(super) fn check(&self, optics: &Optics, check: &mut Checker<'_>) -> Result<Illumination> {
        let blocked = self.blocked().check(check)?;
        let vignetting = self.vignetting(optics, check)?;
        Ok(Illumination { vignetting, cos4: self.cos4().check(check)?, unblocked: 1.0 - blocked })
    }

    fn vignetting(&self, optics: &Optics, check: &mut Checker<'_>) -> Result<Option<Vignetting>> {
        if !(self.window_radius_mm().is_given() && self.window_distance_mm().is_given()) {
            let both = "window_radius_mm and window_distance_mm together";
            self.refuse(&["window_radius_mm", "window_distance_mm", "pupil_radius_mm"], both, check)?;
            return Ok(None);
        }
        let window_radius_mm = self.window_radius_mm().check(check)?;
        let distance_mm = self.window_distance_mm().check(check)?;
        let pupil_radius_mm = self.pupil_radius_mm().or(0.5 * optics.aperture_mm).check(check)?;
        Ok(Some(Vignetting { window_radius_mm, pupil_radius_mm, distance_mm }))
    }
}
