//! Where a camera puts directions: attitude, focal length, distortion and the atmosphere's stretch; fitted to stars.
//!
//! `x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + tangential terms (p1, p2) + e1 x + e2 y`, `y' = ... + e2 x - e1 y`: Brown
//! and Conrady's model with a stretch. Refraction of air moves stars by `R tan z` towards the zenith (R = 58 arcsec),
//! so it shrinks lengths by R along the horizon and by R (1 + tan^2 z) across it: their mean goes into the focal
//! length, half their difference, `R tan^2 z / 2`, is the stretch. The constant part goes into the attitude.

use crate::newton::{Fitted, first_three, fit};
use base::axes::{Icrf, Rotation, Sensor};
use glam::{DVec2, DVec3};
use sky::astrometry::BrownConrady;

/// A camera's geometry as it is fitted.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Geometry {
    /// Attitude.
    pub attitude: Rotation<Sensor, Icrf>,
    /// Focal length over pixel pitch.
    pub focal_px: f64,
    /// Where the boresight meets the detector, px.
    pub centre_px: [f64; 2],
    /// Distortion.
    pub distortion: BrownConrady,
    /// Stretch along x less that along y, halved, and along the diagonals.
    pub stretch: [f64; 2],
}

/// A star and where it was measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tie {
    /// Apparent direction, ICRF axes.
    pub direction: DVec3,
    /// Place, px.
    pub px: [f64; 2],
    /// Its standard error along each axis, px.
    pub error_px: f64,
}

/// Parameters that are fitted beside the attitude.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Freedom {
    /// The attitude alone.
    Attitude,
    /// Focal length too.
    Scale,
    /// Radial and tangential distortion too.
    Distortion,
    /// The stretch of the atmosphere too.
    Air,
}

/// A fitted geometry.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedGeometry {
    /// The geometry.
    pub geometry: Geometry,
    /// Standard error of the focal length, px; 0 where it was kept.
    pub focal_error_px: f64,
    /// Standard error of the stretch; 0 where it was kept.
    pub stretch_error: f64,
}

impl Geometry {
    /// Returns the place of an apparent direction, px; `None` behind the camera.
    #[must_use]
    pub fn place(&self, direction: DVec3) -> Option<[f64; 2]> {
        let v = self.attitude.apply(direction);
        if v.z <= 0.1 {
            return None;
        }
        let ideal = DVec2::new(v.x, v.y) / v.z;
        let [e1, e2] = self.stretch;
        let stretched = DVec2::new(e1 * ideal.x + e2 * ideal.y, e2 * ideal.x - e1 * ideal.y);
        let distorted = self.distortion.distort(ideal) + stretched;
        Some([0, 1].map(|i| self.centre_px[i] + self.focal_px * distorted.to_array()[i]))
    }

    /// Returns the geometry nearest to the ties, of `freedom`; `None` when they do not determine it.
    #[must_use]
    pub fn fitted(&self, ties: &[Tie], freedom: Freedom) -> Option<FittedGeometry> {
        let count = match freedom {
            Freedom::Attitude => 3,
            Freedom::Scale => 4,
            Freedom::Distortion => 7,
            Freedom::Air => 9,
        };
        // Two numbers of each star; a few stars more than needed.
        if 2 * ties.len() < count + 3 {
            return None;
        }
        let steps = [1e-6, 1e-6, 1e-6, 1e-4, 1e-3, 1e-5, 1e-5, 1e-6, 1e-6];
        let residuals = |p: &[f64]| self.moved(p).residuals(ties);
        let Fitted { values, errors, chi2 } = fit(&vec![0.0; count], &steps[..count], residuals)?;
        // The ties may scatter more than their errors say.
        let excess = (chi2 / (2 * ties.len() - count) as f64).max(1.0).sqrt();
        let error = |i: usize| errors.get(i).map_or(0.0, |error| error * excess);
        Some(FittedGeometry {
            geometry: self.moved(&values),
            focal_error_px: error(3) * self.focal_px,
            stretch_error: error(7).max(error(8)),
        })
    }

