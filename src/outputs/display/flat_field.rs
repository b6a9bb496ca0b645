//! Non-uniformity of a display as a tracker sees it: light of one pixel at full grey, by place.
//!
//! A polynomial (degree 4 at most) of the place, scaled to -1..1 over the display, fitted to the flux of dots; 1 at its
//! brightest on the display. It is the flux of a *point*: the display's luminance, the lens's vignetting, and the solid
//! angle of a pixel together, which is what a star's magnitude needs; what the tracker's own optics vignette, as its
//! camera file states it, has been divided out before. Limits: structure finer than the grid of dots is not in it.
//! Tests below.

use base::least_squares::{Basis, median, rms};
use serde::{Deserialize, Serialize};

/// Highest degree.
const DEGREE: usize = 4;
/// A dot further off than this many standard deviations is left out.
const OUTLIER_SIGMA: f64 = 5.0;
/// Standard deviation over the median of absolute deviations, of normal errors.
const SIGMA_PER_MEDIAN: f64 = 1.4826;
/// A higher degree must lessen the residual by this share.
const WORTH: f64 = 0.98;
/// Least relative light of a display's pixel: below it the polynomial is not believed.
const LEAST: f64 = 0.05;
/// Rounds of leaving out and taking in again.
const MOST_ROUNDS: usize = 20;
/// Places along a side at which the brightest and the dimmest pixel are looked for.
const LOOKED_AT: usize = 65;

/// Numbers of a flat field, as a calibration file holds them.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FlatParameters {
    /// Highest degree.
    pub degree: usize,
    /// Coefficients in the order 1, x, y, x^2, x y, y^2 ...
    pub coefficient: Vec<f64>,
}

/// A display's flat field, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct FlatField {
    parameters: FlatParameters,
    size_px: [usize; 2],
}

/// A flat field, and the dots that it was fitted to.
#[derive(Debug, Clone, PartialEq)]
pub struct FlatFit {
    /// The flat field.
    pub flat: FlatField,
    /// Flux of one pixel where the flat field is 1, in the unit of the dots' flux per pixel.
    pub full_flux: f64,
    /// Residual of the dots, magnitudes rms.
    pub residual_mag_rms: f64,
    /// Dots left out.
    pub outliers: usize,
}

/// Returns the exponents of x and y of every term of a polynomial, in the order 1, x, y, x^2, x y, y^2 ...
pub(in crate::display) fn exponents(degree: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..=degree).flat_map(|sum| (0..=sum).map(move |j| (sum - j, j)))
}

impl FlatField {
    /// Checks the numbers.
    ///
    /// # Errors
    /// A sentence, when the count is wrong, or the light is not within 5 % to 100 % all over the display.
    pub fn new(parameters: FlatParameters, size_px: [usize; 2]) -> Result<Self, String> {
        let wanted = exponents(parameters.degree.min(DEGREE)).count();
        if parameters.degree > DEGREE || parameters.coefficient.len() != wanted {
            return Err(format!(
                "wanted {wanted} coefficients of a degree up to {DEGREE}, got {}",
                parameters.coefficient.len()
            ));
        }
        if let Some(wrong) = parameters.coefficient.iter().find(|c| !c.is_finite()) {
            return Err(format!("wanted coefficients that are numbers, got {wrong}"));
        }
        let flat = Self { parameters, size_px };
        let [least, most] = flat.range();
        if least >= LEAST && most <= 1.0 + 1e-6 {
            Ok(flat)
        } else {
            Err(format!("wanted relative light from {LEAST} to 1 all over the display, got {least:.3} to {most:.3}"))
        }
    }

    /// Returns the field with the same light everywhere.
    pub fn uniform(size_px: [usize; 2]) -> Self {
        Self { parameters: FlatParameters { degree: 0, coefficient: vec![1.0] }, size_px }
    }

    /// Returns the numbers as given.
    pub fn parameters(&self) -> &FlatParameters {
        &self.parameters
    }

    /// Returns the relative light of the pixel at a place, display px.
    pub fn at(&self, px: [f64; 2]) -> f64 {
        value(self.parameters.degree, &self.parameters.coefficient, px, self.size_px)
    }

