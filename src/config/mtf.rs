//! `[mtf]`: the links of the chain whose star `[psf] model = "chain"` draws.
//!
//! Every key left out is off. Diffraction is always on (`[psf]` has its F-number and obscuration), the pixel too. The
//! light is one wavelength (`psf.wavelength_nm`), or the camera's `[band]` for a star of colour `psf.bp_rp`.

use crate::error::{ConfigError, Result};
use crate::key::{Section, section, taken};
use crate::key_type::{Whole, Word};
use crate::psf::{Psf, PsfKeys};
use crate::{check::Checker, detector::Detector, optics::Optics};
use image::detector::tdi::Tdi;
use plan::optics::mtf::blur::{Circuit, LOWEST_CUTOFF};
use plan::optics::mtf::diffusion::{Diffusion, Layers, Side};
use plan::optics::mtf::{ChainParams, Defocus, DefocusForm, MtfChain, MtfError, TdiBlur, Wavefront};
use plan::optics::{Band, SpectralWeight};

/// Light in which the star is drawn.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LightOfChain {
    /// One wavelength, nm.
    Wavelength(f64),
    /// The camera's band, for a star of this BP-RP.
    Color(f64),
}

/// The chain, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Chain {
    /// Its links, in its light.
    pub params: ChainParams,
    /// The light.
    pub light: LightOfChain,
}

section! {
    /// Links of the chain of transfer functions that psf.model = "chain" draws; every key left out is off.
    MtfKeys at "mtf" {
        /// Wavefront error, waves rms over the pupil, such as 0.05; the aberration term ends at 0.18.
        wavefront_error_waves: f64 = Optional, Within(0.0, 0.18);
        /// Wavelength of the measurement in nanometres, such as 632.8.
        wavefront_wavelength_nm: f64 = Computed("psf.wavelength_nm, in a band 632.8"), Within(100.0, 20_000.0);
        /// Image plane to focus in um, such as 20; leave it out in focus.
        defocus_um: f64 = Optional, Within(-1e5, 1e5);
        /// Exact holds up to 16 waves; geometric is the blur disc of rays.
        defocus_model: Word<DefocusForm> = "exact",
            [("exact", DefocusForm::Exact), ("geometric", DefocusForm::Geometric)];
        /// Blur of the assembly, a standard deviation on the detector in um, such as 1.5; leave it out for none.
        assembly_um: f64 = Silent(0.0), Within(0.0, 1e3);
        /// Blur of the fabrication, a standard deviation on the detector in um, such as 1.5; leave it out for none.
        fabrication_um: f64 = Silent(0.0), Within(0.0, 1e3);
        /// Standard deviation of the charge's spread in um, such as 2; leave it out for none.
        diffusion_um: f64 = Optional, Within(0.0, 1e3);
        /// Depletion layer in um; a layered detector has diffusion_length_um too and, lit from the back, field_free_um.
        depletion_um: f64 = Optional, Within(0.0, 1e3);
        /// Diffusion length in um of a layered detector, which has depletion_um too.
        diffusion_length_um: f64 = Optional, PositiveUpTo(1e4);
        /// Field-free layer in um of a layered detector that is lit from the back.
        field_free_um: f64 = Optional, PositiveUpTo(1e3);
        /// Width of the sensitive square over the pitch: the square root of the fill factor.
        pixel_aperture: f64 = Silent(1.0), PositiveUpTo(1.0);
        /// Steps in which charge moves from row to row: 2, 3 or 4 for usual CCDs.
        tdi_phases: Whole = 4, 1..=8;
        /// Image against charge from one stage to the next, px, such as 0.01.
        tdi_mismatch_px: f64 = 0.0, Within(-1.0, 1.0);
        /// Bandwidth of the readout over its pixel rate, cycles/px, such as 2.
        circuit_cutoff: f64 = Optional, Within(LOWEST_CUTOFF, 1e3);
        /// Poles; 1 for RC.
        circuit_order: Whole = 1, 1..=8;
    }
}

