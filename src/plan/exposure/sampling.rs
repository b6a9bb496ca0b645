//! PSF sampling: methods to compute the light in a pixel from the PSF, and their errors.
//!
//! In: PSF, method. Out: bounds of the 5 x 5 centroid error and of the largest pixel error. Methods that use points of
//! the PSF are products of two axes, so they are tried on one: all phases of a star on its pixel, in f64. The error of
//! a table is its splines' fourth-order remainder. `tests/physics/stability/sampling.rs` compares the bounds with drawn
//! images.

use crate::exposure::moments::window_sensitivity;
use crate::optics::{PsfForm, PsfModel, gaussian};
use core::{f64::consts::PI, fmt, str::FromStr};

/// Interpolation error of a tabulated PSF relative to its peak.
pub const TABLE_ERROR: f64 = 3e-5;
/// Largest part of a table's coefficients that a sum of products may omit, relative to the largest: part of
/// [`TABLE_ERROR`].
pub const PRODUCTS_ERROR: f64 = 1e-6;
/// Single-precision rounding of a table and of a star drawn from it.
const TABLE_ROUNDING: SamplingError = SamplingError { centroid_px: 1e-5, peak: 3e-6 };
/// Widest footprint of a Gaussian drawn from its formula instead of a table, px (the CPU backend's vectors).
pub const ANALYTIC_HALF_PX: usize = 7;
/// Largest oversampling of a table.
pub const MOST_OVERSAMPLING: usize = 32;
/// Number of phases of a star on its pixel that are tried, from one edge to the other.
const PHASES: i32 = 64;
/// Safety factor for errors between two phases (errors are smooth in the phase; their second difference is 1e-3 of
/// them).
const BETWEEN_PHASES: f64 = 1.05;
/// Pixels on each side of a star that are compared: an analytic footprint and the pixels it may lack.
const REACH_PX: i32 = 9;
/// Pixels on each side of the middle of a tracker's window.
const WINDOW_HALF_PX: i32 = 2;
/// Centroid error of a table per unit of its peak error and of the window's sensitivity (measured at most 0.8).
const TABLE_CENTROID_SAFETY: f64 = 2.0;

/// Method to compute pixel values from the PSF.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Default)]
pub enum PsfSampling {
    /// Exact pixel integrals where the PSF has a closed form and is narrow, else the table that keeps
    /// [`TABLE_ERROR`].
    #[default]
    Auto,
    /// A table of exact pixel integrals, interpolated by cubic B-splines.
    Table {
        /// Number of grid points per pixel.
        oversampling: usize,
    },
    /// Mean of `n` x `n` points of the PSF in each pixel.
    Supersampled {
        /// Number of points along each side of a pixel.
        n: usize,
    },
    /// The PSF at the pixel's centre.
    Point,
    /// An image of the PSF at integer places, moved by bicubic convolution with a = -1/2 (Keys 1981).
    Bicubic,
}

impl PsfSampling {
    /// Returns true for exact pixel integrals and tables of them.
    pub fn is_exact(self) -> bool {
        matches!(self, Self::Auto | Self::Table { .. })
    }

