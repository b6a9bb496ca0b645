//! Directions in sensor axes <-> pixels: pinhole with distortion.
//!
//! Sensor axes: +Z boresight, +X image right (columns), +Y image down (rows). Pixel coordinates: x right, y down, the
//! centre of the first pixel is (0, 0). x_px = cx + fx x', y_px = cy + fy y', with (x', y') the distorted (X/Z, Y/Z)
//! of [`Distortion`]. Limits: refraction, chromatic shift and a curved detector are not modelled.
//! Tests below: round trip to [`ROUND_TRIP_PX`], Jacobian against differences, domain; independent projection in
//! `tests/physics/apparent_places`.

use super::distortion::{BrownConrady, Distortion, Domain, PolynomialDistortion};
use glam::{DVec2, DVec3};

/// Largest image side accepted, px.
const LARGEST_SIDE_PX: f64 = 65_536.0;
/// Largest focal length accepted, px: 0.02 arcsec pixels.
const LARGEST_FOCAL_PX: f64 = 1e7;
/// Largest magnitude of a distortion coefficient accepted.
const LARGEST_COEFFICIENT: f64 = 1e6;

/// Parameters of a camera's geometry.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraParameters {
    /// Columns.
    pub width_px: usize,
    /// Rows.
    pub height_px: usize,
    /// Focal length over pixel pitch along columns and rows, px; equal for square pixels.
    pub focal_px: [f64; 2],
    /// Where the boresight falls, px; `((width - 1) / 2, (height - 1) / 2)` is the image's middle.
    pub principal_point_px: [f64; 2],
    /// Lens distortion; a polynomial is given apart ([`CameraGeometry::with_polynomial`]).
    pub distortion: BrownConrady,
}

/// A camera's geometry, checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraGeometry {
    parameters: CameraParameters,
    distortion: Distortion,
    domain: Domain,
    half_diagonal_rad: f64,
    is_distorted: bool,
}

impl CameraGeometry {
    /// Checks the parameters and finds the domain on which the distortion is one-to-one.
    ///
    /// # Errors
    /// When a number is out of range, or the image reaches beyond that domain.
    pub fn new(parameters: CameraParameters) -> Result<Self, AstrometryError> {
        check_parameters(&parameters)?;
        Self::with_distortion(parameters, Distortion::BrownConrady(parameters.distortion))
    }

    /// Returns the same with a polynomial in place of Brown and Conrady's distortion, which must be zero.
    ///
    /// # Errors
    /// As [`Self::new`], and when both models bend.
    pub fn with_polynomial(
        parameters: CameraParameters,
        polynomial: PolynomialDistortion,
    ) -> Result<Self, AstrometryError> {
        check_parameters(&parameters)?;
        if parameters.distortion != BrownConrady::default() {
            return Err(AstrometryError::TwoDistortions);
        }
        polynomial.coefficients().try_for_each(check_coefficient)?;
        Self::with_distortion(parameters, Distortion::Polynomial(polynomial))
    }

    fn with_distortion(parameters: CameraParameters, distortion: Distortion) -> Result<Self, AstrometryError> {
        let domain = Domain::of(&distortion);
        let is_distorted = !distortion.is_none();
        let mut camera = Self { parameters, distortion, domain, half_diagonal_rad: 0.0, is_distorted };
        for [x_px, y_px] in camera.corners_px() {
            let limit_deg = domain.radius.atan().to_degrees();
            let corner = camera.unproject([x_px, y_px]);
            let corner = corner.ok_or(AstrometryError::DistortionFolds { limit_deg, x_px, y_px })?;
            camera.half_diagonal_rad = camera.half_diagonal_rad.max(corner.angle_between(DVec3::Z));
        }
        Ok(camera)
    }

    /// Returns the parameters as given.
    pub fn parameters(&self) -> &CameraParameters {
        &self.parameters
    }

    /// Returns the lens's distortion, by whichever model.
    pub fn distortion(&self) -> &Distortion {
        &self.distortion
    }

    /// Columns.
    pub fn width_px(&self) -> usize {
        self.parameters.width_px
    }

    /// Returns the number of rows.
    pub fn height_px(&self) -> usize {
        self.parameters.height_px
    }

    /// Returns the angle of one pixel on the boresight, along columns and rows, rad.
    pub fn ifov_rad(&self) -> [f64; 2] {
        self.parameters.focal_px.map(|focal_px| 1.0 / focal_px)
    }

