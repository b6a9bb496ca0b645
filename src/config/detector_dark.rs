//! Dark current of `[detector]`: rate or density, temperatures, doubling, non-uniformity.

use crate::check::{Checker, Rule};
use crate::{detector_effects::DetectorKeys, error::ConfigError};
use image::detector::DarkLaw;

/// Most dark current of a pixel, electrons per second.
pub(super) const MOST_DARK_E_PER_S: f64 = 1e9;
/// Absolute zero, and above what any detector endures.
pub(super) const CELSIUS: Rule = Rule::Within(-273.15, 200.0);

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
        let reference_c = keys.dark_temperature_c().check(check)?;
        // A detector at its reference temperature has no default to report.
        let operating_c = keys.temperature_c().or_silently(reference_c).check(check)?;
        let doubling_k = keys.dark_doubling_k();
        let doubling_k = if keys.temperature_c().is_given() {
            doubling_k.check(check)?
        } else {
            doubling_k.or_silently(DarkLaw::AT_REFERENCE.doubling_k).check(check)?
        };
        let law = DarkLaw { reference_c, operating_c, doubling_k };
        let warm_e_per_s = e_per_s * law.factor();
        if warm_e_per_s.is_nan() || warm_e_per_s > MOST_DARK_E_PER_S {
            let got = format!("{operating_c}, where the dark current is {warm_e_per_s:.1e} e-/s");
            let wanted = format!("a dark current of at most {MOST_DARK_E_PER_S:.0e} e-/s");
            let advice = "give the dark current at a temperature nearer to the detector's, or a larger dark_doubling_k";
            return Err(keys.temperature_c().advised(advice).invalid(got, wanted, check));
        }
        let nonuniformity = keys.dark_nonuniformity().check(check)?;
        Ok(Self { e_per_s, law, nonuniformity })
    }

    fn rate(keys: &DetectorKeys, pixel_pitch_um: f64, check: &mut Checker<'_>) -> Result<f64, ConfigError> {
        let density = keys.dark_current_na_per_cm2();
        let Some(na_per_cm2) = density.raw().copied() else { return keys.dark_e_per_s().check(check) };
        if let Some(e_per_s) = keys.dark_e_per_s().raw() {
            let advice = "give the dark current once: as a density, or per pixel";
            return Err(density.advised(advice).invalid(
                na_per_cm2,
                format!("no dark_e_per_s ({e_per_s}) beside it"),
                check,
            ));
        }
        density.check(check)?;
        let advice = "electrons per second of a pixel of this density and pitch are too many";
        let e_per_s = DarkLaw::e_per_s_of_density(na_per_cm2, pixel_pitch_um);
        let rule = Rule::Within(0.0, MOST_DARK_E_PER_S);
        check.meets(&keys.dark_current_na_per_cm2().key(), e_per_s, rule, advice)
    }
}
