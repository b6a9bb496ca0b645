//! What a detector is exposed under in one frame: handed over with each exposure, and not kept.

use crate::detector::background::Background;
use crate::detector::protons::ProtonFlux;

/// The conditions of one exposure.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetectorConditions {
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Light besides that of the image: sky, stray light.
    pub background: Background,
    /// Temperature above that of the parameters, K.
    pub warmer_k: f64,
    /// Protons in place of those of the parameters; a flux that [`ProtonFlux::checked`] refuses is none.
    pub protons: Option<ProtonFlux>,
}

impl DetectorConditions {
    /// An exposure without background, at the temperature and with the protons of the parameters.
    #[must_use]
    pub const fn dark(exposure_s: f64) -> Self {
        Self::lit(exposure_s, Background::DARK)
    }

    /// The same with background light.
    #[must_use]
    pub const fn lit(exposure_s: f64, background: Background) -> Self {
        Self { exposure_s, background, warmer_k: 0.0, protons: None }
    }
}
