//! What a laboratory would write down of a detector, and how it compares with what was asked for.

/// One level of light, less the dark level.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LightPoint {
    /// Electrons that light makes in every pixel.
    pub light_e: f64,
    /// Mean signal, DN.
    pub signal_dn: f64,
    /// Temporal variance more than in the dark, DN^2.
    pub variance_dn2: f64,
    /// Temporal variance with that of the dark, DN^2.
    pub total_variance_dn2: f64,
}

/// Measured properties of a detector.
#[derive(Debug, Clone, PartialEq)]
pub struct DataSheet {
    /// Electrons per digital number (EMVA: 1/K).
    pub gain_e_per_dn: f64,
    /// Mean of a dark image of no exposure, DN.
    pub black_level_dn: f64,
    /// Noise of a read, e- rms.
    pub read_noise_e_rms: f64,
    /// Dark current, e-/s.
    pub dark_e_per_s: f64,
    /// Spread of the pixels' dark means (EMVA: DSNU), e- rms.
    pub dsnu_e_rms: f64,
    /// Spread of the pixels' responses at half saturation (EMVA: PRNU), rms share.
    pub prnu: f64,
    /// Plateau over the dark level, e-.
    pub saturation_e: f64,
    /// Electrons counted per electron that light made: 1 when gain and signal agree.
    pub responsivity: f64,
    /// Largest deviation from a straight line between 5 and 95 % of saturation, relative.
    pub linearity_error: f64,
    /// The photon transfer curve.
    pub points: Vec<LightPoint>,
}
