//! `[mtf]`: the links of the chain whose star `[psf] model = "chain"` draws.
//!
//! Every key left out is off. Diffraction is always on (`[psf]` has its F-number and obscuration), the pixel too. The
//! light is one wavelength (`psf.wavelength_nm`), or the camera's `[band]` for a star of colour `psf.bp_rp`.

use crate::check::{Checker, Rule};
use crate::detector::Detector;
use crate::error::ConfigError;
use crate::optics::{DEFAULT_WAVELENGTH_NM, LARGEST_OBSCURATION, Optics, Psf};
use image::detector::tdi::Tdi;
use plan::optics::mtf::circuit::{Circuit, LOWEST_CUTOFF};
use plan::optics::mtf::diffusion::{Diffusion, Layers, Side};
use plan::optics::mtf::{ChainParams, Defocus, DefocusForm, MtfChain, MtfError, TdiBlur, Wavefront};
use plan::optics::{Band, SpectralWeight};
use serde::Deserialize;

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

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct MtfKeys {
    wavefront_error_waves: Option<f64>,
    wavefront_wavelength_nm: Option<f64>,
    defocus_um: Option<f64>,
    defocus_model: Option<String>,
    assembly_um: Option<f64>,
    fabrication_um: Option<f64>,
    diffusion_um: Option<f64>,
    depletion_um: Option<f64>,
    diffusion_length_um: Option<f64>,
    field_free_um: Option<f64>,
    pixel_aperture: Option<f64>,
    tdi_phases: Option<i64>,
    tdi_mismatch_px: Option<f64>,
    circuit_cutoff: Option<f64>,
    circuit_order: Option<i64>,
}

/// What `[psf]` says of a chain's lens and light.
#[derive(Debug)]
pub(super) struct LensKeys {
    pub(super) f_number: Option<f64>,
    pub(super) wavelength_nm: Option<f64>,
    pub(super) obscuration: Option<f64>,
    pub(super) bp_rp: Option<f64>,
}