impl Chain {
    /// Checks every link by itself; [`Self::take_light`] checks them in the light of the camera.
    pub(super) fn check(
        lens: &PsfKeys,
        keys: Option<&MtfKeys>,
        optics: &Optics,
        detector: &Detector,
        check: &mut Checker<'_>,
    ) -> Result<Self> {
        let none = MtfKeys::default();
        let keys = keys.unwrap_or(&none);
        let f_number = lens.f_number().or(optics.f_number()).check(check)?;
        let obscuration = lens.obscuration().or(optics.obscuration).check(check)?;
        let light = light(lens, check)?;
        taken!(check, keys => assembly_um, fabrication_um);
        let aperture_px = keys.pixel_aperture().check(check)?;
        let params = ChainParams {
            pixel_pitch_um: detector.pixel_pitch_um,
            f_number,
            obscuration,
            wavefront: wavefront(keys, light, check)?,
            defocus: defocus(keys, check)?,
            assembly_um,
            fabrication_um,
            diffusion: diffusion(keys, check)?,
            aperture_px,
            tdi: tdi(keys, detector.params.spatial.tdi, check)?,
            circuit: circuit(keys, check)?,
            band: Vec::new(),
        };
        Ok(Self { params, light })
    }

    /// Returns the chain in its light; refuses what does not hold there.
    pub(super) fn take_light(&mut self, band: Option<&Band>, check: &Checker<'_>) -> Result<()> {
        self.params.band = match (self.light, band) {
            (LightOfChain::Wavelength(nm), Some(band)) if band.response(nm) <= 0.0 => {
                let advice = "the detector counts no light there: give a wavelength of the band, or psf.bp_rp";
                return Err(check.invalid("psf.wavelength_nm", nm, "a wavelength inside [band]", advice));
            }
            (LightOfChain::Wavelength(wavelength_nm), _) => vec![SpectralWeight { wavelength_nm, weight: 1.0 }],
            (LightOfChain::Color(bp_rp), Some(band)) => self.params.in_band(band, bp_rp).band,
            (LightOfChain::Color(bp_rp), None) => {
                let advice = "give the camera's [band], or psf.wavelength_nm in place of psf.bp_rp";
                return Err(check.invalid("psf.bp_rp", bp_rp, "no colour without a [band]", advice));
            }
        };
        MtfChain::new(self.params.clone()).map(drop).map_err(|error| refused(&error, check))
    }
}

/// Refuses `[mtf]` beside another model than the chain.
pub(super) fn belongs_to_chain(keys: Option<&MtfKeys>, psf: &Psf, check: &Checker<'_>) -> Result<()> {
    check.unused("mtf", keys.is_some() && !matches!(psf, Psf::Chain(_)), "psf.model = \"chain\"")
}

/// Returns one wavelength, or a colour in the band.
fn light(lens: &PsfKeys, check: &mut Checker<'_>) -> Result<LightOfChain> {
    if lens.bp_rp().is_given() {
        let owner = "one wavelength; psf.bp_rp asks for the whole band: keep one of the two";
        lens.refuse(&["wavelength_nm"], owner, check)?;
        return lens.bp_rp().check(check).map(LightOfChain::Color);
    }
    lens.wavelength_nm().check(check).map(LightOfChain::Wavelength)
}

/// Returns the key to blame for what a chain refuses.
fn refused(error: &MtfError, check: &Checker<'_>) -> ConfigError {
    let key = match error {
        MtfError::Wavefront { .. } => "mtf.wavefront_error_waves",
        MtfError::Defocus { .. } => "mtf.defocus_um",
        MtfError::Band { .. } => "psf.bp_rp",
        MtfError::Number { .. } => "mtf",
    };
    check.invalid(key, "refused", "a chain that holds in its light", &error.to_string())
}

