//! Magnitude and colour -> electrons per second.
//!
//! `rate = F0 * A * transmission * QE * 10^(-0.4 m)`, with `m = G + c1 (BP-RP) + c2 (BP-RP)^2` the instrument
//! magnitude, `F0` the photon rate of a `G = 0, BP-RP = 0` star above the optics (photons s^-1 m^-2 in the band) and
//! `A` the clear aperture `pi/4 D^2 (1 - e^2)`. Limits: the colour law is a fit; blue and red ends are clamped to
//! [`COLOR_RANGE`]. Source of the form: Pogson's law; Gaia DR3 documentation section 5.4 for the G band.
//!
//! *V.* Johnson V of a star from Gaia's G and BP-RP, for data sheets and users of V.
//!
//! `G - V` is a polynomial of BP-RP: Gaia DR3 documentation, section 5.5.1, table 5.9 (Johnson-Cousins; Riello et al.
//! 2021, A&A 649, A3, appendix C). Valid for -0.5 < BP-RP < 5 (clamped), scatter of the stars about it 0.030 mag.

use core::f64::consts::PI;

/// Colours outside this range are clamped before the colour law (Gaia DR3 documentation section 5.5.1).
pub const COLOR_RANGE: (f64, f64) = (-0.5, 5.0);

/// Radiometric chain of one camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Radiometry {
    /// Photons s^-1 m^-2 of a `G = 0, BP-RP = 0` star in the band, above the optics.
    pub zero_magnitude_photons_per_s_m2: f64,
    /// Aperture diameter, mm.
    pub aperture_mm: f64,
    /// Linear central obscuration, `0 <= e < 1`.
    pub obscuration: f64,
    /// Optical transmission, 0 to 1.
    pub transmission: f64,
    /// Mean quantum efficiency in the band, electrons per photon.
    pub quantum_efficiency: f64,
    /// Colour law: coefficient of `BP-RP`, mag per mag.
    pub color_c1: f64,
    /// Colour law: coefficient of `(BP-RP)^2`.
    pub color_c2: f64,
}

impl Radiometry {
    /// Returns the clear aperture, m^2.
    pub fn clear_aperture_m2(&self) -> f64 {
        let diameter_m = self.aperture_mm * 1e-3;
        PI / 4.0 * diameter_m * diameter_m * (1.0 - self.obscuration * self.obscuration)
    }

    /// Returns the electrons per second of a star of instrument magnitude 0.
    pub fn zero_point_e_per_s(&self) -> f64 {
        self.zero_magnitude_photons_per_s_m2 * self.clear_aperture_m2() * self.transmission * self.quantum_efficiency
    }

    /// Returns the instrument magnitude.
    pub fn mag_instrument(&self, mag_g: f64, bp_rp: f64) -> f64 {
        let color = if bp_rp.is_finite() { bp_rp.clamp(COLOR_RANGE.0, COLOR_RANGE.1) } else { 0.0 };
        mag_g + self.color_c1 * color + self.color_c2 * color * color
    }

    /// Returns the electrons a star leaves on the detector during one exposure.
    pub fn electrons(&self, mag_g: f64, bp_rp: f64, exposure_s: f64) -> f64 {
        self.zero_point_e_per_s() * exposure_s * 10_f64.powf(-0.4 * self.mag_instrument(mag_g, bp_rp))
    }
}

/// Coefficients of 1, x, x^2, x^3 with x = BP-RP.
const G_MINUS_V: [f64; 4] = [-0.02704, 0.01424, -0.2156, 0.01426];

/// Returns `G - V` of a star of this colour; a missing colour is taken as 0.
pub fn g_minus_v(bp_rp: f64) -> f64 {
    let x = if bp_rp.is_finite() { bp_rp.clamp(COLOR_RANGE.0, COLOR_RANGE.1) } else { 0.0 };
    let [c0, c1, c2, c3] = G_MINUS_V;
    c0 + x * (c1 + x * (c2 + x * c3))
}

/// Returns the V magnitude of a star.
pub fn mag_v(mag_g: f64, bp_rp: f64) -> f64 {
    mag_g - g_minus_v(bp_rp)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plain() -> Radiometry {
        Radiometry {
            zero_magnitude_photons_per_s_m2: 4e10,
            aperture_mm: 100.0,
            obscuration: 0.5,
            transmission: 0.8,
            quantum_efficiency: 0.5,
            color_c1: 0.1,
            color_c2: 0.0,
        }
    }

    #[test]
    fn five_magnitudes_are_a_factor_of_one_hundred() {
        let ratio = plain().electrons(1.0, 0.0, 0.1) / plain().electrons(6.0, 0.0, 0.1);
        assert!((ratio - 100.0).abs() < 1e-10, "{ratio}");
    }

    #[test]
    fn the_zero_point_is_the_product_of_the_chain() {
        // pi/4 * 0.01 m^2 * 0.75 * 4e10 * 0.8 * 0.5
        let by_hand = core::f64::consts::FRAC_PI_4 * 0.01 * 0.75 * 4e10 * 0.8 * 0.5;
        assert!((plain().zero_point_e_per_s() / by_hand - 1.0).abs() < 1e-14, "{}", plain().zero_point_e_per_s());
    }

    #[test]
    fn colours_are_clamped_and_missing_ones_are_neutral() {
        assert_eq!(plain().mag_instrument(5.0, 9.0), 5.0 + 0.1 * COLOR_RANGE.1);
        assert_eq!(plain().mag_instrument(5.0, f64::NAN), 5.0);
    }
}

#[cfg(test)]
mod photometry_v_tests {
    use super::*;

    #[test]
    fn the_sun_has_its_published_v() {
        // Sun: V = -26.76, G = -26.90, BP-RP = 0.82 (Willmer 2018; Casagrande and VandenBerg 2018).
        assert!((mag_v(-26.90, 0.82) + 26.76).abs() < 0.03, "{}", mag_v(-26.90, 0.82));
    }

    #[test]
    fn colours_are_clamped_and_missing_ones_neutral() {
        assert_eq!(g_minus_v(f64::NAN), G_MINUS_V[0]);
        assert_eq!(g_minus_v(7.0), g_minus_v(5.0));
        assert!((g_minus_v(1.0) - (-0.02704 + 0.01424 - 0.2156 + 0.01426)).abs() < 1e-15);
    }
}
