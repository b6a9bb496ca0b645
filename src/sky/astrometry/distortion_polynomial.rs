//! Ideal (pinhole) coordinates -> distorted coordinates: a full polynomial in both, as a fit to stars gives it.
//!
//! With x = X/Z, y = Y/Z (dimensionless): x' = x + sum a_ij x^i y^j, y' = y + sum b_ij x^i y^j, 1 <= i + j <= 5. The
//! form is that of SIP (Shupe et al. 2005, ASP Conf. 347, 491), but from ideal to distorted and in focal lengths, not
//! pixels. Why not radial terms only: a fit to stars also finds decentring, tilt, anamorphism and shear, and a radial
//! polynomial of even powers is among these terms (test below). Odd powers of r have no derivative on the axis beyond
//! the first and are not offered. No constant: that is the principal point.
//!
//! Domain. On a disc whose Jacobian has a positive definite symmetric part no two directions share a pixel (the map is
//! strictly monotone there). Its smaller eigenvalue on a circle is taken at [`ANGLES`] places, less what it can fall
//! between two of them: every entry is a trigonometric polynomial in the angle, so its slope is bounded by the sum of
//! (n - 1) r^(n - 1) times the coefficients of degree n (times n). Tests: `distortion::tests`.

use glam::{DMat2, DVec2};

/// Highest sum of exponents.
pub const DEGREE: usize = 5;
/// Terms with 1 <= i + j <= [`DEGREE`].
const TERMS: usize = (DEGREE + 1) * (DEGREE + 2) / 2 - 1;
/// Places on a circle at which the Jacobian is evaluated.
const ANGLES: u32 = 1024;

/// Coefficients of one polynomial distortion, dimensionless. All zero: none.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PolynomialDistortion {
    /// Coefficients of x' and y', in the order of `exponents`.
    terms: [DVec2; TERMS],
}

impl Default for PolynomialDistortion {
    fn default() -> Self {
        Self { terms: [DVec2::ZERO; TERMS] }
    }
}

/// Exponents (i, j) of every term in order: x, y, x^2, x y, y^2, x^3 ...
fn exponents() -> impl Iterator<Item = (usize, usize)> {
    (1..=DEGREE).flat_map(|degree| (0..=degree).map(move |j| (degree - j, j)))
}

impl PolynomialDistortion {
    /// Adds `along_x` and `along_y` to the coefficients of x^i y^j; `None` when the polynomial lacks that term.
    #[must_use]
    pub fn with_term(mut self, i: usize, j: usize, along_x: f64, along_y: f64) -> Option<Self> {
        let at = exponents().position(|term| term == (i, j))?;
        self.terms[at] += DVec2::new(along_x, along_y);
        Some(self)
    }

    /// Returns every coefficient, for checks.
    pub fn coefficients(&self) -> impl Iterator<Item = f64> + '_ {
        self.terms.iter().flat_map(|term| term.to_array())
    }

    /// Returns the distorted coordinates of ideal ones.
    pub fn distort(&self, ideal: DVec2) -> DVec2 {
        let (x, y) = (powers(ideal.x), powers(ideal.y));
        let bends = exponents().zip(&self.terms).map(|((i, j), term)| *term * (x[i] * y[j]));
        ideal + bends.fold(DVec2::ZERO, |sum, bend| sum + bend)
    }

    /// Returns the derivative of [`Self::distort`]: columns by x and y; not symmetric in general.
    pub fn derivative(&self, ideal: DVec2) -> DMat2 {
        let (x, y) = (powers(ideal.x), powers(ideal.y));
        let mut columns = [DVec2::X, DVec2::Y];
        for ((i, j), term) in exponents().zip(&self.terms) {
            if i > 0 {
                columns[0] += *term * (i as f64 * x[i - 1] * y[j]);
            }
            if j > 0 {
                columns[1] += *term * (j as f64 * x[i] * y[j - 1]);
            }
        }
        DMat2::from_cols(columns[0], columns[1])
    }

    /// Returns the lower bound of the smaller eigenvalue of the Jacobian's symmetric part on the circle of radius `r`.
    pub(super) fn least_stretch(&self, r: f64) -> f64 {
        let step_rad = core::f64::consts::TAU / f64::from(ANGLES);
        let stretch = |k: u32| smaller_eigenvalue(&self.derivative(DVec2::from_angle(f64::from(k) * step_rad) * r));
        let least = (0..ANGLES).map(stretch).fold(f64::INFINITY, f64::min);
        least - 0.5 * step_rad * self.slope_along_circle(r)
    }

    /// Returns the bound of the change of the Jacobian (norm) per radian along the circle of radius `r`.
    fn slope_along_circle(&self, r: f64) -> f64 {
        let slope = |((i, j), term): ((usize, usize), &DVec2)| {
            let degree = (i + j) as f64;
            // d(x^i y^j) on the circle has norm degree r^(degree - 1) at most; Bernstein's inequality for its slope.
            term.length() * degree * (degree - 1.0) * r.powi((i + j) as i32 - 1)
        };
        exponents().zip(&self.terms).map(slope).sum()
    }
}

/// Returns 1, v, v^2 ... v^[`DEGREE`].
fn powers(v: f64) -> [f64; DEGREE + 1] {
    let mut powers = [1.0; DEGREE + 1];
    for n in 1..=DEGREE {
        powers[n] = powers[n - 1] * v;
    }
    powers
}

/// Returns the smaller eigenvalue of the symmetric part.
fn smaller_eigenvalue(m: &DMat2) -> f64 {
    let half_trace = 0.5 * (m.x_axis.x + m.y_axis.y);
    let half_difference = 0.5 * (m.x_axis.x - m.y_axis.y);
    half_trace - half_difference.hypot(0.5 * (m.x_axis.y + m.y_axis.x))
}
