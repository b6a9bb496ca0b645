//! Dark current of `[detector]`: rate or density, temperatures, doubling, non-uniformity.

use crate::check::{Checker, Rule};
use crate::detector::DetectorKeys;
use crate::error::ConfigError;
use image::detector::DarkLaw;

const DEFAULT_E_PER_S: f64 = 10.0;
const DEFAULT_REFERENCE_C: f64 = 20.0;
const MOST_E_PER_S: f64 = 1e9;
/// Absolute zero, and above what any detector stands.
const CELSIUS: Rule = Rule::Within(-273.15, 200.0);

/// The dark current, checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct DarkCurrent {
    pub(super) e_per_s: f64,
    pub(super) law: DarkLaw,
    pub(super) nonuniformity: f64,
}

impl DarkCurrent {
    pub(super) fn check(
        keys: &DetectorKeys,
        pixel_pitch_um: f64,
        check: &mut Checker<'_>,
    ) -> Result<Self, ConfigError> {
        let e_per_s = Self::rate(keys, pixel_pitch_um, check)?;
        let reference_c = check.number(
            "detector.dark_temperature_c",
            keys.dark_temperature_c,
            DEFAULT_REFERENCE_C,
            CELSIUS,
            "degrees Celsius at which the dark current was measured",
        )?;
        // Nobody wants to be told that a detector is as warm as it was when it was measured.
        let operating_c = keys.temperature_c.unwrap_or(reference_c);
        let advice = "the detector's temperature in degrees Celsius; left out, it is dark_temperature_c";
        check.meets("detector.temperature_c", operating_c, CELSIUS, advice)?;
        let doubling_k = keys.dark_doubling_k;
        let advice = "kelvin of warming that double the dark current, 5 to 10 for silicon";
        let key = "detector.dark_doubling_k";
        let doubling_k = if keys.temperature_c.is_some() {
            check.number(key, doubling_k, DarkLaw::AT_REFERENCE.doubling_k, Rule::Positive, advice)?
        } else {
            check.meets(key, doubling_k.unwrap_or(DarkLaw::AT_REFERENCE.doubling_k), Rule::Positive, advice)?
        };
        let law = DarkLaw { reference_c, operating_c, doubling_k };
        let warm_e_per_s = e_per_s * law.factor();
        if warm_e_per_s.is_nan() || warm_e_per_s > MOST_E_PER_S {
            let got = format!("{operating_c}, where the dark current is {warm_e_per_s:.1e} e-/s");
            let wanted = format!("a dark current of at most {MOST_E_PER_S:.0e} e-/s");
            let advice = "give the dark current at a temperature nearer to the detector's, or a larger dark_doubling_k";
            return Err(check.invalid("detector.temperature_c", got, wanted, advice));
        }
        let advice = "rms share of the mean dark current: 20 % is 0.2; 0 turns it off";
        let nonuniformity = keys.dark_nonuniformity.unwrap_or(0.0);
        check.meets("detector.dark_nonuniformity", nonuniformity, Rule::Within(0.0, 1.0), advice)?;
        Ok(Self { e_per_s, law, nonuniformity })
    }

    fn rate(keys: &DetectorKeys, pixel_pitch_um: f64, check: &mut Checker<'_>) -> Result<f64, ConfigError> {
        let rule = Rule::Within(0.0, MOST_E_PER_S);
        let Some(na_per_cm2) = keys.dark_current_na_per_cm2 else {
            return check.number("detector.dark_e_per_s", keys.dark_e_per_s, DEFAULT_E_PER_S, rule, "0 turns it off");
        };
        let key = "detector.dark_current_na_per_cm2";
        if let Some(e_per_s) = keys.dark_e_per_s {
            let advice = "give the dark current once: as a density, or per pixel";
            return Err(check.invalid(key, na_per_cm2, format!("no dark_e_per_s ({e_per_s}) beside it"), advice));
        }
        let density = "nanoamperes per square centimetre, such as 0.1; 0 turns it off";
        check.meets(key, na_per_cm2, Rule::Within(0.0, 1e6), density)?;
        let advice = "electrons per second of a pixel of this density and pitch are too many";
        check.meets(key, DarkLaw::e_per_s_of_density(na_per_cm2, pixel_pitch_um), rule, advice)
    }
}
