//! A density and a seed -> a series of jitter; a series or a density -> its power in bands.
//!
//! *Series.* Random phases (Shinozuka and Deodatis, 1991): one cosine per bin of a discrete Fourier transform, with the
//! density's power in that bin, and a phase from `base::random`. So the variance of the series is exactly the density's
//! integral. Frequencies with a period longer than the series go into its slowest bin. The transform has no vector
//! code: the same bits on every machine. *Power in bands.* Welch's method: Hann windows of up to 65,536 samples,
//! overlapping by half, scaled to the variance of the record. *Limit.* A line within two bins of an edge is shared by
//! both bands.

use crate::attitude::jitter::psd::{self, Piece, PsdPoint};
use crate::attitude::jitter::record::{JitterRecord, RecordEnd};
use base::random::{Stage, key, philox};
use base::refused::Refused;
use core::f64::consts::{PI, TAU};
use glam::DVec3;
use rustfft::{FftPlanner, num_complex::Complex64};

/// Samples per period of the highest frequency of a density.
const SAMPLES_PER_PERIOD: f64 = 2.5;
/// Largest number of samples of a series made from a density; longer runs repeat it.
const SERIES_MAX: usize = 1 << 22;
/// Largest number of samples of one window of Welch's method.
const WINDOW_MAX: usize = 1 << 16;
/// Largest number of rows of a density.
pub const DENSITY_ROWS_MAX: usize = 100_000;

/// One bin of a one-sided spectrum.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpectrumBin {
    /// Centre frequency, Hz.
    pub frequency_hz: f64,
    /// Power about each axis, rad^2.
    pub power_rad2: DVec3,
}

impl JitterRecord {
    /// Returns a series with this density, at least `duration_s` long if its rate allows it; it repeats.
    ///
    /// # Errors
    /// When the rows are invalid, or the frequencies do not fit a series.
    pub fn of_density(points: &[PsdPoint], seed: u64, duration_s: f64) -> Result<Self, Refused> {
        if !(2..=DENSITY_ROWS_MAX).contains(&points.len()) {
            return Err(Refused(format!("{got} rows; wanted 2 to {DENSITY_ROWS_MAX}", got = points.len())));
        }
        psd::check_rows(points).map_err(Refused::of)?;
        let highest_hz = points.last().map_or(1.0, |point| point.frequency_hz);
        let rate_hz = SAMPLES_PER_PERIOD * highest_hz;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped first")]
        let count = ((duration_s * rate_hz).clamp(1024.0, SERIES_MAX as f64).ceil() as usize).next_power_of_two();
        let transform = FftPlanner::new().plan_fft_inverse(count);
        let mut samples = vec![DVec3::ZERO; count];
        let mut waves = vec![Complex64::ZERO; count];
        for axis in 0..3 {
            waves.fill(Complex64::ZERO);
            for (place, power) in bin_powers(points, axis, rate_hz / count as f64, count / 2) {
                waves[place] = Complex64::from_polar((2.0 * power).sqrt(), phase(seed, axis, place));
            }
            transform.process(&mut waves);
            samples.iter_mut().zip(&waves).for_each(|(sample, wave)| sample[axis] = wave.re);
        }
        Self::new(1.0 / rate_hz, samples, RecordEnd::Repeat)
    }

    /// Returns the power by frequency.
    pub fn spectrum(&self) -> Vec<SpectrumBin> {
        let samples = self.samples();
        let length = (1_usize << samples.len().ilog2()).min(WINDOW_MAX);
        let mean = samples.iter().sum::<DVec3>() / samples.len() as f64;
        let transform = FftPlanner::new().plan_fft_forward(length);
        let mut powers = vec![DVec3::ZERO; length / 2 + 1];
        let mut waves = vec![Complex64::ZERO; length];
        for axis in 0..3 {
            for window in samples.windows(length).step_by((length / 2).max(1)) {
                for (place, (wave, sample)) in waves.iter_mut().zip(window).enumerate() {
                    let hann = 0.5 - 0.5 * (TAU * place as f64 / length as f64).cos();
                    *wave = Complex64::new((sample[axis] - mean[axis]) * hann, 0.0);
                }
                transform.process(&mut waves);
                powers.iter_mut().zip(&waves).for_each(|(power, wave)| power[axis] += wave.norm_sqr());
            }
        }
        let variance = samples.iter().map(|sample| (*sample - mean) * (*sample - mean)).sum::<DVec3>();
        let whole: DVec3 = powers.iter().sum();
        let scale =
            DVec3::from_array([0, 1, 2].map(|axis| {
                if whole[axis] > 0.0 { variance[axis] / (samples.len() as f64 * whole[axis]) } else { 0.0 }
            }));
        let bin_hz = 1.0 / (length as f64 * self.period_s());
        let bin = |(place, power): (usize, DVec3)| SpectrumBin {
            frequency_hz: place as f64 * bin_hz,
            power_rad2: power * scale,
        };
        powers.into_iter().enumerate().map(bin).collect()
    }
}

/// Returns the power of a spectrum in a band, rad^2: from the first frequency on, below the second.
pub fn band_power_rad2(spectrum: &[SpectrumBin], [from_hz, below_hz]: [f64; 2]) -> DVec3 {
    let inside = |bin: &&SpectrumBin| (from_hz..below_hz).contains(&bin.frequency_hz);
    spectrum.iter().filter(inside).map(|bin| bin.power_rad2).sum()
}

