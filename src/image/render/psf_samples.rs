//! Samples of a PSF on the grid of its table.
//!
//! In: a round PSF, or a [`PsfGrid`]; step `1 / S` px. Out: pixel integrals, or at once
//! the coefficients of the spline through them. Pixels are sums of `S x S` subcells, each integrated by Gauss-Legendre:
//! for an Airy pattern of `L >= 0.2` and a Moffat profile of `alpha >= 0.3` px the error is below that of single
//! precision. A grid whose knots are among the table's is refined exactly, by the two-scale relation of the cubic
//! B-spline (Unser, IEEE Signal Processing Magazine 16 (1999), 22). Tests: the table's.

use crate::render::grid::Grid;
use plan::optics::{RoundPsf, psf_grid::PsfGrid, quadrature::gauss_legendre};

/// Gauss-Legendre nodes per axis and subcell.
const SUBCELL_NODES: usize = 4;

/// Computes pixel integrals of a round PSF on the grid, by summing subcells of side `1 / S`.
pub(super) fn of_profile(psf: &dyn RoundPsf, oversampling: usize, grid: &mut Grid) {
    let (side, half, stride) = (grid.columns(), grid.half[0], grid.stride);
    let margin = oversampling / 2;
    let cells = side - 1 + oversampling; // subcell c spans grid coordinate (c - half - margin) .. + 1
    let step = 1.0 / oversampling as f64;
    let nodes = gauss_legendre(SUBCELL_NODES);
    let middle = cells / 2; // even: symmetric about the centre
    let quadrant: Vec<f64> = {
        use rayon::prelude::*;
        (0..middle * middle)
            .into_par_iter()
            .map(|i| {
                let (cx, cy) = (i % middle, i / middle);
                if cx < cy {
                    return 0.0; // by symmetry from (cy, cx)
                }
                let value = |nx: f64, ny: f64| {
                    let (x, y) = ((cx as f64 + 0.5 + nx) * step, (cy as f64 + 0.5 + ny) * step);
                    psf.irradiance(x.hypot(y))
                };
                let sum: f64 = nodes
                    .iter()
                    .flat_map(|a| nodes.iter().map(move |b| (a, b)))
                    .map(|(a, b)| a.weight * b.weight * value(a.x, b.x))
                    .sum();
                sum * step * step
            })
            .collect()
    };
    let fold = |c: usize| if c >= middle { c - middle } else { middle - 1 - c };
    let cell = |x: usize, y: usize| {
        let (x, y) = (fold(x), fold(y));
        quadrant[x.min(y) * middle + x.max(y)]
    };
    // Running sums along x, then along y.
    let mut along_x = vec![0.0_f64; side * cells];
    for y in 0..cells {
        let mut sum: f64 = (0..oversampling).map(|x| cell(x, y)).sum();
        for x in 0..side {
            along_x[y * side + x] = sum;
            if x + 1 < side {
                sum += cell(x + oversampling, y) - cell(x, y);
            }
        }
    }
    for x in 0..side {
        let mut sum: f64 = (0..oversampling).map(|y| along_x[y * side + x]).sum();
        for y in 0..side {
            grid.values[y * stride + x] = sum as f32;
            if y + 1 < side {
                sum += along_x[(y + oversampling) * side + x] - along_x[y * side + x];
            }
        }
    }
    debug_assert_eq!(cells, 2 * (half + margin), "the subcells are centred");
}

/// Computes the values of a PSF's spline at the points of `grid`.
pub(super) fn of_grid(psf: &PsfGrid, oversampling: usize, grid: &mut Grid) {
    let (half, stride) = (grid.half, grid.stride);
    let at = |i: usize, half: usize| (i as f64 - half as f64) / oversampling as f64;
    for (row, line) in grid.values.chunks_exact_mut(stride).enumerate() {
        for (column, value) in line.iter_mut().take(2 * half[0] + 1).enumerate() {
            *value = psf.pixel(at(column, half[0]), at(row, half[1])) as f32;
        }
    }
}

/// Returns coefficients of a PSF's own spline on the finer `grid`; false when its knots are not among the grid's.
pub(super) fn refine(psf: &PsfGrid, oversampling: usize, grid: &mut Grid) -> bool {
    let ratio = oversampling / psf.oversampling();
    if !oversampling.is_multiple_of(psf.oversampling()) || !ratio.is_power_of_two() {
        return false;
    }
    // Coefficients up to one beyond the last sample.
    let mut half = (PsfGrid::side_of(psf.oversampling(), psf.half_px()) / 2 + 1).cast_signed();
    let range = || -half..=half;
    let mut fine: Vec<f64> =
        range().flat_map(|row| range().map(move |column| (column, row))).map(|(x, y)| psf.coefficient(x, y)).collect();
    for _ in 0..ratio.trailing_zeros() {
        fine = halved(&fine, (2 * half + 1).cast_unsigned());
        half = 2 * half - 1;
    }
    let side = 2 * half + 1;
    let (offset, stride) = (grid.half.map(|h| half - h.cast_signed()), grid.stride);
    for (row, line) in grid.values.chunks_exact_mut(stride).enumerate() {
        for (column, value) in line.iter_mut().take(2 * grid.half[0] + 1).enumerate() {
            let (x, y) = (column.cast_signed() + offset[0], row.cast_signed() + offset[1]);
            let inside = (0..side).contains(&x) && (0..side).contains(&y);
            let taken = usize::try_from(y * side + x).ok().filter(|_| inside).and_then(|at| fine.get(at));
            *value = taken.map_or(0.0, |c| *c as f32);
        }
    }
    true
}

/// Returns the same spline on knots half as far apart: `side` coefficients along each side become `2 side - 3`.
fn halved(coarse: &[f64], side: usize) -> Vec<f64> {
    let finer = 2 * side - 3;
    // Fine knot k is at coarse (k + 1) / 2.
    let line = |at: &dyn Fn(usize) -> f64, k: usize| {
        let i = k.div_ceil(2);
        if k.is_multiple_of(2) { 0.5 * (at(i) + at(i + 1)) } else { (at(i - 1) + 6.0 * at(i) + at(i + 1)) / 8.0 }
    };
    let mut along_x = vec![0.0; finer * side];
    for (row, out) in coarse.chunks_exact(side).zip(along_x.chunks_exact_mut(finer)) {
        for (k, value) in out.iter_mut().enumerate() {
            *value = line(&|i| row[i], k);
        }
    }
    let mut out = vec![0.0; finer * finer];
    for (k, row) in out.chunks_exact_mut(finer).enumerate() {
        for (x, value) in row.iter_mut().enumerate() {
            *value = line(&|i| along_x[i * finer + x], k);
        }
    }
    out
}
