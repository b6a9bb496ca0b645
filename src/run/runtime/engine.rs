//! The frame engine: one slot in, one finished frame out. Allocates nothing after its first frames, formats nothing,
//! touches no file and takes no lock.

mod draw;

use crate::runtime::error::{Result, RunError};
use crate::runtime::ledger::{Event, EventKind, Ledger};
use crate::runtime::load::{LoadChange, LoadEstimate};
use crate::runtime::marks::{FrameMark, FrameMarks};
use crate::runtime::slot::{Slot, Started};
use crate::runtime::{
    conditions::Conditions, describe::PathFacts, exposing::Exposing, imager::Imager, params::RunParams,
    receiver::Receiver,
};
use base::time::{Span, Tai};
use base::{axes::Rotation, clock::Stopwatch, refused::Refused, region::Regions, units::SPEED_OF_LIGHT_KM_S};
use config::Overlap;
use frames::report::{FrameEnd, Stage, StageTimes};
use frames::sink::SentFrame;
use glam::DVec3;
use image::detector::{DetectorConditions, defects::Defects};
use plan::attitude::{
    AttitudeMethod, EstimateLimits, JitterTrack, LosPath, MotionScale, PathOrigin, PathOutcome, PathReport, compose,
};
use plan::exposure::{ExposurePlan, Instrument, Planner, Source, SourcePlace};
use plan::exposure::{cost::CostModel, target::Target};
use plan::optics::PsfModel;
use scene::{Scene, field_light::illumination_map, wcs::WcsMaker};
use sky::{almanac::Almanac, astrometry::Sight};
use stars::Sky;

pub use crate::runtime::describe::fill_meta;
pub use draw::Light;

/// Content of the image of a slot.
enum Shown {
    Stars,
    Dark,
    Nothing,
}

/// Draws frames.
pub struct FrameEngine {
    /// Number of its head, by which it finds its mounting in the receiver.
    head: usize,
    params: RunParams,
    /// The times and settings of its exposures, for commands.
    pub exposing: Exposing,
    planner: Planner,
    /// Planners of other optics; the entry of the optics in use is empty.
    optics: Vec<Option<Planner>>,
    /// Index of the optics in use.
    in_use: usize,
    conditions: Conditions,
    scene: Scene,
    /// Maps from frames to the sky; `None` where frames have no map.
    wcs: Option<WcsMaker>,
    imager: Imager,
    cost: CostModel,
    /// Load estimate, on the real clock only.
    load: Option<LoadEstimate>,
    /// Largest expected motion of the body, if known.
    motion: Option<MotionScale>,
    /// The bound of the latest frame's pointing error, rad, by the attitude method that made it; `None` when
    /// the motion is unknown or the method has no bound (held, or predicted beyond the acceleration's horizon).
    pub pointing_bound_rad: Option<f64>,
    /// End of the latest frame if it goes out on time.
    pub end_on_time: FrameEnd,
    /// True once a frame has shown an attitude.
    has_been_lit: bool,
    /// Facts about the latest frame's line of sight.
    path: PathFacts,
    /// Where the engine reports what each frame was drawn from, when a run is captured.
    marks: Option<FrameMarks>,
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
    pub fn with_sky(params: RunParams, mut imager: Imager, sky: &Sky, almanac: &Almanac) -> Result<Self> {
        imager.disturbances_mut().defects_mut().set_frame_period_s(params.frame_period.s());
        let camera = &params.camera;
        let mut los = LosPath::commanded(Rotation::IDENTITY, params.first_exposure, camera.exposure_s);
        let attitude = &params.attitude;
        los.jitter = JitterTrack::with_capacity(attitude.jitter_lines.len(), attitude.settings.jitter_history.capacity);
        let cost = params.cost.unwrap_or(imager.cost());
        let planner = new_planner(&params, &imager, los, None);
        if params.target_overlap == Overlap::Brighter && params.has_targets() {
            imager.keep_brighter()?;
        }
        let scene = Scene::new(&params.scene(almanac), sky);
        // A frame drawn for a display is not an image of the sky by this camera.
        let of_sensor = params.drawn_from_sensor.is_none();
        let wcs = of_sensor.then(|| WcsMaker::new(&camera.geometry, &camera.output())).flatten();
        if let Some(map) = illumination_map(camera) {
            imager.set_illumination_map(map)?;
        }
        Ok(Self {
            head: 0,
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
            end_on_time: FrameEnd::OnTime,
            has_been_lit: false,
            path: PathFacts::default(),
            marks: None,
        })
    }

