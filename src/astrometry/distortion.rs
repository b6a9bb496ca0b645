//! Ideal (pinhole) coordinates <-> distorted coordinates: Brown-Conrady.
//!
//! With x = X/Z, y = Y/Z, r^2 = x^2 + y^2 (dimensionless):
//! x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + 2 p1 x y + p2 (r^2 + 2 x^2),
//! y' = y (1 + k1 r^2 + k2 r^4 + k3 r^6) + p1 (r^2 + 2 y^2) + 2 p2 x y
//! (Brown 1966, Photogrammetric Engineering 32, 444; signs and order as in OpenCV's calib3d).
//!
//! Domain. The Jacobian is symmetric: its radial part has eigenvalues f = 1 + k1 r^2 + k2 r^4 + k3 r^6 and
//! g = 1 + 3 k1 r^2 + 5 k2 r^4 + 7 k3 r^6, its tangential part has eigenvalues of at most 6 r hypot(p1, p2). Where
//! min(f, g) exceeds that bound it is positive definite, so on a disc x' is the gradient of a convex function and no
//! two directions share a pixel. [`Domain`] holds the largest such disc. Test: `domain_ends_where_the_model_folds`.

use glam::{DMat2, DVec2};

/// Largest ideal radius considered: tan(85 deg), beyond any pinhole camera.
const LARGEST_RADIUS: f64 = 11.43;
/// Steps of the search for the domain's end; the end itself is then bisected.
const SEARCH_STEPS: u32 = 4096;
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
    /// Distorted coordinates of ideal ones.
    #[must_use]
    pub fn distort(&self, ideal: DVec2) -> DVec2 {
        let DVec2 { x, y } = ideal;
        let r2 = ideal.length_squared();
        let tangential = DVec2::new(
            2.0 * self.p1 * x * y + self.p2 * (r2 + 2.0 * x * x),
            self.p1 * (r2 + 2.0 * y * y) + 2.0 * self.p2 * x * y,
        );
        ideal * self.scale(r2) + tangential
    }

    /// Derivative of [`Self::distort`]; symmetric.
    #[must_use]
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

    /// Lower bound of the Jacobian's smaller eigenvalue on the circle of radius `r`.
    fn least_stretch(&self, r: f64) -> f64 {
        let r2 = r * r;
        let radial = 1.0 + r2 * (3.0 * self.k1 + r2 * (5.0 * self.k2 + r2 * 7.0 * self.k3));
        radial.min(self.scale(r2)) - 6.0 * r * self.p1.hypot(self.p2)
    }
}

/// The disc of ideal coordinates on which the distortion is one-to-one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Domain {
    pub(super) radius: f64,
}

impl Domain {
    pub(super) fn of(model: &BrownConrady) -> Self {
        let at_step = |step: u32| LARGEST_RADIUS * f64::from(step) / f64::from(SEARCH_STEPS);
        let Some(first_bad) = (1..=SEARCH_STEPS).find(|&step| model.least_stretch(at_step(step)) <= 0.0) else {
            return Self { radius: LARGEST_RADIUS };
        };
        let (mut good, mut bad) = (at_step(first_bad - 1), at_step(first_bad));
        for _ in 0..HALVINGS {
            let middle = f64::midpoint(good, bad);
            if model.least_stretch(middle) > 0.0 { good = middle } else { bad = middle }
        }
        Self { radius: good }
    }

    pub(super) fn contains(&self, ideal: DVec2) -> bool {
        ideal.length_squared() <= self.radius * self.radius
    }

    /// Ideal coordinates that are distorted into `wanted`, by Newton's method with halved steps; `None` when none of
    /// the domain is.
    pub(super) fn undistort(&self, model: &BrownConrady, wanted: DVec2) -> Option<DVec2> {
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

    /// The first of the steps 1, 1/2, 1/4 ... that stays in the domain and comes nearer.
    fn shorter_step(
        &self,
        model: &BrownConrady,
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

#[cfg(test)]
mod tests {
    use super::*;

    const LENS: BrownConrady = BrownConrady { k1: -0.12, k2: 0.03, k3: -0.004, p1: 4e-4, p2: -3e-4 };

    fn disc(radius: f64) -> impl Iterator<Item = DVec2> {
        (0..400_u32).map(move |i| DVec2::from_angle(f64::from(i) * 2.399_963) * radius * (f64::from(i) / 399.0).sqrt())
    }

    #[test]
    fn undistort_inverts_distort_over_the_domain() {
        let domain = Domain::of(&LENS);
        for ideal in disc(0.99 * domain.radius) {
            let got = domain.undistort(&LENS, LENS.distort(ideal)).expect("inside the domain");
            // The inversion's residual divided by the least stretch at 99 % of the domain (a few per cent).
            assert!(got.distance(ideal) < 100.0 * INVERSION, "{got} for {ideal}");
        }
    }

    #[test]
    fn derivative_agrees_with_differences() {
        const H: f64 = 1e-6;
        for ideal in disc(0.8) {
            let column = |d: DVec2| (LENS.distort(ideal + d) - LENS.distort(ideal - d)) / (2.0 * H);
            let got = LENS.derivative(ideal);
            // Central differences: rounding 1e-16 / 1e-6, truncation 1e-12.
            assert!(got.x_axis.distance(column(DVec2::X * H)) < 1e-9, "{got}");
            assert!(got.y_axis.distance(column(DVec2::Y * H)) < 1e-9, "{got}");
        }
    }

    #[test]
    fn domain_ends_where_the_model_folds() {
        // x (1 - r^2 / 3) turns back at r = 1 (derivative 1 - r^2).
        let barrel = BrownConrady { k1: -1.0 / 3.0, ..Default::default() };
        let domain = Domain::of(&barrel);
        assert!((domain.radius - 1.0).abs() < 1e-9, "{}", domain.radius);
        assert!(domain.undistort(&barrel, DVec2::new(0.66, 0.0)).is_some(), "just inside 2/3");
        assert!(domain.undistort(&barrel, DVec2::new(0.67, 0.0)).is_none(), "no direction is imaged beyond 2/3");
        assert_eq!(Domain::of(&BrownConrady::default()).radius, LARGEST_RADIUS, "no distortion, no fold");
    }

    #[test]
    fn jacobian_is_positive_over_the_whole_domain() {
        let strong = BrownConrady { k1: -0.3, k2: 0.0, k3: 0.0, p1: 0.02, p2: -0.03 };
        let radius = Domain::of(&strong).radius;
        let worst = |r: f64| disc(r).map(|v| strong.derivative(v).determinant()).fold(f64::MAX, f64::min);
        assert!(worst(radius) > 0.0, "radius {radius}");
        assert!(worst(1.5 * radius) < 0.0, "control: it does fold further out");
    }
}