/// Returns the mean variance of the line of sight within an exposure, rad^2: each frequency counts by `1 - sinc^2(f
/// T)`.
pub fn smear_power_rad2(spectrum: &[SpectrumBin], exposure_s: f64) -> DVec3 {
    let within = |bin: &SpectrumBin| {
        let angle = PI * bin.frequency_hz * exposure_s;
        let sinc = if angle < 1e-9 { 1.0 } else { angle.sin() / angle };
        bin.power_rad2 * (1.0 - sinc * sinc)
    };
    spectrum.iter().map(within).sum()
}

fn phase(seed: u64, axis: usize, place: usize) -> f64 {
    let word = |i: usize| u32::try_from(i).unwrap_or(u32::MAX);
    // The last word keeps these numbers different from those of a density that came over the bus.
    let [a, ..] = philox([word(place), word(axis), Stage::Jitter as u32, 1], key(seed));
    TAU * (f64::from(a) + 0.5) / 4_294_967_296.0
}

/// Returns the power of a checked density in each bin from the first to `last`.
fn bin_powers(points: &[PsdPoint], axis: usize, bin_hz: f64, last: usize) -> Vec<(usize, f64)> {
    let end = |point: &PsdPoint| (point.frequency_hz, point.density[axis]);
    let mut pieces = points.windows(2).map(|pair| Piece::between(end(&pair[0]), end(&pair[1]))).peekable();
    let (mut passed, mut below) = (0.0, 0.0);
    let mut bins = Vec::with_capacity(last);
    for place in 1..=last {
        // The last bin takes the rest that rounding leaves above it.
        let edge_hz = if place == last { f64::INFINITY } else { (place as f64 + 0.5) * bin_hz };
        while let Some(piece) = pieces.next_if(|piece| piece.high_hz <= edge_hz) {
            passed += piece.power_to(piece.high_hz);
        }
        let upto = passed + pieces.peek().map_or(0.0, |piece| piece.power_to(edge_hz));
        bins.push((place, (upto - below).max(0.0)));
        below = upto;
    }
    bins
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::attitude::{JitterReject, psd_variance};

    fn density() -> Vec<PsdPoint> {
        let point =
            |frequency_hz, density: f64| PsdPoint { frequency_hz, density: DVec3::new(density, 0.5 * density, 0.0) };
        vec![point(1.0, 4e-12), point(30.0, 1e-12), point(100.0, 1e-12), point(2000.0, 1e-14)]
    }

    #[test]
    fn a_series_has_the_power_of_its_density_in_every_band() {
        let record = JitterRecord::of_density(&density(), 7, 20.0).unwrap();
        assert!(record.duration_s() >= 20.0 && record.end() == RecordEnd::Repeat);
        let variance =
            record.samples().iter().map(|sample| *sample * *sample).sum::<DVec3>() / record.samples().len() as f64;
        let wanted = psd_variance(&density());
        assert!(((variance - wanted) / wanted.x).abs().max_element() < 1e-6, "{variance} for {wanted}");
        let spectrum = record.spectrum();
        let total = band_power_rad2(&spectrum, [0.0, f64::INFINITY]);
        assert!(((total - wanted) / wanted.x).abs().max_element() < 1e-6, "{total} for {wanted}");
        for band in [[1.0, 30.0], [30.0, 100.0], [100.0, 2000.0]] {
            let inside: Vec<_> =
                density().into_iter().filter(|p| (band[0]..=band[1]).contains(&p.frequency_hz)).collect();
            let wanted = psd_variance(&inside);
            let found = band_power_rad2(&spectrum, band);
            assert!((found.x / wanted.x - 1.0).abs() < 0.03, "{band:?}: {found} for {wanted}");
            assert!((found.x / (1.21 * wanted.x) - 1.0).abs() > 0.1, "negative control: scaled by 1.1");
        }
    }

    #[test]
    fn a_series_is_the_same_for_a_seed_and_another_for_another() {
        let record = |seed| JitterRecord::of_density(&density(), seed, 1.0).unwrap();
        assert_eq!(record(3), record(3));
        assert_ne!(record(3), record(4));
    }

    #[test]
    fn a_tone_smears_by_its_share() {
        let samples = (0..20_000).map(|i| DVec3::X * (TAU * 50.0 * f64::from(i) * 1e-3).sin()).collect();
        let spectrum = JitterRecord::new(1e-3, samples, RecordEnd::Still).unwrap().spectrum();
        assert!((band_power_rad2(&spectrum, [45.0, 55.0]).x - 0.5).abs() < 1e-3);
        assert!(band_power_rad2(&spectrum, [100.0, 500.0]).x < 1e-6);
        // An exposure of a whole period smears all of the power; a hundredth of a period smears none.
        assert!((smear_power_rad2(&spectrum, 0.02).x - 0.5).abs() < 1e-3);
        assert!(smear_power_rad2(&spectrum, 0.0002).x < 1e-3);
    }

    #[test]
    fn invalid_density_is_refused() {
        let refused = |points: &[PsdPoint]| JitterRecord::of_density(points, 1, 1.0).unwrap_err();
        assert_eq!(refused(&density()[..1]), Refused(format!("1 rows; wanted 2 to {DENSITY_ROWS_MAX}")));
        let mut falling = density();
        falling.swap(1, 2);
        assert_eq!(refused(&falling), Refused::of(JitterReject::NotRising { row: 2 }));
    }
}
