//! The frame engine: one slot in, one finished frame out. Allocates nothing after its first frames, formats nothing,
//! touches no file and takes no lock.
//!
//! The line of sight is composed first; sources, plan, image, truth and metadata follow. For single images the motion is
//! given instead, and so may be the sources.

use crate::runtime::describe::{PathFacts, describe_exposure, describe_pointing};
use crate::runtime::error::{Result, RunError};
use crate::runtime::ledger::{Event, EventKind, Ledger, note_scene};
use crate::runtime::load::{LoadChange, Pace};
use crate::runtime::marks::{FrameMark, FrameMarks};
use crate::runtime::pointing::{Pointing, Shown};
use crate::runtime::slot::{Slot, Started};
use crate::runtime::{
    conditions::Conditions, drawer::Drawer, exposing::Exposing, imager::Imager, params::RunParams, receiver::Receiver,
};
use base::time::{Span, Tai};
use base::{clock::Stopwatch, refused::Refused, units::SPEED_OF_LIGHT_KM_S};
use frames::report::{Stage, StageTimes};
use frames::sink::{FaultFlags, SentFrame};
use glam::DVec3;
use image::{detector::DetectorConditions, detector::readout::Levels};
use plan::attitude::PathOrigin;
use plan::exposure::{Degradation, Motion, Source};
use scene::truth::{add_tracks, fill_targets, fill_truth, keep_shown};
use scene::{Scene, SceneReport, wcs::WcsMaker};
use sky::almanac::Almanac;
use stars::Sky;

pub use crate::runtime::describe::fill_meta;

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

/// Draws frames.
pub struct FrameEngine {
    /// Number of its head, by which it finds its mounting in the receiver.
    pub(crate) head: usize,
    /// The parameters that it was made with.
    pub params: RunParams,
    /// The times and settings of its exposures, for commands.
    pub exposing: Exposing,
    /// Plans and draws.
    pub drawer: Drawer,
    /// The conditions of the next exposure.
    pub(crate) conditions: Conditions,
    /// All that shines.
    pub scene: Scene,
    /// Maps from frames to the sky; `None` where frames have no map.
    pub wcs: Option<WcsMaker>,
    /// The time for drawing.
    pub pace: Pace,
    /// The line of sight of the latest frame.
    pub pointing: Pointing,
    /// Where the engine reports what each frame was drawn from, when a run is captured.
    pub(crate) marks: Option<FrameMarks>,
}

impl FrameEngine {
    /// Returns an engine with everything that can be made before the first frame.
    ///
    /// # Errors
    /// When the backend or the catalog is unavailable.
    pub fn new(params: RunParams) -> Result<Self> {
        let imager = Imager::of_detector(params.backend, params.camera.make_detector(params.seeds())?)?;
        let (sky, almanac) = (params.open_sky().map_err(RunError::Stars)?, params.almanac());
        Self::with_sky(params, imager, &sky, &almanac)
    }

    /// Returns an engine that uses an imager for the same camera, backend and seed; the heads of a run share its sky
    /// and its almanac.
    ///
    /// # Errors
    /// When the imager refuses the parameters.
    pub fn with_sky(params: RunParams, imager: Imager, sky: &Sky, almanac: &Almanac) -> Result<Self> {
        let camera = &params.camera;
        // A frame drawn for a display is not an image of the sky by this camera.
        let of_sensor = params.drawn_from_sensor.is_none();
        Ok(Self {
            head: 0,
            exposing: Exposing::new(&params),
            pace: Pace::new(&params, &imager),
            drawer: Drawer::new(&params, imager)?,
            conditions: Conditions::new(),
            scene: Scene::new(&params.scene(almanac), sky),
            wcs: of_sensor.then(|| WcsMaker::new(&camera.geometry, &camera.output())).flatten(),
            pointing: Pointing::new(),
            marks: None,
            params,
        })
    }

    /// Returns the engine for another head than the first.
    #[must_use]
    pub fn of_head(mut self, head: usize) -> Self {
        self.head = head;
        self
    }

    /// Passes the conditions to the planner.
    pub(super) fn take_conditions(&mut self) {
        self.drawer.use_optics(self.conditions.optics);
        self.drawer.planner.set_target_light(self.conditions.throughput);
    }

