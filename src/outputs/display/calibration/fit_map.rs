//! Directions of dots and their display pixels -> homography and polynomial.
//!
//! 1. A homography that half of the dots agree with: of many sets of four dots the one with the least median residual
//!    (Rousseeuw 1984, J. Am. Stat. Assoc. 79, 871), then least squares over all that agree with it. Its determinant's sign
//!    shows a mirror.
//! 2. In its axes, a polynomial of degree 1 to 5 (and the principal point) by linear least squares; dots further off
//!    than five standard deviations are left out, and all dots are tested again, until the choice does not change. The
//!    degree is the lowest whose residual, each dot left out of its own fit, is within 2 % of the least, and whose camera
//!    does not fold.
//!
//! In narrow fields the keystone drowns in noise and distortion: where it would put the principal point or the axes far
//! off, the homography is an affine map, and the polynomial takes the rest. Limits: a camera accepts coefficients up to
//! 1e6; below half a degree, distortion of more than a percent may need more in degree 5, and degree 4 is then taken.
//! Errors of the tracker's own camera file go into the map, since only the two together are measured. Tests:
//! `fit_map_tests`; `tests/physics/display_calibration`.

use crate::display::calibration::error;
use crate::display::flat_field::{Covered, exponents};
use crate::display::geometry::{DisplayGeometry, GeometryParameters, Pinhole, taken_apart, wxyz};
use base::least_squares::{Basis, median, rms};
use base::{random::philox, refused::Refused};
use glam::{DMat3, DQuat, DVec2, DVec3};

/// Fewest dots that make a map.
pub const FEWEST_DOTS: usize = 12;
/// Largest residual that still is a map, display px rms.
pub const LARGEST_RMS_PX: f64 = 0.5;
/// Largest share of dots that may be left out.
const MOST_OUTLIERS: f64 = 0.25;
const HIGHEST_DEGREE: usize = 5;
/// Sets of four that are tried: with a quarter of the dots wrong, all fail with a chance of 1e-24.
const DRAWS: u32 = 400;
const OUTLIER_SIGMA: f64 = 5.0;
/// Standard deviation over the median of absolute deviations, of normal errors.
const SIGMA_PER_MEDIAN: f64 = 1.4826;
/// Rounding error, px: smaller residuals do not make outliers.
const LEAST_LIMIT_PX: f64 = 1e-6;
const MOST_ROUNDS: usize = 20;
/// A higher degree must lessen the residual by this share.
const WORTH: f64 = 0.98;
/// Furthest principal point, in sides of the display: the same, in a narrow field.
const FURTHEST_SIDES: f64 = 8.0;
/// Largest angle between drawn axes and the dots' middle: beyond it the keystone is noise.
const MOST_TILT_COS: f64 = 0.7;

/// One dot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenDot {
    /// Its number in the plan.
    pub number: usize,
    /// Direction in which the tracker sees it: sensor axes, any length.
    pub v_sensor: DVec3,
    /// Place at which the display shows it.
    pub display_px: [f64; 2],
}

/// A map, and how well it fits.
#[derive(Debug, Clone, PartialEq)]
pub struct MapFit {
    /// The map's numbers.
    pub parameters: GeometryParameters,
    /// The map.
    pub geometry: DisplayGeometry,
    /// Shown less mapped place of every dot given, display px.
    pub residual_px: Vec<DVec2>,
    /// Whether each dot was used in the fit.
    pub is_used: Vec<bool>,
    /// Residual of the dots fitted to, display px rms (of the length).
    pub rms_px: f64,
    /// Largest of them.
    pub max_px: f64,
    /// Error of the map from the noise of the dots, display px rms over the dots: residual times root of terms over
    /// dots.
    pub map_error_px: f64,
}

