//! Signal-to-noise ratio of a star, and the electrons needed for a given one.
//!
//! Electrons `S` of the star, shares `w_i` of its PSF in the pixels of a square window, variance `b` of each pixel
//! without the star. Two estimates of `S`, both unbiased after subtraction of the mean background:
//!
//! * **aperture**: the sum over the window, `SNR = S E / sqrt(S E + n b)` with `E = sum w_i`, `n` pixels;
//! * **optimal**: pixels weighted by `w_i / (S w_i + b)`, `SNR^2 = sum (S w_i)^2 / (S w_i + b)`; no other linear
//!   estimate has less noise (Gauss-Markov; Horne 1986, PASP 98, 609).
//!
//! `b = dark + background + read^2 + LSB^2 / 12`: shot noise of all light except the star's, the readout, the
//! converter's rounding (EMVA 1288; Janesick, *Photon Transfer*). Fixed patterns are the same in every frame, so they
//! are separate ([`Terms::prnu_e`], [`Terms::dsnu_e`]): in a single frame without a correction they add in quadrature.
//!
//! *Limits.* The star is on the centre of a pixel; the background's level is known exactly; no saturation; rounding is
//! an independent noise only where the rest is above half a step. *Validation:* `tests/physics/snr.rs`, by frames that
//! are drawn, read out and measured.

use crate::optics::psf::PsfModel;

/// Noise of a pixel without a star, over one exposure.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct PixelNoise {
    /// Dark signal, e-.
    pub dark_e: f64,
    /// Light of the sky and stray light, e-.
    pub background_e: f64,
    /// Temporal noise of the readout, e- rms.
    pub read_noise_e_rms: f64,
    /// One step of the converter, e-.
    pub lsb_e: f64,
    /// Photo-response non-uniformity, rms share.
    pub prnu: f64,
    /// Dark-signal non-uniformity, e- rms.
    pub dsnu_e_rms: f64,
}

impl PixelNoise {
    /// Returns the variance of one frame without fixed patterns, e-^2.
    pub fn variance_e2(&self) -> f64 {
        self.dark_e + self.background_e + self.read_noise_e_rms.powi(2) + self.lsb_e.powi(2) / 12.0
    }
}

/// Share of a star's light in an aperture, and the aperture's noise without the star.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NoiseInAperture {
    /// Share of the star's electrons in the aperture, above 0.
    pub share: f64,
    /// Variance of the aperture's sum without the star, e-^2.
    pub variance_e2: f64,
}

impl NoiseInAperture {
    /// Returns the SNR of a star of this many electrons in total.
    pub fn snr(&self, electrons: f64) -> f64 {
        let signal = self.share * electrons;
        signal / (signal + self.variance_e2).sqrt()
    }
}

/// Returns the electrons of the whole star whose sum over the aperture has this SNR: the positive root of `(S E)^2 -
/// snr^2 S E - snr^2 n b = 0`.
pub fn electrons_for_snr(snr: f64, noise: &NoiseInAperture) -> f64 {
    let squared = snr * snr;
    0.5 * (squared + (squared * squared + 4.0 * squared * noise.variance_e2).sqrt()) / noise.share
}

/// A square window about a star on the centre of its middle pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Window {
    /// Side, px; odd.
    pub side_px: usize,
    /// Shares of the star's light, row by row.
    shares: Vec<f64>,
}

/// Parts of the noise of the sum over a window, e- rms.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Terms {
    /// Star's electrons in the window, e-.
    pub signal_e: f64,
    /// Star's electrons in the brightest pixel, e-.
    pub peak_e: f64,
    /// Shot noise of the star.
    pub shot_e: f64,
    /// Shot noise of the dark signal.
    pub dark_e: f64,
    /// Shot noise of the background.
    pub background_e: f64,
    /// Readout.
    pub read_e: f64,
    /// Rounding of the converter.
    pub rounding_e: f64,
    /// SNR of the sum.
    pub snr: f64,
    /// SNR of the optimal weights.
    pub snr_optimal: f64,
    /// Pattern of the photo-response, not in the SNR.
    pub prnu_e: f64,
    /// Pattern of the dark signal, not in the SNR.
    pub dsnu_e: f64,
}

impl Window {
    /// Returns a window of `side_px` (made odd) pixels squared.
    pub fn new(psf: &PsfModel, side_px: usize) -> Self {
        let half = (side_px / 2) as i64;
        let offsets = || (-half..=half).map(|offset| offset as f64);
        let shares = offsets().flat_map(|y| offsets().map(move |x| psf.pixel(x, y))).collect();
        Self { side_px: 2 * (side_px / 2) + 1, shares }
    }

    /// Returns the window, up to `most_px`, that reaches this SNR with the faintest star.
    pub fn best(psf: &PsfModel, pixel: &PixelNoise, snr: f64, most_px: usize) -> Self {
        let mut best = Self::new(psf, 1);
        let mut least_e = electrons_for_snr(snr, &best.noise(pixel));
        for side_px in (3..=most_px).step_by(2) {
            let window = Self::new(psf, side_px);
            let needed_e = electrons_for_snr(snr, &window.noise(pixel));
            if needed_e < least_e {
                (best, least_e) = (window, needed_e);
            }
        }
        best
    }

    /// Returns the share of the star's light in the window (ensquared energy).
    pub fn share(&self) -> f64 {
        self.shares.iter().sum()
    }

    /// Returns the share of the star's light in the brightest pixel.
    pub fn peak(&self) -> f64 {
        self.shares.iter().copied().fold(0.0, f64::max)
    }

