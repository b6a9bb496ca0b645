//! Ideal (pinhole) coordinates <-> distorted coordinates: Brown-Conrady, or a polynomial
//! ([`crate::astrometry::PolynomialDistortion`]).
//!
//! Brown-Conrady: with x = X/Z, y = Y/Z, r^2 = x^2 + y^2 (dimensionless): x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1
//! x y + p2 (r^2 + 2 x^2), y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y (Brown 1966,
//! Photogrammetric Engineering 32, 444; signs and order as in OpenCV's calib3d).
//!
//! Domain. The Jacobian is symmetric: its radial part has eigenvalues f = 1 + k1 r^2 + k2 r^4 + k3 r^6 and g = 1 + 3 k1
//! r^2 + 5 k2 r^4 + 7 k3 r^6, its tangential part has eigenvalues of at most 6 r hypot(p1, p2). Where min(f, g) exceeds
//! that bound it is positive definite, so on a disc x' is the gradient of a convex function and no two directions share
//! a pixel. [`Domain`] holds the largest such disc. Test: `domain_ends_where_the_model_folds`.
//!
//! *Polynomial.* Ideal (pinhole) coordinates -> distorted coordinates: a full polynomial in both, as a fit to stars
//! gives it.
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

use base::bisection::halved;
use glam::{DMat2, DVec2};

/// Largest ideal radius considered: tan(85 deg), beyond any pinhole camera.
const LARGEST_RADIUS: f64 = 11.43;
/// Steps of the search for the domain's end; the end itself is then bisected.
const SEARCH_STEPS: u32 = 4096;
/// Steps per octave, and octaves, of the same search for a polynomial: its terms may bite at any radius, and each step
/// takes a whole circle. The smallest radius is 2^-20 of the largest: 2 arcsec.
const STEPS_PER_OCTAVE: u32 = 16;
const OCTAVES: u32 = 20;
/// Halvings of the bisection: LARGEST_RADIUS / 4096 / 2^40 is 2.5e-15.
const HALVINGS: u32 = 40;
/// Newton steps before giving up; three or four suffice for real lenses.
const NEWTON_STEPS: u32 = 50;
/// Residual of the inversion, dimensionless: 1e-12 of a focal length is 2e-7 arcsec.
pub(super) const INVERSION: f64 = 1e-12;

/// Coefficients of the distortion, dimensionless (lengths in focal lengths). All zero: none.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BrownConrady {
    /// Radial, r^3.
    pub k1: f64,
    /// Radial, r^5.
    pub k2: f64,
    /// Radial, r^7.
    pub k3: f64,
    /// Tangential, mainly along y.
    pub p1: f64,
    /// Tangential, mainly along x.
    pub p2: f64,
}

impl BrownConrady {
    /// Returns the distorted coordinates of ideal ones.
    pub fn distort(&self, ideal: DVec2) -> DVec2 {
        let DVec2 { x, y } = ideal;
        let r2 = ideal.length_squared();
        let tangential = DVec2::new(
            2.0 * self.p1 * x * y + self.p2 * (r2 + 2.0 * x * x),
            self.p1 * (r2 + 2.0 * y * y) + 2.0 * self.p2 * x * y,
        );
        ideal * self.scale(r2) + tangential
    }

    /// Returns the derivative of [`Self::distort`]; symmetric.
    pub fn derivative(&self, ideal: DVec2) -> DMat2 {
        let DVec2 { x, y } = ideal;
        let r2 = ideal.length_squared();
        // d(scale)/d(r^2), doubled: the radial term's outer product.
        let slope = 2.0 * (self.k1 + r2 * (2.0 * self.k2 + r2 * 3.0 * self.k3));
        let scale = self.scale(r2);
        let xx = scale + slope * x * x + 2.0 * self.p1 * y + 6.0 * self.p2 * x;
        let yy = scale + slope * y * y + 6.0 * self.p1 * y + 2.0 * self.p2 * x;
        let xy = slope * x * y + 2.0 * (self.p1 * x + self.p2 * y);
        DMat2::from_cols(DVec2::new(xx, xy), DVec2::new(xy, yy))
    }