    /// Returns the least and most light on the display.
    pub fn range(&self) -> [f64; 2] {
        let place = |i: usize, side: usize| i as f64 * (side as f64 - 1.0) / (LOOKED_AT as f64 - 1.0);
        let [width, height] = self.size_px;
        let all = (0..LOOKED_AT).flat_map(|i| (0..LOOKED_AT).map(move |j| [place(i, width), place(j, height)]));
        let light = all.map(|px| self.at(px));
        light.fold([f64::INFINITY, f64::NEG_INFINITY], |[least, most], l| [least.min(l), most.max(l)])
    }
}

fn terms(degree: usize, px: [f64; 2], size_px: [usize; 2]) -> impl Iterator<Item = f64> {
    let scaled = |i: usize| 2.0 * px[i] / (size_px[i] as f64 - 1.0).max(1.0) - 1.0;
    let (x, y) = (scaled(0), scaled(1));
    exponents(degree).map(move |(i, j)| x.powi(i as i32) * y.powi(j as i32))
}

/// Fits dots' places (display px) and fluxes per pixel.
///
/// # Errors
/// A sentence, when no degree makes a flat field of them.
pub fn fit_flat(dots: &[([f64; 2], f64)], size_px: [usize; 2]) -> Result<FlatFit, String> {
    let mut best: Option<(f64, FlatFit)> = None;
    let mut refusal = format!("wanted the flux of at least 2 dots, got {}", dots.len());
    for degree in 0..=DEGREE {
        match fit_degree(degree, dots, size_px) {
            Ok((score, fit)) if best.as_ref().is_none_or(|(obtained, _)| score < obtained * WORTH) => {
                best = Some((score, fit))
            }
            Ok(_) => {}
            Err(why) => refusal = why,
        }
    }
    best.map(|(_, fit)| fit).ok_or(refusal)
}

/// Returns the fit of one degree, and its residual computed as if every dot was left out of its own fit.
fn fit_degree(degree: usize, dots: &[([f64; 2], f64)], size_px: [usize; 2]) -> Result<(f64, FlatFit), String> {
    let count = exponents(degree).count();
    let mut agrees: Vec<bool> = dots.iter().map(|dot| dot.1 > 0.0 && dot.1.is_finite()).collect();
    for _ in 0..MOST_ROUNDS {
        let kept: Vec<([f64; 2], f64)> =
            dots.iter().zip(&agrees).filter(|(_, agrees)| **agrees).map(|(dot, _)| *dot).collect();
        if kept.len() < 2 * count || 4 * kept.len() < 3 * dots.len() {
            let (got, of) = (kept.len(), dots.len());
            return Err(format!("degree {degree}: wanted the flux of more dots that agree, got {got} of {of}"));
        }
        let (coefficient, basis) = solved(degree, &kept, size_px)?;
        let off = |dot: &([f64; 2], f64)| dot.1 / value(degree, &coefficient, dot.0, size_px) - 1.0;
        let mut sizes: Vec<f64> = kept.iter().map(|dot| off(dot).abs()).collect();
        let limit = (OUTLIER_SIGMA * SIGMA_PER_MEDIAN * median(&mut sizes)).max(1e-9);
        // All dots are tested again: those that an outlier pulled away come back.
        let now: Vec<bool> = dots.iter().map(|dot| off(dot).abs() <= limit).collect();
        if now == agrees {
            let residual_mag_rms = 2.5 / core::f64::consts::LN_10 * rms(kept.iter().map(off));
            let score = rms(kept.iter().enumerate().map(|(i, dot)| off(dot) / (1.0 - basis.leverage(i)).max(1e-6)));
            let (flat, full_flux) = normalised(degree, coefficient, size_px)?;
            return Ok((score, FlatFit { flat, full_flux, residual_mag_rms, outliers: dots.len() - kept.len() }));
        }
        agrees = now;
    }
    Err(format!("degree {degree}: no lasting choice of dots that agree"))
}

fn solved(degree: usize, dots: &[([f64; 2], f64)], size_px: [usize; 2]) -> Result<(Vec<f64>, Basis), String> {
    let rows: Vec<Vec<f64>> = dots.iter().map(|dot| terms(degree, dot.0, size_px).collect()).collect();
    let columns = (0..exponents(degree).count()).map(|c| rows.iter().map(|row| row[c]).collect());
    let basis =
        Basis::of(columns.collect()).ok_or_else(|| format!("degree {degree}: the dots are in too few places"))?;
    let flux: Vec<f64> = dots.iter().map(|dot| dot.1).collect();
    Ok((basis.solve(&flux), basis))
}

