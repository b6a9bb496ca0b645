//! An instrument's band: transmission(lambda) x QE(lambda) -> electrons of a star from G and BP-RP.
//!
//! `rate = A 10^(-0.4 G) * integral of n(lambda; BP-RP) T(lambda) QE(lambda) d lambda`, with `n` the star's photons
//! ([`StarSpectrum`]) and `A` the clear aperture. The integral is taken once per colour at start
//! ([`Band::e_per_s_m2`]); [`BandRadiometry`] keeps it as an offset of magnitude at steps of [`COLOR_STEP`] and looks
//! it up by cubic interpolation: no allocation, and within 1e-5 mag of the integral for bands of a hundred nanometres
//! and more (`the_table_agrees_with_the_integral`).
//!
//! *Limits.* Those of the spectrum; light outside the tables counts for nothing. *Validation:* the tests below;
//! `tests/physics/radiometry.rs` integrates again by other means and against measured colours.

use crate::optics::spectrum::{Cells, Spectrum, SpectrumError};
use crate::optics::star_spectrum::{StarSpectra, StarSpectrum};
use crate::optics::{radiometry::COLOR_RANGE, spectrum::SpectralWeight};
use std::sync::Arc;

/// Step of the colour table, mag of BP-RP.
pub const COLOR_STEP: f64 = 0.05;
/// Number of its entries: more beyond either end of [`COLOR_RANGE`] would not help, because colours are clamped there.
const COLORS: usize = 111;

/// Electrons per photon by wavelength.
#[derive(Debug, Clone)]
pub struct Band {
    transmission: Transmission,
    qe: Spectrum,
    cells: Cells,
}

#[derive(Debug, Clone, PartialEq)]
enum Transmission {
    Flat(f64),
    Table(Spectrum),
}

impl PartialEq for Band {
    fn eq(&self, other: &Self) -> bool {
        self.transmission == other.transmission && self.qe == other.qe
    }
}

impl Band {
    /// Returns a band from two tables of shares.
    ///
    /// # Errors
    /// When the transmission covers wavelengths without QE, or the product is zero everywhere.
    pub fn new(transmission: Spectrum, qe: Spectrum) -> Result<Self, SpectrumError> {
        let ((from_nm, to_nm), (least_nm, most_nm)) = (transmission.range_nm(), qe.range_nm());
        if from_nm < least_nm || to_nm > most_nm {
            return Err(SpectrumError::OutsideQe { from_nm, to_nm, least_nm, most_nm });
        }
        let knots = transmission.knots_nm().chain(qe.knots_nm());
        let cells = Cells::new(from_nm, to_nm, knots);
        Self { transmission: Transmission::Table(transmission), qe, cells }.not_dark()
    }

    /// Returns a band whose optics transmit the same share, 0 to 1, at every wavelength of the QE.
    ///
    /// # Errors
    /// When the product is zero everywhere.
    pub fn with_flat_transmission(transmission: f64, qe: Spectrum) -> Result<Self, SpectrumError> {
        let (from_nm, to_nm) = qe.range_nm();
        let cells = Cells::new(from_nm, to_nm, qe.knots_nm());
        Self { transmission: Transmission::Flat(transmission), qe, cells }.not_dark()
    }

    fn not_dark(self) -> Result<Self, SpectrumError> {
        if self.cells.integral(|nm| self.response(nm)) > 0.0 { Ok(self) } else { Err(SpectrumError::Dark) }
    }

    /// Returns electrons per photon above the optics; 0 outside the tables.
    pub fn response(&self, nm: f64) -> f64 {
        let transmission = match &self.transmission {
            Transmission::Flat(share) => *share,
            Transmission::Table(table) => table.at(nm),
        };
        transmission * self.qe.at(nm)
    }

    /// Returns the first and last wavelength of the tables, nm.
    pub fn range_nm(&self) -> (f64, f64) {
        match &self.transmission {
            Transmission::Flat(_) => self.qe.range_nm(),
            Transmission::Table(table) => table.range_nm(),
        }
    }

    /// Returns the electrons s^-1 m^-2 of a star of G = 0 with this spectrum.
    pub fn e_per_s_m2(&self, star: &StarSpectrum) -> f64 {
        self.cells.integral(|nm| self.response(nm) * star.photons_per_s_m2_nm(nm))
    }

    /// Returns the mean transmission for such a star: its electrons with transmission over those without.
    pub fn mean_transmission(&self, star: &StarSpectrum) -> f64 {
        let bare = self.cells.integral(|nm| self.qe.at(nm) * star.photons_per_s_m2_nm(nm));
        if bare > 0.0 { self.e_per_s_m2(star) / bare } else { 0.0 }
    }

