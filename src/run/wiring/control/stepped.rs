//! A run on the virtual clock as its client sees it: its clock is held between two requests.

use super::answers::{Answer, Controlled, Instants, Refusal, attitude, solved};
use super::{newest::NewestFrames, protocol::StepBy, samples::SampleList};
use crate::runtime::exposing::Exposing;
use crate::runtime::{Ledger, RunRecord, TrackerOutput};
use crate::wiring::{
    assessment::mode_name, error::Result, far_side::FarSide, run_clock::RunTimes, run_end::LoopView,
    stepped::SteppedRun,
};
use base::time::{Span, Tai};
use config::{Event, Plant, Scenario};
use core::sync::atomic::{AtomicBool, Ordering};
use frames::{report::RunNumbers, sink::SentFrame};
use serde_json::{Value, json};
use testbed::tracker::Outcome;

/// A client that is silent for so long after the last frame of a run in steps counts as one that has sent `finish`: the
/// reports of the run do not wait for it.
const SILENCE_AT_THE_END: Span = Span::from_ms(30_000);

/// The run that a session controls.
pub struct Stage<'a> {
    /// The scenario of the run.
    pub scenario: &'a Scenario,
    /// The run.
    pub going: &'a mut SteppedRun,
    /// The newest frame of each head.
    pub newest: &'a mut NewestFrames,
    /// The report of a run under way.
    pub report: &'a mut dyn FnMut(&LoopView<'_>) -> Value,
    /// Called after each frame with the number of its head.
    pub progress: &'a mut dyn FnMut(usize, &SentFrame, &RunRecord),
    /// Set by Ctrl-C.
    pub stop: &'a AtomicBool,
}

impl Controlled for Stage<'_> {
    const CLOCK: &'static str = "virtual";

    fn scenario(&self) -> &Scenario {
        self.scenario
    }

    fn is_over(&self, waited: Span) -> bool {
        self.is_interrupted() || self.is_whole() && waited >= SILENCE_AT_THE_END
    }

    fn is_interrupted(&self) -> bool {
        self.stop.load(Ordering::SeqCst)
    }

    fn is_whole(&self) -> bool {
        self.going.is_finished()
    }

    fn instants(&self) -> Answer<Instants> {
        let RunTimes { zero, end, .. } = self.going.times();
        Ok(Instants { zero, now: self.going.now(), end })
    }

    fn so_far(&self) -> Answer<(Instants, RunNumbers, bool)> {
        Ok((self.instants()?, self.going.record().numbers(None), self.going.is_finished()))
    }

    fn on_far_side<T: Send + 'static>(&mut self, act: impl FnOnce(&mut FarSide) -> T + Send + 'static) -> Answer<T> {
        Ok(act(self.going.far.get_mut()))
    }

    fn on_exposing<T: Send + 'static>(
        &mut self,
        head: usize,
        act: impl FnOnce(&mut Exposing, &mut Ledger) -> T + Send + 'static,
    ) -> Answer<T> {
        Ok(self.going.with_exposing(head, act)?)
    }

    fn inject(&mut self, event: &Event) -> Answer<f64> {
        self.going.inject(event)?;
        Ok(event.at.s().max(self.instants()?.now_s()))
    }

    /// Sends the trigger over the bus.
    fn fire(&mut self, number: u16, at: Option<Tai>) -> Answer<()> {
        let now = self.going.now();
        Ok(self.going.far.get_mut().send_trigger(number, at, now)?)
    }

    /// Queues samples until their instants.
    fn take_samples(&mut self, samples: &SampleList) -> Answer {
        let instants = self.instants()?;
        let samples = samples.since(instants.zero);
        self.going.take_plant(&samples)?;
        let (waiting, attitude_until) = self.going.plant_waiting();
        let attitude_until_s = attitude_until.map(|at| instants.s(at));
        Ok(json!({ "taken": samples.len(), "waiting": waiting, "attitude_until_s": attitude_until_s }))
    }

    fn note_bad_samples(&mut self) -> Answer<()> {
        self.going.note_refused_sample();
        Ok(())
    }

    fn frame(&self, head: usize, path: Option<&str>, pixels: bool) -> Answer {
        Ok(self.newest.answer(head, path, pixels, self.going.times().zero)?)
    }

    fn received_truth(&self, at_s: Option<f64>) -> Option<Answer> {
        (self.scenario.plant == Plant::Outside).then(|| Ok(received_truth(at_s, self.going, &self.instants()?)?))
    }

    fn step(&mut self, by: StepBy) -> Answer {
        let goal = step_goal(by, self.going, &self.instants()?, self.newest.out_of_first_head())?;
        let before = self.newest.out();
        match goal {
            Goal::Time(at) => self.advance_to(at).map_err(Refusal::Loop)?,
            Goal::Frames(out) => {
                let is_short = |stage: &Self| stage.newest.out_of_first_head() < out && !stage.going.is_finished();
                while is_short(self) && !self.stop.load(Ordering::Relaxed) {
                    // Dropped and late frames do not go out at the end of their own readout: wait for later frames.
                    let at = next_frame_out(self.going).unwrap_or(self.going.times().end);
                    self.advance_to(at).map_err(Refusal::Loop)?;
                }
            }
        }
        Ok(json!({
            "now_s": self.instants()?.now_s(),
            "frames_out": self.newest.out() - before,
            "frames_delivered": self.going.record().frames.delivered,
            "mode": self.going.with_vehicle(|vehicle| mode_name(vehicle.mode())),
            "finished": self.going.is_finished(),
        }))
    }

    fn tracker(&self, head: usize) -> Answer {
        let output = self.going.tracker_output(head)?;
        let Some(TrackerOutput { frame, mid_exposure, outcome }) = output else {
            return Ok(json!({ "valid": false, "stars": 0, "reason": "no frame yet" }));
        };
        let mut answer = match outcome {
            Outcome::Solved(solution) => {
                let mut answer = solved(&solution);
                let body_from_sensor = self.going.run.heads[head].mounting.inverse();
                answer["body_from_icrf"] = (body_from_sensor * solution.sensor_from_icrf).wxyz().into();
                answer["valid"] = true.into();
                answer
            }
            Outcome::NoSolution(reason) => json!({ "valid": false, "stars": 0, "reason": reason.to_string() }),
        };
        answer["frame"] = frame.into();
        answer["mid_exposure_s"] = self.instants()?.s(mid_exposure).into();
        Ok(answer)
    }

    fn summary(&mut self) -> Answer {
        let report = self.going.look(self.newest.frames_crc32(), &mut *self.report);
        Ok(json!({ "finished": self.going.is_finished(), "report": report }))
    }
}

