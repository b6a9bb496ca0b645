//! Pixel place <-> direction in sensor axes: pinhole camera with Brown-Conrady distortion.
//!
//! Source: Brown, "Decentering distortion of lenses", Photogrammetric Engineering 32 (1966), 444; Conrady, MNRAS 79
//! (1919), 384. In tangent coordinates x = X/Z, y = Y/Z, r2 = x^2 + y^2:
//!
//! ```text
//! x' = x (1 + k1 r2 + k2 r2^2 + k3 r2^3) + 2 p1 x y + p2 (r2 + 2 x^2)
//! y' = y (1 + k1 r2 + k2 r2^2 + k3 r2^3) + p1 (r2 + 2 y^2) + 2 p2 x y
//! x_px = cx + fx x',  y_px = cy + fy y'
//! ```
//!
//! Sensor axes: +Z boresight, +X image right, +Y image down; the first pixel's centre is (0, 0). The inverse is
//! Newton's. Limit: the distortion must not fold inside the field ([`Geometry::check`]); directions far outside it may
//! land on the image, so callers cut by [`Geometry::corner_rad`] first. Test: `distortion_round_trips`.
//!
//! Weighted pairs of directions -> attitude: Davenport's q-method for Wahba's problem.
//!
//! Source: Wahba, SIAM Review 7 (1965), 409; Davenport's method in Shuster & Oh, "Three-axis attitude determination
//! from vector observations", J. Guidance and Control 4 (1981), 70, eqs. 18..25: the attitude is the eigenvector of the
//! largest eigenvalue of K. Differs: Shuster's quaternion is the conjugate of ours (Hamilton, passive), so the vector
//! part changes sign. The eigenvector is found by Jacobi rotations: no case of slow or failed convergence, unlike
//! Newton on the characteristic polynomial. Tests: `davenport_recovers_the_attitude`, `triad_agrees`.

use base::axes::{Icrf, Rotation, Sensor};
use base::refused::Refused;
use glam::{DMat2, DMat3, DQuat, DVec2, DVec3};

/// Newton steps of the inverse: each doubles the digits, and the start is good to a tenth.
const NEWTON_STEPS: usize = 12;
/// Where Newton stops, in tangent coordinates: 2e-8 arcsec.
const NEWTON_STOP: f64 = 1e-13;

/// The calibrated camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geometry {
    /// Columns.
    pub width_px: usize,
    /// Rows.
    pub height_px: usize,
    /// Focal length in pixels, along x and y.
    pub focal_px: [f64; 2],
    /// Where the boresight meets the image, px.
    pub principal_point_px: [f64; 2],
    /// Brown-Conrady coefficients in the order `k1, k2, p1, p2, k3`; zeros for none.
    pub distortion: [f64; 5],
}

impl Geometry {
    /// Returns a camera without distortion whose boresight meets the middle of the image.
    pub fn centred(width_px: usize, height_px: usize, focal_px: f64) -> Self {
        let middle = |count: usize| (count as f64 - 1.0) / 2.0;
        Self {
            width_px,
            height_px,
            focal_px: [focal_px; 2],
            principal_point_px: [middle(width_px), middle(height_px)],
            distortion: [0.0; 5],
        }
    }

    /// Returns the place of a direction (sensor axes, any length), px; `None` from 90 degrees off the boresight.
    pub fn pixel(&self, direction: DVec3) -> Option<DVec2> {
        if direction.z.is_nan() || direction.z <= 0.0 {
            return None;
        }
        let ideal = DVec2::new(direction.x, direction.y) / direction.z;
        Some(self.pixel_of_tangent(self.distort(ideal)))
    }

    /// Returns the place of a direction and its derivative with respect to the rotation vector (rad, sensor axes) by
    /// which the sensor is turned: columns are d(place)/d(rotation about X, Y, Z), px/rad.
    pub fn pixel_and_turn(&self, direction: DVec3) -> Option<(DVec2, [DVec2; 3])> {
        let place = self.pixel(direction)?;
        let ideal = DVec2::new(direction.x, direction.y) / direction.z;
        let slope = self.distortion_slope(ideal);
        let focal = DVec2::from(self.focal_px);
        // Turning the axes by e moves the direction by -e x v; its tangent coordinates follow from the quotient rule.
        let turned = |axis: DVec3| {
            let d = direction.cross(axis) / direction.z;
            focal * (slope * (DVec2::new(d.x, d.y) - ideal * d.z))
        };
        Some((place, [turned(DVec3::X), turned(DVec3::Y), turned(DVec3::Z)]))
    }

