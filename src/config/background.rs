//! `[background]`: light on the whole detector that is not the stars': uniform, or the sky's.
//!
//! `[baffle]`: stray light of Sun, Moon and Earth. Without the section there is none.

use crate::key_type::{Numbers, Raw, Shape};
use crate::{check::Checker, error::Result, key::section};
use base::units::DEG;
use plan::optics::baffle::{Baffle as Shade, EARTH_ALBEDO, PointSourceTransmittance};
use std::sync::Arc;

/// The background, checked. All zero without the section.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Background {
    /// Uniform part, in the middle of the image, e-/s per pixel.
    pub uniform_e_per_s: f64,
    /// Its gradient towards the right and the bottom, share per half diagonal.
    pub gradient: [f64; 2],
    /// Its growth outwards, share per half diagonal squared.
    pub quadratic: f64,
    /// The sky's.
    pub sky: Sky,
}

/// Surface brightness of the sky.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Sky {
    /// Dark.
    #[default]
    Dark,
    /// The same everywhere, instrument magnitudes per square arcsecond.
    Even {
        /// Surface brightness.
        mag_per_arcsec2: f64,
    },
    /// By direction.
    Model {
        /// Zodiacal light.
        zodiacal: bool,
        /// The Galaxy.
        galactic: bool,
    },
}

section! {
    /// Light on the whole detector that is not the stars'.
    BackgroundKeys at "background" {
        /// Electrons per second and pixel in the middle of the image; 0 turns it off.
        uniform_e_per_s: f64 = Silent(0.0), Within(0.0, 1e12);
        /// Its gradient towards the right and the bottom, a share of the uniform part at half a diagonal, such as 0.2.
        gradient: [f64; 2] = Silent(Numbers([0.0; 2])), Within(-1.0, 1.0);
        /// Its growth outwards, a share of the uniform part at half a diagonal from the middle, such as 0.2.
        quadratic: f64 = Silent(0.0), Within(-1.0, 1.0);
        /// The same brightness everywhere, instrument magnitudes per square arcsecond: 22 to 23.5 in space.
        mag_per_arcsec2: f64 = Optional, Within(-10.0, 40.0);
        /// Models of the sky's light by direction.
        sky: Raw<Vec<String>> = Optional, Shape::list(Shape::Words(vec!["zodiacal", "galactic"])),
            "such as sky = [\"zodiacal\", \"galactic\"]; for one brightness give mag_per_arcsec2";
    }
}

impl BackgroundKeys {
    pub(super) fn check(&self, check: &mut Checker<'_>) -> Result<Background> {
        let uniform_e_per_s = self.uniform_e_per_s().check(check)?;
        let (gradient, quadratic) = (self.gradient().check(check)?, self.quadratic().check(check)?);
        check_shape("background", gradient, quadratic, check)?;
        if uniform_e_per_s == 0.0 {
            let uniform = "a uniform_e_per_s above 0: the gradient is a share of it";
            check.unused("background.gradient", gradient != [0.0; 2], uniform)?;
            check.unused("background.quadratic", quadratic != 0.0, uniform)?;
        }
        Ok(Background { uniform_e_per_s, gradient, quadratic, sky: self.check_sky(check)? })
    }

    fn check_sky(&self, check: &Checker<'_>) -> Result<Sky> {
        let words = self.sky().raw().map_or(&[][..], Vec::as_slice);
        let even = self.mag_per_arcsec2();
        if even.is_given() {
            check.unused(
                &even.key(),
                !words.is_empty(),
                "a file without background.sky: the light would count twice",
            )?;
        }
        if let Some(mag_per_arcsec2) = even.optional(check)? {
            return Ok(Sky::Even { mag_per_arcsec2 });
        }
        let [mut zodiacal, mut galactic] = [false; 2];
        for word in words {
            match word.as_str() {
                "zodiacal" => zodiacal = true,
                "galactic" => galactic = true,
                other => {
                    return Err(self.sky().invalid(format!("\"{other}\""), "\"zodiacal\" and \"galactic\"", check));
                }
            }
        }
        Ok(if zodiacal || galactic { Sky::Model { zodiacal, galactic } } else { Sky::Dark })
    }
}

