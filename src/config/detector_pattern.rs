//! Fixed patterns of `[detector]`: rms or peak-to-peak, maps, columns and rows.

use crate::key::{Given, section};
use crate::{check::Checker, detector_effects::DetectorKeys, error::ConfigError, image_file};
use image::detector::{LinePattern, Patterns};
use std::sync::Arc;

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
    pub(super) fn check(keys: &DetectorKeys, size_px: [u32; 2], check: &mut Checker<'_>) -> Result<Self, ConfigError> {
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
) -> Result<f64, ConfigError> {
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

fn read_maps(keys: &MapKeys, size_px: [u32; 2], check: &Checker<'_>) -> Result<Patterns, ConfigError> {
    let read = |path: Given<'_, String>, is_fine: fn(f32) -> bool, wanted: &str| {
        let key = path.key();
        let Some(path) = path.raw() else { return Ok(None) };
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
