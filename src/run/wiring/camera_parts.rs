//! A checked camera file -> the parameters of the other crates.

use crate::wiring::{light_parts::background_light, seen_mag::auto_limiting_mag};
use anyhow::{Context, Result};
use config;
use plan::optics::chain_psf::{ChainPsf, Drawing};
use plan::optics::{BackgroundLight, PsfModel};
use plan::{exposure::Shutter, optics::mtf::MtfChain};
use scene::camera::CameraParams;
use sky::astrometry::{BrownConrady, CameraGeometry, CameraParameters};

/// Returns the camera in the form used by the other crates.
///
/// # Errors
/// When the distortion model is not valid over the whole detector, or the photometry cannot supply the requested light.
pub fn camera_params(camera: &config::Camera) -> Result<CameraParams> {
    let (detector, optics) = (&camera.detector, &camera.optics);
    let focal_px = optics.focal_length_mm * 1e3 / detector.pixel_pitch_um;
    let d = &camera.distortion;
    let parameters = CameraParameters {
        width_px: detector.width_px as usize,
        height_px: detector.height_px as usize,
        focal_px: [focal_px; 2],
        principal_point_px: optics.principal_point_px,
        distortion: BrownConrady { k1: d.k1, k2: d.k2, k3: d.k3, p1: d.p1, p2: d.p2 },
    };
    let geometry = match d.polynomial {
        None => CameraGeometry::new(parameters),
        Some(polynomial) => CameraGeometry::with_polynomial(parameters, polynomial),
    }
    .with_context(|| format!("camera \"{}\"", camera.name))?;
    let mut params = CameraParams {
        name: camera.name.as_str().into(),
        geometry,
        shutter: shutter(camera.exposure.rolling_line_us),
        psf: psf(camera)?,
        sampling: camera.sampling,
        radiometry: camera.star_light(),
        illumination: camera.illumination,
        background: BackgroundLight::default(),
        detector: detector.params,
        patterns: detector.maps.clone(),
        pixel_pitch_um: detector.pixel_pitch_um,
        focal_length_mm: optics.focal_length_mm,
        limiting_mag: f32::NAN,
        exposure_s: camera.exposure.exposure_s,
        readout_s: camera.exposure.readout_s,
    };
    let star_e_per_s = |mag_g, bp_rp| params.radiometry.electrons(mag_g, bp_rp, 1.0);
    params.background = background_light(camera, geometry.ifov_rad(), star_e_per_s)?;
    params.limiting_mag = camera.radiometry.limiting_mag.unwrap_or_else(|| auto_limiting_mag(&params)) as f32;
    Ok(params)
}

fn shutter(rolling_line_us: f64) -> Shutter {
    if rolling_line_us > 0.0 { Shutter::Rolling { line_s: rolling_line_us * 1e-6 } } else { Shutter::Global }
}

fn psf(camera: &config::Camera) -> Result<PsfModel> {
    Ok(match &camera.psf {
        config::Psf::Gaussian { sigma_px } => PsfModel::gaussian(*sigma_px),
        config::Psf::Airy { f_number, wavelength_nm, obscuration } => {
            let lambda_n_px = wavelength_nm * 1e-3 * f_number / camera.detector.pixel_pitch_um;
            PsfModel::airy(lambda_n_px, *obscuration)
        }
        config::Psf::Chain(chain) => {
            let chain = MtfChain::new(chain.params.clone()).with_context(|| format!("camera \"{}\"", camera.name))?;
            let drawn = ChainPsf::draw(&chain, &Drawing::default());
            PsfModel::grid(drawn.with_context(|| format!("camera \"{}\"", camera.name))?.grid)
        }
        config::Psf::Made(psf) => psf.clone(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wiring::seen_mag::seen_mag;
    use config::{Camera, Document};
    use std::path::Path;

    fn drawn(optics: &str) -> (f64, f64) {
        let text = format!("[detector]\nwidth_px = 640\nheight_px = 480\n[optics]\n{optics}\n");
        let camera = Camera::from_document(&Document::from_text(&text, Path::new("cam.toml"))).unwrap();
        let params = camera_params(&camera).unwrap();
        (seen_mag(&params).unwrap(), f64::from(params.limiting_mag))
    }

    #[test]
    fn auto_draws_half_a_magnitude_beyond_what_is_seen_in_tenths() {
        for optics in ["focal_length_mm = 16", "focal_length_mm = 50", "focal_length_mm = 50\naperture_mm = 5"] {
            let (seen, drawn) = drawn(optics);
            let beyond = drawn - seen;
            assert!((0.5 - 1e-6..0.6 + 1e-6).contains(&beyond), "{optics}: {beyond}");
            assert!((10.0 * drawn - (10.0 * drawn).round()).abs() < 1e-5, "{optics}: tenths, got {drawn}");
        }
    }

    #[test]
    fn a_larger_aperture_draws_fainter_stars() {
        let [(_, small), (_, large)] = [5, 50].map(|mm| drawn(&format!("focal_length_mm = 50\naperture_mm = {mm}")));
        assert!(large > small + 2.0, "{small} {large}");
    }
}
