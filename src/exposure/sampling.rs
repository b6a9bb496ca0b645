//! PSF sampling: how the light in a pixel is had from the PSF, and what that errs by.
//!
//! In: PSF, method. Out: bounds of the 5 x 5 centroid error and of the largest pixel error. A method turns the PSF's
//! transform `G(k)` into `G(k) T(k)` where the pixel's integral is `G(k) sinc(kx / 2) sinc(ky / 2)`; the error is the
//! integral of the difference, weighted by the window (`crate::exposure::spectrum`), plus, for a method that
//! interpolates, the images of the spectrum that its grid brings. Held against drawn images by
//! `tests/physics/sampling.rs`.

use crate::exposure::spectrum::window_of_points;
use crate::optics::PsfModel;
use core::f64::consts::PI;
use core::fmt;
use core::str::FromStr;

/// Interpolation error of a tabulated PSF relative to its peak.
pub const TABLE_ERROR: f64 = 3e-5;
/// Largest oversampling of a table.
pub const MOST_OVERSAMPLING: usize = 32;
/// Points per side of the integrals over spatial frequency.
const GRID: usize = 96;
/// Images of the spectrum on each side of the origin that are summed for interpolation.
const IMAGES: i32 = 3;

/// How pixel values are had from the PSF.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Default)]
pub enum PsfSampling {
    /// Exact pixel integrals where the PSF has a closed form and is narrow, else the table that keeps
    /// [`TABLE_ERROR`].
    #[default]
    Auto,
    /// A table of exact pixel integrals, interpolated by cubic B-splines.
    Table {
        /// Grid points per pixel.
        oversampling: usize,
    },
    /// Mean of `n` x `n` points of the PSF in each pixel.
    Supersampled {
        /// Points along each side of a pixel.
        n: usize,
    },
    /// The PSF at the pixel's centre.
    Point,
    /// An image of the PSF at integer places, moved by bicubic convolution with a = -1/2 (Keys 1981).
    Bicubic,
}

impl PsfSampling {
    /// The methods a chart compares.
    pub const CHARTED: [Self; 9] = [
        Self::Auto,
        Self::Table { oversampling: 16 },
        Self::Table { oversampling: 8 },
        Self::Table { oversampling: 4 },
        Self::Table { oversampling: 2 },
        Self::Supersampled { n: 5 },
        Self::Supersampled { n: 3 },
        Self::Point,
        Self::Bicubic,
    ];
}

impl fmt::Display for PsfSampling {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Table { oversampling } => write!(f, "table:{oversampling}"),
            Self::Supersampled { n } => write!(f, "supersampled:{n}"),
            Self::Point => f.write_str("point"),
            Self::Bicubic => f.write_str("bicubic"),
        }
    }
}

/// Text that names no sampling.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "PSF sampling \"{got}\": wanted auto, table:S (S = 2, 4, 8, 16 or 32), supersampled:N (N from 1 to 9), point or bicubic"
)]
pub struct PsfSamplingError {
    got: String,
}

impl FromStr for PsfSampling {
    type Err = PsfSamplingError;
    fn from_str(text: &str) -> Result<Self, PsfSamplingError> {
        let refuse = || PsfSamplingError { got: text.into() };
        match text.split_once(':') {
            None => match text {
                "auto" => Ok(Self::Auto),
                "point" => Ok(Self::Point),
                "bicubic" => Ok(Self::Bicubic),
                _ => Err(refuse()),
            },
            Some((name, number)) => {
                let number: usize = number.parse().map_err(|_| refuse())?;
                match name {
                    "table" if [2, 4, 8, 16, 32].contains(&number) => Ok(Self::Table { oversampling: number }),
                    "supersampled" if (1..=9).contains(&number) => Ok(Self::Supersampled { n: number }),
                    _ => Err(refuse()),
                }
            }
        }
    }
}