    /// Returns the geometry with parameters added: rotation, share of the focal length, k1, p1, p2, stretch.
    fn moved(&self, p: &[f64]) -> Self {
        let by = |i: usize| p.get(i).copied().unwrap_or(0.0);
        let BrownConrady { k1, k2, k3, p1, p2 } = self.distortion;
        Self {
            attitude: self.attitude.rotated_by(first_three(p)),
            focal_px: self.focal_px * (1.0 + by(3)),
            centre_px: self.centre_px,
            distortion: BrownConrady { k1: k1 + by(4), k2, k3, p1: p1 + by(5), p2: p2 + by(6) },
            stretch: [self.stretch[0] + by(7), self.stretch[1] + by(8)],
        }
    }

    fn residuals(&self, ties: &[Tie]) -> Vec<f64> {
        let of = |tie: &Tie| {
            let place = self.place(tie.direction).unwrap_or([1e6; 2]);
            [0, 1].map(|i| (place[i] - tie.px[i]) / tie.error_px)
        };
        ties.iter().flat_map(of).collect()
    }
}

/// Returns the parallel of the zenith's direction on the image that a stretch means, degrees from right towards down, 0
/// to 180, and its size.
#[must_use]
pub fn stretch_axis(stretch: [f64; 2]) -> (f64, f64) {
    // Lengths along the vertical shrink: the axis of the negative stretch.
    let axis = 0.5 * (-stretch[1]).atan2(-stretch[0]);
    (axis.to_degrees().rem_euclid(180.0), stretch[0].hypot(stretch[1]))
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::axes::sensor_from_ra_dec_roll;

    fn truth() -> Geometry {
        Geometry {
            attitude: sensor_from_ra_dec_roll(1.0, 0.5, 2.0),
            focal_px: 5114.0,
            centre_px: [511.5, 383.5],
            distortion: BrownConrady { k1: 0.11, k2: 0.0, k3: 0.0, p1: 2e-4, p2: 1e-4 },
            stretch: [-2e-4, 1e-4],
        }
    }

    fn ties(count: u32) -> Vec<Tie> {
        let sensor =
            |i: u32| DVec3::new(f64::from(i * 37 % 100) * 0.002 - 0.1, f64::from(i * 61 % 100) * 0.0015 - 0.075, 1.0);
        let direction = |i: u32| truth().attitude.inverse().apply(sensor(i).normalize());
        (0..count)
            .map(direction)
            .map(|direction| Tie { direction, px: truth().place(direction).unwrap(), error_px: 0.05 })
            .collect()
    }

    #[test]
    fn a_known_geometry_is_found_from_its_stars() {
        let start = Geometry {
            attitude: truth().attitude.rotated_by(DVec3::new(1e-4, -2e-4, 1e-3)),
            focal_px: 5072.0,
            distortion: BrownConrady::default(),
            stretch: [0.0; 2],
            ..truth()
        };
        let found = start.fitted(&ties(60), Freedom::Air).unwrap();
        assert!((found.geometry.focal_px - 5114.0).abs() < 0.01, "{found:?}");
        assert!((found.geometry.distortion.k1 - 0.11).abs() < 1e-4 && (found.geometry.stretch[0] + 2e-4).abs() < 1e-7);
        let without = start.fitted(&ties(60), Freedom::Distortion).unwrap().geometry;
        let worst =
            ties(60).iter().map(|tie| (without.place(tie.direction).unwrap()[0] - tie.px[0]).abs()).fold(0.0, f64::max);
        assert!(worst > 0.03, "control: without the stretch {worst} px remain");
        assert_eq!(start.fitted(&ties(4), Freedom::Air), None, "too few");
    }

    #[test]
    fn the_vertical_is_where_lengths_shrink() {
        // Lengths along y are smaller: the vertical is down, 90 degrees from right.
        let (axis_deg, size) = stretch_axis([2e-4, 0.0]);
        assert!((axis_deg - 90.0).abs() < 1e-9 && (size - 2e-4).abs() < 1e-12, "{axis_deg}");
        assert!(stretch_axis([-1e-4, 0.0]).0.abs() < 1e-9, "along x");
    }
}