    fn scale(&self, r2: f64) -> f64 {
        1.0 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))
    }

    /// Returns the lower bound of the Jacobian's smaller eigenvalue on the circle of radius `r`.
    fn least_stretch(&self, r: f64) -> f64 {
        let r2 = r * r;
        let radial = 1.0 + r2 * (3.0 * self.k1 + r2 * (5.0 * self.k2 + r2 * 7.0 * self.k3));
        radial.min(self.scale(r2)) - 6.0 * r * self.p1.hypot(self.p2)
    }
}

/// A lens's distortion, by one model or another.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "a camera is copied whole; one lens is not worth a heap")]
pub enum Distortion {
    /// Radial and tangential terms.
    BrownConrady(BrownConrady),
    /// A full polynomial.
    Polynomial(PolynomialDistortion),
}

impl Distortion {
    /// Returns the distorted coordinates of ideal ones.
    pub fn distort(&self, ideal: DVec2) -> DVec2 {
        match self {
            Self::BrownConrady(model) => model.distort(ideal),
            Self::Polynomial(model) => model.distort(ideal),
        }
    }

    /// Returns the derivative of [`Self::distort`]: columns by x and y.
    pub fn derivative(&self, ideal: DVec2) -> DMat2 {
        match self {
            Self::BrownConrady(model) => model.derivative(ideal),
            Self::Polynomial(model) => model.derivative(ideal),
        }
    }

    /// Returns whether it bends nothing.
    pub fn is_none(&self) -> bool {
        match self {
            Self::BrownConrady(model) => *model == BrownConrady::default(),
            Self::Polynomial(model) => *model == PolynomialDistortion::default(),
        }
    }

    /// Returns the lower bound of the Jacobian's stretch in any direction, on the circle of radius `r`.
    fn least_stretch(&self, r: f64) -> f64 {
        match self {
            Self::BrownConrady(model) => model.least_stretch(r),
            Self::Polynomial(model) => model.least_stretch(r),
        }
    }

    /// Returns the radii at which the end of the domain is looked for, from small to large.
    fn search_radius(&self, step: u32) -> Option<f64> {
        match self {
            Self::BrownConrady(_) if step <= SEARCH_STEPS => {
                Some(LARGEST_RADIUS * f64::from(step) / f64::from(SEARCH_STEPS))
            }
            Self::Polynomial(_) if step <= OCTAVES * STEPS_PER_OCTAVE => {
                let down = f64::from(OCTAVES * STEPS_PER_OCTAVE - step) / f64::from(STEPS_PER_OCTAVE);
                Some(LARGEST_RADIUS * (-down).exp2())
            }
            Self::BrownConrady(_) | Self::Polynomial(_) => None,
        }
    }
}

/// The disc of ideal coordinates on which the distortion is one-to-one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Domain {
    pub(super) radius: f64,
}

impl Domain {
    pub(super) fn of(model: &Distortion) -> Self {
        if model.is_none() {
            return Self { radius: LARGEST_RADIUS };
        }
        let mut radii = (1..).map_while(|step| model.search_radius(step));
        let mut good = 0.0;
        // A stretch that is not a number ends the search too.
        let bad = radii.find(|&r| {
            let is_good = model.least_stretch(r) > 0.0;
            if is_good {
                good = r;
            }
            !is_good
        });
        let Some(bad) = bad else { return Self { radius: LARGEST_RADIUS } };
        let [radius, _] = halved([good, bad], HALVINGS, |r| model.least_stretch(r) > 0.0);
        Self { radius }
    }

    #[inline]
    pub(super) fn contains(&self, ideal: DVec2) -> bool {
        ideal.length_squared() <= self.radius * self.radius
    }

