//! `[background]`: light on the whole detector that is not the stars': uniform, or the sky's.

use crate::check::{Checker, Rule};
use crate::error::ConfigError;
use serde::Deserialize;

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

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct BackgroundKeys {
    uniform_e_per_s: f64,
    gradient: [f64; 2],
    quadratic: f64,
    mag_per_arcsec2: Option<f64>,
    sky: Vec<String>,
}

impl BackgroundKeys {
    pub(super) fn check(&self, check: &mut Checker<'_>) -> Result<Background, ConfigError> {
        let advice = "electrons per second and pixel in the middle of the image; 0 turns it off";
        let rule = Rule::Within(0.0, 1e12);
        let uniform_e_per_s = check.meets("background.uniform_e_per_s", self.uniform_e_per_s, rule, advice)?;
        check_shape("background", self.gradient, self.quadratic, check)?;
        if uniform_e_per_s == 0.0 {
            let uniform = "a uniform_e_per_s above 0, of which it is a share";
            check.unused("background.gradient", self.gradient != [0.0; 2], uniform)?;
            check.unused("background.quadratic", self.quadratic != 0.0, uniform)?;
        }
        let (gradient, quadratic) = (self.gradient, self.quadratic);
        Ok(Background { uniform_e_per_s, gradient, quadratic, sky: self.check_sky(check)? })
    }

    fn check_sky(&self, check: &mut Checker<'_>) -> Result<Sky, ConfigError> {
        let key = "background.mag_per_arcsec2";
        if let Some(mag_per_arcsec2) = self.mag_per_arcsec2 {
            let models = "a file without background.sky: the light would count twice";
            check.unused(key, !self.sky.is_empty(), models)?;
            let advice = "instrument magnitudes per square arcsecond: 22 to 23.5 in space";
            let mag_per_arcsec2 = check.meets(key, mag_per_arcsec2, Rule::Within(-10.0, 40.0), advice)?;
            return Ok(Sky::Even { mag_per_arcsec2 });
        }
        let [mut zodiacal, mut galactic] = [false; 2];
        for word in &self.sky {
            match word.as_str() {
                "zodiacal" => zodiacal = true,
                "galactic" => galactic = true,
                other => {
                    let advice = "such as sky = [\"zodiacal\", \"galactic\"]; for one brightness give mag_per_arcsec2";
                    let wanted = "\"zodiacal\" and \"galactic\"";
                    return Err(check.invalid("background.sky", format!("\"{other}\""), wanted, advice));
                }
            }
        }
        Ok(if zodiacal || galactic { Sky::Model { zodiacal, galactic } } else { Sky::Dark })
    }
}

/// Gradient and quadratic term of a non-uniform light, which must not be negative anywhere on the image.
pub(super) fn check_shape(
    section: &str,
    gradient: [f64; 2],
    quadratic: f64,
    check: &Checker<'_>,
) -> Result<(), ConfigError> {
    let share = Rule::Within(-1.0, 1.0);
    let advice = "a share of the uniform part at half a diagonal from the middle, such as 0.2";
    for value in gradient {
        check.meets(&format!("{section}.gradient"), value, share, advice)?;
    }
    check.meets(&format!("{section}.quadratic"), quadratic, share, advice)?;
    let deepest = gradient[0].hypot(gradient[1]) - quadratic.min(0.0);
    if deepest > 1.0 {
        let wanted = "a light that is nowhere below 0: the gradient's length less a negative quadratic at most 1";
        return Err(check.invalid(&format!("{section}.gradient"), deepest, wanted, "make the shape shallower"));
    }
    Ok(())
}
