//! The frame engine: one slot in, one finished frame out. Allocates nothing after its first frames, formats nothing,
//! touches no file and takes no lock.

use crate::runtime::conditions::Conditions;
use crate::runtime::describe::{describe_exposure, describe_pointing};
pub use crate::runtime::describe::{fill_meta, origin_name};
use crate::runtime::error::RunError;
use crate::runtime::exposing::Exposing;
use crate::runtime::imager::Imager;
use crate::runtime::ledger::{Event, EventKind, Ledger};
use crate::runtime::load::{LoadChange, LoadEstimate};
use crate::runtime::marks::{FrameMark, FrameMarks};
use crate::runtime::params::RunParams;
use crate::runtime::path_facts::PathFacts;
use crate::runtime::receiver::Receiver;
use crate::runtime::scene_events;
use crate::runtime::slot::{Slot, Started};
use base::axes::Rotation;
use base::clock::Stopwatch;
use base::region::Regions;
use base::time::{Span, Tai};
use base::units::SPEED_OF_LIGHT_KM_S;
use frames::report::{Stage, StageTimes};
use frames::sink::{FaultFlags, SentFrame};
use glam::DVec3;
use image::detector::DetectorConditions;
use image::detector::binning::Levels;
use image::detector::defects::Defects;
use plan::attitude::{
    AttitudeMethod, EstimateLimits, JitterTrack, LosPath, MotionScale, PathOrigin, PathOutcome, PathReport, compose,
};
use plan::exposure::cost::CostModel;
use plan::exposure::{Degradation, Instrument, Planner, Source, SourcePlace};
use plan::optics::PsfModel;
use scene::Scene;
use scene::error::SceneError;
use scene::field_light::illumination_map;
use scene::truth::{add_tracks, fill_targets, fill_truth, keep_shown};
use scene::wcs::WcsMaker;
use sky::almanac::Almanac;
use stars::Sky;

/// What a slot shows.
enum Shown {
    Stars,
    Dark,
    Nothing,
}

/// Draws frames.
pub struct FrameEngine {
    params: RunParams,
    exposing: Exposing,
    planner: Planner,
    /// Planners of other optics; the place of the one in use is empty.
    optics: Vec<Option<Planner>>,
    /// Which optics are in use.
    in_use: usize,
    conditions: Conditions,
    scene: Scene,
    /// Maps of frames to the sky; `None` where there are none.
    wcs: Option<WcsMaker>,
    imager: Imager,
    cost: CostModel,
    /// Followed on the real clock only.
    load: Option<LoadEstimate>,
    /// How the body may move, where that is known.
    motion: Option<MotionScale>,
    pointing_bound_rad: Option<f64>,
    /// The latest frame's line of sight.
    path: PathFacts,
    /// Where it says what each frame was drawn from, when a run is captured.
    marks: Option<FrameMarks>,
}

impl FrameEngine {
    /// Returns everything that can be made before the first frame.
    ///
    /// # Errors
    /// When the backend or the catalog is unavailable.
    pub fn new(params: RunParams) -> Result<Self, RunError> {
        let imager = Imager::of_detector(params.backend, params.camera.make_detector(params.seeds())?)?;
        let (sky, almanac) = (params.open_sky()?, params.almanac());
        Self::with_sky(params, imager, &sky, &almanac)
    }

    /// Makes it with an imager for the same camera, backend and seed; the heads of a run share its sky and its almanac.
    ///
    /// # Errors
    /// When the imager refuses what the parameters want of it.
    pub fn with_sky(params: RunParams, mut imager: Imager, sky: &Sky, almanac: &Almanac) -> Result<Self, RunError> {
        imager.disturbances_mut().defects_mut().set_frame_period_s(params.frame_period.s());
        let camera = &params.camera;
        let mut los = LosPath::commanded(Rotation::IDENTITY, params.first_exposure, camera.exposure_s);
        let attitude = &params.attitude;
        los.jitter = JitterTrack::with_capacity(attitude.jitter_lines.len(), attitude.jitter_history.capacity);
        let cost = params.cost.unwrap_or(imager.cost());
        let planner = new_planner(&params, &imager, los, None);
        if params.keeps_brighter && params.has_targets() {
            imager.keep_brighter()?;
        }
        let scene = Scene::new(&params.scene(almanac), sky);
        // What is drawn for a display is no image of the sky by this camera.
        let of_sensor = params.drawn_from_sensor.is_none();
        let wcs = of_sensor.then(|| WcsMaker::new(&camera.geometry, &camera.output())).flatten();
        if let Some(map) = illumination_map(camera) {
            imager.set_illumination_map(map)?;
        }
        Ok(Self {
            exposing: Exposing::new(&params),
            planner,
            optics: vec![None],
            in_use: 0,
            conditions: Conditions::new(),
            scene,
            wcs,
            imager,
            params,
            cost,
            load: None,
            motion: None,
            pointing_bound_rad: None,
            path: PathFacts::default(),
            marks: None,
        })
    }

