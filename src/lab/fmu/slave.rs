//! The life of one instance of a unit: start, steps, end. `worker` calls this for the C interface.
//!
//! The importer sets inputs for the start of a step, and the run goes on to its end: what a frame needs beyond the
//! start of a step is predicted from attitude, rate and acceleration. Life: new, [`Slave::enter`], [`Slave::exit`],
//! [`Slave::step`] ..., [`Slave::terminate`]; [`Slave::reset`] begins again.
//! Its state says which calls it takes (section 2.3 of the standard, without event mode). Variables are got and
//! set by their references.

use crate::archive::{RUN_FILE, check_plant, token};
use crate::error::{self, FmuError};
use crate::values::{HeadOutputs, Inputs, Place, Value, whole};
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
    state: State,
    inputs: Inputs,
    heads: Vec<HeadOutputs>,
    /// When the next step begins.
    pub(crate) time_s: [f64; 1],
    refused: i64,
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
        self.refused = whole(run.record().ledger.count(EventKind::SampleRefused));
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
enum State {
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
    fn wants(self, states: &[Self], function: &'static str) -> Result<(), FmuError> {
        if states.contains(&self) {
            return Ok(());
        }
        let wanted = states.first().copied().map_or("another state", Self::words);
        Err(FmuError::from(Refused(format!("{function} was called {state}; wanted {wanted}", state = self.words()))))
    }
}

impl Slave {
    /// Returns the value of a variable; `None` for a reference that belongs to none.
    pub(crate) fn value(&self, reference: u32) -> Option<Value<'_>> {
        let inputs = &self.inputs;
        Some(match reference {
            reference::TIME => Value::Reals(&self.time_s),
            reference::OUTPUT_DIR => Value::Text(&inputs.output_dir),
            reference::Q_BODY_FROM_ICRF => Value::Reals(&inputs.q),
            reference::RATE => Value::Reals(&inputs.rate),
            reference::ACCELERATION => Value::Reals(&inputs.acceleration),
            reference::JITTER => Value::Reals(&inputs.jitter),
            reference::POSITION => Value::Reals(&inputs.position),
            reference::VELOCITY => Value::Reals(&inputs.velocity),
            reference::HAS_OBSERVER => Value::Boolean(inputs.has_observer),
            reference::TRIGGER => Value::Whole(inputs.trigger.into()),
            reference::TRIGGER_COUNT => Value::Whole(inputs.trigger_count.into()),
            reference::REFUSED => Value::Whole(self.refused),
            of_head => {
                let of_heads = of_head.checked_sub(reference::HEADS)?;
                let number = usize::try_from(of_heads / reference::HEAD_STRIDE).ok()?;
                self.heads.get(number)?.value(of_heads % reference::HEAD_STRIDE)?
            }
        })
    }

    /// Returns where the value of an input or parameter goes; `None` for any other variable, or after the start.
    pub(crate) fn place(&mut self, reference: u32) -> Option<Place<'_>> {
        let inputs = &mut self.inputs;
        let is_before_start = matches!(self.state, State::Instantiated | State::Initialising);
        Some(match reference {
            reference::OUTPUT_DIR if is_before_start => Place::Text(&mut inputs.output_dir),
            reference::Q_BODY_FROM_ICRF => Place::Reals(&mut inputs.q),
            reference::RATE => Place::Reals(&mut inputs.rate),
            reference::ACCELERATION => Place::Reals(&mut inputs.acceleration),
            reference::JITTER => Place::Reals(&mut inputs.jitter),
            reference::POSITION => Place::Reals(&mut inputs.position),
            reference::VELOCITY => Place::Reals(&mut inputs.velocity),
            reference::HAS_OBSERVER => Place::Boolean(&mut inputs.has_observer),
            reference::TRIGGER => Place::Short(&mut inputs.trigger),
            reference::TRIGGER_COUNT => Place::Long(&mut inputs.trigger_count),
            _no_input => return None,
        })
    }
}
