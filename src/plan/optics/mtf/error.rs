//! Errors in the parameters of a chain of transfer functions.

/// A chain that was refused.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum MtfError {
    /// A number outside its domain.
    #[error("{what} is {got}; wanted {wanted}: {advice}")]
    Number {
        /// The number, with its unit.
        what: &'static str,
        /// Given value.
        got: f64,
        /// The domain.
        wanted: &'static str,
        /// Advice for the user.
        advice: &'static str,
    },
    /// More wavefront error than the empirical aberration term holds for.
    #[error(
        "the wavefront error is {rms_waves:.3} waves rms at {wavelength_nm:.0} nm; wanted at most {limit}, where \
         Shannon's aberration term ends: give a smaller one, or a measured PSF"
    )]
    Wavefront {
        /// At that wavelength, waves rms.
        rms_waves: f64,
        /// The wavelength, nm.
        wavelength_nm: f64,
        /// Largest accepted value, waves rms.
        limit: f64,
    },
    /// Defocus outside the domain of its form.
    #[error(
        "a defocus of {defocus_um} um is {w20_waves:.3} waves at {wavelength_nm:.0} nm; wanted {wanted} for the {form} \
         form: {advice}"
    )]
    Defocus {
        /// Image plane to focus, um.
        defocus_um: f64,
        /// Wavefront error at the edge of the pupil, waves.
        w20_waves: f64,
        /// The wavelength, nm.
        wavelength_nm: f64,
        /// Domain of the form.
        wanted: &'static str,
        /// Exact or geometric.
        form: &'static str,
        /// Advice for the user.
        advice: &'static str,
    },
    /// An invalid band.
    #[error("the band's weights are {why}; wanted positive shares that sum to 1: take those of the camera's band")]
    Band {
        /// Description of the error.
        why: String,
    },
}
