//! `[detector]`: geometry, charge, conversion.
//!
//! Dark current of `[detector]`: rate or density, temperatures, doubling, non-uniformity.
//!
//! Fixed patterns of `[detector]`: rms or peak-to-peak, maps, columns and rows.
//!
//! Readout of `[detector]`: gain, rounding, amplifier and row noise, response.

use crate::check::{Checker, Rule};
use crate::detector_effects::{DetectorKeys, Fits, check_effects};
use crate::key::{Given, section, taken};
use crate::key_type::{Raw, Shape};
use crate::{error::Result, named_files::read_image};
use image::detector::{DarkLaw, DetectorParams, LinePattern, Nonlinearity, Patterns, Rounding, RowNoise};
use std::sync::Arc;

/// Most columns or rows.
pub(super) const LARGEST_SIDE_PX: i64 = 16_384;
const DEFAULT_BLACK_LEVEL_DN: f64 = 64.0;

/// The detector, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Detector {
    /// Columns.
    pub width_px: u32,
    /// Rows.
    pub height_px: u32,
    /// Pitch of the square pixels, um.
    pub pixel_pitch_um: f64,
    /// Patterns given as maps, in place of drawn ones.
    pub maps: Patterns,
    /// Electrons per photon, averaged over the band, fill factor included.
    pub quantum_efficiency: f64,
    /// Charge, conversion, noise and effects.
    pub params: DetectorParams,
}

