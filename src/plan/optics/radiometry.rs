//! Magnitude and colour -> electrons per second.
//!
//! `rate = F0 * A * transmission * QE * 10^(-0.4 m)`, with `m = G + c1 (BP-RP) + c2 (BP-RP)^2` the instrument
//! magnitude, `F0` the photon rate of a `G = 0, BP-RP = 0` star above the optics (photons s^-1 m^-2 in the band) and
//! `A` the clear aperture `pi/4 D^2 (1 - e^2)`. Limits: the colour law is a fit; blue and red ends are clamped to
//! [`COLOR_RANGE`]. Source of the form: Pogson's law; Gaia DR3 documentation section 5.4 for the G band.

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
