//! A chain of transfer functions -> the PSF integrated over pixels, on a grid.
//!
//! In: [`MtfChain`]; the allowed errors of the samples ([`Drawing`]). Out: [`PsfGrid`] with the bounds of its errors
//! ([`ChainPsf`]). `P(x, y) = integral of S(fx, fy) exp(2 pi i (fx x + fy y))`, `S` the chain including the pixel: unit
//! flux over the infinite plane, because `S(0) = 1`.
//!
//! *Method.* `S` is sampled every `1 / T` cycles/px up to the end of its band, folded to the grid's own band (as by
//! sampling, and exact), and transformed along rows and columns. `S` is even in both axes, so is `P`. The factors that
//! depend on the wavelength are round: they are tabulated once ([`ROWS`] rows, cubic interpolation).
//!
//! *Errors*, in shares of the flux per pixel, each bounded and reported:
//! * **folded wings**: sampling `S` repeats the star every `T` px. A cone `-s |f|` at frequency 0 makes a mean wing of
//!   `s / (4 pi^2 r^3)`; the rings of an annular pupil reach at most `RINGS` times that; the sum of `|m|^-3` over all
//!   repetitions is 9.03 (4 zeta(3/2) beta(3/2)). `T` is taken so that the sum is small enough;
//! * **between samples**: for one wave of frequency `f`, cubic spline interpolation through samples every `1 / n` px
//!   errs by at most `E(u) = 2 (1 - eta(u))`, `u = f / n`, `eta` the spline's own spectrum over that of its samples
//!   (all aliases are positive and sum to 1). Two axes: `E(ux) + E(uy)`. Integrated over `|S|` this bounds every point;
//!   `n` is the least that is good enough;
//! * **outside**: the light beyond the grid's edge, mean over all places of the star.
//!
//! Limits: a star so sharp that 32 samples per pixel are too few is refused. Sources: Goodman, Introduction to Fourier
//! Optics; Unser, IEEE Signal Processing Magazine 16 (1999) 22, for `eta`. `tests/physics/psf_chain.rs` compares grids
//! with Airy stamps, with the chain by transforming back, and every bound with the error it bounds.

use crate::optics::mtf::{MtfChain, blur};
use crate::optics::psf::LARGEST_HALF_PX;
use crate::optics::psf_grid::{MOST_OVERSAMPLING, PsfGrid};
use base::refused::Refused;
use core::f64::consts::PI;
use rustfft::{FftPlanner, num_complex::Complex64};

/// Number of rows of the table of factors that depend on the wavelength.
pub const ROWS: usize = 4096;
/// Factor below which frequencies are left out: ten thousand times below any bound.
const NOTHING: f64 = 1e-12;
/// Ratio of the crests of the rings to the mean wing: `2 (1 + sqrt e)^2 / (1 + e)` for an obscuration e, at most 4.
const RINGS: f64 = 4.0;
/// Sum of `|m|^-3` over the repetitions of the star.
const REPETITIONS: f64 = 9.034;
/// Largest bound of the spline's error that is accepted, share of the flux per pixel.
pub const MOST_ERROR: f64 = 1e-4;
/// Available numbers of samples per pixel.
const OVERSAMPLINGS: [usize; 6] = [4, 8, 12, 16, 24, 32];
/// Available periods, px: products of small primes.
const PERIODS: [usize; 8] = [128, 192, 256, 384, 512, 768, 1024, 1536];

/// Accuracy with which a PSF is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Drawing {
    /// Error of the grid's spline at any place for which the samples per pixel are chosen, share of the flux per pixel.
    /// A star that needs more than 32 is drawn with 32, up to [`MOST_ERROR`].
    pub pixel: f64,
    /// Largest share of the light outside the grid; its size is limited to [`LARGEST_HALF_PX`].
    pub outside: f64,
    /// Number of samples per pixel that replaces the one chosen by the error; even.
    pub oversampling: Option<usize>,
    /// Half-width that replaces the one chosen by the light outside, px.
    pub half_px: Option<usize>,
}

