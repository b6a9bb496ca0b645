//! A camera's sensitivity: SNR of its stars, limiting magnitudes, saturation.
//!
//! Input: a camera's parameters and its conditions (colour, background). Output: everything `starloop snr` prints. The
//! formulas are those of `plan::optics::snr`. The camera's own uniform background counts; omitted are effects that
//! depend on the pointing (Galaxy, zodiacal light, Sun, Moon, Earth), motion, defects and effects that depend on
//! neighbours.
//!
//! The faintest star that a camera sees, and the magnitude down to which `radiometry.limiting_mag = "auto"` draws.
//!
//! Seen is a star of the Sun's colour whose sum over the best window has an SNR of 3 in one frame, as `starloop snr`
//! prints it: without motion, sky of the pointing or stray light. Drawn is half a magnitude more, for redder stars and
//! for the sum of those that are hardly seen, rounded up to a tenth: the last bits of a machine's mathematical library
//! do not count. No fainter star is drawn than the catalog has, nor more than fit into memory.

use base::refused::Refused;
use config::Bench;
use plan::optics::StarLight;
use plan::optics::snr::{PixelNoise, Terms, Window, electrons_for_snr};
use scene::camera::CameraParams;
use stars::{FieldMemory, Sky};

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

/// SNR of the faintest star that counts as seen.
pub const SEEN_SNR: f64 = 3.0;
/// Colour of the star, BP-RP: the Sun's.
const SEEN_BP_RP: f64 = 0.82;
/// Magnitudes that are drawn beyond what is seen.
const MARGIN_MAG: f64 = 0.5;
/// Steps of magnitude.
const STEPS_PER_MAG: f64 = 10.0;
/// Magnitudes within which "auto" stays, as those that a file gives.
const RANGE_MAG: [f64; 2] = [-2.0, 25.0];

/// Returns the sensitivity of a camera for stars of the Sun's colour.
pub fn sensitivity_for_suns(camera: &CameraParams) -> Sensitivity {
    Sensitivity::new(camera, &Conditions { bp_rp: SEEN_BP_RP, ..Conditions::default() })
}

/// Returns the G magnitude of the faintest star that the camera sees; `None` when it sees none.
pub fn seen_mag(camera: &CameraParams) -> Option<f64> {
    sensitivity_for_suns(camera).limiting_mag(SEEN_SNR)
}

/// Returns the magnitude down to which "auto" draws, whatever the catalog has.
pub(crate) fn auto_limiting_mag(camera: &CameraParams) -> f64 {
    let [brightest, faintest] = RANGE_MAG;
    let drawn = seen_mag(camera).unwrap_or(brightest) + MARGIN_MAG;
    ((drawn * STEPS_PER_MAG).ceil() / STEPS_PER_MAG).clamp(brightest, faintest)
}

/// Bounds the magnitude of "auto" by the bench's catalog and by the memory for its stars.
///
/// # Errors
/// When a layer cannot be read or is damaged, or the layers do not make one sky.
pub(crate) fn bound_by_catalog(camera: &mut CameraParams, bench: &Bench) -> Result<(), Refused> {
    if bench.camera.radiometry.limiting_mag.is_some() {
        return Ok(());
    }
    let field = FieldMemory { radius_rad: camera.geometry.half_diagonal_rad(), memory_mb: bench.star_memory_mb };
    camera.limiting_mag = Sky::faintest(&bench.layers, camera.limiting_mag, field)?;
    Ok(())
}
