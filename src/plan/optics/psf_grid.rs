//! A pixel-integrated PSF on a grid of samples: made by a chain of MTFs, or measured.
//!
//! In: `P(dx, dy)`, the share of the light in the pixel whose centre lies (dx, dy) px from the star, every `1 /
//! oversampling` px up to `half_px + 1/2` px from the star; x right, y down; unit flux over the infinite plane. Out:
//! the same between the samples: the cubic B-spline through them with natural ends ([`Spline`]: the second derivative
//! vanishes there, so nothing is extrapolated), 0 beyond. That spline is the model, with which every backend can be
//! compared; its distance from the real light is for the maker of the samples to state. Source: Unser, Aldroubi and
//! Eden, IEEE Trans. Signal Processing 41 (1993), 821. Error of a smooth `P`: `h^4 |f''''| / 384` along each axis.
//! Tests below compare it with a Gaussian's integrals.

use crate::optics::gaussian;
use base::{bisection::halved, refused::Refused};
use core::f64::consts::PI;

/// Largest reach of a footprint from its star, px: the wings of an Airy pattern beyond it are left out and reported as
/// lost flux.
pub const LARGEST_HALF_PX: usize = 48;
/// Most negative sample that is accepted, share of the peak: ringing of a transform, noise of a measurement.
pub const NEGATIVE_SHARE: f64 = 0.01;
/// Smallest and largest flux of a grid: missing light is outside the grid, too much light is an error.
pub const FLUX_RANGE: (f64, f64) = (0.5, 1.01);
/// Largest number of grid points per pixel.
pub const MOST_OVERSAMPLING: usize = 32;

/// Error of a cubic spline on a grid of step h for a function whose third derivative steps by J at knots h apart,
/// anywhere between the grid's: at most `J h^3` times this (Peano's kernel, summed over all knots without regard to
/// sign; steps that change slowly give a quarter).
const OWN_KNOTS: f64 = 1.0 / 48.0;
/// The same for knots at least 2 h apart.
const FINER_KNOTS: f64 = 1.0 / 80.0;
/// Factor for interpolation along x, then along y: one error, plus the other times the spline's norm `(1 + 3 sqrt 3) /
/// 4`.
pub(super) const BOTH_AXES: f64 = 2.55;
/// Smallest reported core, px: no grid is fine enough for a narrower one.
const LEAST_CORE_PX: f64 = 0.05;

/// A pixel-integrated PSF given by samples.
#[derive(Debug, Clone, PartialEq)]
pub struct PsfGrid {
    oversampling: usize,
    half_px: usize,
    spline: Spline,
    peak: f64,
    flux: f64,
    core_sigma_px: f64,
    third_step: f64,
    /// Share of the light outside a footprint of half-width 0, 1, ... px, for the worst position of the star on its
    /// pixel.
    lost: Vec<f64>,
}

/// Every value is finite: equality is reflexive, and identical grids in memory need no comparison.
impl Eq for PsfGrid {}

impl PsfGrid {
    /// Returns the number of samples along each side of a grid.
    pub fn side_of(oversampling: usize, half_px: usize) -> usize {
        2 * half_px * oversampling + oversampling + 1
    }

