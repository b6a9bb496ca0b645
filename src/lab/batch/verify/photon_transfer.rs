//! The laboratory: moments of flats, and photon transfer by straight lines through them.
//!
//! Photon transfer: flats and darks -> gain, noise, dark current, patterns, linearity, saturation.
//!
//! The procedure of EMVA 1288 Release 4.0 Linear, with our own names for its K (here `1 / gain_e_per_dn`), `mu_p` (here
//! electrons of light: the quantum efficiency is not needed) and so on:
//!
//! 1. *Saturation*: light is doubled until the mean no longer rises; the plateau over the dark level is the capacity.
//! 2. *Photon transfer* (section 6.6): pairs at [`Procedure::levels`] levels; slope of variance over mean, both less their
//!    dark values, up to 70 % of saturation, is `1 / gain`. Weights: a variance errs by its own share.
//! 3. *Linearity* (section 6.7): a line through the means from 5 to 95 % of saturation, weights `1 / y^2`; largest deviation.
//! 4. *Dark* (section 7.1): means of pairs over a series of exposures; slope is the dark current. Variance at no exposure, less
//!    1/12 DN^2, is the read noise.
//! 5. *Patterns* (section 8.2): stacks of darks and of flats at half saturation; `prnu = sqrt(s50^2 - sdark^2) / (mean50 -
//!    meandark)`.
//!
//! *Limits.* A dark noise below 0.4 DN is not visible through the quantisation; the gain is that of a linear detector:
//! for a curved response it is the mean slope. Errors for 512 x 512 pixels and the default procedure: gain 0.2 %, read
//! noise 0.2 %, patterns 0.5 % if they exceed the noise of the stack. Checked by `tests/physics/photon_transfer.rs`.

use crate::verify::{DataSheet, data_sheet::LightPoint};
use base::image::DnImage;

/// Variance of rounding to whole DN.
pub const QUANTISATION_DN2: f64 = 1.0 / 12.0;
/// Shares of saturation between which linearity is evaluated (EMVA 1288, section 6.7).
const JUDGED: [f64; 2] = [0.05, 0.95];
/// Relative rise of the mean for a doubling of light below which the detector is saturated.
const PLATEAU: f64 = 1e-3;
/// Largest number of doublings from one electron on: no well is deeper.
const MOST_DOUBLINGS: u32 = 34;

/// One flat exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Flat {
    /// Mean electrons per pixel from light.
    pub light_e: f64,
    /// Exposure, s.
    pub exposure_s: f64,
    /// Number of the frame: every frame is used once.
    pub frame: u32,
}

/// Scope of the measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Procedure {
    /// Exposure of everything but the dark series, s.
    pub exposure_s: f64,
    /// Longest exposure of the dark series, s.
    pub longest_dark_s: f64,
    /// Levels of light.
    pub levels: u32,
    /// Number of exposures of the dark series, besides zero.
    pub darks: u32,
    /// Number of images of a stack.
    pub stacked: u32,
    /// Share of saturation up to which the photon transfer is fitted (EMVA 1288, section 6.6: 0.7); less for a bent
    /// response.
    pub fitted: f64,
}

impl Procedure {
    /// Returns EMVA's 50 levels and its minimum of 16 stacked images.
    pub fn new(exposure_s: f64, longest_dark_s: f64) -> Self {
        Self { exposure_s, longest_dark_s, levels: 50, darks: 8, stacked: 32, fitted: 0.7 }
    }
}

/// Source of flats: a camera.
struct Laboratory<'a> {
    expose: &'a mut dyn FnMut(Flat, &mut DnImage),
    images: [DnImage; 2],
    frame: u32,
}

/// Measures a detector with `expose`, which returns images of `size_px`.
#[must_use]
pub fn characterise(
    size_px: [usize; 2],
    procedure: &Procedure,
    expose: &mut dyn FnMut(Flat, &mut DnImage),
) -> DataSheet {
    let images = [(); 2].map(|()| DnImage::new(size_px[0], size_px[1]));
    let mut lab = Laboratory { expose, images, frame: 0 };
    let dark = lab.pair(0.0, procedure.exposure_s);
    let (plateau_dn, saturating_e) = lab.saturation(procedure.exposure_s);
    let points = lab.levels(procedure, saturating_e, dark);
    let gain_e_per_dn = 1.0 / transfer(&points, procedure.fitted * (plateau_dn - dark.mean_dn)).slope;
    let [level, noise] = lab.dark_series(procedure);
    let (darks, flats) =
        (lab.stack(0.0, procedure), lab.stack(half_light(&points, plateau_dn - dark.mean_dn), procedure));
    DataSheet {
        gain_e_per_dn,
        black_level_dn: level.offset,
        read_noise_e_rms: (noise.offset - QUANTISATION_DN2).max(0.0).sqrt() * gain_e_per_dn,
        dark_e_per_s: level.slope * gain_e_per_dn,
        dsnu_e_rms: darks.spatial_variance_dn2.max(0.0).sqrt() * gain_e_per_dn,
        dsnu2_se: darks.spatial_variance_se_dn2 * gain_e_per_dn * gain_e_per_dn,
        prnu: prnu(&darks, &flats),
        saturation_e: (plateau_dn - dark.mean_dn) * gain_e_per_dn,
        responsivity: responsivity(&points, plateau_dn - dark.mean_dn).slope * gain_e_per_dn,
        linearity_error: linearity_error(&points, plateau_dn - dark.mean_dn),
        points,
    }
}

