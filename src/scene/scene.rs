//! Finds all light sources of one exposure: stars, planets and discs, targets on the sky, the background.
//!
//! In: a line of sight. Out: the sources, the targets, and facts about them for the user ([`SceneReport`]). Allocates
//! nothing after its first frames.

use crate::camera::{self, CameraParams};
use crate::sky_bodies::{BodyCounts, SkyBodies};
use crate::sky_targets::{SkyTarget, SkyTargets};
use crate::{field_light::FieldLight, sky_view::SkyView};
use base::{refused::Refused, time::Tai};
use image::detector::Background;
use plan::{attitude::LosPath, exposure::Source};
use sky::almanac::Almanac;
use sky::observer::{BarycentricState, Observer, ObserverTrack};
use stars::{Sky, tiles::Shortfall};

/// Parameters of a scene.
#[derive(Debug, Clone, Copy)]
pub struct SceneParams<'a> {
    /// The camera.
    pub camera: &'a CameraParams,
    /// Position of the observer.
    pub observer: &'a Observer,
    /// Days prepared for the exposures.
    pub almanac: &'a Almanac,
    /// True when the Sun's light deflection is applied to stars.
    pub light_deflection: bool,
    /// True when planets, Moon and Earth are drawn and hide the sources behind them.
    pub bodies: bool,
    /// Targets on the sky.
    pub targets: &'a [SkyTarget],
}

/// Everything one camera may see.
pub struct Scene {
    /// Stars.
    pub stars: SkyView,
    /// Planets, Moon and Earth, if they are drawn.
    pub bodies: Option<SkyBodies>,
    /// Targets on the sky.
    pub targets: SkyTargets,
    /// The light besides them.
    pub light: FieldLight,
    almanac: Almanac,
    /// True when the latest exposure shows more than background.
    has_stars: bool,
    /// True when the loss of the reader of tiles has been reported.
    has_lost_reader: bool,
}

/// Report about the scene of an exposure.
#[derive(Debug, Clone, Copy)]
pub struct SceneReport {
    /// Light in every pixel.
    pub background: Background,
    /// True when the boresight is inside an exclusion angle of the baffle.
    pub is_excluded: bool,
    /// Stars that are missing.
    pub shortfall: Shortfall,
    /// True when the thread that reads stars has failed since the previous exposure.
    pub lost_reader: bool,
    /// Counts of hidden stars and drawn bodies.
    pub bodies: BodyCounts,
    /// Number of targets whose orbits can no longer be followed.
    pub lost_targets: u32,
    /// True when a day of the almanac was not prepared, so that its series were evaluated in this call.
    pub evaluated_series: bool,
}

impl Scene {
    /// Returns the scene of a camera, with the stars of `sky`.
    pub fn new(params: &SceneParams<'_>, sky: &Sky) -> Self {
        let SceneParams { camera, almanac, .. } = *params;
        let observer = || ObserverTrack::with_almanac(params.observer.clone(), almanac.clone());
        Self {
            stars: SkyView::new(camera, observer(), sky).with_light_deflection(params.light_deflection),
            bodies: params.bodies.then(|| SkyBodies::new(camera, observer())),
            targets: SkyTargets::new(camera, observer(), params.targets.to_vec()),
            light: FieldLight::new(camera, observer()),
            almanac: almanac.clone(),
            has_stars: false,
            has_lost_reader: false,
        }
    }

    /// Accepts the observer's state at an instant, from outside, relative to the body that it orbits: km and km/s, ICRF
    /// axes.
    ///
    /// # Errors
    /// When a number is not finite, too large, or below the surface of the body.
    pub fn follow_observer(&mut self, at: Tai, state: BarycentricState) -> Result<(), Refused> {
        let bodies = self.bodies.as_mut().map(SkyBodies::observer_mut);
        let light = self.light.observer_mut();
        let tracks = [self.stars.observer_mut(), self.targets.observer_mut()].into_iter().chain(bodies).chain(light);
        for track in tracks {
            track.follow(at, state).map_err(camera::observer)?;
        }
        Ok(())
    }

    /// Returns true when the observer's states come from outside, and the nearest is far from an instant.
    pub fn is_observer_far(&self, at: Tai) -> bool {
        self.stars.observer().is_far(at)
    }

    /// Finds everything for an exposure; without stars only its background.
    ///
    /// # Errors
    /// When the observer's orbit cannot be computed at that time, or a tile of stars cannot be read.
    pub fn find(&mut self, los: &LosPath, has_stars: bool) -> Result<SceneReport, Refused> {
        let evaluated = self.almanac.evaluated();
        let mut report = self.find_all(los, has_stars)?;
        report.evaluated_series = self.almanac.evaluated() > evaluated;
        Ok(report)
    }

    fn find_all(&mut self, los: &LosPath, has_stars: bool) -> Result<SceneReport, Refused> {
        let (background, glare) = self.light.at(los)?;
        let is_excluded = glare.excluded.contains(&true);
        let (shortfall, bodies) = (Shortfall::default(), BodyCounts::default());
        let mut report = SceneReport {
            background,
            is_excluded,
            shortfall,
            lost_reader: false,
            bodies,
            lost_targets: 0,
            evaluated_series: false,
        };
        self.has_stars = has_stars;
        if !has_stars {
            self.targets.forget();
            return Ok(report);
        }
        self.stars.find_in_view(los)?;
        report.shortfall = self.stars.shortfall;
        report.lost_reader = self.stars.has_lost_reader() && !self.has_lost_reader;
        self.has_lost_reader |= report.lost_reader;
        if let Some(bodies) = &mut self.bodies {
            bodies.expect_sweep(los.rate_rad_s.length() * los.exposure_s);
            bodies.seen(self.stars.found(), &los.mid_sensor_from_icrf, los.mid_exposure())?;
            report.bodies = bodies.counts();
        }
        report.lost_targets = self.targets.find_in_view(los)?;
        if let Some(bodies) = &self.bodies {
            // A target's setting behind the Earth is part of its light; the Moon hides it for all of the exposure or
            // not at all.
            self.targets.leave_out(|seen| bodies.before.moon_hides(seen.apparent_icrf, seen.range_km));
        }
        Ok(report)
    }

    /// Returns the sources of the latest exposure.
    pub fn sources(&self) -> &[Source] {
        match &self.bodies {
            _ if !self.has_stars => &[],
            Some(bodies) => bodies.sources(),
            None => self.stars.found(),
        }
    }
}

impl SceneReport {
    /// Returns the number of missing stars, including those too faint for the camera.
    pub fn missing_stars(&self) -> usize {
        usize::try_from(self.shortfall.late_stars + self.shortfall.crowded_out_stars).unwrap_or(usize::MAX)
    }
}