    /// Returns the PSF through `samples`, row by row, [`Self::side_of`] along each side, the star on the middle one.
    ///
    /// # Errors
    /// When the samples have another shape, are not finite, fall below zero by more than [`NEGATIVE_SHARE`] of the
    /// peak, or contain a flux outside [`FLUX_RANGE`].
    pub fn new(oversampling: usize, half_px: usize, samples: Vec<f64>) -> Result<Self, Refused> {
        if !oversampling.is_multiple_of(2) || !(2..=MOST_OVERSAMPLING).contains(&oversampling) {
            return Err(Refused(format!(
                "PSF grid: {oversampling} samples per pixel, wanted an even number from 2 to {MOST_OVERSAMPLING}"
            )));
        }
        if !(1..=LARGEST_HALF_PX).contains(&half_px) {
            return Err(Refused(format!("PSF grid: half-width {half_px} px, wanted 1 to {LARGEST_HALF_PX} px")));
        }
        let side = Self::side_of(oversampling, half_px);
        if samples.len() != side * side {
            return Err(Refused(format!(
                "PSF grid: {got} samples, wanted {side} x {side} = {}: 2 x {half_px} px x {oversampling} + \
                 {oversampling} + 1 along each side",
                side * side,
                got = samples.len()
            )));
        }
        if let Some(at) = samples.iter().position(|v| !v.is_finite()) {
            return Err(Refused(format!(
                "PSF grid: the sample at column {column}, row {row} is {got}, wanted a finite number",
                column = at % side,
                row = at / side,
                got = samples[at]
            )));
        }
        let (least, peak) =
            samples.iter().fold((f64::INFINITY, 0.0_f64), |(least, most), v| (least.min(*v), most.max(*v)));
        let flux = flux_of(&samples, side, oversampling);
        if !(FLUX_RANGE.0..=FLUX_RANGE.1).contains(&flux) {
            return Err(Refused(format!(
                "PSF grid: the samples hold {flux:.4} of the light, wanted {} to {}; normalise them, or take \
                 a larger grid",
                FLUX_RANGE.0, FLUX_RANGE.1
            )));
        }
        if least < -NEGATIVE_SHARE * peak {
            return Err(Refused(format!(
                "PSF grid: the least sample is {least:.3e}, {:.1} % of the peak below zero, wanted at \
                 most {:.0} %; subtract the background, or take a measurement with less noise",
                -100.0 * least / peak,
                100.0 * NEGATIVE_SHARE
            )));
        }
        let lost = lost_by_half_width(&samples, side, oversampling, half_px);
        let spline = Spline::new(&samples, side);
        let mut grid = Self { oversampling, half_px, spline, peak, flux, core_sigma_px: 0.0, third_step: 0.0, lost };
        grid.peak = grid.highest_near(&samples);
        grid.core_sigma_px = core_sigma_px(grid.sharpest_curvature() / grid.peak);
        grid.third_step = grid.largest_third_step() / grid.peak;
        Ok(grid)
    }

    /// Returns samples of `pixel` on such a grid: x and y from the star, px.
    ///
    /// # Errors
    /// The same errors as [`Self::new`].
    pub fn sampled(oversampling: usize, half_px: usize, pixel: impl Fn(f64, f64) -> f64) -> Result<Self, Refused> {
        let side = Self::side_of(oversampling.min(MOST_OVERSAMPLING), half_px.min(LARGEST_HALF_PX));
        let at = |i: usize| (i as f64 - (side / 2) as f64) / oversampling as f64;
        let samples = (0..side * side).map(|i| pixel(at(i % side), at(i / side))).collect();
        Self::new(oversampling, half_px, samples)
    }

    /// Returns the number of samples per pixel.
    pub fn oversampling(&self) -> usize {
        self.oversampling
    }

    /// Returns the half-width, px: the grid ends this and half a pixel from the star.
    pub fn half_px(&self) -> usize {
        self.half_px
    }

    /// Returns the largest share any pixel can receive, for the best position of the star.
    pub fn peak(&self) -> f64 {
        self.peak
    }

    /// Returns the share of the light inside the grid, mean over all places of the star on its pixel.
    pub fn flux(&self) -> f64 {
        self.flux
    }

    /// Returns the standard deviation of the Gaussian with the same largest curvature, before the integral over a
    /// pixel, px.
    pub fn core_sigma_px(&self) -> f64 {
        self.core_sigma_px
    }

    /// Returns the interpolation error of a table with `per_px` grid points per pixel, relative to the peak. The spline
    /// has steps of its third derivative at its knots: a table that includes these knots is that spline, and a kernel,
    /// which displaces it, has an error within this bound.
    pub fn table_error(&self, per_px: f64) -> f64 {
        let own = self.oversampling as f64;
        let knots = if per_px >= 2.0 * own {
            FINER_KNOTS
        } else if per_px > own {
            OWN_KNOTS
        } else {
            OWN_KNOTS * own / per_px
        };
        BOTH_AXES * knots * self.third_step / per_px.powi(3)
    }

    /// Returns the share of the light outside a square footprint of half-width `half_px + 1/2` px (upper bound over all
    /// places of the star on its pixel).
    pub fn lost_flux(&self, half_px: usize) -> f64 {
        self.lost.get(half_px).or(self.lost.last()).copied().unwrap_or(1.0)
    }

