//! The chain: product of optics, detector and circuit, for one wavelength or over a band.
//!
//! [`ChainParams`] (checked once) -> [`MtfChain`]: frequency `[fx, fy]` (cycles/px) -> each [`Term`] and the product.
//! Over a band, factors that depend on the wavelength are averaged with the band's shares of electrons, as intensities
//! add: `sum_k weight_k diffraction_k aberration_k defocus_k diffusion_k`, times the other terms. A table of terms
//! shows each term's own mean; the product is the mean of the products, not the product of those means.
//!
//! Limits: linear and the same everywhere on the detector; all terms real. Aberration times diffraction times exact
//! defocus assumes that the three are independent, as does Shannon's fit. Source: Holst, Electro-Optical Imaging System
//! Performance, 5th ed., for the product; Goodman, Introduction to Fourier Optics, 6.5, for the sum over a band. Unit
//! tests compare products with terms by hand; `tests/physics/psf_chain.rs` compares the drawn PSF with the chain.

use crate::optics::mtf::chain_params::{ChainParams, DefocusForm};
use crate::optics::mtf::defocus::{self, DefocusedPupil};
use crate::optics::mtf::{MtfError, aberration, blur, diffraction, motion};
use crate::optics::{SpectralWeight, mtf::diffusion::Diffusion};

base::words! {
    /// One link of the chain, in the order of light.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub enum Term {
        /// Pupil.
        Diffraction = "diffraction",
        /// Wavefront error.
        Aberration = "aberration",
        /// Focus error.
        Defocus = "defocus",
        /// Assembly.
        Assembly = "assembly",
        /// Fabrication.
        Fabrication = "fabrication",
        /// Charge diffusion.
        Diffusion = "charge diffusion",
        /// Pixel.
        Aperture = "pixel",
        /// Charge that follows the image along the columns.
        Tdi = "TDI",
        /// Readout.
        Circuit = "circuit",
    }
}

impl Term {
    /// Returns the direction of the factor in tables, `[x, y]`: TDI is along the columns, the circuit along the rows,
    /// others are the same along both.
    pub fn axis(self) -> [f64; 2] {
        if self == Self::Tdi { [0.0, 1.0] } else { [1.0, 0.0] }
    }
}

/// One wavelength of the band, ready to evaluate.
#[derive(Debug, Clone)]
struct Color {
    light: SpectralWeight,
    lambda_n_px: f64,
    rms_waves: f64,
    w20_waves: f64,
    /// The exact form; `None`: in focus, or geometric.
    pupil: Option<DefocusedPupil>,
}

/// A checked chain.
#[derive(Debug, Clone)]
pub struct MtfChain {
    params: ChainParams,
    colors: Vec<Color>,
}

impl MtfChain {
    /// Checks the parameters, and returns the chain.
    ///
    /// # Errors
    /// The first number outside its domain, for any wavelength of the band.
    pub fn new(params: ChainParams) -> Result<Self, MtfError> {
        params.check()?;
        let colors = params.band.iter().map(|light| Color::new(&params, *light)).collect::<Result<_, _>>()?;
        Ok(Self { params, colors })
    }

    /// Returns its parameters.
    pub fn params(&self) -> &ChainParams {
        &self.params
    }

    /// Returns the terms that are not off.
    pub fn terms(&self) -> impl Iterator<Item = Term> {
        Term::ALL.into_iter().filter(|term| self.is_on(*term))
    }

    /// Returns true when columns and rows differ.
    pub fn has_axes(&self) -> bool {
        self.is_on(Term::Tdi) || self.is_on(Term::Circuit)
    }

    fn is_on(&self, term: Term) -> bool {
        let p = &self.params;
        match term {
            Term::Diffraction | Term::Aperture => true,
            Term::Aberration => p.wavefront.is_some(),
            Term::Defocus => p.defocus.is_some(),
            Term::Assembly => p.assembly_um > 0.0,
            Term::Fabrication => p.fabrication_um > 0.0,
            Term::Diffusion => p.diffusion.is_some(),
            Term::Tdi => p.tdi.is_some(),
            Term::Circuit => p.circuit.is_some(),
        }
    }

