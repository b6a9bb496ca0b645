//! Stars of one field where a geometry puts them, and those that it is fitted to.

use crate::geometry::{FittedGeometry, Freedom, Geometry, Tie};
use crate::picture::rms;
use crate::{detect::Detection, measure::Spot, sky_stars::SkyStar};
use base::least_squares::median;
use core::f64::consts::SQRT_2;

/// Most stars that are measured: of deep layers the brightest.
const MOST_STARS: usize = 4000;
/// Stars of the catalog so near are one star for the image, px.
const MERGED_PX: f64 = 1.6;
/// Another star so near, with this share of the light, is in a star's pixels.
const BLEND_PX: f64 = 6.0;
const BLEND_SHARE: f64 = 0.05;
/// Least SNR of the stars that the geometry is fitted to.
pub(crate) const TIE_SNR: f64 = 10.0;
/// Stars further away than this many spreads are left out of the geometry's fit.
const CLIP: f64 = 4.0;
/// Error of the places of stars besides noise, px.
const PLACE_FLOOR_PX: f64 = 0.03;

/// A star of the field, where the geometry puts it.
#[derive(Debug, Clone)]
pub(crate) struct FieldStar {
    pub star: SkyStar,
    pub px: [f64; 2],
    /// Numbers of the catalog's stars that it is made of.
    pub members: Vec<u32>,
    pub is_blended: bool,
}

/// Returns the stars on the image, brightest first; stars that the image cannot separate as one.
pub(crate) fn on_image(stars: Vec<SkyStar>, geometry: &Geometry) -> Vec<FieldStar> {
    let mut field: Vec<FieldStar> = Vec::new();
    for star in stars.into_iter().take(MOST_STARS) {
        let Some(px) = geometry.place(star.direction) else { continue };
        match field.iter_mut().find(|other| (other.px[0] - px[0]).hypot(other.px[1] - px[1]) < MERGED_PX) {
            Some(other) => merge(other, &star, px),
            None => field.push(FieldStar { star, px, members: vec![star.id], is_blended: false }),
        }
    }
    let lights: Vec<([f64; 2], f64)> = field.iter().map(|one| (one.px, 10_f64.powf(-0.4 * one.star.mag_g))).collect();
    for (i, one) in field.iter_mut().enumerate() {
        let disturbs = |(k, (px, light)): (usize, &([f64; 2], f64))| {
            k != i && (px[0] - one.px[0]).hypot(px[1] - one.px[1]) < BLEND_PX && *light > BLEND_SHARE * lights[i].1
        };
        one.is_blended = lights.iter().enumerate().any(disturbs);
    }
    field
}

/// Adds a star to one that the image cannot separate from it.
fn merge(one: &mut FieldStar, other: &SkyStar, px: [f64; 2]) {
    let light = |mag: f64| 10_f64.powf(-0.4 * mag);
    let [a, b] = [one.star.mag_g, other.mag_g].map(light);
    let share = b / (a + b);
    one.star.direction = one.star.direction.lerp(other.direction, share).normalize();
    one.star.bp_rp += share * (other.bp_rp - one.star.bp_rp);
    one.star.mag_g = -2.5 * (a + b).log10();
    one.px = [0, 1].map(|i| one.px[i] + share * (px[i] - one.px[i]));
    one.members.push(other.id);
}

/// Returns detections with the stars of the field near them.
pub(crate) fn ties_of_detections(field: &[FieldStar], found: &[Detection], radius_px: f64) -> Vec<Tie> {
    let mut ties = Vec::new();
    for detection in found {
        let distance = |one: &FieldStar| (one.px[0] - detection.px[0]).hypot(one.px[1] - detection.px[1]);
        let nearest = field.iter().min_by(|a, b| distance(a).total_cmp(&distance(b)));
        let near = nearest.filter(|one| distance(one) < radius_px);
        let error_px = (1.0 / detection.sigma).hypot(0.05);
        ties.extend(near.map(|one| Tie { direction: one.star.direction, px: detection.px, error_px }));
    }
    ties
}

/// Returns the measured stars that a geometry is fitted to.
pub(crate) fn ties_of_spots(field: &[FieldStar], spots: &[Option<Spot>]) -> Vec<Tie> {
    let of = |(one, spot): (&FieldStar, &Option<Spot>)| {
        let spot = spot
            .as_ref()
            .filter(|spot| spot.is_placed && spot.snr() > TIE_SNR && !spot.is_saturated && !one.is_blended)?;
        Some(Tie { direction: one.star.direction, px: spot.px, error_px: spot.place_error_px.hypot(PLACE_FLOOR_PX) })
    };
    field.iter().zip(spots).filter_map(of).collect()
}

/// Fits a geometry, then again without the ties that are far from it; the ties that were kept.
pub(crate) fn clipped(start: &Geometry, ties: &[Tie], freedom: Freedom) -> Option<(FittedGeometry, Vec<Tie>)> {
    let mut kept = ties.to_vec();
    let mut fitted = start.fitted(&kept, freedom)?;
    for _ in 0..3 {
        let distance = |tie: &Tie| {
            fitted
                .geometry
                .place(tie.direction)
                .map_or(f64::MAX, |px| (px[0] - tie.px[0]).hypot(px[1] - tie.px[1]) / tie.error_px)
        };
        let mut all: Vec<f64> = kept.iter().map(distance).collect();
        let limit = CLIP * median(&mut all).max(1.0);
        kept = ties.iter().filter(|tie| distance(tie) <= limit).copied().collect();
        fitted = start.fitted(&kept, freedom)?;
    }
    Some((fitted, kept))
}

/// Returns the rms distance of ties from a geometry along an axis, the far ones left out, px.
pub(crate) fn rms_of(geometry: &Geometry, ties: &[Tie]) -> f64 {
    let off = |tie: &Tie| geometry.place(tie.direction).map(|px| (px[0] - tie.px[0]).hypot(px[1] - tie.px[1]));
    rms(ties.iter().filter_map(off).filter(|off| *off < 1.0)) / SQRT_2
}