impl Default for Drawing {
    /// Returns a tenth of the allowed error of a rendered pixel, 1e-4 of the flux.
    fn default() -> Self {
        Self { pixel: 1e-5, outside: 1e-4, oversampling: None, half_px: None }
    }
}

/// A drawn PSF and its errors.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainPsf {
    /// The PSF.
    pub grid: PsfGrid,
    /// Bound of the light that the repetitions of the star add to any sample.
    pub folded: f64,
    /// Bound of the spline's error between samples.
    pub between: f64,
    /// Share of the light outside the grid.
    pub outside: f64,
    /// Period of the transform, px.
    pub period_px: usize,
}

/// Largest share of light outside the largest grid.
const MOST_OUTSIDE: f64 = 0.2;

impl ChainPsf {
    /// Draws the star of a chain.
    ///
    /// # Errors
    /// When it is too sharp or too wide for a grid.
    pub fn draw(chain: &MtfChain, drawing: &Drawing) -> Result<Self, Refused> {
        let spectrum = Spectrum::of(chain);
        let (oversampling, between) = spectrum.oversampling(drawing)?;
        let (half_px, outside) = spectrum.half_px(drawing)?;
        let period_px = spectrum.period_px(half_px, 0.01 * drawing.pixel);
        let samples = spectrum.samples(oversampling, half_px, period_px);
        let folded = spectrum.folded(half_px, period_px);
        Ok(Self { grid: PsfGrid::new(oversampling, half_px, samples)?, folded, between, outside, period_px })
    }
}

/// The chain prepared for sampling: a round factor that depends on the wavelength, and one for each axis.
#[derive(Debug)]
struct Spectrum<'a> {
    chain: &'a MtfChain,
    /// Round factor every `step` cycles/px from 0 to the end of the band.
    round: Vec<f64>,
    step: f64,
    end: f64,
    slope: f64,
    /// Radius of the geometric blur disc of defocus, px: wings start at its edge.
    disc_px: f64,
}

impl<'a> Spectrum<'a> {
    fn of(chain: &'a MtfChain) -> Self {
        let p = chain.params();
        let blur_px = p.assembly_um.hypot(p.fabrication_um) / p.pixel_pitch_um;
        let blurred = if blur_px > 0.0 { blur::gaussian_cutoff(blur_px, NOTHING) } else { f64::INFINITY };
        let end = chain.cutoff().min(blurred);
        let step = end / (ROWS - 1) as f64;
        let round = (0..ROWS).map(|i| chain.colored(i as f64 * step)).collect();
        let disc_um = p.defocus.map_or(0.0, |d| d.defocus_um.abs() / (2.0 * p.f_number));
        Self { chain, round, step, end, slope: -chain.slope_at_zero(), disc_px: disc_um / p.pixel_pitch_um }
    }

