//! `[radiometry]` and `[exposure]`.

use crate::check::{Checker, Rule};
use crate::key::{Section, section, taken};
use crate::key_type::{Any, Raw, Shape, Word};
use crate::{detector::Detector, error::Result};
use core::fmt;
use plan::optics::{GreyMap, GreyScale};
use serde::Deserialize;

/// Photons per second and square metre of a star of G = 0 in the band of Gaia G, above the optics.
///
/// Gaia EDR3 G on the Vega scale: zero point 3228.75 Jy, effective width 405.3 nm, pivot wavelength 621.8 nm (SVO
/// Filter Profile Service), so `3228.75e-26 / h * 405.3 / 621.8 = 3.18e10`, rounded.
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
    /// Stars fainter than this G magnitude are not rendered; `None`: as faint as the camera sees.
    pub limiting_mag: Option<f64>,
    /// Whether stars that the camera sees are left out on purpose.
    pub seen_stars_left_out: bool,
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

section! {
    /// Magnitudes to electrons.
    RadiometryKeys at "radiometry" {
        /// Where electrons come from: photons in a band, or a mapping of magnitudes to greys.
        model: Word<Model> = Silent("photons"),
            [("photons", Model::PhotonsG), ("photons_v", Model::PhotonsV), ("linear_grey", Model::LinearGrey)],
            "photons take zero_magnitude_photons_per_s_m2 (of G = 0; photons_v: of V = 0), color_c1, color_c2; \
             linear_grey takes two magnitudes and their greys";
        /// Faintest G magnitude to render, such as 7.0; "auto": half a magnitude beyond what the camera sees at SNR 3, as
        /// far as the catalog reaches and its stars fit into memory.
        limiting_mag: Raw<FaintestKey> = Computed("\"auto\""),
            Shape::either(Shape::Number(LIMITING_MAG), Shape::Words(vec!["auto"]));
        /// Stars that the camera sees, and that limiting_mag or the catalog leaves out, are left out on purpose: `check` does
        /// not warn of them.
        seen_stars_left_out: bool = Silent(false), Any;
        /// Photons per second and square metre of a star of magnitude 0 above the optics, about 3e10 for silicon.
        zero_magnitude_photons_per_s_m2: f64 = GAIA_G_ZERO_PHOTONS_PER_S_M2, Positive;
        /// First colour term: instrument magnitude less magnitude, per magnitude of BP-RP.
        color_c1: f64 = 0.0, Within(-5.0, 5.0),
            "magnitudes per magnitude of BP-RP; 0 when the band is that of the magnitude";
        /// Second colour term, per squared magnitude of BP-RP.
        color_c2: f64 = 0.0, Within(-5.0, 5.0),
            "magnitudes per magnitude of BP-RP; 0 when the band is that of the magnitude";
        /// The quantity that the grey is linear in; irradiance keeps the stars' ratios.
        grey_scale: Word<GreyScale> = "irradiance",
            [("irradiance", GreyScale::Irradiance), ("magnitude", GreyScale::Magnitude)];
        /// Magnitude G of the star that gets brightest_grey_dn.
        brightest_mag: f64 = -1.5, Within(-30.0, 30.0);
        /// Magnitude G of the star that gets faintest_grey_dn, fainter than brightest_mag.
        faintest_mag: f64 = Computed("limiting_mag, 7 where that is \"auto\""), Within(-30.0, 30.0);
        /// Sum of the brightest star's grey above the black level, DN.
        brightest_grey_dn: f64 = Computed("largest DN less black level"), Positive;
        /// Sum of the faintest star's grey above the black level, DN.
        faintest_grey_dn: f64 = 1.0, NotNegative;
    }

    /// When the detector collects light, and when its frame is due.
    ExposureKeys at "exposure" {
        /// Integration time in seconds: 100 ms is 0.1.
        exposure_s: f64 = 0.05, PositiveUpTo(3600.0);
        /// Microseconds from one row's exposure to the next, such as 15; 0 for a global shutter.
        rolling_line_us: f64 = 0.0, Within(0.0, 1e6);
        /// Seconds from the end of exposure to the frame; 0 for none.
        readout_s: f64 = 0.02, Within(0.0, 3600.0);
    }
}

/// Magnitudes of the faintest star to render.
const LIMITING_MAG: Rule = Rule::Within(-2.0, 25.0);
/// Magnitude of the faintest star of a grey mapping for which the file names none.
const FAINTEST_GREY_MAG: f64 = 7.0;

/// The faintest star to render, as a file gives it: a magnitude, or "auto".
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged, expecting = "invalid type: expected a magnitude or \"auto\"")]
pub(super) enum FaintestKey {
    Mag(f64),
    Word(String),
}

impl fmt::Display for FaintestKey {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Mag(mag) => mag.fmt(f),
            Self::Word(word) => write!(f, "\"{word}\""),
        }
    }
}

#[derive(Clone, Copy, PartialEq)]
pub(super) enum Model {
    PhotonsG,
    PhotonsV,
    LinearGrey,
}

