//! What moves the image during one exposure.

use crate::attitude::LosPath;
use crate::exposure::features::{Features, features};
use crate::exposure::pixel_path::{PixelPath, PixelPoint};
use glam::DVec3;

/// Smooth rotation and jitter of the line of sight; a commanded image path, when given, replaces the jitter.
#[derive(Debug, Clone, PartialEq)]
pub struct Motion {
    /// Line of sight about mid-exposure.
    pub los: LosPath,
    /// Commanded displacement of the image on the detector.
    pub image_path: Option<PixelPath>,
}

impl Motion {
    /// Smooth rotation vector `tau` of an exposure away from its middle, sensor axes, rad.
    #[must_use]
    pub fn smooth_rotation_rad(&self, tau: f64) -> DVec3 {
        self.los.smooth_rotation_rad(tau * self.los.exposure_s)
    }

    /// True when nothing but smooth rotation moves the image.
    #[must_use]
    pub fn is_smooth(&self) -> bool {
        self.image_path.is_none() && self.los.jitter.is_still()
    }

    /// Features at `tau` in [-1/2, 1/2].
    #[must_use]
    pub fn features_at(&self, tau: f64) -> Features {
        let shared = match &self.image_path {
            None => {
                let jitter = self.los.jitter_rotation_rad(tau * self.los.exposure_s);
                [jitter.x, jitter.y, jitter.z, 0.0]
            }
            Some(path) => point_at(path, tau, self.los.exposure_s).shared(),
        };
        features(tau, shared)
    }
}

/// Position of a path at `tau`.
fn point_at(path: &PixelPath, tau: f64, exposure_s: f64) -> PixelPoint {
    let points = path.points();
    let still = PixelPoint { t_s: 0.0, dx_px: 0.0, dy_px: 0.0, roll_rad: 0.0 };
    match path {
        PixelPath::Samples(_) => {
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the list")]
            let i = ((tau + 0.5) * points.len() as f64).clamp(0.0, points.len() as f64 - 1.0) as usize;
            points.get(i).copied().unwrap_or(still)
        }
        PixelPath::Line(_) => {
            let t_s = (tau + 0.5) * exposure_s;
            let after = points.partition_point(|point| point.t_s <= t_s);
            match (after.checked_sub(1).and_then(|i| points.get(i)), points.get(after)) {
                (Some(a), Some(b)) => a.towards(b, (t_s - a.t_s) / (b.t_s - a.t_s)),
                (Some(only), None) | (None, Some(only)) => *only,
                (None, None) => still,
            }
        }
    }
}
