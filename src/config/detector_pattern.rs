//! Fixed patterns of `[detector]`: rms or peak-to-peak, maps, columns and rows.

use crate::check::{Checker, Rule};
use crate::detector::DetectorKeys;
use crate::error::ConfigError;
use crate::image_file;
use image::detector::{LinePattern, Patterns};
use serde::Deserialize;
use std::sync::Arc;

const DEFAULT_PRNU: f64 = 0.01;
const DEFAULT_DSNU_E: f64 = 1.0;
/// Standard deviations between the extremes of a peak-to-peak figure.
const DEFAULT_PP_SIGMAS: f64 = 6.0;
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

/// `[detector.lines]`.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LineKeys {
    column_e_rms: Option<f64>,
    column_gain_rms: Option<f64>,
    row_e_rms: Option<f64>,
}

/// `[detector.maps]`: FITS files of the detector's size.
#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MapKeys {
    prnu: Option<String>,
    dsnu_e: Option<String>,
    dark_factor: Option<String>,
}

/// A figure that may be given as rms, as peak-to-peak, or as a map.
struct Spread<'a> {
    name: &'a str,
    rms: Option<f64>,
    peak_to_peak: Option<f64>,
    is_mapped: bool,
}

impl FixedPatterns {
    pub(super) fn check(keys: &DetectorKeys, size_px: [u32; 2], check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        let sigmas = keys.pp_sigmas.unwrap_or(DEFAULT_PP_SIGMAS);
        let advice = "standard deviations from peak to peak, usually 5 to 6";
        check.meets("detector.pp_sigmas", sigmas, Rule::Within(1.0, 20.0), advice)?;
        let maps = &keys.maps;
        let prnu = Spread { name: "prnu", rms: keys.prnu, peak_to_peak: keys.prnu_pp, is_mapped: maps.prnu.is_some() };
        let advice = "an rms fraction: 1 % is 0.01";
        let prnu = prnu.check(sigmas, DEFAULT_PRNU, Rule::Within(0.0, 0.5), advice, check)?;
        let dsnu = Spread {
            name: "dsnu_e_rms",
            rms: keys.dsnu_e_rms,
            peak_to_peak: keys.dsnu_e_pp,
            is_mapped: maps.dsnu_e.is_some(),
        };
        let dsnu_e_rms = dsnu.check(sigmas, DEFAULT_DSNU_E, Rule::NotNegative, "0 turns it off", check)?;
        if let (Some(nonuniformity), true) = (keys.dark_nonuniformity, maps.dark_factor.is_some()) {
            let advice = "leave out dark_nonuniformity: the map has the pixels' own factors";
            return Err(check.invalid("detector.dark_nonuniformity", nonuniformity, "no dark_factor map", advice));
        }
        Ok(Self { prnu, dsnu_e_rms, lines: Self::lines(&keys.lines, check)?, maps: read_maps(maps, size_px, check)? })
    }

    fn lines(keys: &LineKeys, check: &Checker<'_>) -> Result<LinePattern, ConfigError> {
        let off = |key: &str, given: Option<f64>, rule, advice| {
            check.meets(&format!("detector.lines.{key}"), given.unwrap_or(0.0), rule, advice)
        };
        let offset = "electrons rms; 0 turns it off";
        Ok(LinePattern {
            column_e_rms: off("column_e_rms", keys.column_e_rms, Rule::NotNegative, offset)?,
            column_gain_rms: off(
                "column_gain_rms",
                keys.column_gain_rms,
                Rule::Within(0.0, 0.2),
                "an rms fraction: 0.1 % is 0.001",
            )?,
            row_e_rms: off("row_e_rms", keys.row_e_rms, Rule::NotNegative, offset)?,
        })
    }
}

impl Spread<'_> {
    fn check(
        self,
        sigmas: f64,
        default: f64,
        rule: Rule,
        advice: &str,
        check: &mut Checker<'_>,
    ) -> Result<f64, ConfigError> {
        let key = format!("detector.{}", self.name);
        let given = [self.rms.is_some(), self.peak_to_peak.is_some(), self.is_mapped];
        if given.into_iter().filter(|given| *given).count() > 1 {
            let got = "given more than once";
            return Err(check.invalid(&key, got, "rms, peak-to-peak or a map", "keep one of the three"));
        }
        if self.is_mapped {
            return Ok(0.0);
        }
        match self.peak_to_peak {
            Some(peak_to_peak) => {
                let advice = "a peak-to-peak figure; over pp_sigmas it is the rms";
                check.meets(&key, peak_to_peak / sigmas, rule, advice)
            }
            None => check.number(&key, self.rms, default, rule, advice),
        }
    }
}

fn read_maps(keys: &MapKeys, size_px: [u32; 2], check: &Checker<'_>) -> Result<Patterns, ConfigError> {
    let read = |name: &str, path: &Option<String>, is_fine: fn(f32) -> bool, wanted: &str| {
        let key = format!("detector.maps.{name}");
        let Some(path) = path else { return Ok(None) };
        let pixels = image_file::read(check, &key, path, size_px)?;
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
        prnu: read("prnu", &keys.prnu, |share| share > -1.0, "shares above -1: 0.01 is 1 % above the mean response")?,
        dsnu_e: read("dsnu_e", &keys.dsnu_e, |_| true, "electrons")?,
        dark_factor: read("dark_factor", &keys.dark_factor, |factor| factor >= 0.0, "factors of 0 or more")?,
    };
    if let (Some(map), Some(path)) = (&made.prnu, &keys.prnu) {
        let mean = map.iter().map(|share| f64::from(*share)).sum::<f64>() / map.len().max(1) as f64;
        if mean.abs() > LARGEST_MEAN_PRNU {
            let got = format!("{path}, whose mean is {mean:.3}");
            let wanted = "shares about 0: 0.01 is 1 % above the mean response";
            return Err(check.invalid("detector.maps.prnu", got, wanted, "if it holds gains about 1, subtract 1"));
        }
    }
    Ok(made)
}