fn wavefront(keys: &MtfKeys, light: LightOfChain, check: &mut Checker<'_>) -> Result<Option<Wavefront>> {
    let Some(rms_waves) = keys.wavefront_error_waves().optional(check)? else {
        keys.refuse(&["wavefront_wavelength_nm"], "mtf.wavefront_error_waves", check)?;
        return Ok(None);
    };
    let default_nm = if let LightOfChain::Wavelength(nm) = light { nm } else { 632.8 };
    let at_nm = keys.wavefront_wavelength_nm().or(default_nm).check(check)?;
    Ok(Some(Wavefront { rms_waves, at_nm }))
}

fn defocus(keys: &MtfKeys, check: &mut Checker<'_>) -> Result<Option<Defocus>> {
    let Some(defocus_um) = keys.defocus_um().optional(check)? else {
        keys.refuse(&["defocus_model"], "mtf.defocus_um", check)?;
        return Ok(None);
    };
    Ok(Some(Defocus { defocus_um, form: keys.defocus_model().check(check)? }))
}

fn diffusion(keys: &MtfKeys, check: &mut Checker<'_>) -> Result<Option<Diffusion>> {
    let of_layers = ["depletion_um", "diffusion_length_um", "field_free_um"];
    if keys.diffusion_um().is_given() {
        let owner = "a layered detector, which has no mtf.diffusion_um: keep one of the two";
        keys.refuse(&of_layers, owner, check)?;
        return Ok(Some(Diffusion::Gaussian { sigma_um: keys.diffusion_um().check(check)? }));
    }
    if !keys.given().iter().any(|(key, is_given)| *is_given && of_layers.contains(key)) {
        return Ok(None);
    }
    taken!(check, keys => depletion_um, diffusion_length_um);
    let back = keys.field_free_um().optional(check)?;
    let side = back.map_or(Side::Front, |field_free_um| Side::Back { field_free_um });
    Ok(Some(Diffusion::Layered(Layers { depletion_um, diffusion_length_um, side })))
}

/// Returns the blur of charge that follows the image; the stages are the detector's.
fn tdi(keys: &MtfKeys, detector: Option<Tdi>, check: &mut Checker<'_>) -> Result<Option<TdiBlur>> {
    let Some(Tdi { stages }) = detector else {
        keys.refuse(&["tdi_phases", "tdi_mismatch_px"], "[detector.tdi]", check)?;
        return Ok(None);
    };
    let phases = keys.tdi_phases().check(check)?;
    Ok(Some(TdiBlur { stages, phases, mismatch_px: keys.tdi_mismatch_px().check(check)? }))
}

fn circuit(keys: &MtfKeys, check: &mut Checker<'_>) -> Result<Option<Circuit>> {
    let Some(cutoff) = keys.circuit_cutoff().optional(check)? else {
        keys.refuse(&["circuit_order"], "mtf.circuit_cutoff", check)?;
        return Ok(None);
    };
    Ok(Some(Circuit { cutoff, order: keys.circuit_order().check(check)? }))
}

#[cfg(test)]
mod tests {
    use crate::{Camera, ConfigError, Document, Psf};
    use plan::optics::mtf::TdiBlur;
    use std::path::Path;

    fn camera(psf: &str, mtf: &str) -> Result<Camera, ConfigError> {
        let text = format!(
            "[detector]\nwidth_px = 64\nheight_px = 64\npixel_pitch_um = 5.5\n[optics]\nfocal_length_mm = 50\n\
             aperture_mm = 25\n[psf]\n{psf}\n[mtf]\n{mtf}\n"
        );
        Camera::from_document(&Document::from_text(&text, Path::new("lab/cam.toml")))
    }

    fn refused(psf: &str, mtf: &str, parts: &[&str]) {
        let error = camera(psf, mtf).expect_err(mtf).to_string();
        assert!(error.contains("lab/cam.toml"), "names the file: {error}");
        for part in parts {
            assert!(error.contains(part), "says \"{part}\": {error}");
        }
    }

    const CHAIN: &str = "model = \"chain\"\nwavelength_nm = 620";

