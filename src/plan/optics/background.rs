//! All light on the detector besides the stars -> electrons per second and pixel, with their shape.
//!
//! `b(u, v) = c + g . (u, v) + q (u^2 + v^2) + sky I(u, v)`: u right, v down, in half diagonals of the image; c from
//! the uniform light of the camera file and from stray light, g and q as shares of it; the sky (given, zodiacal,
//! Galaxy) on the axis, to be multiplied by the relative illumination I. Stray light of bodies: `E_sun PST A_pixel`,
//! with `E_sun` in electrons s^-1 m^-2 on the detector: the photons of a star of the Sun's G and colour above the
//! optics, times quantum efficiency (the transmittance contains the optics' transmission). Non-uniform stray light is
//! brighter on the side of the image on which its source would lie in a wider field. Tests: below;
//! `tests/physics/field_light.rs`.

use crate::optics::baffle::{Baffle, BrightBodies, Glare};
use crate::optics::sky_brightness::{S10_MAG_PER_ARCSEC2, SUN_V_LESS_G, SkyBrightness, pixel_arcsec2};
use glam::{DVec2, DVec3};

/// Light on a camera's detector besides the stars. Off: all zero.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct BackgroundLight {
    /// Constant uniform part, e-/s per pixel, in the middle of the image.
    pub uniform_e_per_s: f64,
    /// Its gradient towards the right and the bottom, share per half diagonal.
    pub gradient: DVec2,
    /// Its increase outwards, share per half diagonal squared.
    pub quadratic: f64,
    /// Sky of uniform brightness, e-/s per pixel on the axis.
    pub sky_e_per_s: f64,
    /// Zodiacal light and Galaxy.
    pub sky: SkyBrightness,
    /// Stray light of Sun, Moon and Earth.
    pub stray: Option<StrayLight>,
}

/// Stray light through a baffle.
#[derive(Debug, Clone, PartialEq)]
pub struct StrayLight {
    /// The baffle.
    pub baffle: Baffle,
    /// Electrons per second and pixel of the Sun at 1 au without optics, [`sun_e_per_s`].
    pub sun_e_per_s: f64,
    /// Gradient towards the source, share per half diagonal.
    pub gradient: f64,
    /// Increase outwards, share per half diagonal squared.
    pub quadratic: f64,
}

/// A frame's background, electrons per second and pixel.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BackgroundRates {
    /// Rate in the middle of the image.
    pub uniform: f64,
    /// Gradient towards the right and the bottom, per half diagonal.
    pub gradient: DVec2,
    /// Increase outwards, per half diagonal squared.
    pub quadratic: f64,
    /// Rate of the sky, on the axis.
    pub sky: f64,
}

impl BackgroundLight {
    /// Returns true when all parts are zero.
    pub fn is_dark(&self) -> bool {
        *self == Self::default()
    }

    /// Returns true when it depends on the positions of Sun, Moon and Earth.
    pub fn needs_bodies(&self) -> bool {
        self.stray.is_some() || self.sky.zodiacal
    }

    /// Returns the part that does not depend on the pointing.
    pub fn constant(&self) -> BackgroundRates {
        let uniform = self.uniform_e_per_s;
        BackgroundRates {
            uniform,
            gradient: self.gradient * uniform,
            quadratic: self.quadratic * uniform,
            sky: self.sky_e_per_s,
        }
    }

    /// Returns the background with the boresight and the Sun in these directions (ICRF axes), and with this stray light
    /// of bodies.
    pub fn rates(&self, boresight_icrf: DVec3, sun_icrf: DVec3, glare: &Glare) -> BackgroundRates {
        let mut rates = self.constant();
        rates.sky += self.sky.e_per_s(boresight_icrf, sun_icrf);
        if let Some(stray) = &self.stray {
            stray.add(glare, &mut rates);
        }
        rates
    }
}

impl StrayLight {
    /// Returns the glare of the bodies.
    pub fn glare(&self, bodies: &BrightBodies) -> Glare {
        self.baffle.glare(bodies)
    }

    fn add(&self, glare: &Glare, rates: &mut BackgroundRates) {
        let uniform = self.sun_e_per_s * glare.share;
        rates.uniform += uniform;
        rates.gradient += self.sun_e_per_s * self.gradient * glare.towards;
        rates.quadratic += self.quadratic * uniform;
    }
}

/// Gaia G of a star of the Sun's colour whose light over a square arcsecond is 1 S10.
pub const S10_MAG_G: f64 = S10_MAG_PER_ARCSEC2 - SUN_V_LESS_G;