    /// Returns the round factor at a magnitude: the cubic through four rows.
    fn round_at(&self, f: f64) -> f64 {
        let place = f / self.step;
        if place > (ROWS - 1) as f64 {
            return 0.0;
        }
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "0 to ROWS")]
        let first = (place as usize).clamp(1, ROWS - 3) - 1;
        let t = place - first as f64;
        let r = &self.round[first..first + 4];
        let (a, b, c, d) = (t, t - 1.0, t - 2.0, t - 3.0);
        -r[0] * b * c * d / 6.0 + r[1] * a * c * d / 2.0 - r[2] * a * b * d / 2.0 + r[3] * a * b * c / 6.0
    }

    /// Returns the factor of each axis every `step` cycles/px: the colourless terms are separable.
    fn axes(&self, step: f64, first: f64, count: usize) -> [Vec<f64>; 2] {
        let at = |i: usize| (first + i as f64) * step;
        let x = (0..count).map(|i| self.chain.colorless([at(i), 0.0])).collect();
        let y = (0..count).map(|i| self.chain.colorless([0.0, at(i)])).collect();
        [x, y]
    }

    /// Returns the bound of the spline's error between samples, with `oversampling` samples per pixel.
    fn between(&self, oversampling: usize) -> f64 {
        const CELLS: usize = 192;
        let step = self.end / CELLS as f64;
        let [x, y] = self.axes(step, 0.5, CELLS);
        let at = |i: usize| (i as f64 + 0.5) * step;
        let errors: Vec<f64> = (0..CELLS).map(|i| spline_error(at(i) / oversampling as f64)).collect();
        let mut sum = 0.0;
        for j in 0..CELLS {
            for i in 0..CELLS {
                let factor = (self.round_at(at(i).hypot(at(j))) * x[i] * y[j]).abs();
                sum += factor * (errors[i] + errors[j]);
            }
        }
        4.0 * sum * step * step
    }

    fn oversampling(&self, drawing: &Drawing) -> Result<(usize, f64), Refused> {
        if let Some(got) = drawing.oversampling {
            // The grid would refuse it too, but only after this many samples.
            let is_known = got.is_multiple_of(2) && (2..=MOST_OVERSAMPLING).contains(&got);
            return if is_known {
                Ok((got, self.between(got)))
            } else {
                Err(Refused(format!(
                    "PSF grid: {got} samples per pixel, wanted an even number from 2 to {MOST_OVERSAMPLING}"
                )))
            };
        }
        let bounds = OVERSAMPLINGS.map(|n| (n, self.between(n)));
        let [.., (most, bound)] = bounds;
        let found = bounds.into_iter().find(|(_, bound)| *bound <= drawing.pixel);
        let last = (bound <= MOST_ERROR).then_some((most, bound));
        found.or(last).ok_or_else(|| Refused(format!(
            "the chain's star is too sharp for a grid: with {most} samples per pixel it may err by {bound:.1e} of the \
             flux, wanted {MOST_ERROR:.1e}; add what blurs a real one (assembly, fabrication, charge diffusion, \
             defocus), or take model = \"airy\""
        )))
    }

    /// Returns the half-width and the light outside it, from a coarse drawing of the largest grid.
    fn half_px(&self, drawing: &Drawing) -> Result<(usize, f64), Refused> {
        const COARSE: usize = 2;
        let period_px = self.period_px(LARGEST_HALF_PX, 1e-7);
        let samples = self.samples(COARSE, LARGEST_HALF_PX, period_px);
        let outside = outside_by_half_width(&samples, COARSE);
        let enough = outside.iter().position(|lost| *lost <= drawing.outside);
        let half_px = drawing.half_px.unwrap_or(enough.unwrap_or(LARGEST_HALF_PX).max(2)).min(LARGEST_HALF_PX);
        if outside[LARGEST_HALF_PX] > MOST_OUTSIDE {
            return Err(Refused(format!(
                "the chain's star is too wide: {outside:.2} of its light lie further than {LARGEST_HALF_PX} px from its \
                 middle; take less defocus or blur",
                outside = outside[LARGEST_HALF_PX]
            )));
        }
        Ok((half_px, outside[half_px]))
    }

    /// Returns the bound of the light that the repetitions of the star add to a sample of a grid.
    fn folded(&self, half_px: usize, period_px: usize) -> f64 {
        // Distance from the furthest corner of the grid, reduced by a pixel and the blur disc.
        let reach = core::f64::consts::SQRT_2 * (half_px as f64 + 1.0) + self.disc_px;
        let nearest = period_px as f64 - reach;
        if nearest <= 0.0 {
            return f64::INFINITY;
        }
        REPETITIONS * RINGS * self.slope / (4.0 * PI * PI * nearest.powi(3))
    }

    /// Returns the shortest period that keeps the repetitions below `wanted`, or the longest.
    fn period_px(&self, half_px: usize, wanted: f64) -> usize {
        let longest = PERIODS[PERIODS.len() - 1];
        PERIODS.into_iter().find(|period| self.folded(half_px, *period) <= wanted).unwrap_or(longest)
    }

    /// Returns samples of the PSF, row by row.
    fn samples(&self, oversampling: usize, half_px: usize, period_px: usize) -> Vec<f64> {
        let middle = half_px * oversampling + oversampling / 2;
        let waves = Waves::new(period_px * oversampling, middle + 1);
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some thousands")]
        let count = (self.end * period_px as f64).floor() as usize + 1;
        let step = 1.0 / period_px as f64;
        let [x, y] = self.axes(step, 0.0, count);
        // Along y for every frequency along x, then along x for every place along y.
        let factor = |i: usize, j: usize| self.round_at((i as f64).hypot(j as f64) * step) * x[i] * y[j];
        let columns = waves.transform(count, count, factor);
        let quadrant = waves.transform(middle + 1, count, |place, i| columns[i * (middle + 1) + place]);
        let side = 2 * middle + 1;
        let scale = step * step;
        let from_middle = |i: usize| i.abs_diff(middle);
        (0..side * side)
            .map(|k| scale * quadrant[from_middle(k / side) * (middle + 1) + from_middle(k % side)])
            .collect()
    }
}

