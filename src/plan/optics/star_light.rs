//! The radiometry selected by a camera: magnitude and colour -> electrons of one exposure.
//!
//! | model | electrons from |
//! |---|---|
//! | [`StarLight::Parametric`] | zero-magnitude photons, mean transmission and QE, colour law in BP-RP; magnitudes in G |
//! | [`StarLight::ParametricV`] | the same, with Johnson V (from G and BP-RP) as the magnitude |
//! | [`StarLight::Band`] | transmission(lambda) x QE(lambda), integrated over the star's spectrum |
//! | [`StarLight::Grey`] | a linear grey mapping, independent of exposure and aperture |
//!
//! Nothing but this value is stored; on the frame path a star costs one `powf` and at most one look-up.
//!
//! *Linear grey mapping.* Magnitude -> grey between the brightest and the faintest star, and back to electrons.
//!
//! Image simulators without a radiometric chain define greys this way: the brightest star of the scene gets one grey,
//! the faintest another, those between follow linearly in irradiance `E = 10^(-0.4 m)`, `g = g_f + (g_b - g_f) (E -
//! E_f) / (E_b - E_f)`, or in magnitude, `g = g_f + (g_b - g_f) (m_f - m) / (m_f - m_b)`. `g` is the sum of the star's
//! grey above black, spread by the PSF as for other models; times the gain it gives electrons, so noise, saturation and
//! the rest of the chain stay the same.
//!
//! *Its limits.* Not physics: electrons do not depend on exposure, aperture or colour, and flux ratios are kept only in
//! irradiance with `g_f / g_b = E_f / E_b`. Stars outside the two magnitudes get the grey of the nearer one.

use crate::optics::band::BandRadiometry;
use crate::optics::radiometry::{Radiometry, mag_v};
use base::bisection::bisected;

/// Brightest and faintest G between which a star of given electrons is searched.
const MAG_RANGE: (f64, f64) = (-30.0, 40.0);
/// Number of halvings of that range: to 1e-13 mag.
const HALVINGS: u32 = 50;

/// Magnitude to electrons.
#[derive(Debug, Clone, PartialEq)]
pub enum StarLight {
    /// A few parameters; magnitudes in Gaia G.
    Parametric(Radiometry),
    /// A few parameters; magnitudes in Johnson V.
    ParametricV(Radiometry),
    /// An instrument band.
    Band(BandRadiometry),
    /// Linear grey mapping.
    Grey(GreyMap),
}

impl From<Radiometry> for StarLight {
    fn from(radiometry: Radiometry) -> Self {
        Self::Parametric(radiometry)
    }
}

impl StarLight {
    /// Returns the electrons a star of this G and BP-RP leaves on the detector during one exposure.
    pub fn electrons(&self, mag_g: f64, bp_rp: f64, exposure_s: f64) -> f64 {
        match self {
            Self::Parametric(radiometry) => radiometry.electrons(mag_g, bp_rp, exposure_s),
            Self::ParametricV(radiometry) => radiometry.electrons(mag_v(mag_g, bp_rp), bp_rp, exposure_s),
            Self::Band(band) => band.electrons(mag_g, bp_rp, exposure_s),
            Self::Grey(map) => map.electrons(mag_g),
        }
    }

    /// Returns the instrument magnitude: 0 for the zero point's electrons; G itself under a grey mapping.
    pub fn mag_instrument(&self, mag_g: f64, bp_rp: f64) -> f64 {
        match self {
            Self::Parametric(radiometry) => radiometry.mag_instrument(mag_g, bp_rp),
            Self::ParametricV(radiometry) => radiometry.mag_instrument(mag_v(mag_g, bp_rp), bp_rp),
            Self::Band(band) => band.mag_instrument(mag_g, bp_rp),
            Self::Grey(_) => mag_g,
        }
    }

    /// Returns the electrons per second of a star of instrument magnitude 0; `None` when electrons do not follow the
    /// exposure.
    pub fn zero_point_e_per_s(&self) -> Option<f64> {
        match self {
            Self::Parametric(radiometry) | Self::ParametricV(radiometry) => Some(radiometry.zero_point_e_per_s()),
            Self::Band(band) => Some(band.zero_point_e_per_s()),
            Self::Grey(_) => None,
        }
    }

    /// Returns the G magnitude of the star of this colour with this many electrons; `None` if there is none.
    pub fn mag_g_of_electrons(&self, electrons: f64, bp_rp: f64, exposure_s: f64) -> Option<f64> {
        let of = |mag_g: f64| self.electrons(mag_g, bp_rp, exposure_s);
        let (bright, faint) = MAG_RANGE;
        if !(of(faint)..=of(bright)).contains(&electrons) {
            return None;
        }
        Some(bisected([bright, faint], HALVINGS, |mag_g| of(mag_g) >= electrons))
    }
}

/// Returns the electrons per second and pixel of a sky of this surface brightness (instrument magnitudes per square
/// arcsecond), with pixels of `ifov_arcsec` squared: `zero_point 10^(-0.4 mu) ifov^2`.
pub fn surface_brightness_e_per_s_px(zero_point_e_per_s: f64, mag_per_arcsec2: f64, ifov_arcsec: f64) -> f64 {
    zero_point_e_per_s * 10_f64.powf(-0.4 * mag_per_arcsec2) * ifov_arcsec * ifov_arcsec
}

/// Quantity in which the grey is linear.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum GreyScale {
    /// Irradiance.
    Irradiance,
    /// Magnitude.
    Magnitude,
}

