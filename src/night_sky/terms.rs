//! Ties -> the terms of the geometry that the stars call for: second radial term, optical axis off its place.
//!
//! Nested models are compared by the ratio `F = (fall of chi^2 / added parameters) / (chi^2 / degrees of freedom)`, both fitted
//! to the stars that the wider one keeps. A term is taken from [`LEAST_RATIO`] on: chance passes it once in some thousand
//! frames. The strongest comes first. Tests: below; drawn frames in `tests/night_sky`.

use crate::field::clipped;
use crate::geometry::{FittedGeometry, Freedom, Geometry, Tie};

/// Least F ratio of a term with one parameter (second radial), and of one with two (axis).
const LEAST_RATIO: [f64; 2] = [15.0, 10.0];
/// Least degrees of freedom that are left.
const LEAST_FREEDOM: usize = 10;

/// Fits the geometry with the terms of `base` and those that are significant; the terms that it has in the end.
pub(crate) fn fitted(start: &Geometry, ties: &[Tie], base: Freedom) -> Option<(FittedGeometry, Freedom)> {
    let (mut best, mut freedom) = (clipped(start, ties, base)?.0, base);
    for _ in 0..LEAST_RATIO.len() {
        let wider = [Freedom { second_radial: true, ..freedom }, Freedom { axis: true, ..freedom }];
        let tried = wider.into_iter().filter(|wider| *wider != freedom).filter_map(|wider| {
            let (found, ratio) = gain(start, ties, freedom, wider)?;
            let least = LEAST_RATIO[wider.parameters() - freedom.parameters() - 1];
            (ratio >= least).then_some((ratio / least, found, wider))
        });
        let Some((_, found, wider)) = tried.max_by(|a, b| a.0.total_cmp(&b.0)) else { break };
        (best, freedom) = (found, wider);
    }
    Some((best, freedom))
}

/// Returns the wider model's fit and its F ratio.
fn gain(start: &Geometry, ties: &[Tie], narrow: Freedom, wide: Freedom) -> Option<(FittedGeometry, f64)> {
    let (found, kept) = clipped(start, ties, wide)?;
    let left = (2 * kept.len()).checked_sub(wide.parameters()).filter(|left| *left >= LEAST_FREEDOM)?;
    let before = start.fitted(&kept, narrow)?.chi2;
    let added = (wide.parameters() - narrow.parameters()) as f64;
    let ratio = (before - found.chi2) / added / (found.chi2 / left as f64).max(f64::MIN_POSITIVE);
    Some((found, ratio))
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::axes::sensor_from_ra_dec_roll;
    use glam::DVec3;
    use sky::astrometry::BrownConrady;

    const ERROR_PX: f64 = 0.05;

    fn geometry(k2: f64, off_px: f64) -> Geometry {
        Geometry {
            attitude: sensor_from_ra_dec_roll(1.0, 0.5, 2.0),
            focal_px: 2500.0,
            centre_px: [511.5 + off_px, 511.5 - 0.5 * off_px],
            distortion: BrownConrady { k1: -0.05, k2, k3: 0.0, p1: 1e-4, p2: 0.0 },
            stretch: [0.0; 2],
        }
    }

    /// Returns stars over the field with noise of [`ERROR_PX`] along each axis.
    fn ties(truth: &Geometry, seed: u32) -> Vec<Tie> {
        let share = |word: u32| f64::from(word) / f64::from(u32::MAX);
        let of = |i: u32| {
            let words = base::random::philox([i, seed, 0, 0], [7, 9]).map(share);
            let direction = DVec3::new(0.4 * (words[0] - 0.5), 0.4 * (words[1] - 0.5), 1.0).normalize();
            let direction = truth.attitude.inverse().apply(direction);
            let noise = base::random::philox([i, seed, 1, 0], [7, 9]).map(share);
            // Box and Muller's pair of Gaussian numbers.
            let (size, angle) = ((-2.0 * noise[0].max(1e-12).ln()).sqrt(), core::f64::consts::TAU * noise[1]);
            let place = truth.place(direction).unwrap();
            let px = [place[0] + ERROR_PX * size * angle.cos(), place[1] + ERROR_PX * size * angle.sin()];
            Tie { direction, px, error_px: ERROR_PX }
        };
        (0..50).map(of).collect()
    }

    fn found(k2: f64, off_px: f64, seed: u32) -> (FittedGeometry, Freedom) {
        let ties = ties(&geometry(k2, off_px), seed);
        fitted(&geometry(0.0, 0.0), &ties, Freedom::DISTORTION).unwrap()
    }

    #[test]
    fn terms_that_a_camera_has_are_found_within_their_errors() {
        for seed in 0..4 {
            let (fit, freedom) = found(0.5, 0.0, seed);
            assert!(freedom.second_radial && !freedom.axis, "{freedom:?}");
            assert!((fit.geometry.distortion.k2 - 0.5).abs() < 4.0 * fit.second_radial_error, "{fit:?}");
            let (fit, freedom) = found(0.0, 40.0, seed);
            assert!(freedom.axis && !freedom.second_radial, "{freedom:?}");
            let off = fit.geometry.centre_px[0] - 551.5;
            assert!(off.abs() < 4.0 * fit.axis_errors_px[0] && fit.axis_errors_px[0] < 8.0, "{off} px, {fit:?}");
            let (_, freedom) = found(0.5, 40.0, seed);
            assert!(freedom.axis && freedom.second_radial, "{freedom:?}");
        }
    }

    #[test]
    fn terms_that_a_camera_lacks_are_not_found() {
        let any = (10..40).filter(|seed| found(0.0, 0.0, *seed).1 != Freedom::DISTORTION).count();
        assert!(any <= 1, "{any} of 30 frames without such terms");
    }
}
