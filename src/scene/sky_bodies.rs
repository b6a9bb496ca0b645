//! Stars in view, time -> stars that no body hides, and planets, Moon and Earth.
//!
//! In: the sources of one exposure and its attitude. Out: the sources to draw. Apparent places as for stars; light by
//! the magnitude (planets, Moon) or the albedo (Earth) through the radiometry of stars, with the Sun's colour. A planet
//! whose radius is below [`POINT_RADIUS_PX`] is a point. The Sun is never drawn: its disc in the field is reported.
//! Reuses its buffers; more sources than ever before may allocate once. Tests: `tests/physics/bodies.rs`.

use crate::camera::{self, CameraParams};
use crate::discs::{Disc, DiscPainter, Law, Occultation};
use base::axes::{Icrf, Rotation, Sensor};
use base::{refused::Refused, time::Tai, units::AU_KM};
use core::f64::consts::PI;
use glam::DVec3;
use plan::exposure::{Source, SourcePlace};
use plan::optics::baffle::{EARTH_ALBEDO, SUN_MAG_G};
use plan::{exposure::target::FIRST_BODY_ID, optics::StarLight};
use sky::astrometry::{CameraGeometry, aberrated};
use sky::bodies::{SUN_RADIUS_KM, Spheroid, Standpoint};
use sky::magnitude::{Lighting, SUN_BP_RP, SUN_G_LESS_V, moon_v, planet_v};
use sky::{observer::ObserverTrack, planets::Planet};

/// Radius below which planets are points, px: the error of the middle of their light is at most half of it.
pub const POINT_RADIUS_PX: f64 = 0.02;
/// The Earth's number in identifiers.
pub const EARTH_NUMBER: u32 = 3;
/// The Moon's number in identifiers.
pub const MOON_NUMBER: u32 = 9;
/// Initial capacity for sources.
const SOURCES_RESERVED: usize = 65_536;
/// Margin of the field beyond the detector's corner, px.
const MARGIN_PX: f64 = 64.0;
/// Smallest integral of a law over a disc, of 1.57 at full phase: a thinner crescent is not scaled to its magnitude.
const LEAST_OVER_DISC: f64 = 1e-4;

/// Counts of bodies in one frame.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BodyCounts {
    /// Stars on the detector that a body hides.
    pub occulted: usize,
    /// Sources that form discs.
    pub disc_sources: usize,
    /// The largest cell of a disc, px; above 1 its light shows as dots.
    pub coarsest_px: f64,
    /// True when the Sun's disc is on the detector and not hidden. It is not drawn.
    pub has_sun: bool,
}

/// One body as the observer sees it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SeenBody {
    /// Its name.
    pub name: &'static str,
    /// Its number: 0 for the Sun, planets in order, 9 for the Moon.
    pub number: u32,
    /// Apparent direction of its centre, unit, ICRF.
    pub apparent_icrf: DVec3,
    /// Its distance, km.
    pub range_km: f64,
    /// Its angular radius, rad.
    pub radius_rad: f64,
    /// G magnitude; `None` for the Earth.
    pub mag_g: Option<f64>,
    /// Share of its disc that is lit.
    pub lit_share: f64,
}

/// Camera parameters needed for bodies.
#[derive(Debug, Clone)]
pub struct BodyCamera {
    /// Projection.
    pub geometry: CameraGeometry,
    /// Magnitude to electrons.
    pub light: StarLight,
    /// Exposure time, s.
    pub exposure_s: f64,
    /// Faintest G that is drawn.
    pub limiting_mag: f64,
}

/// The bodies in view of one camera.
#[derive(Debug)]
pub struct SkyBodies {
    observer: ObserverTrack,
    camera: BodyCamera,
    painter: DiscPainter,
    sources: Vec<Source>,
    counts: BodyCounts,
    /// Bodies that hide others in the latest frame's field.
    pub before: Occultation,
}

impl SkyBodies {
    /// Returns the bodies for `camera` and this observer.
    pub fn new(camera: &CameraParams, observer: ObserverTrack) -> Self {
        let body_camera = BodyCamera {
            geometry: camera.geometry,
            light: camera.radiometry.clone(),
            exposure_s: camera.exposure_s,
            limiting_mag: f64::from(camera.limiting_mag),
        };
        Self::through(body_camera, observer)
    }