    /// Returns the factor of one term alone at `[fx, fy]`, over the band. Exact defocus is its effect on diffraction,
    /// as a ratio; beyond the cutoff, where both are zero, it is 1.
    pub fn term(&self, term: Term, frequency: [f64; 2]) -> f64 {
        let f = frequency[0].hypot(frequency[1]);
        let p = &self.params;
        let px = |um: f64| um / p.pixel_pitch_um;
        let mean = |of: &dyn Fn(&Color) -> f64| self.colors.iter().map(|c| c.light.weight * of(c)).sum::<f64>();
        match term {
            Term::Diffraction => mean(&|c| diffraction::mtf(f, c.lambda_n_px, p.obscuration)),
            Term::Aberration => mean(&|c| aberration::in_domain(f * c.lambda_n_px, c.rms_waves)),
            Term::Defocus => {
                let focused = mean(&|c| diffraction::mtf(f, c.lambda_n_px, p.obscuration));
                if focused > 0.0 { mean(&|c| c.focus_and_diffraction(f, p.obscuration)) / focused } else { 1.0 }
            }
            Term::Assembly => blur::gaussian(f, px(p.assembly_um)),
            Term::Fabrication => blur::gaussian(f, px(p.fabrication_um)),
            Term::Diffusion => mean(&|c| c.diffusion(f, p)),
            Term::Aperture => blur::square(frequency, p.aperture_px),
            Term::Tdi => p.tdi.map_or(1.0, |tdi| motion::tdi(frequency[1], tdi)),
            Term::Circuit => p.circuit.map_or(1.0, |low_pass| blur::low_pass(frequency[0], low_pass)),
        }
    }

    /// Returns the round factors that depend on the wavelength, at the magnitude `f` of a frequency.
    pub fn colored(&self, f: f64) -> f64 {
        let p = &self.params;
        let of = |c: &Color| {
            let optics = c.focus_and_diffraction(f, p.obscuration);
            if optics == 0.0 {
                return 0.0;
            }
            optics * aberration::in_domain(f * c.lambda_n_px, c.rms_waves) * c.diffusion(f, p)
        };
        self.colors.iter().map(|c| c.light.weight * of(c)).sum()
    }

    /// Returns the factors that do not depend on the wavelength: assembly, fabrication, the pixel, TDI and the circuit.
    pub fn colorless(&self, frequency: [f64; 2]) -> f64 {
        let p = &self.params;
        let blur_px = p.assembly_um.hypot(p.fabrication_um) / p.pixel_pitch_um;
        blur::gaussian(frequency[0].hypot(frequency[1]), blur_px)
            * blur::square(frequency, p.aperture_px)
            * p.tdi.map_or(1.0, |tdi| motion::tdi(frequency[1], tdi))
            * p.circuit.map_or(1.0, |low_pass| blur::low_pass(frequency[0], low_pass))
    }

    /// Returns the whole chain at `[fx, fy]`, the pixel included: the transform of the light integrated over pixels.
    pub fn product(&self, frequency: [f64; 2]) -> f64 {
        self.colored(frequency[0].hypot(frequency[1])) * self.colorless(frequency)
    }

    /// Returns the cutoff frequency of the pupil, the highest over all wavelengths, cycles/px.
    pub fn cutoff(&self) -> f64 {
        self.colors.iter().map(|c| diffraction::cutoff(c.lambda_n_px)).fold(0.0, f64::max)
    }

    /// Returns the slope of the product at frequency 0, per cycle/px: `-s |f|`, whose transform is a wing of `s / (4
    /// pi^2 r^3)`.
    pub fn slope_at_zero(&self) -> f64 {
        let of = |c: &Color| {
            let aberration = if c.rms_waves > 0.0 { aberration::slope_at_zero(c.rms_waves) } else { 0.0 };
            c.light.weight * c.lambda_n_px * (diffraction::slope_at_zero(self.params.obscuration) + aberration)
        };
        self.colors.iter().map(of).sum()
    }

    /// Returns the standard deviation of the Gaussian with the same factor, without the pixel, at half the Nyquist
    /// frequency, px: the scale of the star's core.
    pub fn core_sigma_px(&self) -> f64 {
        let f = 0.25;
        let seen = 0.5 * (self.product([f, 0.0]) + self.product([0.0, f]));
        let passed = (seen / blur::square([f, 0.0], self.params.aperture_px)).clamp(1e-9, 1.0);
        (-0.5 * passed.ln()).sqrt() / (core::f64::consts::PI * f)
    }

    /// Returns the mean wavelength of the electrons, nm.
    pub fn mean_wavelength_nm(&self) -> f64 {
        self.colors.iter().map(|c| c.light.weight * c.light.wavelength_nm).sum()
    }
}