impl Radiometry {
    pub(super) fn check(keys: &RadiometryKeys, detector: &Detector, check: &mut Checker<'_>) -> Result<Self> {
        let model = keys.model().check(check)?;
        let limiting_mag = keys.faintest(check)?;
        let seen_stars_left_out = keys.seen_stars_left_out().check(check)?;
        if model == Model::LinearGrey {
            let map = keys.grey_map(limiting_mag, detector, check)?;
            // A mapping of magnitudes to greys has no noise that a star could be lost in.
            let limiting_mag = limiting_mag.or(Some(map.faintest_mag));
            let model = RadiometryModel::LinearGrey(map);
            let zero_magnitude_photons_per_s_m2 = GAIA_G_ZERO_PHOTONS_PER_S_M2;
            return Ok(Self {
                model,
                zero_magnitude_photons_per_s_m2,
                color_c1: 0.0,
                color_c2: 0.0,
                limiting_mag,
                seen_stars_left_out,
            });
        }
        let zero_magnitude_photons_per_s_m2 = keys.zero_magnitude_photons_per_s_m2().check(check)?;
        let (color_c1, color_c2) = (keys.color_c1().check(check)?, keys.color_c2().check(check)?);
        let of_grey = ["brightest_mag", "faintest_mag", "brightest_grey_dn", "faintest_grey_dn", "grey_scale"];
        keys.refuse(&of_grey, "model = \"linear_grey\"", check)?;
        let model = if model == Model::PhotonsV { RadiometryModel::PhotonsV } else { RadiometryModel::PhotonsG };
        Ok(Self { model, zero_magnitude_photons_per_s_m2, color_c1, color_c2, limiting_mag, seen_stars_left_out })
    }
}

impl RadiometryKeys {
    /// Returns the faintest magnitude to render; `None`: "auto".
    fn faintest(&self, check: &mut Checker<'_>) -> Result<Option<f64>> {
        let given = self.limiting_mag();
        match given.raw() {
            None => {
                check.note(&given.key(), "auto");
                Ok(None)
            }
            Some(FaintestKey::Word(word)) if word == "auto" => Ok(None),
            Some(FaintestKey::Mag(mag)) if LIMITING_MAG.is_met_by(*mag) => Ok(Some(*mag)),
            Some(other) => Err(given.invalid(other, format!("{LIMITING_MAG}, or \"auto\""), check)),
        }
    }

    fn grey_map(&self, limiting_mag: Option<f64>, detector: &Detector, check: &mut Checker<'_>) -> Result<GreyMap> {
        let of_photons = ["zero_magnitude_photons_per_s_m2", "color_c1", "color_c2"];
        self.refuse(&of_photons, "model = \"photons\" or \"photons_v\"", check)?;
        let scale = self.grey_scale().check(check)?;
        let brightest_mag = self.brightest_mag().check(check)?;
        let faintest_mag = self.faintest_mag().or(limiting_mag.unwrap_or(FAINTEST_GREY_MAG)).check(check)?;
        let range_dn = f64::from(detector.params.largest_dn()) - detector.params.black_level_dn;
        let brightest_grey_dn = self.brightest_grey_dn().or(range_dn).check(check)?;
        let faintest_grey_dn = self.faintest_grey_dn().check(check)?;
        if faintest_mag <= brightest_mag {
            let wanted = format!("more than brightest_mag, {brightest_mag}");
            return Err(self.faintest_mag().invalid(faintest_mag, wanted, check));
        }
        if faintest_grey_dn > brightest_grey_dn {
            let wanted = format!("at most brightest_grey_dn, {brightest_grey_dn}");
            return Err(self.faintest_grey_dn().invalid(faintest_grey_dn, wanted, check));
        }
        let gain_e_per_dn = detector.params.gain_e_per_dn;
        Ok(GreyMap { brightest_mag, faintest_mag, brightest_grey_dn, faintest_grey_dn, scale, gain_e_per_dn })
    }
}

impl Exposure {
    pub(super) fn check(keys: &ExposureKeys, check: &mut Checker<'_>) -> Result<Self> {
        taken!(check, keys => exposure_s, rolling_line_us, readout_s);
        Ok(Self { exposure_s, rolling_line_us, readout_s })
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
        let gain = grey.detector.params.gain_e_per_dn;
        assert!((light.electrons(1.0, 0.0, 0.1) - 1000.0 * gain).abs() < 1e-6);
        assert_eq!(light.electrons(1.0, 0.0, 0.1), light.electrons(1.0, 2.0, 9.0), "no exposure, no colour");
    }

    #[test]
    fn faintest_star_is_a_number_or_auto() {
        let of = |text: &str| camera(text).map(|camera| camera.radiometry.limiting_mag);
        assert_eq!((of("").unwrap(), of("limiting_mag = \"auto\"").unwrap()), (None, None));
        assert_eq!(of("limiting_mag = 6.5").unwrap(), Some(6.5));
        assert_eq!(of("limiting_mag = 7").unwrap(), Some(7.0), "a whole number");
        assert_eq!(of("model = \"linear_grey\"\nfaintest_mag = 6").unwrap(), Some(6.0), "the mapping's own end");
        for bad in ["26", "\"all\"", "true"] {
            let error = of(&format!("limiting_mag = {bad}")).unwrap_err();
            assert!(error.contains("radiometry.limiting_mag is") && error.contains("auto"), "{bad}: {error}");
        }
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
