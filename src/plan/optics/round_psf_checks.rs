//! Checks for every round PSF: its functions agree with each other and with sums over its irradiance.

use crate::optics::quadrature::{gauss_legendre, over_pixel};
use crate::optics::{moffat::Moffat, round_psf::RoundPsf};
use core::f64::consts::TAU;

/// Largest disagreement of two shares of the flux.
const SHARE: f64 = 1e-6;
/// Start of the wings, sigmas of the core.
const FAR_SIGMAS: f64 = 7.0;
/// Share by which a bound may be too small: 4.5 % for the envelope of an obscured pattern at three times `lambda
/// N`.
const BOUND: f64 = 0.05;

/// Panics with the first function that does not agree with the irradiance.
pub(crate) fn agrees(psf: &dyn RoundPsf) {
    if let Err(wrong) = disagreement(psf) {
        panic!("{psf:?}: {wrong}");
    }
}

fn disagreement(psf: &dyn RoundPsf) -> Result<(), String> {
    let compare = |what: &str, got: f64, wanted: f64, allowed: f64| {
        if (got - wanted).abs() <= allowed { Ok(()) } else { Err(format!("{what}: {got}, wanted {wanted}")) }
    };
    let nodes = gauss_legendre(64);
    for at in [[0.0, 0.0], [0.3, -0.8], [2.6, 1.1]] {
        compare("pixel", psf.pixel(at[0], at[1]), over_pixel(&nodes, at, |r| psf.irradiance(r)), SHARE)?;
    }
    for r_px in [0.5, 2.0, 6.0] {
        let panels = 400;
        let width = r_px / f64::from(panels);
        let ring = |k: i32| {
            let at = |x: f64| (f64::from(k) + 0.5 + x) * width;
            nodes[..].iter().map(|node| node.weight * width * at(node.x) * psf.irradiance(at(node.x))).sum::<f64>()
        };
        let within = TAU * (0..panels).map(ring).sum::<f64>();
        compare("encircled energy", psf.encircled_energy(r_px), within, SHARE)?;
        let (lost, bound) = (1.0 - within, psf.lost_flux(r_px));
        if r_px > FAR_SIGMAS * psf.core_sigma_px() && bound * (1.0 + BOUND) < lost {
            return Err(format!("lost flux beyond {r_px} px: {bound}, wanted a bound of {lost}"));
        }
    }
    let half = psf.irradiance(0.5 * psf.fwhm_px()) / psf.irradiance(0.0);
    compare("height at half the FWHM", half, 0.5, SHARE)?;
    let gaussian = (-0.5_f64).exp();
    let core = psf.irradiance(psf.core_sigma_px()) / psf.irradiance(0.0);
    compare("height at the core's sigma", core, gaussian, 0.15)?;
    let finer = psf.table_error(8.0) / psf.table_error(16.0);
    if finer < 4.0 { Err(format!("a table twice as fine errs {finer} times less")) } else { Ok(()) }
}

/// A PSF with one wrong function.
#[derive(Debug)]
struct Wrong(Moffat, &'static str);

impl RoundPsf for Wrong {
    fn irradiance(&self, r_px: f64) -> f64 {
        self.0.irradiance(r_px)
    }
    fn pixel(&self, x_px: f64, y_px: f64) -> f64 {
        self.0.pixel(x_px, y_px) * if self.1 == "pixel" { 1.001 } else { 1.0 }
    }
    fn lost_flux(&self, r_px: f64) -> f64 {
        self.0.lost_flux(r_px) * if self.1 == "lost flux" { 0.9 } else { 1.0 }
    }
    fn encircled_energy(&self, r_px: f64) -> f64 {
        self.0.encircled_energy(r_px) * if self.1 == "encircled energy" { 1.001 } else { 1.0 }
    }
    fn fwhm_px(&self) -> f64 {
        self.0.fwhm_px() * if self.1 == "FWHM" { 1.001 } else { 1.0 }
    }
    fn core_sigma_px(&self) -> f64 {
        self.0.core_sigma_px() * if self.1 == "core" { 2.0 } else { 1.0 }
    }
    fn table_error(&self, per_px: f64) -> f64 {
        if self.1 == "table" { 1e-3 } else { self.0.table_error(per_px) }
    }
    fn line_step_px(&self) -> f64 {
        self.0.line_step_px()
    }
}

#[test]
fn one_wrong_answer_is_found() {
    let moffat = || Moffat::new(0.9, 3.0);
    agrees(&Wrong(moffat(), "nothing"));
    for (answer, named) in [
        ("pixel", "pixel"),
        ("lost flux", "lost flux"),
        ("encircled energy", "encircled energy"),
        ("FWHM", "FWHM"),
        ("core", "core"),
        ("table", "twice as fine"),
    ] {
        let found = disagreement(&Wrong(moffat(), answer)).unwrap_err();
        assert!(found.contains(named), "{answer}: {found}");
    }
}