    #[test]
    fn a_chain_takes_its_lens_from_the_camera() {
        let loaded = camera(CHAIN, "wavefront_error_waves = 0.05\nassembly_um = 1.5").unwrap();
        let Psf::Chain(chain) = &loaded.psf else { panic!("{:?}", loaded.psf) };
        let p = &chain.params;
        assert_eq!((p.f_number, p.obscuration, p.pixel_pitch_um, p.assembly_um), (2.0, 0.0, 5.5, 1.5));
        assert_eq!(p.wavefront.map(|w| (w.rms_waves, w.at_nm)), Some((0.05, 620.0)), "measured where it is used");
        assert_eq!((p.defocus, p.diffusion, p.circuit, p.aperture_px), (None, None, None, 1.0), "off");
        assert_eq!(p.band.len(), 1, "one wavelength");
    }

    #[test]
    fn the_detector_has_the_stages_of_a_tdi_blur() {
        let loaded = camera(CHAIN, "tdi_mismatch_px = 0.05\n[detector.tdi]\nstages = 16").unwrap();
        let Psf::Chain(chain) = &loaded.psf else { panic!("{:?}", loaded.psf) };
        assert_eq!(chain.params.tdi, Some(TdiBlur { stages: 16, phases: 4, mismatch_px: 0.05 }));
    }

    #[test]
    fn contradictions_are_refused_with_what_to_try() {
        refused("model = \"gaussian\"", "assembly_um = 1", &["mtf", "model = \"chain\""]);
        refused(CHAIN, "wavefront_error_waves = 0.2", &["mtf.wavefront_error_waves", "0.18"]);
        refused(CHAIN, "wavefront_wavelength_nm = 633", &["mtf.wavefront_wavelength_nm", "wavefront_error_waves"]);
        // 0.12 waves at 632.8 nm are 0.19 at 400 nm.
        let blue = "model = \"chain\"\nwavelength_nm = 400";
        let error = "wavefront_error_waves = 0.12\nwavefront_wavelength_nm = 632.8";
        refused(blue, error, &["mtf.wavefront_error_waves", "0.190 waves", "400 nm"]);
        refused(CHAIN, "defocus_um = 20\ndefocus_model = \"geometric\"", &["mtf.defocus_um", "exact"]);
        refused(CHAIN, "defocus_um = 400", &["mtf.defocus_um", "20.161 waves", "geometric"]);
        refused(CHAIN, "defocus_model = \"exact\"", &["mtf.defocus_model", "mtf.defocus_um"]);
        refused(CHAIN, "diffusion_um = 1\ndepletion_um = 5", &["mtf.depletion_um", "keep one of the two"]);
        refused(CHAIN, "depletion_um = 5", &["mtf.diffusion_length_um", "missing"]);
        refused(CHAIN, "circuit_cutoff = 0.05", &["mtf.circuit_cutoff", "0.1"]);
        refused(CHAIN, "circuit_order = 2", &["mtf.circuit_order", "mtf.circuit_cutoff"]);
        refused(CHAIN, "tdi_phases = 3", &["mtf.tdi_phases", "[detector.tdi]"]);
        refused(CHAIN, "tdi_mismatch_px = 0.1", &["mtf.tdi_mismatch_px", "[detector.tdi]"]);
        let tdi = "[detector.tdi]\nstages = 16";
        refused(CHAIN, &format!("tdi_mismatch_px = 2\n{tdi}"), &["mtf.tdi_mismatch_px", "-1 to 1"]);
        refused(CHAIN, "pixel_aperture = 1.2", &["mtf.pixel_aperture", "up to 1"]);
        refused("model = \"chain\"\nbp_rp = 0.8", "", &["psf.bp_rp", "[band]"]);
        refused("model = \"chain\"\nbp_rp = 0.8\nwavelength_nm = 600", "", &["psf.wavelength_nm", "keep one"]);
        let far = "model = \"chain\"\nwavelength_nm = 1500";
        refused(far, "depletion_um = 5\ndiffusion_length_um = 50", &["1500", "300 to 1100"]);
    }
}