impl Laboratory<'_> {
    fn pair(&mut self, light_e: f64, exposure_s: f64) -> Pair {
        for image in &mut self.images {
            (self.expose)(Flat { light_e, exposure_s, frame: self.frame }, image);
            self.frame += 1;
        }
        Pair::of(&self.images[0], &self.images[1])
    }

    /// Returns the mean of a saturated image, DN, and the light that first gave it.
    fn saturation(&mut self, exposure_s: f64) -> (f64, f64) {
        let mut before = self.pair(0.0, exposure_s).mean_dn;
        let dark = before;
        let mut light_e = 1.0;
        for _ in 0..MOST_DOUBLINGS {
            let mean = self.pair(light_e, exposure_s).mean_dn;
            let rises = mean - before > PLATEAU * (mean - dark).max(1.0);
            // The first doublings are below the noise.
            if !rises && mean - dark > 10.0 {
                return (mean, 0.5 * light_e);
            }
            (before, light_e) = (mean, 2.0 * light_e);
        }
        (before, light_e)
    }

    /// Returns pairs at even steps of light up to the first saturated one, minus the dark pair.
    fn levels(&mut self, procedure: &Procedure, saturating_e: f64, dark: Pair) -> Vec<LightPoint> {
        let point = |i: u32| {
            let light_e = saturating_e * f64::from(i) / f64::from(procedure.levels);
            let pair = self.pair(light_e, procedure.exposure_s);
            let (signal_dn, variance_dn2) = (pair.mean_dn - dark.mean_dn, pair.variance_dn2 - dark.variance_dn2);
            LightPoint { light_e, signal_dn, variance_dn2, total_variance_dn2: pair.variance_dn2 }
        };
        (1..=procedure.levels).map(point).collect()
    }

    /// Returns lines of mean and variance over the exposure, without light.
    fn dark_series(&mut self, procedure: &Procedure) -> [Line; 2] {
        let pair = |i: u32| {
            let exposure_s = procedure.longest_dark_s * f64::from(i) / f64::from(procedure.darks);
            (exposure_s, self.pair(0.0, exposure_s))
        };
        let pairs: Vec<(f64, Pair)> = (0..=procedure.darks).map(pair).collect();
        // The error of a variance is a share of itself, that of a mean its noise.
        let means = pairs.iter().map(|(s, pair)| [*s, pair.mean_dn, 1.0 / pair.variance_dn2.max(1e-3)]);
        let variances = pairs.iter().map(|(s, pair)| [*s, pair.variance_dn2, pair.variance_dn2.max(1e-3).powi(-2)]);
        [Line::through(means), Line::through(variances)]
    }

    fn stack(&mut self, light_e: f64, procedure: &Procedure) -> Pattern {
        let image = &mut self.images[0];
        let mut stack = Stack::new(image.pixels().len());
        for _ in 0..procedure.stacked {
            (self.expose)(Flat { light_e, exposure_s: procedure.exposure_s, frame: self.frame }, image);
            self.frame += 1;
            stack.add(image);
        }
        stack.pattern()
    }
}

/// Returns the points between two shares of the saturation signal.
fn between(
    points: &[LightPoint],
    saturation_dn: f64,
    [low, high]: [f64; 2],
) -> impl Iterator<Item = &LightPoint> + Clone {
    points.iter().filter(move |p| (low * saturation_dn..=high * saturation_dn).contains(&p.signal_dn))
}

/// Returns the line of variance over mean.
fn transfer(points: &[LightPoint], most_dn: f64) -> Line {
    let fitted = between(points, most_dn, [0.0, 1.0]);
    Line::through(fitted.map(|p| [p.signal_dn, p.variance_dn2, p.total_variance_dn2.powi(-2)]))
}

