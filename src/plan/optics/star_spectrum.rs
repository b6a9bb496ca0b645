//! The spectrum of a star of known G and BP-RP: photons s^-1 m^-2 nm^-1 above the optics.
//!
//! A black body, `n(lambda) = s lambda^-4 / (exp(c2 / (lambda T)) - 1)`. `T` is the **colour temperature** in Gaia's
//! own system: the body whose BP-RP, through Gaia's passbands and zero points, is the star's. `s` makes its G the
//! star's. So both values of a star in the catalog are reproduced with any reddening, and light between and near Gaia's
//! bands is interpolated instead of estimated from an effective temperature. Sources: Planck's law (CODATA 2018
//! constants); Gaia's bands: below.
//!
//! *Limits.* No lines, bands of molecules, or Balmer jump. Against the mean stars of the Gaia DR3 documentation, table
//! 5.9, over -0.4 <= BP-RP <= 2.6: V errs by at most 0.045 mag, R by 0.068, I by 0.048; up to 4: V 0.10, R 0.07, I
//! 0.12. Against measured spectra of Vega and the Sun: electrons of a silicon detector err by 0.1 %, of 100 to 200 nm
//! wide parts of it by 1 to 5 %; a detector that sees more blue than Gaia by 5 % for Vega (Balmer jump), 1 % for the
//! Sun. Light outside 350 to 1000 nm is only as good as the black body. Colours are clamped to [`COLOR_RANGE`], a
//! missing one is taken as 0. *Validation:* `tests/physics/radiometry.rs`, the tests below.
//!
//! *Gaia's passbands* G, BP and RP, and their zero points. Source: Gaia EDR3 passbands and Vega-system zero points
//! (Riello et al. 2021, A&A 649, A3; ESA, "Gaia EDR3 passbands"; unchanged in DR3). Values are the published ones at
//! every tenth nanometre (published: every one), rounded to four digits, with straight lines between: against the full
//! table, G of black bodies from 1500 to 100 000 K errs by at most 0.9 mmag, BP-RP by 3.5 mmag; Vega's by 0.4 and 1.3
//! mmag. The zero points' own uncertainties are 3 to 4 mmag. With these zero points Vega's spectrum (CALSPEC,
//! alpha_lyr_stis_011) has G = 0.013, BP-RP = -0.017.
//!
//! `mag = ZP - 2.5 log10(P * integral of n(lambda) S(lambda) d lambda)`, `n` photons s^-1 m^-2 nm^-1, `P` the area of
//! the telescope's pupil.

use crate::optics::radiometry::COLOR_RANGE;
use crate::optics::spectrum::{Cells, Spectrum};

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
    /// Colour temperature, K.
    pub temperature_k: f64,
    scale: f64,
}

impl StarSpectrum {
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

/// Area of Gaia's pupil, m^2 (Riello et al. 2021).
pub const PUPIL_M2: f64 = 0.7278;
/// Wavelength step of the tables, nm.
const STEP_NM: f64 = 10.0;

/// One of Gaia's bands.
#[derive(Debug, Clone, PartialEq)]
pub struct GaiaBand {
    /// Electrons per photon at the pupil.
    pub response: Spectrum,
    /// Magnitude of one electron per second, Vega system.
    pub zero_point_mag: f64,
}

impl GaiaBand {
    /// Returns the G band.
    pub fn g() -> Self {
        Self { response: Spectrum::sampled(320.0, STEP_NM, &G), zero_point_mag: 25.687_366_867_1 }
    }

    /// Returns the BP band.
    pub fn bp() -> Self {
        Self { response: Spectrum::sampled(320.0, STEP_NM, &BP), zero_point_mag: 25.338_542_215_8 }
    }

    /// Returns the RP band.
    pub fn rp() -> Self {
        Self { response: Spectrum::sampled(600.0, STEP_NM, &RP), zero_point_mag: 24.747_895_501_2 }
    }

    /// Returns the magnitude of a source from which the telescope would count this many electrons s^-1 m^-2.
    pub fn mag(&self, e_per_s_m2: f64) -> f64 {
        self.zero_point_mag - 2.5 * (PUPIL_M2 * e_per_s_m2).log10()
    }

    /// Returns the electrons s^-1 m^-2 that the telescope counts from a source of magnitude 0.
    pub fn zero_magnitude_e_per_s_m2(&self) -> f64 {
        10_f64.powf(0.4 * self.zero_point_mag) / PUPIL_M2
    }
}

/// Response of G from 320 nm.
const G: [f64; 75] = [
    0.0, 0.0098, 0.0869, 0.1259, 0.1214, 0.1093, 0.1163, 0.2046, 0.3408, 0.4332, 0.4929, 0.5325, 0.5601, 0.5819,
    0.5989, 0.6127, 0.6245, 0.6346, 0.6429, 0.6514, 0.6592, 0.6652, 0.6726, 0.6779, 0.6834, 0.6882, 0.6929, 0.6984,
    0.7013, 0.7059, 0.7099, 0.7123, 0.7149, 0.7169, 0.7181, 0.7174, 0.7164, 0.7130, 0.7095, 0.7023, 0.6949, 0.6829,
    0.6709, 0.6544, 0.6361, 0.6155, 0.5924, 0.5674, 0.5396, 0.5101, 0.4791, 0.4474, 0.4148, 0.3804, 0.3473, 0.3140,
    0.2805, 0.2495, 0.2183, 0.1896, 0.1621, 0.1371, 0.1138, 0.0932, 0.0750, 0.0588, 0.0452, 0.0339, 0.0245, 0.0171,
    0.0114, 0.0073, 0.0044, 0.0024, 0.0,
];

/// Response of BP from 320 nm.
const BP: [f64; 39] = [
    0.0, 0.0109, 0.2098, 0.1846, 0.2353, 0.2044, 0.1621, 0.2544, 0.4322, 0.5335, 0.5783, 0.5990, 0.6153, 0.6270,
    0.6270, 0.6292, 0.6346, 0.6353, 0.6315, 0.6301, 0.6300, 0.6233, 0.6202, 0.6227, 0.6193, 0.6086, 0.6133, 0.6432,
    0.6279, 0.6132, 0.6495, 0.6669, 0.6207, 0.5284, 0.3412, 0.0352, 0.0007, 0.0003, 0.0,
];

/// Response of RP from 600 nm.
const RP: [f64; 50] = [
    0.0, 0.0001, 0.0090, 0.3945, 0.7285, 0.6932, 0.7068, 0.7259, 0.7318, 0.7311, 0.7376, 0.7352, 0.7322, 0.7396,
    0.7434, 0.7384, 0.7392, 0.7300, 0.7148, 0.7045, 0.7038, 0.7012, 0.6905, 0.6750, 0.6552, 0.6279, 0.5985, 0.5664,
    0.5321, 0.4998, 0.4632, 0.4237, 0.3837, 0.3410, 0.2992, 0.2555, 0.2165, 0.1788, 0.1454, 0.1143, 0.0815, 0.0522,
    0.0302, 0.0166, 0.0086, 0.0042, 0.0019, 0.0008, 0.0003, 0.0,
];

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
            assert!((spectra.color(star.temperature_k.recip()) - color).abs() < 1e-9, "{color}");
        }
    }

    #[test]
    fn bluer_is_hotter_and_missing_or_impossible_colours_are_clamped() {
        let spectra = StarSpectra::new();
        let t = |color: f64| spectra.of_color(color).temperature_k;
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
        let t = StarSpectra::new().of_color(0.82).temperature_k;
        assert!((t / 5772.0 - 1.0).abs() < 0.05, "{t}");
    }
}