    /// Returns the largest angle between the boresight and a corner of the image, rad: the radius of the cone that
    /// holds it.
    pub fn half_diagonal_rad(&self) -> f64 {
        self.half_diagonal_rad
    }

    /// Returns the pixel coordinates of a direction (sensor axes, any length). `None` behind the camera, for a
    /// direction that is not finite, and beyond the domain of the distortion; pixels outside the image are given.
    pub fn project(&self, v_sensor: DVec3) -> Option<[f64; 2]> {
        self.ideal(v_sensor).map(|ideal| self.pixel(self.distortion.distort(ideal)))
    }

    /// Returns the unit direction in sensor axes of a pixel position; `None` where no direction of the domain is
    /// imaged.
    pub fn unproject(&self, px: [f64; 2]) -> Option<DVec3> {
        let ideal = self.tangent_of_pixel(px)?;
        Some(ideal.extend(1.0).normalize())
    }

    /// Returns the rate of the pixel position of a fixed star with the sensor's rotation: `[d x_px / d v, d y_px / d
    /// v]`, px/rad, `v` the rotation vector by which the sensor axes turn, in sensor axes (`Rotation::rotated_by`); the
    /// star's direction changes by -v x s. `None` as for [`Self::project`].
    pub fn jacobian(&self, v_sensor: DVec3) -> Option<[[f64; 3]; 2]> {
        let ideal = self.ideal(v_sensor)?;
        let DVec2 { x, y } = ideal;
        // With s = (x, y, 1): ds = s x v, then d(X/Z) = dX - x dZ and d(Y/Z) = dY - y dZ.
        let ideal_rates = [DVec2::new(x * y, 1.0 + y * y), DVec2::new(-1.0 - x * x, -x * y), DVec2::new(y, -x)];
        let derivative = self.distortion.derivative(ideal);
        let rates = ideal_rates.map(|rate| derivative * rate);
        let [fx, fy] = self.parameters.focal_px;
        Some([rates.map(|rate| fx * rate.x), rates.map(|rate| fy * rate.y)])
    }

    /// Tangents (X/Z, Y/Z) of a direction (sensor axes, any length); `None` as for [`Self::project`].
    #[inline]
    pub fn tangent(&self, v_sensor: DVec3) -> Option<DVec2> {
        self.ideal(v_sensor)
    }

    /// Returns the pixel coordinates of tangents, distorted; does not check them against the domain.
    #[inline]
    pub fn pixel_of_tangent(&self, tangent: DVec2) -> [f64; 2] {
        self.pixel(if self.is_distorted() { self.distortion.distort(tangent) } else { tangent })
    }

    /// Tangents of a pixel position; `None` where no direction of the domain is imaged.
    #[inline]
    pub fn tangent_of_pixel(&self, px: [f64; 2]) -> Option<DVec2> {
        let p = &self.parameters;
        let distorted = DVec2::from_array([0, 1].map(|i| (px[i] - p.principal_point_px[i]) / p.focal_px[i]));
        if self.is_distorted() {
            self.domain.undistort(&self.distortion, distorted)
        } else {
            (distorted.is_finite() && self.domain.contains(distorted)).then_some(distorted)
        }
    }

    /// Returns the derivative of the pixel coordinates by the tangents, px: rows x and y.
    #[inline]
    pub fn px_per_tangent(&self, tangent: DVec2) -> [[f64; 2]; 2] {
        let [fx, fy] = self.parameters.focal_px;
        if !self.is_distorted() {
            return [[fx, 0.0], [0.0, fy]];
        }
        let derivative = self.distortion.derivative(tangent);
        [[fx * derivative.x_axis.x, fx * derivative.y_axis.x], [fy * derivative.x_axis.y, fy * derivative.y_axis.y]]
    }

    /// Returns the largest tangent of the angle to the boresight that is imaged.
    pub fn largest_tangent(&self) -> f64 {
        self.domain.radius
    }

    /// Returns whether the lens distorts.
    #[inline]
    pub fn is_distorted(&self) -> bool {
        self.is_distorted
    }

    #[inline]
    fn ideal(&self, v_sensor: DVec3) -> Option<DVec2> {
        let ideal = v_sensor.truncate() / v_sensor.z;
        (v_sensor.z > 0.0 && ideal.is_finite() && self.domain.contains(ideal)).then_some(ideal)
    }

