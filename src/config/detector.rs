//! `[detector]`: geometry, charge, conversion.

use crate::check::{Checker, Rule};
use crate::detector_effects::{DetectorKeys, Fits, check_effects};
use crate::detector_readout::{Converter, Readout};
use crate::{detector_dark::DarkCurrent, detector_pattern::FixedPatterns, error::ConfigError};
use image::detector::{DetectorParams, Patterns};

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
    pub(super) fn check(keys: &DetectorKeys, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        let (width_px, height_px) = (keys.width_px().check(check)?, keys.height_px().check(check)?);
        let bits = keys.bits().check(check)?;
        let largest_dn = f64::from((1_u32 << bits) - 1);
        let black_default = DEFAULT_BLACK_LEVEL_DN.min((largest_dn / 8.0).floor());
        let black_level = keys.black_level_dn().or(black_default).within(Rule::Within(0.0, largest_dn - 1.0));
        let black_level_dn = black_level.check(check)?;
        let full_well_e = keys.full_well_e().check(check)?;
        let readout = Readout::check(keys, Converter { full_well_e, bits, black_level_dn }, check)?;
        let poisson = keys.poisson().check(check)?;
        let pixel_pitch_um = keys.pixel_pitch_um().check(check)?;
        let read_noise_e_rms = keys.read_noise_e_rms().check(check)?;
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