    /// Returns the share of the light in the pixel whose centre lies (`x_px`, `y_px`) from the star.
    pub fn pixel(&self, x_px: f64, y_px: f64) -> f64 {
        let reach = self.half_px as f64 + 0.5;
        // Negated, so that NaN counts as outside.
        if !(x_px.abs() <= reach && y_px.abs() <= reach) {
            return 0.0;
        }
        let last = (Self::side_of(self.oversampling, self.half_px) - 1) as f64;
        let at = |v: f64| (v * self.oversampling as f64 + 0.5 * last).clamp(0.0, last);
        self.spline.at(at(x_px), at(y_px))
    }

    /// Returns the spline coefficient `column`, `row` steps of the grid from the star; beyond the grid's margin of one,
    /// 0.
    pub fn coefficient(&self, column: isize, row: isize) -> f64 {
        let middle = (self.stride() / 2).cast_signed();
        let at = |i: isize| usize::try_from(i + middle).ok().filter(|i| *i < self.stride());
        match (at(column), at(row)) {
            (Some(column), Some(row)) => self.spline.coefficients()[row * self.stride() + column],
            _ => 0.0,
        }
    }

    /// Returns the number of coefficients along each side.
    fn stride(&self) -> usize {
        Self::side_of(self.oversampling, self.half_px) + 2
    }

    /// Returns the highest value near the highest sample.
    fn highest_near(&self, samples: &[f64]) -> f64 {
        const PARTS: i32 = 8;
        let side = Self::side_of(self.oversampling, self.half_px);
        let best = (0..samples.len()).max_by(|a, b| samples[*a].total_cmp(&samples[*b])).unwrap_or(0);
        let place = |i: usize, part: i32| {
            (i as f64 - (side / 2) as f64 + f64::from(part) / f64::from(PARTS)) / self.oversampling as f64
        };
        let parts = (-PARTS..=PARTS).flat_map(|y| (-PARTS..=PARTS).map(move |x| (x, y)));
        parts.map(|(x, y)| self.pixel(place(best % side, x), place(best / side, y))).fold(0.0, f64::max)
    }

    /// Returns the largest fourth difference of the coefficients along x or y, 1 / px^3.
    fn largest_third_step(&self) -> f64 {
        let (c, stride) = (self.spline.coefficients(), self.stride());
        let mut most = 0.0_f64;
        for (at, middle) in c.iter().enumerate() {
            for (step, place) in [(1, at % stride), (stride, at / stride)] {
                if place >= 2 && place + 2 < stride {
                    let sides = c[at - 2 * step] + c[at + 2 * step] - 4.0 * (c[at - step] + c[at + step]);
                    most = most.max((sides + 6.0 * middle).abs());
                }
            }
        }
        most * (self.oversampling as f64).powi(3)
    }

    /// Returns the largest second derivative in any direction at any sample, 1 / px^2.
    fn sharpest_curvature(&self) -> f64 {
        let (stride, side) = (self.stride(), Self::side_of(self.oversampling, self.half_px));
        let per_px2 = (self.oversampling as f64).powi(2);
        // Value, slope and curvature of the spline at a knot.
        const B: [[f64; 3]; 3] = [[1.0 / 6.0, 4.0 / 6.0, 1.0 / 6.0], [-0.5, 0.0, 0.5], [1.0, -2.0, 1.0]];
        let mut sharpest = 0.0_f64;
        for row in 0..side {
            for column in 0..side {
                let along = |by: usize, bx: usize| {
                    let mut sum = 0.0;
                    for (m, by) in B[by].iter().enumerate() {
                        let at = (row + m) * stride + column;
                        let line = &self.spline.coefficients()[at..at + 3];
                        sum += by * line.iter().zip(B[bx]).map(|(c, bx)| c * bx).sum::<f64>();
                    }
                    sum
                };
                let (xx, yy, xy) = (along(0, 2), along(2, 0), along(1, 1));
                let (mean, spread) = (0.5 * (xx + yy), (0.5 * (xx - yy)).hypot(xy));
                sharpest = sharpest.max(mean.abs() + spread);
            }
        }
        sharpest * per_px2
    }
}

