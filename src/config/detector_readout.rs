//! Readout of `[detector]`: gain, rounding, amplifier and row noise, response.

use crate::check::{Checker, Rule};
use crate::detector::DetectorKeys;
use crate::error::ConfigError;
use image::detector::{DetectorParams, Nonlinearity, Rounding, RowNoise};
use serde::Deserialize;

/// Readout beyond the read noise, checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Readout {
    pub(super) gain_e_per_dn: f64,
    pub(super) rounding: Rounding,
    pub(super) amplifier_noise_e_rms: f64,
    pub(super) row_noise: RowNoise,
    pub(super) nonlinearity: Nonlinearity,
}

/// `[detector.row_noise]`.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct RowNoiseKeys {
    e_rms: Option<f64>,
    corner_cycles_per_row: Option<f64>,
}

/// `[detector.nonlinearity]`.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct NonlinearityKeys {
    knots_e: Option<Vec<[f64; 2]>>,
}

/// What the gain must go with.
#[derive(Debug, Clone, Copy)]
pub(super) struct Converter {
    pub(super) full_well_e: f64,
    pub(super) bits: u32,
    pub(super) black_level_dn: f64,
}

/// How the gain is found where it is not given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum GainRule {
    /// The full well is the largest number.
    FillRange,
    /// One LSB is the full well over 2^bits.
    Lsb,
}

impl Readout {
    pub(super) fn check(
        keys: &DetectorKeys,
        converter: Converter,
        check: &mut Checker<'_>,
    ) -> Result<Self, ConfigError> {
        let gain_e_per_dn = converter.gain(keys, check)?;
        let roundings = [("nearest", Rounding::Nearest), ("truncate", Rounding::Truncate)];
        let advice = "how the converter makes a whole number";
        let rounding = match &keys.rounding {
            None => Rounding::Nearest,
            word => check.choice("detector.rounding", word.as_deref(), &roundings, advice)?,
        };
        let amplifier_noise_e_rms = keys.amplifier_noise_e_rms.unwrap_or(0.0);
        let advice = "0 turns it off; it adds to read_noise_e_rms in quadrature";
        let key = "detector.amplifier_noise_e_rms";
        check.meets(key, amplifier_noise_e_rms, Rule::Within(0.0, 1e6), advice)?;
        let row_noise = row_noise(&keys.row_noise, check)?;
        let nonlinearity = nonlinearity(&keys.nonlinearity, check)?;
        Ok(Self { gain_e_per_dn, rounding, amplifier_noise_e_rms, row_noise, nonlinearity })
    }
}

impl Converter {
    fn gain(&self, keys: &DetectorKeys, check: &mut Checker<'_>) -> Result<f64, ConfigError> {
        let rules = [("fill-range", GainRule::FillRange), ("lsb", GainRule::Lsb)];
        let advice = "\"fill-range\": the full well is the largest DN; \"lsb\": one DN is full well / 2^bits";
        let key = "detector.gain_e_per_dn";
        let rule = match (&keys.gain_rule, keys.gain_e_per_dn) {
            (None, _) => GainRule::FillRange,
            (word, None) => check.choice("detector.gain_rule", word.as_deref(), &rules, advice)?,
            (Some(word), Some(gain)) => {
                let wanted = format!("no gain_rule (\"{word}\") beside it");
                return Err(check.invalid(key, gain, wanted, "give the gain, or the rule that it follows from"));
            }
        };
        let largest_dn = f64::from((1_u32 << self.bits) - 1);
        let default = match rule {
            GainRule::FillRange => self.full_well_e / (largest_dn - self.black_level_dn),
            GainRule::Lsb => DetectorParams::lsb_e(self.full_well_e, self.bits),
        };
        let advice = "electrons per DN: full well / (2^bits - 1 - black level) uses the whole range";
        let gain = check.number(key, keys.gain_e_per_dn, default, Rule::Positive, advice)?;
        let full_well_dn = self.full_well_e / gain;
        if full_well_dn <= self.black_level_dn {
            let got = format!("{}, which is {full_well_dn:.1} DN at {gain} e-/DN", self.full_well_e);
            let wanted = format!("a full well of more DN than the black level, {}", self.black_level_dn);
            let advice = "lower black_level_dn or gain_e_per_dn, or check the unit of full_well_e: electrons";
            return Err(check.invalid("detector.full_well_e", got, wanted, advice));
        }
        Ok(gain)
    }
}

fn row_noise(keys: &RowNoiseKeys, check: &Checker<'_>) -> Result<RowNoise, ConfigError> {
    let e_rms = keys.e_rms.unwrap_or(0.0);
    let advice = "white noise that a row shares, electrons rms; 0 turns it off";
    check.meets("detector.row_noise.e_rms", e_rms, Rule::Within(0.0, 1e6), advice)?;
    let corner = keys.corner_cycles_per_row.unwrap_or(0.0);
    let key = "detector.row_noise.corner_cycles_per_row";
    let advice = "where 1/f noise equals the white noise: its frequency times the time of a row; 0: no 1/f noise";
    check.meets(key, corner, Rule::Within(0.0, 0.5), advice)?;
    if corner > 0.0 && e_rms == 0.0 {
        let advice = "the corner says where 1/f noise equals the white noise: give row_noise.e_rms too";
        return Err(check.invalid(key, corner, "row_noise.e_rms above 0", advice));
    }
    Ok(RowNoise { e_rms, corner_cycles_per_row: corner })
}

fn nonlinearity(keys: &NonlinearityKeys, check: &Checker<'_>) -> Result<Nonlinearity, ConfigError> {
    let Some(knots_e) = &keys.knots_e else { return Ok(Nonlinearity::OFF) };
    Nonlinearity::through(knots_e).map_err(|error| {
        let wanted = "up to four [electrons, electrons seen], both rising";
        let advice = format!("{error}; such as [[20000, 19900], [30000, 28500]]");
        check.invalid("detector.nonlinearity.knots_e", format!("{knots_e:?}"), wanted, &advice)
    })
}