impl Chain {
    /// Checks every link by itself; [`Self::take_light`] checks them in the light of the camera.
    pub(super) fn check(
        lens: &LensKeys,
        keys: Option<&MtfKeys>,
        optics: &Optics,
        detector: &Detector,
        check: &mut Checker<'_>,
    ) -> Result<Self, ConfigError> {
        let none = MtfKeys::default();
        let keys = keys.unwrap_or(&none);
        let advice = "focal length over aperture; leave it out to take that of [optics]";
        let own = optics.focal_length_mm / optics.aperture_mm;
        let f_number = check.number("psf.f_number", lens.f_number, own, Rule::Within(0.3, 1000.0), advice)?;
        let advice = "a ratio of diameters; leave it out to take that of [optics]";
        let rule = Rule::Within(0.0, LARGEST_OBSCURATION);
        let obscuration = check.number("psf.obscuration", lens.obscuration, optics.obscuration, rule, advice)?;
        let light = light(lens, check)?;
        let blur = |key: &str, given: Option<f64>| {
            let advice = "a standard deviation on the detector in um, such as 1.5; leave it out for none";
            given.map_or(Ok(0.0), |um| check.meets(&format!("mtf.{key}"), um, Rule::Within(0.0, 1e3), advice))
        };
        let assembly_um = blur("assembly_um", keys.assembly_um)?;
        let fabrication_um = blur("fabrication_um", keys.fabrication_um)?;
        let advice = "width of the sensitive square over the pitch: the square root of the fill factor";
        let aperture_px = keys
            .pixel_aperture
            .map_or(Ok(1.0), |width_px| check.meets("mtf.pixel_aperture", width_px, Rule::PositiveUpTo(1.0), advice))?;
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
            tdi: tdi(keys, detector.spatial.tdi, check)?,
            circuit: circuit(keys, check)?,
            band: Vec::new(),
        };
        Ok(Self { params, light })
    }

    /// The chain in its light; refuses what does not hold there.
    pub(super) fn take_light(&mut self, band: Option<&Band>, check: &Checker<'_>) -> Result<(), ConfigError> {
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
pub(super) fn belongs_to_chain(keys: Option<&MtfKeys>, psf: &Psf, check: &Checker<'_>) -> Result<(), ConfigError> {
    check.unused("mtf", keys.is_some() && !matches!(psf, Psf::Chain(_)), "psf.model = \"chain\"")
}

/// One wavelength, or a colour in the band.
fn light(lens: &LensKeys, check: &mut Checker<'_>) -> Result<LightOfChain, ConfigError> {
    if let Some(bp_rp) = lens.bp_rp {
        let owner = "one wavelength; psf.bp_rp asks for the whole band: keep one of the two";
        check.unused("psf.wavelength_nm", lens.wavelength_nm.is_some(), owner)?;
        let advice = "Gaia BP-RP of the star that the PSF is for, such as the Sun's, 0.82";
        return check.meets("psf.bp_rp", bp_rp, Rule::Within(-1.0, 7.0), advice).map(LightOfChain::Color);
    }
    let (rule, advice) = (Rule::Within(100.0, 20_000.0), "effective wavelength in nanometres, such as 620");
    let nm = check.number("psf.wavelength_nm", lens.wavelength_nm, DEFAULT_WAVELENGTH_NM, rule, advice)?;
    Ok(LightOfChain::Wavelength(nm))
}

/// The key to blame for what a chain refuses.
fn refused(error: &MtfError, check: &Checker<'_>) -> ConfigError {
    let key = match error {
        MtfError::Wavefront { .. } => "mtf.wavefront_error_waves",
        MtfError::Defocus { .. } => "mtf.defocus_um",
        MtfError::Band { .. } => "psf.bp_rp",
        MtfError::Number { .. } => "mtf",
    };
    check.invalid(key, "refused", "a chain that holds in its light", &error.to_string())
}

fn wavefront(keys: &MtfKeys, light: LightOfChain, check: &mut Checker<'_>) -> Result<Option<Wavefront>, ConfigError> {
    let Some(rms_waves) = keys.wavefront_error_waves else {
        let owner = "mtf.wavefront_error_waves";
        check.unused("mtf.wavefront_wavelength_nm", keys.wavefront_wavelength_nm.is_some(), owner)?;
        return Ok(None);
    };
    let advice = "waves rms over the pupil, such as 0.05; the aberration term ends at 0.18";
    let rms_waves = check.meets("mtf.wavefront_error_waves", rms_waves, Rule::Within(0.0, 0.18), advice)?;
    let default_nm = if let LightOfChain::Wavelength(nm) = light { nm } else { 632.8 };
    let advice = "wavelength of the measurement in nanometres, such as 632.8";
    let rule = Rule::Within(100.0, 20_000.0);
    let given = keys.wavefront_wavelength_nm;
    let at_nm = check.number("mtf.wavefront_wavelength_nm", given, default_nm, rule, advice)?;
    Ok(Some(Wavefront { rms_waves, at_nm }))
}

fn defocus(keys: &MtfKeys, check: &mut Checker<'_>) -> Result<Option<Defocus>, ConfigError> {
    let Some(defocus_um) = keys.defocus_um else {
        check.unused("mtf.defocus_model", keys.defocus_model.is_some(), "mtf.defocus_um")?;
        return Ok(None);
    };
    let advice = "image plane to focus in um, such as 20; leave it out in focus";
    let defocus_um = check.meets("mtf.defocus_um", defocus_um, Rule::Within(-1e5, 1e5), advice)?;
    let forms = [("exact", DefocusForm::Exact), ("geometric", DefocusForm::Geometric)];
    let advice = "exact holds up to 16 waves; geometric is the blur disc of rays";
    let form = check.choice("mtf.defocus_model", keys.defocus_model.as_deref(), &forms, advice)?;
    Ok(Some(Defocus { defocus_um, form }))
}

fn diffusion(keys: &MtfKeys, check: &Checker<'_>) -> Result<Option<Diffusion>, ConfigError> {
    let is_layered = [keys.depletion_um, keys.diffusion_length_um, keys.field_free_um].iter().any(Option::is_some);
    if let Some(sigma_um) = keys.diffusion_um {
        let owner = "a layered detector, which has no mtf.diffusion_um: keep one of the two";
        check.unused("mtf.depletion_um", keys.depletion_um.is_some(), owner)?;
        check.unused("mtf.diffusion_length_um", keys.diffusion_length_um.is_some(), owner)?;
        check.unused("mtf.field_free_um", keys.field_free_um.is_some(), owner)?;
        let advice = "standard deviation of the charge's spread in um, such as 2; leave it out for none";
        let sigma_um = check.meets("mtf.diffusion_um", sigma_um, Rule::Within(0.0, 1e3), advice)?;
        return Ok(Some(Diffusion::Gaussian { sigma_um }));
    }
    if !is_layered {
        return Ok(None);
    }
    let advice = "a layered detector has depletion_um, diffusion_length_um and, lit from the back, field_free_um";
    let rule = Rule::Within(0.0, 1e3);
    let depletion_um = check.required("mtf.depletion_um", keys.depletion_um, rule, advice)?;
    let diffusion_length_um =
        check.required("mtf.diffusion_length_um", keys.diffusion_length_um, Rule::PositiveUpTo(1e4), advice)?;
    let side = match keys.field_free_um {
        None => Side::Front,
        Some(um) => {
            let field_free_um = check.meets("mtf.field_free_um", um, Rule::PositiveUpTo(1e3), advice)?;
            Side::Back { field_free_um }
        }
    };
    Ok(Some(Diffusion::Layered(Layers { depletion_um, diffusion_length_um, side })))
}

/// Blur of charge that follows the image; the stages are the detector's.
fn tdi(keys: &MtfKeys, detector: Option<Tdi>, check: &mut Checker<'_>) -> Result<Option<TdiBlur>, ConfigError> {
    let Some(Tdi { stages }) = detector else {
        let owner = "[detector.tdi]";
        check.unused("mtf.tdi_phases", keys.tdi_phases.is_some(), owner)?;
        check.unused("mtf.tdi_mismatch_px", keys.tdi_mismatch_px.is_some(), owner)?;
        return Ok(None);
    };
    let advice = "steps in which charge moves from row to row: 2, 3 or 4 for usual CCDs";
    let phases = check.whole("mtf.tdi_phases", keys.tdi_phases, Some(4), 1..=8, advice)?;
    let advice = "image against charge from one stage to the next, px, such as 0.01";
    let rule = Rule::Within(-1.0, 1.0);
    let mismatch_px = check.number("mtf.tdi_mismatch_px", keys.tdi_mismatch_px, 0.0, rule, advice)?;
    Ok(Some(TdiBlur { stages, phases, mismatch_px }))
}

fn circuit(keys: &MtfKeys, check: &mut Checker<'_>) -> Result<Option<Circuit>, ConfigError> {
    let Some(cutoff) = keys.circuit_cutoff else {
        check.unused("mtf.circuit_order", keys.circuit_order.is_some(), "mtf.circuit_cutoff")?;
        return Ok(None);
    };
    let advice = "bandwidth of the readout over its pixel rate, cycles/px, such as 2";
    let cutoff = check.meets("mtf.circuit_cutoff", cutoff, Rule::Within(LOWEST_CUTOFF, 1e3), advice)?;
    let order = check.whole("mtf.circuit_order", keys.circuit_order, Some(1), 1..=8, "poles; 1 for RC")?;
    Ok(Some(Circuit { cutoff, order }))
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
