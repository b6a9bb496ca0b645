//! One star's place on the detector at mid-exposure, and its displacement by a pose.
//!
//! There are two maps from a pose to a displacement. [`StarTrack::displacement_px`] is used by backends: exact
//! perspective and roll, the lens's distortion through its derivative at mid-exposure. [`StarTrack::exact_px`] has the
//! complete distortion; the planner measures the error of the first with the second. Without distortion they agree
//! (test below).

use crate::exposure::pose::{Pose, ROLL, SHIFT};
use glam::{DQuat, DVec2, DVec3};
use sky::astrometry::CameraGeometry;

/// Place of one star at mid-exposure without jitter.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StarPlace {
    /// Position on the detector, px.
    pub mid_px: [f64; 2],
    /// Direction as tangents (X/Z, Y/Z), sensor axes, without distortion.
    pub tangent: DVec2,
}

/// A place and the data needed to turn a pose into a displacement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StarTrack {
    /// The place.
    pub place: StarPlace,
    /// Derivative of the pixel position by the tangents, px: rows x and y.
    pub px_per_tangent: [[f64; 2]; 2],
    /// Position relative to the principal point, px.
    pub from_principal_px: [f64; 2],
}

impl StarPlace {
    /// Returns the track of a direction in sensor axes; `None` outside the camera's domain.
    #[inline]
    pub fn of_direction(camera: &CameraGeometry, mid_sensor: DVec3) -> Option<Self> {
        let tangent = camera.tangent(mid_sensor)?;
        Some(Self { mid_px: camera.pixel_of_tangent(tangent), tangent })
    }

    /// Returns the track of a pixel position; `None` when no direction is imaged.
    pub fn of_pixel(camera: &CameraGeometry, mid_px: [f64; 2]) -> Option<Self> {
        let tangent = camera.tangent_of_pixel(mid_px)?;
        Some(Self { mid_px, tangent })
    }

    /// Returns the unit direction at mid-exposure, sensor axes.
    pub fn mid_sensor(&self) -> DVec3 {
        self.tangent.extend(1.0).normalize()
    }
}

impl StarTrack {
    /// Returns the track of a star at `place`.
    #[inline]
    pub fn new(camera: &CameraGeometry, place: StarPlace) -> Self {
        let [cx, cy] = camera.parameters().principal_point_px;
        let [x, y] = place.mid_px;
        let px_per_tangent = camera.px_per_tangent(place.tangent);
        Self { place, px_per_tangent, from_principal_px: [x - cx, y - cy] }
    }

    /// Returns the displacement from mid-exposure at `pose` as backends draw it, px.
    #[inline]
    pub fn displacement_px(&self, pose: &Pose) -> [f64; 2] {
        let [du, dv] = tangent_step(self.place.tangent, pose);
        let moved = self.px_per_tangent.map(|[a, b]| a * du + b * dv);
        rolled_and_shifted(moved, self.from_principal_px, pose)
    }

    /// Returns the displacement from mid-exposure at `pose` including distortion, px.
    pub fn exact_px(&self, camera: &CameraGeometry, pose: &Pose) -> [f64; 2] {
        if !camera.is_distorted() {
            return self.displacement_px(pose);
        }
        let [du, dv] = tangent_step(self.place.tangent, pose);
        let [x, y] = camera.pixel_of_tangent(self.place.tangent + DVec2::new(du, dv));
        let [mx, my] = camera.pixel_of_tangent(self.place.tangent);
        rolled_and_shifted([x - mx, y - my], self.from_principal_px, pose)
    }