/// Checks the shape of a non-uniform light, which must not be negative anywhere on the image.
pub(super) fn check_shape(section: &str, gradient: [f64; 2], quadratic: f64, check: &Checker<'_>) -> Result<()> {
    let deepest = gradient[0].hypot(gradient[1]) - quadratic.min(0.0);
    if deepest > 1.0 {
        let wanted = "a light that is nowhere below 0: the gradient's length less a negative quadratic at most 1";
        return Err(check.invalid(&format!("{section}.gradient"), deepest, wanted, "make the shape shallower"));
    }
    Ok(())
}

/// The baffle, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Baffle {
    /// Transmittance by angle, the bodies it applies to, and the exclusion angle of each.
    pub shade: Shade,
    /// Gradient of the light towards its source, share per half diagonal.
    pub gradient: f64,
    /// Its growth outwards, share per half diagonal squared.
    pub quadratic: f64,
}

section! {
    /// Stray light of Sun, Moon and Earth.
    BaffleKeys at "baffle" {
        /// Rows of angle off the boresight in degrees and transmittance, such as [[10, 1e-4], [30, 1e-7], [80, 1e-11]].
        transmittance: Raw<Vec<[f64; 2]>> = Needed, Shape::pairs();
        /// Those whose light is to fall on the detector; leave it out for all three.
        shines: Raw<Vec<String>> = Optional, Shape::list(Shape::Words(BODIES.into()));
        /// Angle from the boresight to the Sun below which the camera is not meant to work; 0 for none.
        exclusion_sun_deg: f64 = Silent(0.0), Within(0.0, 180.0);
        /// Angle from the boresight to the Moon's limb below which the camera is not meant to work; 0 for none.
        exclusion_moon_deg: f64 = Silent(0.0), Within(0.0, 180.0);
        /// Angle from the boresight to the Earth's limb below which the camera is not meant to work; 0 for none.
        exclusion_earth_deg: f64 = Silent(0.0), Within(0.0, 180.0);
        /// Share of the sunlight that the Earth sends back: 0.306 on the whole.
        earth_albedo: f64 = EARTH_ALBEDO, Within(0.0, 1.0);
        /// Gradient of the light towards its source, a share of the uniform part at half a diagonal, such as 0.2.
        gradient: f64 = Silent(0.0), Within(-1.0, 1.0);
        /// Its growth outwards, a share of the uniform part at half a diagonal from the middle, such as 0.2.
        quadratic: f64 = Silent(0.0), Within(-1.0, 1.0);
    }
}

/// Bodies in the order of `plan::optics::baffle`.
const BODIES: [&str; 3] = ["sun", "moon", "earth"];

impl BaffleKeys {
    pub(super) fn check(&self, check: &mut Checker<'_>) -> Result<Baffle> {
        let transmittance = self.transmittance();
        let rows = transmittance.raw().map_or(&[][..], Vec::as_slice);
        let table =
            PointSourceTransmittance::new(rows).map_err(|error| transmittance.invalid("refused", error, check))?;
        let exclusion_rad = [
            self.exclusion_sun_deg().check(check)? * DEG,
            self.exclusion_moon_deg().check(check)? * DEG,
            self.exclusion_earth_deg().check(check)? * DEG,
        ];
        let (gradient, quadratic) = (self.gradient().check(check)?, self.quadratic().check(check)?);
        check_shape("baffle", [gradient, 0.0], quadratic, check)?;
        let earth_albedo = self.earth_albedo().check(check)?;
        let shade =
            Shade { transmittance: Arc::new(table), shines: self.check_shines(check)?, exclusion_rad, earth_albedo };
        Ok(Baffle { shade, gradient, quadratic })
    }

    fn check_shines(&self, check: &Checker<'_>) -> Result<[bool; 3]> {
        let Some(words) = self.shines().raw() else { return Ok([true; 3]) };
        if let Some(strange) = words.iter().find(|word| !BODIES.contains(&word.as_str())) {
            return Err(self.shines().invalid(format!("\"{strange}\""), "of \"sun\", \"moon\", \"earth\"", check));
        }
        Ok(BODIES.map(|body| words.iter().any(|word| word == body)))
    }
}