    /// Returns the bodies for a camera given by the needed parameters only.
    pub fn through(camera: BodyCamera, observer: ObserverTrack) -> Self {
        Self {
            observer,
            camera,
            painter: DiscPainter::default(),
            sources: Vec::with_capacity(SOURCES_RESERVED),
            counts: BodyCounts::default(),
            before: Occultation::default(),
        }
    }

    /// Returns its observer, so that callers can add states from outside.
    pub fn observer_mut(&mut self) -> &mut ObserverTrack {
        &mut self.observer
    }

    /// Returns all sources to draw in the latest frame.
    pub fn sources(&self) -> &[Source] {
        &self.sources
    }

    /// Returns the counts of the latest frame.
    pub fn counts(&self) -> BodyCounts {
        self.counts
    }

    /// Sets the motion during the next exposure, rad: bodies this much beyond the detector may shine on it.
    pub fn expect_sweep(&mut self, sweep_rad: f64) {
        let [ifov_x, ifov_y] = self.camera.geometry.ifov_rad();
        self.painter.sweep_px = sweep_rad / ifov_x.min(ifov_y);
    }

    /// Returns all sources to draw: `stars` without the hidden ones, and the bodies in the field.
    ///
    /// # Errors
    /// When the observer's orbit cannot be computed at that time, or it is at the barycentre.
    pub fn seen(
        &mut self,
        stars: &[Source],
        sensor_from_icrf: &Rotation<Sensor, Icrf>,
        at: Tai,
    ) -> Result<&[Source], Refused> {
        let standpoint = self.observer.standpoint(at).map_err(camera::observer)?;
        let boresight = sensor_from_icrf.inverse().apply(DVec3::Z);
        let field_rad = self.field_rad();
        let before = Occultation::in_field(&standpoint, boresight, field_rad);
        self.counts = BodyCounts::default();
        self.take_stars(stars, &before, sensor_from_icrf);
        for planet in Planet::ALL {
            let seen = seen_planet(&standpoint, planet);
            let mag_g = seen.mag_g.unwrap_or(f64::INFINITY);
            if mag_g <= self.camera.limiting_mag
                && seen.apparent_icrf.angle_between(boresight) < field_rad + seen.radius_rad
            {
                self.add_planet(planet, &seen, &standpoint, &before, sensor_from_icrf);
            }
        }
        for disc in [self.moon(&standpoint), self.earth(&standpoint)].into_iter().flatten() {
            self.paint(&disc, &before, sensor_from_icrf);
        }
        let sun = seen_sun(&standpoint);
        let from_middle = sensor_from_icrf.apply(sun.apparent_icrf);
        let [ifov_x, ifov_y] = self.camera.geometry.ifov_rad();
        self.counts.has_sun = !before.hides(sun.apparent_icrf, f64::INFINITY)
            && self.is_on_detector(from_middle, sun.radius_rad / ifov_x.min(ifov_y));
        self.before = before;
        Ok(&self.sources)
    }

    /// Returns every body as seen at `at`, the Sun first.
    ///
    /// # Errors
    /// The same errors as [`Self::seen`].
    pub fn all(&self, at: Tai) -> Result<Vec<SeenBody>, Refused> {
        Ok(seen_from(&self.observer.standpoint(at).map_err(camera::observer)?))
    }

    fn field_rad(&self) -> f64 {
        let [ifov_x, ifov_y] = self.camera.geometry.ifov_rad();
        self.camera.geometry.half_diagonal_rad() + (MARGIN_PX + self.painter.sweep_px) * ifov_x.max(ifov_y)
    }