impl Detector {
    pub(super) fn check(keys: &DetectorKeys, check: &mut Checker<'_>) -> Result<Self> {
        let (width_px, height_px) = (keys.width_px().check(check)?, keys.height_px().check(check)?);
        let bits = keys.bits().check(check)?;
        let largest_dn = f64::from((1_u32 << bits) - 1);
        let black_default = DEFAULT_BLACK_LEVEL_DN.min((largest_dn / 8.0).floor());
        let black_level = keys.black_level_dn().or(black_default).within(Rule::Within(0.0, largest_dn - 1.0));
        let black_level_dn = black_level.check(check)?;
        let full_well_e = keys.full_well_e().check(check)?;
        let readout = Readout::check(keys, Converter { full_well_e, bits, black_level_dn }, check)?;
        taken!(check, keys => poisson, pixel_pitch_um, read_noise_e_rms);
        let dark = DarkCurrent::check(keys, pixel_pitch_um, check)?;
        let patterns = FixedPatterns::check(keys, [width_px, height_px], check)?;
        let quantum_efficiency = keys.quantum_efficiency().check(check)?;
        let fits = Fits { size_px: [width_px, height_px], pixel_pitch_um, full_well_e, bits };
        let spatial = check_effects(keys, fits, check)?;
        let params = DetectorParams {
            full_well_e,
            gain_e_per_dn: readout.gain_e_per_dn,
            bits,
            black_level_dn,
            read_noise_e_rms,
            amplifier_noise_e_rms: readout.amplifier_noise_e_rms,
            dark_e_per_s: dark.e_per_s,
            dark_law: dark.law,
            dark_nonuniformity: dark.nonuniformity,
            prnu: patterns.prnu,
            dsnu_e_rms: patterns.dsnu_e_rms,
            nonlinearity: readout.nonlinearity,
            line_pattern: patterns.lines,
            row_noise: readout.row_noise,
            rounding: readout.rounding,
            poisson,
            spatial,
        };
        Ok(Self { width_px, height_px, pixel_pitch_um, maps: patterns.maps, quantum_efficiency, params })
    }
}

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
    pub(super) fn check(keys: &DetectorKeys, pixel_pitch_um: f64, check: &mut Checker<'_>) -> Result<Self> {
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

    fn rate(keys: &DetectorKeys, pixel_pitch_um: f64, check: &mut Checker<'_>) -> Result<f64> {
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

/// A map of gains instead of shares has a mean near 1.
const LARGEST_MEAN_PRNU: f64 = 0.5;

/// The fixed patterns, checked.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FixedPatterns {
    pub(super) prnu: f64,
    pub(super) dsnu_e_rms: f64,
    pub(super) lines: LinePattern,
    pub(super) maps: Patterns,
}

section! {
    /// Fixed patterns of columns and rows.
    LineKeys at "detector.lines" {
        /// Offset of a column, electrons rms; 0 turns it off.
        column_e_rms: f64 = Silent(0.0), NotNegative;
        /// Gain of a column, an rms fraction: 0.1 % is 0.001.
        column_gain_rms: f64 = Silent(0.0), Within(0.0, 0.2);
        /// Offset of a row, electrons rms; 0 turns it off.
        row_e_rms: f64 = Silent(0.0), NotNegative;
    }

    /// FITS images of the detector's size.
    MapKeys at "detector.maps" {
        /// Photo-response non-uniformity: shares about 0, 0.01 is 1 % above the mean response.
        prnu: String = Optional, "path";
        /// Dark-signal non-uniformity, electrons.
        dsnu_e: String = Optional, "path";
        /// Dark current over its mean, 0 or more.
        dark_factor: String = Optional, "path";
    }
}

impl FixedPatterns {
    pub(super) fn check(keys: &DetectorKeys, size_px: [u32; 2], check: &mut Checker<'_>) -> Result<Self> {
        let sigmas = keys.pp_sigmas().check(check)?;
        let maps = &keys.maps;
        let prnu = spread([keys.prnu(), keys.prnu_pp()], sigmas, maps.prnu().is_given(), check)?;
        let dsnu_e_rms = spread([keys.dsnu_e_rms(), keys.dsnu_e_pp()], sigmas, maps.dsnu_e().is_given(), check)?;
        if let (Some(nonuniformity), true) = (keys.dark_nonuniformity().raw(), maps.dark_factor().is_given()) {
            let advice = "leave out dark_nonuniformity: the map has the pixels' own factors";
            return Err(keys.dark_nonuniformity().advised(advice).invalid(nonuniformity, "no dark_factor map", check));
        }
        let lines = LinePattern {
            column_e_rms: keys.lines.column_e_rms().check(check)?,
            column_gain_rms: keys.lines.column_gain_rms().check(check)?,
            row_e_rms: keys.lines.row_e_rms().check(check)?,
        };
        Ok(Self { prnu, dsnu_e_rms, lines, maps: read_maps(maps, size_px, check)? })
    }
}

/// Reads a figure that may be given as rms, as peak-to-peak, or as a map.
fn spread(
    [rms, peak_to_peak]: [Given<'_, f64>; 2],
    sigmas: f64,
    is_mapped: bool,
    check: &mut Checker<'_>,
) -> Result<f64> {
    let given = [rms.is_given(), peak_to_peak.is_given(), is_mapped];
    if given.into_iter().filter(|given| *given).count() > 1 {
        let wanted = "rms, peak-to-peak or a map";
        return Err(rms.advised("keep one of the three").invalid("given more than once", wanted, check));
    }
    if is_mapped {
        return Ok(0.0);
    }
    match peak_to_peak.raw() {
        Some(figure) => check.meets(&rms.key(), figure / sigmas, rms.limit, &peak_to_peak.advice),
        None => rms.check(check),
    }
}

/// Largest values of maps: more than any pixel's, and small enough for sums of all pixels.
const MOST_SHARE: f32 = 100.0;
const MOST_E: f32 = 1e7;
const MOST_FACTOR: f32 = 1e6;

fn read_maps(keys: &MapKeys, size_px: [u32; 2], check: &Checker<'_>) -> Result<Patterns> {
    let read = |path: Given<'_, String>, is_fine: fn(f32) -> bool, wanted: &str| {
        let key = path.key();
        let Some(path) = path.raw() else { return Ok(None) };
        let pixels = read_image(check, &key, path, size_px)?;
        match pixels.iter().position(|value| !value.is_finite() || !is_fine(*value)) {
            None => Ok(Some(Arc::from(pixels))),
            Some(i) => {
                let (x, y) = (i % size_px[0] as usize, i / size_px[0] as usize);
                let got = format!("{path}, whose pixel ({x}, {y}) is {}", pixels[i]);
                Err(check.invalid(&key, got, wanted, "correct the map: no pixel may be missing"))
            }
        }
    };
    let made = Patterns {
        prnu: read(
            keys.prnu(),
            |share| share > -1.0 && share < MOST_SHARE,
            "shares above -1 and below 100: 0.01 is 1 % above the mean response",
        )?,
        dsnu_e: read(keys.dsnu_e(), |e| e.abs() <= MOST_E, "electrons, 1e7 at most")?,
        dark_factor: read(keys.dark_factor(), |factor| (0.0..=MOST_FACTOR).contains(&factor), "factors of 0 to 1e6")?,
    };
    if let (Some(map), Some(path)) = (&made.prnu, keys.prnu().raw()) {
        let mean = map.iter().map(|share| f64::from(*share)).sum::<f64>() / map.len().max(1) as f64;
        if mean.abs() > LARGEST_MEAN_PRNU {
            let got = format!("{path}, whose mean is {mean:.3}");
            let wanted = "shares about 0: 0.01 is 1 % above the mean response";
            return Err(check.invalid("detector.maps.prnu", got, wanted, "if it holds gains about 1, subtract 1"));
        }
    }
    Ok(made)
}

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
    pub(super) fn check(keys: &DetectorKeys, converter: Converter, check: &mut Checker<'_>) -> Result<Self> {
        let gain_e_per_dn = converter.gain(keys, check)?;
        taken!(check, keys => rounding, amplifier_noise_e_rms);
        let row_noise = row_noise(&keys.row_noise, check)?;
        let nonlinearity = nonlinearity(&keys.nonlinearity, check)?;
        Ok(Self { gain_e_per_dn, rounding, amplifier_noise_e_rms, row_noise, nonlinearity })
    }
}

impl Converter {
    fn gain(&self, keys: &DetectorKeys, check: &mut Checker<'_>) -> Result<f64> {
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

fn row_noise(keys: &RowNoiseKeys, check: &mut Checker<'_>) -> Result<RowNoise> {
    let (e_rms, corner) = (keys.e_rms().check(check)?, keys.corner_cycles_per_row().check(check)?);
    if corner > 0.0 && e_rms == 0.0 {
        let advice = "the corner says where 1/f noise equals the white noise: give row_noise.e_rms too";
        return Err(keys.corner_cycles_per_row().advised(advice).invalid(corner, "row_noise.e_rms above 0", check));
    }
    Ok(RowNoise { e_rms, corner_cycles_per_row: corner })
}

fn nonlinearity(keys: &NonlinearityKeys, check: &Checker<'_>) -> Result<Nonlinearity> {
    let Some(knots_e) = keys.knots_e().raw() else { return Ok(Nonlinearity::OFF) };
    Nonlinearity::through(knots_e).map_err(|error| {
        let wanted = "up to four [electrons, electrons seen], both rising";
        let advice = format!("{error}; such as [[20000, 19900], [30000, 28500]]");
        keys.knots_e().advised(advice).invalid(format!("{knots_e:?}"), wanted, check)
    })
}
