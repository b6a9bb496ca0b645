//! All that shines into one exposure: stars, planets and discs, targets on the sky, the background.
//!
//! In: a line of sight. Out: the sources, the targets, and what a person must be told of them ([`SceneReport`]). Allocates
//! nothing after its first frames.

use crate::camera::CameraParams;
use crate::error::SceneError;
use crate::field_light::FieldLight;
use crate::sky_bodies::{BodyCounts, SkyBodies};
use crate::sky_targets::{SkyTarget, SkyTargets};
use crate::sky_view::SkyView;
use base::time::Tai;
use image::detector::Background;
use plan::attitude::LosPath;
use plan::exposure::Source;
use sky::almanac::Almanac;
use sky::observer::{BarycentricState, Observer, ObserverTrack};
use stars::Sky;
use stars::tiles::Shortfall;

/// What a scene is made from.
#[derive(Debug, Clone, Copy)]
pub struct SceneParams<'a> {
    /// The camera.
    pub camera: &'a CameraParams,
    /// Where the sensor is.
    pub observer: &'a Observer,
    /// Days prepared for the exposures.
    pub almanac: &'a Almanac,
    /// Whether the Sun bends the light of stars.
    pub light_deflection: bool,
    /// Whether planets, Moon and Earth are drawn, and hide what is behind them.
    pub bodies: bool,
    /// Targets on the sky.
    pub targets: &'a [SkyTarget],
}

/// What one camera may see.
pub struct Scene {
    /// Stars.
    pub stars: SkyView,
    /// Planets, Moon and Earth, where they are drawn.
    pub bodies: Option<SkyBodies>,
    /// Targets on the sky.
    pub targets: SkyTargets,
    /// The light beside them.
    pub light: FieldLight,
    almanac: Almanac,
    /// The latest exposure shows more than background.
    has_stars: bool,
    /// It was reported that tiles are read no more.
    has_lost_reader: bool,
}

/// What was found for an exposure.
#[derive(Debug, Clone, Copy)]
pub struct SceneReport {
    /// Light in every pixel.
    pub background: Background,
    /// The boresight is inside an exclusion angle of the baffle.
    pub is_excluded: bool,
    /// Stars that are missing.
    pub shortfall: Shortfall,
    /// The thread that reads stars broke down since the exposure before.
    pub lost_reader: bool,
    /// What bodies hide, and how they are drawn.
    pub bodies: BodyCounts,
    /// Targets whose orbits could be followed until now.
    pub lost_targets: u32,
    /// A day of the almanac was not prepared: its series were evaluated in this call.
    pub evaluated_series: bool,
}

impl Scene {
    /// Makes the scene of a camera, with the stars of `sky`.
    #[must_use]
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

    /// Takes in the observer's state at an instant, from outside, relative to the body it is about: km and km/s, ICRF axes.
    ///
    /// # Errors
    /// When a number is not finite, too large, or below the surface of the body.
    pub fn follow_observer(&mut self, at: Tai, state: BarycentricState) -> Result<(), SceneError> {
        let bodies = self.bodies.as_mut().map(SkyBodies::observer_mut);
        let light = self.light.observer_mut();
        let tracks = [self.stars.observer_mut(), self.targets.observer_mut()].into_iter().chain(bodies).chain(light);
        for track in tracks {
            track.follow(at, state)?;
        }
        Ok(())
    }

    /// Returns true when the observer's states come from outside, and the nearest is far from an instant.
    #[must_use]
    pub fn is_observer_far(&self, at: Tai) -> bool {
        self.stars.observer().is_far(at)
    }

    /// Finds all of it for an exposure; without stars its background only.
    ///
    /// # Errors
    /// When the observer's orbit cannot be computed at that time, or a tile of stars cannot be read.
    pub fn find(&mut self, los: &LosPath, has_stars: bool) -> Result<SceneReport, SceneError> {
        let evaluated = self.almanac.evaluated();
        let mut report = self.find_all(los, has_stars)?;
        report.evaluated_series = self.almanac.evaluated() > evaluated;
        Ok(report)
    }

    fn find_all(&mut self, los: &LosPath, has_stars: bool) -> Result<SceneReport, SceneError> {
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
        report.shortfall = self.stars.shortfall();
        report.lost_reader = self.stars.has_lost_reader() && !self.has_lost_reader;
        self.has_lost_reader |= report.lost_reader;
        if let Some(bodies) = &mut self.bodies {
            bodies.expect_sweep(los.rate_rad_s.length() * los.exposure_s);
            bodies.seen(self.stars.found(), &los.mid_sensor_from_icrf, los.mid_exposure())?;
            report.bodies = bodies.counts();
        }
        report.lost_targets = self.targets.find_in_view(los)?;
        if let Some(bodies) = &self.bodies {
            // Where a target sets behind the Earth is part of its light; the Moon hides it for all of the exposure or none.
            self.targets.leave_out(|seen| bodies.before().moon_hides(seen.apparent_icrf, seen.range_km));
        }
        Ok(report)
    }

    /// Returns the sources that were found.
    #[must_use]
    pub fn sources(&self) -> &[Source] {
        match &self.bodies {
            _ if !self.has_stars => &[],
            Some(bodies) => bodies.sources(),
            None => self.stars.found(),
        }
    }
}

impl SceneReport {
    /// Returns how many stars are missing, those too faint for the camera among them.
    #[must_use]
    pub fn missing_stars(&self) -> usize {
        usize::try_from(self.shortfall.late_stars + self.shortfall.crowded_out_stars).unwrap_or(usize::MAX)
    }
}
