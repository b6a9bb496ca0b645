//! Weighted pairs of directions -> attitude: Davenport's q-method for Wahba's problem.
//!
//! Source: Wahba, SIAM Review 7 (1965), 409; Davenport's method in Shuster & Oh, "Three-axis attitude determination
//! from vector observations", J. Guidance and Control 4 (1981), 70, eqs. 18..25: the attitude is the eigenvector of the
//! largest eigenvalue of K. Differs: Shuster's quaternion is the conjugate of ours (Hamilton, passive), so the vector
//! part changes sign. The eigenvector is found by Jacobi rotations: no case of slow or failed convergence, unlike
//! Newton on the characteristic polynomial. Tests: `davenport_recovers_the_attitude`, `triad_agrees`.

use base::axes::{Icrf, Rotation, Sensor};
use glam::{DMat3, DQuat, DVec3};

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
