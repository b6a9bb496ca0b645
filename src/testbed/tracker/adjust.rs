//! Matched spots and a rough attitude -> the most likely attitude, its covariance, and the spots that do not belong.
//!
//! Gauss-Newton in pixels, where the errors are made: each spot counts with the inverse of its own 2 x 2 covariance,
//! and the covariance of the attitude is the inverse of the Fisher information (Shuster, "Maximum likelihood estimation
//! of spacecraft attitude", J. Astronautical Sciences 37 (1989), 79). Spots whose squared residual is above
//! [`MOST_CHI_SQUARE`] are left out, worst first. Tests: `attitude_errors_follow_the_covariance`,
//! `an_outlier_is_left_out`.

use super::{centroid::Spot, geometry::Geometry};
use base::axes::{Icrf, Rotation, Sensor};
use glam::{DMat2, DMat3, DVec2, DVec3};

/// Largest squared residual of one spot in units of its covariance: chance 4e-6 for two degrees of freedom.
const MOST_CHI_SQUARE: f64 = 25.0;
/// Gauss-Newton steps; each squares the distance to the solution.
const STEPS: usize = 4;
/// Where the steps stop, rad: 2e-7 arcsec.
const STOP_RAD: f64 = 1e-12;
/// Rounds of leaving out.
const ROUNDS: usize = 8;

/// A spot and the guide star it is taken for.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MatchedStar {
    /// Place in the list of guide stars.
    pub star: usize,
    /// Apparent direction, ICRF axes.
    pub apparent_icrf: DVec3,
    /// The measured spot.
    pub spot: Spot,
    /// Measured minus expected place, px.
    pub residual_px: DVec2,
    /// Whether the attitude uses it: outliers are kept, unused.
    pub used: bool,
}

/// An attitude and how well the spots agree with it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Adjusted {
    pub(super) attitude: Rotation<Sensor, Icrf>,
    /// Of the rotation vector, sensor axes, rad^2.
    pub(super) covariance_rad2: DMat3,
    pub(super) chi_square_per_dof: f64,
    pub(super) residual_rms_px: f64,
    pub(super) used: usize,
}

/// Finds the attitude from `start`, good to a degree. `None` when fewer than three spots stay or they leave an axis
/// free.
pub(super) fn adjust(
    geometry: &Geometry,
    start: &Rotation<Sensor, Icrf>,
    matches: &mut [MatchedStar],
    floor_px: f64,
) -> Option<Adjusted> {
    let mut attitude = *start;
    for _ in 0..ROUNDS {
        for _ in 0..STEPS {
            let (information, gradient) = normal_equations(geometry, &attitude, matches, floor_px);
            let step = solve(&information)? * gradient;
            if !step.is_finite() || step.length() > 0.1 {
                return None;
            }
            attitude = attitude.rotated_by(step);
            if step.length() < STOP_RAD {
                break;
            }
        }
        if !leave_out_worst(geometry, &attitude, matches, floor_px) {
            return summary(geometry, attitude, matches, floor_px);
        }
    }
    summary(geometry, attitude, matches, floor_px)
}

fn summary(
    geometry: &Geometry,
    attitude: Rotation<Sensor, Icrf>,
    matches: &[MatchedStar],
    floor_px: f64,
) -> Option<Adjusted> {
    let (information, _) = normal_equations(geometry, &attitude, matches, floor_px);
    let covariance_rad2 = solve(&information)?;
    let (mut used, mut chi_square, mut squares) = (0_usize, 0.0, 0.0);
    for m in matches.iter().filter(|m| m.used) {
        used += 1;
        chi_square += m.residual_px.dot(weight(&m.spot, floor_px) * m.residual_px);
        squares += m.residual_px.length_squared();
    }
    if used < 3 {
        return None;
    }
    let chi_square_per_dof = chi_square / (2.0 * used as f64 - 3.0);
    let residual_rms_px = (0.5 * squares / used as f64).sqrt();
    Some(Adjusted { attitude, covariance_rad2, chi_square_per_dof, residual_rms_px, used })
}

/// Updates the residuals and marks spots beyond the limit, those within a factor of two of the worst at once. Whether
/// any was marked.
fn leave_out_worst(
    geometry: &Geometry,
    attitude: &Rotation<Sensor, Icrf>,
    matches: &mut [MatchedStar],
    floor_px: f64,
) -> bool {
    let mut worst: f64 = 0.0;
    for m in matches.iter_mut() {
        let Some(place) = geometry.pixel(attitude.apply(m.apparent_icrf)) else {
            m.used = false;
            continue;
        };
        m.residual_px = m.spot.place_px - place;
        if m.used {
            worst = worst.max(m.residual_px.dot(weight(&m.spot, floor_px) * m.residual_px));
        }
    }
    let limit = MOST_CHI_SQUARE.max(0.25 * worst);
    let mut any = false;
    for m in matches.iter_mut().filter(|m| m.used) {
        if m.residual_px.dot(weight(&m.spot, floor_px) * m.residual_px) > limit {
            m.used = false;
            any = true;
        }
    }
    any
}

/// Returns the inverse covariance of a spot's place, 1/px^2.
fn weight(spot: &Spot, floor_px: f64) -> DMat2 {
    let [xx, xy, yy] = spot.covariance_px2;
    let floor = floor_px * floor_px;
    DMat2::from_cols_array(&[xx + floor, xy, xy, yy + floor]).inverse()
}

fn normal_equations(
    geometry: &Geometry,
    attitude: &Rotation<Sensor, Icrf>,
    matches: &[MatchedStar],
    floor_px: f64,
) -> (DMat3, DVec3) {
    let (mut information, mut gradient) = (DMat3::ZERO, DVec3::ZERO);
    for m in matches.iter().filter(|m| m.used) {
        let Some((place, turn)) = geometry.pixel_and_turn(attitude.apply(m.apparent_icrf)) else { continue };
        let weight = weight(&m.spot, floor_px);
        let residual = weight * (m.spot.place_px - place);
        let weighted = turn.map(|column| weight * column);
        let row = |a: DVec2| DVec3::new(a.dot(weighted[0]), a.dot(weighted[1]), a.dot(weighted[2]));
        information += DMat3::from_cols(row(turn[0]), row(turn[1]), row(turn[2]));
        gradient += DVec3::new(turn[0].dot(residual), turn[1].dot(residual), turn[2].dot(residual));
    }
    (information, gradient)
}

/// Returns the inverse of an information matrix, unless it leaves an axis free.
fn solve(information: &DMat3) -> Option<DMat3> {
    let scale = information.x_axis.x.max(information.y_axis.y).max(information.z_axis.z);
    let determinant = information.determinant();
    // 1e-9 of the cube: roll known a thousand times worse than the boresight is as good as unknown.
    (determinant > 1e-9 * scale * scale * scale * 1e-3).then(|| information.inverse())
}