    #[inline]
    fn pixel(&self, distorted: DVec2) -> [f64; 2] {
        let p = &self.parameters;
        [0, 1].map(|i| p.principal_point_px[i] + p.focal_px[i] * distorted[i])
    }

    /// Returns the outer corners of the corner pixels.
    fn corners_px(&self) -> [[f64; 2]; 4] {
        let [right, bottom] = [self.parameters.width_px, self.parameters.height_px].map(|side| side as f64 - 0.5);
        [[-0.5, -0.5], [right, -0.5], [-0.5, bottom], [right, bottom]]
    }
}

fn check_parameters(p: &CameraParameters) -> Result<(), AstrometryError> {
    let check = |parameter, wanted, low: f64, high: f64, got: f64| {
        let good = (low..=high).contains(&got);
        if good { Ok(()) } else { Err(AstrometryError::Parameter { parameter, wanted, got }) }
    };
    check("width_px", "1..65536", 1.0, LARGEST_SIDE_PX, p.width_px as f64)?;
    check("height_px", "1..65536", 1.0, LARGEST_SIDE_PX, p.height_px as f64)?;
    for focal_px in p.focal_px {
        check("focal_px", "1..1e7", 1.0, LARGEST_FOCAL_PX, focal_px)?;
    }
    for px in p.principal_point_px {
        check("principal_point_px", "-65536..131072", -LARGEST_SIDE_PX, 2.0 * LARGEST_SIDE_PX, px)?;
    }
    let BrownConrady { k1, k2, k3, p1, p2 } = p.distortion;
    [k1, k2, k3, p1, p2].into_iter().try_for_each(check_coefficient)
}

fn check_coefficient(got: f64) -> Result<(), AstrometryError> {
    let good = (-LARGEST_COEFFICIENT..=LARGEST_COEFFICIENT).contains(&got);
    let (parameter, wanted) = ("distortion coefficient", "-1e6..1e6");
    if good { Ok(()) } else { Err(AstrometryError::Parameter { parameter, wanted, got }) }
}

/// A pixel position split so that single precision keeps its fraction: `column + fraction_x`, `row + fraction_y`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelPosition {
    /// Nearest column; may lie outside the image.
    pub column: i32,
    /// Nearest row; may lie outside the image.
    pub row: i32,
    /// Remainder along columns, -0.5 (included) to 0.5, px.
    pub fraction_x: f32,
    /// Remainder along rows, -0.5 (included) to 0.5, px.
    pub fraction_y: f32,
}

impl PixelPosition {
    /// Splits pixel coordinates; `None` when not finite or beyond the range of `i32`.
    pub fn split(px: [f64; 2]) -> Option<Self> {
        let (column, fraction_x) = split_one(px[0])?;
        let (row, fraction_y) = split_one(px[1])?;
        Some(Self { column, row, fraction_x, fraction_y })
    }

    /// Returns the whole position, px.
    pub fn px(&self) -> [f64; 2] {
        [f64::from(self.column) + f64::from(self.fraction_x), f64::from(self.row) + f64::from(self.fraction_y)]
    }
}

#[allow(
    clippy::cast_possible_truncation,
    reason = "the range is checked; the fraction is meant to be single precision"
)]
fn split_one(px: f64) -> Option<(i32, f32)> {
    let whole = (px + 0.5).floor();
    let fraction = (px - whole) as f32;
    if whole.abs() >= f64::from(i32::MAX) || !px.is_finite() {
        return None;
    }
    // A fraction just below 0.5 rounds to 0.5 in single precision: it belongs to the next pixel.
    if fraction >= 0.5 { Some((whole as i32 + 1, fraction - 1.0)) } else { Some((whole as i32, fraction)) }
}

