//! Directions -> places and mean places, eight stars at a time: the vector form of `place` for single stars.
//!
//! Domain: a lens without distortion and one mean pose for all rows (a global shutter, or a still image), where it is
//! the same arithmetic; otherwise stars are placed one by one. Test: `blocks_place_as_single_stars_do` in `place`.

use crate::exposure::pose::{Pose, ROLL, SHIFT};
use crate::{attitude::LosPath, exposure::correction::Correction, exposure::mean_field::MeanField};
use glam::DVec3;
use sky::astrometry::CameraGeometry;

/// Distances from the detector within which the light of stars can reach it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Margins {
    /// For ordinary stars, px.
    pub(super) ordinary_px: f64,
    /// For those of `from_e` and more, which may be drawn whole, px.
    pub(super) whole_px: f64,
    /// Electrons from which on a star may be drawn whole.
    pub(super) from_e: f64,
}

/// Number of stars in a block.
pub(super) const STARS: usize = 8;

/// Numbers of eight stars.
type Eight = [f64; STARS];

/// Data common to all stars of an exposure.
#[derive(Debug, Clone, Copy)]
pub(super) struct BlockPlacer {
    /// Rows of the rotation from ICRF to sensor axes.
    rows: [DVec3; 3],
    focal_px: [f64; 2],
    centre_px: [f64; 2],
    /// Square of the largest tangent that is imaged.
    domain_squared: f64,
    pose: Pose,
    correction: Correction,
    /// Limits of visible mean places: above the first and below the second; of ordinary stars, and of whole ones.
    sight_px: [[f64; 2]; 2],
    reach_px: [[f64; 2]; 2],
}

/// Places of eight stars; values of stars that are not in sight are undefined.
#[derive(Debug, Clone, Copy)]
pub(super) struct Places {
    pub(super) in_sight: [bool; STARS],
    /// In sight if they are drawn whole.
    pub(super) in_reach: [bool; STARS],
    pub(super) tangent: [Eight; 2],
    pub(super) mid_px: [Eight; 2],
    pub(super) mean_px: [Eight; 2],
}

impl BlockPlacer {
    /// Returns a placer for one exposure; `None` outside the domain.
    pub(super) fn new(camera: &CameraGeometry, los: &LosPath, means: &MeanField, margins: Margins) -> Option<Self> {
        let (pose, correction) = means.same_for_all_rows()?;
        if camera.is_distorted() {
            return None;
        }
        let parameters = camera.parameters();
        let inverse = los.mid_sensor_from_icrf.inverse();
        let last = [camera.width_px(), camera.height_px()].map(|side| side as f64 - 1.0);
        let within = |margin_px: f64| [[-margin_px; 2], last.map(|last| last + margin_px)];
        Some(Self {
            rows: [DVec3::X, DVec3::Y, DVec3::Z].map(|axis| inverse.apply(axis)),
            focal_px: parameters.focal_px,
            centre_px: parameters.principal_point_px,
            domain_squared: camera.largest_tangent().powi(2),
            pose,
            correction,
            sight_px: within(margins.ordinary_px),
            reach_px: within(margins.whole_px),
        })
    }

    /// Places eight directions, by component.
    #[inline(always)]
    pub(super) fn place(&self, [x, y, z]: &[Eight; 3]) -> Places {
        let mut places = Places {
            in_sight: [false; STARS],
            in_reach: [false; STARS],
            tangent: [[0.0; STARS]; 2],
            mid_px: [[0.0; STARS]; 2],
            mean_px: [[0.0; STARS]; 2],
        };
        let [row_x, row_y, row_z] = self.rows;
        let [cx, cy] = self.centre_px;
        let [fx, fy] = self.focal_px;
        for k in 0..STARS {
            let along = |row: DVec3| row.x * x[k] + row.y * y[k] + row.z * z[k];
            let forward = along(row_z);
            let (u, v) = (along(row_x) / forward, along(row_y) / forward);
            places.tangent[0][k] = u;
            places.tangent[1][k] = v;
            places.mid_px[0][k] = cx + fx * u;
            places.mid_px[1][k] = cy + fy * v;
            // A direction behind the camera, or beyond the domain, is not imaged.
            places.in_sight[k] = (forward > 0.0) & (u * u + v * v <= self.domain_squared);
        }
        self.mean(&mut places);
        let is_within = |x: f64, y: f64, [[left, top], [right, bottom]]: [[f64; 2]; 2]| {
            (x > left) & (x < right) & (y > top) & (y < bottom)
        };
        for k in 0..STARS {
            let (x, y) = (places.mean_px[0][k], places.mean_px[1][k]);
            places.in_reach[k] = places.in_sight[k] & is_within(x, y, self.reach_px);
            places.in_sight[k] &= is_within(x, y, self.sight_px);
        }
        places
    }

    #[inline(always)]
    fn mean(&self, places: &mut Places) {
        let Pose(p) = &self.pose;
        let (sin, less, shift) = (p[ROLL], p[ROLL + 1], [p[SHIFT], p[SHIFT + 1]]);
        let [cx, cy] = self.centre_px;
        let [fx, fy] = self.focal_px;
        for k in 0..STARS {
            let (u, v) = (places.tangent[0][k], places.tangent[1][k]);
            let (px, py) = (places.mid_px[0][k], places.mid_px[1][k]);
            let turned = |row: usize| p[3 * row] * u + p[3 * row + 1] * v + p[3 * row + 2];
            let back = turned(2);
            let scale = 1.0 / (1.0 + back);
            let dx = fx * ((turned(0) - u * back) * scale);
            let dy = fy * ((turned(1) - v * back) * scale);
            let (ax, ay) = (px - cx + dx, py - cy + dy);
            places.mean_px[0][k] = px + (dx + less * ax - sin * ay + shift[0]);
            places.mean_px[1][k] = py + (dy + sin * ax + less * ay + shift[1]);
        }
        self.correction.add_to_eight(&places.mid_px, &mut places.mean_px);
    }
}
