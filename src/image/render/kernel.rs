//! A Gaussian convolved with a path, as B-spline coefficients on a fine grid.
//!
//! In: trace of the path (weight, px), sigma. Out: `sum_k w_k X_k(x) Y_k(y)`, with `X_k` and `Y_k` the spline
//! coefficients of one axis's pixel integral about the node. Each axis is filtered by the inverse B-spline as a finite
//! sum (`sqrt 3 z^|j|`, `z = sqrt 3 - 2`, 1e-7 beyond twelve), so every loop is a vector loop. Tests: the table's
//! tests and the agreement tests of both backends.

use crate::render::grid::{Grid, LANES, reserve_as};
use crate::render::profile::erf;
use base::{fused::mul_add, vector_level::vector_level};
use plan::exposure::moments::TracePoint;
use pulp::{Arch, NullaryFnOnce};

/// Taps on each side of the inverse filter.
const TAPS: usize = 12;
/// Columns summed in registers at once.
const COLUMNS: usize = 4 * LANES;

/// A path's nodes and, per node, the coefficients of its two axes.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct GaussianPath {
    nodes: Vec<[f32; 3]>,
    /// By axis, then node: coefficients, padded to whole blocks of columns.
    axes: [Vec<f32>; 2],
    edges: Vec<f32>,
    samples: Vec<f32>,
}

impl GaussianPath {
    /// Takes the path.
    pub(super) fn trace(&mut self, path: impl Iterator<Item = TracePoint>) {
        self.nodes.clear();
        self.nodes.extend(path.map(|point| point.map(|v| v as f32)));
    }

    /// Reserves capacity for a path of so many nodes on `grid`, `s` grid points per pixel.
    pub(super) fn reserve(&mut self, grid: &Grid, s: usize, nodes: usize) {
        self.nodes.reserve_exact(nodes);
        let sides = [grid.columns(), grid.rows()];
        for (axis, side) in self.axes.iter_mut().zip(sides) {
            axis.reserve_exact(nodes * side.next_multiple_of(COLUMNS));
        }
        let longest = sides[0].max(sides[1]) + 2 * TAPS + s;
        self.edges.reserve_exact(longest.next_multiple_of(COLUMNS));
        self.samples.reserve_exact(longest.next_multiple_of(COLUMNS));
    }

    /// Reserves capacity for a path like `other`.
    pub(super) fn reserve_as(&mut self, other: &Self) {
        reserve_as(&mut self.nodes, &other.nodes);
        for (axis, other) in self.axes.iter_mut().zip(&other.axes) {
            reserve_as(axis, other);
        }
        reserve_as(&mut self.edges, &other.edges);
        reserve_as(&mut self.samples, &other.samples);
    }
}

/// Fills `grid` (step `1 / s` px) with the Gaussian of `sigma_px` convolved with the path.
pub(super) fn accumulate(path: &mut GaussianPath, grid: &mut Grid, sigma_px: f64, s: usize) {
    let arch = vector_level();
    let fused = !matches!(arch, Arch::Scalar);
    arch.dispatch(Accumulate { path, grid, sigma_px: sigma_px as f32, s, fused });
}

struct Accumulate<'a> {
    path: &'a mut GaussianPath,
    grid: &'a mut Grid,
    sigma_px: f32,
    s: usize,
    fused: bool,
}

impl NullaryFnOnce for Accumulate<'_> {
    type Output = ();
    #[inline(always)]
    fn call(self) {
        if self.fused { self.sum::<true>() } else { self.sum::<false>() }
    }
}

