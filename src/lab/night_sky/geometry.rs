//! Where a camera puts directions: attitude, focal length, distortion and the atmosphere's stretch; fitted to stars.
//!
//! `x' = x (1 + k1 r^2 + k2 r^4 + k3 r^6) + tangential terms (p1, p2) + e1 x + e2 y`, `y' = ... + e2 x - e1 y`: Brown
//! and Conrady's model with a stretch. Refraction of air moves stars by `R tan z` towards the zenith (R = 58 arcsec),
//! so it shrinks lengths by R along the horizon and by R (1 + tan^2 z) across it: their mean goes into the focal
//! length, half their difference, `R tan^2 z / 2`, is the stretch. The constant part goes into the attitude.
//!
//! The optical axis (principal point) shows by the perspective alone: away from it by `c` px, a star at the tangent `x` moves by
//! `c x^2`, beside a constant part, which goes into the attitude. A [`Freedom`] lists the fitted terms.
//!
//! The stars call for the second radial term and for an axis off its place, or for neither (`fitted_with_terms`): nested models are compared by the ratio `F = (fall of chi^2 / added parameters) / (chi^2 / degrees of freedom)`, both fitted
//! to the stars that the wider one keeps. A term is taken from `LEAST_RATIO` on: chance passes it once in some thousand
//! frames. The strongest comes first. Tests: below; drawn frames in `tests/night_sky`.

use crate::newton::{Fitted, fit};
use crate::picture::rms;
use base::axes::{Icrf, Rotation, Sensor};
use base::least_squares::median;
use core::f64::consts::SQRT_2;
use glam::{DVec2, DVec3};
use sky::astrometry::BrownConrady;

/// Stars further away than this many spreads are left out of the geometry's fit.
const CLIP: f64 = 4.0;

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
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Freedom {
    /// Focal length.
    pub scale: bool,
    /// First radial and both tangential terms of the distortion.
    pub distortion: bool,
    /// Second radial term.
    pub second_radial: bool,
    /// Principal point: where the optical axis meets the detector.
    pub axis: bool,
    /// The stretch of the atmosphere.
    pub air: bool,
}

impl Freedom {
    /// The attitude alone.
    pub const ATTITUDE: Self = Self { scale: false, distortion: false, second_radial: false, axis: false, air: false };
    /// Focal length too.
    pub const SCALE: Self = Self { scale: true, ..Self::ATTITUDE };
    /// Radial and tangential distortion too.
    pub const DISTORTION: Self = Self { distortion: true, ..Self::SCALE };

    /// Returns the steps of the differences of all parameters, the rotation's first.
    fn steps(self) -> Vec<f64> {
        let groups: [(bool, &[f64]); 5] = [
            (self.scale, &[1e-4]),
            (self.distortion, &[1e-3, 1e-5, 1e-5]),
            (self.second_radial, &[1e-2]),
            (self.axis, &[1.0, 1.0]),
            (self.air, &[1e-6, 1e-6]),
        ];
        let free = groups.into_iter().filter(|(is_free, _)| *is_free).flat_map(|(_, steps)| steps);
        [1e-6; 3].iter().chain(free).copied().collect()
    }

    /// Returns the number of parameters.
    pub fn parameters(self) -> usize {
        self.steps().len()
    }

    /// Returns one number for each of the model's: those of `values` where they are free, 0 elsewhere.
    fn spread(self, values: &[f64]) -> Moves {
        let mut rest = values.iter().skip(3).copied();
        let mut next = |is_free: bool| if is_free { rest.next().unwrap_or(0.0) } else { 0.0 };
        Moves {
            scale: next(self.scale),
            first: [(); 3].map(|()| next(self.distortion)),
            second_radial: next(self.second_radial),
            axis_px: [(); 2].map(|()| next(self.axis)),
            stretch: [(); 2].map(|()| next(self.air)),
        }
    }
}

/// Changes of a geometry's numbers, or their standard errors.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct Moves {
    scale: f64,
    first: [f64; 3],
    second_radial: f64,
    axis_px: [f64; 2],
    stretch: [f64; 2],
}

/// A fitted geometry.
#[derive(Debug, Clone, PartialEq)]
pub struct FittedGeometry {
    /// The geometry.
    pub geometry: Geometry,
    /// Standard error of the focal length, px; 0 where it was kept, as the others.
    pub focal_error_px: f64,
    /// Standard error of the second radial term.
    pub second_radial_error: f64,
    /// Standard errors of the principal point, px.
    pub axis_errors_px: [f64; 2],
    /// Standard error of the stretch.
    pub stretch_error: f64,
    /// Sum of squared distances in units of the ties' errors.
    pub chi2: f64,
}

