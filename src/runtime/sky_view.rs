//! Catalog, observer and radiometry -> the sources of one exposure. Reuses its buffers.

use crate::astrometry::{ApparentSource, apparent_places, cone_margin_rad};
use crate::attitude::LosPath;
use crate::base::time::Tai;
use crate::exposure::{Source, SourcePlace};
use crate::runtime::error::RunError;
use crate::runtime::params::CameraParams;
use crate::sky::catalog::{Catalog, CatalogSource};
use crate::sky::observer::{Observer, ObserverTrack};
use glam::DVec3;
use std::sync::Arc;

/// The sky as one camera sees it.
pub struct SkyView {
    catalog: Arc<Catalog>,
    observer: ObserverTrack,
    camera: CameraParams,
    radius_rad: f64,
    in_cone: Vec<CatalogSource>,
    apparent: Vec<ApparentSource>,
    sources: Vec<Source>,
}

/// Stars in view for which there is room from the start.
const STARS_RESERVED: usize = 16_384;
/// Margin of the cone beyond the detector's corner, px: footprints and motion within the exposure.
const MARGIN_PX: f64 = 64.0;

impl SkyView {
    /// The stars of `catalog` through `camera`.
    #[must_use]
    pub fn new(camera: &CameraParams, observer: Observer, at: Tai, catalog: Arc<Catalog>) -> Self {
        let [ifov_x, ifov_y] = camera.geometry.ifov_rad();
        let margin_rad = cone_margin_rad(&catalog, at) + MARGIN_PX * ifov_x.max(ifov_y);
        Self {
            radius_rad: camera.geometry.half_diagonal_rad() + margin_rad,
            observer: ObserverTrack::new(observer, at),
            camera: camera.clone(),
            catalog,
            in_cone: Vec::with_capacity(STARS_RESERVED),
            apparent: Vec::with_capacity(STARS_RESERVED),
            sources: Vec::with_capacity(STARS_RESERVED),
        }
    }

    /// Sources in view during an exposure: about its boresight, at mid-exposure, as far as it sweeps.
    ///
    /// # Errors
    /// When the observer's orbit cannot be computed at that time.
    pub fn in_view(&mut self, los: &LosPath) -> Result<&[Source], RunError> {
        let boresight = los.mid_sensor_from_icrf.inverse().apply(DVec3::Z);
        self.sources(boresight, los.rate_rad_s.length() * los.exposure_s, los.mid_exposure())
    }

    /// Sources in view around `boresight_icrf` at `at`; `sweep_rad` widens the cone by the motion in the exposure.
    ///
    /// # Errors
    /// When the observer's orbit cannot be computed at that time.
    pub fn sources(&mut self, boresight_icrf: DVec3, sweep_rad: f64, at: Tai) -> Result<&[Source], RunError> {
        let state = self.observer.barycentric_state(at)?;
        self.catalog.cone(boresight_icrf, self.radius_rad + sweep_rad, self.camera.limiting_mag, &mut self.in_cone);
        apparent_places(&self.in_cone, self.catalog.epoch_yr(), at, &state, &mut self.apparent);
        let radiometry = &self.camera.radiometry;
        self.sources.clear();
        self.sources.extend(self.apparent.iter().map(|star| {
            let (mag_g, bp_rp) = (f64::from(star.mag_g), f64::from(star.bp_rp));
            Source {
                id: star.id,
                electrons: radiometry.electrons(mag_g, bp_rp, self.camera.exposure_s),
                mag: radiometry.mag_instrument(mag_g, bp_rp) as f32,
                place: SourcePlace::Icrf(star.apparent_icrf),
            }
        }));
        Ok(&self.sources)
    }
}
