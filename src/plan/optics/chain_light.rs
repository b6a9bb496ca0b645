//! The light of a chain before the pixel: irradiance, encircled energy and width at half height.
//!
//! In: [`MtfChain`]. Out: the light that falls on (and has diffused in) the detector, without the pixel's square and
//! the circuit, which is round: Hankel transforms of its factor `M(f)`, `I(r) = 2 pi int M J0(2 pi f r) f df` and
//! `EE(R) = 2 pi R int M J1(2 pi f R) df` (Goodman, Introduction to Fourier Optics, 2.1.5), with unit flux.
//! Gauss-Legendre panels: error below 1e-6 up to [`FURTHEST_PX`] for bands that end at 8 cycles/px. The tests compare
//! it with closed forms of Airy patterns and Gaussians.

use crate::optics::mtf::{MtfChain, blur};
use crate::optics::quadrature::gauss_legendre;
use base::bisection::bisected;
use core::f64::consts::TAU;

/// Largest distance at which results are valid, px.
pub const FURTHEST_PX: f64 = 12.0;
/// Number of panels of the band.
const PANELS: u32 = 96;
/// Number of nodes of a panel.
const NODES: usize = 8;
/// Factor below which frequencies are left out.
const NOTHING: f64 = 1e-12;

/// Light of a star before pixels.
#[derive(Debug, Clone)]
pub struct ChainLight {
    /// Frequency, cycles/px, and the chain's factor at that frequency times the width of its node.
    band: Vec<[f64; 2]>,
}

impl ChainLight {
    /// Returns the light of a chain, which is sampled once.
    pub fn of(chain: &MtfChain) -> Self {
        let p = chain.params();
        let blur_px = p.assembly_um.hypot(p.fabrication_um) / p.pixel_pitch_um;
        let blurred = if blur_px > 0.0 { blur::gaussian_cutoff(blur_px, NOTHING) } else { f64::INFINITY };
        let width = chain.cutoff().min(blurred) / f64::from(PANELS);
        let nodes = gauss_legendre(NODES);
        let panel = |k: u32| {
            let at = move |x: f64| (f64::from(k) + 0.5 + x) * width;
            let factor = |f: f64| chain.colored(f) * blur::gaussian(f, blur_px);
            nodes.iter().map(move |node| [at(node.x), node.weight * width * factor(at(node.x))]).collect::<Vec<_>>()
        };
        Self { band: (0..PANELS).flat_map(panel).collect() }
    }

    /// Returns the irradiance at `r_px` from the star, share of the flux per square pixel.
    pub fn irradiance(&self, r_px: f64) -> f64 {
        TAU * self.band.iter().map(|[f, m]| m * f * libm::j0(TAU * f * r_px)).sum::<f64>()
    }

    /// Returns the share of the light within `radius_px` of the star.
    pub fn encircled_energy(&self, radius_px: f64) -> f64 {
        TAU * radius_px * self.band.iter().map(|[f, m]| m * libm::j1(TAU * f * radius_px)).sum::<f64>()
    }

    /// Returns the full width at half height, px. For a ring-shaped star (much defocus behind an obscuration) it is the
    /// width at which the irradiance last falls to half of its maximum.
    pub fn fwhm_px(&self) -> f64 {
        const STEP_PX: f64 = 0.02;
        let steps = (FURTHEST_PX / STEP_PX) as u32;
        let profile: Vec<f64> = (0..=steps).map(|i| self.irradiance(f64::from(i) * STEP_PX)).collect();
        let half = 0.5 * profile.iter().copied().fold(0.0, f64::max);
        let Some(last) = profile.iter().rposition(|value| *value > half) else { return 0.0 };
        let about = [last as f64 * STEP_PX, (last + 1) as f64 * STEP_PX];
        2.0 * bisected(about, 40, |r| self.irradiance(r) > half)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::optics::airy::Airy;
    use crate::optics::mtf::{ChainParams, Defocus, DefocusForm};
    use crate::optics::{PsfModel, RoundPsf, energy};

    fn params(lambda_n_px: f64, obscuration: f64) -> ChainParams {
        ChainParams::diffraction(1.0, lambda_n_px / 0.5, obscuration, 500.0)
    }

    fn light(params: ChainParams) -> ChainLight {
        ChainLight::of(&MtfChain::new(params).unwrap())
    }

    #[test]
    fn diffraction_alone_is_an_airy_pattern() {
        for (l, e) in [(0.4, 0.0), (1.0, 0.3)] {
            let (ours, airy, pattern) = (light(params(l, e)), PsfModel::airy(l, e), Airy::new(l, e));
            for r in [0.0, 0.5, 1.0, 3.0, 10.0] {
                let (i, exact) = (ours.irradiance(r), pattern.irradiance(r));
                assert!((i - exact).abs() < 1e-6, "L {l}, e {e}, r {r}: {i} against {exact}");
                let (held, exact) = (ours.encircled_energy(r), energy::encircled_energy(&airy, r));
                assert!((held - exact).abs() < 1e-6, "L {l}, e {e}, circle {r}: {held} against {exact}");
            }
            assert!((ours.fwhm_px() - energy::fwhm_px(&airy)).abs() < 1e-5, "width");
        }
        let wrong = light(params(0.41, 0.0)).encircled_energy(0.3);
        assert!((wrong - energy::encircled_energy(&PsfModel::airy(0.4, 0.0), 0.3)).abs() > 1e-3, "must show");
    }

    #[test]
    fn a_blur_far_above_diffraction_is_a_gaussian() {
        let ours = light(ChainParams { pixel_pitch_um: 30.0, f_number: 0.3, assembly_um: 30.0, ..params(1.0, 0.0) });
        // Diffraction of 0.005 px adds wings of 0.1 % at one pixel.
        let gaussian = PsfModel::gaussian(1.0);
        assert!((ours.encircled_energy(1.0) - energy::encircled_energy(&gaussian, 1.0)).abs() < 3e-3);
        assert!((ours.fwhm_px() - energy::fwhm_px(&gaussian)).abs() < 2e-2, "{}", ours.fwhm_px());
    }

    #[test]
    fn much_defocus_is_the_shadow_of_the_pupil() {
        // 8 waves at L = 0.2: a disc of radius 4 L W20 = 6.4 px with soft edges.
        let defocus = Some(Defocus { defocus_um: 8.0 * 8.0 * 0.16 * 0.5, form: DefocusForm::Exact });
        let ours = light(ChainParams { defocus, ..params(0.2, 0.0) });
        assert!(
            (ours.encircled_energy(6.4 / 2.0_f64.sqrt()) - 0.5).abs() < 0.05,
            "half of the area, half of the light"
        );
        // Fringes at the edge are the highest: half of their height is reached inside it.
        assert!((10.5..13.0).contains(&ours.fwhm_px()), "{}", ours.fwhm_px());
    }
}
