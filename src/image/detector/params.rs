//! Detector parameters in the terms of EMVA 1288 and ECSS.

use crate::detector::{
    dark_current::DarkLaw, line_pattern::LinePattern, nonlinearity::Nonlinearity, poisson::PoissonMethod,
    rounding::Rounding, row_noise::RowNoise, spatial::SpatialParams,
};

/// One detector.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DetectorParams {
    /// Saturation capacity, e-.
    pub full_well_e: f64,
    /// Electrons per digital number (the reciprocal of EMVA's K).
    pub gain_e_per_dn: f64,
    /// Bits of the ADC, 1 to 16.
    pub bits: u32,
    /// Digital number of zero electrons.
    pub black_level_dn: f64,
    /// Temporal noise of the readout, e- rms.
    pub read_noise_e_rms: f64,
    /// Noise of the amplifiers after the pixel, e- rms; in quadrature with the read noise.
    pub amplifier_noise_e_rms: f64,
    /// Mean dark current at the reference temperature of `dark_law`, e-/s.
    pub dark_e_per_s: f64,
    /// Law by which the dark current follows the detector's temperature.
    pub dark_law: DarkLaw,
    /// Dark-current non-uniformity, rms share of the mean: grows with exposure and temperature.
    pub dark_nonuniformity: f64,
    /// Photo-response non-uniformity, rms share.
    pub prnu: f64,
    /// Dark-signal non-uniformity, e- rms: an offset that does not depend on exposure or temperature.
    pub dsnu_e_rms: f64,
    /// Response to charge.
    pub nonlinearity: Nonlinearity,
    /// Fixed patterns of columns and rows.
    pub line_pattern: LinePattern,
    /// Noise that a row shares.
    pub row_noise: RowNoise,
    /// Rounding of the ADC.
    pub rounding: Rounding,
    /// Method of drawing shot noise; a GPU supports [`PoissonMethod::Auto`] only.
    pub poisson: PoissonMethod,
    /// Defects, protons, and the effects of more than one pixel or one frame.
    pub spatial: SpatialParams,
}

impl DetectorParams {
    /// Shot noise alone, one electron per number, 16 bits: every other effect is off. For `..` in literals.
    pub const QUIET: Self = Self {
        full_well_e: 1e7,
        gain_e_per_dn: 1.0,
        bits: 16,
        black_level_dn: 0.0,
        read_noise_e_rms: 0.0,
        amplifier_noise_e_rms: 0.0,
        dark_e_per_s: 0.0,
        dark_law: DarkLaw::AT_REFERENCE,
        dark_nonuniformity: 0.0,
        prnu: 0.0,
        dsnu_e_rms: 0.0,
        nonlinearity: Nonlinearity::OFF,
        line_pattern: LinePattern::OFF,
        row_noise: RowNoise::OFF,
        rounding: Rounding::Nearest,
        poisson: PoissonMethod::Auto,
        spatial: SpatialParams::OFF,
    };

    /// Returns the largest digital number.
    pub fn largest_dn(&self) -> u16 {
        u16::try_from((1_u32 << self.bits.min(16)) - 1).unwrap_or(u16::MAX)
    }

    /// Returns electrons at which the converter clips.
    pub fn converter_full_e(&self) -> f64 {
        (f64::from(self.largest_dn()) - self.black_level_dn) * self.gain_e_per_dn
    }

    /// Returns the same, when that is below the full well.
    pub fn converter_clips_at_e(&self) -> Option<f64> {
        Some(self.converter_full_e()).filter(|e| *e < self.full_well_e)
    }

    /// Returns electrons of one LSB of a converter that ends where the pixel does: `full well / 2^bits`.
    pub fn lsb_e(full_well_e: f64, bits: u32) -> f64 {
        full_well_e / f64::from(1_u32 << bits.min(16))
    }

    /// Returns the mean dark current at the detector's temperature, e-/s.
    pub fn operating_dark_e_per_s(&self) -> f64 {
        self.dark_e_per_s * self.dark_law.factor()
    }

    /// Returns the noise of a pixel's readout from frame to frame, that which its row shares included, e- rms.
    pub fn temporal_noise_e_rms(&self) -> f64 {
        let row_e2 = if self.row_noise.is_on() { self.row_noise.variance_e2() } else { 0.0 };
        self.readout_noise_e_rms().hypot(row_e2.sqrt())
    }

    /// Returns the white noise of a pixel's readout: read and amplifier noise, e- rms.
    pub fn readout_noise_e_rms(&self) -> f64 {
        if self.amplifier_noise_e_rms == 0.0 {
            return self.read_noise_e_rms;
        }
        self.read_noise_e_rms.hypot(self.amplifier_noise_e_rms)
    }
}