impl Color {
    fn new(p: &ChainParams, light: SpectralWeight) -> Result<Self, MtfError> {
        let nm = light.wavelength_nm;
        let lambda_n_px = nm * 1e-3 * p.f_number / p.pixel_pitch_um;
        let rms_waves = p.wavefront.map_or(0.0, |w| w.rms_waves * w.at_nm / nm);
        if aberration::mtf(0.0, rms_waves).is_none() {
            let limit = aberration::LARGEST_RMS_WAVES;
            return Err(MtfError::Wavefront { rms_waves, wavelength_nm: nm, limit });
        }
        let defocus_um = p.defocus.map_or(0.0, |d| d.defocus_um);
        let w20_waves = defocus::w20_waves(defocus_um, p.f_number, nm);
        let is_exact = p.defocus.is_some_and(|d| d.form == DefocusForm::Exact);
        let pupil = is_exact.then(|| DefocusedPupil::new(w20_waves, p.obscuration)).flatten();
        let refused = |wanted, form, advice| {
            Err(MtfError::Defocus { defocus_um, w20_waves, wavelength_nm: nm, wanted, form, advice })
        };
        if is_exact && pupil.is_none() {
            return refused("at most 16", "exact", "take the geometric form, which holds from 5 waves on");
        }
        if !is_exact && !defocus::holds_geometrically(w20_waves) {
            return refused("at most 0.1, or at least 5,", "geometric", "take the exact one");
        }
        if p.diffusion.is_some_and(|d| d.mtf(0.0, nm).is_none()) {
            return Err(MtfError::Number {
                what: "the wavelength (nm) in a layered detector",
                got: nm,
                wanted: "300 to 1100",
                advice: "silicon's absorption is known there; give charge diffusion as a Gaussian, or another band",
            });
        }
        Ok(Self { light, lambda_n_px, rms_waves, w20_waves, pupil })
    }

    fn focus_and_diffraction(&self, f: f64, obscuration: f64) -> f64 {
        let v = f * self.lambda_n_px;
        match &self.pupil {
            Some(pupil) => pupil.mtf(v),
            None if self.w20_waves == 0.0 => diffraction::at_share_of_cutoff(v, obscuration),
            None => {
                diffraction::at_share_of_cutoff(v, obscuration) * defocus::blur_disc(v, self.w20_waves, obscuration)
            }
        }
    }