    /// Makes other optics ready, with everything they need to be switched to within a frame; their number.
    ///
    /// # Errors
    /// When the backend cannot have another set of tables.
    pub fn add_optics(&mut self, psf: PsfModel) -> Result<usize, RunError> {
        let los = self.planner.latest().motion.los.clone();
        let mut planner = new_planner(&self.params, &self.imager, los, Some(psf));
        // One star, drawn once: all tables are built.
        let camera = &self.params.camera.geometry;
        let middle = [0.5 * camera.width_px() as f64, 0.5 * camera.height_px() as f64];
        let star = Source { id: 0, electrons: 1e4, mag: f32::NAN, place: SourcePlace::Pixel(middle) };
        self.imager.add_tables()?;
        let before = self.imager.use_tables(self.optics.len());
        let drawn = self.imager.render(planner.plan(&[star])).map(|_| ());
        self.imager.use_tables(before);
        if let Err(error) = drawn {
            // Tables and optics have the same numbers: both go, or none.
            self.imager.remove_last_tables();
            return Err(error.into());
        }
        self.optics.push(Some(planner));
        Ok(self.optics.len() - 1)
    }

    /// What the next frame is exposed under.
    pub fn conditions_mut(&mut self) -> &mut Conditions {
        &mut self.conditions
    }

    /// Defects of the detector, to be changed from the next frame on.
    pub fn defects_mut(&mut self) -> &mut Defects {
        self.imager.disturbances_mut().defects_mut()
    }

    /// Brings the conditions to the planner.
    pub fn take_conditions(&mut self) {
        self.use_optics(self.conditions.optics);
        self.planner.set_target_light(self.conditions.throughput);
    }

    fn use_optics(&mut self, number: usize) {
        if let Some(next) = self.optics.get_mut(number).and_then(Option::take) {
            let before = core::mem::replace(&mut self.planner, next);
            self.optics[self.in_use] = Some(before);
            self.in_use = number;
            self.imager.use_tables(number);
        }
    }

    /// From here on the planner's time follows the measured load: for runs on the real clock. Frames that may not be
    /// degraded are drawn as before.
    pub fn follow_load(&mut self) {
        let may_degrade = self.params.degrade && self.imager.may_degrade();
        self.load = may_degrade.then(LoadEstimate::default);
    }

    /// From here on stars of layers are read ahead by a thread, and those that are late are missing: for the real clock.
    ///
    /// # Errors
    /// When the system has no thread for it.
    pub fn read_stars_ahead(&mut self) -> Result<(), RunError> {
        Ok(self.scene.stars.read_ahead()?)
    }

    /// The next frame is planned under this load, where it is followed at all: a replay's word instead of a measurement.
    pub fn assume_load(&mut self, ratio: f64) {
        self.load = self.load.map(|_| LoadEstimate::standing_at(ratio));
    }

    /// From here on says of each frame what it was drawn from.
    pub fn mark_frames(&mut self, marks: FrameMarks) {
        self.marks = Some(marks);
    }

    /// Returns the measured over predicted drawing time; 1 where it is not followed.
    #[must_use]
    pub fn load(&self) -> f64 {
        self.load.map_or(1.0, |load| load.ratio())
    }

    /// Takes in how long the latest frame took to draw and read out; `at` is when. Tells the ledger when a load begins or
    /// has gone.
    pub fn learn_load(&mut self, drawn: Span, at: Tai, slot: Slot, ledger: &mut Ledger) {
        let predicted_ms = self.planner.latest().chosen.cost_ms + self.detector_ms(&self.exposing.settings().regions);
        let kind = match self.load.as_mut().and_then(|load| load.observe(predicted_ms, drawn.ms())) {
            None => return,
            Some(LoadChange::Overloaded) => EventKind::Overloaded,
            Some(LoadChange::Gone) => EventKind::LoadGone,
        };
        ledger.note(Event::new(kind, at, Some(slot.number), drawn));
    }

