//! `[illumination]`: vignetting, the cosine's fourth power, blocked aperture. Without the section the field is even.

use crate::key::{Section, section};
use crate::{check::Checker, error::ConfigError, key_type::Any, optics::Optics};
use plan::optics::{Illumination, illumination::Vignetting};

/// Largest share of the aperture that may be blocked: more leaves no aperture worth the name.
const MOST_BLOCKED: f64 = 0.95;

section! {
    /// How the image plane is lit.
    IlluminationKeys at "illumination" {
        /// Light falls off with the fourth power of the field angle's cosine.
        cos4: bool = Silent(false), Any;
        /// Share of the aperture that a spider or frame blocks, beside the central obscuration: 3 % is 0.03.
        blocked: f64 = Silent(0.0), Within(0.0, MOST_BLOCKED);
        /// Radius of the stop that cuts oblique beams, in millimetres.
        window_radius_mm: f64 = Optional, PositiveUpTo(1e5);
        /// From that stop to the entrance pupil, along the axis.
        window_distance_mm: f64 = Optional, PositiveUpTo(1e5);
        /// Radius of the entrance pupil; leave it out for half of optics.aperture_mm.
        pupil_radius_mm: f64 = Computed("half of optics.aperture_mm"), PositiveUpTo(1e5);
    }
}

impl IlluminationKeys {
    pub(super) fn check(&self, optics: &Optics, check: &mut Checker<'_>) -> Result<Illumination, ConfigError> {
        let blocked = self.blocked().check(check)?;
        let vignetting = self.vignetting(optics, check)?;
        Ok(Illumination { vignetting, cos4: self.cos4().check(check)?, unblocked: 1.0 - blocked })
    }

    fn vignetting(&self, optics: &Optics, check: &mut Checker<'_>) -> Result<Option<Vignetting>, ConfigError> {
        if !(self.window_radius_mm().is_given() && self.window_distance_mm().is_given()) {
            let both = "window_radius_mm and window_distance_mm together";
            self.refuse(&["window_radius_mm", "window_distance_mm", "pupil_radius_mm"], both, check)?;
            return Ok(None);
        }
        let window_radius_mm = self.window_radius_mm().check(check)?;
        let distance_mm = self.window_distance_mm().check(check)?;
        let pupil_radius_mm = self.pupil_radius_mm().or(0.5 * optics.aperture_mm).check(check)?;
        Ok(Some(Vignetting { window_radius_mm, pupil_radius_mm, distance_mm }))
    }
}