/// Fits the dots.
///
/// # Errors
/// When there are too few, or no map fits three quarters of them.
pub fn fit_map(dots: &[SeenDot], size_px: [usize; 2]) -> Result<MapFit, Refused> {
    let in_front = |dot: &&SeenDot| dot.v_sensor.z > 0.0 && dot.v_sensor.is_finite();
    let unseen = dots.len() - dots.iter().filter(in_front).count();
    if dots.len() - unseen < FEWEST_DOTS || unseen > 0 {
        return Err(error::few_dots(FEWEST_DOTS, dots.len() - unseen, 0, unseen, 0));
    }
    // About their middle, so that an affine map has its axis there.
    let middle = dots.iter().map(|dot| dot.v_sensor.normalize()).sum::<DVec3>().normalize();
    let centred_from_sensor = DMat3::from_quat(DQuat::from_rotation_arc(middle, DVec3::Z));
    let tangent = |axes: DMat3, dot: &SeenDot| {
        let v = axes * dot.v_sensor;
        v.truncate() / v.z
    };
    let tangents: Vec<DVec2> = dots.iter().map(|dot| tangent(centred_from_sensor, dot)).collect();
    let shown: Vec<DVec2> = dots.iter().map(|dot| DVec2::from(dot.display_px)).collect();
    let (mut pinhole, mirrored, agrees) = start(&tangents, &shown, size_px)?;
    pinhole.drawn_from_sensor *= centred_from_sensor;
    let most = size_px[0] as f64 - 1.0;
    let drawn: Vec<DVec2> = shown.iter().map(|px| if mirrored { DVec2::new(most - px.x, px.y) } else { *px }).collect();
    let places: Vec<DVec2> = dots.iter().map(|dot| tangent(pinhole.drawn_from_sensor, dot)).collect();
    let mut best: Option<(f64, MapFit)> = None;
    let mut refusal = None;
    let mut least_px = f64::INFINITY;
    for degree in 1..=HIGHEST_DEGREE {
        let Some(poly) = fit_polynomial(degree, &pinhole, &places, &drawn, &agrees) else { break };
        least_px = least_px.min(poly.rms_px);
        let parameters = poly.parameters(&pinhole, mirrored, &shown);
        match DisplayGeometry::new(&parameters, size_px) {
            Err(error) => refusal = Some(error),
            Ok(_) if best.as_ref().is_some_and(|(obtained, _)| poly.score >= obtained * WORTH) => {}
            Ok(geometry) => best = Some((poly.score, reported(&poly, parameters, geometry, dots))),
        }
    }
    match (best, refusal) {
        (Some((_, fit)), _) => accepted(fit),
        (None, Some(error)) if least_px <= LARGEST_RMS_PX => Err(error::not_a_camera(error)),
        (None, Some(_)) => Err(not_fitting(least_px)),
        (None, None) => Err(not_a_map("dots in more places", format!("{} dots", dots.len()))),
    }
}

fn not_a_map(wanted: &'static str, got: String) -> Refused {
    error::not_a_map(wanted, got)
}

fn not_fitting(rms_px: f64) -> Refused {
    not_a_map("a residual below 0.5 display px rms", format!("{rms_px:.3} px"))
}

fn accepted(fit: MapFit) -> Result<MapFit, Refused> {
    let (all, used) = (fit.is_used.len(), fit.is_used.iter().filter(|used| **used).count());
    if fit.rms_px > LARGEST_RMS_PX {
        return Err(not_fitting(fit.rms_px));
    }
    if ((all - used) as f64) > MOST_OUTLIERS * all as f64 {
        return Err(not_a_map("three of four dots that agree with one map", format!("{used} of {all}")));
    }
    Ok(fit)
}

/// Returns pinhole, mirror, and the dots that agree with a homography as far as distortion lets them.
fn start(tangents: &[DVec2], shown: &[DVec2], size_px: [usize; 2]) -> Result<(Pinhole, bool, Vec<bool>), Refused> {
    let flat = || not_a_map("dots that are not on one line", format!("{} dots", shown.len()));
    let mirror = DMat3::from_cols_array(&[-1.0, 0.0, 0.0, 0.0, 1.0, 0.0, size_px[0] as f64 - 1.0, 0.0, 1.0]);
    let rough = agreed_homography(tangents, shown).ok_or_else(flat)?;
    let mut sizes: Vec<f64> = tangents.iter().zip(shown).map(|(t, px)| off(&rough, *t, *px)).collect();
    let middle = median(&mut sizes.clone());
    let limit = (OUTLIER_SIGMA * SIGMA_PER_MEDIAN * middle).max(LEAST_LIMIT_PX);
    let agrees: Vec<bool> = sizes.drain(..).map(|size| size <= limit).collect();
    let chosen: Vec<usize> = (0..shown.len()).filter(|i| agrees[*i]).collect();
    let centre = chosen.iter().map(|i| tangents[*i].extend(1.0).normalize()).sum::<DVec3>().normalize();
    for keystone in [true, false] {
        let Some(h) = homography(tangents, shown, &chosen, keystone) else { continue };
        let mirrored = h.determinant() < 0.0;
        let Some(pinhole) = taken_apart(&if mirrored { mirror * h } else { h }) else { continue };
        let side = size_px[0].max(size_px[1]) as f64;
        let is_near = pinhole.principal_point_px.iter().all(|px| px.abs() < FURTHEST_SIDES * side);
        let is_upright = (pinhole.drawn_from_sensor * centre).z > MOST_TILT_COS;
        if (is_upright && is_near) || !keystone {
            return Ok((pinhole, mirrored, agrees));
        }
    }
    Err(flat())
}