    /// The largest motion that the body may make, as far as it is in the attitude records: with it the error of every
    /// frame's attitude has a bound.
    pub fn expect_motion(&mut self, motion: MotionScale) {
        self.motion = Some(motion);
    }

    /// Returns the bound of the latest frame's pointing error, rad, by the attitude method that made it; `None` when
    /// nothing is known of the motion, or the method has no bound (held, or predicted beyond the acceleration's
    /// horizon).
    #[must_use]
    pub fn pointing_bound_rad(&self) -> Option<f64> {
        self.pointing_bound_rad
    }

    /// Returns the largest error of the map to the sky in the headers of frames, px, as far as it is the lens's; `None` where
    /// frames have no map.
    #[must_use]
    pub fn wcs_error_px(&self) -> Option<f64> {
        self.wcs.as_ref().map(WcsMaker::lens_error_px)
    }

    /// Returns the backend and detector.
    #[must_use]
    pub fn imager(&self) -> &Imager {
        &self.imager
    }

    /// Parameters.
    #[must_use]
    pub fn params(&self) -> &RunParams {
        &self.params
    }

    /// Returns the slot of frame `number` of a run without commands to its camera.
    #[must_use]
    pub fn slot(&self, number: u32) -> Slot {
        self.exposing.nominal(number)
    }

    /// Returns times and settings of its exposures.
    #[must_use]
    pub fn exposing(&self) -> &Exposing {
        &self.exposing
    }

    /// Returns the same, for commands.
    pub fn exposing_mut(&mut self) -> &mut Exposing {
        &mut self.exposing
    }

    /// Returns how long a slot waits for jitter samples that are under way, at most: nothing without a stream of them or for frames
    /// drawn ahead, and no more than half of the time that a frame like the one before leaves.
    #[must_use]
    pub fn jitter_wait(&self, slot: Slot, receiver: &Receiver) -> Span {
        let params = &self.params;
        if params.ahead > Span::ZERO || !receiver.jitter().is_streaming(slot.exposure_end) {
            return Span::ZERO;
        }
        let (load, latest_ms) = (self.load(), self.planner.latest().chosen.cost_ms);
        let regions = &self.exposing.settings_of(&slot).regions;
        let spare_ms = (self.drawing_budget_ms(regions, load) - latest_ms) * load;
        let frame_ms = (latest_ms + self.detector_ms(regions)) * load * f64::from(params.heads);
        let half_ms = 0.5 * spare_ms.min(params.frame_period.ms() - frame_ms).max(0.0);
        receiver.params().jitter_wait.min(Span::from_s(half_ms * 1e-3))
    }

    /// Returns the predicted time of the detector for a frame of these regions, ms; a device reads out all of it.
    fn detector_ms(&self, regions: &Regions) -> f64 {
        let share = if self.imager.is_on_device() { 1.0 } else { self.params.camera.readout_share(regions) };
        self.params.camera.predicted_readout_ms(&self.cost) * share
    }

    /// Returns the time in which a frame of these regions must be drawn, ms, under a load.
    fn drawing_budget_ms(&self, regions: &Regions, load: f64) -> f64 {
        let size_px = self.params.camera.output().size_px;
        let rows_share = regions.rows(size_px) as f64 / size_px[1].max(1) as f64;
        self.params.drawing_budget_of_ms([rows_share, self.detector_ms(regions)], load)
    }

    /// Gives the planner the time that the next frame's regions leave it, on the real clock by the load.
    fn set_time_budget(&mut self, slot: Slot, receiver: &Receiver) {
        if !(self.params.degrade && self.imager.may_degrade()) {
            return;
        }
        let load = self.load();
        let wait_ms = if self.load.is_some() { self.jitter_wait(slot, receiver).ms() / load } else { 0.0 };
        let limit_ms = self.drawing_budget_ms(&self.exposing.settings().regions, load);
        self.planner.set_time_budget_ms(limit_ms - wait_ms);
    }

    /// Returns true when jitter samples of a slot's exposure are still to come.
    #[must_use]
    pub fn lacks_jitter(&self, slot: Slot, receiver: &Receiver) -> bool {
        receiver.jitter().is_behind(slot.exposure_end + Span::from_s(0.5 * self.rows_s()))
    }