/// Returns the line of mean over light.
fn responsivity(points: &[LightPoint], saturation_dn: f64) -> Line {
    let judged = between(points, saturation_dn, JUDGED);
    Line::through(judged.map(|p| [p.light_e, p.signal_dn, p.signal_dn.powi(-2)]))
}

/// Returns the largest relative deviation from the straight line.
fn linearity_error(points: &[LightPoint], saturation_dn: f64) -> f64 {
    let line = responsivity(points, saturation_dn);
    let judged = between(points, saturation_dn, JUDGED);
    judged.map(|p| (p.signal_dn / line.at(p.light_e) - 1.0).abs()).fold(0.0, f64::max)
}

/// Returns the light that gives half of the saturation signal.
fn half_light(points: &[LightPoint], saturation_dn: f64) -> f64 {
    let line = responsivity(points, saturation_dn);
    (0.5 * saturation_dn - line.offset) / line.slope
}

fn prnu(darks: &Pattern, flats: &Pattern) -> f64 {
    let variance = (flats.spatial_variance_dn2 - darks.spatial_variance_dn2).max(0.0);
    variance.sqrt() / (flats.mean_dn - darks.mean_dn)
}

// Moments of flat images: the mean, the temporal noise, the spatial pattern.
//
// Two images of the same light differ only by their temporal noise, for any fixed pattern:
// `sigma^2 = 1/2 <(a - b)^2> - 1/2 (<a> - <b>)^2`. The pattern is the remaining variance of the mean of many images:
// `s^2 = var(mean) - sigma^2 / L`. Source: EMVA 1288 Release 4.0 Linear, sections 6.5 and 8.2. Units: DN, DN^2. Tests below.

/// Mean and temporal variance of a pair.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pair {
    /// Mean of both, DN.
    pub mean_dn: f64,
    /// Temporal variance of one image, DN^2.
    pub variance_dn2: f64,
}

impl Pair {
    /// Returns the moments of two images of the same light.
    pub fn of(a: &DnImage, b: &DnImage) -> Self {
        let count = a.pixels().len() as f64;
        let (mut sum_a, mut sum_b, mut squares) = (0_u64, 0_u64, 0.0);
        for (a, b) in a.pixels().iter().zip(b.pixels()) {
            sum_a += u64::from(*a);
            sum_b += u64::from(*b);
            let difference = f64::from(*a) - f64::from(*b);
            squares += difference * difference;
        }
        let (mean_a, mean_b) = (sum_a as f64 / count, sum_b as f64 / count);
        let step = mean_a - mean_b;
        Self { mean_dn: 0.5 * (mean_a + mean_b), variance_dn2: 0.5 * (squares / count - step * step) }
    }
}

/// Sum of many images of the same light, with their temporal noise.
#[derive(Debug, Clone)]
pub struct Stack {
    sums: Vec<u32>,
    squares: Vec<u64>,
    images: u32,
}

/// Moments of a stack.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Pattern {
    /// Mean of all pixels, DN.
    pub mean_dn: f64,
    /// Variance of the pixels' own means without their temporal noise, DN^2.
    pub spatial_variance_dn2: f64,
    /// Mean temporal variance of a pixel, DN^2.
    pub temporal_variance_dn2: f64,
    /// Standard error of the spatial variance, DN^2.
    pub spatial_variance_se_dn2: f64,
}

impl Stack {
    /// Returns an empty stack for images of this many pixels.
    pub fn new(pixels: usize) -> Self {
        Self { sums: vec![0; pixels], squares: vec![0; pixels], images: 0 }
    }

    /// Adds an image (65,536 at most).
    pub fn add(&mut self, image: &DnImage) {
        self.images += 1;
        for ((sum, square), dn) in self.sums.iter_mut().zip(&mut self.squares).zip(image.pixels()) {
            *sum += u32::from(*dn);
            *square += u64::from(*dn) * u64::from(*dn);
        }
    }

    /// Returns the mean and temporal variance of one pixel, DN and DN^2.
    pub fn pixel(&self, at: usize) -> [f64; 2] {
        let images = f64::from(self.images);
        let mean = f64::from(self.sums[at]) / images;
        [mean, (self.squares[at] as f64 / images - mean * mean) * images / (images - 1.0)]
    }

