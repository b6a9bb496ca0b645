//! Picture, background, PSF, places of the catalog's stars -> place and light of each: fits of the PSF, neighbours
//! taken off.
//!
//! All stars are fitted one after the other, brightest first, on the image less all the others, several times over. A
//! star that is too faint for a place of its own keeps the one that was predicted. The same code measures real and
//! drawn frames.
//!
//! The PSF is a table of pixel values ([`Stamp`]): light of a star in any pixel near it, by cubic interpolation.

use crate::picture::{Picture, window};
use base::least_squares::median;
use plan::optics::PsfModel;

/// Half-width of the square in which a star is fitted, px.
pub const FIT_HALF_PX: i64 = 3;
/// Half-width of the square on which its light is taken off for others, px.
const LIGHT_HALF_PX: i64 = 7;
/// Ring in which the background beside a star is taken, px.
const RING_PX: [f64; 2] = [6.0, 10.0];
/// Rounds over all stars.
const ROUNDS: usize = 4;
/// SNR from which a place is fitted.
const PLACED_SNR: f64 = 6.0;
/// Furthest that a star may be from where it is expected, px.
const FURTHEST_PX: f64 = 2.0;
/// Share of the range from which a pixel counts as saturated.
const SATURATED: f64 = 0.97;
/// How far the PSF errs, a share of a pixel's light: keeps bright stars from being fitted by their model's error.
const PSF_ERROR: f64 = 0.03;

/// Parts of the noise of a pixel.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PixelNoise {
    /// Electrons of a digital number.
    pub gain_e_per_dn: f64,
    /// Noise without light, DN rms.
    pub read_dn: f64,
    /// Number of no charge, DN.
    pub black_dn: f64,
    /// Largest digital number.
    pub most_dn: f64,
}

impl PixelNoise {
    /// Returns the variance of a pixel of this mean, DN^2.
    pub fn variance(&self, dn: f64) -> f64 {
        self.read_dn * self.read_dn + (dn - self.black_dn).max(0.0) / self.gain_e_per_dn
    }
}

/// A star in the image.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spot {
    /// Place, px.
    pub px: [f64; 2],
    /// Light above the background, DN.
    pub flux_dn: f64,
    /// Its standard error, DN.
    pub flux_error_dn: f64,
    /// Standard error of the place along each axis, px.
    pub place_error_px: f64,
    /// Background beside it that the surface lacks, DN.
    pub beside_dn: f64,
    /// A pixel is full.
    pub is_saturated: bool,
    /// The place was fitted.
    pub is_placed: bool,
}

impl Spot {
    /// Returns the signal-to-noise ratio of the light.
    pub fn snr(&self) -> f64 {
        self.flux_dn / self.flux_error_dn
    }
}

/// An image in which stars are measured.
#[derive(Debug, Clone, Copy)]
pub struct Plate<'a> {
    /// The image.
    pub picture: &'a Picture,
    /// Its background, of every pixel, DN.
    pub background: &'a [f32],
    /// Its noise.
    pub noise: PixelNoise,
}

/// Returns the spot of each expected place, in their order; `None` at the edge.
pub fn measure(plate: &Plate<'_>, stamp: &Stamp, expected: &[[f64; 2]]) -> Vec<Option<Spot>> {
    let mut left: Vec<f32> = plate.picture.dn.iter().zip(plate.background).map(|(dn, surface)| dn - surface).collect();
    let width = plate.picture.size_px[0];
    let mut spots: Vec<Option<Spot>> = expected
        .iter()
        .map(|px| plate.picture.holds(*px, LIGHT_HALF_PX + 3).then(|| first_look(plate, &left, *px)))
        .collect();
    let mut order: Vec<usize> = (0..spots.len()).collect();
    order.sort_by(|a, b| flux_of(&spots[*b]).total_cmp(&flux_of(&spots[*a])));
    spots.iter().flatten().for_each(|spot| add(&mut left, width, stamp, spot, -1.0));
    for round in 0..ROUNDS {
        for place in &order {
            if let Some(spot) = &mut spots[*place] {
                add(&mut left, width, stamp, spot, 1.0);
                refine(plate, &left, stamp, expected[*place], spot, round > 0);
                add(&mut left, width, stamp, spot, -1.0);
            }
        }
        for spot in spots.iter_mut().flatten() {
            spot.beside_dn = beside(plate, &left, spot.px);
        }
    }
    spots
}

