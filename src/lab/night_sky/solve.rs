//! Detections -> attitude, with nothing known but the camera: "lost in space".
//!
//! The brightest detections are taken in pairs. Every pair of bright catalog stars of the same separation, within the
//! tolerance of the scale, gives two attitudes; each is tried on the other detections, and those that three of them
//! agree with are refined and counted on many. An attitude is accepted when [`LEAST_MATCHES`] and half of the brightest
//! detections have a catalog star within `MATCH_PX`: by chance that happens less than once in 1e9 skies.

use crate::geometry::{Freedom, Geometry, Tie};
use crate::{detect::Detection, sky_stars::SkyStar};
use base::axes::{Icrf, Rotation, Sensor};
use glam::{DMat3, DQuat, DVec3};

/// Catalog stars per field that pairs are made of, and that detections are looked up among; the mean over the sky.
const STARS_PER_FIELD: [f64; 2] = [30.0, 60.0];
/// Most of them on the sky.
const MOST_STARS: [usize; 2] = [16_000, 32_000];
/// Detections that pairs are made of.
const PAIRED: usize = 10;
/// Detections that an attitude is counted on.
const COUNTED: usize = 24;
/// How near a catalog star must be after the refinement, px.
const MATCH_PX: f64 = 3.0;
/// Least number of matches.
pub const LEAST_MATCHES: usize = 8;
/// How far the camera's scale may be off, one try after the other.
pub const SCALE_TOLERANCES: [f64; 2] = [0.006, 0.03];
/// Error of a detection's place besides, px.
const PLACE_PX: f64 = 2.0;

/// The catalog's bright stars, ordered for look-ups.
pub struct BrightSky {
    /// By declination.
    stars: Vec<SkyStar>,
    /// Pairs by their angle, rad.
    pairs: Vec<(f64, u32, u32)>,
}

