//! The polynomial of `[distortion]`.

use crate::check::{Checker, Rule};
use crate::error::ConfigError;
use crate::key::Given;
use crate::key_type::Raw;
use sky::astrometry::{DISTORTION_DEGREE, PolynomialDistortion};

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
