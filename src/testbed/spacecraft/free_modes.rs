//! Cantilever modes and inertia -> the modes of the body floating free.
//!
//! With `D` the couplings as columns, `eta` and the body's rotation about rest obey (Hughes (1986), chapter 6)
//! ```text
//! J theta'' + D eta'' = T          eta'' + C eta' + L eta = -D' theta''
//! (1 - D' J^-1 D) eta'' + C eta' + L eta = -D' J^-1 T
//! ```
//! The symmetric pair `(1 - D' J^-1 D, L)` is diagonalised by `eta = F p`:
//! ```text
//! p'' + 2 z o p' + o^2 p = -g . T       theta = J^-1 (T twice integrated) - sum g p       g = J^-1 D F
//! ```
//! `J` has the rotors free about their axes. `Differs:` of `F' C F` the diagonal is kept; with one mode that is exact,
//! with several it leaves out terms of the order of the damping ratio. `tests/flexible.rs` and
//! `tests/micro_vibration.rs` hold frequencies and responses to theory.

use super::equations::outer;
use super::params::{MODES_MAX, SpacecraftParams};
use core::f64::consts::TAU;
use glam::{DMat3, DVec3};

/// Sweeps of Jacobi's method: 4 x 4 matrices are diagonal to rounding after 5.
const SWEEPS: usize = 8;

type Square = [[f64; MODES_MAX]; MODES_MAX];

/// One mode of the free body.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FreeMode {
    /// Frequency, rad/s.
    pub(super) frequency_rad_s: f64,
    /// Damping ratio.
    pub(super) damping: f64,
    /// Rotation of the body per modal coordinate, and torque to modal force.
    pub(super) shape: DVec3,
}

/// Returns the inertia with the rotors free about their axes, kg m^2.
pub(super) fn free_inertia(params: &SpacecraftParams) -> DMat3 {
    let mut inertia = params.inertia_kg_m2;
    for wheel in &params.wheels {
        let axis = wheel.axis_body.normalize_or_zero();
        inertia -= outer(axis, axis) * wheel.inertia_kg_m2;
    }
    inertia
}

/// Returns the free modes of checked parameters, in no order.
pub(super) fn free_modes(params: &SpacecraftParams) -> Vec<FreeMode> {
    let modes = &params.modes;
    let inverse = free_inertia(params).inverse();
    // L^-1/2 (1 - D' J^-1 D) L^-1/2: eigenvalues 1 / o^2.
    let mut matrix = Square::default();
    for (i, a) in modes.iter().enumerate() {
        for (j, b) in modes.iter().enumerate() {
            let identity = if i == j { 1.0 } else { 0.0 };
            let frequencies = TAU * a.frequency_hz * TAU * b.frequency_hz;
            matrix[i][j] = (identity - a.coupling.dot(inverse * b.coupling)) / frequencies;
        }
    }
    let vectors = diagonalise(&mut matrix, modes.len());
    (0..modes.len())
        .map(|m| {
            let frequency_rad_s = matrix[m][m].powf(-0.5);
            let (mut shape, mut damping_rad_s) = (DVec3::ZERO, 0.0);
            for (i, mode) in modes.iter().enumerate() {
                let o = TAU * mode.frequency_hz;
                let part = vectors[i][m] / o * frequency_rad_s;
                shape += mode.coupling * part;
                damping_rad_s += 2.0 * mode.damping * o * part * part;
            }
            FreeMode { frequency_rad_s, damping: damping_rad_s / (2.0 * frequency_rad_s), shape: inverse * shape }
        })
        .collect()
}

/// Applies Jacobi's method (Golub and Van Loan, "Matrix Computations", section 8.5): `matrix` becomes diagonal in its
/// first `n` rows; the columns of what is returned are its eigenvectors.
fn diagonalise(matrix: &mut Square, n: usize) -> Square {
    let mut vectors = Square::default();
    for i in 0..n {
        vectors[i][i] = 1.0;
    }
    for _ in 0..SWEEPS {
        for p in 0..n {
            for q in p + 1..n {
                rotate(matrix, &mut vectors, n, p, q);
            }
        }
    }
    vectors
}

/// Applies one rotation that brings `matrix[p][q]` to zero.
fn rotate(matrix: &mut Square, vectors: &mut Square, n: usize, p: usize, q: usize) {
    if matrix[p][q] == 0.0 {
        return;
    }
    let tau = (matrix[q][q] - matrix[p][p]) / (2.0 * matrix[p][q]);
    let tan = tau.signum() / (tau.abs() + tau.hypot(1.0));
    let cos = 1.0 / tan.hypot(1.0);
    let sin = tan * cos;
    for k in 0..n {
        let (a, b) = (matrix[k][p], matrix[k][q]);
        (matrix[k][p], matrix[k][q]) = (cos * a - sin * b, sin * a + cos * b);
        let (a, b) = (vectors[k][p], vectors[k][q]);
        (vectors[k][p], vectors[k][q]) = (cos * a - sin * b, sin * a + cos * b);
    }
    for k in 0..n {
        let (a, b) = (matrix[p][k], matrix[q][k]);
        (matrix[p][k], matrix[q][k]) = (cos * a - sin * b, sin * a + cos * b);
    }
}