    /// Updates the load estimate with the time the latest frame took to draw and read out; `at` is the current time.
    /// Adds an event to the ledger when an overload starts or has ended.
    pub fn learn_load(&mut self, drawn: Span, at: Tai, slot: Slot, ledger: &mut Ledger) {
        let (plan_ms, regions) = (self.drawer.planner.latest().chosen.cost_ms, &self.exposing.settings().regions);
        let kind = match self.pace.learn(plan_ms, drawn, &self.params, regions) {
            None => return,
            Some(LoadChange::Overloaded) => EventKind::Overloaded,
            Some(LoadChange::Gone) => EventKind::LoadGone,
        };
        ledger.note(Event::new(kind, at, Some(slot.number), drawn));
    }

    /// Returns the longest time that a slot waits for jitter samples that are under way: zero without a stream of them
    /// or for frames drawn ahead, and at most half of the time that a frame like the one before leaves.
    pub fn jitter_wait(&self, slot: Slot, receiver: &Receiver) -> Span {
        let is_streaming = receiver.mountings.of(self.head).jitter.is_streaming(slot.exposure_end);
        if self.params.ahead > Span::ZERO || !is_streaming {
            return Span::ZERO;
        }
        let latest_ms = self.drawer.planner.latest().chosen.cost_ms;
        let regions = &self.exposing.settings_of(&slot).regions;
        receiver.params.settings.jitter_wait.min(self.pace.half_spare(latest_ms, &self.params, regions))
    }

    /// Returns true when jitter samples of a slot's exposure are still to come.
    pub fn lacks_jitter(&self, slot: Slot, receiver: &Receiver) -> bool {
        receiver.mountings.of(self.head).jitter.is_behind(slot.exposure_end + Span::from_s(0.5 * self.rows_s()))
    }

    /// Returns the time from the exposure of the first row to that of the last, s; the path must cover all rows.
    fn rows_s(&self) -> f64 {
        let camera = &self.params.camera;
        camera.shutter.line_s() * (camera.geometry.height_px() as f64 - 1.0)
    }

    /// Returns the observer's barycentric velocity divided by the speed of light, ICRF axes, as frames are drawn with
    /// it.
    ///
    /// # Errors
    /// When the observer's orbit cannot be computed at that time.
    pub fn observer_beta(&self, at: Tai) -> Result<DVec3, Refused> {
        Ok(self.scene.stars.observer().barycentric_state(at)?.velocity_km_s / SPEED_OF_LIGHT_KM_S)
    }

    /// Draws a frame into `frame` before the run, so that the first real frame needs no first-time work.
    ///
    /// # Errors
    /// When the backend failed.
    pub fn warm_up(&mut self, frame: &mut SentFrame) -> Result<()> {
        let Drawer { planner, imager, .. } = &mut self.drawer;
        let sources = self.scene.stars.in_view(&planner.latest().motion.los).map_err(RunError::Scene)?;
        let plan = planner.plan(sources);
        imager.image(plan, 0, &DetectorConditions::dark(plan.motion.los.exposure_s), &mut frame.image)?;
        // Clear residual charge: the warm-up frame must not affect frame 0.
        imager.reset_detector();
        Ok(())
    }

    /// Exposes one slot. `receiver` holds the messages that have arrived. Returns the times of the stages, or `None`
    /// when no attitude is available and the policy is to send no frame.
    ///
    /// # Errors
    /// When the backend failed or the policy for a stopped stream is to stop.
    pub fn expose(
        &mut self,
        slot: Slot,
        receiver: &mut Receiver,
        ledger: &mut Ledger,
        frame: &mut SentFrame,
    ) -> Result<Option<StageTimes>> {
        let mut times = bus_times(slot, receiver);
        let lengths_s = [self.exposing.exposure_s(), self.rows_s()];
        receiver.mountings.of_mut(self.head).jitter.set_exposure_s(lengths_s[0]);
        self.conditions.set_exposing(self.exposing.light_factor(), self.exposing.settings());
        let (regions, wait) = (&self.exposing.settings().regions, || self.jitter_wait(slot, receiver));
        if let Some(planner_ms) = self.pace.planner_ms(&self.params, regions, wait) {
            self.drawer.planner.set_time_budget_ms(planner_ms);
        }
        let mut watch = Stopwatch::start();
        self.follow_observer(receiver, slot, ledger);
        let los = &mut self.drawer.planner.motion_mut().los;
        let light = match self.pointing.compose((self.head, slot), lengths_s, receiver, los, ledger)? {
            Shown::Stars => Light::Sky,
            Shown::Dark => Light::Dark,
            Shown::Nothing => return Ok(None),
        };
        times.set(Stage::Attitude, watch.lap());
        self.draw(slot, light, ledger, frame, &mut times)?;
        receiver.mountings.of_mut(self.head).note_drawn(slot.exposure_end);
        frame.meta.attitude_age = receiver.attitudes.age_at(slot.release).unwrap_or(Span::ZERO);
        if let Some(marks) = &self.marks {
            let (load, degradation) = (self.pace.load(), frame.meta.degradation.name());
            let (messages, exposed) = (receiver.messages, self.exposing.exposed(&slot));
            marks.put(FrameMark { frame: slot.number, messages, load, degradation, exposed });
        }
        Ok(Some(times))
    }