    /// Returns the mean wavelength of the electrons of such a star, nm.
    pub fn mean_wavelength_nm(&self, star: &StarSpectrum) -> f64 {
        let moment = self.cells.integral(|nm| nm * self.response(nm) * star.photons_per_s_m2_nm(nm));
        moment / self.e_per_s_m2(star)
    }

    /// Returns the first and last wavelength at which electrons are made, nm.
    fn support_nm(&self) -> (f64, f64) {
        let (first, last) = self.range_nm();
        let edges = &self.cells.edges_nm;
        let bright = |cell: &&[f64]| self.response(0.5 * (cell[0] + cell[1])) > 0.0;
        (
            edges.windows(2).find(bright).map_or(first, |cell| cell[0]),
            edges.windows(2).rev().find(bright).map_or(last, |cell| cell[1]),
        )
    }
}

/// Returns the band as `n` wavelengths (at least one) for a star of this colour: equal parts of the band, each at the
/// mean wavelength of its electrons and with their share. Shares sum to 1, and the mean wavelength is the band's; parts
/// without electrons are left out.
pub fn spectral_weights(band: &Band, bp_rp: f64, n: usize) -> Vec<SpectralWeight> {
    let star = StarSpectra::new().of_color(bp_rp);
    let (from, to) = band.support_nm();
    let width = (to - from) / n.max(1) as f64;
    let total = band.e_per_s_m2(&star);
    let part = |i: usize| {
        let start = from + width * i as f64;
        let cells = Cells::new(start, start + width, band.cells.edges_nm.iter().copied());
        let electrons = |nm: f64| band.response(nm) * star.photons_per_s_m2_nm(nm);
        let sum = cells.integral(electrons);
        let moment = cells.integral(|nm| nm * electrons(nm));
        (sum > 0.0).then(|| SpectralWeight { wavelength_nm: moment / sum, weight: sum / total })
    };
    (0..n.max(1)).filter_map(part).collect()
}

/// Zero point and colour law of a band behind an aperture, ready for the frame path.
#[derive(Debug, Clone, PartialEq)]
pub struct BandRadiometry {
    zero_point_e_per_s: f64,
    /// Instrument magnitude minus G, at steps of [`COLOR_STEP`].
    offsets_mag: Arc<[f64]>,
}

impl BandRadiometry {
    /// Integrates over the band for every colour of the table, and returns the table.
    pub fn new(band: &Band, clear_aperture_m2: f64) -> Self {
        let spectra = StarSpectra::new();
        let zero = band.e_per_s_m2(&spectra.of_color(0.0));
        let offset = |i: usize| {
            let color = COLOR_RANGE.0 + COLOR_STEP * i as f64;
            -2.5 * (band.e_per_s_m2(&spectra.of_color(color)) / zero).log10()
        };
        Self { zero_point_e_per_s: zero * clear_aperture_m2, offsets_mag: (0..COLORS).map(offset).collect() }
    }

    /// Returns the electrons per second of a star of G = 0 and BP-RP = 0.
    pub fn zero_point_e_per_s(&self) -> f64 {
        self.zero_point_e_per_s
    }

    /// Returns the instrument magnitude: 0 for the zero point's electrons.
    pub fn mag_instrument(&self, mag_g: f64, bp_rp: f64) -> f64 {
        let color = if bp_rp.is_finite() { bp_rp.clamp(COLOR_RANGE.0, COLOR_RANGE.1) } else { 0.0 };
        let at = (color - COLOR_RANGE.0) / COLOR_STEP;
        let first = (at.floor() as usize).saturating_sub(1).min(COLORS - 4);
        let [a, b, c, d] = [0, 1, 2, 3].map(|i| self.offsets_mag[first + i]);
        // Lagrange's cubic through four neighbours, written with the nodes at -1, 0, 1, 2.
        let t = at - first as f64 - 1.0;
        let (u, v, w) = (t + 1.0, t - 1.0, t - 2.0);
        mag_g + -a * t * v * w / 6.0 + b * u * v * w / 2.0 - c * u * t * w / 2.0 + d * u * t * v / 6.0
    }

