//! The control socket: an external program advances the clock of a closed loop, observes it and injects faults.
//!
//! In: requests, one line of JSON each ([`protocol`]). Out: one line of JSON per request, `"ok"` true or false, the
//! request's `"id"` echoed. An invalid request is explained in its reply and changes nothing; only the end of the
//! connection, `finish`, Ctrl-C, another protocol or a failed loop end a session. One client, loopback only, no
//! encryption: only a program that can read the token (`token`) may control the run. Frames are written below the run's
//! output folder only (`output`). Stepping in any lengths gives the same bits as the run in one piece. Tests: `tests`
//! of the parts, and `tests/closed_loop/control.rs` through the binary.

mod admission;
mod answers;
mod camera;
mod error;
mod lines;
pub mod local;
mod newest;
mod output;
pub mod protocol;
mod reaction;
mod samples;
mod steered;
#[cfg(test)]
mod tests;
mod token;

pub use admission::ControlRefusals;
pub use error::ControlError;
pub use lines::ControlAddress;

use crate::runtime::exposing::Exposing;
use crate::runtime::{Ledger, RunRecord};
use crate::wiring::{error::LoopError, run_end::LoopView, steering::Steering, stepped::SteppedRun};
use admission::{Admitted, admit, foreign_sentence};
use answers::Instants;
use base::clock::{Clock, Monotonic};
use base::time::Span;
use config::Scenario;
use core::sync::atomic::{AtomicBool, Ordering};
use frames::sink::SentFrame;
use lines::{Incoming, LineSocket};
pub use newest::NewestFrames;
use protocol::{Request, StepBy, refused, reported};
use serde_json::{Value, json};
use std::{net::TcpListener, path::Path};
use testbed::vehicle::Vehicle;
use token::{Token, TokenFile};

/// A client that is silent for so long after the last frame of a run in steps counts as one that has sent `finish`: the
/// reports of the run do not wait for it.
const SILENCE_AT_THE_END: Span = Span::from_ms(30_000);

/// How a session ended.
#[derive(Debug, Clone, PartialEq)]
pub enum SessionEnd {
    /// The client requested the end, or is silent after it; the last reply needs its request's id.
    Finish(Option<Value>),
    /// The client closed the connection.
    Gone,
    /// Ctrl-C.
    Interrupted,
}

/// A socket that waits for its client.
pub struct ControlListener {
    listener: TcpListener,
    address: ControlAddress,
    token: Token,
    file: TokenFile,
}

impl ControlListener {
    /// Listens, with a new token.
    ///
    /// # Errors
    /// When the system refuses the address, or the token's file.
    pub fn bind(address: ControlAddress) -> Result<Self, ControlError> {
        let refuse = |source| ControlError::Listen { address, source };
        let listener = TcpListener::bind(address.socket()).map_err(refuse)?;
        listener.set_nonblocking(true).map_err(refuse)?;
        let address = ControlAddress::of(listener.local_addr().map_err(refuse)?).unwrap_or(address);
        let token = Token::random()?;
        let file = TokenFile::write(&token, address)?;
        Ok(Self { listener, address, token, file })
    }

    /// Returns its address, and the token with its file, a line each.
    pub fn announcement(&self) -> String {
        let Self { address, token, file, .. } = self;
        format!("control: listening on {address}\ncontrol: token {token}, also in {}", file.path.display())
    }

    /// Waits for a client with the token; returns `None` when `stop` came first. Frames may be written below `output`.
    pub fn accept(self, scenario: &Scenario, output: Option<&Path>, stop: &AtomicBool) -> Option<ControlSession> {
        let Self { listener, token, file, .. } = self;
        let mut refusals = ControlRefusals::new();
        let Admitted { socket, id } = admit(&listener, &token, stop, &mut refusals)?;
        let newest = NewestFrames::new(scenario.bench.head_count(), output);
        Some(ControlSession { socket, newest, token, refusals, hello: Some(id), _removed_at_the_end: file })
    }
}

/// A connected client.
pub struct ControlSession {
    socket: LineSocket,
    newest: NewestFrames,
    token: Token,
    refusals: ControlRefusals,
    /// Id of the hello that is not answered yet.
    hello: Option<Option<Value>>,
    _removed_at_the_end: TokenFile,
}

/// Called after each frame with the number of its head.
pub type Progress<'a> = &'a mut dyn FnMut(usize, &SentFrame, &RunRecord);

/// The run that a session controls.
pub struct Stage<'a> {
    /// The scenario of the run.
    pub scenario: &'a Scenario,
    /// The run.
    pub going: &'a mut SteppedRun,
    /// The report of a run under way.
    pub report: &'a mut dyn FnMut(&LoopView<'_>) -> Value,
    /// Called after each frame.
    pub progress: Progress<'a>,
    /// Set by Ctrl-C.
    pub stop: &'a AtomicBool,
}