    /// Returns the engine for another head than the first.
    #[must_use]
    pub fn of_head(mut self, head: usize) -> Self {
        self.head = head;
        self
    }

    /// Returns the number of its head.
    pub fn head(&self) -> usize {
        self.head
    }

    /// Prepares other optics so that they can be switched to within a frame; returns their index.
    ///
    /// # Errors
    /// When the backend cannot build another set of tables.
    pub fn add_optics(&mut self, psf: PsfModel) -> Result<usize> {
        self.imager.add_tables()?;
        match self.make_optics(self.optics.len(), psf) {
            Ok(planner) => {
                self.optics.push(Some(planner));
                Ok(self.optics.len() - 1)
            }
            Err(error) => {
                // Tables and optics have the same indices: remove both or none.
                self.imager.remove_last_tables();
                Err(error)
            }
        }
    }

    /// Replaces other optics that are not in use and will not be again. The old ones are freed first, so that the new ones take
    /// their memory.
    ///
    /// # Errors
    /// When the backend cannot build the tables.
    pub fn replace_optics(&mut self, number: usize, psf: PsfModel) -> Result<()> {
        self.optics[number] = None;
        self.optics[number] = Some(self.make_optics(number, psf)?);
        Ok(())
    }

    /// Returns a planner for other optics, whose tables are built at `number`.
    fn make_optics(&mut self, number: usize, psf: PsfModel) -> Result<Planner> {
        let los = self.planner.latest().motion.los.clone();
        let mut planner = new_planner(&self.params, &self.imager, los, Some(psf));
        // Drawing one star once builds all tables.
        let camera = &self.params.camera.geometry;
        let middle = [0.5 * camera.width_px() as f64, 0.5 * camera.height_px() as f64];
        let star = Source { id: 0, electrons: 1e4, mag: f32::NAN, place: SourcePlace::Pixel(middle) };
        let before = self.imager.use_tables(number);
        let drawn = self.imager.render(planner.plan(&[star])).map(|_| ());
        self.imager.use_tables(before);
        drawn?;
        Ok(planner)
    }

    /// Returns the conditions of the next exposure.
    pub fn conditions_mut(&mut self) -> &mut Conditions {
        &mut self.conditions
    }

    /// Returns the defects of the detector; changes apply from the next frame on.
    pub fn defects_mut(&mut self) -> &mut Defects {
        self.imager.disturbances_mut().defects_mut()
    }

    /// Sets the scripted targets in place of those of the bench; allocates, so it is for single images.
    pub fn set_targets(&mut self, targets: &[Target]) {
        let others = self.optics.iter_mut().flatten();
        others.chain([&mut self.planner]).for_each(|planner| planner.set_targets(targets.to_vec()));
    }

    /// Draws the mean electrons of one target alone, along the motion of the latest image; they stay in the imager. The
    /// targets are gone then: set them before the next image. For single images.
    ///
    /// # Errors
    /// When the backend failed.
    pub fn draw_target_alone(&mut self, target: &Target) -> Result<()> {
        self.set_targets(&[]);
        // A planned target has the light that reaches the detector.
        self.planner.set_target_light(1.0);
        self.planner.set_targets_on_sky(&[*target]);
        self.imager.render(self.planner.plan(&[]))?;
        Ok(())
    }

    /// Passes the conditions to the planner.
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

    /// Makes the planner's time follow the measured load from here on: for runs on the real clock. Frames that may not
    /// be degraded are drawn as before.
    pub fn follow_load(&mut self) {
        let may_degrade = self.params.degrade && self.imager.may_degrade();
        self.load = may_degrade.then(LoadEstimate::default);
    }