    /// From the exposure of the first row to that of the last, s: the path must cover them all.
    fn rows_s(&self) -> f64 {
        let camera = &self.params.camera;
        camera.shutter.line_s() * (camera.geometry.height_px() as f64 - 1.0)
    }

    /// Draws a frame into `frame` before the run, so that nothing is done for the first time during it.
    ///
    /// # Errors
    /// When the backend failed.
    pub fn warm_up(&mut self, frame: &mut SentFrame) -> Result<(), RunError> {
        let sources = self.scene.stars.in_view(&self.planner.latest().motion.los)?;
        let plan = self.planner.plan(sources);
        self.imager.image(plan, 0, &DetectorConditions::dark(plan.motion.los.exposure_s), &mut frame.image)?;
        // What it left in the pixels is no frame's.
        self.imager.reset_detector();
        Ok(())
    }

    /// Exposes one slot. `receiver` holds what had arrived. Returns the times of the stages, or `None` when there is no attitude
    /// and the policy is to send no frame.
    ///
    /// # Errors
    /// When the backend failed or the policy for a stopped stream is to stop.
    pub fn expose(
        &mut self,
        slot: Slot,
        receiver: &mut Receiver,
        ledger: &mut Ledger,
        frame: &mut SentFrame,
    ) -> Result<Option<StageTimes>, RunError> {
        let mut times = bus_times(slot, receiver);
        receiver.set_exposure_s(self.exposing.exposure_s());
        self.conditions.set_exposing(self.exposing.light_factor(), self.exposing.settings());
        self.set_time_budget(slot, receiver);
        let mut watch = Stopwatch::start();
        self.follow_observer(receiver, slot, ledger);
        let has_stars = match self.compose(slot, receiver, ledger)? {
            Shown::Stars => true,
            Shown::Dark => false,
            Shown::Nothing => return Ok(None),
        };
        times.set(Stage::Attitude, watch.lap());
        let los = &self.planner.latest().motion.los;
        let found = self.scene.find(los, has_stars)?;
        scene_events::note(&found, slot, ledger);
        let conditions = self.conditions.of_detector(los.exposure_s, found.background);
        let (camera, sensor_from_icrf) = (&self.params.camera.geometry, los.mid_sensor_from_icrf);
        let sources = if has_stars {
            self.conditions.seen(self.scene.sources(), camera, &sensor_from_icrf, self.params.seed)
        } else {
            &[]
        };
        self.planner.set_targets_on_sky(self.scene.targets.in_view());
        times.set(Stage::Sky, watch.lap());
        let plan = self.planner.plan(sources);
        times.set(Stage::Plan, watch.lap());
        let is_coarse = self.scene.targets.is_coarse() || plan.targets.iter().any(|target| target.is_coarse);
        if !plan.chosen.verdict.is_met() || is_coarse {
            note(ledger, EventKind::OverBudget, slot, Span::ZERO);
        }
        if plan.degradation > Degradation::Full {
            let predicted = Span::from_s(plan.chosen.cost_ms * 1e-3);
            let (at, frame) = (slot.release, Some(slot.number));
            ledger.note(Event {
                kind: EventKind::Degraded,
                at,
                frame,
                span: predicted,
                degradation: plan.degradation,
                what: "",
            });
        }
        let left_out = self.imager.disturbances().protons_left_out();
        let imaging = self.imager.image(plan, slot.number, &conditions, &mut frame.image)?;
        if self.imager.disturbances().protons_left_out() > left_out {
            note(ledger, EventKind::ProtonsLeftOut, slot, Span::ZERO);
        }
        times.merge(&imaging.by_stage());
        let output = self.params.camera.output();
        let sight = self.scene.stars.sight();
        fill_truth(plan, &output, sight, &mut frame.truth);
        self.scene.stars.name_stars(&mut frame.truth);
        fill_targets(plan, self.scene.targets.facts(), &output, &mut frame.targets);
        add_tracks(self.imager.disturbances().proton_tracks(), &output, &mut frame.truth);
        keep_shown(plan, &output, &conditions.regions, &mut frame.truth, &mut frame.targets);
        let levels = Levels::of_exposure(&self.params.camera.detector, &conditions);
        fill_meta(plan, slot.number, self.params.seeds(), &levels, self.imager.name(), &mut frame.meta);
        if let Some(drawn_from_sensor) = &self.params.drawn_from_sensor {
            describe_pointing(&plan.motion.los, &drawn_from_sensor.inverse(), &mut frame.meta);
        }
        frame.meta.facts = self.params.drawn_from_sensor.is_none().then(|| self.params.camera.facts_of(&levels));
        let maker = self.wcs.as_mut().filter(|_| has_stars).zip(sight);
        frame.meta.wcs = maker.and_then(|(maker, sight)| maker.at(&plan.motion.los.mid_sensor_from_icrf, sight));
        self.path.describe(&mut frame.meta);
        describe_exposure(&slot, self.exposing.settings(), &mut frame.meta);
        self.exposing.see(&frame.image, slot.release, ledger);
        receiver.note_drawn(slot.exposure_end);
        frame.meta.left_out_stars += found.missing_stars();
        frame.meta.occulted_stars = found.bodies.occulted;
        frame.meta.overlap_lost_e = self.imager.overlap_lost_e();
        (frame.meta.binning, frame.meta.window_px) = (output.binning, output.first_px);
        frame.meta.attitude_age = receiver.age_at(slot.release).unwrap_or(Span::ZERO);
        frame.meta.faults |= flags_of(plan.motion.los.origin, has_stars);
        if let Some(marks) = &self.marks {
            let (load, degradation) = (self.load(), frame.meta.degradation);
            let (messages, exposed) = (receiver.messages_by_port(), self.exposing.exposed(&slot));
            marks.put(FrameMark { frame: slot.number, messages, load, degradation, exposed });
        }
        Ok(Some(times))
    }