    /// Methods compared by a chart.
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

/// The text is not the name of a sampling.
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

/// Returns the grid points per pixel that keep a table's interpolation error below [`TABLE_ERROR`].
pub fn oversampling(psf: &PsfModel) -> usize {
    let enough = |s: &usize| table_error(psf, *s) <= TABLE_ERROR - PRODUCTS_ERROR;
    match psf.form() {
        // The knots of a grid are knots of its table, which is therefore the same spline.
        PsfForm::Grid(grid) => {
            let finer = || (0..).map(|k| grid.oversampling() << k).take_while(|s| *s <= MOST_OVERSAMPLING);
            finer().find(enough).or(finer().last()).unwrap_or(MOST_OVERSAMPLING)
        }
        // One value for all nodes.
        PsfForm::Field(field) => field.nodes().iter().map(oversampling).max().unwrap_or(MOST_OVERSAMPLING),
        PsfForm::Gaussian(_) | PsfForm::Round(_) => [4, 8, 16].into_iter().find(enough).unwrap_or(MOST_OVERSAMPLING),
    }
}

/// Returns the interpolation error of a table with `s` grid points per pixel, relative to the peak.
pub fn table_error(psf: &PsfModel, s: usize) -> f64 {
    psf.table_error(s as f64)
}

/// Returns the number of images of a table: phases along both axes, with the taps' margin.
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

/// Returns error bounds of `sampling` for a PSF with a core of `sigma_px`.
pub fn sampling_error(psf: &PsfModel, sampling: PsfSampling) -> SamplingError {
    let sigma_px = psf.core_sigma_px();
    let s = match sampling {
        PsfSampling::Auto if psf.is_gaussian() => return SamplingError::default(),
        PsfSampling::Auto => oversampling(psf),
        PsfSampling::Table { oversampling } => oversampling,
        PsfSampling::Supersampled { .. } | PsfSampling::Point | PsfSampling::Bicubic => {
            return tried_error(sigma_px, sampling);
        }
    };
    // A table's error moves the centroid like any other change of shape.
    let peak = table_error(psf, s);
    SamplingError { centroid_px: peak * TABLE_CENTROID_SAFETY * window_sensitivity(sigma_px), peak }
}

/// Returns error bounds of a star drawn from the table of a PSF, or of a kernel made of it: between the grid points,
/// what a sum of products omits, and single precision.
pub fn drawn_table_error(psf: &PsfModel) -> SamplingError {
    let s = oversampling(psf);
    let peak = table_error(psf, s);
    let centroid_px = peak * TABLE_CENTROID_SAFETY * window_sensitivity(psf.core_sigma_px());
    SamplingError {
        centroid_px: centroid_px + TABLE_ROUNDING.centroid_px,
        peak: peak + PRODUCTS_ERROR + TABLE_ROUNDING.peak,
    }
}

/// Returns the light in the pixel whose centre lies `x` px from a star along one axis, by a method that uses points of
/// the PSF.
fn sampled(sigma_px: f64, sampling: PsfSampling, x: f64) -> f64 {
    let density = |x: f64| (-0.5 * (x / sigma_px).powi(2)).exp() / (sigma_px * (2.0 * PI).sqrt());
    let mean = |n: usize| (0..n).map(|i| density(x + (i as f64 + 0.5) / n as f64 - 0.5)).sum::<f64>() / n as f64;
    match sampling {
        PsfSampling::Point => density(x),
        PsfSampling::Supersampled { n } => mean(n),
        PsfSampling::Bicubic => {
            let first = x.floor() - 1.0;
            (0..4).map(|m| first + f64::from(m)).map(|at| density(at) * keys(x - at)).sum()
        }
        PsfSampling::Auto | PsfSampling::Table { .. } => gaussian::cell(x, sigma_px),
    }
}

/// Returns the bicubic convolution kernel with a = -1/2 (Keys 1981, eq. 4 with his optimal a).
pub fn keys(x: f64) -> f64 {
    let x = x.abs();
    if x < 1.0 {
        (1.5 * x - 2.5) * x * x + 1.0
    } else if x < 2.0 {
        ((-0.5 * x + 2.5) * x - 4.0) * x + 2.0
    } else {
        0.0
    }
}

/// Returns the largest errors over all phases. The centroid of a window along one axis does not depend on the other
/// axis; a pixel value does.
fn tried_error(sigma_px: f64, sampling: PsfSampling) -> SamplingError {
    let mut pixels = Vec::new();
    let mut centroid_px = 0.0_f64;
    for phase in -PHASES / 2..=PHASES / 2 {
        let at = f64::from(phase) / f64::from(PHASES);
        let axis = |pixel: i32| {
            let x = f64::from(pixel) - at;
            [sampled(sigma_px, sampling, x), gaussian::cell(x, sigma_px)]
        };
        pixels.extend((-REACH_PX..=REACH_PX).map(axis));
        let centroid = |k: usize| {
            let window = (-WINDOW_HALF_PX..=WINDOW_HALF_PX).map(|pixel| (f64::from(pixel), axis(pixel)[k]));
            let (first, sum) = window.fold((0.0, 0.0), |(first, sum), (x, light)| (first + x * light, sum + light));
            first / sum
        };
        centroid_px = centroid_px.max((centroid(0) - centroid(1)).abs());
    }
    let mut peak = 0.0_f64;
    for (i, [drawn_x, true_x]) in pixels.iter().enumerate() {
        for [drawn_y, true_y] in &pixels[i..] {
            peak = peak.max((drawn_x * drawn_y - true_x * true_y).abs());
        }
    }
    SamplingError {
        centroid_px: BETWEEN_PHASES * core::f64::consts::SQRT_2 * centroid_px,
        peak: BETWEEN_PHASES * peak / gaussian::cell(0.0, sigma_px).powi(2),
    }
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
    fn many_points_are_the_integral_and_keys_passes_constants() {
        let by_points = sampled(0.8, PsfSampling::Supersampled { n: 9 }, 0.3);
        let error = by_points - gaussian::cell(0.3, 0.8);
        assert!(error.abs() < 1e-3 && error.abs() > 1e-6, "{error:e}");
        let sum: f64 = (-2..3).map(|m| keys(0.2 + f64::from(m))).sum();
        assert!((sum - 1.0).abs() < 1e-12, "{sum}");
        let at_rest = sampled(0.8, PsfSampling::Bicubic, 1.0) - sampled(0.8, PsfSampling::Point, 1.0);
        assert!(at_rest.abs() < 1e-12, "a whole shift interpolates nothing: {at_rest:e}");
    }

    #[test]
    fn bounds_fall_with_finer_sampling_and_wider_psfs() {
        let bound = |sigma, sampling| sampling_error(&PsfModel::gaussian(sigma), sampling).centroid_px;
        assert!(bound(0.8, PsfSampling::Supersampled { n: 3 }) < bound(0.8, PsfSampling::Point));
        assert!(bound(0.8, PsfSampling::Supersampled { n: 5 }) < bound(0.8, PsfSampling::Supersampled { n: 3 }));
        assert!(bound(1.5, PsfSampling::Bicubic) < bound(0.5, PsfSampling::Bicubic));
    }
}
