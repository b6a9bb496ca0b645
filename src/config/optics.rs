//! `[optics]`, `[distortion]`.

use crate::check::{Checker, Rule};
use crate::distortion::{Terms, check_polynomial};
use crate::key::{Given, Section, section};
use crate::key_type::{Numbers, Raw, Shape, Word};
use crate::{detector::Detector, error::ConfigError};
use sky::astrometry::PolynomialDistortion;

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

    pub(super) fn check(keys: &OpticsKeys, detector: &Detector, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        let focal_length_mm = keys.focal_length_mm().check(check)?;
        let aperture_mm = keys.aperture_mm().or(focal_length_mm / DEFAULT_F_NUMBER).check(check)?;
        let obscuration = keys.obscuration().check(check)?;
        let transmission = keys.transmission().check(check)?;
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
fn principal_point(
    given: &Given<'_, [f64; 2]>,
    centre: [f64; 2],
    check: &mut Checker<'_>,
) -> Result<[f64; 2], ConfigError> {
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
    /// Reads the distortion; zero without keys. Coefficients must be finite and small enough to be a lens.
    pub(super) fn check(keys: &DistortionKeys, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        let IsPolynomial(is_polynomial) = keys.model().check(check)?;
        let polynomial = if is_polynomial {
            keys.refuse(&["k1", "k2", "k3", "p1", "p2"], "model = \"brown-conrady\"", check)?;
            Some(check_polynomial([keys.x(), keys.y()], check)?)
        } else {
            keys.refuse(&["x", "y"], "model = \"polynomial\"", check)?;
            None
        };
        Ok(Self {
            k1: keys.k1().check(check)?,
            k2: keys.k2().check(check)?,
            k3: keys.k3().check(check)?,
            p1: keys.p1().check(check)?,
            p2: keys.p2().check(check)?,
            polynomial,
        })
    }
}
