//! Directions in a tracker's axes <-> pixels of the display it looks at.
//!
//! The map of a flat display, seen through a lens that maps straight lines to straight lines, is a homography: with the
//! direction v = (X, Y, Z), pixel (x, y, 1) ~ H v. Every such H is K R, a camera matrix times a rotation (Hartley and
//! Zisserman, Multiple View Geometry, 2nd ed. 2004, section 6.2.4: Gram and Schmidt from the last row). So **a
//! calibrated display is a camera that the renderer draws with**: turn the directions by R, then project with K's focal
//! lengths and principal point; K's shear, and what the lens bends, are terms of [`PolynomialDistortion`] (degree 5 at
//! most, of tangents in R's axes, dimensionless). Stars are drawn at their moved centroids; no image is resampled.
//!
//! Exactness: the camera evaluates the very polynomial that was fitted, so camera and calibration differ by rounding
//! only, below [`CAMERA_PX`] display px; the way back is a Newton iteration to 1e-12 of a focal length. A mirror
//! between display and tracker cannot be a rotation: [`DisplayGeometry::mirrored`] then says that columns are shown in
//! reverse order. Limits: a polynomial says nothing beyond the dots it was fitted to ([`DisplayGeometry::covered`]).
//! Tests: below, and `tests/physics/display_calibration` against a simulated collimator that shares no code.

use crate::display::flat_field::Covered;
use base::axes::{Rotation, Sensor};
use base::units::ARCSEC;
use glam::{DMat3, DQuat, DVec3};
use serde::{Deserialize, Serialize};
use sky::astrometry::{AstrometryError, CameraGeometry, CameraParameters, PolynomialDistortion};

/// Bound of the difference between a camera made here and the fitted map, display px: rounding of 50 terms at 1e5 px.
pub const CAMERA_PX: f64 = 1e-8;
/// Longest side of a display, px.
pub const LARGEST_SIDE_PX: usize = 16_384;

/// Numbers of a display's geometry, as a calibration file holds them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GeometryParameters {
    /// Whether the tracker sees the display mirrored: columns are then shown in reverse order.
    pub mirrored: bool,
    /// Rotation of drawn axes from the tracker's sensor axes, quaternion w x y z.
    pub drawn_from_sensor: [f64; 4],
    /// Focal lengths along columns and rows, display px.
    pub focal_px: [f64; 2],
    /// Display pixel of the drawn axes' +Z, px.
    pub principal_point_px: [f64; 2],
    /// Highest degree of the polynomial.
    pub degree: usize,
    /// Terms: exponent of x, exponent of y, coefficient along x, coefficient along y.
    pub terms: Vec<(usize, usize, f64, f64)>,
    /// Corners of the area within the outermost of the dots fitted to, display px.
    pub covered_px: Vec<[f64; 2]>,
}

/// A display's geometry, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct DisplayGeometry {
    camera: CameraGeometry,
    drawn_from_sensor: Rotation<Sensor, Sensor>,
    mirrored: bool,
    covered: Covered,
}

impl DisplayGeometry {
    /// Checks the numbers for a display of so many columns and rows.
    ///
    /// # Errors
    /// When a number is out of range, a term is none, or the map folds over on the display.
    pub fn new(parameters: &GeometryParameters, [width_px, height_px]: [usize; 2]) -> Result<Self, AstrometryError> {
        let refuse = |parameter, wanted, got| Err(AstrometryError::Parameter { parameter, wanted, got });
        let turn = Rotation::from_wxyz(parameters.drawn_from_sensor, 1e-9);
        let Some(drawn_from_sensor) = turn else {
            let norm = parameters.drawn_from_sensor.iter().map(|v| v * v).sum::<f64>().sqrt();
            return refuse("drawn_from_sensor", "a quaternion of length 1", norm);
        };
        let mut polynomial = PolynomialDistortion::default();
        for &(i, j, along_x, along_y) in &parameters.terms {
            match polynomial.with_term(i, j, along_x, along_y) {
                Some(more) => polynomial = more,
                None => return refuse("terms", "exponents with a sum from 1 to 5", (i + j) as f64),
            }
        }
        let camera = CameraParameters {
            width_px,
            height_px,
            focal_px: parameters.focal_px,
            principal_point_px: parameters.principal_point_px,
            distortion: Default::default(),
        };
        let camera = CameraGeometry::with_polynomial(camera, polynomial)?;
        let Some(covered) = Covered::within(&parameters.covered_px) else {
            return refuse("covered_px", "three corners or more of an area", parameters.covered_px.len() as f64);
        };
        Ok(Self { camera, drawn_from_sensor, mirrored: parameters.mirrored, covered })
    }

