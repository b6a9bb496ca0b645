//! Finds background and stars of a picture.
//!
//! Background: medians of square cells, smoothed over 3 x 3 cells and interpolated between them. Stars: local maxima of
//! the image smoothed by a Gaussian of one pixel, above [`LEAST_SIGMA`] times the spread; place by moments under a
//! Gaussian.

use crate::picture::{Picture, robust};
use base::least_squares::median;

/// Side of a cell of the background, px.
const CELL_PX: usize = 32;
/// How far above the spread of the smoothed image a star is.
pub const LEAST_SIGMA: f64 = 6.0;
/// Standard deviation of the Gaussian that detections are smoothed and weighted by, px.
const SMOOTH_PX: f64 = 1.0;
/// Half-width of its window, and distance of a detection from the edge, px.
const HALF_PX: usize = 4;
/// Steps of the moments.
const STEPS: usize = 12;

/// A star above the background.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Detection {
    /// Place, px.
    pub px: [f64; 2],
    /// Sum of its pixels above the background, DN.
    pub flux_dn: f64,
    /// Height of the smoothed peak over the spread.
    pub sigma: f64,
}

/// Returns the background of every pixel: a smooth surface through the medians of cells.
pub fn background(picture: &Picture) -> Vec<f32> {
    let cells = picture.size_px.map(|side| (side / CELL_PX).max(1));
    let edge = |i: usize, k: usize| k * picture.size_px[i] / cells[i];
    let cell = |cx: usize, cy: usize| {
        let rows = edge(1, cy)..edge(1, cy + 1);
        let mut values: Vec<f64> = rows
            .flat_map(|y| (edge(0, cx)..edge(0, cx + 1)).map(move |x| (x, y)))
            .map(|(x, y)| picture.at(x, y))
            .collect();
        let [middle, spread] = robust(&mut values);
        // Stars lift the median a little: they are cut off, and the mean of the rest taken.
        let limit = 2.5 * spread.max(0.5);
        let (count, sum) =
            values.iter().filter(|v| (*v - middle).abs() <= limit).fold((0.0, 0.0), |(n, s), v| (n + 1.0, s + v));
        if count > 0.0 { sum / count } else { middle }
    };
    let mesh: Vec<f64> =
        (0..cells[1]).flat_map(|cy| (0..cells[0]).map(move |cx| (cx, cy))).map(|(cx, cy)| cell(cx, cy)).collect();
    let mesh = smoothed_mesh(&mesh, cells);
    let middle = |i: usize, k: usize| 0.5 * (edge(i, k) + edge(i, k + 1)) as f64 - 0.5;
    let places: [Vec<(usize, f64)>; 2] = core::array::from_fn(|i| {
        (0..picture.size_px[i]).map(|at| between(at as f64, cells[i], |k| middle(i, k))).collect()
    });
    let mut surface = Vec::with_capacity(picture.dn.len());
    for &(cy, fy) in &places[1] {
        for &(cx, fx) in &places[0] {
            let at = |x: usize, y: usize| mesh[y.min(cells[1] - 1) * cells[0] + x.min(cells[0] - 1)];
            let row = |y: usize| at(cx, y) * (1.0 - fx) + at(cx + 1, y) * fx;
            #[allow(clippy::cast_possible_truncation, reason = "digital numbers")]
            surface.push((row(cy) * (1.0 - fy) + row(cy + 1) * fy) as f32);
        }
    }
    surface
}

/// Returns the cell before a place and the share of the next one; beyond the outer middles the line goes on.
fn between(at: f64, cells: usize, middle: impl Fn(usize) -> f64) -> (usize, f64) {
    let before = (0..cells).rev().find(|k| middle(*k) <= at).unwrap_or(0).min(cells.saturating_sub(2));
    if cells < 2 {
        return (0, 0.0);
    }
    let [low, high] = [before, before + 1].map(&middle);
    (before, (at - low) / (high - low))
}

/// Returns each cell as the median of its neighbourhood where it is far from it: a bright star's cell.
fn smoothed_mesh(mesh: &[f64], cells: [usize; 2]) -> Vec<f64> {
    let of = |cx: usize, cy: usize| {
        let near = |at: usize, most: usize| at.saturating_sub(1)..=(at + 1).min(most - 1);
        let mut around: Vec<f64> =
            near(cy, cells[1]).flat_map(|y| near(cx, cells[0]).map(move |x| mesh[y * cells[0] + x])).collect();
        let own = mesh[cy * cells[0] + cx];
        let [middle, spread] = robust(&mut around);
        if (own - middle).abs() > 4.0 * spread.max(0.1) { middle } else { own }
    };
    (0..cells[1]).flat_map(|cy| (0..cells[0]).map(move |cx| (cx, cy))).map(|(cx, cy)| of(cx, cy)).collect()
}

