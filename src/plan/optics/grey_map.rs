//! Linear grey mapping: magnitude -> grey between the brightest and the faintest star, and back to electrons.
//!
//! Image simulators without a radiometric chain define greys this way: the brightest star of the scene gets one grey,
//! the faintest another, those between follow linearly in irradiance `E = 10^(-0.4 m)`, `g = g_f + (g_b - g_f) (E -
//! E_f) / (E_b - E_f)`, or in magnitude, `g = g_f + (g_b - g_f) (m_f - m) / (m_f - m_b)`. `g` is the sum of the star's
//! grey above black, spread by the PSF as for other models; times the gain it gives electrons, so noise, saturation and
//! the rest of the chain stay the same.
//!
//! *Limits.* Not physics: electrons do not depend on exposure, aperture or colour, and flux ratios are kept only in
//! irradiance with `g_f / g_b = E_f / E_b`. Stars outside the two magnitudes get the grey of the nearer one.

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
