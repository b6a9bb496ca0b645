//! `[baffle]`: stray light of Sun, Moon and Earth. Without the section there is none.

use crate::background::check_shape;
use crate::check::{Checker, Rule};
use crate::error::ConfigError;
use base::units::DEG;
use plan::optics::baffle::{Baffle as Shade, EARTH_ALBEDO, PointSourceTransmittance};
use serde::Deserialize;
use std::sync::Arc;

/// The baffle, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Baffle {
    /// What it lets through, of whom, and where it is not meant to work.
    pub shade: Shade,
    /// Gradient of the light towards its source, share per half diagonal.
    pub gradient: f64,
    /// Its growth outwards, share per half diagonal squared.
    pub quadratic: f64,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct BaffleKeys {
    transmittance: Vec<[f64; 2]>,
    shines: Option<Vec<String>>,
    exclusion_sun_deg: f64,
    exclusion_moon_deg: f64,
    exclusion_earth_deg: f64,
    earth_albedo: Option<f64>,
    gradient: f64,
    quadratic: f64,
}

/// Bodies in the order of `plan::optics::baffle`.
const BODIES: [&str; 3] = ["sun", "moon", "earth"];

impl BaffleKeys {
    pub(super) fn check(&self, check: &mut Checker<'_>) -> Result<Baffle, ConfigError> {
        let key = "baffle.transmittance";
        let advice = "rows of angle off the boresight in degrees and point-source transmittance, such as \
                      [[10, 1e-4], [30, 1e-7], [80, 1e-11]]";
        let table = PointSourceTransmittance::new(&self.transmittance)
            .map_err(|error| check.invalid(key, "refused", error, advice))?;
        let exclusions = [self.exclusion_sun_deg, self.exclusion_moon_deg, self.exclusion_earth_deg];
        let mut exclusion_rad = [0.0; 3];
        for ((body, deg), rad) in BODIES.iter().zip(exclusions).zip(&mut exclusion_rad) {
            let key = format!("baffle.exclusion_{body}_deg");
            let advice = "angle between the boresight and the limb, in degrees; 0 for none";
            *rad = check.meets(&key, deg, Rule::Within(0.0, 180.0), advice)? * DEG;
        }
        check_shape("baffle", [self.gradient, 0.0], self.quadratic, check)?;
        let advice = "share of the sunlight that the Earth sends back: 0.306 on the whole";
        let earth_albedo =
            check.number("baffle.earth_albedo", self.earth_albedo, EARTH_ALBEDO, Rule::Within(0.0, 1.0), advice)?;
        let shade = Shade { transmittance: Arc::new(table), shines: self.shines(check)?, exclusion_rad, earth_albedo };
        Ok(Baffle { shade, gradient: self.gradient, quadratic: self.quadratic })
    }

    fn shines(&self, check: &Checker<'_>) -> Result<[bool; 3], ConfigError> {
        let Some(words) = &self.shines else { return Ok([true; 3]) };
        if let Some(strange) = words.iter().find(|word| !BODIES.contains(&word.as_str())) {
            let wanted = "of \"sun\", \"moon\", \"earth\"";
            let advice = "those whose light is to fall on the detector; leave it out for all three";
            return Err(check.invalid("baffle.shines", format!("\"{strange}\""), wanted, advice));
        }
        Ok(BODIES.map(|body| words.iter().any(|word| word == body)))
    }
}
