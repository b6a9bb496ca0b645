//! One instance of a unit: inputs, steps, outputs. The C interface calls this; a test can as well.
//!
//! The importer sets inputs for the begin of a step, and the run goes on to its end: what a frame needs beyond the begin of a
//! step is predicted from attitude, rate and acceleration. Life: new, [`Slave::enter`], [`Slave::exit`], [`Slave::step`] ...,
//! [`Slave::terminate`]; [`Slave::reset`] begins again.

use crate::archive::{RUN_FILE, check_plant, token};
use crate::error::FmuError;
use crate::state::State;
use crate::variables::reference;
use base::axes::{Rotation, WRITTEN_NORM_TOLERANCE};
use base::time::{Span, Tai};
use config::{Action, Camera, Carrier, Document, Doors, Event, PackedDocuments, Plant, Scenario};
use frames::sink::{SentFrame, TruthKind};
use glam::DVec3;
use run::runtime::{EventKind, PlantAttitude, PlantSample};
use run::wiring::assemble::{Outputs, Run, RunOptions};
use run::wiring::stepped::SteppedRun;
use sky::observer::BarycentricState;
use std::path::{Path, PathBuf};
use testbed::tracker::Outcome;

/// Inputs are in metres, the program's orbits in kilometres.
const M_PER_KM: f64 = 1000.0;
/// Largest difference of a step's begin from the end of the step before, s.
const STEP_TOLERANCE_S: f64 = 1e-9;

/// Inputs and parameters.
#[derive(Debug, Clone, PartialEq)]
struct Inputs {
    output_dir: String,
    q: [f64; 4],
    rate: [f64; 3],
    acceleration: [f64; 3],
    jitter: [f64; 3],
    position: [f64; 3],
    velocity: [f64; 3],
    has_observer: bool,
    trigger: u16,
    trigger_count: u32,
}

impl Default for Inputs {
    fn default() -> Self {
        Self {
            output_dir: "starloop_fmu".into(),
            q: [1.0, 0.0, 0.0, 0.0],
            rate: [0.0; 3],
            acceleration: [0.0; 3],
            jitter: [0.0; 3],
            position: [0.0; 3],
            velocity: [0.0; 3],
            has_observer: false,
            trigger: 0,
            trigger_count: 0,
        }
    }
}

/// Outputs of one head.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
struct HeadOutputs {
    frames: u64,
    mid_exposure_s: [f64; 1],
    truth: [f64; 4],
    stars: i32,
    tracker_q: [f64; 4],
    tracker_valid: bool,
    tracker_stars: i32,
    tracker_time_s: [f64; 1],
}

/// One instance.
pub struct Slave {
    scenario: Scenario,
    state: State,
    inputs: Inputs,
    heads: Vec<HeadOutputs>,
    time_s: [f64; 1],
    refused: u64,
    fired: u32,
    /// Jitter was given: from then on zeros are jitter too.
    has_jitter: bool,
    run: Option<SteppedRun>,
}

impl Slave {
    /// Makes an instance from the resources of an archive; `token` is the importer's, from the description.
    ///
    /// # Errors
    /// When the packed run file is missing, damaged, refused, or not that of the description.
    pub fn new(resources: &Path, given_token: &str) -> Result<Self, FmuError> {
        let path = resources.join(RUN_FILE);
        let read = |source| FmuError::File { path: path.clone(), doing: "read the run file", source };
        let text = std::fs::read_to_string(&path).map_err(read)?;
        let damaged = |why: String| FmuError::Resource { path: path.clone(), why };
        let packed: PackedDocuments = serde_json::from_str(&text).map_err(|error| damaged(error.to_string()))?;
        let document = Document::packed(packed)?;
        let mut scenario = Scenario::from_document(&document)?;
        check_plant(&scenario, &document.name())?;
        let heads = scenario.bench.head_count();
        let wanted = token(&text, heads);
        if wanted != given_token {
            return Err(damaged(format!("its token is {wanted}, and that of the description {given_token}")));
        }
        scenario.plant = Plant::Outside;
        scenario.bench.flight_computer.is_external = true;
        let is_known_lens = |camera: &Camera| camera.distortion.polynomial.is_none();
        if (0..heads).all(|head| is_known_lens(&scenario.bench.of_head(head).camera)) {
            scenario.trackers.get_or_insert_default();
        }
        scenario.bench.link.carrier = Carrier::Simulated(Doors::default());
        scenario.bench.link.pps = None;
        scenario.bench.extra_links.clear();
        let heads = vec![HeadOutputs::default(); heads];
        let (state, inputs) = (State::Instantiated, Inputs::default());
        Ok(Self { scenario, state, inputs, heads, time_s: [0.0], refused: 0, fired: 0, has_jitter: false, run: None })
    }