    /// Returns the moments of the stack, which needs at least two images.
    pub fn pattern(&self) -> Pattern {
        let count = self.sums.len() as f64;
        let [sum, temporal] = (0..self.sums.len()).map(|at| self.pixel(at)).fold([0.0; 2], add);
        let (mean_dn, temporal_variance_dn2) = (sum / count, temporal / count);
        let spread: f64 = (0..self.sums.len()).map(|at| (self.pixel(at)[0] - mean_dn).powi(2)).sum();
        let spatial_variance_dn2 = spread / (count - 1.0) - temporal_variance_dn2 / f64::from(self.images);
        // The standard error of a variance of `count` normal deviates is the root of 2 / count of itself.
        let spatial_variance_se_dn2 = (2.0 / count).sqrt() * spread / (count - 1.0);
        Pattern { mean_dn, spatial_variance_dn2, temporal_variance_dn2, spatial_variance_se_dn2 }
    }
}

fn add([a, b]: [f64; 2], [c, d]: [f64; 2]) -> [f64; 2] {
    [a + c, b + d]
}

// A straight line through points with weights: `y = offset + slope x`. Source: normal equations of weighted least
// squares, about the weighted mean of x, which keeps the digits.

/// A straight line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Line {
    /// Value at x = 0.
    pub offset: f64,
    /// Rise per unit of x.
    pub slope: f64,
}

impl Line {
    /// Returns the line nearest to `[x, y, weight]`; its slope is 0 when all x are equal.
    pub fn through(points: impl Iterator<Item = [f64; 3]> + Clone) -> Self {
        let sums = points
            .clone()
            .fold([0.0; 3], |[w, wx, wy], [x, y, weight]| [w + weight, weight.mul_add(x, wx), weight.mul_add(y, wy)]);
        let (mean_x, mean_y) = (sums[1] / sums[0], sums[2] / sums[0]);
        let [xx, xy] = points.fold([0.0; 2], |[xx, xy], [x, y, weight]| {
            let dx = x - mean_x;
            [xx + weight * dx * dx, xy + weight * dx * (y - mean_y)]
        });
        let slope = if xx > 0.0 { xy / xx } else { 0.0 };
        Self { offset: mean_y - slope * mean_x, slope }
    }

    /// Returns the value at `x`.
    pub fn at(&self, x: f64) -> f64 {
        self.slope.mul_add(x, self.offset)
    }
}

#[cfg(test)]
mod flats_tests {
    use super::*;

    fn image(pixels: &[u16]) -> DnImage {
        let mut image = DnImage::new(pixels.len(), 1);
        image.pixels_mut().copy_from_slice(pixels);
        image
    }

    #[test]
    fn a_pair_shows_time_and_hides_the_pattern() {
        // Differences -2, 2, 0, 4: mean 1, mean square 6, so 1/2 (6 - 1).
        let pair = Pair::of(&image(&[10, 22, 30, 44]), &image(&[12, 20, 30, 40]));
        assert_eq!(pair, Pair { mean_dn: 26.0, variance_dn2: 2.5 });
        let still = Pair::of(&image(&[1, 500, 9000]), &image(&[1, 500, 9000]));
        assert_eq!(still.variance_dn2, 0.0, "a pattern does not count as noise");
    }

    #[test]
    fn a_stack_takes_both_apart() {
        let mut stack = Stack::new(3);
        for offset in [0, 2, 4, 2] {
            stack.add(&image(&[10 + offset, 20 + offset, 30 + offset]));
        }
        // In time: 0, 2, 4, 2 has a variance of 8 / 3. In space: 10, 20, 30 has 100, and of the noise 8 / 3 / 4 is
        // taken off.
        let pattern = stack.pattern();
        assert_eq!(stack.pixel(1)[0], 22.0);
        assert!((pattern.temporal_variance_dn2 - 8.0 / 3.0).abs() < 1e-12, "{pattern:?}");
        assert!((pattern.spatial_variance_dn2 - (100.0 - 2.0 / 3.0)).abs() < 1e-12, "{pattern:?}");
        assert_eq!(pattern.mean_dn, 22.0);
    }
}

#[cfg(test)]
mod linear_fit_tests {
    use super::*;

    #[test]
    fn a_line_is_found_and_weights_count() {
        let points = [[1.0, 5.0, 1.0], [2.0, 7.0, 3.0], [4.0, 11.0, 0.5]];
        let line = Line::through(points.into_iter());
        assert!((line.slope - 2.0).abs() < 1e-12 && (line.offset - 3.0).abs() < 1e-12, "{line:?}");
        let outlier = |weight| Line::through(points.into_iter().chain([[5.0, 100.0, weight]])).slope;
        assert!((outlier(0.0) - 2.0).abs() < 1e-12 && outlier(1.0) > 5.0, "a weight of nothing counts nothing");
        let level = Line::through([[1.0, 2.0, 1.0], [1.0, 4.0, 1.0]].into_iter());
        assert_eq!((level.slope, level.at(9.0)), (0.0, 3.0));
    }
}
