//! Amplitude and phase of sine waves in a record, by correlation under a Hann window.
//!
//! In: equally spaced samples that cover the record once. Out: a phasor `X` with `x(t) = Re(X exp(i w t))`. Tones at
//! multiples of one over the record's length, two or more multiples apart and above zero, do not disturb each other,
//! nor does a constant; slow drift falls off with the cube of the distance (Harris, "On the use of windows for harmonic
//! analysis with the discrete Fourier transform", Proc. IEEE 66 (1978)). Test: `tests`.

use core::f64::consts::TAU;
use testbed::acs::filter::Complex;

/// Returns the phasor at `frequency_hz` of `samples` taken every `period_s` from `first_s` on.
pub fn phasor(samples: impl ExactSizeIterator<Item = f64>, first_s: f64, period_s: f64, frequency_hz: f64) -> Complex {
    let count = samples.len() as f64;
    let mut sum = Complex::real(0.0);
    for (k, sample) in samples.enumerate() {
        let place = k as f64;
        let hann = 0.5 - 0.5 * (TAU * place / count).cos();
        sum = sum + Complex::unit(-TAU * frequency_hz * (first_s + place * period_s)) * (hann * sample);
    }
    // The window's mean is one half, and a sine has half its amplitude at each of two frequencies.
    sum * (4.0 / count)
}

/// Returns the value at `x` of points by ascending `x`, with straight lines between and beyond them; `None` for fewer
/// than two.
pub fn read_at(points: &[[f64; 2]], x: f64) -> Option<f64> {
    let last = points.len().checked_sub(2)?;
    let k = points.iter().skip(1).position(|point| x < point[0]).unwrap_or(last).min(last);
    let ([x0, y0], [x1, y1]) = (points[k], points[k + 1]);
    Some(y0 + (y1 - y0) * (x - x0) / (x1 - x0))
}