    /// Returns the unit direction (sensor axes) seen at a place, px.
    pub fn direction(&self, place_px: DVec2) -> DVec3 {
        let seen = (place_px - DVec2::from(self.principal_point_px)) / DVec2::from(self.focal_px);
        let mut ideal = seen;
        if self.distortion != [0.0; 5] {
            for _ in 0..NEWTON_STEPS {
                let step = self.distortion_slope(ideal).inverse() * (seen - self.distort(ideal));
                ideal += step;
                if step.length_squared() < NEWTON_STOP * NEWTON_STOP {
                    break;
                }
            }
        }
        ideal.extend(1.0).normalize()
    }

    /// Returns whether a place is on the image and at least `margin_px` inside its outermost pixels' centres.
    pub fn holds(&self, place_px: DVec2, margin_px: f64) -> bool {
        let last = DVec2::new(self.width_px as f64 - 1.0, self.height_px as f64 - 1.0);
        place_px.cmpge(DVec2::splat(margin_px)).all() && place_px.cmple(last - margin_px).all()
    }

    /// Returns the angle from the boresight to the furthest corner, rad.
    pub fn corner_rad(&self) -> f64 {
        self.corners().map(|corner| self.direction(corner).angle_between(DVec3::Z)).into_iter().fold(0.0, f64::max)
    }

    /// Returns the angle of one pixel on the boresight, rad (mean of x and y).
    pub fn ifov_rad(&self) -> f64 {
        0.5 * (1.0 / self.focal_px[0] + 1.0 / self.focal_px[1])
    }

    /// Returns the solid angle of the field, sr, to a few per cent (flat-field approximation).
    pub fn field_sr(&self) -> f64 {
        self.width_px as f64 / self.focal_px[0] * (self.height_px as f64 / self.focal_px[1])
    }

    /// Returns the image diagonal, px.
    pub fn diagonal_px(&self) -> f64 {
        (self.width_px as f64).hypot(self.height_px as f64)
    }

    /// # Errors
    /// When the distortion cannot be inverted at a corner of the image.
    pub fn check(&self) -> Result<(), Refused> {
        for corner in self.corners() {
            let back = self.pixel(self.direction(corner));
            if !back.is_some_and(|back| back.distance(corner) < 1e-6) {
                let [x_px, y_px] = corner.to_array();
                return Err(Refused(format!(
                    "tracker distortion k1, k2, p1, p2, k3 = {distortion:?}: wanted one that can be inverted at the image corner \
         ({x_px}, {y_px}) px, got a fold there; refit it over the whole field",
                    distortion = self.distortion
                )));
            }
        }
        Ok(())
    }

    fn corners(&self) -> [DVec2; 4] {
        let (right, bottom) = (self.width_px as f64 - 0.5, self.height_px as f64 - 0.5);
        [(-0.5, -0.5), (right, -0.5), (-0.5, bottom), (right, bottom)].map(DVec2::from)
    }

    fn pixel_of_tangent(&self, tangent: DVec2) -> DVec2 {
        DVec2::from(self.principal_point_px) + DVec2::from(self.focal_px) * tangent
    }

