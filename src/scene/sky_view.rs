//! Stars, observer and radiometry -> the sources of one exposure. Reuses its buffers.
//!
//! Uses the tiles of the field, whose light was computed when they were decoded, on all cores. Tests:
//! `tests/physics/frames.rs`, `tests/physics/deep_sky.rs`.

use crate::camera::{self, CameraParams};
use crate::field::{FieldBounds, FieldStars};
use base::axes::{Icrf, Rotation, Sensor};
use base::time::{Span, Tai};
use base::{refused::Refused, source_id::SourceId};
use frames::sink::{TruthKind, TruthStar};
use glam::{DQuat, DVec3};
use plan::attitude::LosPath;
use plan::exposure::{Source, SourcePlace};
use sky::astrometry::{ApparentPlaces, Sight, Vantage, cone_margin_rad};
use sky::observer::ObserverTrack;
use stars::tiles::{Light, Shortfall, TileSky, TileStar};
use stars::{Sky, healpix::chord_squared};
use std::sync::Arc;

/// The sky in view of one camera.
pub struct SkyView {
    tiles: TileSky,
    field: FieldStars,
    /// Stars missing from the latest field.
    pub shortfall: Shortfall,
    epoch_yr: f64,
    fastest_mas_yr: f64,
    observer: ObserverTrack,
    light_deflection: bool,
    half_diagonal_rad: f64,
    /// Angle from the boresight to the detector's corner, with its margin.
    field_rad: f64,
    /// The same in the catalog, at the latest requested time.
    radius_rad: f64,
    bounds: FieldBounds,
    /// Aberration and light deflection by the observer in the latest field.
    sight: Option<Sight>,
    sources: Vec<Source>,
}

/// Initial capacity for stars in view.
const STARS_RESERVED: usize = 16_384;
/// Margin of the cone beyond the detector's corner, px: footprints and motion within the exposure.
const MARGIN_PX: f64 = 64.0;
/// Time by which tiles are requested ahead, for a slew at a constant rate.
const AHEAD: Span = Span::from_ms(2000);

impl SkyView {
    /// Returns the stars of `sky` through `camera` where `observer` flies.
    pub fn new(camera: &CameraParams, observer: ObserverTrack, sky: &Sky) -> Self {
        let [ifov_x, ifov_y] = camera.geometry.ifov_rad();
        let field_rad = camera.geometry.half_diagonal_rad() + MARGIN_PX * ifov_x.max(ifov_y);
        let Sky { layers, most_stars } = sky;
        Self {
            tiles: TileSky::new(Arc::clone(layers), light(camera), *most_stars),
            field: FieldStars::with_capacity(STARS_RESERVED),
            shortfall: Shortfall::default(),
            epoch_yr: layers.epoch_yr(),
            fastest_mas_yr: layers.fastest_mas_yr(),
            field_rad,
            radius_rad: field_rad,
            bounds: FieldBounds::new(&camera.geometry),
            sight: None,
            observer,
            light_deflection: true,
            half_diagonal_rad: camera.geometry.half_diagonal_rad(),
            sources: Vec::with_capacity(STARS_RESERVED),
        }
    }

    /// Sets whether the Sun bends the stars' light: by default it does.
    #[must_use]
    pub fn with_light_deflection(self, light_deflection: bool) -> Self {
        Self { light_deflection, ..self }
    }

    /// Starts a thread that reads tiles of layers ahead of the camera: stars that have not been read in time are
    /// missing. For the real clock.
    ///
    /// # Errors
    /// When the system cannot start the thread.
    pub fn read_ahead(&mut self) -> Result<(), Refused> {
        self.tiles.read_ahead().map_err(|source| Refused(format!("thread \"tiles\": {source}")))
    }

    /// Accepts the tiles that were read ahead; returns how many are still to come.
    ///
    /// # Errors
    /// When a tile cannot be read.
    pub fn settle(&mut self) -> Result<usize, Refused> {
        self.tiles.settle().map_err(camera::stars)
    }

    /// Returns true when the thread that reads tiles has failed.
    pub fn has_lost_reader(&self) -> bool {
        self.tiles.has_lost_reader()
    }

    /// Returns its observer.
    pub fn observer(&self) -> &ObserverTrack {
        &self.observer
    }

    /// Returns its observer, so that callers can add states from outside.
    pub fn observer_mut(&mut self) -> &mut ObserverTrack {
        &mut self.observer
    }

    /// Returns the effect of the observer on directions at the latest exposure; `None` before the first.
    pub fn sight(&self) -> Option<&Sight> {
        self.sight.as_ref()
    }

    /// Returns the sources in view during an exposure: about its boresight, at mid-exposure, as far as it sweeps.
    ///
    /// # Errors
    /// When the observer's orbit cannot be computed at that time, or a tile cannot be read.
    pub fn in_view(&mut self, los: &LosPath) -> Result<&[Source], Refused> {
        self.find_in_view(los)?;
        Ok(&self.sources)
    }

    /// Returns the sources of the latest call.
    pub fn found(&self) -> &[Source] {
        &self.sources
    }