    /// Passes the observer's states from outside to the scene; notes states that do not fit an orbit and slots far from
    /// all states.
    fn follow_observer(&mut self, receiver: &mut Receiver, slot: Slot, ledger: &mut Ledger) {
        for (at, state) in receiver.mountings.of_mut(self.head).take_observers() {
            if self.scene.follow_observer(at, state).is_err() {
                note(ledger, EventKind::SampleRefused, slot, slot.release - at);
            }
        }
        if self.scene.is_observer_far(slot.exposure_end) {
            note(ledger, EventKind::ObserverPredicted, slot, Span::ZERO);
        }
    }

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
    /// drawer's imager. Returns the times of the stages.
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
        let Drawer { planner, imager, .. } = &mut self.drawer;
        imager.render(planner.latest())?;
        times.set(Stage::Render, watch.lap());
        let (plan, whole) = (planner.latest(), self.params.camera.whole_sensor());
        let sight = self.scene.stars.sight().filter(|_| light.is_on_sky());
        fill_truth(plan, &whole, sight, &mut frame.truth);
        name_stars(&self.scene, light, frame);
        fill_targets(plan, self.scene.targets.facts(), &whole, &mut frame.targets);
        let levels = Levels::of_output(&self.params.camera.detector);
        fill_meta(plan, slot.number, self.params.seeds(), &levels, imager.name(), &mut frame.meta);
        (frame.meta.binning, frame.meta.window_px) = (whole.binning, whole.first_px);
        frame.meta.facts = Some(self.params.camera.facts_of(&levels));
        Ok(times)
    }

    /// Sets the motion of the next image.
    fn aim(&mut self, motion: &Motion) {
        self.pointing.path = PathFacts::default();
        self.conditions.set_exposing(self.exposing.light_factor(), self.exposing.settings());
        self.drawer.planner.motion_mut().clone_from(motion);
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
        let planner = &mut self.drawer.planner;
        let los = &planner.latest().motion.los;
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
        planner.set_targets_on_sky(self.scene.targets.in_view());
        times.set(Stage::Sky, watch.lap());
        planner.plan(sources);
        times.set(Stage::Plan, watch.lap());
        Ok((found, conditions))
    }

    /// Draws, reads out and describes the image whose line of sight is in the planner.
    fn draw(
        &mut self,
        slot: Slot,
        light: Light<'_>,
        ledger: &mut Ledger,
        frame: &mut SentFrame,
        times: &mut StageTimes,
    ) -> Result<()> {
        let (found, conditions) = self.find_and_plan(slot, light, ledger, times)?;
        let Drawer { planner, imager, .. } = &mut self.drawer;
        let plan = planner.latest();
        let is_coarse = self.scene.targets.is_coarse || plan.targets.iter().any(|target| target.is_coarse);
        if !plan.chosen.verdict.is_met() || is_coarse {
            note(ledger, EventKind::OverBudget, slot, Span::ZERO);
        }
        if plan.degradation > Degradation::Full {
            let predicted = Span::from_s(plan.chosen.cost_ms * 1e-3);
            let (at, frame, degradation) = (slot.release, Some(slot.number), plan.degradation);
            ledger.note(Event { kind: EventKind::Degraded, at, frame, span: predicted, degradation, what: "" });
        }
        let left_out = imager.disturbances().protons_left_out();
        let imaging = imager.image(plan, slot.number, &conditions, &mut frame.image)?;
        if imager.disturbances().protons_left_out() > left_out {
            note(ledger, EventKind::ProtonsLeftOut, slot, Span::ZERO);
        }
        times.merge(&imaging.by_stage());
        self.describe(slot, light, &conditions, &found, frame);
        self.exposing.see(&frame.image, slot.release, ledger);
        Ok(())
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
        let (plan, imager) = (self.drawer.planner.latest(), &self.drawer.imager);
        let output = self.params.camera.output();
        let sight = self.scene.stars.sight().filter(|_| !matches!(light, Light::Sources { is_on_sky: false, .. }));
        fill_truth(plan, &output, sight, &mut frame.truth);
        name_stars(&self.scene, light, frame);
        fill_targets(plan, self.scene.targets.facts(), &output, &mut frame.targets);
        add_tracks(imager.disturbances().proton_tracks(), &output, &mut frame.truth);
        keep_shown(plan, &output, &conditions.regions, &mut frame.truth, &mut frame.targets);
        let levels = Levels::of_exposure(&self.params.camera.detector, conditions);
        let meta = &mut frame.meta;
        fill_meta(plan, slot.number, self.params.seeds(), &levels, imager.name(), meta);
        if let Some(drawn_from_sensor) = &self.params.drawn_from_sensor {
            describe_pointing(&plan.motion.los, &drawn_from_sensor.inverse(), meta);
        }
        meta.facts = self.params.drawn_from_sensor.is_none().then(|| self.params.camera.facts_of(&levels));
        let sight = sight.filter(|_| light.is_on_sky());
        meta.observer_beta = sight.map_or([0.0; 3], |sight| sight.observer_beta().to_array());
        let maker = self.wcs.as_mut().zip(sight);
        meta.wcs = maker.and_then(|(maker, sight)| maker.at(&plan.motion.los.mid_sensor_from_icrf, sight));
        self.pointing.path.describe(meta);
        describe_exposure(&slot, self.exposing.settings(), meta);
        meta.left_out_stars += found.missing_stars();
        meta.occulted_stars = found.bodies.occulted;
        meta.overlap_lost_e = imager.overlap_lost_e();
        (meta.binning, meta.window_px) = (output.binning, output.first_px);
        meta.faults |= flags_of(plan.motion.los.origin, !matches!(light, Light::Dark));
    }
}