    /// Enters initialisation; time begins at `start_s`, which must be 0: the first exposure.
    ///
    /// # Errors
    /// When it is not the time for it, or the start is another one.
    pub fn enter(&mut self, start_s: f64) -> Result<(), FmuError> {
        self.state.wants(&[State::Instantiated], "fmi3EnterInitializationMode")?;
        if start_s != 0.0 {
            return Err(FmuError::Step { from_s: start_s, step_s: 0.0, at_s: 0.0 });
        }
        self.state = State::Initialising;
        Ok(())
    }

    /// Leaves initialisation: the run is put together.
    ///
    /// # Errors
    /// When it is not the time for it, or a part cannot be made.
    pub fn exit(&mut self) -> Result<(), FmuError> {
        self.state.wants(&[State::Initialising], "fmi3ExitInitializationMode")?;
        self.state = State::Failed;
        let directory = self.make_directory()?;
        let no_sinks = Vec::new();
        let sinks = if directory.is_some() { &self.scenario.bench.sinks } else { &no_sinks };
        let mut options = RunOptions::stepped(Outputs::Configured { sinks, directory });
        options.is_controlled = true;
        self.run = Some(SteppedRun::of(Run::assemble(&self.scenario, options)?)?);
        self.state = State::Stepping;
        Ok(())
    }

    /// Makes the new folder for frames; `None` when none are kept.
    fn make_directory(&self) -> Result<Option<PathBuf>, FmuError> {
        if self.inputs.output_dir.is_empty() {
            return Ok(None);
        }
        let path = PathBuf::from(&self.inputs.output_dir);
        let refuse = |source| FmuError::File {
            path: path.clone(),
            doing: "make the new folder for frames (set output_dir to another one)",
            source,
        };
        std::fs::create_dir(&path).map_err(refuse)?;
        Ok(Some(path))
    }

    /// Takes one step: the inputs hold at its begin.
    ///
    /// # Errors
    /// When it does not begin where the one before ended, an input cannot be taken, or the run failed.
    pub fn step(&mut self, from_s: f64, step_s: f64) -> Result<(), FmuError> {
        self.state.wants(&[State::Stepping], "fmi3DoStep")?;
        let at_s = self.time_s[0];
        let is_in_order = (from_s - at_s).abs() <= STEP_TOLERANCE_S * at_s.abs().max(1.0);
        if !(is_in_order && step_s > 0.0 && step_s.is_finite()) {
            return Err(FmuError::Step { from_s, step_s, at_s });
        }
        let attitude = self.attitude()?;
        let Some(run) = &mut self.run else { return Err(FmuError::Step { from_s, step_s, at_s }) };
        let at = run.zero() + Span::from_s(from_s);
        if self.inputs.trigger_count > self.fired {
            let (on_trigger, lasts) = (None, Span::ZERO);
            let action = Action::Trigger { number: self.inputs.trigger };
            run.inject(&Event { at: at - run.zero(), on_trigger, lasts, action })?;
        }
        self.fired = self.inputs.trigger_count;
        self.has_jitter |= self.inputs.jitter != [0.0; 3];
        let sample = PlantSample {
            at,
            attitude: Some(attitude),
            jitter_rad: self.has_jitter.then(|| DVec3::from_array(self.inputs.jitter)),
            observer: self.inputs.has_observer.then(|| self.inputs.observer()),
        };
        run.take_plant(&[sample])?;
        // The sample of the next step comes at the end of this one, and must not lie in the past then.
        let until = at + Span::from_s(step_s) - Span::from_ns(1);
        let (heads, zero) = (&mut self.heads, run.zero());
        let outcome = run.advance_to(until, &mut |head, frame, _record| {
            if let Some(outputs) = heads.get_mut(head) {
                outputs.take(frame, zero);
            }
            true
        });
        if let Err(error) = outcome {
            self.state = State::Failed;
            return Err(error.into());
        }
        self.refused = run.record().ledger.count(EventKind::SampleRefused);
        self.take_trackers();
        self.time_s = [from_s + step_s];
        Ok(())
    }

