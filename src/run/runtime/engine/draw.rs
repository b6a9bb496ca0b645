//! The second half of a frame: the line of sight is known; sources, plan, image, truth and metadata follow.

use super::{FrameEngine, note};
use crate::runtime::describe::{PathFacts, describe_exposure, describe_pointing, fill_meta};
use crate::runtime::error::{Result, RunError};
use crate::runtime::ledger::{Event, EventKind, Ledger, note_scene};
use crate::runtime::slot::Slot;
use base::{clock::Stopwatch, time::Span};
use frames::report::{Stage, StageTimes};
use frames::sink::{FaultFlags, SentFrame};
use image::{detector::DetectorConditions, detector::readout::Levels};
use plan::attitude::PathOrigin;
use plan::exposure::{Degradation, Motion, Source};
use scene::SceneReport;
use scene::truth::{add_tracks, fill_targets, fill_truth, keep_shown};

/// Light of one exposure.
#[derive(Debug, Clone, Copy)]
pub enum Light<'a> {
    /// The sky.
    Sky,
    /// Nothing but background.
    Dark,
    /// Given sources in place of the sky's.
    Sources {
        /// The sources.
        sources: &'a [Source],
        /// True when the attitude is that of the sky: their directions are in the truth, and the image has a map.
        is_on_sky: bool,
    },
}

impl Light<'_> {
    /// Returns whether pixels of the image have directions on the sky.
    pub fn is_on_sky(self) -> bool {
        match self {
            Self::Sky => true,
            Self::Dark => false,
            Self::Sources { is_on_sky, .. } => is_on_sky,
        }
    }
}

impl FrameEngine {
    /// Exposes a slot along a given motion, without messages: for single images. Returns the times of the stages.
    ///
    /// # Errors
    /// When the backend failed, or the sky cannot be computed at that time.
    pub fn expose_along(
        &mut self,
        slot: Slot,
        motion: &Motion,
        light: Light<'_>,
        ledger: &mut Ledger,
        frame: &mut SentFrame,
    ) -> Result<StageTimes> {
        let mut times = StageTimes::default();
        self.aim(motion);
        self.draw(slot, light, ledger, frame, &mut times)?;
        Ok(times)
    }

    /// Finds the sources of a given motion, plans, and draws the mean electrons before the detector; they stay in the
    /// imager ([`Self::imager`]). Returns the times of the stages.
    ///
    /// # Errors
    /// When the backend failed, or the sky cannot be computed at that time.
    pub fn mean_along(
        &mut self,
        slot: Slot,
        motion: &Motion,
        light: Light<'_>,
        ledger: &mut Ledger,
        frame: &mut SentFrame,
    ) -> Result<StageTimes> {
        let mut times = StageTimes::default();
        self.aim(motion);
        self.find_and_plan(slot, light, ledger, &mut times)?;
        let mut watch = Stopwatch::start();
        self.imager.render(self.planner.latest())?;
        times.set(Stage::Render, watch.lap());
        let (plan, whole) = (self.planner.latest(), self.params.camera.whole_sensor());
        let sight = self.scene.stars.sight().filter(|_| light.is_on_sky());
        fill_truth(plan, &whole, sight, &mut frame.truth);
        self.name_stars(light, frame);
        fill_targets(plan, self.scene.targets.facts(), &whole, &mut frame.targets);
        let levels = Levels::of_output(&self.params.camera.detector);
        fill_meta(plan, slot.number, self.params.seeds(), &levels, self.imager.name(), &mut frame.meta);
        (frame.meta.binning, frame.meta.window_px) = (whole.binning, whole.first_px);
        frame.meta.facts = Some(self.params.camera.facts_of(&levels));
        Ok(times)
    }

    /// Sets the motion of the next image.
    fn aim(&mut self, motion: &Motion) {
        self.path = PathFacts::default();
        self.conditions.set_exposing(self.exposing.light_factor(), self.exposing.settings());
        self.planner.motion_mut().clone_from(motion);
    }

    /// Finds what shines into the exposure and plans its image.
    fn find_and_plan(
        &mut self,
        slot: Slot,
        light: Light<'_>,
        ledger: &mut Ledger,
        times: &mut StageTimes,
    ) -> Result<(SceneReport, DetectorConditions)> {
        let mut watch = Stopwatch::start();
        let los = &self.planner.latest().motion.los;
        let found = self.scene.find(los, matches!(light, Light::Sky)).map_err(RunError::Scene)?;
        if let Light::Sources { is_on_sky: true, .. } = light {
            self.scene.stars.look(los.mid_exposure()).map_err(RunError::Scene)?;
        }
        note_scene(&found, slot, ledger);
        let conditions = self.conditions.of_detector(los.exposure_s, found.background);
        let (camera, sensor_from_icrf) = (&self.params.camera.geometry, los.mid_sensor_from_icrf);
        let sources = match light {
            Light::Sky => self.scene.sources(),
            Light::Dark => &[],
            Light::Sources { sources, .. } => sources,
        };
        let sources = match light {
            Light::Dark => sources,
            Light::Sky | Light::Sources { .. } => {
                self.conditions.seen(sources, camera, &sensor_from_icrf, self.params.seed)
            }
        };
        self.planner.set_targets_on_sky(self.scene.targets.in_view());
        times.set(Stage::Sky, watch.lap());
        self.planner.plan(sources);
        times.set(Stage::Plan, watch.lap());
        Ok((found, conditions))
    }