/// Writes the catalog numbers of stars into the truth; given sources are in no catalog.
fn name_stars(scene: &Scene, light: Light<'_>, frame: &mut SentFrame) {
    match light {
        Light::Sky | Light::Dark => scene.stars.name_stars(&mut frame.truth),
        Light::Sources { is_on_sky: true, .. } => {}
        // Sources given in pixels, and no attitude: they are nowhere on the sky.
        Light::Sources { is_on_sky: false, .. } => {
            frame.truth.iter_mut().for_each(|row| row.apparent_deg = [f64::NAN; 2]);
        }
    }
}

/// Returns the flags of a frame that shows no stars or a held attitude.
fn flags_of(origin: PathOrigin, has_stars: bool) -> FaultFlags {
    let blank = if has_stars { FaultFlags::NONE } else { FaultFlags::BLANK };
    let stale = if origin == PathOrigin::Held { FaultFlags::LINK_STALE } else { FaultFlags::NONE };
    blank | stale
}

/// Returns the age at the slot's release of what the bus brought, the uncertainty of its time, and the delay from the
/// trigger to the exposure.
fn bus_times(slot: Slot, receiver: &Receiver) -> StageTimes {
    let mut times = StageTimes::default();
    let trigger = match slot.started {
        Started::Rate => None,
        Started::Trigger { .. } => Some(slot.trigger_delay()),
    };
    let known = [
        (Stage::Trigger, trigger),
        (Stage::BusAge, receiver.attitudes.age_at(slot.release)),
        (Stage::ArrivalAge, receiver.attitudes.arrival_age_at(slot.release)),
        (Stage::Correlation, receiver.clock.remote.estimate().map(|estimate| estimate.spread)),
    ];
    for (stage, span) in known {
        if let Some(span) = span {
            times.set(stage, span);
        }
    }
    times
}

fn note(ledger: &mut Ledger, kind: EventKind, slot: Slot, span: Span) {
    ledger.note(Event::new(kind, slot.release, Some(slot.number), span));
}
