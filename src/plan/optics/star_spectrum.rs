//! The spectrum of a star of known G and BP-RP: photons s^-1 m^-2 nm^-1 above the optics.
//!
//! A black body, `n(lambda) = s lambda^-4 / (exp(c2 / (lambda T)) - 1)`. `T` is the **colour temperature** in Gaia's
//! own system: the body whose BP-RP, through Gaia's passbands and zero points, is the star's. `s` makes its G the
//! star's. So both values of a star in the catalog are reproduced with any reddening, and light between and near Gaia's
//! bands is interpolated instead of estimated from an effective temperature. Sources: Planck's law (CODATA 2018
//! constants); Gaia's bands: `gaia_bands`.
//!
//! *Limits.* No lines, bands of molecules, or Balmer jump. Against the mean stars of the Gaia DR3 documentation, table
//! 5.9, over -0.4 <= BP-RP <= 2.6: V errs by at most 0.045 mag, R by 0.068, I by 0.048; up to 4: V 0.10, R 0.07, I
//! 0.12. Against measured spectra of Vega and the Sun: electrons of a silicon detector err by 0.1 %, of 100 to 200 nm
//! wide parts of it by 1 to 5 %; a detector that sees more blue than Gaia by 5 % for Vega (Balmer jump), 1 % for the
//! Sun. Light outside 350 to 1000 nm is only as good as the black body. Colours are clamped to [`COLOR_RANGE`], a
//! missing one is taken as 0. *Validation:* `tests/physics/radiometry.rs`, the tests below.

use crate::optics::{gaia_bands::GaiaBand, radiometry::COLOR_RANGE, spectrum::Cells};

/// Second radiation constant `h c / k`, nm K (CODATA 2018).
const C2_NM_K: f64 = 1.438_776_877e7;
/// Range of reciprocal temperatures in the search for a colour temperature, 1/K: colours -0.63 and 6.
const RECIPROCAL_RANGE_PER_K: (f64, f64) = (1e-7, 1.0 / 1200.0);
/// Tolerance of the colour in the search for a temperature, mag.
const COLOR_TOLERANCE: f64 = 1e-10;
/// Largest number of steps of that search: it needs about ten.
const MOST_STEPS: usize = 100;

/// Spectrum of one star of G = 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StarSpectrum {
    temperature_k: f64,
    scale: f64,
}

impl StarSpectrum {
    /// Returns the colour temperature, K.
    pub fn temperature_k(&self) -> f64 {
        self.temperature_k
    }

    /// Returns the photons s^-1 m^-2 nm^-1 of the star, scaled to G = 0, at a wavelength above 0.
    pub fn photons_per_s_m2_nm(&self, nm: f64) -> f64 {
        self.scale * planck_photons(nm, self.temperature_k.recip())
    }
}

/// Returns the shape of a black body in photons per wavelength.
fn planck_photons(nm: f64, reciprocal_k: f64) -> f64 {
    // In micrometres, so that the numbers stay near one.
    (nm * 1e-3).powi(-4) / (C2_NM_K * reciprocal_k / nm).exp_m1()
}

/// Makes spectra: Gaia's bands, ready to be integrated over.
#[derive(Debug, Clone)]
pub struct StarSpectra {
    g: (GaiaBand, Cells),
    bp: (GaiaBand, Cells),
    rp: (GaiaBand, Cells),
}

impl Default for StarSpectra {
    fn default() -> Self {
        Self::new()
    }
}

impl StarSpectra {
    /// Returns spectra with the passbands of this crate.
    pub fn new() -> Self {
        let ready = |band: GaiaBand| {
            let (from, to) = band.response.range_nm();
            let cells = Cells::new(from, to, band.response.knots_nm());
            (band, cells)
        };
        Self { g: ready(GaiaBand::g()), bp: ready(GaiaBand::bp()), rp: ready(GaiaBand::rp()) }
    }

