//! A camera's sensitivity: SNR of its stars, limiting magnitudes, saturation.
//!
//! Input: a camera's parameters and its conditions (colour, background). Output: everything `starloop snr` prints. The
//! formulas are those of `plan::optics::snr`. The camera's own uniform background counts; omitted are effects that
//! depend on the pointing (Galaxy, zodiacal light, Sun, Moon, Earth), motion, defects and effects that depend on
//! neighbours.

use plan::optics::StarLight;
use plan::optics::snr::{PixelNoise, Terms, Window, electrons_for_snr};
use scene::camera::CameraParams;

/// Largest window size that is tried, px.
const MOST_WINDOW_PX: usize = 25;
/// SNR for which the window is chosen when none is given.
const WINDOW_SNR: f64 = 5.0;
/// Number of halvings in the search for the star of a given optimal SNR.
const HALVINGS: usize = 100;

/// Stars and background of a field, and how the stars are measured.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Conditions {
    /// Colour of the stars, BP-RP.
    pub bp_rp: f64,
    /// Exposure instead of the camera's, s.
    pub exposure_s: Option<f64>,
    /// Light of sky and stray light besides the camera's own, electrons per second and pixel.
    pub background_e_per_s: f64,
    /// Side of the window whose sum is taken, px; `None`: the one that finds the faintest stars.
    pub window_px: Option<usize>,
}

/// A camera's sensitivity under some conditions.
#[derive(Debug, Clone)]
pub struct Sensitivity {
    /// Magnitude to electrons.
    pub light: StarLight,
    /// Window whose sum is taken.
    pub window: Window,
    /// Noise of a pixel without a star.
    pub pixel: PixelNoise,
    /// Exposure, s.
    pub exposure_s: f64,
    /// Colour of the stars.
    pub bp_rp: f64,
    /// Electrons at which a pixel is full: the well, or the converter's range.
    pub full_e: f64,
}

impl Sensitivity {
    /// Returns the sensitivity of a camera.
    pub fn new(params: &CameraParams, conditions: &Conditions) -> Self {
        let detector = &params.detector;
        let exposure_s = conditions.exposure_s.unwrap_or(params.exposure_s);
        let own_e_per_s = params.background.uniform_e_per_s + params.background.sky_e_per_s;
        let pixel = PixelNoise {
            dark_e: detector.operating_dark_e_per_s() * exposure_s,
            background_e: (conditions.background_e_per_s + own_e_per_s) * exposure_s,
            read_noise_e_rms: detector.temporal_noise_e_rms(),
            lsb_e: detector.gain_e_per_dn,
            prnu: detector.prnu,
            dsnu_e_rms: detector.dsnu_e_rms,
        };
        let window = match conditions.window_px {
            Some(side_px) => Window::new(&params.psf, side_px),
            None => Window::best(&params.psf, &pixel, WINDOW_SNR, MOST_WINDOW_PX),
        };
        let full_e = detector.full_well_e.min(detector.converter_full_e());
        Self { light: params.radiometry.clone(), window, pixel, exposure_s, bp_rp: conditions.bp_rp, full_e }
    }

    /// Returns the electrons of a star.
    pub fn electrons(&self, mag_g: f64) -> f64 {
        self.light.electrons(mag_g, self.bp_rp, self.exposure_s)
    }

    /// Returns the signal and noise of a star.
    pub fn terms(&self, mag_g: f64) -> Terms {
        self.window.terms(self.electrons(mag_g), &self.pixel)
    }

    /// Returns the G magnitude at which the sum over the window has this SNR; `None` when no star does.
    pub fn limiting_mag(&self, snr: f64) -> Option<f64> {
        self.mag_of(electrons_for_snr(snr, &self.window.noise(&self.pixel)))
    }

    /// Returns the G magnitude at which the optimally weighted sum has this SNR; `None` when no star does.
    pub fn limiting_mag_optimal(&self, snr: f64) -> Option<f64> {
        // The optimal sum needs at most the electrons of the plain sum, and SNR rises with the star's light.
        let (mut faint_e, mut bright_e) = (0.0, electrons_for_snr(snr, &self.window.noise(&self.pixel)));
        for _ in 0..HALVINGS {
            let middle_e = 0.5 * (faint_e + bright_e);
            if self.window.snr_optimal(middle_e, &self.pixel) < snr { faint_e = middle_e } else { bright_e = middle_e }
        }
        self.mag_of(bright_e)
    }

    /// Returns the G magnitude at which the brightest pixel is full; `None` when no star fills it, or it is full
    /// without one.
    pub fn saturation_mag(&self) -> Option<f64> {
        self.mag_of(self.window.saturating_electrons(self.full_e, &self.pixel))
    }

    fn mag_of(&self, electrons: f64) -> Option<f64> {
        self.light.mag_g_of_electrons(electrons, self.bp_rp, self.exposure_s)
    }
}
