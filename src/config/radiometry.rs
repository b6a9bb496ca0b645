//! `[radiometry]` and `[exposure]`.

use crate::check::{Checker, Rule};
use crate::detector::Detector;
use crate::error::ConfigError;
use plan::optics::{GreyMap, GreyScale};
use serde::Deserialize;

/// Photons per second and square metre of a star of G = 0 in the band of Gaia G, above the optics.
///
/// Gaia EDR3 G on the Vega scale: zero point 3228.75 Jy, effective width 405.3 nm, pivot wavelength 621.8 nm (SVO Filter
/// Profile Service), so `3228.75e-26 / h * 405.3 / 621.8 = 3.18e10`, rounded.
pub(super) const GAIA_G_ZERO_PHOTONS_PER_S_M2: f64 = 3.2e10;

/// Where electrons come from when there is no `[band]`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum RadiometryModel {
    /// Photons of magnitude 0 in Gaia G, mean transmission and QE.
    PhotonsG,
    /// The same, with magnitudes in Johnson V.
    PhotonsV,
    /// A linear grey mapping.
    LinearGrey(GreyMap),
}

/// How magnitudes become photons, checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Radiometry {
    /// Where electrons come from.
    pub model: RadiometryModel,
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
    model: Option<String>,
    brightest_mag: Option<f64>,
    faintest_mag: Option<f64>,
    brightest_grey_dn: Option<f64>,
    faintest_grey_dn: Option<f64>,
    grey_scale: Option<String>,
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

#[derive(Clone, Copy, PartialEq)]
enum Model {
    PhotonsG,
    PhotonsV,
    LinearGrey,
}

impl Radiometry {
    pub(super) fn check(
        keys: &RadiometryKeys,
        detector: &Detector,
        check: &mut Checker<'_>,
    ) -> Result<Self, ConfigError> {
        let models = [("photons", Model::PhotonsG), ("photons_v", Model::PhotonsV), ("linear_grey", Model::LinearGrey)];
        let advice = "photons take zero_magnitude_photons_per_s_m2 (of G = 0; photons_v: of V = 0), color_c1, color_c2; \
                      linear_grey takes two magnitudes and their greys";
        let word = keys.model.as_deref().unwrap_or(models[0].0);
        let model = check.choice("radiometry.model", Some(word), &models, advice)?;
        let mut number = |key: &str, given, default, rule, advice| {
            check.number(&format!("radiometry.{key}"), given, default, rule, advice)
        };
        let limiting = "faintest G magnitude to render, such as 7.0";
        let limiting_mag = number("limiting_mag", keys.limiting_mag, 7.0, Rule::Within(-2.0, 25.0), limiting)?;
        if model == Model::LinearGrey {
            let model = RadiometryModel::LinearGrey(keys.grey_map(limiting_mag, detector, check)?);
            let zero_magnitude_photons_per_s_m2 = GAIA_G_ZERO_PHOTONS_PER_S_M2;
            return Ok(Self { model, zero_magnitude_photons_per_s_m2, color_c1: 0.0, color_c2: 0.0, limiting_mag });
        }
        let color = "magnitudes per magnitude of BP-RP; 0 when the band is that of the magnitude";
        let zero_magnitude_photons_per_s_m2 = number(
            "zero_magnitude_photons_per_s_m2",
            keys.zero_magnitude_photons_per_s_m2,
            GAIA_G_ZERO_PHOTONS_PER_S_M2,
            Rule::Positive,
            "photons per second and square metre, about 3e10 for silicon",
        )?;
        let color_c1 = number("color_c1", keys.color_c1, 0.0, Rule::Within(-5.0, 5.0), color)?;
        let color_c2 = number("color_c2", keys.color_c2, 0.0, Rule::Within(-5.0, 5.0), color)?;
        keys.no_grey(check)?;
        let model = if model == Model::PhotonsV { RadiometryModel::PhotonsV } else { RadiometryModel::PhotonsG };
        Ok(Self { model, zero_magnitude_photons_per_s_m2, color_c1, color_c2, limiting_mag })
    }
}

impl RadiometryKeys {
    /// Refuses the keys of the grey mapping where there is none.
    fn no_grey(&self, check: &Checker<'_>) -> Result<(), ConfigError> {
        for (key, is_given) in [
            ("brightest_mag", self.brightest_mag.is_some()),
            ("faintest_mag", self.faintest_mag.is_some()),
            ("brightest_grey_dn", self.brightest_grey_dn.is_some()),
            ("faintest_grey_dn", self.faintest_grey_dn.is_some()),
            ("grey_scale", self.grey_scale.is_some()),
        ] {
            check.unused(&format!("radiometry.{key}"), is_given, "model = \"linear_grey\"")?;
        }
        Ok(())
    }