impl Geometry {
    /// Returns the place of an apparent direction, px; `None` behind the camera.
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
    pub fn fitted(&self, ties: &[Tie], freedom: Freedom) -> Option<FittedGeometry> {
        let steps = freedom.steps();
        let count = steps.len();
        // Two numbers of each star; a few stars more than needed.
        if 2 * ties.len() < count + 3 {
            return None;
        }
        let residuals = |p: &[f64]| self.moved(p, freedom).residuals(ties);
        let Fitted { values, errors, chi2 } = fit(&vec![0.0; count], &steps, residuals)?;
        // The ties may scatter more than their errors say.
        let excess = (chi2 / (2 * ties.len() - count) as f64).max(1.0).sqrt();
        let errors: Vec<f64> = errors.into_iter().map(|error| error * excess).collect();
        let errors = freedom.spread(&errors);
        Some(FittedGeometry {
            geometry: self.moved(&values, freedom),
            focal_error_px: errors.scale * self.focal_px,
            second_radial_error: errors.second_radial,
            axis_errors_px: errors.axis_px,
            stretch_error: errors.stretch[0].max(errors.stretch[1]),
            chi2,
        })
    }

    /// Returns the geometry with the parameters of `freedom` added.
    fn moved(&self, p: &[f64], freedom: Freedom) -> Self {
        let by = freedom.spread(p);
        let BrownConrady { k1, k2, k3, p1, p2 } = self.distortion;
        let [by_k1, by_p1, by_p2] = by.first;
        Self {
            attitude: self.attitude.rotated_by(DVec3::from_slice(p)),
            focal_px: self.focal_px * (1.0 + by.scale),
            centre_px: [0, 1].map(|i| self.centre_px[i] + by.axis_px[i]),
            distortion: BrownConrady { k1: k1 + by_k1, k2: k2 + by.second_radial, k3, p1: p1 + by_p1, p2: p2 + by_p2 },
            stretch: [0, 1].map(|i| self.stretch[i] + by.stretch[i]),
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
pub fn stretch_axis(stretch: [f64; 2]) -> (f64, f64) {
    // Lengths along the vertical shrink: the axis of the negative stretch.
    let axis = 0.5 * (-stretch[1]).atan2(-stretch[0]);
    (axis.to_degrees().rem_euclid(180.0), stretch[0].hypot(stretch[1]))
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

/// Least F ratio of a term with one parameter (second radial), and of one with two (axis).
const LEAST_RATIO: [f64; 2] = [15.0, 10.0];
/// Least degrees of freedom that are left.
const LEAST_FREEDOM: usize = 10;

/// Fits the geometry with the terms of `base` and those that are significant; the terms that it has in the end.
pub(crate) fn fitted_with_terms(start: &Geometry, ties: &[Tie], base: Freedom) -> Option<(FittedGeometry, Freedom)> {
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

    const AIR: Freedom = Freedom { air: true, ..Freedom::DISTORTION };

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
        let found = start.fitted(&ties(60), AIR).unwrap();
        assert!((found.geometry.focal_px - 5114.0).abs() < 0.01, "{found:?}");
        assert!((found.geometry.distortion.k1 - 0.11).abs() < 1e-4 && (found.geometry.stretch[0] + 2e-4).abs() < 1e-7);
        let without = start.fitted(&ties(60), Freedom::DISTORTION).unwrap().geometry;
        let worst =
            ties(60).iter().map(|tie| (without.place(tie.direction).unwrap()[0] - tie.px[0]).abs()).fold(0.0, f64::max);
        assert!(worst > 0.03, "control: without the stretch {worst} px remain");
        assert_eq!(start.fitted(&ties(4), AIR), None, "too few");
    }

    #[test]
    fn second_radial_term_and_axis_come_back_where_they_are_free() {
        let truth = Geometry {
            centre_px: [541.5, 363.5],
            distortion: BrownConrady { k2: 3.0, ..truth().distortion },
            stretch: [0.0; 2],
            ..truth()
        };
        let at = |tie: &Tie| Tie { px: truth.place(tie.direction).unwrap(), ..*tie };
        let ties: Vec<Tie> = ties(60).iter().map(at).collect();
        let start = Geometry { centre_px: [511.5, 383.5], distortion: BrownConrady::default(), ..truth };
        let all = Freedom { second_radial: true, axis: true, ..Freedom::DISTORTION };
        let found = start.fitted(&ties, all).unwrap();
        assert!((found.geometry.distortion.k2 - 3.0).abs() < 1e-3, "{found:?}");
        let off = [0, 1].map(|i| found.geometry.centre_px[i] - truth.centre_px[i]);
        assert!(off[0].hypot(off[1]) < 0.01, "{off:?}");
        assert!(found.second_radial_error > 0.0 && found.axis_errors_px[0] > 0.0 && found.stretch_error == 0.0);
        let without = start.fitted(&ties, Freedom::DISTORTION).unwrap();
        assert!(without.chi2 > 30.0 * (1.0 + found.chi2), "control: {} and {}", without.chi2, found.chi2);
    }

    #[test]
    fn the_vertical_is_where_lengths_shrink() {
        // Lengths along y are smaller: the vertical is down, 90 degrees from right.
        let (axis_deg, size) = stretch_axis([2e-4, 0.0]);
        assert!((axis_deg - 90.0).abs() < 1e-9 && (size - 2e-4).abs() < 1e-12, "{axis_deg}");
        assert!(stretch_axis([-1e-4, 0.0]).0.abs() < 1e-9, "along x");
    }
}

#[cfg(test)]
mod terms_tests {
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
        fitted_with_terms(&geometry(0.0, 0.0), &ties, Freedom::DISTORTION).unwrap()
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