    /// Brings the observer's states from outside to the scene, and notes those that no orbit has and slots far from all.
    fn follow_observer(&mut self, receiver: &mut Receiver, slot: Slot, ledger: &mut Ledger) {
        for (at, state) in receiver.take_observers() {
            if self.scene.follow_observer(at, state).is_err() {
                note(ledger, EventKind::SampleRefused, slot, slot.release - at);
            }
        }
        if self.scene.is_observer_far(slot.exposure_end) {
            note(ledger, EventKind::ObserverPredicted, slot, Span::ZERO);
        }
    }

    /// Returns the observer's velocity about the barycentre over the speed of light, ICRF axes, as frames are drawn with it.
    ///
    /// # Errors
    /// When the observer's orbit cannot be computed at that time.
    pub fn observer_beta(&self, at: Tai) -> Result<DVec3, SceneError> {
        Ok(self.scene.stars.observer().barycentric_state(at)?.velocity_km_s / SPEED_OF_LIGHT_KM_S)
    }

    /// Returns the line of sight of the slot into the planner.
    fn compose(&mut self, slot: Slot, receiver: &Receiver, ledger: &mut Ledger) -> Result<Shown, RunError> {
        let (params, rows_s) = (receiver.params(), self.rows_s());
        self.path = PathFacts::default();
        let los = &mut self.planner.motion_mut().los;
        if !receiver.session().is_rendering() {
            note(ledger, EventKind::NotRunning, slot, Span::ZERO);
            self.pointing_bound_rad = None;
            show_nothing(los, slot.exposure_start, self.exposing.exposure_s());
            return Ok(Shown::Dark);
        }
        let outcome = compose(
            receiver.history(),
            receiver.jitter(),
            params.sensor_from_body,
            slot.exposure_start - Span::from_s(0.5 * rows_s),
            self.exposing.exposure_s() + rows_s,
            &params.estimate,
            los,
        );
        los.exposure_start = slot.exposure_start;
        los.exposure_s = self.exposing.exposure_s();
        self.pointing_bound_rad = match (&outcome, &self.motion) {
            (Ok(PathOutcome::Show(report)), Some(motion)) => bound_rad(los.origin, report, motion, &params.estimate),
            _ => None,
        };
        match outcome {
            Ok(PathOutcome::Show(report)) => {
                let age = receiver.age_at(slot.release).unwrap_or(Span::ZERO);
                match los.origin {
                    PathOrigin::Held => note(ledger, EventKind::AttitudeHeld, slot, age),
                    PathOrigin::Predicted => note(ledger, EventKind::Predicted, slot, report.horizon),
                    PathOrigin::Interpolated | PathOrigin::Commanded | PathOrigin::Absent => {}
                }
                self.path = PathFacts::of(&report, los.origin);
                self.path.note(slot, ledger);
                Ok(Shown::Stars)
            }
            Ok(PathOutcome::Blank { age }) => {
                note(ledger, EventKind::Blank, slot, age);
                Ok(Shown::Dark)
            }
            Ok(PathOutcome::Drop { age }) => {
                note(ledger, EventKind::AttitudeMissing, slot, age);
                Ok(Shown::Nothing)
            }
            Ok(PathOutcome::Stop { age }) => {
                note(ledger, EventKind::AttitudeStopped, slot, age);
                Err(RunError::AttitudeStopped { age })
            }
            Err(_nothing_received_yet) => {
                note(ledger, EventKind::NoAttitude, slot, Span::ZERO);
                show_nothing(los, slot.exposure_start, self.exposing.exposure_s());
                Ok(Shown::Dark)
            }
        }
    }
}

