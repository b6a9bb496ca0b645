//! The polynomial of `[distortion]`, and the refusal of a distortion that folds the image.

use crate::check::{Checker, Rule};
use crate::optics::{Distortion, Optics};
use crate::{detector::Detector, error::ConfigError, key::Given, key_type::Raw};
use sky::astrometry::{
    AstrometryError, BrownConrady, CameraGeometry, CameraParameters, DISTORTION_DEGREE, PolynomialDistortion,
};

/// Rows of exponents of x and y, and the coefficient of that term.
pub(super) type Terms = Vec<(usize, usize, f64)>;

/// Returns the polynomial of the terms along x and along y.
pub(super) fn check_polynomial(
    along: [Given<'_, Raw<Terms>>; 2],
    check: &Checker<'_>,
) -> Result<PolynomialDistortion, ConfigError> {
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
) -> Result<(), ConfigError> {
    let d = distortion;
    let parameters = CameraParameters {
        width_px: detector.width_px as usize,
        height_px: detector.height_px as usize,
        focal_px: [optics.focal_length_mm * 1e3 / detector.pixel_pitch_um; 2],
        principal_point_px: optics.principal_point_px,
        distortion: BrownConrady { k1: d.k1, k2: d.k2, k3: d.k3, p1: d.p1, p2: d.p2 },
    };
    let geometry = match d.polynomial {
        None => CameraGeometry::new(parameters),
        Some(polynomial) => CameraGeometry::with_polynomial(parameters, polynomial),
    };
    match geometry {
        Err(AstrometryError::DistortionFolds { limit_deg, x_px, y_px }) => {
            let got = format!("one-to-one only to {limit_deg:.2} deg off axis");
            let wanted = format!("a direction for every pixel, also for the corner at ({x_px}, {y_px}) px");
            let advice = "check signs and units of the coefficients: all are for lengths in focal lengths";
            Err(check.invalid("distortion", got, wanted, advice))
        }
        Ok(_) | Err(AstrometryError::Parameter { .. } | AstrometryError::TwoDistortions) => Ok(()),
    }
}
