//! A run on the real clock as its client sees it: it goes on while answers are made.
//!
//! Not available: what [`Controlled`] refuses.

use super::answers::{Answer, Controlled, Instants, Refusal};
use super::samples::SampleList;
use crate::runtime::{Ledger, exposing::Exposing};
use crate::wiring::{far_side::FarSide, run_clock::RunTimes, steering::Steering};
use base::time::{Span, Tai};
use config::{Event, Plant, Scenario};
use core::sync::atomic::{AtomicBool, Ordering};
use core::time::Duration;
use frames::report::RunNumbers;
use serde_json::json;

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

    fn await_begin(&self) {
        let mut waited = Duration::ZERO;
        while !self.steering.has_begun() && waited < BEGINS_WITHIN {
            std::thread::sleep(LOOK);
            waited += LOOK;
        }
    }

    fn instants(&self) -> Answer<Instants> {
        let (times, now) = self.steering.now()?;
        Ok(Instants { zero: times.zero, now, end: times.end })
    }

    fn so_far(&self) -> Answer<(Instants, RunNumbers, bool)> {
        let over = |(times, numbers): (RunTimes, RunNumbers)| {
            (Instants { zero: times.zero, now: times.end, end: times.end }, numbers, true)
        };
        if let Some(ended) = self.steering.ended() {
            return Ok(over(ended));
        }
        let going = self.instants().and_then(|instants| Ok((instants, self.steering.numbers()?, false)));
        // The frame thread may have ended since: the run is summed up then.
        going.or_else(|error| self.steering.awaited_end().map(over).ok_or(error))
    }

    fn on_far_side<T: Send + 'static>(&mut self, act: impl FnOnce(&mut FarSide) -> T + Send + 'static) -> Answer<T> {
        Ok(self.steering.on_far_end(act)?)
    }

    fn on_exposing<T: Send + 'static>(
        &mut self,
        head: usize,
        act: impl FnOnce(&mut Exposing, &mut Ledger) -> T + Send + 'static,
    ) -> Answer<T> {
        let count = self.scenario.bench.head_count();
        let done = self.steering.on_frame_thread(move |heads, _receiver, record, _release| {
            let no_head = || format!("head is {head}; there are {count}, counted from 0");
            let head = heads.get_mut(head).ok_or_else(no_head)?;
            Ok::<_, String>(act(&mut head.engine.exposing, &mut record.ledger))
        });
        Ok(done??)
    }

    fn inject(&mut self, event: &Event) -> Answer<f64> {
        Ok(self.steering.inject(event)?.at.s())
    }

    fn fire(&mut self, number: u16, at: Option<Tai>) -> Answer<()> {
        Ok(self.steering.trigger(number, at, self.scenario.plant == Plant::Outside)?)
    }

    /// Passes on samples of an external plant; each is used when it comes, by its own instant.
    fn take_samples(&mut self, samples: &SampleList) -> Answer {
        if !self.scenario.bench.is_lockstep() {
            let why = "the attitudes of this bench come by its link, or from inside; wanted plant.kind = \"outside\" with a \
                       simulated link without gateways to send samples here";
            return Err(Refusal::Request(why.into()));
        }
        let instants = self.instants()?;
        let samples = samples.since(instants.zero);
        let waiting = self.steering.send_samples(&samples)?;
        let attitudes = samples.iter().filter(|sample| sample.attitude.is_some());
        let attitude_until_s = attitudes.map(|sample| sample.at).max().map(|at| instants.s(at));
        Ok(json!({
            "taken": samples.len(), "waiting": waiting, "attitude_until_s": attitude_until_s, "now_s": instants.now_s(),
        }))
    }

    fn note_bad_samples(&mut self) -> Answer<()> {
        Ok(self.steering.note_bad_samples()?)
    }

    fn frame(&self, head: usize, path: Option<&str>, pixels: bool) -> Answer {
        let ended = self.steering.ended().map(|(times, _)| times.zero);
        let zero = ended.map_or_else(|| self.instants().map(|instants| instants.zero), Ok)?;
        Ok(self.steering.newest().answer(head, path, pixels, zero)?)
    }
}
