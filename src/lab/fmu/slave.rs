//! The life of one instance of a unit: start, steps, end. `worker` calls this for the C interface.
//!
//! The importer sets inputs for the start of a step, and the run goes on to its end: what a frame needs beyond the
//! start of a step is predicted from attitude, rate and acceleration. Life: new, [`Slave::enter`], [`Slave::exit`],
//! [`Slave::step`] ..., [`Slave::terminate`]; [`Slave::reset`] begins again.
//! Its state says which calls it takes (section 2.3 of the standard, without event mode). Variables are got and
//! set by their references.

use crate::archive::{RUN_FILE, check_plant, token};
use crate::error::{self, FmuError};
use crate::values::{HeadOutputs, Inputs};
use crate::variables::reference;
use base::input_file::{DATA_BYTES, read_text};
use base::{refused::Refused, time::Span};
use config::{Action, Camera, Carrier, Document, Event, GatewayParams, PackedDocuments, Plant, Scenario, SessionStart};
use run::wiring::assemble::{Outputs, Run, RunOptions};
use run::{runtime::EventKind, wiring::stepped::SteppedRun};
use std::path::{Path, PathBuf};

/// Largest difference of a step's begin from the end of the step before, s.
const STEP_TOLERANCE_S: f64 = 1e-9;

/// One instance.
pub struct Slave {
    scenario: Scenario,
    pub(crate) state: State,
    pub(crate) inputs: Inputs,
    pub(crate) heads: Vec<HeadOutputs>,
    pub(crate) time_s: [f64; 1],
    pub(crate) refused: u64,
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
        let read = |source| error::file(&path, "read the run file", source);
        let text = read_text(&path, DATA_BYTES).map_err(read)?;
        let damaged = |why: String| {
            FmuError::from(Refused::at(&path, format_args!("{why}; write the unit again with `starloop fmu`")))
        };
        let packed: PackedDocuments = serde_json::from_str(&text).map_err(|error| damaged(error.to_string()))?;
        let packed = packed.kept_in(resources);
        packed.check_data()?;
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
        // The lines are those of the simulated flight computer, whose place the importer takes: it sets its own jitter,
        // and one that sets none gets none. `[jitter]` says by itself that it is added to every source of motion.
        scenario.bench.flight_computer.jitter_lines.clear();
        let is_known_lens = |camera: &Camera| camera.distortion.polynomial.is_none();
        if (0..heads).all(|head| is_known_lens(&scenario.bench.of_head(head).camera)) {
            scenario.trackers.get_or_insert_default();
        }
        scenario.bench.link.carrier = Carrier::Simulated(GatewayParams::default());
        scenario.bench.link.pps = None;
        // An external flight computer, which would send RUN, does not exist here.
        scenario.bench.session.start = SessionStart::AtOnce;
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
        self.state.wants(&[State::Instantiated], "EnterInitializationMode")?;
        if start_s != 0.0 {
            return Err(error::step(start_s, 0.0, 0.0));
        }
        self.state = State::Initialising;
        Ok(())
    }

    /// Leaves initialisation: the run is put together.
    ///
    /// # Errors
    /// When it is not the time for it, or a part cannot be made.
    pub fn exit(&mut self) -> Result<(), FmuError> {
        self.state.wants(&[State::Initialising], "ExitInitializationMode")?;
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
        let refuse =
            |source| error::file(&path, "make the new folder for frames (set output_dir to another one)", source);
        std::fs::create_dir(&path).map_err(refuse)?;
        Ok(Some(path))
    }

    /// Takes one step with the inputs that were set before it.
    ///
    /// # Errors
    /// When it does not begin where the one before ended, an input cannot be taken, or the run failed.
    pub fn step(&mut self, from_s: f64, step_s: f64) -> Result<(), FmuError> {
        self.state.wants(&[State::Stepping], "DoStep")?;
        let at_s = self.time_s[0];
        let is_in_order = (from_s - at_s).abs() <= STEP_TOLERANCE_S * at_s.abs().max(1.0);
        if !(is_in_order && step_s > 0.0 && step_s.is_finite()) {
            return Err(error::step(from_s, step_s, at_s));
        }
        let Some(run) = &mut self.run else { return Err(error::step(from_s, step_s, at_s)) };
        let at = run.times().zero + Span::from_s(from_s);
        let has_jitter = self.has_jitter || self.inputs.jitter != [0.0; 3];
        let sample = self.inputs.sample(at, has_jitter)?;
        if self.inputs.trigger_count > self.fired {
            let (on_trigger, lasts) = (None, Span::ZERO);
            let action = Action::Trigger { number: self.inputs.trigger };
            run.inject(&Event { at: at - run.times().zero, on_trigger, lasts, action })?;
        }
        self.fired = self.inputs.trigger_count;
        self.has_jitter = has_jitter;
        run.take_plant(&[sample])?;
        // The sample of the next step comes at the end of this one, and must not lie in the past then.
        let until = at + Span::from_s(step_s) - Span::from_ns(1);
        let (heads, zero) = (&mut self.heads, run.times().zero);
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
        for (number, head) in self.heads.iter_mut().enumerate() {
            // A head without a tracker, or before its first frame, stays invalid.
            if let Ok(Some(output)) = run.tracker_output(number) {
                head.take_tracker(&output, zero);
            }
        }
        self.time_s = [from_s + step_s];
        Ok(())
    }

    /// Ends the run: frames on their way go out, sinks are finished. Returns what was lost, in one sentence, if
    /// anything was.
    ///
    /// # Errors
    /// When it is not the time for it, or a sink failed.
    pub fn terminate(&mut self) -> Result<Option<String>, FmuError> {
        self.state.wants(&[State::Stepping, State::Failed], "Terminate")?;
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
}

/// Life of an instance.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum State {
    /// Made: parameters may be set.
    Instantiated,
    /// Between enter and exit of initialisation.
    Initialising,
    /// Steps are taken.
    Stepping,
    /// Over: outputs may be read.
    Terminated,
    /// A call failed: it may be reset or freed.
    Failed,
}

impl State {
    const fn words(self) -> &'static str {
        match self {
            Self::Instantiated => "before initialisation",
            Self::Initialising => "during initialisation",
            Self::Stepping => "between steps",
            Self::Terminated => "after the end",
            Self::Failed => "after an error",
        }
    }

    /// Refuses a call that this state does not take.
    pub(crate) fn wants(self, states: &[Self], function: &'static str) -> Result<(), FmuError> {
        if states.contains(&self) {
            return Ok(());
        }
        let wanted = states.first().copied().map_or("another state", Self::words);
        Err(FmuError::from(Refused(format!("{function} was called {state}; wanted {wanted}", state = self.words()))))
    }
}

impl Slave {
    /// Returns the time at which the next step begins, s.
    pub fn time_s(&self) -> f64 {
        self.time_s[0]
    }

    /// Returns the numbers of a variable of double precision; `None` for a reference that is none of them.
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
                    reference::TRUE_JITTER => &head.true_jitter,
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

    /// Returns the value of a Boolean variable; `None` for a reference of another type.
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
