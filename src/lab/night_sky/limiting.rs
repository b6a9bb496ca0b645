//! Residuals of the stars -> what they come from, in words: noise, geometry, the stars' shapes, the image's response.
//!
//! A polynomial of third degree in both coordinates (ten terms along each axis) is taken for any geometry: where it would leave
//! much less, a lens model lacks a term; where it leaves as much, no geometry helps. The shapes are Gaussian-weighted second
//! moments; their spread over the stars is compared with that of the drawn frame, which has the same noise and one PSF.

use crate::figures::{Pair, StarRow};
use crate::picture::{robust, window};
use crate::result::{COUNTED_SNR, Comparison, MOST_CENTROID_PX};
use crate::{measure::Plate, newton::linear};

/// Least number of stars for a polynomial.
const LEAST_STARS: usize = 20;
/// Share of the distances that geometry must leave at most to be named.
const GEOMETRY_SHARE: f64 = 0.75;
/// Share of the distances that the drawn frame must have by itself for noise to be named.
const NOISE_SHARE: f64 = 0.6;
/// Spread of the shapes over that of the drawn frame's from which they are named.
const SHAPE_SPREAD: f64 = 2.0;
/// Half-width of the square of the moments and standard deviation of their weight, px.
const HALF_PX: i64 = 3;
const WEIGHT_PX: f64 = 1.2;

/// Returns what limits the agreement, in words.
pub(crate) fn words(of: &Comparison, shape_spread: f64) -> Vec<String> {
    let mut found = Vec::new();
    let (real, limit) = (of.centroid_robust_px, of.centroid_limit_px);
    let drawn = (limit * limit - MOST_CENTROID_PX * MOST_CENTROID_PX).max(0.0).sqrt();
    if drawn > NOISE_SHARE * real {
        found.push(format!("noise: the drawn frame has {drawn:.3} of {real:.3} px by itself"));
    } else if real > limit && !of.attitude_given {
        found.extend(of_centroids(of, shape_spread));
    }
    if let Some([gamma, error]) = of.response_gamma {
        found.push(format!(
            "the image's response: magnitudes change by {:+.3} +- {:.3} mag a magnitude, an exponent of {gamma:.2} +- {error:.2} \
             makes the image linear",
            of.response_slope[0], of.response_slope[1]
        ));
    }
    found
}

/// Returns what distances beyond noise come from; nothing where too few stars say.
fn of_centroids(of: &Comparison, shape_spread: f64) -> Option<String> {
    let real = of.centroid_robust_px;
    let kept: Vec<&StarRow> = of.star_rows.iter().filter(|row| !row.is_outlier).collect();
    let left = left_by_cubic(&kept)?;
    Some(if left < GEOMETRY_SHARE * real {
        format!("the geometry: a polynomial of third degree would leave {left:.3} of {real:.3} px")
    } else if shape_spread > SHAPE_SPREAD {
        format!(
            "the stars' shapes: they change over the field ({shape_spread:.1} times as much as in the drawn frame), one PSF is drawn for \
             all; no geometry helps (a polynomial of third degree leaves {left:.3} of {real:.3} px)"
        )
    } else {
        format!("not the geometry: a polynomial of third degree leaves {left:.3} of {real:.3} px")
    })
}

/// Returns the rms distance that a polynomial of third degree leaves, px.
fn left_by_cubic(rows: &[&StarRow]) -> Option<f64> {
    if rows.len() < LEAST_STARS {
        return None;
    }
    let most = rows.iter().fold(1.0_f64, |most, row| most.max(row.x_px).max(row.y_px));
    let terms = |row: &&StarRow| {
        let (x, y) = (2.0 * row.x_px / most - 1.0, 2.0 * row.y_px / most - 1.0);
        vec![1.0, x, y, x * x, x * y, y * y, x * x * x, x * x * y, x * y * y, y * y * y]
    };
    let columns: Vec<Vec<f64>> = rows.iter().map(terms).collect();
    let ones = vec![1.0; rows.len()];
    let chi2 = |of: fn(&StarRow) -> f64| {
        let values: Vec<f64> = rows.iter().map(|row| of(row)).collect();
        linear(&columns, &values, &ones).map(|fitted| fitted.chi2)
    };
    let sum = chi2(|row| row.dx_px)? + chi2(|row| row.dy_px)?;
    Some((sum / (rows.len() - columns[0].len()) as f64).sqrt())
}

/// Returns how much the stars' shapes vary, real frame over drawn one; 1 where there are too few stars.
pub(crate) fn shape_spread(real: &Plate<'_>, drawn: &Plate<'_>, pairs: &[Pair]) -> f64 {
    let is_good = |pair: &&Pair| {
        let is_full = pair.real.is_saturated || pair.drawn.is_saturated;
        !pair.is_blended && !is_full && pair.real.snr().min(pair.drawn.snr()) > COUNTED_SNR
    };
    let good: Vec<&Pair> = pairs.iter().filter(is_good).collect();
    if good.len() < LEAST_STARS {
        return 1.0;
    }
    let spread = |shapes: Vec<[f64; 3]>| {
        let along = |i: usize| robust(&mut shapes.iter().map(|shape| shape[i]).collect::<Vec<f64>>())[1];
        (0..3).map(|i| along(i).powi(2)).sum::<f64>().sqrt()
    };
    let [real, drawn] = [
        spread(good.iter().map(|pair| shape(real, pair.real.px, pair.real.beside_dn)).collect()),
        spread(good.iter().map(|pair| shape(drawn, pair.drawn.px, pair.drawn.beside_dn)).collect()),
    ];
    real / drawn.max(f64::MIN_POSITIVE)
}

/// Returns size and elongation of a star, along the axes and along the diagonals, px^2.
fn shape(plate: &Plate<'_>, px: [f64; 2], beside_dn: f64) -> [f64; 3] {
    let width = plate.picture.size_px[0];
    let mut sums = [0.0; 4];
    for [x, y] in window(px, HALF_PX) {
        let (dx, dy) = (x as f64 - px[0], y as f64 - px[1]);
        let weight = (-0.5 * (dx * dx + dy * dy) / (WEIGHT_PX * WEIGHT_PX)).exp();
        let light = weight * (plate.picture.at(x, y) - f64::from(plate.background[y * width + x]) - beside_dn);
        let moments = [1.0, dx * dx + dy * dy, dx * dx - dy * dy, 2.0 * dx * dy];
        sums.iter_mut().zip(moments).for_each(|(sum, moment)| *sum += light * moment);
    }
    [sums[1] / sums[0], sums[2] / sums[0], sums[3] / sums[0]]
}