impl ControlSession {
    /// Answers requests until the session ends.
    ///
    /// # Errors
    /// When the loop failed; the error was sent to the client.
    pub fn serve(&mut self, stage: &mut Stage<'_>) -> Result<SessionEnd, LoopError> {
        if let Some(id) = self.hello.take() {
            self.socket.send(&reported(id, hello(stage)));
        }
        let clock = Monotonic::start();
        loop {
            let (asked, is_finished) = (clock.now(), stage.going.is_finished());
            let is_stopped = || stage.stop.load(Ordering::SeqCst);
            let is_over = || is_stopped() || is_finished && clock.now() - asked >= SILENCE_AT_THE_END;
            let line = match self.next_line(&is_over) {
                Next::Line(line) => line,
                Next::Again => continue,
                // The run is whole: its end is not put off, and it was not interrupted.
                Next::End(SessionEnd::Interrupted) if is_finished => return Ok(SessionEnd::Finish(None)),
                Next::End(end) => return Ok(end),
            };
            let (id, request) = protocol::parse(&line);
            let answer = match request {
                Ok(Request::Finish) => return Ok(SessionEnd::Finish(id)),
                Ok(request) => self.answer(&request, stage),
                Err(why) => Err(Refusal::Request(why)),
            };
            match answer {
                Ok(answer) => self.socket.send(&reported(id, answer)),
                Err(Refusal::Request(why)) => self.socket.send(&refused(id, &why)),
                Err(Refusal::Loop(error)) => {
                    self.socket.send(&refused(id, &format!("the run failed and is over: {error}")));
                    return Err(error);
                }
            }
            if stage.stop.load(Ordering::SeqCst) {
                return Ok(SessionEnd::Interrupted);
            }
        }
    }

    /// Answers requests about a run on the real clock until the session ends, or `over` is set.
    #[must_use]
    pub fn serve_steered(&mut self, scenario: &Scenario, steering: &Steering, over: &AtomicBool) -> SessionEnd {
        if let Some(id) = self.hello.take() {
            let hello = steered::hello(scenario, steering);
            self.socket.send(&hello.map_or_else(|why| refused(id.clone(), &why), |hello| reported(id.clone(), hello)));
        }
        loop {
            let line = match self.next_line(&|| over.load(Ordering::SeqCst)) {
                Next::Line(line) => line,
                Next::Again => continue,
                Next::End(end) => return end,
            };
            let (id, request) = protocol::parse(&line);
            let answer = match request {
                Ok(Request::Finish) => return SessionEnd::Finish(id),
                Ok(Request::Hello { token: Some(text) }) if !self.token.is(&text) => {
                    Err("the token is not that of this run".into())
                }
                Ok(request) => steered::answer(&request, scenario, steering),
                Err(why) => Err(why),
            };
            self.socket
                .send(&answer.map_or_else(|why| refused(id.clone(), &why), |answer| reported(id.clone(), answer)));
        }
    }

    /// Reads the next line that may be a request; invalid lines are answered here.
    fn next_line(&mut self, is_over: &dyn Fn() -> bool) -> Next {
        match self.socket.read_line(is_over) {
            Incoming::Line(line) => Next::Line(line),
            Incoming::Unusable(why) => {
                self.socket.send(&refused(None, &why));
                Next::Again
            }
            Incoming::Foreign(foreign) => {
                *self.refusals.entry(foreign.name()).or_default() += 1;
                self.socket.send(&refused(None, &foreign_sentence()));
                Next::End(SessionEnd::Gone)
            }
            Incoming::Gone => Next::End(SessionEnd::Gone),
            Incoming::Stopped => Next::End(SessionEnd::Interrupted),
        }
    }

    /// Returns the number of connections refused before and during the session, by reason.
    pub fn refusals(&self) -> &ControlRefusals {
        &self.refusals
    }

    /// Sends the last reply: the final report and the coming exit status.
    pub fn close(mut self, id: Option<Value>, report: Value, exit_status: u8) {
        self.socket.send(&reported(id, json!({ "report": report, "exit_status": exit_status })));
    }

    fn answer(&mut self, request: &Request, stage: &mut Stage<'_>) -> Result<Value, Refusal> {
        match request {
            Request::Hello { token: Some(text) } if !self.token.is(text) => {
                Err(Refusal::Request("the token is not that of this run".into()))
            }
            Request::Hello { .. }
            | Request::State
            | Request::Step(_)
            | Request::Inject(_)
            | Request::Trigger { .. }
            | Request::Truth { .. }
            | Request::Estimate
            | Request::Frame { .. }
            | Request::React(_)
            | Request::Tracker { .. }
            | Request::Camera(_)
            | Request::BadSamples(_)
            | Request::Plant(_)
            | Request::Summary
            | Request::Finish => answer(&mut self.newest, request, stage),
        }
    }
}