/// Flags of a frame that shows no stars, or an attitude that was held.
fn flags_of(origin: PathOrigin, has_stars: bool) -> FaultFlags {
    let blank = if has_stars { FaultFlags::NONE } else { FaultFlags::BLANK };
    let stale = if origin == PathOrigin::Held { FaultFlags::LINK_STALE } else { FaultFlags::NONE };
    blank | stale
}

/// Returns a planner of the run, for the camera's own optics or for others.
fn new_planner(params: &RunParams, imager: &Imager, los: LosPath, psf: Option<PsfModel>) -> Planner {
    let (camera, cost) = (&params.camera, params.cost.unwrap_or(imager.cost()));
    let own = camera.instrument();
    let instrument = Instrument { psf: psf.unwrap_or_else(|| own.psf.clone()), ..own };
    let mut planner = Planner::new(instrument, params.budget, cost, params.method, los);
    if params.degrade && imager.may_degrade() {
        planner = planner.within_ms(params.drawing_budget_ms(&cost)).down_to(params.last_degradation);
    }
    if imager.is_exact() {
        planner = planner.exact();
    }
    planner.set_targets(params.targets.clone());
    planner.reserve_targets_on_sky(params.sky_targets.len());
    planner
}

/// A line of sight that stands still and is nobody's.
fn show_nothing(los: &mut LosPath, exposure_start: Tai, exposure_s: f64) {
    los.mid_sensor_from_icrf = Rotation::IDENTITY;
    los.exposure_start = exposure_start;
    los.exposure_s = exposure_s;
    los.rate_rad_s = DVec3::ZERO;
    los.acceleration_rad_s2 = DVec3::ZERO;
    los.jitter.lines.clear();
    los.jitter.points.clear();
    los.origin = PathOrigin::Absent;
    los.horizon = Span::ZERO;
}

/// Returns how old what the bus brought is at the slot's release, how well its time is known, and how long after its
/// trigger it began.
fn bus_times(slot: Slot, receiver: &Receiver) -> StageTimes {
    let mut times = StageTimes::default();
    let trigger = match slot.started {
        Started::Rate => None,
        Started::Trigger { .. } => Some(slot.trigger_delay()),
    };
    let known = [
        (Stage::Trigger, trigger),
        (Stage::BusAge, receiver.age_at(slot.release)),
        (Stage::ArrivalAge, receiver.arrival_age_at(slot.release)),
        (Stage::Correlation, receiver.clock().estimate().map(|estimate| estimate.spread)),
    ];
    for (stage, span) in known {
        if let Some(span) = span {
            times.set(stage, span);
        }
    }
    times
}

/// Returns the bound of the error at mid-exposure, rad, where the method that was used has one.
fn bound_rad(origin: PathOrigin, report: &PathReport, motion: &MotionScale, limits: &EstimateLimits) -> Option<f64> {
    let bound_rad = match origin {
        PathOrigin::Interpolated => AttitudeMethod::Interpolation.bound_rad(motion, report.gap.s()),
        PathOrigin::Predicted if report.horizon <= limits.max_horizon => {
            AttitudeMethod::ConstantAcceleration.bound_rad(motion, report.horizon.s())
        }
        PathOrigin::Predicted | PathOrigin::Held | PathOrigin::Commanded | PathOrigin::Absent => return None,
    };
    // Half a turn says: outside the method's domain.
    (bound_rad < core::f64::consts::PI).then_some(bound_rad)
}

fn note(ledger: &mut Ledger, kind: EventKind, slot: Slot, span: Span) {
    ledger.note(Event::new(kind, slot.release, Some(slot.number), span));
}