impl Stage<'_> {
    fn advance_to(&mut self, at: Tai) -> Result<()> {
        let Self { going, newest, progress, stop, .. } = self;
        going.advance_to(at, &mut |head, frame, record| {
            progress(head, frame, record);
            newest.keep_exchanged(head, frame);
            !stop.load(Ordering::Relaxed)
        })
    }
}

/// Goal of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
enum Goal {
    /// Up to this instant.
    Time(Tai),
    /// Until the first head has sent this many frames in total.
    Frames(u64),
}

/// Returns the goal of a step, if it is ahead and not past the end.
fn step_goal(by: StepBy, going: &SteppedRun, instants: &Instants, frames_out: u64) -> Result<Goal, String> {
    let (Instants { zero, now, end }, now_s, end_s) = (*instants, instants.now_s(), instants.s(instants.end));
    if going.is_finished() {
        return Err(format!("the run has reached its end at {end_s} s; wanted summary or finish"));
    }
    let (at, asked) = match by {
        StepBy::Seconds(s) => (now + Span::from_s(s), format!("s is {s}")),
        StepBy::Until(until_s) => (zero + Span::from_s(until_s), format!("until_s is {until_s}")),
        StepBy::Frames(frames) => {
            // A commanded camera may send any number of frames.
            let engine = &going.run.heads[0].engine;
            let at_most = if engine.exposing.is_commanded { u64::MAX } else { u64::from(engine.params.frames) };
            let left = at_most.saturating_sub(frames_out);
            let goal = Goal::Frames(frames_out.saturating_add(frames));
            let refuse = || format!("frames is {frames}; wanted at most the {left} that are left");
            return (frames <= left).then_some(goal).ok_or_else(refuse);
        }
    };
    // At the end, frames in flight go out by themselves: a run is over at its last readout.
    if at > end {
        return Err(format!("{asked}, past the end; wanted at most until_s {end_s}, it is {now_s} s now"));
    }
    if at <= now {
        return Err(format!("{asked}; wanted a time after now, which is {now_s} s"));
    }
    Ok(Goal::Time(at))
}

/// Returns when the next known frame goes out; `None` when there is none.
fn next_frame_out(going: &SteppedRun) -> Option<Tai> {
    let next = going.run.heads[0].engine.exposing.next().slot().map(|slot| slot.due);
    going.going.next_out().into_iter().chain(next).min().filter(|at| *at > going.now())
}

/// Returns the attitude that frames of the first head are drawn with, according to the samples of an external plant.
fn received_truth(at_s: Option<f64>, going: &SteppedRun, instants: &Instants) -> Result<Value, String> {
    let at = instants.at(at_s);
    let asked_s = instants.s(at);
    if at > instants.now {
        let now_s = instants.now_s();
        return Err(format!("at_s is {asked_s} s; wanted a time not after now, which is {now_s} s"));
    }
    let estimated = going.attitude_at(at).map_err(|error| format!("at_s is {asked_s}: {error}"))?;
    let mut answer = attitude(&(going.run.scenario.bench.sensor_from_body * estimated.state.body_from_icrf));
    answer["at_s"] = asked_s.into();
    answer["body_rate_rad_s"] = estimated.state.rate_rad_s.to_array().to_vec().into();
    answer["origin"] = estimated.origin.name().into();
    Ok(answer)
}