    /// Starts a thread that reads stars of layers ahead; stars that are late are missing from the frame. For the real
    /// clock.
    ///
    /// # Errors
    /// When the system cannot start the thread.
    pub fn read_stars_ahead(&mut self) -> Result<()> {
        self.scene.stars.read_ahead().map_err(RunError::Scene)
    }

    /// Overrides the measured load for the next frame (used by replay). No effect when load tracking is off.
    pub fn assume_load(&mut self, ratio: f64) {
        self.load = self.load.map(|_| LoadEstimate::with_ratio(ratio));
    }

    /// Reports from here on what each frame was drawn from.
    pub fn mark_frames(&mut self, marks: FrameMarks) {
        self.marks = Some(marks);
    }

    /// Returns the ratio of measured to predicted drawing time; 1 where load is not tracked.
    pub fn load(&self) -> f64 {
        self.load.map_or(1.0, |load| load.ratio())
    }

    /// Updates the load estimate with the time the latest frame took to draw and read out; `at` is the current time.
    /// Adds an event to the ledger when an overload starts or has ended.
    pub fn learn_load(&mut self, drawn: Span, at: Tai, slot: Slot, ledger: &mut Ledger) {
        let predicted_ms = self.planner.latest().chosen.cost_ms + self.detector_ms(&self.exposing.settings().regions);
        let kind = match self.load.as_mut().and_then(|load| load.observe(predicted_ms, drawn.ms())) {
            None => return,
            Some(LoadChange::Overloaded) => EventKind::Overloaded,
            Some(LoadChange::Gone) => EventKind::LoadGone,
        };
        ledger.note(Event::new(kind, at, Some(slot.number), drawn));
    }

    /// Sets the largest motion that the body may make, as far as it is in the attitude records: with it the error of
    /// every frame's attitude has a bound.
    pub fn expect_motion(&mut self, motion: MotionScale) {
        self.motion = Some(motion);
    }

    /// Returns the largest error that the lens contributes to the sky map in frame headers, px; `None` where frames
    /// have no map.
    pub fn wcs_error_px(&self) -> Option<f64> {
        self.wcs.as_ref().map(WcsMaker::lens_error_px)
    }

    /// Returns the backend and detector.
    pub fn imager(&self) -> &Imager {
        &self.imager
    }

    /// Returns what the observer did to directions at the latest image; `None` before the first.
    pub fn sight(&self) -> Option<&Sight> {
        self.scene.stars.sight()
    }

    /// Returns the plan of the latest frame.
    pub fn latest_plan(&self) -> &ExposurePlan {
        self.planner.latest()
    }

    /// Returns the parameters.
    pub fn params(&self) -> &RunParams {
        &self.params
    }

    /// Returns the slot of frame `number` of a run without commands to its camera.
    pub fn slot(&self, number: u32) -> Slot {
        self.exposing.nominal(number)
    }

    /// Returns the longest time that a slot waits for jitter samples that are under way: zero without a stream of them
    /// or for frames drawn ahead, and at most half of the time that a frame like the one before leaves.
    pub fn jitter_wait(&self, slot: Slot, receiver: &Receiver) -> Span {
        let params = &self.params;
        if params.ahead > Span::ZERO || !receiver.mounting(self.head).jitter.is_streaming(slot.exposure_end) {
            return Span::ZERO;
        }
        let (load, latest_ms) = (self.load(), self.planner.latest().chosen.cost_ms);
        let regions = &self.exposing.settings_of(&slot).regions;
        let spare_ms = (self.drawing_budget_ms(regions, load) - latest_ms) * load;
        let frame_ms = (latest_ms + self.detector_ms(regions)) * load * f64::from(params.heads);
        let half_ms = 0.5 * spare_ms.min(params.frame_period.ms() - frame_ms).max(0.0);
        receiver.params.settings.jitter_wait.min(Span::from_s(half_ms * 1e-3))
    }