fn flux_of(spot: &Option<Spot>) -> f64 {
    spot.as_ref().map_or(f64::NEG_INFINITY, |spot| spot.flux_dn)
}

fn first_look(plate: &Plate<'_>, left: &[f32], px: [f64; 2]) -> Spot {
    let width = plate.picture.size_px[0];
    let flux: f64 = window(px, 2).map(|[x, y]| f64::from(left[y * width + x])).sum();
    let is_saturated = window(px, FIT_HALF_PX).any(|[x, y]| plate.picture.at(x, y) >= SATURATED * plate.noise.most_dn);
    Spot {
        px,
        flux_dn: flux.max(0.0),
        flux_error_dn: 1.0,
        place_error_px: 1.0,
        beside_dn: 0.0,
        is_saturated,
        is_placed: false,
    }
}

/// Adds a spot's light to an image.
fn add(left: &mut [f32], width: usize, stamp: &Stamp, spot: &Spot, sign: f64) {
    for [x, y] in window(spot.px, LIGHT_HALF_PX) {
        let light = spot.flux_dn * stamp.at(x as f64 - spot.px[0], y as f64 - spot.px[1]);
        #[allow(clippy::cast_possible_truncation, reason = "digital numbers")]
        {
            left[y * width + x] += (sign * light) as f32;
        }
    }
}

/// Fits light and place of one star to an image that has no other.
fn refine(plate: &Plate<'_>, left: &[f32], stamp: &Stamp, expected: [f64; 2], spot: &mut Spot, may_move: bool) {
    const STEP_PX: f64 = 0.02;
    let width = plate.picture.size_px[0];
    for _ in 0..3 {
        let mut normal = [[0.0; 3]; 3];
        // The same by noise alone, for the errors.
        let mut pure = [[0.0; 3]; 3];
        let mut right = [0.0; 3];
        for [x, y] in window(spot.px, FIT_HALF_PX) {
            let i = y * width + x;
            let (dx, dy) = (x as f64 - spot.px[0], y as f64 - spot.px[1]);
            let share = stamp.at(dx, dy);
            let slope = |ax: f64, ay: f64| (stamp.at(dx - ax, dy - ay) - stamp.at(dx + ax, dy + ay)) / (2.0 * STEP_PX);
            let columns = [share, spot.flux_dn * slope(STEP_PX, 0.0), spot.flux_dn * slope(0.0, STEP_PX)];
            let light = spot.flux_dn * share;
            let mean = f64::from(plate.background[i]) + spot.beside_dn + light.max(0.0);
            let variance = plate.noise.variance(mean).max(1e-6);
            let weight = 1.0 / (variance + (PSF_ERROR * light).powi(2));
            let rest = f64::from(left[i]) - spot.beside_dn - light;
            for a in 0..3 {
                right[a] += weight * columns[a] * rest;
                for b in 0..3 {
                    normal[a][b] += weight * columns[a] * columns[b];
                    pure[a][b] += columns[a] * columns[b] / variance;
                }
            }
        }
        if normal[0][0] <= 0.0 {
            return;
        }
        let is_bright = may_move && spot.flux_dn * normal[0][0].sqrt() > PLACED_SNR;
        let matrix = glam::DMat3::from_cols_array_2d(&normal);
        let pure = glam::DMat3::from_cols_array_2d(&pure);
        if is_bright && matrix.determinant().abs() > 0.0 && pure.determinant().abs() > 0.0 {
            let step = matrix.inverse() * glam::DVec3::from_array(right);
            let covariance = pure.inverse();
            spot.flux_dn = (spot.flux_dn + step.x).max(0.0);
            let moved = [spot.px[0] + step.y.clamp(-0.5, 0.5), spot.px[1] + step.z.clamp(-0.5, 0.5)];
            if (moved[0] - expected[0]).hypot(moved[1] - expected[1]) <= FURTHEST_PX {
                spot.px = moved;
            }
            spot.flux_error_dn = covariance.x_axis.x.max(0.0).sqrt();
            spot.place_error_px = (0.5 * (covariance.y_axis.y + covariance.z_axis.z)).max(0.0).sqrt();
            spot.is_placed = true;
        } else {
            spot.px = expected;
            spot.flux_dn = (spot.flux_dn + right[0] / normal[0][0]).max(0.0);
            spot.flux_error_dn = pure.x_axis.x.sqrt().recip();
            spot.is_placed = false;
        }
    }
}

