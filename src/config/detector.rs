//! `[detector]`: geometry, charge, conversion.

use crate::check::{Checker, Rule};
use crate::detector_dark::DarkCurrent;
use crate::detector_effects::{
    BinningKeys, BloomingKeys, ChargeTransferKeys, DefectsKeys, Fits, ImageLagKeys, ProtonsKeys, TdiKeys, WindowKeys,
    check_effects,
};
use crate::detector_pattern::{FixedPatterns, LineKeys, MapKeys};
use crate::detector_readout::{Converter, NonlinearityKeys, Readout, RowNoiseKeys};
use crate::error::ConfigError;
use image::detector::{DarkLaw, LinePattern, Nonlinearity, Patterns, PoissonMethod, Rounding, RowNoise, SpatialParams};
use serde::Deserialize;

const LARGEST_SIDE_PX: u32 = 16_384;
const DEFAULT_PIXEL_PITCH_UM: f64 = 10.0;
const DEFAULT_FULL_WELL_E: f64 = 30_000.0;
const DEFAULT_BITS: u32 = 12;
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
    /// Saturation capacity, electrons.
    pub full_well_e: f64,
    /// Electrons per digital number.
    pub gain_e_per_dn: f64,
    /// Bits of the converter, 1 to 16.
    pub bits: u32,
    /// Digital number of no charge.
    pub black_level_dn: f64,
    /// Temporal noise of one read, electrons rms.
    pub read_noise_e_rms: f64,
    /// Noise of the amplifiers after the pixel, electrons rms.
    pub amplifier_noise_e_rms: f64,
    /// Mean dark current, electrons per second and pixel, at the law's reference temperature.
    pub dark_e_per_s: f64,
    /// The detector's temperature and what it makes of the dark current.
    pub dark_law: DarkLaw,
    /// Dark-current non-uniformity, rms share of the mean.
    pub dark_nonuniformity: f64,
    /// Photo-response non-uniformity, rms fraction.
    pub prnu: f64,
    /// Dark-signal non-uniformity of one frame, electrons rms: an offset, whatever exposure and temperature.
    pub dsnu_e_rms: f64,
    /// Patterns given as maps, in place of drawn ones.
    pub maps: Patterns,
    /// Fixed patterns of columns and rows.
    pub line_pattern: LinePattern,
    /// Noise that a row shares.
    pub row_noise: RowNoise,
    /// Response to charge.
    pub nonlinearity: Nonlinearity,
    /// How the converter makes a whole number.
    pub rounding: Rounding,
    /// Electrons per photon, averaged over the band, fill factor included.
    pub quantum_efficiency: f64,
    /// How shot noise is drawn.
    pub poisson: PoissonMethod,
    /// Defects, protons, and what needs more than one pixel or one frame.
    pub spatial: SpatialParams,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct DetectorKeys {
    width_px: Option<i64>,
    height_px: Option<i64>,
    pixel_pitch_um: Option<f64>,
    full_well_e: Option<f64>,
    pub(super) gain_e_per_dn: Option<f64>,
    pub(super) gain_rule: Option<String>,
    pub(super) rounding: Option<String>,
    bits: Option<i64>,
    black_level_dn: Option<f64>,
    read_noise_e_rms: Option<f64>,
    pub(super) amplifier_noise_e_rms: Option<f64>,
    pub(super) dark_e_per_s: Option<f64>,
    pub(super) dark_current_na_per_cm2: Option<f64>,
    pub(super) dark_temperature_c: Option<f64>,
    pub(super) temperature_c: Option<f64>,
    pub(super) dark_doubling_k: Option<f64>,
    pub(super) dark_nonuniformity: Option<f64>,
    pub(super) prnu: Option<f64>,
    pub(super) prnu_pp: Option<f64>,
    pub(super) dsnu_e_rms: Option<f64>,
    pub(super) dsnu_e_pp: Option<f64>,
    pub(super) pp_sigmas: Option<f64>,
    quantum_efficiency: Option<f64>,
    poisson: Option<String>,
    pub(super) defects: Option<DefectsKeys>,
    pub(super) protons: Option<ProtonsKeys>,
    pub(super) image_lag: Option<ImageLagKeys>,
    pub(super) blooming: Option<BloomingKeys>,
    pub(super) charge_transfer: Option<ChargeTransferKeys>,
    pub(super) binning: Option<BinningKeys>,
    pub(super) window: Option<WindowKeys>,
    pub(super) tdi: Option<TdiKeys>,
    #[serde(default)]
    pub(super) lines: LineKeys,
    #[serde(default)]
    pub(super) maps: MapKeys,
    #[serde(default)]
    pub(super) row_noise: RowNoiseKeys,
    #[serde(default)]
    pub(super) nonlinearity: NonlinearityKeys,
}