    /// Returns the place at `pose` including distortion, px; `None` outside the camera's domain.
    pub fn seen_px(&self, camera: &CameraGeometry, pose: &Pose) -> Option<[f64; 2]> {
        let tangent = self.place.tangent;
        let forward = 1.0 + pose.0[6] * tangent.x + pose.0[7] * tangent.y + pose.0[8];
        let [du, dv] = tangent_step(tangent, pose);
        let is_imaged = forward > 0.0 && (tangent + DVec2::new(du, dv)).length() <= camera.largest_tangent();
        let [dx, dy] = self.exact_px(camera, pose);
        is_imaged.then_some([self.place.mid_px[0] + dx, self.place.mid_px[1] + dy])
    }
}

/// Returns the change of a direction's tangents: with `d = (R - I) (u, v, 1)`, `(d_x - u d_z, d_y - v d_z) / (1 +
/// d_z)`.
#[inline]
fn tangent_step(DVec2 { x: u, y: v }: DVec2, Pose(p): &Pose) -> [f64; 2] {
    let d = |row: usize| p[3 * row] * u + p[3 * row + 1] * v + p[3 * row + 2];
    let dz = d(2);
    let scale = 1.0 / (1.0 + dz);
    [(d(0) - u * dz) * scale, (d(1) - v * dz) * scale]
}

#[inline]
fn rolled_and_shifted([x, y]: [f64; 2], [rx, ry]: [f64; 2], Pose(p): &Pose) -> [f64; 2] {
    let (sin, less) = (p[ROLL], p[ROLL + 1]);
    let (ax, ay) = (rx + x, ry + y);
    [x + less * ax - sin * ay + p[SHIFT], y + sin * ax + less * ay + p[SHIFT + 1]]
}

/// Returns the direction of a fixed star after the sensor axes have turned by `rotation_rad`.
pub fn turned(mid_sensor: DVec3, rotation_rad: DVec3) -> DVec3 {
    DQuat::from_scaled_axis(-rotation_rad) * mid_sensor
}

#[cfg(test)]
mod tests {
    use super::*;
    use sky::astrometry::{BrownConrady, CameraParameters};

    fn camera(distortion: BrownConrady) -> CameraGeometry {
        let parameters = CameraParameters {
            width_px: 8192,
            height_px: 8192,
            focal_px: [9000.0, 9000.0],
            principal_point_px: [4095.5, 4100.0],
            distortion,
        };
        CameraGeometry::new(parameters).unwrap()
    }

    /// Returns the largest difference of a displacement from that of two exact projections, px.
    fn worst(camera: &CameraGeometry, displacement: impl Fn(&StarTrack, &Pose) -> [f64; 2]) -> f64 {
        let rotation = DVec3::new(1.1e-3, -0.7e-3, 2e-3);
        let pose = Pose::new(DQuat::from_scaled_axis(-rotation), 0.0, [0.0; 2]);
        let mut worst = 0.0_f64;
        for px in [[10.0, 20.0], [8100.0, 4000.0], [4095.5, 4100.0], [2000.3, 7000.7]] {
            let track = StarTrack::new(camera, StarPlace::of_pixel(camera, px).unwrap());
            let moved = camera.project(turned(track.place.mid_sensor(), rotation)).unwrap();
            let [dx, dy] = displacement(&track, &pose);
            worst = worst.max((moved[0] - px[0] - dx).hypot(moved[1] - px[1] - dy));
        }
        worst
    }

    #[test]
    fn displacements_are_those_of_exact_projections() {
        let pinhole = camera(BrownConrady::default());
        let lens = camera(BrownConrady { k1: -0.08, k2: 0.02, k3: 0.0, p1: 1e-3, p2: -5e-4 });
        for camera in [pinhole, lens] {
            let exact = worst(&camera, |track, pose| track.exact_px(&camera, pose));
            assert!(exact < 1e-8, "exact: {exact:e} px");
        }
        let drawn = worst(&pinhole, StarTrack::displacement_px);
        assert!(drawn < 1e-8, "pinhole: {drawn:e} px");
        let drawn = worst(&lens, StarTrack::displacement_px);
        assert!((1e-4..0.1).contains(&drawn), "lens: the derivative leaves out second order: {drawn:e} px");
    }
}