/// The mapping.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GreyMap {
    /// Magnitude of the brightest star.
    pub brightest_mag: f64,
    /// Magnitude of the faintest star, above [`Self::brightest_mag`].
    pub faintest_mag: f64,
    /// Sum of the brightest star's grey above black, DN.
    pub brightest_grey_dn: f64,
    /// Sum of the faintest star's grey above black, DN.
    pub faintest_grey_dn: f64,
    /// Quantity in which the grey is linear.
    pub scale: GreyScale,
    /// Electrons per DN.
    pub gain_e_per_dn: f64,
}

impl GreyMap {
    /// Returns the sum of a star's grey above black, DN.
    pub fn grey_dn(&self, mag: f64) -> f64 {
        let (bright, faint) = (self.brightest_mag, self.faintest_mag);
        let mag = mag.clamp(bright, faint);
        let share = match self.scale {
            GreyScale::Magnitude => (faint - mag) / (faint - bright),
            GreyScale::Irradiance => {
                let [least, most, irradiance] = [faint, bright, mag].map(|m| 10_f64.powf(-0.4 * (m - bright)));
                (irradiance - least) / (most - least)
            }
        };
        self.faintest_grey_dn + (self.brightest_grey_dn - self.faintest_grey_dn) * share
    }

    /// Returns the electrons of a star in any exposure.
    pub fn electrons(&self, mag: f64) -> f64 {
        self.gain_e_per_dn * self.grey_dn(mag)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::star_light::GreyScale;

    fn plain() -> Radiometry {
        Radiometry {
            zero_magnitude_photons_per_s_m2: 3.2e10,
            aperture_mm: 50.0,
            obscuration: 0.0,
            transmission: 0.8,
            quantum_efficiency: 0.5,
            color_c1: 0.1,
            color_c2: 0.0,
        }
    }

    #[test]
    fn magnitudes_are_found_again_from_electrons() {
        for light in [StarLight::Parametric(plain()), StarLight::ParametricV(plain())] {
            for (mag, color) in [(-1.0, 0.0), (6.5, 1.2), (22.0, 3.0)] {
                let found = light.mag_g_of_electrons(light.electrons(mag, color, 0.3), color, 0.3).unwrap();
                assert!((found - mag).abs() < 1e-10, "{found}");
            }
        }
        let grey = StarLight::Grey(GreyMap {
            brightest_mag: 1.0,
            faintest_mag: 7.0,
            brightest_grey_dn: 1000.0,
            faintest_grey_dn: 10.0,
            scale: GreyScale::Magnitude,
            gain_e_per_dn: 2.0,
        });
        assert!((grey.mag_g_of_electrons(1010.0, 0.0, 0.1).unwrap() - 4.0).abs() < 1e-10);
        assert_eq!(grey.mag_g_of_electrons(19.0, 0.0, 0.1), None, "below the faintest grey");
        assert_eq!(grey.mag_g_of_electrons(2001.0, 0.0, 0.1), None, "above the brightest grey");
    }

    #[test]
    fn a_zero_point_in_v_counts_red_stars_as_fainter() {
        let (g, v) = (StarLight::Parametric(plain()), StarLight::ParametricV(plain()));
        let ratio = v.electrons(6.0, 1.5, 0.1) / g.electrons(6.0, 1.5, 0.1);
        let by_hand = 10_f64.powf(0.4 * (-0.02704 + 0.01424 * 1.5 - 0.2156 * 2.25 + 0.01426 * 3.375));
        assert!((ratio / by_hand - 1.0).abs() < 1e-12, "{ratio}");
    }

    #[test]
    fn a_sky_of_one_magnitude_is_a_star_spread_over_its_area() {
        let one = surface_brightness_e_per_s_px(1e9, 22.0, 1.0);
        assert!((one / (1e9 * 10_f64.powf(-8.8)) - 1.0).abs() < 1e-14, "one arcsec square");
        assert!((surface_brightness_e_per_s_px(1e9, 22.0, 3.0) / one - 9.0).abs() < 1e-12);
    }
}

#[cfg(test)]
mod grey_map_tests {
    use super::*;

    fn map(scale: GreyScale) -> GreyMap {
        GreyMap {
            brightest_mag: 2.0,
            faintest_mag: 7.0,
            brightest_grey_dn: 4000.0,
            faintest_grey_dn: 40.0,
            scale,
            gain_e_per_dn: 8.0,
        }
    }

    #[test]
    fn the_ends_have_their_greys_and_beyond_them_nothing_changes() {
        for scale in [GreyScale::Irradiance, GreyScale::Magnitude] {
            for (mag, grey) in [(2.0, 4000.0), (7.0, 40.0), (1.0, 4000.0), (9.0, 40.0)] {
                assert!((map(scale).grey_dn(mag) - grey).abs() < 1e-9, "{scale:?} {mag}");
            }
            assert!((map(scale).electrons(2.0) - 32_000.0).abs() < 1e-6);
        }
    }

    #[test]
    fn between_them_irradiance_or_magnitude_is_linear() {
        assert!((map(GreyScale::Magnitude).grey_dn(4.5) - 2020.0).abs() < 1e-9, "half way");
        // Greys in the ratio of the irradiances (100) follow Pogson's law at all magnitudes.
        let pogson = 4000.0 * 10_f64.powf(-0.4 * 2.5);
        assert!((map(GreyScale::Irradiance).grey_dn(4.5) - pogson).abs() < 1e-9);
        assert!((map(GreyScale::Magnitude).grey_dn(4.5) - pogson).abs() > 1000.0, "the two differ");
    }
}