fn off(h: &DMat3, tangent: DVec2, px: DVec2) -> f64 {
    let seen = *h * tangent.extend(1.0);
    let off = (seen.truncate() / seen.z).distance(px);
    if seen.z > 0.0 && off.is_finite() { off } else { f64::INFINITY }
}

fn agreed_homography(tangents: &[DVec2], shown: &[DVec2]) -> Option<DMat3> {
    let mut best: Option<(f64, DMat3)> = None;
    for draw in 0..DRAWS {
        let words = philox([draw, 0, 0, 0], [0x686f_6d6f, shown.len() as u32]);
        let chosen: Vec<usize> = words.iter().map(|word| *word as usize % shown.len()).collect();
        let is_repeated = (1..4).any(|i| chosen[..i].contains(&chosen[i]));
        let Some(h) = (!is_repeated).then(|| homography(tangents, shown, &chosen, true)).flatten() else { continue };
        let mut sizes: Vec<f64> = tangents.iter().zip(shown).map(|(t, px)| off(&h, *t, *px)).collect();
        let score = median(&mut sizes);
        if best.as_ref().is_none_or(|(obtained, _)| score < *obtained) {
            best = Some((score, h));
        }
    }
    best.map(|(_, h)| h)
}

/// Returns the least squares over the chosen dots, the last entry 1 at their middle; an affine map without keystone.
fn homography(tangents: &[DVec2], shown: &[DVec2], chosen: &[usize], keystone: bool) -> Option<DMat3> {
    let [from_centred, to_centred] = [tangents, shown].map(|points| {
        let middle = chosen.iter().map(|i| points[*i]).sum::<DVec2>() / chosen.len() as f64;
        let size = chosen.iter().map(|i| points[*i].distance(middle)).fold(1e-12, f64::max);
        DMat3::from_cols_array(&[size, 0.0, 0.0, 0.0, size, 0.0, middle.x, middle.y, 1.0])
    });
    let into = |m: &DMat3, p: DVec2| (m.inverse() * p.extend(1.0)).truncate();
    let unknowns = if keystone { 8 } else { 6 };
    let mut columns = vec![Vec::with_capacity(2 * chosen.len()); unknowns];
    let mut values = Vec::with_capacity(2 * chosen.len());
    for i in chosen {
        let (t, u) = (into(&from_centred, tangents[*i]), into(&to_centred, shown[*i]));
        let rows = [
            ([t.x, t.y, 1.0, 0.0, 0.0, 0.0, -u.x * t.x, -u.x * t.y], u.x),
            ([0.0, 0.0, 0.0, t.x, t.y, 1.0, -u.y * t.x, -u.y * t.y], u.y),
        ];
        for (row, value) in rows {
            columns.iter_mut().zip(row).for_each(|(column, v)| column.push(v));
            values.push(value);
        }
    }
    let mut h = Basis::of(columns)?.solve(&values);
    h.resize(8, 0.0);
    let centred = DMat3::from_cols_array(&[h[0], h[3], h[6], h[1], h[4], h[7], h[2], h[5], 1.0]);
    Some(to_centred * centred * from_centred.inverse())
}

/// A polynomial, constant terms first.
struct Polynomial {
    degree: usize,
    along: [Vec<f64>; 2],
    is_used: Vec<bool>,
    /// Residual computed as if each dot was left out, display px rms.
    score: f64,
    /// Residual of the dots fitted to, display px rms.
    rms_px: f64,
    terms: usize,
}