/// Returns the trapezoidal sum over the grid: the mean, over all places of the star on its pixel, of the light on its
/// pixels.
fn flux_of(samples: &[f64], side: usize, oversampling: usize) -> f64 {
    let weight = |i: usize| if i == 0 || i + 1 == side { 0.5 } else { 1.0 };
    let rows = samples.chunks_exact(side).enumerate();
    let sum: f64 =
        rows.map(|(y, row)| weight(y) * row.iter().enumerate().map(|(x, v)| weight(x) * v).sum::<f64>()).sum();
    sum / (oversampling * oversampling) as f64
}

/// Returns the largest loss of footprints of half-width 0, 1, ... `half_px`, over the places of the star that the grid
/// has.
fn lost_by_half_width(samples: &[f64], side: usize, oversampling: usize, half_px: usize) -> Vec<f64> {
    let mut lost = vec![0.0_f64; half_px + 1];
    for (phase_y, phase_x) in (0..=oversampling).flat_map(|y| (0..=oversampling).map(move |x| (y, x))) {
        let value = |column: usize, row: usize| {
            samples[(phase_y + row * oversampling) * side + phase_x + column * oversampling]
        };
        let mut inside = 0.0;
        for (half, lost) in lost.iter_mut().enumerate() {
            let (low, high) = (half_px - half, half_px + half);
            // The ring of pixels that this half-width adds.
            inside += (low..=high).map(|x| value(x, low)).sum::<f64>();
            if half > 0 {
                inside += (low..=high).map(|x| value(x, high)).sum::<f64>();
                inside += (low + 1..high).map(|y| value(low, y) + value(high, y)).sum::<f64>();
            }
            *lost = lost.max(1.0 - inside);
        }
    }
    lost
}

/// Returns the sigma of the Gaussian whose pixel integral has this largest curvature, relative to its peak, 1 / px^2;
/// by bisection.
fn core_sigma_px(curvature: f64) -> f64 {
    const STEPS: i32 = 64;
    let of_gaussian = |sigma: f64| {
        // The density's slope, at both edges of the pixel.
        let slope = |x: f64| -x * (-0.5 * (x / sigma).powi(2)).exp() / (sigma.powi(3) * (2.0 * PI).sqrt());
        let second = |x: f64| (slope(x + 0.5) - slope(x - 0.5)).abs();
        let most = (0..=STEPS).map(|i| second(f64::from(i) / f64::from(STEPS))).fold(0.0, f64::max);
        most / gaussian::cell(0.0, sigma)
    };
    let [low, _] = halved([LEAST_CORE_PX, LARGEST_HALF_PX as f64], 50, |sigma| of_gaussian(sigma) > curvature);
    low
}

/// The cubic B-spline with natural ends through an image, by sample.
#[derive(Debug, Clone, PartialEq)]
pub struct Spline {
    /// Coefficients, with one more than the samples on every side.
    coefficients: Vec<f64>,
    columns: usize,
    rows: usize,
}

impl Spline {
    /// Returns the spline through samples, row by row, `columns` in each.
    pub fn new(samples: &[f64], columns: usize) -> Self {
        let rows = samples.len() / columns;
        let stride = columns + 2;
        let mut out = vec![0.0; stride * (rows + 2)];
        for (row, line) in samples.chunks_exact(columns).enumerate() {
            natural(line.iter().copied(), &mut out[(row + 1) * stride..(row + 2) * stride]);
        }
        let mut column = vec![0.0; rows + 2];
        for x in 0..stride {
            natural((1..=rows).map(|y| out[y * stride + x]), &mut column);
            for (y, value) in column.iter().enumerate() {
                out[y * stride + x] = *value;
            }
        }
        Self { coefficients: out, columns, rows }
    }

    /// Returns the coefficients row by row, with one more on every side than there are samples.
    pub fn coefficients(&self) -> &[f64] {
        &self.coefficients
    }