/// Returns electrons per second and pixel that the Sun at 1 au would leave on a bare detector behind the band's filter.
///
/// A star of the Sun's magnitude and colour leaves `collected_e_per_s` through an aperture of `effective_m2` (clear
/// area times transmission); a pixel has `pixel_m2`.
pub fn sun_e_per_s(collected_e_per_s: f64, effective_m2: f64, pixel_m2: f64) -> f64 {
    collected_e_per_s / effective_m2 * pixel_m2
}

/// Returns the electrons per second and pixel, on the axis, of a sky whose square arcsecond shines like a star of
/// `star_e_per_s`.
pub fn sky_e_per_s(star_e_per_s: f64, ifov_rad: [f64; 2]) -> f64 {
    star_e_per_s * pixel_arcsec2(ifov_rad)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::Radiometry;
    use crate::optics::baffle::{PointSourceTransmittance, SUN_BP_RP, SUN_MAG_G};
    use base::units::DEG;
    use std::sync::Arc;

    fn radiometry() -> Radiometry {
        Radiometry {
            zero_magnitude_photons_per_s_m2: 3.2e10,
            aperture_mm: 30.0,
            obscuration: 0.3,
            transmission: 0.8,
            quantum_efficiency: 0.5,
            color_c1: 0.0,
            color_c2: 0.0,
        }
    }

    #[test]
    fn sunlight_is_the_solar_constant_in_photons() {
        // 1 m^2 of pixel, 50 % quantum efficiency: half of the photons. The band of Gaia G transmits about 60 % of
        // 330-1050 nm, which is 3/4 of 1361 W/m^2 at 3.0e-19 J: 2e21 photons; the zero point gives 1.85e21.
        let light = radiometry();
        let collected = light.electrons(SUN_MAG_G, SUN_BP_RP, 1.0);
        let photons = sun_e_per_s(collected, light.clear_aperture_m2() * light.transmission, 1.0) / 0.5;
        assert!((photons / (3.2e10 * 10_f64.powf(0.4 * 26.90)) - 1.0).abs() < 1e-12, "{photons:e}");
        let by_energy = 0.6 * 0.75 * 1361.0 / 3.0e-19;
        assert!((photons / by_energy - 1.0).abs() < 0.15, "{photons:e} {by_energy:e}");
    }

    #[test]
    fn sky_is_magnitudes_over_the_pixel() {
        let ifov = [20.0 / 3600.0 * DEG; 2];
        let by_hand = radiometry().zero_point_e_per_s() * 10_f64.powf(-0.4 * 21.0) * 400.0;
        let got = sky_e_per_s(radiometry().electrons(21.0, 0.0, 1.0), ifov);
        assert!((got / by_hand - 1.0).abs() < 1e-12);
        // 100 S10 are 22.78 V, 22.64 G.
        let s10 = sky_e_per_s(radiometry().electrons(S10_MAG_G, SUN_BP_RP, 1.0), ifov) * 100.0;
        let wanted = sky_e_per_s(radiometry().electrons(22.782 - 0.14, 0.0, 1.0), ifov);
        assert!((s10 / wanted - 1.0).abs() < 1e-3, "{s10} {wanted}");
    }

    #[test]
    fn parts_add_with_their_shapes() {
        let rows = [[0.0, 1e-6], [90.0, 1e-6]];
        let baffle = Baffle {
            transmittance: Arc::new(PointSourceTransmittance::new(&rows).expect("a table")),
            shines: [true, false, false],
            exclusion_rad: [0.0; 3],
            earth_albedo: 0.3,
        };
        let stray = StrayLight { baffle, sun_e_per_s: 1e10, gradient: 0.2, quadratic: -0.1 };
        let light = BackgroundLight {
            uniform_e_per_s: 50.0,
            gradient: DVec2::new(0.1, 0.0),
            quadratic: 0.3,
            sky_e_per_s: 7.0,
            sky: SkyBrightness::default(),
            stray: Some(stray),
        };
        let glare = Glare { share: 2e-6, towards: DVec2::new(0.0, 2e-6), excluded: [false; 3] };
        let rates = light.rates(DVec3::Z, DVec3::X, &glare);
        assert!((rates.uniform - 20_050.0).abs() < 1e-9 && rates.sky == 7.0, "{rates:?}");
        assert!(rates.gradient.distance(DVec2::new(5.0, 4000.0)) < 1e-9, "{rates:?}");
        assert!((rates.quadratic - (15.0 - 2000.0)).abs() < 1e-9, "{rates:?}");
        assert!(light.needs_bodies() && !light.is_dark() && BackgroundLight::default().is_dark());
    }
}