    /// Returns the electrons a star leaves on the detector during one exposure.
    pub fn electrons(&self, mag_g: f64, bp_rp: f64, exposure_s: f64) -> f64 {
        self.zero_point_e_per_s * exposure_s * 10_f64.powf(-0.4 * self.mag_instrument(mag_g, bp_rp))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn silicon() -> Spectrum {
        Spectrum::share(vec![[350.0, 0.1], [450.0, 0.5], [600.0, 0.65], [800.0, 0.45], [1000.0, 0.08], [1050.0, 0.0]])
            .unwrap()
    }

    fn filter(from: f64, to: f64) -> Spectrum {
        Spectrum::share(vec![[from, 0.8], [to, 0.8]]).unwrap()
    }

    fn bands() -> [Band; 3] {
        [
            Band::with_flat_transmission(0.8, silicon()).unwrap(),
            Band::new(filter(450.0, 550.0), silicon()).unwrap(),
            Band::new(filter(850.0, 950.0), silicon()).unwrap(),
        ]
    }

    #[test]
    fn the_table_agrees_with_the_integral() {
        let spectra = StarSpectra::new();
        for band in bands() {
            let table = BandRadiometry::new(&band, 0.01);
            let mut worst = 0.0_f64;
            for i in 0..=550 {
                let color = -0.5 + 0.01 * f64::from(i) + if i < 550 { 0.003 } else { 0.0 };
                let exact = 0.01 * band.e_per_s_m2(&spectra.of_color(color)) * 10_f64.powf(-0.4 * 5.0);
                worst = worst.max((-2.5 * (table.electrons(5.0, color, 1.0) / exact).log10()).abs());
            }
            assert!(worst < 1e-5, "{worst:e} mag");
            // Control: without its colour term the table would have a far larger error.
            assert!(table.mag_instrument(0.0, 2.0).abs() > 0.02, "{}", table.mag_instrument(0.0, 2.0));
        }
    }

    #[test]
    fn gaias_own_band_has_no_colour_term() {
        let g = crate::optics::star_spectrum::GaiaBand::g();
        let table = BandRadiometry::new(&Band::with_flat_transmission(1.0, g.response.clone()).unwrap(), 1.0);
        for color in [-0.5, 0.0, 0.7, 2.0, 5.0] {
            assert!((table.mag_instrument(8.0, color) - 8.0).abs() < 1e-9, "{color}");
        }
        assert!((table.zero_point_e_per_s() / g.zero_magnitude_e_per_s_m2() - 1.0).abs() < 1e-9);
    }

    #[test]
    fn missing_and_impossible_colours_are_taken_as_they_are_elsewhere() {
        let table = BandRadiometry::new(&bands()[1], 0.01);
        assert!((table.mag_instrument(5.0, f64::NAN) - 5.0).abs() < 1e-9);
        assert_eq!(table.mag_instrument(5.0, 9.0), table.mag_instrument(5.0, COLOR_RANGE.1));
        assert_eq!(table.mag_instrument(5.0, -9.0), table.mag_instrument(5.0, COLOR_RANGE.0));
    }

    #[test]
    fn weights_sum_to_one_and_keep_the_mean_wavelength() {
        for band in bands() {
            for (color, n) in [(0.0, 1), (0.82, 2), (2.0, 7), (-0.3, 16)] {
                let weights = spectral_weights(&band, color, n);
                assert!(weights.len() == n && weights.iter().all(|w| w.weight > 0.0), "{weights:?}");
                let sum: f64 = weights.iter().map(|w| w.weight).sum();
                let mean: f64 = weights.iter().map(|w| w.weight * w.wavelength_nm).sum();
                let star = StarSpectra::new().of_color(color);
                assert!((sum - 1.0).abs() < 1e-9, "{sum}");
                assert!((mean - band.mean_wavelength_nm(&star)).abs() < 1e-6, "{mean}");
            }
        }
    }

    #[test]
    fn red_stars_weigh_the_red_and_parts_without_light_are_left_out() {
        let weights = |color| spectral_weights(&bands()[0], color, 4);
        assert!(weights(2.0)[0].weight < weights(0.0)[0].weight);
        assert!(weights(2.0)[3].weight > weights(0.0)[3].weight);
        let gap = Spectrum::share(vec![
            [400.0, 0.0],
            [500.0, 0.0],
            [510.0, 0.9],
            [520.0, 0.0],
            [780.0, 0.0],
            [790.0, 0.9],
            [800.0, 0.0],
            [900.0, 0.0],
        ]);
        let weights = spectral_weights(&Band::with_flat_transmission(1.0, gap.unwrap()).unwrap(), 0.5, 10);
        assert_eq!(weights.len(), 2, "two of ten parts have light: {weights:?}");
        assert!((weights[0].wavelength_nm - 510.0).abs() < 1.0 && (weights[1].wavelength_nm - 790.0).abs() < 1.0);
    }

    #[test]
    fn transmission_must_lie_where_qe_is_stated_and_something_must_pass() {
        assert!(Band::new(filter(350.0, 1050.0), silicon()).is_ok(), "the edges themselves");
        let refused = |from, to| matches!(Band::new(filter(from, to), silicon()), Err(SpectrumError::OutsideQe { .. }));
        assert!(refused(349.0, 800.0) && refused(400.0, 1051.0));
        assert_eq!(Band::with_flat_transmission(0.0, silicon()), Err(SpectrumError::Dark));
        let dark = Spectrum::share(vec![[400.0, 0.0], [500.0, 0.0]]).unwrap();
        assert_eq!(Band::new(dark, silicon()), Err(SpectrumError::Dark));
    }
}