    fn diffusion(&self, f: f64, p: &ChainParams) -> f64 {
        let at = |d: Diffusion| d.mtf(f / p.pixel_pitch_um, self.light.wavelength_nm);
        p.diffusion.and_then(at).unwrap_or(1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::mtf::blur::Circuit;
    use crate::optics::mtf::diffusion::{Layers, Side};
    use crate::optics::mtf::{Defocus, TdiBlur, Wavefront};
    use core::f64::consts::PI;

    fn plain() -> ChainParams {
        ChainParams::diffraction(5.0, 4.0, 0.3, 600.0)
    }

    fn two_colors() -> Vec<SpectralWeight> {
        vec![
            SpectralWeight { wavelength_nm: 500.0, weight: 0.25 },
            SpectralWeight { wavelength_nm: 800.0, weight: 0.75 },
        ]
    }

    #[test]
    fn one_wavelength_is_the_product_of_its_terms() {
        let chain = MtfChain::new(ChainParams {
            wavefront: Some(Wavefront { rms_waves: 0.06, at_nm: 633.0 }),
            defocus: Some(Defocus { defocus_um: 12.0, form: DefocusForm::Exact }),
            assembly_um: 0.8,
            fabrication_um: 0.6,
            diffusion: Some(Diffusion::Gaussian { sigma_um: 1.0 }),
            aperture_px: 0.9,
            tdi: Some(TdiBlur { stages: 8, phases: 3, mismatch_px: 0.05 }),
            circuit: Some(Circuit { cutoff: 1.5, order: 2 }),
            ..plain()
        })
        .unwrap();
        assert_eq!(chain.terms().count(), Term::ALL.len(), "all are on");
        for f in [[0.0, 0.0], [0.25, 0.0], [0.0, 0.5], [0.4, -0.3]] {
            let terms: f64 = chain.terms().map(|term| chain.term(term, f)).product();
            assert!((chain.product(f) - terms).abs() < 1e-14, "{f:?}: {} against {terms}", chain.product(f));
        }
        // By hand: 0.6 um x 4 / 5 um = 0.48 px, 12 um / (8 x 16 x 0.6 um) = 0.15625 waves.
        let f = 0.5;
        let by_hand = DefocusedPupil::new(0.156_25, 0.3).unwrap().mtf(f * 0.48)
            * aberration::mtf(f * 0.48, 0.06 * 633.0 / 600.0).unwrap()
            * blur::gaussian(f, (0.64 + 0.36 + 1.0_f64).sqrt() / 5.0)
            * blur::sinc(0.9 * f)
            * blur::sinc(f / 3.0)
            * ((8.0 * PI * 0.05 * f).sin() / (8.0 * (PI * 0.05 * f).sin()));
        assert!((chain.product([0.0, f]) - by_hand).abs() < 1e-14, "{} against {by_hand}", chain.product([0.0, f]));
        let along = |term, frequency| chain.term(term, frequency);
        assert!(along(Term::Circuit, [f, 0.0]) < 0.999 && along(Term::Circuit, [0.0, f]) == 1.0, "along x alone");
        assert!(along(Term::Tdi, [0.0, f]) < 0.999 && along(Term::Tdi, [f, 0.0]) == 1.0, "along y alone");
        assert!((chain.product([0.0, 0.0]) - 1.0).abs() < 1e-14, "no light is lost");
    }

    #[test]
    fn a_band_is_the_mean_of_its_wavelengths() {
        let params = ChainParams {
            wavefront: Some(Wavefront { rms_waves: 0.05, at_nm: 600.0 }),
            diffusion: Some(Diffusion::Layered(Layers {
                depletion_um: 5.0,
                diffusion_length_um: 40.0,
                side: Side::Front,
            })),
            ..plain()
        };
        let of = |band| MtfChain::new(ChainParams { band, ..params.clone() }).unwrap();
        let alone = |wavelength_nm| of(vec![SpectralWeight { wavelength_nm, weight: 1.0 }]);
        let (both, blue, red) = (of(two_colors()), alone(500.0), alone(800.0));
        for f in [[0.2, 0.0], [0.5, 0.1], [1.7, 0.0]] {
            let mean = 0.25 * blue.product(f) + 0.75 * red.product(f);
            assert!((both.product(f) - mean).abs() < 1e-15, "{f:?}");
            let terms: f64 = both.terms().map(|term| both.term(term, f)).product();
            assert!((terms - mean).abs() > 1e-6, "the product of mean terms is another thing");
        }
        assert!((both.mean_wavelength_nm() - 725.0).abs() < 1e-9 && (both.cutoff() - 2.5).abs() < 1e-12, "ends");
        // A long diffusion length bends the curve early: 130 f^2.
        let step = 1e-8;
        let slope = (both.colored(step) - 1.0) / step;
        // The exact defocus is good to 1e-11: over this step, 1e-4 of the slope.
        assert!((slope / both.slope_at_zero() - 1.0).abs() < 1e-4, "{slope} against {}", both.slope_at_zero());
    }

    #[test]
    fn a_gaussian_chain_has_its_own_core() {
        // Diffraction of 0.01 px leaves 0.7 px of blur.
        let chain = MtfChain::new(ChainParams {
            f_number: 0.3,
            pixel_pitch_um: 18.0,
            obscuration: 0.0,
            assembly_um: 12.6,
            ..plain()
        });
        assert!((chain.unwrap().core_sigma_px() - 0.7).abs() < 0.01);
    }

    #[test]
    fn term_outside_its_domain_is_refused_with_the_wavelength() {
        let error_text = |params: ChainParams| MtfChain::new(params).unwrap_err().to_string();
        let wavefront = Some(Wavefront { rms_waves: 0.15, at_nm: 800.0 });
        let text = error_text(ChainParams { wavefront, band: two_colors(), ..plain() });
        assert!(text.contains("0.240 waves rms at 500 nm"), "{text}");
        let defocus = Some(Defocus { defocus_um: 12.0, form: DefocusForm::Geometric });
        let text = error_text(ChainParams { defocus, ..plain() });
        assert!(text.contains("0.156 waves") && text.contains("exact one"), "{text}");
        let defocus = Some(Defocus { defocus_um: 1300.0, form: DefocusForm::Exact });
        assert!(error_text(ChainParams { defocus, ..plain() }).contains("16.927 waves"), "too far");
        assert!(
            error_text(ChainParams { obscuration: 1.0, ..plain() }).contains("obscuration is 1"),
            "no aperture left"
        );
        assert!(
            error_text(ChainParams { aperture_px: 1.1, ..plain() }).contains("sensitive width"),
            "wider than a pixel"
        );
        assert!(error_text(ChainParams { assembly_um: -1.0, ..plain() }).contains("assembly"), "negative");
        assert!(error_text(ChainParams { assembly_um: f64::NAN, ..plain() }).contains("assembly"), "no number");
        let circuit = Some(Circuit { cutoff: 0.09, order: 1 });
        assert!(error_text(ChainParams { circuit, ..plain() }).contains("cutoff"), "too slow");
        assert!(error_text(ChainParams { band: vec![], ..plain() }).contains("weights are missing"), "no light");
        let mut band = two_colors();
        band[0].weight = -0.25;
        assert!(error_text(ChainParams { band, ..plain() }).contains("-0.25 at 500 nm"), "negative light");
    }
}
