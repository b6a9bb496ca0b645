//! Parameters of a detector and conditions of an exposure -> the numbers of the inner loops.

use crate::detector::{conditions::DetectorConditions, nonlinearity::Pieces, params::DetectorParams};

/// The parameters as the inner loops (and the GPU) want them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Constants {
    /// Stray light of one exposure, e-.
    pub stray_light_e: f32,
    /// Dark signal of one exposure, e-.
    pub dark_e: f32,
    /// Saturation capacity, e-.
    pub full_well_e: f32,
    /// Read and amplifier noise, e- rms.
    pub read_noise_e: f32,
    /// Digital numbers per electron.
    pub dn_per_e: f32,
    /// Black level, DN.
    pub black_dn: f32,
    /// Number that is added before the fraction is cut off, DN.
    pub rounding_dn: f32,
    /// Largest digital number.
    pub largest_dn: f32,
    /// Response to charge, where there is one.
    pub nonlinearity: Option<Pieces>,
}

impl Constants {
    /// Returns the numbers of one exposure with so many electrons of background in every pixel.
    #[allow(clippy::cast_possible_truncation, reason = "the inner loops work in single precision")]
    pub fn new(params: &DetectorParams, conditions: &DetectorConditions, stray_light_e: f32) -> Self {
        let [gain_e_per_dn, black_level_dn] = conditions.gain_and_black(params);
        let dark_e_per_s = params.dark_e_per_s * params.dark_law.warmer_by(conditions.warmer_k).factor();
        Self {
            stray_light_e,
            dark_e: (dark_e_per_s * conditions.exposure_s) as f32,
            full_well_e: params.full_well_e as f32,
            read_noise_e: params.readout_noise_e_rms() as f32,
            dn_per_e: (1.0 / gain_e_per_dn) as f32,
            black_dn: black_level_dn as f32,
            rounding_dn: params.rounding.dn(),
            largest_dn: f32::from(params.largest_dn()),
            nonlinearity: params.nonlinearity.is_on().then(|| params.nonlinearity.pieces()),
        }
    }
}
