//! The light sections of a checked camera file -> the light on its detector besides the stars.

use anyhow::{Result, bail};
use config::{self, Sky};
use core::f64::consts::PI;
use glam::DVec2;
use plan::optics::background::{S10_MAG_G, StrayLight, sky_e_per_s, sun_e_per_s};
use plan::optics::baffle::{SUN_BP_RP, SUN_MAG_G};
use plan::optics::sky_brightness::SkyBrightness;
use plan::optics::{BackgroundLight, StarSpectra};

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