    /// Returns the aperture and its noise without a star.
    pub fn noise(&self, pixel: &PixelNoise) -> NoiseInAperture {
        NoiseInAperture { share: self.share(), variance_e2: self.shares.len() as f64 * pixel.variance_e2() }
    }

    /// Returns the SNR of the optimally weighted sum for a star of this many electrons in total.
    pub fn snr_optimal(&self, electrons: f64, pixel: &PixelNoise) -> f64 {
        let variance = pixel.variance_e2();
        let of_pixel = |share: &f64| {
            let signal = electrons * share;
            if signal > 0.0 { signal * signal / (signal + variance) } else { 0.0 }
        };
        self.shares.iter().map(of_pixel).sum::<f64>().sqrt()
    }

    /// Returns all terms of the noise for a star of this many electrons in total.
    pub fn terms(&self, electrons: f64, pixel: &PixelNoise) -> Terms {
        let pixels = self.shares.len() as f64;
        let signal_e = electrons * self.share();
        let lit = |share: &f64| (electrons * share + pixel.background_e).powi(2);
        Terms {
            signal_e,
            peak_e: electrons * self.peak(),
            shot_e: signal_e.sqrt(),
            dark_e: (pixels * pixel.dark_e).sqrt(),
            background_e: (pixels * pixel.background_e).sqrt(),
            read_e: pixels.sqrt() * pixel.read_noise_e_rms,
            rounding_e: (pixels / 12.0).sqrt() * pixel.lsb_e,
            snr: self.noise(pixel).snr(electrons),
            snr_optimal: self.snr_optimal(electrons, pixel),
            prnu_e: pixel.prnu * self.shares.iter().map(lit).sum::<f64>().sqrt(),
            dsnu_e: pixels.sqrt() * pixel.dsnu_e_rms,
        }
    }

    /// Returns the electrons of the whole star at which its brightest pixel contains `full_e`, including all other
    /// signals in it.
    pub fn saturating_electrons(&self, full_e: f64, pixel: &PixelNoise) -> f64 {
        ((full_e - pixel.dark_e - pixel.background_e) / self.peak()).max(0.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pixel() -> PixelNoise {
        PixelNoise { dark_e: 19.0, background_e: 4.0, read_noise_e_rms: 12.0, lsb_e: 6.0, prnu: 0.01, dsnu_e_rms: 2.0 }
    }

    #[test]
    fn electrons_for_an_snr_have_that_snr() {
        for side_px in [1, 3, 7] {
            let noise = Window::new(&PsfModel::gaussian(0.8), side_px).noise(&pixel());
            for snr in [0.1, 3.0, 5.0, 300.0] {
                let found = noise.snr(electrons_for_snr(snr, &noise));
                assert!((found / snr - 1.0).abs() < 1e-12, "{side_px} px, {snr}: {found}");
            }
        }
        let noiseless = NoiseInAperture { share: 1.0, variance_e2: 0.0 };
        assert!((electrons_for_snr(5.0, &noiseless) - 25.0).abs() < 1e-12, "photons alone: SNR^2");
    }

    #[test]
    fn parts_add_up_to_the_whole() {
        let window = Window::new(&PsfModel::gaussian(0.7), 5);
        let t = window.terms(2000.0, &pixel());
        let sum: f64 = [t.shot_e, t.dark_e, t.background_e, t.read_e, t.rounding_e].iter().map(|e| e * e).sum();
        assert!((t.signal_e / sum.sqrt() / t.snr - 1.0).abs() < 1e-12);
        assert!(
            (t.dark_e - (25.0_f64 * 19.0).sqrt()).abs() < 1e-12
                && (t.rounding_e - 5.0 * 6.0 / 12_f64.sqrt()).abs() < 1e-12
        );
        assert!((t.dsnu_e - 10.0).abs() < 1e-12, "5 x 2 e-, apart");
    }

    #[test]
    fn no_window_does_better_than_the_optimal_weights() {
        let psf = PsfModel::gaussian(0.9);
        let wide = Window::new(&psf, 15);
        for electrons in [30.0, 300.0, 3e5] {
            let optimal = wide.snr_optimal(electrons, &pixel());
            for side_px in [1, 3, 5, 7, 9] {
                let sum = Window::new(&psf, side_px).noise(&pixel()).snr(electrons);
                assert!(sum < optimal, "{electrons} e-, {side_px} px: {sum} against {optimal}");
            }
        }
        // Bright: only photon noise matters, and both reach sqrt(S).
        assert!((wide.snr_optimal(1e9, &pixel()) / 1e9_f64.sqrt() - 1.0).abs() < 1e-4);
    }

    #[test]
    fn the_best_window_is_found_and_follows_the_psf() {
        let side = |sigma| Window::best(&PsfModel::gaussian(sigma), &pixel(), 5.0, 25).side_px;
        assert_eq!(side(0.3), 1);
        assert_eq!(side(0.8), 3);
        assert!(side(2.0) >= 5, "{}", side(2.0));
        let best = Window::best(&PsfModel::gaussian(0.8), &pixel(), 5.0, 25);
        for other in [1, 5] {
            let needed = electrons_for_snr(5.0, &Window::new(&PsfModel::gaussian(0.8), other).noise(&pixel()));
            assert!(needed > electrons_for_snr(5.0, &best.noise(&pixel())), "{other} px");
        }
    }

    #[test]
    fn the_brightest_pixel_is_full_at_saturation() {
        let window = Window::new(&PsfModel::gaussian(0.6), 5);
        let star = window.saturating_electrons(30_000.0, &pixel());
        assert!((window.terms(star, &pixel()).peak_e + 19.0 + 4.0 - 30_000.0).abs() < 1e-9);
        assert_eq!(window.saturating_electrons(10.0, &pixel()), 0.0, "full without a star");
    }
}