    /// Ends the run: frames on their way go out, sinks are finished. Returns what was lost, in one sentence, if anything was.
    ///
    /// # Errors
    /// When it is not the time for it, or a sink failed.
    pub fn terminate(&mut self) -> Result<Option<String>, FmuError> {
        self.state.wants(&[State::Stepping, State::Failed], "fmi3Terminate")?;
        self.state = State::Terminated;
        let Some(run) = self.run.take() else { return Ok(None) };
        let end = run.end(None);
        if let Some(error) = end.error {
            self.state = State::Failed;
            return Err(error.into());
        }
        Ok((!end.losses.is_empty()).then(|| end.losses.to_string()))
    }

    /// Begins again, as after the instantiation. The folder for frames must be another one or gone.
    pub fn reset(&mut self) {
        self.run = None;
        self.heads.fill(HeadOutputs::default());
        (self.inputs, self.state, self.time_s) = (Inputs::default(), State::Instantiated, [0.0]);
        (self.refused, self.fired, self.has_jitter) = (0, 0, false);
    }

    /// Returns the time at which the next step begins, s.
    #[must_use]
    pub fn time_s(&self) -> f64 {
        self.time_s[0]
    }

    /// Brings what the trackers say to the outputs.
    fn take_trackers(&mut self) {
        let Some(run) = &self.run else { return };
        for (number, head) in self.heads.iter_mut().enumerate() {
            // A head without a tracker, or before its first frame, stays invalid.
            let Ok(Some(output)) = run.tracker_output(number) else { continue };
            head.tracker_time_s = [(output.mid_exposure - run.zero()).s()];
            match output.outcome {
                Outcome::Solved(solution) => {
                    head.tracker_valid = true;
                    head.tracker_q = solution.sensor_from_icrf.wxyz();
                    head.tracker_stars = i32::try_from(solution.stars).unwrap_or(i32::MAX);
                }
                Outcome::NoSolution(_) => (head.tracker_valid, head.tracker_stars) = (false, 0),
            }
        }
    }

    fn attitude(&self) -> Result<PlantAttitude, FmuError> {
        let Inputs { q, rate, acceleration, .. } = &self.inputs;
        let body_from_icrf = Rotation::from_wxyz(*q, WRITTEN_NORM_TOLERANCE).ok_or_else(|| FmuError::Value {
            name: "q_body_from_icrf".into(),
            wanted: "a unit quaternion w x y z (norm within 0.001 of 1)",
            got: format!("{q:?}"),
        })?;
        let (rate_rad_s, acceleration_rad_s2) = (DVec3::from_array(*rate), DVec3::from_array(*acceleration));
        Ok(PlantAttitude { body_from_icrf, rate_rad_s, acceleration_rad_s2 })
    }

    /// Returns the numbers of a variable of double precision; `None` for a reference that is none of them.
    #[must_use]
    pub fn float64(&self, reference: u32) -> Option<&[f64]> {
        let inputs = &self.inputs;
        Some(match reference {
            reference::TIME => &self.time_s,
            reference::Q_BODY_FROM_ICRF => &inputs.q,
            reference::RATE => &inputs.rate,
            reference::ACCELERATION => &inputs.acceleration,
            reference::JITTER => &inputs.jitter,
            reference::POSITION => &inputs.position,
            reference::VELOCITY => &inputs.velocity,
            other => {
                let (head, within) = self.head(other)?;
                match within {
                    reference::MID_EXPOSURE => &head.mid_exposure_s,
                    reference::TRUTH => &head.truth,
                    reference::TRACKER_Q => &head.tracker_q,
                    reference::TRACKER_TIME => &head.tracker_time_s,
                    _no_such_float => return None,
                }
            }
        })
    }