    fn distort(&self, ideal: DVec2) -> DVec2 {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let (x, y, r2) = (ideal.x, ideal.y, ideal.length_squared());
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let bend_x = 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x);
        let bend_y = p1 * (r2 + 2.0 * y * y) + 2.0 * p2 * x * y;
        ideal * radial + DVec2::new(bend_x, bend_y)
    }

    /// Returns the derivative of [`Self::distort`]; symmetric.
    fn distortion_slope(&self, ideal: DVec2) -> DMat2 {
        let [k1, k2, p1, p2, k3] = self.distortion;
        let (x, y, r2) = (ideal.x, ideal.y, ideal.length_squared());
        let radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3));
        let growth = 2.0 * (k1 + r2 * (2.0 * k2 + 3.0 * r2 * k3));
        let xx = radial + growth * x * x + 2.0 * p1 * y + 6.0 * p2 * x;
        let yy = radial + growth * y * y + 6.0 * p1 * y + 2.0 * p2 * x;
        let xy = growth * x * y + 2.0 * p1 * x + 2.0 * p2 * y;
        DMat2::from_cols_array(&[xx, xy, xy, yy])
    }
}

/// Sweeps of the Jacobi method; a 4 x 4 matrix needs 5 to reach rounding.
const SWEEPS: usize = 12;

/// One direction in both axes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Observation {
    /// Unit direction, sensor axes.
    pub(super) measured: DVec3,
    /// Unit direction, ICRF axes.
    pub(super) reference: DVec3,
    /// Inverse variance, any common unit.
    pub(super) weight: f64,
}

/// Returns the attitude that minimises the weighted squared distances between measured and rotated reference
/// directions.
pub(super) fn davenport(observations: impl Iterator<Item = Observation>) -> Rotation<Sensor, Icrf> {
    // Column c of B is the sum of weight * measured * reference[c].
    let mut b = DMat3::ZERO;
    for o in observations {
        let w = o.measured * o.weight;
        b += DMat3::from_cols(w * o.reference.x, w * o.reference.y, w * o.reference.z);
    }
    let s = b + b.transpose();
    let trace = b.x_axis.x + b.y_axis.y + b.z_axis.z;
    let z = DVec3::new(b.z_axis.y - b.y_axis.z, b.x_axis.z - b.z_axis.x, b.y_axis.x - b.x_axis.y);
    let mut k = [[0.0; 4]; 4];
    for row in 0..3 {
        for column in 0..3 {
            k[row][column] = s.col(column)[row];
        }
        k[row][row] -= trace;
        k[row][3] = z[row];
        k[3][row] = z[row];
    }
    k[3][3] = trace;
    let [x, y, z, w] = largest_eigenvector(k);
    Rotation::from_quat(DQuat::from_xyzw(-x, -y, -z, w))
}

/// Returns the eigenvector of the largest eigenvalue of a symmetric matrix: cyclic Jacobi (Golub & Van Loan, *Matrix
/// Computations*, 4th ed., section 8.5).
pub(super) fn largest_eigenvector(mut a: [[f64; 4]; 4]) -> [f64; 4] {
    let mut vectors = [[0.0; 4]; 4];
    for (row, vector) in vectors.iter_mut().enumerate() {
        vector[row] = 1.0;
    }
    for _ in 0..SWEEPS {
        for p in 0..3 {
            for q in p + 1..4 {
                rotate(&mut a, &mut vectors, p, q);
            }
        }
    }
    let best = (1..4).fold(0, |best, next| if a[next][next] > a[best][best] { next } else { best });
    [vectors[0][best], vectors[1][best], vectors[2][best], vectors[3][best]]
}

/// Applies one Jacobi rotation that makes the element (p, q) zero.
fn rotate(a: &mut [[f64; 4]; 4], vectors: &mut [[f64; 4]; 4], p: usize, q: usize) {
    if a[p][q].abs() <= f64::EPSILON * 1e-3 * (a[p][p].abs() + a[q][q].abs()) {
        return;
    }
    let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
    let c = 1.0 / t.hypot(1.0);
    let s = t * c;
    for i in 0..4 {
        let (ip, iq) = (a[i][p], a[i][q]);
        (a[i][p], a[i][q]) = (c * ip - s * iq, s * ip + c * iq);
    }
    for i in 0..4 {
        let (pi, qi) = (a[p][i], a[q][i]);
        (a[p][i], a[q][i]) = (c * pi - s * qi, s * pi + c * qi);
    }
    for v in vectors.iter_mut() {
        (v[p], v[q]) = (c * v[p] - s * v[q], s * v[p] + c * v[q]);
    }
}
