//! All that shines into one exposure: stars, planets and discs, targets on the sky, the background.
//!
//! In: a line of sight. Out: the sources, the targets, and what a person must be told of them ([`SceneReport`]). Allocates
//! nothing after its first frames.

use crate::runtime::engine::Slot;
use crate::runtime::error::RunError;
use crate::runtime::field_light::FieldLight;
use crate::runtime::ledger::{Event, EventKind, Ledger};
use crate::runtime::params::RunParams;
use crate::runtime::sky_bodies::{BodyCounts, SkyBodies};
use crate::runtime::sky_targets::SkyTargets;
use crate::runtime::sky_view::SkyView;
use base::time::Span;
use image::detector::Background;
use plan::attitude::LosPath;
use plan::exposure::Source;
use stars::Sky;
use stars::tiles::Shortfall;

/// What one camera may see.
pub struct Scene {
    /// Stars.
    pub stars: SkyView,
    /// Planets, Moon and Earth, where they are drawn.
    pub bodies: Option<SkyBodies>,
    /// Targets on the sky.
    pub targets: SkyTargets,
    light: FieldLight,
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
}

impl Scene {
    /// For a run, with the stars of `sky`.
    #[must_use]
    pub fn new(params: &RunParams, sky: &Sky) -> Self {
        let (camera, at) = (&params.camera, params.first_exposure);
        let observer = || params.observer.clone();
        Self {
            stars: SkyView::new(camera, observer(), at, sky).with_light_deflection(params.light_deflection),
            bodies: params.bodies.then(|| SkyBodies::new(camera, observer(), at)),
            targets: SkyTargets::new(camera, observer(), at, params.sky_targets.clone()),
            light: FieldLight::new(camera, observer(), at),
            has_stars: false,
            has_lost_reader: false,
        }
    }

    /// Finds all of it for an exposure; without stars its background only.
    ///
    /// # Errors
    /// When the observer's orbit cannot be computed at that time, or a tile of stars cannot be read.
    pub fn find(&mut self, los: &LosPath, has_stars: bool) -> Result<SceneReport, RunError> {
        let (background, glare) = self.light.at(los)?;
        let is_excluded = glare.excluded.contains(&true);
        let (shortfall, bodies) = (Shortfall::default(), BodyCounts::default());
        let (lost_reader, lost_targets) = (false, 0);
        let mut report = SceneReport { background, is_excluded, shortfall, lost_reader, bodies, lost_targets };
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

    /// The sources that were found.
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
    /// Tells the ledger.
    pub(super) fn note(&self, slot: Slot, ledger: &mut Ledger) {
        let Self { is_excluded, shortfall, lost_reader, bodies, .. } = *self;
        for (kind, happened) in [
            (EventKind::StarsLate, shortfall.late_tiles > 0),
            (EventKind::StarReaderLost, lost_reader),
            (EventKind::StarsCrowdedOut, shortfall.crowded_out_stars > 0),
            (EventKind::InsideExclusion, is_excluded),
            (EventKind::SunInField, bodies.has_sun),
            (EventKind::CoarseDisc, bodies.coarsest_px > 1.0),
        ] {
            if happened {
                ledger.note(Event::new(kind, slot.release, Some(slot.number), Span::ZERO));
            }
        }
        for _ in 0..self.lost_targets {
            ledger.note(Event::new(EventKind::TargetLost, slot.release, Some(slot.number), Span::ZERO));
        }
    }

    /// Stars that are missing, those too faint for the camera among them.
    pub(super) fn missing_stars(&self) -> usize {
        usize::try_from(self.shortfall.late_stars + self.shortfall.crowded_out_stars).unwrap_or(usize::MAX)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::time::Tai;

    #[test]
    fn lost_reader_is_an_event_with_a_name_of_its_own() {
        let at = Tai::from_ns(0);
        let slot = Slot { number: 3, exposure_start: at, exposure_end: at, release: at, due: at };
        let report = SceneReport {
            background: Background::default(),
            is_excluded: false,
            shortfall: Shortfall { late_tiles: 1, late_stars: 1, crowded_out_stars: 0 },
            lost_reader: true,
            bodies: BodyCounts::default(),
            lost_targets: 0,
        };
        let mut ledger = Ledger::default();
        report.note(slot, &mut ledger);
        SceneReport { lost_reader: false, ..report }.note(slot, &mut ledger);
        let count = |kind| ledger.count(kind);
        assert_eq!((count(EventKind::StarReaderLost), count(EventKind::StarsLate)), (1, 2));
    }
}