impl Accumulate<'_> {
    #[inline(always)]
    fn sum<const FUSED: bool>(self) {
        let Self { path, grid, sigma_px, s, .. } = self;
        let padded = [grid.columns(), grid.rows()].map(|n| n.next_multiple_of(COLUMNS));
        for axis in 0..2 {
            let GaussianPath { nodes, axes, edges, samples } = &mut *path;
            axes[axis].resize(nodes.len() * padded[axis], 0.0);
            for (node, out) in nodes.iter().zip(axes[axis].chunks_exact_mut(padded[axis])) {
                let gain = if axis == 0 { node[0] } else { 1.0 };
                let shape = Axis { half: grid.half[axis], s, scale: core::f32::consts::FRAC_1_SQRT_2 / sigma_px };
                shape.coefficients::<FUSED>(node[1 + axis], gain, edges, samples, out);
            }
        }
        let (columns, rows, stride) = (grid.columns(), grid.rows(), grid.stride);
        for (row, line) in grid.values.chunks_exact_mut(stride).take(rows).enumerate() {
            let mut first = 0;
            while first < columns {
                let mut sums = [0.0_f32; COLUMNS];
                for (x, y) in path.axes[0].chunks_exact(padded[0]).zip(path.axes[1].chunks_exact(padded[1])) {
                    let gain = y[row];
                    for (sum, x) in sums.iter_mut().zip(&x[first..first + COLUMNS]) {
                        *sum = mul_add::<FUSED>(gain, *x, *sum);
                    }
                }
                let end = stride.min(first + COLUMNS);
                line[first..end].copy_from_slice(&sums[..end - first]);
                first += COLUMNS;
            }
        }
    }
}

/// One axis of the grid.
struct Axis {
    half: usize,
    s: usize,
    /// `1 / (sqrt 2 sigma)`.
    scale: f32,
}

impl Axis {
    /// Returns the spline coefficients of `gain` times the pixel integral about `shift`.
    #[inline(always)]
    fn coefficients<const FUSED: bool>(
        &self,
        shift: f32,
        gain: f32,
        edges: &mut Vec<f32>,
        samples: &mut Vec<f32>,
        out: &mut [f32],
    ) {
        let side = 2 * self.half + 1;
        let step = 1.0 / self.s as f32;
        // Edges of pixels centred on the grid points, the taps' margin included.
        let count = side + 2 * TAPS + self.s;
        let start = -((self.half + TAPS) as f32) * step - 0.5 - shift;
        edges.resize(count.next_multiple_of(LANES), 0.0);
        for (i, edge) in edges.iter_mut().enumerate() {
            *edge = erf::<FUSED>(mul_add::<FUSED>(i as f32, step, start) * self.scale);
        }
        samples.resize((side + 2 * TAPS).next_multiple_of(LANES) + LANES, 0.0);
        let half_gain = 0.5 * gain;
        let (low, high) = (&edges[..side + 2 * TAPS], &edges[self.s..self.s + side + 2 * TAPS]);
        for ((value, low), high) in samples.iter_mut().zip(low).zip(high) {
            *value = half_gain * (high - low);
        }
        let filter = inverse_filter();
        for (block, out) in out[..side.next_multiple_of(LANES)].chunks_exact_mut(LANES).enumerate() {
            let mut sums = [0.0_f32; LANES];
            let first = block * LANES;
            for (j, tap) in filter.iter().enumerate() {
                let Some(values) = samples.get(first + j..first + j + LANES) else { continue };
                for (sum, value) in sums.iter_mut().zip(values) {
                    *sum = mul_add::<FUSED>(*tap, *value, *sum);
                }
            }
            out.copy_from_slice(&sums);
        }
        out[side..].fill(0.0);
    }
}

/// Taps of the inverse of the cubic B-spline: `sqrt 3 z^|j|`.
#[inline(always)]
fn inverse_filter() -> [f32; 2 * TAPS + 1] {
    const ROOT_3: f32 = 1.732_050_8;
    const POLE: f32 = -0.267_949_2;
    let mut taps = [0.0; 2 * TAPS + 1];
    let mut value = ROOT_3;
    for j in 0..=TAPS {
        taps[TAPS + j] = value;
        taps[TAPS - j] = value;
        value *= POLE;
    }
    taps
}