    fn take_stars(&mut self, stars: &[Source], before: &Occultation, sensor_from_icrf: &Rotation<Sensor, Icrf>) {
        self.sources.clear();
        if before.is_none() {
            self.sources.extend_from_slice(stars);
            return;
        }
        for star in stars {
            match star.place {
                SourcePlace::Icrf(apparent) if before.hides(apparent, f64::INFINITY) => {
                    let is_on_detector = self.is_on_detector(sensor_from_icrf.apply(apparent), 0.0);
                    self.counts.occulted += usize::from(is_on_detector);
                }
                SourcePlace::Icrf(_) | SourcePlace::Pixel(_) => self.sources.push(*star),
            }
        }
    }

    /// Returns true when a direction, sensor axes, is on the detector or nearer to it than `margin_px`.
    fn is_on_detector(&self, direction: DVec3, margin_px: f64) -> bool {
        let camera = &self.camera.geometry;
        let size_px = [camera.width_px(), camera.height_px()];
        camera.project(direction).is_some_and(|px| {
            let inside = |i: usize| px[i] > -0.5 - margin_px && px[i] < size_px[i] as f64 - 0.5 + margin_px;
            inside(0) && inside(1)
        })
    }

    fn electrons(&self, mag_g: f64) -> f64 {
        self.camera.light.electrons(mag_g, SUN_BP_RP, self.camera.exposure_s)
    }

    #[allow(clippy::cast_possible_truncation, reason = "magnitudes are single precision")]
    fn mag_instrument(&self, mag_g: f64) -> f32 {
        self.camera.light.mag_instrument(mag_g, SUN_BP_RP) as f32
    }

    fn add_planet(
        &mut self,
        planet: Planet,
        seen: &SeenBody,
        standpoint: &Standpoint,
        before: &Occultation,
        sensor_from_icrf: &Rotation<Sensor, Icrf>,
    ) {
        let mag_g = seen.mag_g.unwrap_or(f64::INFINITY);
        let (id, electrons, mag) = (FIRST_BODY_ID + seen.number, self.electrons(mag_g), self.mag_instrument(mag_g));
        let [ifov_x, ifov_y] = self.camera.geometry.ifov_rad();
        if seen.radius_rad / ifov_x.min(ifov_y) < POINT_RADIUS_PX {
            if !before.hides(seen.apparent_icrf, seen.range_km) {
                self.sources.push(Source { id, electrons, mag, place: SourcePlace::Icrf(seen.apparent_icrf) });
            }
            return;
        }
        let law = if planet == Planet::Mercury { Law::LommelSeeliger } else { Law::Lambert };
        let [from_sun_km, from_observer_km] = standpoint.planet_km(planet);
        let phase_rad = Lighting { from_sun_km, from_observer_km }.phase_rad();
        let disc = Disc {
            body: Spheroid::sphere(seen.apparent_icrf, seen.range_km, planet.radius_km()),
            id,
            mag,
            to_sun: -from_sun_km.normalize(),
            law,
            e_per_sr: e_per_sr(electrons, law, phase_rad, seen.radius_rad),
            electrons: Some(electrons),
        };
        self.paint(&disc, before, sensor_from_icrf);
    }

    fn moon(&self, standpoint: &Standpoint) -> Option<Disc> {
        let body = standpoint.moon()?;
        let lighting = moon_lighting(standpoint);
        let mag_g = moon_v(&lighting) + SUN_G_LESS_V;
        let (law, electrons) = (Law::LommelSeeliger, self.electrons(mag_g));
        Some(Disc {
            body,
            id: FIRST_BODY_ID + MOON_NUMBER,
            mag: self.mag_instrument(mag_g),
            to_sun: -lighting.from_sun_km.normalize(),
            law,
            e_per_sr: e_per_sr(electrons, law, lighting.phase_rad(), body.angular_radius_rad()),
            electrons: Some(electrons),
        })
    }

    /// Returns the Earth: a Lambert sphere of its Bond albedo, as for its stray light.
    fn earth(&self, standpoint: &Standpoint) -> Option<Disc> {
        let body = standpoint.earth()?;
        let from_sun_km = standpoint.from_sun_km - standpoint.from_earth.position_km;
        let nearness = AU_KM * AU_KM / from_sun_km.length_squared();
        Some(Disc {
            body,
            id: FIRST_BODY_ID + EARTH_NUMBER,
            mag: f32::NAN,
            to_sun: -from_sun_km.normalize(),
            law: Law::Lambert,
            e_per_sr: self.electrons(SUN_MAG_G) * nearness * EARTH_ALBEDO / PI,
            electrons: None,
        })
    }

