//! `[baffle]`: stray light of Sun, Moon and Earth. Without the section there is none.

use crate::key_type::{Raw, Shape};
use crate::{background::check_shape, check::Checker, error::ConfigError, key::section};
use base::units::DEG;
use plan::optics::baffle::{Baffle as Shade, EARTH_ALBEDO, PointSourceTransmittance};
use std::sync::Arc;

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
    pub(super) fn check(&self, check: &mut Checker<'_>) -> Result<Baffle, ConfigError> {
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

    fn check_shines(&self, check: &Checker<'_>) -> Result<[bool; 3], ConfigError> {
        let Some(words) = self.shines().raw() else { return Ok([true; 3]) };
        if let Some(strange) = words.iter().find(|word| !BODIES.contains(&word.as_str())) {
            return Err(self.shines().invalid(format!("\"{strange}\""), "of \"sun\", \"moon\", \"earth\"", check));
        }
        Ok(BODIES.map(|body| words.iter().any(|word| word == body)))
    }
}