    fn grey_map(
        &self,
        limiting_mag: f64,
        detector: &Detector,
        check: &mut Checker<'_>,
    ) -> Result<GreyMap, ConfigError> {
        for (key, is_given) in [
            ("zero_magnitude_photons_per_s_m2", self.zero_magnitude_photons_per_s_m2.is_some()),
            ("color_c1", self.color_c1.is_some()),
            ("color_c2", self.color_c2.is_some()),
        ] {
            check.unused(&format!("radiometry.{key}"), is_given, "model = \"photons\" or \"photons_v\"")?;
        }
        let scales = [("irradiance", GreyScale::Irradiance), ("magnitude", GreyScale::Magnitude)];
        let linear_in = "what the grey is linear in; irradiance keeps the stars' ratios";
        let scale = check.choice("radiometry.grey_scale", self.grey_scale.as_deref(), &scales, linear_in)?;
        let mut number = |key: &str, given, default, rule, advice| {
            check.number(&format!("radiometry.{key}"), given, default, rule, advice)
        };
        let mags = Rule::Within(-30.0, 30.0);
        let brightest_mag =
            number("brightest_mag", self.brightest_mag, -1.5, mags, "G of the star that gets brightest_grey_dn")?;
        let faint = "G of the star that gets faintest_grey_dn, fainter than brightest_mag";
        let faintest_mag = number("faintest_mag", self.faintest_mag, limiting_mag, mags, faint)?;
        let range_dn = f64::from(detector.largest_dn()) - detector.black_level_dn;
        let grey = "sum of the star's grey above the black level, DN";
        let brightest_grey_dn = number("brightest_grey_dn", self.brightest_grey_dn, range_dn, Rule::Positive, grey)?;
        let faintest_grey_dn = number("faintest_grey_dn", self.faintest_grey_dn, 1.0, Rule::NotNegative, grey)?;
        if faintest_mag <= brightest_mag {
            let wanted = format!("more than brightest_mag, {brightest_mag}");
            return Err(check.invalid("radiometry.faintest_mag", faintest_mag, wanted, faint));
        }
        if faintest_grey_dn > brightest_grey_dn {
            let wanted = format!("at most brightest_grey_dn, {brightest_grey_dn}");
            return Err(check.invalid("radiometry.faintest_grey_dn", faintest_grey_dn, wanted, grey));
        }
        let gain_e_per_dn = detector.gain_e_per_dn;
        Ok(GreyMap { brightest_mag, faintest_mag, brightest_grey_dn, faintest_grey_dn, scale, gain_e_per_dn })
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

#[cfg(test)]
mod tests {
    use crate::{Camera, Document};
    use plan::optics::StarLight;
    use std::path::Path;

    fn camera(radiometry: &str) -> Result<Camera, String> {
        let text = format!(
            "[detector]\nwidth_px = 640\nheight_px = 480\n[optics]\nfocal_length_mm = 25\n[radiometry]\n{radiometry}\n"
        );
        Camera::from_document(&Document::from_text(&text, Path::new("lab/cam.toml"))).map_err(|e| e.to_string())
    }

    #[test]
    fn the_model_chooses_where_electrons_come_from() {
        assert!(matches!(camera("").unwrap().star_light(), StarLight::Parametric(_)));
        assert!(matches!(camera("model = \"photons_v\"").unwrap().star_light(), StarLight::ParametricV(_)));
        let grey =
            camera("model = \"linear_grey\"\nbrightest_mag = 1\nfaintest_mag = 6\nbrightest_grey_dn = 1000").unwrap();
        let light = grey.star_light();
        assert_eq!(light.zero_point_e_per_s(), None);
        let gain = grey.detector.gain_e_per_dn;
        assert!((light.electrons(1.0, 0.0, 0.1) - 1000.0 * gain).abs() < 1e-6);
        assert_eq!(light.electrons(1.0, 0.0, 0.1), light.electrons(1.0, 2.0, 9.0), "no exposure, no colour");
    }

    #[test]
    fn keys_of_another_model_and_contradictions_are_refused() {
        for (text, parts) in [
            ("model = \"grey\"", ["radiometry.model", "\"linear_grey\""]),
            ("brightest_mag = 1", ["radiometry.brightest_mag", "belongs to"]),
            ("model = \"photons_v\"\ngrey_scale = \"magnitude\"", ["radiometry.grey_scale", "belongs to"]),
            ("model = \"linear_grey\"\ncolor_c1 = 0.1", ["radiometry.color_c1", "belongs to"]),
            ("model = \"linear_grey\"\nbrightest_mag = 6\nfaintest_mag = 6", ["radiometry.faintest_mag", "more than"]),
            (
                "model = \"linear_grey\"\nbrightest_grey_dn = 10\nfaintest_grey_dn = 11",
                ["radiometry.faintest_grey_dn", "at most"],
            ),
        ] {
            let error = camera(text).map(|camera| camera.name).expect_err(text);
            assert!(error.contains("lab/") && parts.iter().all(|part| error.contains(part)), "{text}: {error}");
        }
    }
}