impl BrightSky {
    /// Takes the brightest of `stars` (brightest first): as many as fields of `solid_angle` (steradian) need; pairs up
    /// to `widest_rad`.
    pub fn new(stars: &[SkyStar], solid_angle: f64, widest_rad: f64) -> Self {
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a number of stars")]
        let wanted = |i: usize| (STARS_PER_FIELD[i] * 4.0 * core::f64::consts::PI / solid_angle) as usize;
        let [paired, known] = [0, 1].map(|i| wanted(i).min(MOST_STARS[i]).min(stars.len()));
        let faintest_paired = paired.checked_sub(1).map_or(f64::MIN, |last| stars[last].mag_g);
        let mut stars = stars[..known].to_vec();
        stars.sort_by(|a, b| a.direction.z.total_cmp(&b.direction.z));
        let (mut pairs, least_cos) = (Vec::new(), widest_rad.cos());
        let widest_z = 2.0 * (0.5 * widest_rad).sin();
        let is_paired = |star: &SkyStar| star.mag_g <= faintest_paired;
        for (i, a) in stars.iter().enumerate().filter(|(_, star)| is_paired(star)) {
            for (k, b) in stars.iter().enumerate().skip(i + 1).filter(|(_, star)| is_paired(star)) {
                if b.direction.z - a.direction.z > widest_z {
                    break;
                }
                let cos = a.direction.dot(b.direction);
                if cos > least_cos {
                    #[allow(clippy::cast_possible_truncation, reason = "at most 32,000")]
                    pairs.push((2.0 * (0.5 * a.direction.distance(b.direction)).asin(), i as u32, k as u32));
                }
            }
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0));
        Self { stars, pairs }
    }

    /// Returns the nearest star within `radius_rad` of a direction.
    fn nearest(&self, direction: DVec3, radius_rad: f64) -> Option<&SkyStar> {
        let first = self.stars.partition_point(|star| star.direction.z < direction.z - radius_rad);
        let near = self.stars[first..].iter().take_while(|star| star.direction.z <= direction.z + radius_rad);
        let by_distance = near.map(|star| (star.direction.distance_squared(direction), star));
        let best = by_distance.min_by(|a, b| a.0.total_cmp(&b.0))?;
        (best.0 <= radius_rad * radius_rad).then_some(best.1)
    }

    /// Returns the attitude of a camera whose detections have these directions in its axes, and the number of stars
    /// that agree; `start` has its geometry.
    pub fn solve(&self, start: &Geometry, found: &[(Detection, DVec3)], tolerance: f64) -> Option<(Geometry, usize)> {
        let paired = &found[..found.len().min(PAIRED)];
        for last in 1..paired.len() {
            for first in 0..last {
                let pair = [paired[first].1, paired[last].1];
                if let Some(solved) = self.try_pair(start, found, pair, tolerance) {
                    return Some(solved);
                }
            }
        }
        None
    }

    fn try_pair(
        &self,
        start: &Geometry,
        found: &[(Detection, DVec3)],
        [a, b]: [DVec3; 2],
        tolerance: f64,
    ) -> Option<(Geometry, usize)> {
        let angle = a.angle_between(b);
        let place_rad = PLACE_PX / start.focal_px;
        let slack = tolerance * angle + place_rad;
        // A short pair says little about the direction.
        if angle < 40.0 * place_rad {
            return None;
        }
        let from = self.pairs.partition_point(|pair| pair.0 < angle - slack);
        let seen = frame(a, b);
        for (_, i, k) in self.pairs[from..].iter().take_while(|pair| pair.0 <= angle + slack) {
            let [i, k] = [*i, *k].map(|place| self.stars[place as usize].direction);
            for (c, d) in [(i, k), (k, i)] {
                let attitude = Rotation::from_quat(DQuat::from_mat3(&(seen * frame(c, d).transpose())));
                if self.agrees(&attitude, found, tolerance, place_rad, 3)
                    && let Some(solved) = self.refined(start, attitude, found, tolerance)
                {
                    return Some(solved);
                }
            }
        }
        None
    }

    /// Returns true when `wanted` of the brighter detections beside a pair have a star.
    fn agrees(
        &self,
        attitude: &Rotation<Sensor, Icrf>,
        found: &[(Detection, DVec3)],
        tolerance: f64,
        place_rad: f64,
        wanted: usize,
    ) -> bool {
        let icrf_from_sensor = attitude.inverse();
        let (mut hits, mut misses) = (0, 0);
        let tried = found.len().min(PAIRED + 2);
        for (_, direction) in &found[..tried] {
            let radius = tolerance * direction.angle_between(DVec3::Z) + 2.0 * place_rad;
            if self.nearest(icrf_from_sensor.apply(*direction), radius).is_some() {
                hits += 1;
            } else {
                misses += 1;
            }
            // Two of them are the pair itself.
            if misses > tried.saturating_sub(wanted + 2) {
                return false;
            }
        }
        hits >= wanted + 2
    }

    fn refined(
        &self,
        start: &Geometry,
        attitude: Rotation<Sensor, Icrf>,
        found: &[(Detection, DVec3)],
        tolerance: f64,
    ) -> Option<(Geometry, usize)> {
        let counted = &found[..found.len().min(COUNTED)];
        let mut geometry = Geometry { attitude, ..*start };
        let widest_px = counted.iter().map(|(_, v)| v.angle_between(DVec3::Z)).fold(0.0, f64::max) * start.focal_px;
        let mut radius_px = tolerance * widest_px + 2.0 * PLACE_PX;
        for _ in 0..4 {
            let ties = self.ties(&geometry, counted, radius_px);
            geometry =
                geometry.fitted(&ties, if ties.len() > 4 { Freedom::SCALE } else { Freedom::ATTITUDE })?.geometry;
            radius_px = (0.4 * radius_px).max(MATCH_PX);
        }
        if (geometry.focal_px / start.focal_px - 1.0).abs() > 1.5 * tolerance {
            return None;
        }
        let matches = self.ties(&geometry, counted, MATCH_PX).len();
        (matches >= LEAST_MATCHES.max(counted.len() / 2)).then_some((geometry, matches))
    }

    /// Returns detections with the stars that a geometry puts within `radius_px` of them.
    fn ties(&self, geometry: &Geometry, found: &[(Detection, DVec3)], radius_px: f64) -> Vec<Tie> {
        let icrf_from_sensor = geometry.attitude.inverse();
        let mut ties = Vec::new();
        for (detection, direction) in found {
            // `direction` is of the camera's own scale; the search is wide, the distance is that on the image.
            let wide = 4.0 * (radius_px + 10.0) / geometry.focal_px;
            let near = self.nearest_on_image(geometry, icrf_from_sensor.apply(*direction), wide, detection.px);
            ties.extend(near.filter(|(_, distance)| *distance <= radius_px).map(|(star, _)| Tie {
                direction: star.direction,
                px: detection.px,
                error_px: 1.0,
            }));
        }
        ties
    }

    fn nearest_on_image(
        &self,
        geometry: &Geometry,
        about: DVec3,
        radius_rad: f64,
        px: [f64; 2],
    ) -> Option<(&SkyStar, f64)> {
        let first = self.stars.partition_point(|star| star.direction.z < about.z - radius_rad);
        let near = self.stars[first..].iter().take_while(|star| star.direction.z <= about.z + radius_rad);
        let near = near.filter(|star| star.direction.distance_squared(about) < radius_rad * radius_rad);
        let distance =
            |star: &SkyStar| geometry.place(star.direction).map(|place| (place[0] - px[0]).hypot(place[1] - px[1]));
        near.filter_map(|star| Some((star, distance(star)?))).min_by(|a, b| a.1.total_cmp(&b.1))
    }
}

/// Returns axes that a pair defines: its middle, across it, and their product.
fn frame(a: DVec3, b: DVec3) -> DMat3 {
    let (middle, across) = ((a + b).normalize(), a.cross(b).normalize());
    DMat3::from_cols(middle, across.cross(middle), across)
}