    /// Returns the predicted time of the detector for a frame of these regions, ms; a GPU always reads out the whole
    /// image.
    fn detector_ms(&self, regions: &Regions) -> f64 {
        let share = if self.imager.is_on_device() { 1.0 } else { self.params.camera.readout_share(regions) };
        self.params.camera.predicted_readout_ms(&self.cost) * share
    }

    /// Returns the time in which a frame of these regions must be drawn under a load, ms.
    fn drawing_budget_ms(&self, regions: &Regions, load: f64) -> f64 {
        let size_px = self.params.camera.output().size_px;
        let rows_share = regions.rows(size_px) as f64 / size_px[1].max(1) as f64;
        self.params.drawing_budget_of_ms([rows_share, self.detector_ms(regions)], load)
    }

    /// Sets the planner's time to what the next frame's regions leave, reduced by the load on the real clock.
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
    pub fn lacks_jitter(&self, slot: Slot, receiver: &Receiver) -> bool {
        receiver.mounting(self.head).jitter.is_behind(slot.exposure_end + Span::from_s(0.5 * self.rows_s()))
    }

    /// Returns the time from the exposure of the first row to that of the last, s; the path must cover all rows.
    fn rows_s(&self) -> f64 {
        let camera = &self.params.camera;
        camera.shutter.line_s() * (camera.geometry.height_px() as f64 - 1.0)
    }

    /// Draws a frame into `frame` before the run, so that the first real frame needs no first-time work.
    ///
    /// # Errors
    /// When the backend failed.
    pub fn warm_up(&mut self, frame: &mut SentFrame) -> Result<()> {
        let sources = self.scene.stars.in_view(&self.planner.latest().motion.los).map_err(RunError::Scene)?;
        let plan = self.planner.plan(sources);
        self.imager.image(plan, 0, &DetectorConditions::dark(plan.motion.los.exposure_s), &mut frame.image)?;
        // Clear residual charge: the warm-up frame must not affect frame 0.
        self.imager.reset_detector();
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
        receiver.mounting_mut(self.head).jitter.set_exposure_s(self.exposing.exposure_s());
        self.conditions.set_exposing(self.exposing.light_factor(), self.exposing.settings());
        self.set_time_budget(slot, receiver);
        let mut watch = Stopwatch::start();
        self.follow_observer(receiver, slot, ledger);
        let light = match self.compose(slot, receiver, ledger)? {
            Shown::Stars => Light::Sky,
            Shown::Dark => Light::Dark,
            Shown::Nothing => return Ok(None),
        };
        times.set(Stage::Attitude, watch.lap());
        self.draw(slot, light, ledger, frame, &mut times)?;
        receiver.mounting_mut(self.head).note_drawn(slot.exposure_end);
        frame.meta.attitude_age = receiver.age_at(slot.release).unwrap_or(Span::ZERO);
        if let Some(marks) = &self.marks {
            let (load, degradation) = (self.load(), frame.meta.degradation.name());
            let (messages, exposed) = (receiver.messages_by_port(), self.exposing.exposed(&slot));
            marks.put(FrameMark { frame: slot.number, messages, load, degradation, exposed });
        }
        Ok(Some(times))
    }

    /// Passes the observer's states from outside to the scene; notes states that do not fit an orbit and slots far from
    /// all states.
    fn follow_observer(&mut self, receiver: &mut Receiver, slot: Slot, ledger: &mut Ledger) {
        for (at, state) in receiver.mounting_mut(self.head).take_observers() {
            if self.scene.follow_observer(at, state).is_err() {
                note(ledger, EventKind::SampleRefused, slot, slot.release - at);
            }
        }
        if self.scene.is_observer_far(slot.exposure_end) {
            note(ledger, EventKind::ObserverPredicted, slot, Span::ZERO);
        }
    }