/// Returns the background beside a star that the surface lacks: the median of a ring.
fn beside(plate: &Plate<'_>, left: &[f32], px: [f64; 2]) -> f64 {
    let width = plate.picture.size_px[0];
    #[allow(clippy::cast_possible_truncation, reason = "a few pixels")]
    let half = RING_PX[1] as i64;
    let in_ring = |[x, y]: &[usize; 2]| {
        let r = (*x as f64 - px[0]).hypot(*y as f64 - px[1]);
        (RING_PX[0]..=RING_PX[1]).contains(&r)
    };
    if !plate.picture.holds(px, half) {
        return 0.0;
    }
    let mut values: Vec<f64> = window(px, half).filter(in_ring).map(|[x, y]| f64::from(left[y * width + x])).collect();
    median(&mut values)
}

/// Furthest pixel from a star that has light, px.
pub const REACH_PX: usize = 8;
/// Places per pixel.
const PER_PX: usize = 8;
/// Entries along one axis: places 0 to reach + 2, for the interpolation beyond the ends.
const SIDE: usize = (REACH_PX + 2) * PER_PX;

/// A PSF that is alike on all four sides, as a table.
#[derive(Debug, Clone)]
pub struct Stamp {
    table: Vec<f64>,
}

impl Stamp {
    /// Tabulates a PSF (in the middle of the detector, where it depends on the place).
    pub fn of(psf: &PsfModel) -> Self {
        let at = |i: usize| i as f64 / PER_PX as f64;
        let mut table = vec![0.0; SIDE * SIDE];
        for row in 0..SIDE {
            for column in 0..=row {
                let value = psf.pixel(at(column), at(row));
                table[row * SIDE + column] = value;
                table[column * SIDE + row] = value;
            }
        }
        Self { table }
    }

    /// Returns the share of a star's light in the pixel whose middle is so far from the star, px.
    pub fn at(&self, x_px: f64, y_px: f64) -> f64 {
        let [x, y] = [x_px, y_px].map(|v| v.abs() * PER_PX as f64);
        let most = (REACH_PX * PER_PX) as f64;
        if !(x < most && y < most) {
            return 0.0;
        }
        let (columns, rows) = (weights(x), weights(y));
        let mut sum = 0.0;
        for (k, wy) in rows.1.iter().enumerate() {
            let row = mirrored(rows.0, k) * SIDE;
            for (j, wx) in columns.1.iter().enumerate() {
                sum += wx * wy * self.table[row + mirrored(columns.0, j)];
            }
        }
        sum
    }
}

/// Returns the entry of a place before the first one: the PSF is alike on both sides.
fn mirrored(first: i64, offset: usize) -> usize {
    #[allow(clippy::cast_possible_truncation, reason = "a place of the table")]
    let place = (first + offset as i64).unsigned_abs() as usize;
    place
}

/// Returns the first of four entries and their weights (Lagrange's cubic).
fn weights(at: f64) -> (i64, [f64; 4]) {
    let whole = at.floor();
    let t = at - whole;
    #[allow(clippy::cast_possible_truncation, reason = "a place of the table")]
    let first = whole as i64 - 1;
    let w = [
        -t * (t - 1.0) * (t - 2.0) / 6.0,
        (t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0,
        -(t + 1.0) * t * (t - 2.0) / 2.0,
        (t + 1.0) * t * (t - 1.0) / 6.0,
    ];
    (first, w)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_table_is_the_psf_and_its_light_is_whole() {
        for psf in [PsfModel::gaussian(0.55), PsfModel::halo(0.5, 1.5, 0.3), PsfModel::moffat(1.2, 3.0)] {
            let stamp = Stamp::of(&psf);
            for (x, y) in [(0.0, 0.0), (0.31, -0.77), (-1.49, 2.03), (4.4, -5.1)] {
                assert!((stamp.at(x, y) - psf.pixel(x, y)).abs() < 2e-4, "{x} {y} {psf:?}");
            }
            assert_eq!(stamp.at(9.0, 0.0), 0.0);
        }
        let sum: f64 = (-7..=7)
            .flat_map(|y| (-7..=7).map(move |x| (x, y)))
            .map(|(x, y)| Stamp::of(&PsfModel::gaussian(0.55)).at(f64::from(x) - 0.3, f64::from(y) + 0.2))
            .sum();
        assert!((sum - 1.0).abs() < 1e-3, "{sum}");
    }
}
