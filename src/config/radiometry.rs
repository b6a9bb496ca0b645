//! `[radiometry]` and `[exposure]`.

use crate::config::check::{Checker, Rule};
use crate::config::error::ConfigError;
use serde::Deserialize;

/// Photons per second and square metre of a star of G = 0 in the band of Gaia G, above the optics.
///
/// Gaia EDR3 G on the Vega scale: zero point 3228.75 Jy, effective width 405.3 nm, pivot wavelength 621.8 nm (SVO Filter
/// Profile Service), so `3228.75e-26 / h * 405.3 / 621.8 = 3.18e10`, rounded.
pub(super) const GAIA_G_ZERO_PHOTONS_PER_S_M2: f64 = 3.2e10;

/// How magnitudes become photons, checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Radiometry {
    /// Band-integrated photon rate of a star of G = 0 and BP-RP = 0 above the optics, photons / (s m^2).
    pub zero_magnitude_photons_per_s_m2: f64,
    /// `mag_instrument = G + color_c1 (BP-RP) + color_c2 (BP-RP)^2`.
    pub color_c1: f64,
    /// See [`Self::color_c1`].
    pub color_c2: f64,
    /// Stars fainter than this instrument magnitude are not rendered.
    pub limiting_mag: f64,
}

/// Exposure, checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Exposure {
    /// Integration time, s.
    pub exposure_s: f64,
    /// End of exposure to frame due, s.
    pub readout_s: f64,
    /// Time from one row's exposure to the next, us; 0: all rows together.
    pub rolling_line_us: f64,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RadiometryKeys {
    zero_magnitude_photons_per_s_m2: Option<f64>,
    color_c1: Option<f64>,
    color_c2: Option<f64>,
    limiting_mag: Option<f64>,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct ExposureKeys {
    exposure_s: Option<f64>,
    readout_s: Option<f64>,
    rolling_line_us: Option<f64>,
}

impl Radiometry {
    pub(super) fn check(keys: &RadiometryKeys, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        let mut number = |key: &str, given, default, rule, advice| {
            check.number(&format!("radiometry.{key}"), given, default, rule, advice)
        };
        let color = "magnitudes per magnitude of BP-RP; 0 when the band is that of Gaia G";
        Ok(Self {
            zero_magnitude_photons_per_s_m2: number(
                "zero_magnitude_photons_per_s_m2",
                keys.zero_magnitude_photons_per_s_m2,
                GAIA_G_ZERO_PHOTONS_PER_S_M2,
                Rule::Positive,
                "photons per second and square metre, about 3e10 for silicon",
            )?,
            color_c1: number("color_c1", keys.color_c1, 0.0, Rule::Within(-5.0, 5.0), color)?,
            color_c2: number("color_c2", keys.color_c2, 0.0, Rule::Within(-5.0, 5.0), color)?,
            limiting_mag: number(
                "limiting_mag",
                keys.limiting_mag,
                7.0,
                Rule::Within(-2.0, 25.0),
                "faintest instrument magnitude to render, such as 7.0",
            )?,
        })
    }
}

impl Exposure {
    pub(super) fn check(keys: &ExposureKeys, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        let exposure = "integration time in seconds: 100 ms is 0.1";
        let readout = "seconds from the end of exposure to the frame; 0 for none";
        Ok(Self {
            exposure_s: check.number(
                "exposure.exposure_s",
                keys.exposure_s,
                0.05,
                Rule::PositiveUpTo(3600.0),
                exposure,
            )?,
            rolling_line_us: check.number(
                "exposure.rolling_line_us",
                keys.rolling_line_us,
                0.0,
                Rule::Within(0.0, 1e6),
                "microseconds from one row's exposure to the next, such as 15; 0 for a global shutter",
            )?,
            readout_s: check.number("exposure.readout_s", keys.readout_s, 0.02, Rule::Within(0.0, 3600.0), readout)?,
        })
    }
}
