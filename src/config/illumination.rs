//! `[illumination]`: vignetting, the cosine's fourth power, blocked aperture. Without the section the field is even.

use crate::check::{Checker, Rule};
use crate::error::ConfigError;
use crate::optics::Optics;
use plan::optics::Illumination;
use plan::optics::illumination::Vignetting;
use serde::Deserialize;

/// Largest share of the aperture that may be blocked: more leaves no aperture worth the name.
const MOST_BLOCKED: f64 = 0.95;

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub(super) struct IlluminationKeys {
    cos4: bool,
    blocked: f64,
    window_radius_mm: Option<f64>,
    pupil_radius_mm: Option<f64>,
    window_distance_mm: Option<f64>,
}

impl IlluminationKeys {
    pub(super) fn check(&self, optics: &Optics, check: &mut Checker<'_>) -> Result<Illumination, ConfigError> {
        let advice = "share of the aperture that a spider or frame blocks, beside the central obscuration: 3 % is 0.03";
        let blocked = check.meets("illumination.blocked", self.blocked, Rule::Within(0.0, MOST_BLOCKED), advice)?;
        Ok(Illumination { vignetting: self.vignetting(optics, check)?, cos4: self.cos4, unblocked: 1.0 - blocked })
    }

    fn vignetting(&self, optics: &Optics, check: &mut Checker<'_>) -> Result<Option<Vignetting>, ConfigError> {
        let (radius, distance) = ("illumination.window_radius_mm", "illumination.window_distance_mm");
        let (Some(window_radius_mm), Some(distance_mm)) = (self.window_radius_mm, self.window_distance_mm) else {
            let both = "window_radius_mm and window_distance_mm together";
            check.unused(radius, self.window_radius_mm.is_some(), both)?;
            check.unused(distance, self.window_distance_mm.is_some(), both)?;
            check.unused("illumination.pupil_radius_mm", self.pupil_radius_mm.is_some(), both)?;
            return Ok(None);
        };
        let rule = Rule::PositiveUpTo(1e5);
        let window_radius_mm = check.meets(
            radius,
            window_radius_mm,
            rule,
            "radius of the stop that cuts oblique beams, in millimetres",
        )?;
        let distance_mm =
            check.meets(distance, distance_mm, rule, "from that stop to the entrance pupil, along the axis")?;
        let advice = "radius of the entrance pupil; leave it out for half of optics.aperture_mm";
        let half_mm = 0.5 * optics.aperture_mm;
        let pupil_radius_mm =
            check.number("illumination.pupil_radius_mm", self.pupil_radius_mm, half_mm, rule, advice)?;
        Ok(Some(Vignetting { window_radius_mm, pupil_radius_mm, distance_mm }))
    }
}