    /// Returns the camera that a renderer draws this display's frames with: directions in *drawn* axes -> display px,
    /// columns not yet mirrored. Error against the fitted map: [`CAMERA_PX`].
    pub fn camera(&self) -> &CameraGeometry {
        &self.camera
    }

    /// Turns the tracker's sensor axes into those that [`Self::camera`] calls sensor axes: multiply an attitude from
    /// the left, `drawn_from_sensor * sensor_from_icrf`.
    pub fn drawn_from_sensor(&self) -> Rotation<Sensor, Sensor> {
        self.drawn_from_sensor
    }

    /// Returns whether drawn columns are to be shown in reverse order: column x at `width - 1 - x`.
    pub fn mirrored(&self) -> bool {
        self.mirrored
    }

    /// Returns the area in which dots were seen, display px as shown: beyond it the map is a guess.
    pub fn covered(&self) -> &Covered {
        &self.covered
    }

    /// Returns the display pixel, as shown, of a direction in the tracker's sensor axes; `None` as for
    /// [`CameraGeometry::project`].
    pub fn project(&self, v_sensor: DVec3) -> Option<[f64; 2]> {
        self.camera.project(self.drawn_from_sensor.apply(v_sensor)).map(|px| self.shown(px))
    }

    /// Returns the direction in the tracker's sensor axes, unit length, of a display pixel as shown.
    pub fn unproject(&self, px: [f64; 2]) -> Option<DVec3> {
        self.camera.unproject(self.shown(px)).map(|v| self.drawn_from_sensor.inverse().apply(v))
    }

    /// Converts a drawn column to the shown one, and back.
    pub fn shown(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        if self.mirrored { [self.camera.width_px() as f64 - 1.0 - x, y] } else { [x, y] }
    }

    /// Returns the angle of one display pixel in the middle of the covered area, arcsec.
    pub fn arcsec_per_px(&self) -> f64 {
        let [left, right, top, bottom] = self.covered.range_px();
        let middle = [0.5 * (left + right), 0.5 * (top + bottom)];
        let at = |dx: f64, dy: f64| self.unproject([middle[0] + dx, middle[1] + dy]);
        match (at(0.0, 0.0), at(1.0, 0.0), at(0.0, 1.0)) {
            (Some(here), Some(right), Some(below)) => {
                (here.cross(right).length() * here.cross(below).length()).sqrt() / ARCSEC
            }
            _ => self.camera.ifov_rad()[0] / ARCSEC,
        }
    }
}

/// A homography taken apart: `H ~ K R`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pinhole {
    pub(super) focal_px: [f64; 2],
    pub(super) principal_point_px: [f64; 2],
    /// K's entry beside the first focal length, px.
    pub(super) shear_px: f64,
    pub(super) drawn_from_sensor: DMat3,
}

/// Takes `h` apart, whose third row is positive for visible points; `None` for one that mirrors or flattens.
pub(super) fn taken_apart(h: &DMat3) -> Option<Pinhole> {
    let [h1, h2, h3] = [h.row(0), h.row(1), h.row(2)];
    let scale = h3.length();
    let r3 = h3 / scale;
    let (cy, rest) = (h2.dot(r3), h2 - h2.dot(r3) * r3);
    let fy = rest.length();
    let r2 = rest / fy;
    let (cx, shear) = (h1.dot(r3), h1.dot(r2));
    let rest = h1 - cx * r3 - shear * r2;
    let fx = rest.length();
    let r1 = rest / fx;
    let turn = DMat3::from_cols(r1, r2, r3).transpose();
    let is_rotation = turn.is_finite() && turn.determinant() > 0.5;
    is_rotation.then(|| Pinhole {
        focal_px: [fx / scale, fy / scale],
        principal_point_px: [cx / scale, cy / scale],
        shear_px: shear / scale,
        drawn_from_sensor: turn,
    })
}

