//! Readout of `[detector]`: gain, rounding, amplifier and row noise, response.

use crate::key_type::{Raw, Shape};
use crate::{check::Checker, detector_effects::DetectorKeys, error::ConfigError, key::section};
use image::detector::{DetectorParams, Nonlinearity, Rounding, RowNoise};

/// Readout beyond the read noise, checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Readout {
    pub(super) gain_e_per_dn: f64,
    pub(super) rounding: Rounding,
    pub(super) amplifier_noise_e_rms: f64,
    pub(super) row_noise: RowNoise,
    pub(super) nonlinearity: Nonlinearity,
}

section! {
    /// Noise that a row shares.
    RowNoiseKeys at "detector.row_noise" {
        /// White noise that a row shares, electrons rms; 0 turns it off.
        e_rms: f64 = Silent(0.0), Within(0.0, 1e6);
        /// Where 1/f noise equals the white noise: its frequency times the time of a row; 0: no 1/f noise.
        corner_cycles_per_row: f64 = Silent(0.0), Within(0.0, 0.5);
    }

    /// Nonlinear response to charge.
    NonlinearityKeys at "detector.nonlinearity" {
        /// Up to four [electrons, electrons seen], both rising, such as [[20000, 19900], [30000, 28500]].
        knots_e: Raw<Vec<[f64; 2]>> = Optional, Shape::pairs();
    }
}

/// Limits of the converter, which the gain must fit.
#[derive(Debug, Clone, Copy)]
pub(super) struct Converter {
    pub(super) full_well_e: f64,
    pub(super) bits: u32,
    pub(super) black_level_dn: f64,
}

/// How the gain is found where it is not given.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum GainRule {
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
        let rounding = keys.rounding().check(check)?;
        let amplifier_noise_e_rms = keys.amplifier_noise_e_rms().check(check)?;
        let row_noise = row_noise(&keys.row_noise, check)?;
        let nonlinearity = nonlinearity(&keys.nonlinearity, check)?;
        Ok(Self { gain_e_per_dn, rounding, amplifier_noise_e_rms, row_noise, nonlinearity })
    }
}

impl Converter {
    fn gain(&self, keys: &DetectorKeys, check: &mut Checker<'_>) -> Result<f64, ConfigError> {
        let given = keys.gain_e_per_dn();
        let rule = match (keys.gain_rule().raw(), given.raw()) {
            (Some(word), Some(gain)) => {
                let wanted = format!("no gain_rule (\"{word}\") beside it");
                let advice = "give the gain, or the rule that it follows from";
                return Err(given.advised(advice).invalid(gain, wanted, check));
            }
            (Some(_), None) => keys.gain_rule().check(check)?,
            (None, _) => GainRule::FillRange,
        };
        let largest_dn = f64::from((1_u32 << self.bits) - 1);
        let default = match rule {
            GainRule::FillRange => self.full_well_e / (largest_dn - self.black_level_dn),
            GainRule::Lsb => DetectorParams::lsb_e(self.full_well_e, self.bits),
        };
        let gain = given.or(default).check(check)?;
        let full_well_dn = self.full_well_e / gain;
        if full_well_dn <= self.black_level_dn {
            let got = format!("{}, which is {full_well_dn:.1} DN at {gain} e-/DN", self.full_well_e);
            let wanted = format!("a full well of more DN than the black level, {}", self.black_level_dn);
            let advice = "lower black_level_dn or gain_e_per_dn, or check the unit of full_well_e: electrons";
            return Err(keys.full_well_e().advised(advice).invalid(got, wanted, check));
        }
        Ok(gain)
    }
}

fn row_noise(keys: &RowNoiseKeys, check: &mut Checker<'_>) -> Result<RowNoise, ConfigError> {
    let (e_rms, corner) = (keys.e_rms().check(check)?, keys.corner_cycles_per_row().check(check)?);
    if corner > 0.0 && e_rms == 0.0 {
        let advice = "the corner says where 1/f noise equals the white noise: give row_noise.e_rms too";
        return Err(keys.corner_cycles_per_row().advised(advice).invalid(corner, "row_noise.e_rms above 0", check));
    }
    Ok(RowNoise { e_rms, corner_cycles_per_row: corner })
}

fn nonlinearity(keys: &NonlinearityKeys, check: &Checker<'_>) -> Result<Nonlinearity, ConfigError> {
    let Some(knots_e) = keys.knots_e().raw() else { return Ok(Nonlinearity::OFF) };
    Nonlinearity::through(knots_e).map_err(|error| {
        let wanted = "up to four [electrons, electrons seen], both rising";
        let advice = format!("{error}; such as [[20000, 19900], [30000, 28500]]");
        keys.knots_e().advised(advice).invalid(format!("{knots_e:?}"), wanted, check)
    })
}