    /// Returns the ideal coordinates that are distorted into `wanted`, by Newton's method with halved steps; `None`
    /// when none of the domain is.
    pub(super) fn undistort(&self, model: &Distortion, wanted: DVec2) -> Option<DVec2> {
        let mut ideal = wanted.clamp_length_max(self.radius);
        let mut residual = model.distort(ideal) - wanted;
        for _ in 0..NEWTON_STEPS {
            if residual.length() <= INVERSION * (1.0 + wanted.length()) {
                return Some(ideal);
            }
            let step = model.derivative(ideal).inverse() * residual;
            (ideal, residual) = self.shorter_step(model, wanted, ideal, step, residual.length())?;
        }
        None
    }

    /// Returns the first of the steps 1, 1/2, 1/4 ... that stays in the domain and comes nearer.
    fn shorter_step(
        &self,
        model: &Distortion,
        wanted: DVec2,
        from: DVec2,
        step: DVec2,
        far: f64,
    ) -> Option<(DVec2, DVec2)> {
        (0..HALVINGS).find_map(|halvings| {
            let ideal = from - step * 0.5_f64.powi(halvings.cast_signed());
            let residual = model.distort(ideal) - wanted;
            (self.contains(ideal) && residual.length() < far).then_some((ideal, residual))
        })
    }
}

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

#[cfg(test)]
mod tests {
    use super::*;

    const LENS: BrownConrady = BrownConrady { k1: -0.12, k2: 0.03, k3: -0.004, p1: 4e-4, p2: -3e-4 };

    fn brown(model: BrownConrady) -> Distortion {
        Distortion::BrownConrady(model)
    }

    fn polynomial(terms: &[(usize, usize, f64, f64)]) -> Distortion {
        let with = |model: PolynomialDistortion, &(i, j, a, b): &(usize, usize, f64, f64)| {
            model.with_term(i, j, a, b).expect("a term")
        };
        Distortion::Polynomial(terms.iter().fold(PolynomialDistortion::default(), with))
    }

    /// Returns all that a polynomial can bend: scale and shear, tilt, barrel, something lopsided of degree five.
    fn bent() -> Distortion {
        polynomial(&[
            (1, 0, 2e-3, -1e-3),
            (0, 1, 1.5e-3, -1e-3),
            (2, 0, 3e-3, 1e-3),
            (1, 1, -2e-3, 4e-3),
            (3, 0, -0.1, 0.01),
            (1, 2, -0.1, 0.0),
            (2, 1, 0.0, -0.1),
            (0, 3, -0.02, -0.1),
            (4, 0, 0.02, 0.0),
            (2, 3, 0.03, 0.05),
            (5, 0, 0.04, -0.02),
        ])
    }

    fn disc(radius: f64) -> impl Iterator<Item = DVec2> {
        (0..400_u32).map(move |i| DVec2::from_angle(f64::from(i) * 2.399_963) * radius * (f64::from(i) / 399.0).sqrt())
    }

    #[test]
    fn undistort_inverts_distort_over_the_domain() {
        for model in [brown(LENS), bent()] {
            let domain = Domain::of(&model);
            assert!(domain.radius > 0.5, "{domain:?}");
            for ideal in disc(0.99 * domain.radius) {
                let got = domain.undistort(&model, model.distort(ideal)).expect("inside the domain");
                // The inversion's residual divided by the least stretch at 99 % of the domain (a few per cent).
                assert!(got.distance(ideal) < 100.0 * INVERSION, "{got} for {ideal}");
            }
        }
    }

    #[test]
    fn derivative_agrees_with_differences() {
        const H: f64 = 1e-6;
        for model in [brown(LENS), bent()] {
            for ideal in disc(0.8) {
                let column = |d: DVec2| (model.distort(ideal + d) - model.distort(ideal - d)) / (2.0 * H);
                let got = model.derivative(ideal);
                // Central differences: rounding 1e-16 / 1e-6, truncation 1e-12.
                assert!(got.x_axis.distance(column(DVec2::X * H)) < 1e-9, "{got}");
                assert!(got.y_axis.distance(column(DVec2::Y * H)) < 1e-9, "{got}");
            }
        }
    }