impl Detector {
    /// The largest digital number.
    #[must_use]
    pub fn largest_dn(&self) -> u32 {
        (1 << self.bits) - 1
    }

    /// Electrons at which the converter clips, when that is below the full well.
    #[must_use]
    pub fn converter_clips_at_e(&self) -> Option<f64> {
        let range_e = (f64::from(self.largest_dn()) - self.black_level_dn) * self.gain_e_per_dn;
        (range_e < self.full_well_e).then_some(range_e)
    }

    pub(super) fn check(keys: &DetectorKeys, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        let sides = 1..=LARGEST_SIDE_PX;
        let width_px =
            check.whole("detector.width_px", keys.width_px, None, sides.clone(), "give the number of columns")?;
        let height_px = check.whole("detector.height_px", keys.height_px, None, sides, "give the number of rows")?;
        let bits = "resolution of the converter, such as 12; above 16 does not fit the image";
        let bits = check.whole("detector.bits", keys.bits, Some(DEFAULT_BITS), 1..=16, bits)?;
        let largest_dn = f64::from((1_u32 << bits) - 1);
        let black_default = DEFAULT_BLACK_LEVEL_DN.min((largest_dn / 8.0).floor());
        let black_level_dn = check.number(
            "detector.black_level_dn",
            keys.black_level_dn,
            black_default,
            Rule::Within(0.0, largest_dn - 1.0),
            "it must leave room for signal below the largest digital number",
        )?;
        let well = "saturation capacity from the data sheet, such as 30000";
        let full_well_e =
            check.number("detector.full_well_e", keys.full_well_e, DEFAULT_FULL_WELL_E, Rule::Positive, well)?;
        let readout = Readout::check(keys, Converter { full_well_e, bits, black_level_dn }, check)?;
        let methods = PoissonMethod::ALL.map(|method| (method.name(), method));
        let poisson = "how shot noise is drawn; \"auto\" serves all means, and is the only one on a GPU";
        let poisson = check.choice("detector.poisson", keys.poisson.as_deref(), &methods, poisson)?;
        let pitch = "pixel pitch in micrometres, such as 5.5";
        let pixel_pitch_um = check.number(
            "detector.pixel_pitch_um",
            keys.pixel_pitch_um,
            DEFAULT_PIXEL_PITCH_UM,
            Rule::PositiveUpTo(1000.0),
            pitch,
        )?;
        let read_noise_e_rms = check.number(
            "detector.read_noise_e_rms",
            keys.read_noise_e_rms,
            10.0,
            Rule::Within(0.0, 1e6),
            "0 turns it off",
        )?;
        let dark = DarkCurrent::check(keys, pixel_pitch_um, check)?;
        let patterns = FixedPatterns::check(keys, [width_px, height_px], check)?;
        let quantum_efficiency = check.number(
            "detector.quantum_efficiency",
            keys.quantum_efficiency,
            0.5,
            Rule::PositiveUpTo(1.0),
            "a fraction of the photons: 45 % is 0.45",
        )?;
        let fits = Fits { size_px: [width_px, height_px], pixel_pitch_um, full_well_e, bits };
        let spatial = check_effects(keys, fits, check)?;
        Ok(Self {
            width_px,
            height_px,
            pixel_pitch_um,
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
            maps: patterns.maps,
            line_pattern: patterns.lines,
            row_noise: readout.row_noise,
            nonlinearity: readout.nonlinearity,
            rounding: readout.rounding,
            quantum_efficiency,
            poisson,
            spatial,
        })
    }
}
