//! `[detector]`: geometry, charge, conversion.

use crate::check::{Checker, Rule};
use crate::detector_dark::{CELSIUS, DarkCurrent, MOST_DARK_E_PER_S};
use crate::detector_effects::{
    BinningKeys, BloomingKeys, ChargeTransferKeys, ColourFilterKeys, DefectsKeys, Fits, ImageLagKeys, ProtonsKeys,
    TdiKeys, WindowKeys, check_effects,
};
use crate::detector_pattern::{FixedPatterns, LineKeys, MapKeys};
use crate::detector_readout::{Converter, GainRule, NonlinearityKeys, Readout, RowNoiseKeys};
use crate::error::ConfigError;
use crate::key::section;
use crate::key_type::{Whole, Word};
use image::detector::{DarkLaw, DetectorParams, Patterns, PoissonMethod, Rounding};

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

section! {
    /// Geometry, charge and conversion.
    DetectorKeys at "detector" {
        /// Number of columns.
        width_px: Whole = Needed, 1..=LARGEST_SIDE_PX;
        /// Number of rows.
        height_px: Whole = Needed, 1..=LARGEST_SIDE_PX;
        /// Resolution of the converter, such as 12; above 16 does not fit the image.
        bits: Whole = 12, 1..=16;
        /// Digital number of no charge; it must leave room for signal below the largest digital number.
        black_level_dn: f64 = Computed("64, at most an eighth of the range"), Within(0.0, 65_534.0);
        /// Saturation capacity from the data sheet, such as 30000.
        full_well_e: f64 = 30_000.0, Positive;
        /// Electrons per DN: full well / (2^bits - 1 - black level) uses the whole range.
        gain_e_per_dn: f64 = Computed("by gain_rule"), Positive;
        /// How the gain is found where it is not given.
        gain_rule: Word<GainRule> = Silent("fill-range"),
            [("fill-range", GainRule::FillRange), ("lsb", GainRule::Lsb)],
            "\"fill-range\": the full well is the largest DN; \"lsb\": one DN is full well / 2^bits";
        /// How the converter makes a whole number.
        rounding: Word<Rounding> = Silent("nearest"),
            [("nearest", Rounding::Nearest), ("truncate", Rounding::Truncate)];
        /// Noise after the pixel, electrons rms, adds to read_noise_e_rms in quadrature; 0 turns it off.
        amplifier_noise_e_rms: f64 = Silent(0.0), Within(0.0, 1e6);
        /// How shot noise is drawn; "auto" serves all means, and is the only one on a GPU.
        poisson: Word<PoissonMethod> = PoissonMethod::ALL[0].name(),
            PoissonMethod::ALL.map(|method| (method.name(), method));
        /// Pixel pitch in micrometres, such as 5.5.
        pixel_pitch_um: f64 = 10.0, PositiveUpTo(1000.0);
        /// Temporal noise of one read, electrons rms; 0 turns it off.
        read_noise_e_rms: f64 = 10.0, Within(0.0, 1e6);
        /// Mean dark current, electrons per second and pixel, at dark_temperature_c; 0 turns it off.
        dark_e_per_s: f64 = 10.0, Within(0.0, MOST_DARK_E_PER_S);
        /// Nanoamperes per square centimetre, such as 0.1; 0 turns it off.
        dark_current_na_per_cm2: f64 = Optional, Within(0.0, 1e6);
        /// Degrees Celsius at which the dark current was measured.
        dark_temperature_c: f64 = 20.0, CELSIUS;
        /// The detector's temperature in degrees Celsius; left out, it is dark_temperature_c.
        temperature_c: f64 = Computed("dark_temperature_c"), CELSIUS;
        /// Kelvin of warming that double the dark current, 5 to 10 for silicon.
        dark_doubling_k: f64 = DarkLaw::AT_REFERENCE.doubling_k, Positive;
        /// Rms share of the mean dark current: 20 % is 0.2; 0 turns it off.
        dark_nonuniformity: f64 = Silent(0.0), Within(0.0, 1.0);
        /// Photo-response non-uniformity, an rms fraction: 1 % is 0.01.
        prnu: f64 = 0.01, Within(0.0, 0.5);
        /// The same from peak to peak, in place of prnu.
        prnu_pp: f64 = Optional, NotNegative, "a peak-to-peak figure; over pp_sigmas it is the rms";
        /// Dark-signal non-uniformity of one frame, electrons rms; 0 turns it off.
        dsnu_e_rms: f64 = 1.0, NotNegative;
        /// The same from peak to peak, in place of dsnu_e_rms.
        dsnu_e_pp: f64 = Optional, NotNegative, "a peak-to-peak figure; over pp_sigmas it is the rms";
        /// Standard deviations from peak to peak, usually 5 to 6.
        pp_sigmas: f64 = Silent(6.0), Within(1.0, 20.0);
        /// Electrons per photon, a mean over the band with the fill factor: 45 % is 0.45.
        quantum_efficiency: f64 = 0.5, PositiveUpTo(1.0);
        tables:
        /// A colour filter before each pixel.
        colour_filter: Option<ColourFilterKeys>;
        /// Hot, dead and blinking pixels, drawn at random.
        defects: Option<DefectsKeys>;
        /// Tracks of protons.
        protons: Option<ProtonsKeys>;
        /// Charge that comes with the next frame.
        image_lag: Option<ImageLagKeys>;
        /// Charge above the full well that spills into the column.
        blooming: Option<BloomingKeys>;
        /// Charge that each transfer of a CCD leaves behind.
        charge_transfer: Option<ChargeTransferKeys>;
        /// Pixels that become one.
        binning: Option<BinningKeys>;
        /// The part of the sensor that is read.
        window: Option<WindowKeys>;
        /// Time delay and integration: charge that follows the image.
        tdi: Option<TdiKeys>;
        /// Fixed patterns of columns and rows.
        lines: LineKeys;
        /// Fixed patterns as FITS images of the detector's size.
        maps: MapKeys;
        /// Noise that a row shares.
        row_noise: RowNoiseKeys;
        /// Response to charge that is no straight line.
        nonlinearity: NonlinearityKeys;
    }
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