    /// Returns the spectrum of a star of G = 0 and this colour.
    pub fn of_color(&self, bp_rp: f64) -> StarSpectrum {
        let color = if bp_rp.is_finite() { bp_rp.clamp(COLOR_RANGE.0, COLOR_RANGE.1) } else { 0.0 };
        let reciprocal_k = self.reciprocal_of_color(color);
        let counted = counts(&self.g, reciprocal_k);
        StarSpectrum { temperature_k: reciprocal_k.recip(), scale: self.g.0.zero_magnitude_e_per_s_m2() / counted }
    }

    /// Returns the BP-RP of a black body.
    fn color(&self, reciprocal_k: f64) -> f64 {
        self.bp.0.mag(counts(&self.bp, reciprocal_k)) - self.rp.0.mag(counts(&self.rp, reciprocal_k))
    }

    /// Returns the reciprocal of the colour temperature: the colour rises with it, nearly in proportion. By false
    /// position (Illinois).
    fn reciprocal_of_color(&self, color: f64) -> f64 {
        let (mut low, mut high) = RECIPROCAL_RANGE_PER_K;
        let (mut below, mut above) = (self.color(low) - color, self.color(high) - color);
        let mut tried = low;
        for _ in 0..MOST_STEPS {
            tried = (low * above - high * below) / (above - below);
            let miss = self.color(tried) - color;
            if miss.abs() < COLOR_TOLERANCE {
                break;
            }
            if miss < 0.0 {
                (low, below, above) = (tried, miss, 0.5 * above);
            } else {
                (high, above, below) = (tried, miss, 0.5 * below);
            }
        }
        tried
    }
}

/// Returns the electrons that Gaia counts of a black body of that shape, in arbitrary units.
fn counts((band, cells): &(GaiaBand, Cells), reciprocal_k: f64) -> f64 {
    cells.integral(|nm| band.response.at(nm) * planck_photons(nm, reciprocal_k))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_spectrum_has_the_colour_and_the_magnitude_asked_for() {
        let spectra = StarSpectra::new();
        for color in [-0.5, -0.2, 0.0, 0.3, 0.82, 1.5, 2.5, 3.7, 5.0] {
            let star = spectra.of_color(color);
            let counted = |(band, cells): &(GaiaBand, Cells)| {
                band.mag(cells.integral(|nm| band.response.at(nm) * star.photons_per_s_m2_nm(nm)))
            };
            assert!((counted(&spectra.bp) - counted(&spectra.rp) - color).abs() < 1e-9, "colour {color}");
            assert!(counted(&spectra.g).abs() < 1e-9, "G at colour {color}");
            assert!((spectra.color(star.temperature_k().recip()) - color).abs() < 1e-9, "{color}");
        }
    }

    #[test]
    fn bluer_is_hotter_and_missing_or_impossible_colours_are_clamped() {
        let spectra = StarSpectra::new();
        let t = |color: f64| spectra.of_color(color).temperature_k();
        assert!(t(-0.3) > t(0.0) && t(0.0) > t(1.0) && t(1.0) > t(4.0));
        assert!(t(4.9999) > 1400.0 && t(-0.4999) < 60_000.0, "{} {}", t(5.0), t(-0.5));
        assert_eq!(spectra.of_color(f64::NAN), spectra.of_color(0.0));
        assert_eq!(spectra.of_color(9.0), spectra.of_color(COLOR_RANGE.1));
        assert_eq!(spectra.of_color(-9.0), spectra.of_color(COLOR_RANGE.0));
    }

    #[test]
    fn the_sun_is_as_hot_as_its_colour_says() {
        // BP-RP = 0.82 (Casagrande and VandenBerg 2018); effective temperature 5772 K: the colour is bluer by its
        // lines.
        let t = StarSpectra::new().of_color(0.82).temperature_k();
        assert!((t / 5772.0 - 1.0).abs() < 0.05, "{t}");
    }
}