    #[test]
    fn domain_ends_where_the_model_folds() {
        // x (1 - r^2 / 3) turns back at r = 1 (derivative 1 - r^2), whichever model says it.
        let barrel = brown(BrownConrady { k1: -1.0 / 3.0, ..Default::default() });
        let cubic = polynomial(&[
            (3, 0, -1.0 / 3.0, 0.0),
            (1, 2, -1.0 / 3.0, 0.0),
            (2, 1, 0.0, -1.0 / 3.0),
            (0, 3, 0.0, -1.0 / 3.0),
        ]);
        for (model, margin) in [(barrel, 1e-9), (cubic, 0.02)] {
            let domain = Domain::of(&model);
            // The margin for places between two samples of the circle is taken off a polynomial's radius.
            assert!(domain.radius < 1.0 + 1e-9 && domain.radius > 1.0 - margin, "{}", domain.radius);
            assert!(domain.undistort(&model, DVec2::new(0.66, 0.0)).is_some(), "just inside 2/3");
            assert!(domain.undistort(&model, DVec2::new(0.67, 0.0)).is_none(), "no direction is imaged beyond 2/3");
        }
        for none in [brown(BrownConrady::default()), polynomial(&[])] {
            assert_eq!(Domain::of(&none).radius, LARGEST_RADIUS, "no distortion, no fold");
        }
    }

    #[test]
    fn jacobian_is_positive_over_the_whole_domain() {
        let strong = brown(BrownConrady { k1: -0.3, k2: 0.0, k3: 0.0, p1: 0.02, p2: -0.03 });
        // A fold on one side only, between the axes: circles must be searched all around.
        let lopsided = polynomial(&[(2, 0, 0.1, 0.3), (1, 1, 0.4, 0.2), (0, 3, 0.2, -0.3)]);
        for model in [strong, lopsided] {
            let radius = Domain::of(&model).radius;
            let worst = |r: f64| disc(r).map(|v| model.derivative(v).determinant()).fold(f64::MAX, f64::min);
            assert!(worst(radius) > 0.0, "radius {radius}");
            assert!(worst(2.0 * radius) < 0.0, "control: it does fold further out than {radius}");
        }
    }

    #[test]
    fn brown_conrady_without_its_sixth_order_is_a_polynomial() {
        let BrownConrady { k1, k2, p1, p2, .. } = LENS;
        let same = polynomial(&[
            (3, 0, k1, 0.0),
            (1, 2, k1, 0.0),
            (2, 1, 0.0, k1),
            (0, 3, 0.0, k1),
            (5, 0, k2, 0.0),
            (3, 2, 2.0 * k2, 0.0),
            (1, 4, k2, 0.0),
            (4, 1, 0.0, k2),
            (2, 3, 0.0, 2.0 * k2),
            (0, 5, 0.0, k2),
            (1, 1, 2.0 * p1, 2.0 * p2),
            (2, 0, 3.0 * p2, p1),
            (0, 2, p2, 3.0 * p1),
        ]);
        let lens = brown(BrownConrady { k3: 0.0, ..LENS });
        for ideal in disc(0.8) {
            assert!(lens.distort(ideal).distance(same.distort(ideal)) < 1e-15, "{ideal}");
        }
        assert!(brown(LENS).distort(DVec2::X).distance(same.distort(DVec2::X)) > 1e-3, "control: k3 shows");
    }

    #[test]
    fn terms_out_of_range_are_refused() {
        for (i, j) in [(0, 0), (6, 0), (3, 3)] {
            assert_eq!(PolynomialDistortion::default().with_term(i, j, 1.0, 0.0), None, "x^{i} y^{j}");
        }
        assert!(PolynomialDistortion::default().with_term(0, 5, 1.0, 0.0).is_some(), "degree five is the last");
    }
}
