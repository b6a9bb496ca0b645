//! One star's place on the detector at mid-exposure and how it answers to the path features.

use crate::astrometry::CameraGeometry;
use crate::exposure::features::{FEATURES, Features};
use crate::exposure::motion::Motion;
use glam::{DQuat, DVec3};

/// Place and response of one star.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StarTrack {
    /// Image at mid-exposure without jitter, px.
    pub mid_px: [f64; 2],
    /// Displacement per unit of each feature, px: rows x and y.
    pub response: [Features; 2],
}

impl StarTrack {
    /// Track of the star that stands in direction `mid_sensor` (sensor axes, unit) at mid-exposure. `None` when it
    /// is outside the camera's domain at the start, middle or end of the exposure.
    ///
    /// Smooth motion is the parabola through the exact projections at start, middle and end: error at most
    /// `f |w T|^3 / 9 sqrt(3) / 8` px of a cubic term, checked by the planner; jitter goes through the projection's
    /// derivative (error `f j^2`).
    #[must_use]
    pub fn new(camera: &CameraGeometry, motion: &Motion, mid_sensor: DVec3) -> Option<Self> {
        let mid_px = camera.project(mid_sensor)?;
        let mut response = [[0.0; FEATURES]; 2];
        if motion.smooth_rotation_rad(0.5) != DVec3::ZERO || motion.smooth_rotation_rad(-0.5) != DVec3::ZERO {
            let start = camera.project(turned(mid_sensor, motion.smooth_rotation_rad(-0.5)))?;
            let end = camera.project(turned(mid_sensor, motion.smooth_rotation_rad(0.5)))?;
            for axis in 0..2 {
                response[axis][0] = end[axis] - start[axis];
                response[axis][1] = 2.0 * (end[axis] + start[axis] - 2.0 * mid_px[axis]);
            }
        }
        if motion.image_path.is_some() {
            let [cx, cy] = camera.parameters().principal_point_px;
            let (rx, ry) = (mid_px[0] - cx, mid_px[1] - cy);
            response[0][2..].copy_from_slice(&[1.0, 0.0, -ry, rx]);
            response[1][2..].copy_from_slice(&[0.0, 1.0, rx, ry]);
        } else if !motion.los.jitter.is_still() {
            let jacobian = camera.jacobian(mid_sensor)?;
            for axis in 0..2 {
                response[axis][2..5].copy_from_slice(&jacobian[axis]);
            }
        }
        Some(Self { mid_px, response })
    }

    /// Displacement from `mid_px` at features `phi`, px.
    #[must_use]
    pub fn displacement_px(&self, phi: &Features) -> [f64; 2] {
        self.response.map(|row| row.iter().zip(phi).map(|(r, p)| r * p).sum())
    }
}

/// Direction of a fixed star after the sensor axes have turned by `rotation_rad`.
#[must_use]
pub fn turned(mid_sensor: DVec3, rotation_rad: DVec3) -> DVec3 {
    DQuat::from_scaled_axis(-rotation_rad) * mid_sensor
}
