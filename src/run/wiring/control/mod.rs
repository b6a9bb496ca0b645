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
mod lines;
pub mod local;
mod newest;
pub mod protocol;
mod reaction;
mod samples;
mod steered;
mod stepped;
#[cfg(test)]
mod tests;
mod token;

pub use admission::ControlRefusals;
pub use lines::ControlAddress;

use crate::wiring::error::LoopError;
use admission::{Admitted, admit, foreign_sentence};
use answers::{Answer, Controlled, Refusal};
use base::clock::{Clock, Monotonic};
use base::refused::Refused;
use core::sync::atomic::AtomicBool;
use lines::{Incoming, LineSocket};
pub use newest::NewestFrames;
use protocol::{Request, refused, reported};
use serde_json::{Value, json};
use std::net::TcpListener;
pub use steered::Steered;
pub use stepped::Stage;
use token::{Token, TokenFile};

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
    pub fn bind(address: ControlAddress) -> Result<Self, Refused> {
        let refuse = |source: std::io::Error| {
            Refused(format!("control socket: cannot listen on {address} ({source}); port 0 takes any free one"))
        };
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

    /// Waits for a client with the token; returns `None` when `stop` came first.
    pub fn accept(self, stop: &AtomicBool) -> Option<ControlSession> {
        let Self { listener, token, file, .. } = self;
        let mut refusals = ControlRefusals::new();
        let Admitted { socket, id } = admit(&listener, &token, stop, &mut refusals)?;
        Some(ControlSession { socket, token, refusals, hello: Some(id), _removed_at_the_end: file })
    }
}

/// A connected client.
pub struct ControlSession {
    socket: LineSocket,
    token: Token,
    refusals: ControlRefusals,
    /// Id of the hello that is not answered yet.
    hello: Option<Option<Value>>,
    _removed_at_the_end: TokenFile,
}

impl ControlSession {
    /// Answers requests until the session ends.
    ///
    /// # Errors
    /// When the loop failed; the error was sent to the client.
    pub fn serve(&mut self, stage: &mut Stage<'_>) -> Result<SessionEnd, LoopError> {
        self.serve_run(stage)
    }

    /// Answers requests about a run on the real clock, which reports its own failure, until the session ends or the run
    /// is over.
    #[must_use]
    pub fn serve_steered(&mut self, steered: &mut Steered<'_>) -> SessionEnd {
        self.serve_run(steered).unwrap_or(SessionEnd::Gone)
    }

    fn serve_run(&mut self, run: &mut impl Controlled) -> Result<SessionEnd, LoopError> {
        if let Some(id) = self.hello.take() {
            self.reply(id, answers::hello(run))?;
        }
        let clock = Monotonic::start();
        loop {
            let asked = clock.now();
            let line = match self.next_line(&|| run.is_over(clock.now() - asked)) {
                Next::Line(line) => line,
                Next::Again => continue,
                // The run is whole: its end is not put off, and it was not interrupted.
                Next::End(SessionEnd::Interrupted) if run.is_whole() => return Ok(SessionEnd::Finish(None)),
                Next::End(end) => return Ok(end),
            };
            let (id, request) = protocol::parse(&line);
            let answer = match request {
                Ok(Request::Finish) => return Ok(SessionEnd::Finish(id)),
                Ok(Request::Hello { token: Some(text) }) if !self.token.is(&text) => {
                    Err(Refusal::Request("the token is not that of this run".into()))
                }
                Ok(request) => answers::answer(request, run),
                Err(why) => Err(Refusal::Request(why)),
            };
            self.reply(id, answer)?;
            if run.is_interrupted() {
                return Ok(SessionEnd::Interrupted);
            }
        }
    }

    /// Sends an answer; returns the error of a loop that failed.
    fn reply(&mut self, id: Option<Value>, answer: Answer) -> Result<(), LoopError> {
        match answer {
            Ok(answer) => self.socket.send(&reported(id, answer)),
            Err(Refusal::Request(why)) => self.socket.send(&refused(id, &why)),
            Err(Refusal::Loop(error)) => {
                self.socket.send(&refused(id, &format!("the run failed and is over: {error}")));
                return Err(error);
            }
        }
        Ok(())
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
}

/// Next input from a client.
enum Next {
    Line(String),
    Again,
    End(SessionEnd),
}