fn fit_polynomial(
    degree: usize,
    pinhole: &Pinhole,
    places: &[DVec2],
    drawn: &[DVec2],
    agrees: &[bool],
) -> Option<Polynomial> {
    let focal = DVec2::from(pinhole.focal_px);
    let bends: Vec<DVec2> = places
        .iter()
        .zip(drawn)
        .map(|(place, px)| (*px - DVec2::from(pinhole.principal_point_px)) / focal - *place)
        .collect();
    let row = |place: DVec2| exponents(degree).map(move |(i, j)| place.x.powi(i as i32) * place.y.powi(j as i32));
    let terms = exponents(degree).count();
    let mut is_used = agrees.to_vec();
    for round in 1..=MOST_ROUNDS {
        let chosen: Vec<usize> = (0..places.len()).filter(|i| is_used[*i]).collect();
        if chosen.len() <= terms {
            return None;
        }
        let mut columns = vec![Vec::with_capacity(chosen.len()); terms];
        chosen.iter().for_each(|i| columns.iter_mut().zip(row(places[*i])).for_each(|(column, v)| column.push(v)));
        let basis = Basis::of(columns)?;
        let solve = |axis: usize| basis.solve(&chosen.iter().map(|i| bends[*i][axis]).collect::<Vec<_>>());
        let along = [solve(0), solve(1)];
        let bend = |i: usize, axis: usize| row(places[i]).zip(&along[axis]).map(|(term, c)| term * c).sum::<f64>();
        let off = |i: usize| ((bends[i] - DVec2::new(bend(i, 0), bend(i, 1))) * focal).length();
        let middle = median(&mut chosen.iter().map(|i| off(*i)).collect::<Vec<_>>());
        let limit = (OUTLIER_SIGMA * SIGMA_PER_MEDIAN * middle).max(LEAST_LIMIT_PX);
        let now: Vec<bool> = (0..places.len()).map(|i| off(i) <= limit).collect();
        if now == is_used || round == MOST_ROUNDS {
            let left_out = |(row, i): (usize, &usize)| off(*i) / (1.0 - basis.leverage(row)).max(1e-6);
            let score = rms(chosen.iter().enumerate().map(left_out));
            let rms_px = rms(chosen.iter().map(|i| off(*i)));
            return Some(Polynomial { degree, along, is_used, score, rms_px, terms });
        }
        is_used = now;
    }
    None
}

impl Polynomial {
    fn parameters(&self, pinhole: &Pinhole, mirrored: bool, shown: &[DVec2]) -> GeometryParameters {
        let used: Vec<[f64; 2]> =
            shown.iter().zip(&self.is_used).filter(|(_, used)| **used).map(|(px, _)| px.to_array()).collect();
        // Dots on one line have no area: the geometry refuses that.
        let covered_px = Covered::within(&used).map_or_else(Vec::new, |covered| covered.corners_px().to_vec());
        let moved = |axis: usize| pinhole.principal_point_px[axis] + pinhole.focal_px[axis] * self.along[axis][0];
        let pairs = self.along[0].iter().zip(&self.along[1]);
        let terms = exponents(self.degree).zip(pairs).skip(1).map(|((i, j), (a, b))| (i, j, *a, *b)).collect();
        GeometryParameters {
            mirrored,
            drawn_from_sensor: wxyz(&pinhole.drawn_from_sensor),
            focal_px: pinhole.focal_px,
            principal_point_px: [moved(0), moved(1)],
            degree: self.degree,
            terms,
            covered_px,
        }
    }
}

/// Returns the fit with the residuals of the map itself, not of the equations that led to it.
fn reported(poly: &Polynomial, parameters: GeometryParameters, geometry: DisplayGeometry, dots: &[SeenDot]) -> MapFit {
    let residual = |dot: &SeenDot| {
        let mapped = geometry.project(dot.v_sensor).map_or(DVec2::splat(f64::INFINITY), DVec2::from);
        DVec2::from(dot.display_px) - mapped
    };
    let residual_px: Vec<DVec2> = dots.iter().map(residual).collect();
    let used = || residual_px.iter().zip(&poly.is_used).filter(|(_, used)| **used).map(|(r, _)| r.length());
    let (rms_px, max_px, count) = (rms(used()), used().fold(0.0, f64::max), used().count() as f64);
    let map_error_px = rms_px * (poly.terms as f64 / count).sqrt();
    MapFit { parameters, geometry, residual_px, is_used: poly.is_used.clone(), rms_px, max_px, map_error_px }
}

#[cfg(test)]
#[path = "fit_map_tests.rs"]
mod tests;
