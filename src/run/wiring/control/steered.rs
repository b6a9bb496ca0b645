//! A run on the real clock as its client sees it: it goes on while answers are made.
//!
//! Not available: `step`, because the real clock cannot be paused, and `summary`, because the report is made when the
//! run ends: it comes with the answer to `finish`.

use super::answers::{Controlled, Instants};
use super::{Refusal, protocol::StepBy, samples::SampleList};
use crate::runtime::{Ledger, exposing::Exposing};
use crate::wiring::{error::LoopError, far_side::FarSide, steering::Steering};
use base::time::{Span, Tai};
use config::{Event, Plant, Scenario};
use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use frames::report::RunNumbers;
use serde_json::{Value, json};

/// Longest time that an early client waits for the run to start.
const BEGINS_WITHIN: Duration = Duration::from_secs(30);
/// Interval at which the start is checked.
const LOOK: Duration = Duration::from_millis(10);

/// The run that a session steers.
pub struct Steered<'a> {
    /// The scenario of the run.
    pub scenario: &'a Scenario,
    /// The run.
    pub steering: &'a Steering,
    /// Set when the run is over and its client is not waited for any longer.
    pub over: &'a AtomicBool,
}

impl Controlled for Steered<'_> {
    const CLOCK: &'static str = "real";

    fn scenario(&self) -> &Scenario {
        self.scenario
    }

    fn is_over(&self, _waited: Span) -> bool {
        self.over.load(Ordering::SeqCst)
    }

    /// False: requests that have arrived are answered also when the run is over.
    fn is_interrupted(&self) -> bool {
        false
    }

    fn is_whole(&self) -> bool {
        false
    }

    fn await_begin(&self) {
        let mut waited = Duration::ZERO;
        while !self.steering.has_begun() && waited < BEGINS_WITHIN {
            std::thread::sleep(LOOK);
            waited += LOOK;
        }
    }

    fn instants(&self) -> Result<Instants, String> {
        let (times, now) = self.steering.now().map_err(|error| error.to_string())?;
        Ok(Instants { zero: times.zero, now, end: times.end })
    }

    fn so_far(&self) -> Result<(Instants, RunNumbers, bool), String> {
        if let Some((times, numbers)) = self.steering.ended() {
            return Ok((Instants { zero: times.zero, now: times.end, end: times.end }, numbers, true));
        }
        let instants = self.instants()?;
        Ok((instants, self.steering.numbers().map_err(|error| error.to_string())?, false))
    }

    fn on_far_side<T: Send + 'static>(
        &mut self,
        act: impl FnOnce(&mut FarSide) -> T + Send + 'static,
    ) -> Result<T, String> {
        self.steering.on_far_end(act).map_err(|error| error.to_string())
    }

    fn on_exposing<T: Send + 'static>(
        &mut self,
        head: usize,
        act: impl FnOnce(&mut Exposing, &mut Ledger) -> T + Send + 'static,
    ) -> Result<T, String> {
        let count = self.scenario.bench.head_count();
        let done = self.steering.on_frame_thread(move |heads, _receiver, record, _release| {
            let no_head = || format!("head is {head}; there are {count}, counted from 0");
            let head = heads.get_mut(head).ok_or_else(no_head)?;
            Ok(act(head.engine.exposing_mut(), &mut record.ledger))
        });
        done.map_err(|error| error.to_string())?
    }

    fn inject(&mut self, event: &Event) -> Result<f64, String> {
        self.steering.inject(event).map(|placed| placed.at.s()).map_err(|error| error.to_string())
    }

    fn fire(&mut self, number: u16, at: Option<Tai>) -> Result<(), LoopError> {
        self.steering.trigger(number, at, self.scenario.plant == Plant::Outside)
    }

    /// Passes on samples of an external plant; each is used when it comes, by its own instant.
    fn take_samples(&mut self, samples: &SampleList) -> Result<Value, String> {
        if !self.scenario.bench.is_lockstep() {
            let why = "the attitudes of this bench come by its link, or from inside; wanted plant.kind = \"outside\" with a \
                       simulated link without gateways to send samples here";
            return Err(why.into());
        }
        let instants = self.instants()?;
        let samples = samples.since(instants.zero);
        let waiting = self.steering.send_samples(&samples).map_err(|error| error.to_string())?;
        let attitudes = samples.iter().filter(|sample| sample.attitude.is_some());
        let attitude_until_s = attitudes.map(|sample| sample.at).max().map(|at| instants.s(at));
        Ok(json!({
            "taken": samples.len(), "waiting": waiting, "attitude_until_s": attitude_until_s, "now_s": instants.now_s(),
        }))
    }

    fn note_bad_samples(&mut self) -> Result<(), String> {
        self.steering.note_bad_samples().map_err(|error| error.to_string())
    }

    fn frame(&self, head: usize, path: Option<&str>, pixels: bool) -> Result<Value, String> {
        let ended = self.steering.ended().map(|(times, _)| times.zero);
        let zero = ended.map_or_else(|| self.instants().map(|instants| instants.zero), Ok)?;
        self.steering.newest().answer(head, path, pixels, zero)
    }

    fn received_truth(&self, _at_s: Option<f64>) -> Option<Result<Value, String>> {
        None
    }

    fn step(&mut self, _by: StepBy) -> Result<Value, Refusal> {
        let why = "the real clock cannot be held: ask for state, or run with --clock virtual to step";
        Err(Refusal::Request(why.into()))
    }

    fn tracker(&self, _head: usize) -> Result<Value, String> {
        Err("the real clock goes on meanwhile: ask for estimate, or run with --clock virtual".into())
    }

    fn summary(&mut self) -> Result<Value, String> {
        Err("the report is made when the run ends: ask for state, or send finish".into())
    }
}