/// Grid points per pixel that keep a table's interpolation error below [`TABLE_ERROR`].
#[must_use]
pub fn oversampling(psf: &PsfModel) -> usize {
    [4, 8, 16].into_iter().find(|&s| table_error(psf, s) <= TABLE_ERROR).unwrap_or(MOST_OVERSAMPLING)
}

/// Interpolation error of a table with `s` grid points per pixel, relative to the peak: `h^4 |f''''| / 384`.
#[must_use]
pub fn table_error(psf: &PsfModel, s: usize) -> f64 {
    let s = s as f64;
    match psf {
        PsfModel::Gaussian { sigma_px } => 3.0 / (384.0 * (s * sigma_px).powi(4)),
        // Band limit 1 / L cycles per px: the pattern's own fourth derivative at the peak, (2 pi / L)^4 / 24.
        PsfModel::Airy(airy) => (2.0 * PI / (airy.lambda_n_px() * s)).powi(4) / (24.0 * 384.0),
    }
}

/// Images of a table: phases along both axes, with the taps' margin.
#[must_use]
pub fn table_images(s: usize) -> usize {
    (s + 4) * (s + 4)
}

/// Error bounds of a sampling method.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SamplingError {
    /// 5 x 5 centroid, px.
    pub centroid_px: f64,
    /// Largest pixel error relative to the star's peak.
    pub peak: f64,
}

/// Bounds of what `sampling` errs by for a PSF with a core of `sigma_px`.
#[must_use]
pub fn sampling_error(psf: &PsfModel, sampling: PsfSampling) -> SamplingError {
    let sigma_px = psf.core_sigma_px();
    let s = match sampling {
        PsfSampling::Auto if matches!(psf, PsfModel::Gaussian { .. }) => return SamplingError::default(),
        PsfSampling::Auto => oversampling(psf),
        PsfSampling::Table { oversampling } => oversampling,
        PsfSampling::Supersampled { n } => return transfer_error(sigma_px, |k| dirichlet(k, n), &[]),
        PsfSampling::Point => return transfer_error(sigma_px, |_| 1.0, &[]),
        PsfSampling::Bicubic => return bicubic_error(sigma_px),
    };
    // A table's error is periodic in the star's place, like an S-curve of slope error / step.
    let peak = table_error(psf, s);
    SamplingError { centroid_px: peak * TABLE_CENTROID_PER_PEAK, peak }
}

/// Centroid error of a table per unit of its peak error, px (measured at most 2 for sigma 0.3 to 1.5; doubled).
const TABLE_CENTROID_PER_PEAK: f64 = 4.0;

/// `sin(k / 2) / (k / 2)`.
fn sinc(k: f64) -> f64 {
    if k.abs() < 1e-9 { 1.0 } else { (0.5 * k).sin() / (0.5 * k) }
}

/// Transform of `n` points spread evenly over a pixel.
fn dirichlet(k: f64, n: usize) -> f64 {
    let step = k / n as f64;
    if (0.5 * step).sin().abs() < 1e-9 { 1.0 } else { (0.5 * k).sin() / (n as f64 * (0.5 * step).sin()) }
}

/// Transform of the bicubic convolution kernel with a = -1/2: `sinc^3` forms (Keys 1981, eq. 21 rearranged).
fn keys(k: f64) -> f64 {
    if k.abs() < 1e-3 {
        return 1.0;
    }
    // Piecewise cubic on [0, 1] and [1, 2], even: integrate by Simpson's rule, exact enough for a bound.
    const STEPS: usize = 64;
    let kernel = |x: f64| {
        if x < 1.0 { (1.5 * x - 2.5) * x * x + 1.0 } else { ((-0.5 * x + 2.5) * x - 4.0) * x + 2.0 }
    };
    let h = 2.0 / STEPS as f64;
    let term = |i: usize| {
        let x = i as f64 * h;
        let weight = if i == 0 || i == STEPS {
            1.0
        } else if i % 2 == 1 {
            4.0
        } else {
            2.0
        };
        weight * kernel(x) * (k * x).cos()
    };
    2.0 * h / 3.0 * (0..=STEPS).map(term).sum::<f64>()
}

