//! A star from a table, into the rows of a band: as a sum of products, or as the weighted sum of sixteen images.
//!
//! Tests: the agreement tests of the CPU backend; `products_and_images_are_one_star` below.

use crate::render::bands::{Band, add_clipped, add_lanes};
use crate::render::{grid::LANES, products::MOST_TERMS, table::PsfTable};
use base::fused::mul_add;

/// A star that is drawn from a table.
pub(super) struct Stamped {
    /// Its pixel: column and row.
    pub(super) origin: [i32; 2],
    /// First phases along x and y.
    pub(super) phases: [usize; 2],
    /// Weights of four phases along x.
    pub(super) wx: [f32; 4],
    /// Along y, with the star's electrons in them.
    pub(super) wy: [f32; 4],
}

impl Stamped {
    /// Returns the first column and row, in the band, and the rows of the footprint that lie in it.
    #[inline(always)]
    fn place(&self, band: &Band<'_>, table: &PsfTable) -> ([i32; 2], core::ops::Range<usize>) {
        let left = self.origin[0] - table.half_px[0].cast_signed() as i32;
        let top = self.origin[1] - table.half_px[1].cast_signed() as i32 - band.first_row;
        let rows = table.size_px()[1] as i32;
        let (first, end) = ((-top).max(0), rows.min(band.rows - top));
        ([left, top], first as usize..end.max(first) as usize)
    }
}

/// Adds a star.
#[inline(always)]
pub(super) fn stamp<const FUSED: bool>(band: &mut Band<'_>, table: &PsfTable, star: &Stamped) {
    match table.products.terms {
        0 => add_images::<FUSED>(band, table, star),
        1 => add_products::<1, FUSED>(band, table, star),
        2 => add_products::<2, FUSED>(band, table, star),
        3 => add_products::<3, FUSED>(band, table, star),
        4 => add_products::<4, FUSED>(band, table, star),
        5 => add_products::<5, FUSED>(band, table, star),
        6 => add_products::<6, FUSED>(band, table, star),
        8 => add_products::<8, FUSED>(band, table, star),
        12 => add_products::<12, FUSED>(band, table, star),
        _ => add_products::<MOST_TERMS, FUSED>(band, table, star),
    }
}

/// Adds a star as a sum of products: columns and rows of every term at the star's phase, then row by row.
#[inline(always)]
fn add_products<const TERMS: usize, const FUSED: bool>(band: &mut Band<'_>, table: &PsfTable, star: &Stamped) {
    let ([left, top], rows) = star.place(band, table);
    if rows.is_empty() {
        return;
    }
    let (products, width, columns) = (&table.products, band.width, table.size_px()[0]);
    let [px, py] = star.phases;
    for d in rows.start / LANES..rows.end.div_ceil(LANES) {
        let gains = products.down::<TERMS, FUSED>(py, d, star.wy);
        let rows = rows.start.max(d * LANES)..rows.end.min((d + 1) * LANES);
        let begin = (top + rows.start as i32) as usize * width;
        for c in 0..products.per_row {
            let lines = products.across::<TERMS, FUSED>(px, c, star.wx);
            let from = left + (c * LANES) as i32;
            let Some(pixels) = band.pixels.get_mut(begin..begin + rows.len() * width) else { continue };
            if from >= 0 && from as usize + LANES <= width {
                // From the first pixel on, so that each row's are at its front; the last row is as short as need be.
                let Some(pixels) = pixels.get_mut(from as usize..) else { continue };
                let targets = pixels.chunks_mut(width).filter_map(|line| line.first_chunk_mut::<LANES>());
                for (target, r) in targets.zip(rows.start % LANES..) {
                    add_lanes::<FUSED>(target, &sum_of::<TERMS, FUSED>(&lines, &gains, r), 1.0);
                }
            } else {
                for (line, r) in pixels.chunks_exact_mut(width).zip(rows.start % LANES..) {
                    let sum = sum_of::<TERMS, FUSED>(&lines, &gains, r);
                    add_clipped::<FUSED>(line, from, columns - c * LANES, &sum, 1.0);
                }
            }
        }
    }
}

/// Returns one row of a star: the terms' columns by their values in row `r` of the vector.
#[inline(always)]
fn sum_of<const TERMS: usize, const FUSED: bool>(
    lines: &[[f32; LANES]; TERMS],
    gains: &[[f32; LANES]; TERMS],
    r: usize,
) -> [f32; LANES] {
    let mut sum = [0.0_f32; LANES];
    for (values, gain) in lines.iter().zip(gains) {
        let gain = gain[r % LANES];
        for (sum, value) in sum.iter_mut().zip(values) {
            *sum = mul_add::<FUSED>(gain, *value, *sum);
        }
    }
    sum
}