    /// Returns its value at a place counted in samples from the first; 0 outside.
    pub fn at(&self, x: f64, y: f64) -> f64 {
        // Negated, so that NaN counts as outside.
        let inside = |v: f64, n: usize| v >= 0.0 && v <= n as f64 - 1.0;
        if !inside(x, self.columns) || !inside(y, self.rows) {
            return 0.0;
        }
        let ((first_x, wx), (first_y, wy)) = (taps(x, self.columns), taps(y, self.rows));
        let stride = self.columns + 2;
        let mut sum = 0.0;
        for (m, wy) in wy.iter().enumerate() {
            let at = (first_y + m) * stride + first_x;
            let row = &self.coefficients[at..at + 4];
            sum += wy * row.iter().zip(wx).map(|(c, wx)| c * wx).sum::<f64>();
        }
        sum
    }
}

/// Returns the first of four coefficients along an axis of `n` samples, and their weights.
fn taps(at: f64, n: usize) -> (usize, [f64; 4]) {
    // The last interval includes its end.
    let j = at.floor().clamp(0.0, n as f64 - 2.0);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the samples")]
    (j as usize, weights(at - j))
}

/// Solves one axis by elimination: `(c[i - 1] + 4 c[i] + c[i + 1]) / 6 = f[i]` with a vanishing second derivative at
/// both ends, where therefore `c = f`.
fn natural(samples: impl Iterator<Item = f64>, out: &mut [f64]) {
    let last = out.len() - 2;
    for (c, f) in out[1..=last].iter_mut().zip(samples) {
        *c = f;
    }
    let mut gains = vec![0.0; last];
    for i in 2..last {
        let below = 1.0 / (4.0 - gains[i - 1]);
        gains[i] = below;
        out[i] = (6.0 * out[i] - out[i - 1]) * below;
    }
    for i in (2..last).rev() {
        out[i] -= gains[i] * out[i + 1];
    }
    out[0] = 2.0 * out[1] - out[2];
    out[last + 1] = 2.0 * out[last] - out[last - 1];
}