/// The paper's shift: points of the PSF on whole pixels, convolved with Keys's kernel at the star's fraction.
fn bicubic_error(sigma_px: f64) -> SamplingError {
    let images: Vec<[i32; 2]> =
        (-IMAGES..=IMAGES).flat_map(|m| (-IMAGES..=IMAGES).map(move |n| [m, n])).filter(|at| *at != [0, 0]).collect();
    transfer_error(sigma_px, keys, &images)
}

/// Integral of `|W(k)| |G(k) (T(k) - sinc(k))|`, and of the images `|W(k)| |G(k + 2 pi m) T(k)|` of an interpolator.
fn transfer_error(sigma_px: f64, transfer: impl Fn(f64) -> f64, images: &[[i32; 2]]) -> SamplingError {
    let gauss = |k: f64| (-0.5 * (sigma_px * k).powi(2)).exp();
    let reach = 5.0 / sigma_px;
    let step = 2.0 * reach / GRID as f64;
    let axis: Vec<f64> = (0..GRID).map(|i| (i as f64 + 0.5) * step - reach).collect();
    let along: Vec<[f64; 3]> = axis.iter().map(|&k| [gauss(k), transfer(k), sinc(k)]).collect();
    // With interpolation the pixel grid's own images: G(k + 2 pi m) for every m.
    let shifted = |k: f64, m: i32| gauss(k + 2.0 * PI * f64::from(m));
    let mut error = SamplingError::default();
    for (&ky, [gy, ty, sy]) in axis.iter().zip(&along) {
        for (&kx, [gx, tx, sx]) in axis.iter().zip(&along) {
            let mut difference = (gx * gy * (tx * ty - sx * sy)).abs();
            for [m, n] in images {
                difference += (shifted(kx, *m) * shifted(ky, *n) * tx * ty).abs();
            }
            error.centroid_px += window_of_points(kx, ky) * difference;
            error.peak += difference;
        }
    }
    let area = step * step / (4.0 * PI * PI);
    let peak = libm::erf(0.5 / (sigma_px * core::f64::consts::SQRT_2)).powi(2);
    SamplingError { centroid_px: error.centroid_px * area, peak: error.peak * area / peak }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_round_trip_and_nonsense_is_refused() {
        for sampling in PsfSampling::CHARTED {
            assert_eq!(sampling.to_string().parse(), Ok(sampling));
        }
        for wrong in ["", "table", "table:3", "supersampled:0", "bicubic:2", "exact"] {
            assert!(wrong.parse::<PsfSampling>().is_err(), "{wrong}");
        }
    }

    #[test]
    fn transforms_have_the_values_of_their_sums() {
        // Five points, by hand.
        let k = 1.3;
        let by_hand: f64 = (0..5).map(|i| (k * (f64::from(i) - 2.0) / 5.0).cos()).sum::<f64>() / 5.0;
        assert!((dirichlet(k, 5) - by_hand).abs() < 1e-12);
        assert!((keys(0.002) - 1.0).abs() < 1e-6 && keys(2.0 * PI).abs() < 1e-6, "passes a constant, blocks the grid");
        assert!((sinc(2.0 * PI)).abs() < 1e-12);
    }

    #[test]
    fn bounds_fall_with_finer_sampling_and_wider_psfs() {
        let bound = |sigma, sampling| sampling_error(&PsfModel::gaussian(sigma), sampling).centroid_px;
        assert!(bound(0.8, PsfSampling::Supersampled { n: 3 }) < bound(0.8, PsfSampling::Point));
        assert!(bound(0.8, PsfSampling::Supersampled { n: 5 }) < bound(0.8, PsfSampling::Supersampled { n: 3 }));
        assert!(bound(1.5, PsfSampling::Bicubic) < bound(0.5, PsfSampling::Bicubic));
    }
}
