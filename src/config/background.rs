//! `[background]`: light on the whole detector that is not the stars': uniform, or the sky's.

use crate::key_type::{Numbers, Raw, Shape};
use crate::{check::Checker, error::ConfigError, key::section};

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
    pub(super) fn check(&self, check: &mut Checker<'_>) -> Result<Background, ConfigError> {
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

    fn check_sky(&self, check: &Checker<'_>) -> Result<Sky, ConfigError> {
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
pub(super) fn check_shape(
    section: &str,
    gradient: [f64; 2],
    quadratic: f64,
    check: &Checker<'_>,
) -> Result<(), ConfigError> {
    let deepest = gradient[0].hypot(gradient[1]) - quadratic.min(0.0);
    if deepest > 1.0 {
        let wanted = "a light that is nowhere below 0: the gradient's length less a negative quadratic at most 1";
        return Err(check.invalid(&format!("{section}.gradient"), deepest, wanted, "make the shape shallower"));
    }
    Ok(())
}