/// Why a camera geometry was refused.
#[derive(Debug, thiserror::Error, PartialEq)]
pub enum AstrometryError {
    /// A number is out of range or not finite.
    #[error("camera geometry: {parameter} wanted {wanted}, got {got}")]
    Parameter {
        /// Name of the parameter, with its unit.
        parameter: &'static str,
        /// Accepted range.
        wanted: &'static str,
        /// Value given.
        got: f64,
    },
    /// The distortion model folds over inside the image.
    #[error(
        "camera geometry: distortion is one-to-one only to {limit_deg:.2} deg off axis and no direction reaches the image corner at ({x_px}, {y_px}) px; check signs and units of the coefficients (k1, k2, k3, p1, p2, or the polynomial's: all for lengths in focal lengths)"
    )]
    DistortionFolds {
        /// Off-axis angle to which the model may be used, deg.
        limit_deg: f64,
        /// Column of the corner, px.
        x_px: f64,
        /// Row of the corner, px.
        y_px: f64,
    },
    /// Two models of distortion at once.
    #[error(
        "camera geometry: wanted one model of distortion, got Brown and Conrady's coefficients and a polynomial; put their terms into the polynomial"
    )]
    TwoDistortions,
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::axes::{Icrf, Rotation, Sensor};
    use base::units::DEG;

    /// Inversion to 1e-12 of a focal length of 3000 px, over the model's least stretch (above 0.5 here).
    const ROUND_TRIP_PX: f64 = 1e-8;

    fn parameters() -> CameraParameters {
        CameraParameters {
            width_px: 1024,
            height_px: 768,
            focal_px: [2950.0, 2960.0],
            principal_point_px: [515.25, 380.5],
            distortion: BrownConrady { k1: -0.2, k2: 0.15, k3: 0.01, p1: 5e-4, p2: -2e-4 },
        }
    }

    fn camera() -> CameraGeometry {
        CameraGeometry::new(parameters()).expect("a valid camera")
    }

    /// Returns the same with a polynomial that bends as much, lopsidedly.
    fn polynomial_camera() -> CameraGeometry {
        let terms = [(1, 0, 1e-3, 2e-3), (1, 1, 2e-3, 1e-3), (3, 0, -0.2, 0.0), (1, 2, -0.2, 0.01), (2, 1, 0.02, -0.2)];
        let with = |model: PolynomialDistortion, (i, j, a, b)| model.with_term(i, j, a, b).expect("a term");
        let model = terms.into_iter().chain([(0, 3, 0.0, -0.2), (4, 1, 0.1, 0.2)]).fold(Default::default(), with);
        let plain = CameraParameters { distortion: BrownConrady::default(), ..parameters() };
        CameraGeometry::with_polynomial(plain, model).expect("a valid camera")
    }

    fn grid() -> impl Iterator<Item = [f64; 2]> {
        (0..=16).flat_map(|i| (0..=12).map(move |j| [-0.5 + 64.0 * f64::from(i), -0.5 + 64.0 * f64::from(j)]))
    }

    #[test]
    fn project_undoes_unproject() {
        for camera in [camera(), polynomial_camera()] {
            for px in grid() {
                let direction = camera.unproject(px).expect("inside the image");
                let [x, y] = camera.project(direction * 7.0).expect("inside the image");
                assert!((x - px[0]).hypot(y - px[1]) < ROUND_TRIP_PX, "({x}, {y}) for {px:?}");
                assert!(direction.angle_between(DVec3::Z) <= camera.half_diagonal_rad() + 1e-12, "{px:?}");
            }
        }
    }

    #[test]
    fn right_is_plus_x_and_down_is_plus_y() {
        let plain = CameraGeometry::new(CameraParameters { distortion: BrownConrady::default(), ..parameters() });
        let plain = plain.expect("a valid camera");
        assert_eq!(plain.project(DVec3::Z), Some([515.25, 380.5]), "the boresight falls on the principal point");
        assert_eq!(plain.project(DVec3::new(0.1, 0.0, 1.0)), Some([515.25 + 295.0, 380.5]));
        assert_eq!(plain.project(DVec3::new(0.0, 0.1, 1.0)), Some([515.25, 380.5 + 296.0]));
        let corner_rad = ((515.75_f64 / 2950.0).hypot(387.0 / 2960.0)).atan();
        assert!((plain.half_diagonal_rad() - corner_rad).abs() < 2e-3, "{} deg", plain.half_diagonal_rad() / DEG);
    }

    #[test]
    fn jacobian_agrees_with_a_turned_sensor() {
        const H_RAD: f64 = 1e-6;
        for (camera, px) in [camera(), polynomial_camera()].iter().flat_map(|camera| grid().map(move |px| (camera, px)))
        {
            let star = camera.unproject(px).expect("inside the image");
            let jacobian = camera.jacobian(star * 2.0).expect("inside the image");
            for (axis, v) in [DVec3::X, DVec3::Y, DVec3::Z].into_iter().enumerate() {
                let seen = |h: f64| {
                    let turned = Rotation::<Sensor, Icrf>::IDENTITY.rotated_by(v * h);
                    camera.project(turned.apply(star)).expect("near the image")
                };
                let (after, before) = (seen(H_RAD), seen(-H_RAD));
                for i in 0..2 {
                    let wanted = (after[i] - before[i]) / (2.0 * H_RAD);
                    // Rounding of ~1e-13 px x 1000 over 2e-6 rad, against slopes of 3000 px/rad.
                    assert!((jacobian[i][axis] - wanted).abs() < 1e-3, "{px:?} axis {axis}: {jacobian:?} {wanted}");
                }
            }
        }
    }

    #[test]
    fn nothing_behind_or_beyond_the_domain_is_projected() {
        let camera = camera();
        let bad = [DVec3::NEG_Z, DVec3::X, DVec3::ZERO, DVec3::NAN, DVec3::new(f64::INFINITY, 0.0, 1.0)];
        for v in bad {
            assert_eq!(camera.project(v), None, "{v}");
            assert_eq!(camera.jacobian(v), None, "{v}");
        }
        let fold = BrownConrady { k1: -1.0 / 3.0, ..Default::default() };
        let folding =
            CameraGeometry::new(CameraParameters { distortion: fold, ..parameters() }).expect("folds at 45 deg");
        assert!(folding.project(DVec3::new(0.99, 0.0, 1.0)).is_some(), "inside");
        assert_eq!(folding.project(DVec3::new(1.01, 0.0, 1.0)), None, "a second direction on the same pixel");
        assert_eq!(folding.unproject([515.25 + 0.67 * 2950.0, 380.5]), None, "no direction there");
        assert_eq!(folding.unproject([f64::NAN, 0.0]), None, "not a number");
    }

    #[test]
    fn bad_parameters_are_named() {
        let refuse = |p| CameraGeometry::new(p).expect_err("a bad camera").to_string();
        let focal = refuse(CameraParameters { focal_px: [f64::NAN, 1.0], ..parameters() });
        assert!(focal.contains("focal_px wanted 1..1e7, got NaN"), "{focal}");
        let fold = BrownConrady { k1: -20.0, ..Default::default() };
        let fold = refuse(CameraParameters { distortion: fold, ..parameters() });
        assert!(fold.contains("one-to-one only to 7.3") && fold.contains("-0.5"), "{fold}");
        assert!(refuse(CameraParameters { width_px: 0, ..parameters() }).contains("width_px"), "no columns");
        let both = CameraGeometry::with_polynomial(parameters(), PolynomialDistortion::default());
        assert_eq!(both, Err(AstrometryError::TwoDistortions));
        let plain = CameraParameters { distortion: BrownConrady::default(), ..parameters() };
        let wild = PolynomialDistortion::default().with_term(2, 0, f64::NAN, 0.0).expect("a term");
        let wild = CameraGeometry::with_polynomial(plain, wild).expect_err("not a number").to_string();
        assert!(wild.contains("distortion coefficient wanted -1e6..1e6, got NaN"), "{wild}");
    }

    #[test]
    fn fractions_stay_half_open() {
        for (px, column, fraction) in
            [(3.5, 4, -0.5), (3.499, 3, 0.499), (-0.5, 0, -0.5), (-0.6, -1, 0.4), (0.0, 0, 0.0)]
        {
            let got = PixelPosition::split([px, 0.0]).expect("finite");
            assert_eq!(got.column, column, "{px}");
            assert!((got.fraction_x - fraction).abs() < 1e-6, "{px}: {got:?}");
        }
        let edge = PixelPosition::split([0.499_999_999, 10_000.123_456_7]).expect("finite");
        assert_eq!((edge.column, edge.fraction_x), (1, -0.5), "rounds up to the next pixel, not to +0.5");
        assert!((edge.px()[1] - 10_000.123_456_7).abs() < 1e-8, "f32 of a fraction keeps 3e-8 px: {edge:?}");
        for px in [f64::NAN, f64::INFINITY, 1e10, -1e10] {
            assert_eq!(PixelPosition::split([0.0, px]), None, "{px}");
        }
    }
}
