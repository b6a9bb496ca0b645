//! Attitude and time -> a frame's background: sky, and stray light of Sun, Moon and Earth. Evaluated at the boresight
//! at mid-exposure, once per frame; allocates nothing after start.

use crate::camera::{self, CameraParams};
use base::refused::Refused;
use glam::DVec3;
use image::detector::Background;
use plan::attitude::{LosPath, PathOrigin};
use plan::optics::background::{BackgroundLight, BackgroundRates};
use plan::optics::baffle::{BrightBodies, Glare};
use sky::observer::ObserverTrack;

/// The light besides the stars for one camera.
#[derive(Debug, Clone)]
pub struct FieldLight {
    light: BackgroundLight,
    observer: Option<ObserverTrack>,
}

impl FieldLight {
    /// Returns the light for `camera` and this observer.
    pub fn new(camera: &CameraParams, observer: ObserverTrack) -> Self {
        let light = camera.background.clone();
        let observer = light.needs_bodies().then_some(observer);
        Self { light, observer }
    }

    /// Returns the background and the glare at mid-exposure; the constant part of the background when the attitude is
    /// unknown.
    ///
    /// # Errors
    /// When the observer's orbit cannot be computed at that time.
    pub fn at(&self, los: &LosPath) -> Result<(Background, Glare), Refused> {
        if self.light.is_dark() {
            return Ok((Background::DARK, Glare::default()));
        }
        if los.origin == PathOrigin::Absent {
            return Ok((electrons(&self.light.constant(), los.exposure_s), Glare::default()));
        }
        let sensor_from_icrf = los.mid_sensor_from_icrf;
        let boresight_icrf = sensor_from_icrf.inverse().apply(DVec3::Z);
        let (mut sun_icrf, mut glare) = (DVec3::Z, Glare::default());
        if let Some(observer) = &self.observer {
            let bodies = observer.bodies(los.mid_exposure()).map_err(camera::observer)?;
            sun_icrf = bodies.sun_km;
            let in_sensor = |km: DVec3| sensor_from_icrf.apply(km);
            if let Some(stray) = &self.light.stray {
                glare = stray.glare(&BrightBodies {
                    sun_km: in_sensor(bodies.sun_km),
                    moon_km: in_sensor(bodies.moon_km),
                    earth_km: bodies.earth_km.map(in_sensor),
                });
            }
        }
        Ok((electrons(&self.light.rates(boresight_icrf, sun_icrf, &glare), los.exposure_s), glare))
    }

    /// Returns its observer, so that callers can add states from outside; `None` if the light does not depend on it.
    pub fn observer_mut(&mut self) -> Option<&mut ObserverTrack> {
        self.observer.as_mut()
    }

    /// Returns the smallest and largest electrons of the modelled sky in a pixel on the axis, for these directions
    /// (sensor axes).
    ///
    /// # Errors
    /// The same errors as [`Self::at`].
    pub fn sky_over<const N: usize>(
        &self,
        los: &LosPath,
        directions: [Option<DVec3>; N],
    ) -> Result<(f64, f64), Refused> {
        let sun_icrf = match &self.observer {
            Some(observer) => observer.bodies(los.mid_exposure()).map_err(camera::observer)?.sun_km,
            None => DVec3::Z,
        };
        let icrf_from_sensor = los.mid_sensor_from_icrf.inverse();
        let here = |v: DVec3| self.light.sky.e_per_s(icrf_from_sensor.apply(v), sun_icrf) * los.exposure_s;
        let all = directions.into_iter().flatten().map(here);
        Ok(all.fold((f64::INFINITY, 0.0), |(least, most), e| (least.min(e), most.max(e))))
    }
}

#[allow(clippy::cast_possible_truncation, reason = "electrons are single precision")]
fn electrons(rates: &BackgroundRates, exposure_s: f64) -> Background {
    let e = |e_per_s: f64| (e_per_s * exposure_s) as f32;
    Background {
        uniform_e: e(rates.uniform),
        gradient_e: rates.gradient.to_array().map(e),
        quadratic_e: e(rates.quadratic),
        sky_e: e(rates.sky),
    }
}

/// Returns the relative illumination of every pixel, if the camera has an uneven one and a background to multiply:
/// computed once, before the first frame. `None` for uniform illumination or without background.
#[allow(clippy::cast_possible_truncation, reason = "the detector works in single precision")]
pub fn illumination_map(camera: &CameraParams) -> Option<Vec<f32>> {
    let has_sky = camera.background.sky_e_per_s != 0.0 || !camera.background.sky.is_dark();
    if camera.illumination.is_even() || !has_sky {
        return None;
    }
    let [width, height] = [camera.geometry.width_px(), camera.geometry.height_px()];
    let at = |x: usize, y: usize| {
        // Every pixel of a checked camera is in the domain of its distortion.
        let tangent = camera.geometry.tangent_of_pixel([x as f64, y as f64]);
        tangent.map_or(0.0, |tangent| camera.illumination.at(tangent)) as f32
    };
    let mut map = Vec::with_capacity(width * height);
    (0..height).for_each(|y| map.extend((0..width).map(|x| at(x, y))));
    Some(map)
}