/// Returns w x y z of a rotation matrix.
pub(super) fn wxyz(matrix: &DMat3) -> [f64; 4] {
    let q = DQuat::from_mat3(matrix).normalize();
    [q.w, q.x, q.y, q.z]
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec2;

    /// Returns a tilted, rolled, sheared display.
    fn homography() -> DMat3 {
        let k = DMat3::from_cols_array(&[2000.0, 0.0, 0.0, 12.0, 1990.0, 0.0, 630.0, 355.0, 1.0]);
        let turn = DMat3::from_rotation_z(2.1) * DMat3::from_rotation_y(0.08) * DMat3::from_rotation_x(-0.05);
        k * turn
    }

    fn parameters(pinhole: &Pinhole) -> GeometryParameters {
        GeometryParameters {
            mirrored: false,
            drawn_from_sensor: wxyz(&pinhole.drawn_from_sensor),
            focal_px: pinhole.focal_px,
            principal_point_px: pinhole.principal_point_px,
            degree: 1,
            terms: vec![(0, 1, pinhole.shear_px / pinhole.focal_px[0], 0.0)],
            covered_px: vec![[0.0, 0.0], [1279.0, 0.0], [1279.0, 719.0], [0.0, 719.0]],
        }
    }

    fn through(h: &DMat3, v: DVec3) -> DVec2 {
        let seen = *h * v;
        seen.truncate() / seen.z
    }

    #[test]
    fn a_homography_is_a_camera_exactly() {
        let h = homography();
        let pinhole = taken_apart(&(h * 3.7)).expect("a camera, whatever its scale");
        let geometry = DisplayGeometry::new(&parameters(&pinhole), [1280, 720]).unwrap();
        for [x, y] in [[0.0, 0.0], [1279.0, 0.0], [640.5, 359.25], [3.0, 719.0]] {
            let v = geometry.unproject([x, y]).unwrap();
            let seen = through(&h, v);
            assert!(seen.distance(DVec2::new(x, y)) < CAMERA_PX, "{seen} for {x}, {y}");
            let [px, py] = geometry.project(v * 3.0).unwrap();
            assert!((px - x).hypot(py - y) < CAMERA_PX, "there and back");
        }
        let shearless = GeometryParameters { terms: Vec::new(), ..parameters(&pinhole) };
        let v = geometry.unproject([0.0, 0.0]).unwrap();
        let [x, y] = DisplayGeometry::new(&shearless, [1280, 720]).unwrap().project(v).unwrap();
        assert!(x.hypot(y) > 1.0, "the shear counts: {x}, {y}");
    }

    #[test]
    fn a_mirror_is_reported_and_shown() {
        let mirror = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
        assert_eq!(taken_apart(&(mirror * homography())), None);
        let plain = parameters(&taken_apart(&homography()).unwrap());
        let mirrored = GeometryParameters { mirrored: true, ..plain.clone() };
        let [plain, mirrored] = [plain, mirrored].map(|p| DisplayGeometry::new(&p, [1280, 720]).unwrap());
        let v = plain.unproject([100.0, 50.0]).unwrap();
        let [x, y] = mirrored.project(v).unwrap();
        assert!((x - 1179.0).hypot(y - 50.0) < CAMERA_PX, "{x}, {y}");
        assert!(mirrored.unproject([x, y]).unwrap().distance(v) < 1e-12);
    }

    #[test]
    fn invalid_parameters_are_refused() {
        let good = parameters(&taken_apart(&homography()).unwrap());
        let refused = |change: &dyn Fn(&mut GeometryParameters)| {
            let mut changed = good.clone();
            change(&mut changed);
            DisplayGeometry::new(&changed, [1280, 720]).unwrap_err().to_string()
        };
        assert!(refused(&|p| p.drawn_from_sensor = [1.0, 1.0, 0.0, 0.0]).contains("quaternion"));
        assert!(refused(&|p| p.terms.push((4, 2, 0.0, 0.0))).contains("1 to 5"));
        assert!(refused(&|p| p.terms.push((3, 0, f64::NAN, 0.0))).contains("coefficient"));
        assert!(refused(&|p| p.terms.push((3, 0, -40.0, 0.0))).contains("one-to-one"));
        assert!(refused(&|p| p.focal_px = [0.0, 1.0]).contains("focal_px"));
        assert!(refused(&|p| p.covered_px.truncate(2)).contains("covered_px"));
    }

    #[test]
    fn a_pixel_has_its_angle() {
        let geometry = DisplayGeometry::new(&parameters(&taken_apart(&homography()).unwrap()), [1280, 720]).unwrap();
        let wanted = 1.0 / 1995.0 / ARCSEC;
        assert!((geometry.arcsec_per_px() / wanted - 1.0).abs() < 0.02, "{} arcsec", geometry.arcsec_per_px());
    }
}
