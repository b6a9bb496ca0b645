//! Parameters of a chain, and the domains of their values.
//!
//! In: numbers in the units of their names. Out: the same, or the first one outside its domain ([`MtfError`]). Limits
//! that depend on the wavelength (wavefront error, defocus, absorption) are checked with the chain, wavelength by
//! wavelength.

use crate::optics::mtf::blur::{Circuit, LOWEST_CUTOFF};
use crate::optics::mtf::diffusion::Diffusion;
use crate::optics::{Band, SpectralWeight, spectral_weights};

/// Largest deviation of a band's shares from a sum of 1: the rounding of printed weights.
const WEIGHT_SUM: f64 = 1e-6;

/// Number of wavelengths that represent a band. Four times as many change no pixel by more than 1e-5 of the flux
/// (`tests/physics/psf_chain.rs`).
pub const WAVELENGTHS: usize = 16;

/// Form of the defocus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DefocusForm {
    /// Autocorrelation of the defocused pupil.
    Exact,
    /// Diffraction times the transform of the blur disc.
    Geometric,
}

/// A focus error.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Defocus {
    /// Distance from image plane to focus, um; the sign has no effect on the star.
    pub defocus_um: f64,
    /// Its form.
    pub form: DefocusForm,
}

/// Wavefront error of the optics besides defocus: the same path length at every wavelength.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wavefront {
    /// RMS over the pupil, waves.
    pub rms_waves: f64,
    /// Wavelength at which it is given, nm.
    pub at_nm: f64,
}

/// Time-delayed integration: charge that follows the image along the columns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TdiBlur {
    /// Number of rows that are summed.
    pub stages: u32,
    /// Number of steps in which charge moves from row to row.
    pub phases: u32,
    /// Motion of the image relative to the charge from one stage to the next, px.
    pub mismatch_px: f64,
}

/// Parameters of a chain; `None` and 0 are off.
#[derive(Debug, Clone, PartialEq)]
pub struct ChainParams {
    /// Pixel pitch, um.
    pub pixel_pitch_um: f64,
    /// Focal length over aperture.
    pub f_number: f64,
    /// Linear central obscuration.
    pub obscuration: f64,
    /// Aberrations.
    pub wavefront: Option<Wavefront>,
    /// Focus error.
    pub defocus: Option<Defocus>,
    /// Blur of assembly, standard deviation on the detector, um.
    pub assembly_um: f64,
    /// Blur of fabrication, standard deviation on the detector, um.
    pub fabrication_um: f64,
    /// Charge diffusion.
    pub diffusion: Option<Diffusion>,
    /// Width of the pixel's sensitive square, px.
    pub aperture_px: f64,
    /// Charge that follows the image.
    pub tdi: Option<TdiBlur>,
    /// Bandwidth of the readout.
    pub circuit: Option<Circuit>,
    /// The light: one wavelength, or a band.
    pub band: Vec<SpectralWeight>,
}

impl ChainParams {
    /// Returns parameters with only the diffraction and the pixel at one wavelength.
    pub fn diffraction(pixel_pitch_um: f64, f_number: f64, obscuration: f64, wavelength_nm: f64) -> Self {
        Self {
            pixel_pitch_um,
            f_number,
            obscuration,
            wavefront: None,
            defocus: None,
            assembly_um: 0.0,
            fabrication_um: 0.0,
            diffusion: None,
            aperture_px: 1.0,
            tdi: None,
            circuit: None,
            band: vec![SpectralWeight { wavelength_nm, weight: 1.0 }],
        }
    }

    /// Returns the same parameters in a band, for a star of this BP-RP.
    pub fn in_band(&self, band: &Band, bp_rp: f64) -> Self {
        Self { band: spectral_weights(band, bp_rp, WAVELENGTHS), ..self.clone() }
    }

    /// Refuses numbers outside their domain for any light.
    pub(super) fn check(&self) -> Result<(), MtfError> {
        check_numbers(self)?;
        check_band(&self.band)
    }
}

fn check_numbers(p: &ChainParams) -> Result<(), MtfError> {
    let check = |what, got: f64, is_met: bool, wanted, advice| {
        if is_met && got.is_finite() { Ok(()) } else { Err(MtfError::Number { what, got, wanted, advice }) }
    };
    let blur = "a standard deviation on the detector, such as 1.5; 0 for none";
    check("the pixel pitch (um)", p.pixel_pitch_um, p.pixel_pitch_um > 0.0, "more than 0", "such as 5.5")?;
    check("the F-number", p.f_number, p.f_number >= 0.3, "0.3 or more", "focal length over aperture")?;
    let is_ring = (0.0..1.0).contains(&p.obscuration);
    check("the obscuration", p.obscuration, is_ring, "0 to below 1", "a ratio of diameters; 0 for a lens")?;
    check("the blur of assembly (um)", p.assembly_um, p.assembly_um >= 0.0, "0 or more", blur)?;
    check("the blur of fabrication (um)", p.fabrication_um, p.fabrication_um >= 0.0, "0 or more", blur)?;
    let is_pixel = p.aperture_px > 0.0 && p.aperture_px <= 1.0;
    check("the pixel's sensitive width (px)", p.aperture_px, is_pixel, "above 0, up to 1", "1 for the whole pixel")?;
    if let Some(TdiBlur { stages, phases, mismatch_px }) = p.tdi {
        check("the TDI stages", f64::from(stages), stages > 0, "1 or more", "rows that add up")?;
        check("the TDI phases", f64::from(phases), phases > 0, "1 or more", "2, 3 or 4 for usual CCDs")?;
        let is_slip = mismatch_px.abs() <= 1.0;
        check("the TDI mismatch (px)", mismatch_px, is_slip, "-1 to 1", "of one stage, such as 0.01")?;
    }
    if let Some(low_pass) = p.circuit {
        let is_wide = low_pass.cutoff >= LOWEST_CUTOFF;
        check(
            "the circuit's cutoff (cycles/px)",
            low_pass.cutoff,
            is_wide,
            "0.1 or more",
            "bandwidth over pixel rate",
        )?;
        let order = f64::from(low_pass.order);
        check("the circuit's order", order, (1..=8).contains(&low_pass.order), "1 to 8", "1 for RC")?;
    }
    Ok(())
}

fn check_band(band: &[SpectralWeight]) -> Result<(), MtfError> {
    if band.is_empty() {
        return Err(MtfError::Band { why: "missing".into() });
    }
    let sum: f64 = band.iter().map(|light| light.weight).sum();
    let is_light = |light: &SpectralWeight| {
        light.weight >= 0.0 && light.wavelength_nm > 0.0 && (light.weight + light.wavelength_nm).is_finite()
    };
    if let Some(bad) = band.iter().find(|light| !is_light(light)) {
        return Err(MtfError::Band { why: format!("{} at {} nm", bad.weight, bad.wavelength_nm) });
    }
    if (sum - 1.0).abs() <= WEIGHT_SUM { Ok(()) } else { Err(MtfError::Band { why: format!("of sum {sum}") }) }
}

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