    /// Returns the observer's barycentric velocity divided by the speed of light, ICRF axes, as frames are drawn with
    /// it.
    ///
    /// # Errors
    /// When the observer's orbit cannot be computed at that time.
    pub fn observer_beta(&self, at: Tai) -> Result<DVec3, Refused> {
        Ok(self.scene.stars.observer().barycentric_state(at)?.velocity_km_s / SPEED_OF_LIGHT_KM_S)
    }

    /// Composes the line of sight of the slot in the planner, and returns what the image shows.
    fn compose(&mut self, slot: Slot, receiver: &Receiver, ledger: &mut Ledger) -> Result<Shown> {
        let (params, rows_s, mounting) = (&receiver.params, self.rows_s(), receiver.mounting(self.head));
        self.path = PathFacts::default();
        let los = &mut self.planner.motion_mut().los;
        if !receiver.session.is_rendering() {
            note(ledger, EventKind::NotRunning, slot, Span::ZERO);
            (self.pointing_bound_rad, self.end_on_time) = (None, receiver.session.end_while_dark());
            show_nothing(los, slot.exposure_start, self.exposing.exposure_s());
            return Ok(Shown::Dark);
        }
        let outcome = compose(
            &receiver.history,
            &mounting.jitter,
            mounting.sensor_from_body,
            slot.exposure_start - Span::from_s(0.5 * rows_s),
            self.exposing.exposure_s() + rows_s,
            &params.settings.estimate,
            los,
        );
        los.exposure_start = slot.exposure_start;
        los.exposure_s = self.exposing.exposure_s();
        self.pointing_bound_rad = match (&outcome, &self.motion) {
            (Ok(PathOutcome::Show(report)), Some(motion)) => {
                bound_rad(los.origin, report, motion, &params.settings.estimate)
            }
            _ => None,
        };
        self.end_on_time = match (&outcome, los.origin) {
            (Ok(PathOutcome::Show(_)), PathOrigin::Held) => FrameEnd::AttitudeHeld,
            (Ok(PathOutcome::Show(_)), _) => FrameEnd::OnTime,
            (Ok(_), _) => FrameEnd::Blank,
            (Err(_forgotten), _) if self.has_been_lit => FrameEnd::Blank,
            (Err(_nothing_received_yet), _) => FrameEnd::BlankAtStart,
        };
        self.has_been_lit |= outcome.is_ok();
        match outcome {
            Ok(PathOutcome::Show(report)) => {
                let age = receiver.age_at(slot.release).unwrap_or(Span::ZERO);
                match los.origin {
                    PathOrigin::Held => note(ledger, EventKind::AttitudeHeld, slot, age),
                    PathOrigin::Predicted => note(ledger, EventKind::Predicted, slot, report.horizon),
                    PathOrigin::Interpolated | PathOrigin::Commanded | PathOrigin::Absent | PathOrigin::TestPattern => {
                    }
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

/// Sets a static placeholder line of sight.
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
        (Stage::BusAge, receiver.age_at(slot.release)),
        (Stage::ArrivalAge, receiver.arrival_age_at(slot.release)),
        (Stage::Correlation, receiver.clock.estimate().map(|estimate| estimate.spread)),
    ];
    for (stage, span) in known {
        if let Some(span) = span {
            times.set(stage, span);
        }
    }
    times
}

/// Returns the bound of the error at mid-exposure, rad, if the method that was used has one.
fn bound_rad(origin: PathOrigin, report: &PathReport, motion: &MotionScale, limits: &EstimateLimits) -> Option<f64> {
    let bound_rad = if origin == PathOrigin::Interpolated {
        AttitudeMethod::Interpolation.bound_rad(motion, report.gap.s())
    } else if origin == PathOrigin::Predicted && report.horizon <= limits.max_horizon {
        AttitudeMethod::ConstantAcceleration.bound_rad(motion, report.horizon.s())
    } else {
        return None;
    };
    // A bound of half a turn means: outside the method's domain.
    (bound_rad < core::f64::consts::PI).then_some(bound_rad)
}

fn note(ledger: &mut Ledger, kind: EventKind, slot: Slot, span: Span) {
    ledger.note(Event::new(kind, slot.release, Some(slot.number), span));
}