/// Returns the stars, brightest first.
pub fn detections(picture: &Picture, background: &[f32]) -> Vec<Detection> {
    let flat = picture.map(|i, dn| dn - background[i]);
    let smooth = smoothed(&flat);
    let mut sample: Vec<f64> = smooth.dn.iter().step_by(7).map(|dn| f64::from(*dn)).collect();
    let [_, spread] = robust(&mut sample);
    // Digital numbers are whole: a blank image has no spread at all.
    let limit = LEAST_SIGMA * spread.max(0.05);
    let [width, height] = picture.size_px;
    let mut found = Vec::new();
    for y in HALF_PX..height.saturating_sub(HALF_PX) {
        for x in HALF_PX..width.saturating_sub(HALF_PX) {
            let peak = smooth.at(x, y);
            if peak > limit && is_highest(&smooth, [x, y], peak) {
                found.extend(centred(&flat, [x, y]).map(|(px, flux_dn)| Detection {
                    px,
                    flux_dn,
                    sigma: peak / spread.max(0.05),
                }));
            }
        }
    }
    found.sort_by(|a, b| b.flux_dn.total_cmp(&a.flux_dn));
    found
}

fn is_highest(smooth: &Picture, [x, y]: [usize; 2], peak: f64) -> bool {
    (y - 3..=y + 3).all(|row| {
        (x - 3..=x + 3).all(|column| {
            let other = smooth.at(column, row);
            // Of equal ones the first counts.
            (column, row) == (x, y) || other < peak || (other == peak && (row, column) > (y, x))
        })
    })
}

/// Returns place and sum of a star by moments under a Gaussian that follows it.
fn centred(flat: &Picture, [x, y]: [usize; 2]) -> Option<([f64; 2], f64)> {
    let mut px = [x as f64, y as f64];
    for _ in 0..STEPS {
        let mut sums = [0.0; 3];
        for row in y - HALF_PX..=y + HALF_PX {
            for column in x - HALF_PX..=x + HALF_PX {
                let off = [column as f64 - px[0], row as f64 - px[1]];
                let weight = (-0.5 * (off[0] * off[0] + off[1] * off[1]) / (SMOOTH_PX * SMOOTH_PX)).exp();
                let light = weight * flat.at(column, row);
                sums = [sums[0] + light, sums[1] + light * off[0], sums[2] + light * off[1]];
            }
        }
        if sums[0] <= 0.0 {
            return None;
        }
        // A Gaussian weight halves the distance of a star of its own width.
        px = [px[0] + 1.6 * sums[1] / sums[0], px[1] + 1.6 * sums[2] / sums[0]];
        if (px[0] - x as f64).abs() > 1.5 || (px[1] - y as f64).abs() > 1.5 {
            return None;
        }
    }
    let near = (y - 2..=y + 2).flat_map(|row| (x - 2..=x + 2).map(move |column| flat.at(column, row)));
    let flux: f64 = near.sum();
    (flux > 0.0).then_some((px, flux))
}

fn smoothed(flat: &Picture) -> Picture {
    let half = HALF_PX as i64;
    let raw: Vec<f64> = (-half..=half).map(|k| (-0.5 * (k as f64 / SMOOTH_PX).powi(2)).exp()).collect();
    let sum: f64 = raw.iter().sum();
    #[allow(clippy::cast_possible_truncation, reason = "weights")]
    let kernel: Vec<f32> = raw.iter().map(|value| (value / sum) as f32).collect();
    let [width, height] = flat.size_px;
    let pass = |from: &[f32], along: usize, step: usize, most: usize| -> Vec<f32> {
        (0..from.len())
            .map(|i| {
                let at = if along == 0 { i % width } else { i / width };
                kernel
                    .iter()
                    .enumerate()
                    .map(|(k, weight)| {
                        let other = (at + k).saturating_sub(HALF_PX).min(most - 1);
                        weight * from[i - at * step + other * step]
                    })
                    .sum()
            })
            .collect()
    };
    let rows = pass(&flat.dn, 0, 1, width);
    Picture { size_px: flat.size_px, dn: pass(&rows, 1, width, height) }
}

/// Returns the spread of an image about its background, DN rms: from differences of neighbours, which stars hardly
/// change.
pub fn noise_dn(picture: &Picture) -> f64 {
    let mut differences: Vec<f64> = picture
        .dn
        .chunks_exact(picture.size_px[0])
        .flat_map(|row| row.windows(2))
        .step_by(3)
        .map(|pair| f64::from(pair[1] - pair[0]).abs())
        .collect();
    1.4826 * median(&mut differences) / core::f64::consts::SQRT_2
}