/// Computes sums of cosines `sum over all j of a(|j|) cos(2 pi j k / length)` for `k < places` by fast Fourier
/// transform.
struct Waves {
    transform: std::sync::Arc<dyn rustfft::Fft<f64>>,
    length: usize,
    places: usize,
}

impl Waves {
    fn new(length: usize, places: usize) -> Self {
        Self { transform: FftPlanner::new().plan_fft_forward(length), length, places }
    }

    /// Returns one line of `places` sums for each of `lines`, from amplitudes `a(line, j)`, `j < count`.
    fn transform(&self, lines: usize, count: usize, a: impl Fn(usize, usize) -> f64) -> Vec<f64> {
        let mut sums = vec![0.0; lines * self.places];
        let mut buffer = vec![Complex64::default(); self.length];
        let mut scratch = vec![Complex64::default(); self.transform.get_inplace_scratch_len()];
        // Real and even amplitudes have real sums: two lines are transformed as one complex one.
        for line in (0..lines).step_by(2) {
            buffer.fill(Complex64::default());
            for j in 0..count {
                let second = if line + 1 < lines { a(line + 1, j) } else { 0.0 };
                let amplitude = Complex64::new(a(line, j), second);
                let place = j % self.length;
                buffer[place] += amplitude;
                if j > 0 {
                    buffer[(self.length - place) % self.length] += amplitude;
                }
            }
            self.transform.process_with_scratch(&mut buffer, &mut scratch);
            for (k, sum) in buffer[..self.places].iter().enumerate() {
                sums[line * self.places + k] = sum.re;
                if line + 1 < lines {
                    sums[(line + 1) * self.places + k] = sum.im;
                }
            }
        }
        sums
    }
}

/// Returns the largest error of cubic spline interpolation for a wave of `u` cycles per sample and amplitude 1.
fn spline_error(u: f64) -> f64 {
    let sinc = blur::sinc(u);
    let samples = (2.0 + (2.0 * PI * u).cos()) / 3.0;
    2.0 * (1.0 - (sinc.powi(4) / samples).min(1.0))
}

/// Returns the share of the light outside squares of half-width 0, 1, ... (plus a half) px, mean over all places of the
/// star.
fn outside_by_half_width(samples: &[f64], oversampling: usize) -> Vec<f64> {
    let side = samples.len().isqrt();
    let middle = side / 2;
    let half_widths = middle / oversampling;
    let cell = 1.0 / (oversampling * oversampling) as f64;
    let within = |half_px: usize| {
        let reach = half_px * oversampling + oversampling / 2;
        let line = middle - reach..=middle + reach;
        // The outermost samples lie on the edge: half of their cells is inside.
        let edge = |i: usize| if i.abs_diff(middle) == reach { 0.5 } else { 1.0 };
        let row = |y: usize| line.clone().map(|x| edge(x) * samples[y * side + x]).sum::<f64>();
        line.clone().map(|y| edge(y) * row(y)).sum::<f64>() * cell
    };
    (0..=half_widths).map(|half_px| (1.0 - within(half_px)).max(0.0)).collect()
}