    /// Draws, reads out and describes the image whose line of sight is in the planner.
    pub(super) fn draw(
        &mut self,
        slot: Slot,
        light: Light<'_>,
        ledger: &mut Ledger,
        frame: &mut SentFrame,
        times: &mut StageTimes,
    ) -> Result<()> {
        let (found, conditions) = self.find_and_plan(slot, light, ledger, times)?;
        let plan = self.planner.latest();
        let is_coarse = self.scene.targets.is_coarse || plan.targets.iter().any(|target| target.is_coarse);
        if !plan.chosen.verdict.is_met() || is_coarse {
            note(ledger, EventKind::OverBudget, slot, Span::ZERO);
        }
        if plan.degradation > Degradation::Full {
            let predicted = Span::from_s(plan.chosen.cost_ms * 1e-3);
            let (at, frame, degradation) = (slot.release, Some(slot.number), plan.degradation);
            ledger.note(Event { kind: EventKind::Degraded, at, frame, span: predicted, degradation, what: "" });
        }
        let left_out = self.imager.disturbances().protons_left_out();
        let imaging = self.imager.image(plan, slot.number, &conditions, &mut frame.image)?;
        if self.imager.disturbances().protons_left_out() > left_out {
            note(ledger, EventKind::ProtonsLeftOut, slot, Span::ZERO);
        }
        times.merge(&imaging.by_stage());
        self.describe(slot, light, &conditions, &found, frame);
        self.exposing.see(&frame.image, slot.release, ledger);
        Ok(())
    }

    /// Writes the catalog numbers of stars into the truth; given sources are in no catalog.
    fn name_stars(&self, light: Light<'_>, frame: &mut SentFrame) {
        match light {
            Light::Sky | Light::Dark => self.scene.stars.name_stars(&mut frame.truth),
            Light::Sources { is_on_sky: true, .. } => {}
            // Sources given in pixels, and no attitude: they are nowhere on the sky.
            Light::Sources { is_on_sky: false, .. } => {
                frame.truth.iter_mut().for_each(|row| row.apparent_deg = [f64::NAN; 2]);
            }
        }
    }

    /// Fills in the truth and the metadata of the image that was drawn.
    fn describe(
        &mut self,
        slot: Slot,
        light: Light<'_>,
        conditions: &DetectorConditions,
        found: &SceneReport,
        frame: &mut SentFrame,
    ) {
        let plan = self.planner.latest();
        let output = self.params.camera.output();
        let sight = self.scene.stars.sight().filter(|_| !matches!(light, Light::Sources { is_on_sky: false, .. }));
        fill_truth(plan, &output, sight, &mut frame.truth);
        self.name_stars(light, frame);
        fill_targets(plan, self.scene.targets.facts(), &output, &mut frame.targets);
        add_tracks(self.imager.disturbances().proton_tracks(), &output, &mut frame.truth);
        keep_shown(plan, &output, &conditions.regions, &mut frame.truth, &mut frame.targets);
        let levels = Levels::of_exposure(&self.params.camera.detector, conditions);
        fill_meta(plan, slot.number, self.params.seeds(), &levels, self.imager.name(), &mut frame.meta);
        if let Some(drawn_from_sensor) = &self.params.drawn_from_sensor {
            describe_pointing(&plan.motion.los, &drawn_from_sensor.inverse(), &mut frame.meta);
        }
        frame.meta.facts = self.params.drawn_from_sensor.is_none().then(|| self.params.camera.facts_of(&levels));
        let maker = self.wcs.as_mut().filter(|_| light.is_on_sky()).zip(sight);
        frame.meta.observer_beta =
            sight.filter(|_| light.is_on_sky()).map_or([0.0; 3], |sight| sight.observer_beta().to_array());
        frame.meta.wcs = maker.and_then(|(maker, sight)| maker.at(&plan.motion.los.mid_sensor_from_icrf, sight));
        self.path.describe(&mut frame.meta);
        describe_exposure(&slot, self.exposing.settings(), &mut frame.meta);
        frame.meta.left_out_stars += found.missing_stars();
        frame.meta.occulted_stars = found.bodies.occulted;
        frame.meta.overlap_lost_e = self.imager.overlap_lost_e();
        (frame.meta.binning, frame.meta.window_px) = (output.binning, output.first_px);
        frame.meta.faults |= flags_of(plan.motion.los.origin, !matches!(light, Light::Dark));
    }
}

/// Returns the flags of a frame that shows no stars or a held attitude.
fn flags_of(origin: PathOrigin, has_stars: bool) -> FaultFlags {
    let blank = if has_stars { FaultFlags::NONE } else { FaultFlags::BLANK };
    let stale = if origin == PathOrigin::Held { FaultFlags::LINK_STALE } else { FaultFlags::NONE };
    blank | stale
}