fn value(degree: usize, coefficient: &[f64], px: [f64; 2], size_px: [usize; 2]) -> f64 {
    terms(degree, px, size_px).zip(coefficient).map(|(term, c)| term * c).sum()
}

/// Returns the flat field that is 1 at its brightest, and the factor that it was divided by.
fn normalised(degree: usize, coefficient: Vec<f64>, size_px: [usize; 2]) -> Result<(FlatField, f64), String> {
    let whole = FlatField { parameters: FlatParameters { degree, coefficient }, size_px };
    let full_flux = whole.range()[1];
    let coefficient = whole.parameters.coefficient.iter().map(|c| c / full_flux).collect();
    Ok((FlatField::new(FlatParameters { degree, coefficient }, size_px)?, full_flux))
}

// The part of a display that a map was fitted to: the area within the outermost dots.
//
// The convex hull of the dots' places, display px (Andrew 1979, Inf. Process. Lett. 9, 216: lower and upper chain of
// the sorted points). Within it the map is held by dots on all sides; beyond it, it is a guess. Limit: holes in the
// middle do not show. Tests below.

/// Distance beyond the line of the outermost dots at which a place still counts as on it, display px.
const ON_THE_LINE_PX: f64 = 1e-6;

/// Corners of the covered area, in order.
#[derive(Debug, Clone, PartialEq)]
pub struct Covered {
    corners_px: Vec<[f64; 2]>,
}

/// Returns twice the area of the triangle, positive for a turn from +x to +y.
fn turn(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Returns one chain of the hull, without its last point.
fn chain(points: impl Iterator<Item = [f64; 2]>) -> Vec<[f64; 2]> {
    let mut chain: Vec<[f64; 2]> = Vec::new();
    for point in points {
        while chain.len() >= 2 && turn(chain[chain.len() - 2], chain[chain.len() - 1], point) <= 0.0 {
            chain.pop();
        }
        chain.push(point);
    }
    chain.pop();
    chain
}

impl Covered {
    /// Returns the area within points; `None` when they are on one line, fewer than three, or not finite.
    pub fn within(points_px: &[[f64; 2]]) -> Option<Self> {
        let mut sorted = points_px.to_vec();
        sorted.sort_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])));
        let mut corners_px = chain(sorted.iter().copied());
        corners_px.extend(chain(sorted.iter().rev().copied()));
        let is_finite = points_px.iter().flatten().all(|v| v.is_finite());
        (is_finite && corners_px.len() >= 3).then_some(Self { corners_px })
    }

    /// Returns the corners.
    pub fn corners_px(&self) -> &[[f64; 2]] {
        &self.corners_px
    }

    /// Returns true if a place is within the outermost dots.
    pub fn contains(&self, px: [f64; 2]) -> bool {
        let next = self.corners_px.iter().cycle().skip(1);
        self.corners_px.iter().zip(next).all(|(a, b)| {
            let side = (b[0] - a[0]).hypot(b[1] - a[1]);
            turn(*a, *b, px) >= -ON_THE_LINE_PX * side
        })
    }

    /// Returns the smallest and largest column, smallest and largest row.
    pub fn range_px(&self) -> [f64; 4] {
        let start = [f64::INFINITY, f64::NEG_INFINITY, f64::INFINITY, f64::NEG_INFINITY];
        self.corners_px.iter().fold(start, |[l, r, t, b], [x, y]| [l.min(*x), r.max(*x), t.min(*y), b.max(*y)])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE_PX: [usize; 2] = [640, 480];

    fn truth([x, y]: [f64; 2]) -> f64 {
        let [u, v] = [x / 639.0 - 0.45, y / 479.0 - 0.55];
        1.0 - 0.5 * (u * u + v * v) + 0.05 * u
    }

    fn dots(noise: impl Fn(usize) -> f64) -> Vec<([f64; 2], f64)> {
        let places =
            (0..12).flat_map(|i| (0..9).map(move |j| [20.0 + 54.0 * f64::from(i), 20.0 + 54.0 * f64::from(j)]));
        places.enumerate().map(|(i, px)| (px, 5000.0 * truth(px) * (1.0 + noise(i)))).collect()
    }

    #[test]
    fn vignetting_is_recovered_and_outliers_left_out() {
        let spoiled = |i: usize| if i == 17 || i == 60 { -0.4 } else { 1e-3 * (i as f64 * 2.3).sin() };
        let fit = fit_flat(&dots(spoiled), SIZE_PX).unwrap();
        assert_eq!(fit.outliers, 2);
        assert!(fit.residual_mag_rms < 1e-3, "{} mag", fit.residual_mag_rms);
        for px in [[0.0, 0.0], [639.0, 0.0], [300.0, 240.0], [639.0, 479.0]] {
            let found = fit.flat.at(px) * fit.full_flux / 5000.0;
            assert!((found / truth(px) - 1.0).abs() < 2e-3, "{found} at {px:?}");
        }
        assert!((fit.flat.range()[1] - 1.0).abs() < 1e-9, "1 at its brightest");
        assert!((FlatField::uniform(SIZE_PX).at([0.0, 0.0]) / truth([0.0, 0.0]) - 1.0).abs() > 0.1, "it can fail");
    }

    #[test]
    fn noise_alone_is_flat() {
        let flat: Vec<_> =
            dots(|i| 0.01 * (i as f64 * 12.9898).sin()).iter().map(|d| (d.0, d.1 / truth(d.0))).collect();
        assert!(fit_flat(&flat, SIZE_PX).unwrap().flat.parameters().degree <= 1);
    }

    #[test]
    fn invalid_flat_fields_are_refused() {
        assert!(fit_flat(&[], SIZE_PX).is_err());
        let p = |coefficient: Vec<f64>| FlatField::new(FlatParameters { degree: 1, coefficient }, SIZE_PX);
        assert!(p(vec![0.5, 0.3, 0.1]).is_ok());
        assert!(p(vec![0.5, 0.5, 0.1]).unwrap_err().contains("all over the display"));
        assert!(p(vec![0.5]).unwrap_err().contains("3 coefficients"));
        assert!(p(vec![f64::NAN, 0.0, 0.0]).is_err());
    }
}