    /// Returns the name in its source catalog of a source of the latest call, by its `id`; `None` when it has none.
    /// Reads no file and allocates nothing.
    pub fn source_id(&self, id: u32) -> Option<SourceId> {
        self.tiles.source_id(id)
    }

    /// Adds the identity in the source catalog to each star of the truth table, if known.
    pub fn name_stars(&self, rows: &mut [TruthStar]) {
        for row in rows.iter_mut().filter(|row| row.kind == TruthKind::Star) {
            row.source_id = self.source_id(row.id);
        }
    }

    /// Finds the sources in view as [`Self::in_view`] does; [`Self::found`] returns them.
    ///
    /// # Errors
    /// The same errors as there.
    pub fn find_in_view(&mut self, los: &LosPath) -> Result<(), Refused> {
        let icrf_from_sensor = los.mid_sensor_from_icrf.inverse();
        let boresight = icrf_from_sensor.apply(DVec3::Z);
        let rate_rad_s = los.rate_rad_s.length();
        let sweep_rad = rate_rad_s * los.exposure_s;
        self.find(boresight, sweep_rad, Some(&los.mid_sensor_from_icrf), los.mid_exposure())?;
        // The distance covered by a slew at this rate.
        let half = 0.5 * AHEAD.s();
        let turned = DQuat::from_scaled_axis(icrf_from_sensor.apply(los.rate_rad_s) * half) * boresight;
        let stretch_rad = boresight.angle_between(turned);
        self.tiles.look_ahead(turned, 1.1 * self.radius_rad + stretch_rad);
        Ok(())
    }

    /// Takes in what the observer does to directions at an instant, without looking for stars.
    ///
    /// # Errors
    /// When the observer's orbit cannot be computed at that time.
    pub fn look(&mut self, at: Tai) -> Result<(), Refused> {
        self.sight = Some(Vantage::of(&self.observer, at, self.light_deflection).map_err(camera::observer)?.sight());
        Ok(())
    }

    /// Returns the sources in view around `boresight_icrf` at `at`; `sweep_rad` widens the cone by the motion in the
    /// exposure.
    ///
    /// # Errors
    /// When the observer's orbit cannot be computed at that time, or a tile cannot be read.
    pub fn sources(&mut self, boresight_icrf: DVec3, sweep_rad: f64, at: Tai) -> Result<&[Source], Refused> {
        self.find(boresight_icrf, sweep_rad, None, at)?;
        Ok(&self.sources)
    }

    /// Finds sources; from layers on disk only stars that may be visible at `attitude`, if it is known.
    fn find(
        &mut self,
        boresight_icrf: DVec3,
        sweep_rad: f64,
        attitude: Option<&Rotation<Sensor, Icrf>>,
        at: Tai,
    ) -> Result<(), Refused> {
        let vantage = Vantage::of(&self.observer, at, self.light_deflection).map_err(camera::observer)?;
        self.sight = Some(vantage.sight());
        self.radius_rad = self.field_rad + cone_margin_rad(self.epoch_yr, self.fastest_mas_yr, at, &vantage);
        let margin_rad = self.radius_rad - self.half_diagonal_rad + sweep_rad;
        // A catalog in memory gives the whole cone, a few thousand stars: stars hidden by bodies beside the field count
        // too.
        let attitude = attitude.filter(|_| !self.tiles.layers().is_in_memory());
        let bounds = attitude.and_then(|attitude| self.bounds.at(attitude, margin_rad));
        let radius_rad = self.radius_rad + sweep_rad;
        let Some(axis) = boresight_icrf.try_normalize() else {
            self.sources.clear();
            return Ok(());
        };
        self.shortfall = self.tiles.take_field(axis, radius_rad).map_err(camera::stars)?;
        let chord2 = chord_squared(radius_rad);
        let is_wanted = |star: &TileStar| match &bounds {
            Some(bounds) => bounds.may_have(star.direction_icrf),
            None => star.direction_icrf.distance_squared(axis) <= chord2,
        };
        let places = ApparentPlaces::new(self.epoch_yr, at, &vantage);
        let seen = |star: &TileStar| Source {
            id: star.id,
            electrons: star.electrons,
            mag: star.mag,
            place: SourcePlace::Icrf(places.place(star.direction_icrf, star.motion, star.parallax_mas)),
        };
        let tiles = &self.tiles;
        self.field.take(|block| tiles.block(block), tiles.blocks().count(), is_wanted, seen, &mut self.sources);
        Ok(())
    }
}

/// Returns the camera's radiometry, for tiles as they are read.
fn light(camera: &CameraParams) -> Light {
    let (radiometry, exposure_s) = (camera.radiometry.clone(), camera.exposure_s);
    Light::new(move |mag_g, bp_rp| {
        let (mag_g, bp_rp) = (f64::from(mag_g), f64::from(bp_rp));
        (radiometry.electrons(mag_g, bp_rp, exposure_s), radiometry.mag_instrument(mag_g, bp_rp) as f32)
    })
}