/// Returns the weights of the coefficients at offsets -1, 0, 1, 2 for a point at a share `t` in [0, 1] after offset 0.
fn weights(t: f64) -> [f64; 4] {
    let r = 1.0 - t;
    [r * r * r / 6.0, (4.0 - 3.0 * t * t * (2.0 - t)) / 6.0, (4.0 - 3.0 * r * r * (2.0 - r)) / 6.0, t * t * t / 6.0]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns an elongated Gaussian off its centre, without any symmetry.
    fn skewed(x: f64, y: f64) -> f64 {
        gaussian::cell(x - 0.3, 0.9) * gaussian::cell(y + 0.2, 0.6)
    }

    #[test]
    fn the_spline_goes_through_its_samples_and_between_them_errs_by_the_fourth_order() {
        let worst = |oversampling: usize| {
            let grid = PsfGrid::sampled(oversampling, 6, skewed).unwrap();
            let mut worst = [0.0_f64; 2];
            for k in -600..=600 {
                let (x, y) = (f64::from(k) * 0.01, f64::from(k % 97) * 0.05);
                worst[1] = worst[1].max((grid.pixel(x, y) - skewed(x, y)).abs());
            }
            for k in -6..=6 {
                let at = f64::from(k) / oversampling as f64;
                worst[0] = worst[0].max((grid.pixel(at, -2.0 * at) - skewed(at, -2.0 * at)).abs());
            }
            worst
        };
        let (coarse, fine) = (worst(4), worst(8));
        assert!(coarse[0] < 1e-14 && fine[0] < 1e-14, "at the samples: {coarse:?} {fine:?}");
        // h^4 f'''' / 384 along both axes; the narrower one has 3 / (0.36 + 1/12)^2 of the peak.
        let bound = 1.4 * 15.2 / 384.0 / 4096.0 * skewed(0.3, -0.2);
        assert!(fine[1] < bound && fine[1] > 0.1 * bound, "{:e} against {bound:e}", fine[1]);
        assert!(coarse[1] > 10.0 * fine[1], "fourth order: {coarse:?} {fine:?}");
    }

    #[test]
    fn x_goes_right_and_y_goes_down() {
        let grid = PsfGrid::sampled(8, 5, skewed).unwrap();
        assert!((grid.pixel(1.3, 0.4) - skewed(1.3, 0.4)).abs() < 1e-5);
        assert!((grid.pixel(0.4, 1.3) - skewed(1.3, 0.4)).abs() > 1e-2, "transposed, it is another");
    }

    #[test]
    fn it_ends_where_the_grid_ends() {
        let wide = PsfGrid::sampled(4, 2, |x, y| gaussian::cell(x, 1.5) * gaussian::cell(y, 1.5)).unwrap();
        let edge = gaussian::cell(2.5, 1.5) * gaussian::cell(0.0, 1.5);
        assert!((wide.pixel(2.5, 0.0) - edge).abs() < 1e-15, "{} {edge}", wide.pixel(2.5, 0.0));
        for (x, y) in [(2.500_001, 0.0), (0.0, -2.500_001), (f64::NAN, 0.0), (f64::INFINITY, 0.0)] {
            assert_eq!(wide.pixel(x, y), 0.0, "{x} {y}");
        }
    }

    #[test]
    fn peak_flux_core_and_lost_light_are_those_of_the_gaussian_it_was_made_of() {
        let sigma = 0.8;
        let grid = PsfGrid::sampled(8, 7, |x, y| gaussian::cell(x, sigma) * gaussian::cell(y, sigma)).unwrap();
        assert!((grid.peak() / gaussian::cell(0.0, sigma).powi(2) - 1.0).abs() < 1e-4, "{}", grid.peak());
        assert!((grid.flux() - 1.0).abs() < 1e-9, "{}", grid.flux());
        assert!((grid.core_sigma_px() / sigma - 1.0).abs() < 0.01, "{}", grid.core_sigma_px());
        for half in 1..=4_usize {
            // Worst half a pixel off in both axes.
            let on = |i: i32| gaussian::cell(f64::from(i) - 0.5, sigma);
            let inside: f64 = (-(half as i32)..=half as i32).map(on).sum();
            let (lost, exact) = (grid.lost_flux(half), 1.0 - inside * inside);
            assert!((lost - exact).abs() < 1e-12, "half {half}: {lost:e} against {exact:e}");
        }
        let narrow = PsfGrid::sampled(8, 7, skewed).unwrap();
        assert!((narrow.core_sigma_px() / 0.6 - 1.0).abs() < 0.02, "the narrower axis: {}", narrow.core_sigma_px());
    }

    #[test]
    fn invalid_psf_samples_are_refused() {
        let good = |x: f64, y: f64| gaussian::cell(x, 0.8) * gaussian::cell(y, 0.8);
        let refused = |oversampling, half_px, f: &dyn Fn(f64, f64) -> f64| {
            PsfGrid::sampled(oversampling, half_px, f).expect_err("refused")
        };
        let even = "samples per pixel, wanted an even number from 2 to 32";
        assert_eq!(refused(3, 5, &good), Refused(format!("PSF grid: 3 {even}")));
        assert_eq!(refused(34, 5, &good), Refused(format!("PSF grid: 34 {even}")));
        assert_eq!(refused(4, 0, &good), Refused("PSF grid: half-width 0 px, wanted 1 to 48 px".into()));
        assert_eq!(refused(4, 49, &good), Refused("PSF grid: half-width 49 px, wanted 1 to 48 px".into()));
        let says = |refused: Refused, words: &str| assert!(refused.0.contains(words), "{refused}");
        says(PsfGrid::new(4, 5, vec![0.0; 44]).expect_err("too few"), "44 samples, wanted 45 x 45 = 2025:");
        let hole = |x: f64, y: f64| if x == 0.25 && y == -0.5 { f64::NAN } else { good(x, y) };
        says(refused(4, 5, &hole), "the sample at column 23, row 20 is NaN");
        says(refused(4, 5, &|x, y| 3.0 * good(x, y)), "of the light, wanted 0.5 to 1.01;");
        says(refused(4, 5, &|x, y| 0.4 * good(x, y)), "of the light, wanted 0.5 to 1.01;");
        let rim = |depth: f64| move |x: f64, y: f64| good(x, y) - if x > 5.4 { depth * good(0.0, 0.0) } else { 0.0 };
        says(refused(4, 5, &rim(0.011)), "of the peak below zero, wanted at most 1 %");
        assert!(PsfGrid::sampled(4, 5, rim(0.009)).is_ok(), "a little below zero is noise");
    }
}