#[cfg(test)]
mod covered_tests {
    use super::*;

    #[test]
    fn a_grid_has_four_corners_and_two_sides_of_each_edge() {
        let grid: Vec<[f64; 2]> =
            (0..5).flat_map(|i| (0..4).map(move |j| [10.0 + 20.0 * f64::from(i), 5.0 + 10.0 * f64::from(j)])).collect();
        let covered = Covered::within(&grid).unwrap();
        assert_eq!(covered.corners_px(), [[10.0, 5.0], [90.0, 5.0], [90.0, 35.0], [10.0, 35.0]]);
        assert_eq!(covered.range_px(), [10.0, 90.0, 5.0, 35.0]);
        assert!(grid.iter().all(|px| covered.contains(*px)), "the dots themselves");
        for (px, wanted) in [([9.9, 20.0], false), ([10.1, 20.0], true), ([50.0, 35.1], false), ([50.0, 34.9], true)] {
            assert_eq!(covered.contains(px), wanted, "{px:?}");
        }
        assert_eq!(Covered::within(covered.corners_px()), Some(covered.clone()), "corners are their own hull");
    }

    #[test]
    fn a_slanted_edge_is_not_its_bounding_box() {
        let covered = Covered::within(&[[0.0, 0.0], [100.0, 0.0], [0.0, 100.0], [20.0, 20.0]]).unwrap();
        assert!(covered.contains([49.0, 49.0]) && !covered.contains([51.0, 51.0]));
    }

    #[test]
    fn points_without_area_give_none() {
        let line: Vec<[f64; 2]> = (0..9).map(|i| [f64::from(i), 2.0 * f64::from(i)]).collect();
        assert_eq!(Covered::within(&line), None);
        assert_eq!(Covered::within(&[]), None);
        assert_eq!(Covered::within(&[[3.0, 3.0]; 7]), None);
        assert_eq!(Covered::within(&[[0.0, 0.0], [1.0, 0.0], [0.0, f64::NAN]]), None);
    }
}
