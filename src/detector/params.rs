//! Detector parameters in the terms of EMVA 1288 and ECSS.

use crate::detector::poisson::PoissonMethod;

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
    /// Dark current at the stated temperature, e-/s.
    pub dark_e_per_s: f64,
    /// Photo-response non-uniformity, rms share.
    pub prnu: f64,
    /// Dark-signal non-uniformity, e- rms.
    pub dsnu_e_rms: f64,
    /// How shot noise is drawn; a GPU knows [`PoissonMethod::Auto`] only.
    pub poisson: PoissonMethod,
}

impl DetectorParams {
    /// Shot noise alone, one electron per number, 16 bits: every other effect is off. For `..` in literals.
    pub const QUIET: Self = Self {
        full_well_e: 1e7,
        gain_e_per_dn: 1.0,
        bits: 16,
        black_level_dn: 0.0,
        read_noise_e_rms: 0.0,
        dark_e_per_s: 0.0,
        prnu: 0.0,
        dsnu_e_rms: 0.0,
        poisson: PoissonMethod::Auto,
    };

    /// Largest digital number.
    #[must_use]
    pub fn largest_dn(&self) -> u16 {
        u16::try_from((1_u32 << self.bits.min(16)) - 1).unwrap_or(u16::MAX)
    }
}

/// The parameters as the inner loops (and the GPU's uniform buffer) want them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Constants {
    /// Stray light of one exposure, e-.
    pub stray_light_e: f32,
    /// Dark signal of one exposure, e-.
    pub dark_e: f32,
    /// Saturation capacity, e-.
    pub full_well_e: f32,
    /// Read noise, e- rms.
    pub read_noise_e: f32,
    /// Digital numbers per electron.
    pub dn_per_e: f32,
    /// Black level, DN.
    pub black_dn: f32,
    /// Largest digital number.
    pub largest_dn: f32,
}

impl Constants {
    /// With a dark current so many times larger.
    #[must_use]
    #[allow(clippy::cast_possible_truncation, reason = "the inner loops work in single precision")]
    pub fn warmed(self, dark_factor: f64) -> Self {
        Self { dark_e: (f64::from(self.dark_e) * dark_factor) as f32, ..self }
    }

    /// For one exposure with so many electrons of stray light in every pixel.
    #[must_use]
    #[allow(clippy::cast_possible_truncation, reason = "the inner loops work in single precision")]
    pub fn new(params: &DetectorParams, exposure_s: f64, stray_light_e: f32) -> Self {
        Self {
            stray_light_e,
            dark_e: (params.dark_e_per_s * exposure_s) as f32,
            full_well_e: params.full_well_e as f32,
            read_noise_e: params.read_noise_e_rms as f32,
            dn_per_e: (1.0 / params.gain_e_per_dn) as f32,
            black_dn: params.black_level_dn as f32,
            largest_dn: f32::from(params.largest_dn()),
        }
    }
}