    fn paint(&mut self, disc: &Disc, before: &Occultation, sensor_from_icrf: &Rotation<Sensor, Icrf>) {
        let Self { painter, camera, sources, counts, .. } = self;
        if let Some(drawn) = painter.paint(disc, &camera.geometry, sensor_from_icrf, before, sources) {
            counts.disc_sources += drawn.sources;
            if drawn.sources > 0 {
                counts.coarsest_px = counts.coarsest_px.max(drawn.step_px);
            }
        }
    }
}

/// Returns every body as seen from there, the Sun first.
pub fn seen_from(standpoint: &Standpoint) -> Vec<SeenBody> {
    let mut all = vec![seen_sun(standpoint)];
    all.extend(standpoint.moon().map(|moon| seen_moon(standpoint, &moon)));
    all.extend(standpoint.earth().map(|earth| seen_earth(standpoint, &earth)));
    all.extend(Planet::ALL.map(|planet| seen_planet(standpoint, planet)));
    all
}

/// Returns the radiance that spreads these electrons over a disc.
fn e_per_sr(electrons: f64, law: Law, phase_rad: f64, radius_rad: f64) -> f64 {
    electrons / (law.over_disc(phase_rad).max(LEAST_OVER_DISC) * radius_rad.sin().powi(2))
}

/// Returns the Moon between Sun and observer.
fn moon_lighting(standpoint: &Standpoint) -> Lighting {
    let from_observer_km = -standpoint.from_moon.position_km;
    Lighting { from_sun_km: standpoint.from_sun_km + from_observer_km, from_observer_km }
}

fn seen_sun(standpoint: &Standpoint) -> SeenBody {
    let range_km = standpoint.from_sun_km.length();
    SeenBody {
        name: "Sun",
        number: 0,
        apparent_icrf: aberrated(-standpoint.from_sun_km / range_km, standpoint.observer.velocity_km_s),
        range_km,
        radius_rad: (SUN_RADIUS_KM / range_km).asin(),
        mag_g: Some(SUN_MAG_G + 5.0 * (range_km / AU_KM).log10()),
        lit_share: 1.0,
    }
}

fn seen_moon(standpoint: &Standpoint, body: &Spheroid) -> SeenBody {
    let lighting = moon_lighting(standpoint);
    SeenBody {
        name: "Moon",
        number: MOON_NUMBER,
        apparent_icrf: body.apparent_centre(),
        range_km: body.centre_km.length(),
        radius_rad: body.angular_radius_rad(),
        mag_g: Some(moon_v(&lighting) + SUN_G_LESS_V),
        lit_share: lighting.lit_share(),
    }
}

fn seen_earth(standpoint: &Standpoint, body: &Spheroid) -> SeenBody {
    let from_sun_km = standpoint.from_sun_km - standpoint.from_earth.position_km;
    SeenBody {
        name: "Earth",
        number: EARTH_NUMBER,
        apparent_icrf: body.apparent_centre(),
        range_km: body.centre_km.length(),
        radius_rad: body.angular_radius_rad(),
        mag_g: None,
        lit_share: Lighting { from_sun_km, from_observer_km: body.centre_km }.lit_share(),
    }
}

fn seen_planet(standpoint: &Standpoint, planet: Planet) -> SeenBody {
    let [from_sun_km, from_observer_km] = standpoint.planet_km(planet);
    let lighting = Lighting { from_sun_km, from_observer_km };
    let range_km = from_observer_km.length();
    let year = 2000.0 + standpoint.at.years_since_j2000();
    SeenBody {
        name: planet.name(),
        number: planet.number(),
        apparent_icrf: aberrated(from_observer_km / range_km, standpoint.observer.velocity_km_s),
        range_km,
        radius_rad: (planet.radius_km() / range_km).asin(),
        mag_g: Some(planet_v(planet, &lighting, year) + SUN_G_LESS_V),
        lit_share: lighting.lit_share(),
    }
}
