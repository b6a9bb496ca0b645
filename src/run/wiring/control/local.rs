//! A run on the virtual clock under the control of the program it is in: the requests of the socket without a socket.
//!
//! In: requests as objects of [`super::protocol`]. Out: their answers, and the newest frame of each head itself.
//! Tests: below.

use super::answers::{Refusal, answer};
use super::{NewestFrames, Stage, protocol};
use crate::runtime::RunRecord;
use crate::wiring::run_end::{LoopView, RunEnd};
use crate::wiring::{assemble::Run, error::Result, stepped::SteppedRun};
use config::Scenario;
use core::sync::atomic::AtomicBool;
use frames::sink::SentFrame;
use serde_json::Value;
use std::path::Path;

/// A run and the frames that it sent last.
pub struct LocalSession {
    scenario: Scenario,
    going: SteppedRun,
    newest: NewestFrames,
}

impl LocalSession {
    /// Returns a run before its first step; frames may be written below `output` on request.
    ///
    /// # Errors
    /// When the run is not one that is stepped.
    pub fn of(run: Run, output: Option<&Path>) -> Result<Self> {
        let scenario = run.scenario.clone();
        let newest = NewestFrames::new(scenario.bench.head_count(), output);
        Ok(Self { going: SteppedRun::of(run)?, scenario, newest })
    }

    /// Answers one request, a line of JSON: an object without "ok". `report` makes the report of a run under way.
    ///
    /// # Errors
    /// With what is wrong with the request, or with the loop that failed.
    pub fn ask(
        &mut self,
        line: &str,
        report: &mut dyn FnMut(&Scenario, &LoopView<'_>) -> Value,
    ) -> Result<Value, String> {
        let (_, request) = protocol::parse(line);
        let Self { scenario, going, newest } = self;
        let (scenario, stop) = (&*scenario, AtomicBool::new(false));
        let mut report = |view: &LoopView<'_>| report(scenario, view);
        let progress = &mut |_: usize, _: &SentFrame, _: &RunRecord| {};
        let mut stage = Stage { scenario, going, newest, report: &mut report, progress, stop: &stop };
        answer(request?, &mut stage).map_err(|refusal| match refusal {
            Refusal::Request(why) => why,
            Refusal::Loop(error) => format!("the run failed and is over: {error}"),
        })
    }

    /// Returns the newest frame of a head; `None` before its first, or for a head that does not exist.
    pub fn newest(&self, head: usize) -> Option<&SentFrame> {
        self.newest.newest(head)
    }

    /// Returns true when all frames of the run have gone out.
    pub fn is_finished(&self) -> bool {
        self.going.is_finished()
    }

    /// Ends the run where it is.
    pub fn end(mut self) -> (Scenario, RunEnd) {
        let error = self.going.finish_early(&mut |_, _, _| true);
        (self.scenario, self.going.end(error.err()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wiring::assemble::{Outputs, RunOptions};
    use config::Document;
    use frames::sink::{NullSink, Sink};

    #[test]
    fn requests_are_answered_as_over_the_socket() {
        let document = Document::built_in("benches/closed_loop_small.toml").unwrap();
        let scenario = Scenario::from_document(&document).unwrap().lasting(5.0);
        let mut sink = |_head: usize| Box::new(NullSink::new()) as Box<dyn Sink>;
        let run = Run::assemble(&scenario, RunOptions::stepped(Outputs::Made(&mut sink))).unwrap();
        let mut session = LocalSession::of(run, None).unwrap();
        let mut report = |_: &Scenario, _: &LoopView<'_>| Value::from("report");
        let mut ask = |line: &str| session.ask(line, &mut report);
        assert_eq!(ask(r#"{"request": "hello"}"#).unwrap()["protocol"], 2);
        assert!(ask(r#"{"request": "frame"}"#).unwrap_err().contains("no frame has gone out yet"));
        assert_eq!(ask(r#"{"request": "step", "frames": 2}"#).unwrap()["frames_out"], 2);
        assert!(ask(r#"{"request": "jump"}"#).is_err(), "control: another request");
        assert_eq!(ask(r#"{"request": "summary"}"#).unwrap()["report"], "report");
        assert_eq!(session.newest(0).unwrap().meta.number, 1);
        assert!(session.newest(9).is_none(), "heads are counted from 0");
        assert!(!session.is_finished(), "two frames of ten");
        assert_eq!(session.end().1.record.frames.delivered, 2);
    }
}