/// Adds a star as the weighted sum of sixteen images.
#[inline(always)]
fn add_images<const FUSED: bool>(band: &mut Band<'_>, table: &PsfTable, star: &Stamped) {
    let ([left, top], rows) = star.place(band, table);
    let columns = table.size_px()[0];
    let [px, py] = star.phases;
    let weights = star.wy.map(|wy| star.wx.map(|wx| wy * wx));
    let (per_row, width) = (table.stride / LANES, band.width);
    for r in rows {
        let at = (top + r as i32) as usize * width;
        let line = &mut band.pixels[at..at + width];
        for c in 0..per_row {
            let mut sum = [0.0_f32; LANES];
            for (m, weights) in weights.iter().enumerate() {
                let Some(four) = table.four(py + m, r, c, px) else { continue };
                for (values, weight) in four.iter().zip(weights) {
                    add_lanes::<FUSED>(&mut sum, values, *weight);
                }
            }
            let from = left + (c * LANES) as i32;
            let whole = usize::try_from(from).ok().and_then(|from| line.get_mut(from..)?.first_chunk_mut::<LANES>());
            match whole {
                // Lanes beyond the footprint hold zeros.
                Some(target) => add_lanes::<FUSED>(target, &sum, 1.0),
                None => add_clipped::<FUSED>(line, from, columns - c * LANES, &sum, 1.0),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::table::Form;
    use plan::{exposure::sampling::PRODUCTS_ERROR, optics::PsfModel};

    /// Returns stars all over a small image and over its edges.
    fn drawn(table: &PsfTable) -> Vec<f32> {
        let (width, height) = (50, 40);
        let mut pixels = vec![0.0; width * height];
        let mut band = Band { pixels: &mut pixels, width, first_row: 100, rows: 40 };
        for (i, origin) in
            [[25, 120], [0, 100], [49, 139], [3, 97], [60, 118], [-9, 130], [40, 142]].into_iter().enumerate()
        {
            let fraction = |k: usize| (i * 7 + k * 3) as f32 % 10.0 / 10.0 - 0.45;
            let [(px, wx), (py, wy)] = [table.taps(fraction(0)), table.taps(fraction(1))];
            stamp::<false>(&mut band, table, &Stamped { origin, phases: [px, py], wx, wy: wy.map(|w| 1000.0 * w) });
        }
        pixels
    }

    #[test]
    fn products_and_images_are_one_star() {
        let path = |i: u32| {
            let at = f64::from(i) / 31.0 - 0.5;
            [1.0 / 32.0, 1.5 * at, 2.5 * (at + 0.4 * (9.0 * at).sin())]
        };
        // One block of columns and rows, and several of each.
        for (sigma, half_px) in [(0.7, [6, 7]), (0.7, [7, 12]), (2.0, [12, 20]), (1.0, [20, 7])] {
            let psf = PsfModel::gaussian(sigma);
            let made = |form| {
                let mut table = PsfTable::empty(form);
                table.rebuild_kernel(
                    &psf,
                    half_px,
                    8,
                    (0..32).map(path),
                    [(0, 1.0), (0, 0.0), (0, 0.0), (0, 0.0)],
                    &[],
                );
                table
            };
            let (products, images) = (made(Form::Products), made(Form::Images));
            assert!((3..=8).contains(&products.products.terms), "{} terms", products.products.terms);
            assert_eq!(images.products.terms, 0);
            let (one, other) = (drawn(&products), drawn(&images));
            let peak = other.iter().copied().fold(0.0, f32::max);
            let worst = one.iter().zip(&other).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max) / peak;
            assert!(peak > 10.0 && f64::from(worst) < 2.0 * PRODUCTS_ERROR, "{worst:e} of {peak} e-, {half_px:?}");
        }
    }

    #[test]
    fn path_without_a_short_sum_stays_images() {
        // A path all over the field has no short sum.
        let scattered = |i: u32| {
            let [x, y] = [i * 7 % 40, i * 13 % 37].map(|v| f64::from(v) / 2.5 - 8.0);
            [1.0 / 40.0, x, y]
        };
        let mut table = PsfTable::empty(Form::Products);
        let psf = PsfModel::gaussian(0.5);
        table.rebuild_kernel(&psf, [12; 2], 8, (0..40).map(scattered), [(0, 1.0), (0, 0.0), (0, 0.0), (0, 0.0)], &[]);
        assert_eq!(table.products.terms, 0);
        assert!(drawn(&table).iter().sum::<f32>() > 900.0, "it is drawn all the same");
    }
}