/// Answers one request about a run on the virtual clock.
fn answer(newest: &mut NewestFrames, request: &Request, stage: &mut Stage<'_>) -> Result<Value, Refusal> {
    let going = &mut *stage.going;
    match request {
        Request::Hello { .. } => Ok(hello(stage)),
        Request::State => Ok(state(going)),
        Request::Step(by) => step(newest, *by, stage),
        Request::Inject(keys) => Ok(answers::inject(keys, going)?),
        Request::Trigger { number, at_s } => Ok(answers::trigger(*number, *at_s, going)?),
        Request::Truth { at_s } => Ok(truth(*at_s, going)?),
        Request::Estimate => Ok(estimate(going)),
        Request::Frame { head, path, pixels } => Ok(newest.answer(*head, path.as_deref(), *pixels, going.zero())?),
        Request::React(reaction) => {
            let zero = going.zero();
            let done = going.with_vehicle_mut(|vehicle, now| reaction.act(vehicle, zero, now));
            Ok(done.map_err(|error| error.to_string())??)
        }
        Request::Tracker { head } => Ok(answers::tracker(*head, going)?),
        Request::Camera(camera) => {
            let zero = going.zero();
            let act = |exposing: &mut Exposing, ledger: &mut Ledger, now| camera.act(exposing, ledger, zero, now);
            Ok(going.with_exposing(camera.head, act).map_err(|error| error.to_string())??)
        }
        Request::BadSamples(why) => {
            going.note_bad_samples();
            Err(Refusal::Request(why.clone()))
        }
        Request::Plant(samples) => Ok(answers::plant(samples, going)?),
        Request::Summary => {
            let report = going.look(newest.frames_crc32(), &mut *stage.report);
            Ok(json!({ "finished": going.is_finished(), "report": report }))
        }
        Request::Finish => Ok(Value::Null),
    }
}

fn step(newest: &mut NewestFrames, by: StepBy, stage: &mut Stage<'_>) -> Result<Value, Refusal> {
    let going = &mut *stage.going;
    let goal = answers::step_goal(by, going, newest.out_of_first_head())?;
    let before = newest.out();
    let (progress, stop) = (&mut *stage.progress, stage.stop);
    match goal {
        answers::Goal::Time(at) => going.advance_to(at, &mut |head, frame, record| {
            progress(head, frame, record);
            newest.keep_exchanged(head, frame);
            !stop.load(Ordering::Relaxed)
        })?,
        answers::Goal::Frames(out) => step_frames(going, out, newest, progress, stop)?,
    }
    Ok(answers::stepped(going, newest.out() - before))
}

fn hello(stage: &Stage<'_>) -> Value {
    answers::hello(stage.scenario, &Instants::of(stage.going), "virtual")
}

fn state(going: &SteppedRun) -> Value {
    let mode = going.with_vehicle(Vehicle::mode);
    answers::state(&going.record().numbers(None), &Instants::of(going), mode, going.is_finished())
}

fn truth(at_s: Option<f64>, going: &SteppedRun) -> Result<Value, String> {
    if going.is_outside() {
        return answers::received_truth(at_s, going);
    }
    let (mounting, instants) = (going.mounting(), Instants::of(going));
    let looked = going.with_vehicle(|vehicle| answers::truth(at_s, Some(vehicle), mounting, &instants));
    looked.unwrap_or_else(|| answers::truth(at_s, None, mounting, &instants))
}

fn estimate(going: &SteppedRun) -> Value {
    let (mounting, instants) = (going.mounting(), Instants::of(going));
    let looked = going.with_vehicle(|vehicle| answers::estimate(Some(vehicle), mounting, &instants));
    looked.unwrap_or_else(|| answers::estimate(None, mounting, &instants))
}

/// Advances from one readout to the next until the first head has sent `out` frames in total, or the run is over.
fn step_frames(
    going: &mut SteppedRun,
    out: u64,
    newest: &mut NewestFrames,
    progress: Progress<'_>,
    stop: &AtomicBool,
) -> Result<(), LoopError> {
    while newest.out_of_first_head() < out && !going.is_finished() && !stop.load(Ordering::Relaxed) {
        // Dropped and late frames do not go out at the end of their own readout: wait for later frames.
        let at = going.next_frame_out().unwrap_or(going.end_at());
        going.advance_to(at, &mut |head, frame, record| {
            progress(head, frame, record);
            newest.keep_exchanged(head, frame);
            !stop.load(Ordering::Relaxed)
        })?;
    }
    Ok(())
}

/// Next input from a client.
enum Next {
    Line(String),
    Again,
    End(SessionEnd),
}

/// Reason why a request is not executed.
enum Refusal {
    /// Something is wrong with the request; the session goes on.
    Request(String),
    /// The loop failed.
    Loop(LoopError),
}

impl From<String> for Refusal {
    fn from(why: String) -> Self {
        Self::Request(why)
    }
}

impl From<LoopError> for Refusal {
    fn from(error: LoopError) -> Self {
        Self::Loop(error)
    }
}