    /// Returns where the numbers of an input of double precision go; `None` for any other variable.
    pub fn float64_input(&mut self, reference: u32) -> Option<&mut [f64]> {
        let inputs = &mut self.inputs;
        Some(match reference {
            reference::Q_BODY_FROM_ICRF => &mut inputs.q,
            reference::RATE => &mut inputs.rate,
            reference::ACCELERATION => &mut inputs.acceleration,
            reference::JITTER => &mut inputs.jitter,
            reference::POSITION => &mut inputs.position,
            reference::VELOCITY => &mut inputs.velocity,
            _no_input => return None,
        })
    }

    /// Returns a whole number of any size; `None` for a reference that is none.
    #[must_use]
    pub fn whole(&self, reference: u32) -> Option<i128> {
        Some(match reference {
            reference::TRIGGER => self.inputs.trigger.into(),
            reference::TRIGGER_COUNT => self.inputs.trigger_count.into(),
            reference::REFUSED => self.refused.into(),
            other => {
                let (head, within) = self.head(other)?;
                match within {
                    reference::FRAMES => head.frames.into(),
                    reference::STARS => head.stars.into(),
                    reference::TRACKER_STARS => head.tracker_stars.into(),
                    _no_such_number => return None,
                }
            }
        })
    }

    /// Sets the number or the count of the trigger; false for any other variable.
    pub fn set_whole(&mut self, reference: u32, value: u32) -> bool {
        match (reference, u16::try_from(value)) {
            (reference::TRIGGER, Ok(number)) => self.inputs.trigger = number,
            (reference::TRIGGER_COUNT, _) => self.inputs.trigger_count = value,
            _no_input => return false,
        }
        true
    }

    /// Returns whether something is true; `None` for a reference that is no such variable.
    #[must_use]
    pub fn boolean(&self, reference: u32) -> Option<bool> {
        match reference {
            reference::HAS_OBSERVER => Some(self.inputs.has_observer),
            other => self
                .head(other)
                .filter(|(_, within)| *within == reference::TRACKER_VALID)
                .map(|(head, _)| head.tracker_valid),
        }
    }

    /// Sets whether something is true; false for any other variable.
    pub fn set_boolean(&mut self, reference: u32, value: bool) -> bool {
        match reference {
            reference::HAS_OBSERVER => self.inputs.has_observer = value,
            _no_input => return false,
        }
        true
    }

    /// Returns a text; `None` for a reference that is none.
    #[must_use]
    pub fn text(&self, reference: u32) -> Option<&str> {
        (reference == reference::OUTPUT_DIR).then_some(self.inputs.output_dir.as_str())
    }

    /// Sets a text; false for any other variable, or after the start.
    pub fn set_text(&mut self, reference: u32, value: &str) -> bool {
        let may_be_set = reference == reference::OUTPUT_DIR && self.is_before_start();
        if may_be_set {
            value.clone_into(&mut self.inputs.output_dir);
        }
        may_be_set
    }

    fn is_before_start(&self) -> bool {
        matches!(self.state, State::Instantiated | State::Initialising)
    }

    /// Returns the head that a reference is of, and the reference within it.
    fn head(&self, reference: u32) -> Option<(&HeadOutputs, u32)> {
        let from_heads = reference.checked_sub(reference::HEADS)?;
        let number = usize::try_from(from_heads / reference::HEAD_STRIDE).ok()?;
        Some((self.heads.get(number)?, from_heads % reference::HEAD_STRIDE))
    }
}

impl Inputs {
    fn observer(&self) -> BarycentricState {
        BarycentricState {
            position_km: DVec3::from_array(self.position) / M_PER_KM,
            velocity_km_s: DVec3::from_array(self.velocity) / M_PER_KM,
        }
    }
}

impl HeadOutputs {
    /// Takes in a frame that went out.
    fn take(&mut self, frame: &SentFrame, zero: Tai) {
        let meta = &frame.meta;
        self.frames += 1;
        self.mid_exposure_s = [(meta.mid_exposure - zero).s()];
        self.truth = meta.attitude_wxyz;
        self.stars =
            i32::try_from(frame.truth.iter().filter(|star| star.kind == TruthKind::Star).count()).unwrap_or(i32::MAX);
    }
}
