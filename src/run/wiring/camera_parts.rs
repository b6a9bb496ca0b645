//! A checked camera file -> the parameters of the other crates.
//!
//! The light sections of a checked camera file -> the light on its detector besides the stars.

use crate::wiring::sensitivity::auto_limiting_mag;
use anyhow::{Context, Result, bail};
use config::Sky;
use core::f64::consts::PI;
use glam::DVec2;
use plan::exposure::Shutter;
use plan::optics::background::{S10_MAG_G, StrayLight, sky_e_per_s, sun_e_per_s};
use plan::optics::baffle::{SUN_BP_RP, SUN_MAG_G};
use plan::optics::chain_psf::{ChainPsf, Drawing};
use plan::optics::{BackgroundLight, PsfModel, StarSpectra};
use plan::optics::{mtf::MtfChain, sky_brightness::SkyBrightness};
use scene::camera::CameraParams;

/// Returns the camera in the form used by the other crates.
///
/// # Errors
/// When the distortion model is not valid over the whole detector, or the photometry cannot supply the requested light.
pub fn camera_params(camera: &config::Camera) -> Result<CameraParams> {
    let (detector, optics) = (&camera.detector, &camera.optics);
    let geometry = camera.geometry().with_context(|| format!("camera \"{}\"", camera.name))?;
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

/// Returns the background of `camera`. `star_e_per_s` returns the electrons per second of a star from its G magnitude
/// and BP - RP.
///
/// # Errors
/// When light is given in magnitudes and the camera has no zero point in electrons per second.
pub fn background_light(
    camera: &config::Camera,
    ifov_rad: [f64; 2],
    star_e_per_s: impl Fn(f64, f64) -> f64,
) -> Result<BackgroundLight> {
    let background = &camera.background;
    let zero_point_e_per_s = camera.zero_point_e_per_s();
    if zero_point_e_per_s <= 0.0 && (background.sky != Sky::Dark || camera.baffle.is_some()) {
        bail!(
            "camera \"{}\": [background] mag_per_arcsec2 or sky, and [baffle], want photometry with a zero point in \
             electrons per second, got one without; give background.uniform_e_per_s instead",
            camera.name
        );
    }
    let s10_e_per_s = || sky_e_per_s(star_e_per_s(S10_MAG_G, SUN_BP_RP), ifov_rad);
    let (even_e_per_s, sky) = match background.sky {
        Sky::Dark => (0.0, SkyBrightness::default()),
        Sky::Even { mag_per_arcsec2 } => {
            let star_e_per_s = zero_point_e_per_s * 10_f64.powf(-0.4 * mag_per_arcsec2);
            (sky_e_per_s(star_e_per_s, ifov_rad), SkyBrightness::default())
        }
        Sky::Model { zodiacal, galactic } => (0.0, SkyBrightness { zodiacal, galactic, e_per_s_of_s10: s10_e_per_s() }),
    };
    let stray = camera.baffle.as_ref().map(|baffle| StrayLight {
        baffle: baffle.shade.clone(),
        sun_e_per_s: bare_sun_e_per_s(camera, star_e_per_s(SUN_MAG_G, SUN_BP_RP)),
        gradient: baffle.gradient,
        quadratic: baffle.quadratic,
    });
    Ok(BackgroundLight {
        uniform_e_per_s: background.uniform_e_per_s,
        gradient: DVec2::from_array(background.gradient),
        quadratic: background.quadratic,
        sky_e_per_s: even_e_per_s,
        sky,
        stray,
    })
}

fn bare_sun_e_per_s(camera: &config::Camera, collected_e_per_s: f64) -> f64 {
    let optics = &camera.optics;
    let diameter_m = optics.aperture_mm * 1e-3;
    let aperture_m2 = PI / 4.0 * diameter_m * diameter_m * (1.0 - optics.obscuration * optics.obscuration);
    let pixel_m = camera.detector.pixel_pitch_um * 1e-6;
    // Light past the baffle does not pass the optics: divide by their transmission.
    let transmission = match &camera.band {
        Some(band) => band.mean_transmission(&StarSpectra::new().of_color(SUN_BP_RP)),
        None => optics.transmission,
    };
    sun_e_per_s(collected_e_per_s, aperture_m2 * transmission, pixel_m * pixel_m)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wiring::sensitivity::seen_mag;
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
