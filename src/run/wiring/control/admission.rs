//! Decides which connection may control a run: the first one whose first request is a hello with the right token.
//!
//! Until then a connection is closed, for good and counted, at its first line that is anything else: a web page's
//! POST, a malformed line, a request without the token. One that sends nothing is closed after
//! [`OPENING_WITHIN`], or after [`GRACE`] when another one waits. A refused client gets one line with the reason.

use crate::wiring::control::lines::{Incoming, LOOK, LineSocket};
use crate::wiring::control::protocol::{self, Request, refused};
use crate::wiring::control::token::Token;
use base::clock::{Clock, Monotonic};
use base::time::Tai;
use core::sync::atomic::{AtomicBool, Ordering};
use link::gateway::{GRACE, OPENING_WITHIN};
use serde_json::Value;
use std::{collections::BTreeMap, net::TcpListener};

/// Connections that were refused, by reason.
pub type ControlRefusals = BTreeMap<&'static str, u64>;

/// A client with the token.
#[derive(Debug)]
pub(super) struct Admitted {
    pub(super) socket: LineSocket,
    /// Id of its hello, which is not answered yet.
    pub(super) id: Option<Value>,
}

/// Decision about a connection.
enum Verdict {
    /// It is admitted as the client; its hello has this id.
    Admit(Option<Value>),
    /// It is closed, for this reason, with this sentence.
    Refuse(&'static str, Option<Value>, String),
    /// It closed itself.
    Forget,
}

/// Waits for the client; returns `None` when `stop` came first.
pub(super) fn admit(
    listener: &TcpListener,
    token: &Token,
    stop: &AtomicBool,
    refusals: &mut ControlRefusals,
) -> Option<Admitted> {
    let clock = Monotonic::start();
    let mut waiting: Option<(LineSocket, Tai)> = None;
    while !stop.load(Ordering::SeqCst) {
        let now = clock.now();
        if waiting.as_ref().is_none_or(|(_, since)| now - *since >= GRACE)
            && let Ok(newcomer) = listener.accept().and_then(|(stream, _)| LineSocket::new(stream))
            && let Some((idle, _)) = waiting.replace((newcomer, now))
        {
            refuse(idle, refusals, "gave_way", None, "no hello came, and another client waits");
        }
        let Some((mut socket, since)) = waiting.take() else {
            std::thread::sleep(LOOK);
            continue;
        };
        match socket.look().map(|incoming| judge(incoming, token)) {
            None if now - since >= OPENING_WITHIN => {
                refuse(
                    socket,
                    refusals,
                    "never_opened",
                    None,
                    &format!("no hello came within {} s", OPENING_WITHIN.s()),
                );
            }
            None => waiting = Some((socket, since)),
            Some(Verdict::Admit(id)) => return Some(Admitted { socket, id }),
            Some(Verdict::Refuse(reason, id, why)) => refuse(socket, refusals, reason, id, &why),
            Some(Verdict::Forget) => {}
        }
    }
    None
}

fn judge(incoming: Incoming, token: &Token) -> Verdict {
    let line = match incoming {
        Incoming::Line(line) => line,
        Incoming::Unusable(why) => return Verdict::Refuse("malformed_lines", None, why),
        Incoming::Foreign(foreign) => return Verdict::Refuse(foreign.name(), None, foreign_sentence()),
        Incoming::Gone | Incoming::Stopped => return Verdict::Forget,
    };
    let (id, request) = protocol::parse(&line);
    let wanted =
        "wanted {\"request\": \"hello\", \"token\": \"...\"} first, with the token that the program has printed";
    match request {
        Ok(Request::Hello { token: Some(text) }) if token.is(&text) => Verdict::Admit(id),
        Ok(Request::Hello { token: Some(_) }) => {
            Verdict::Refuse("wrong_token", id, format!("the token is not that of this run; {wanted}"))
        }
        Ok(Request::Hello { token: None }) => Verdict::Refuse("no_token", id, format!("token is missing; {wanted}")),
        Ok(_) => Verdict::Refuse("no_hello", id, format!("the first request is not hello; {wanted}")),
        Err(why) => Verdict::Refuse("malformed_lines", id, why),
    }
}

/// Returns the sentence sent to a client that speaks HTTP or TLS.
pub(super) fn foreign_sentence() -> String {
    "this is a control socket of starloop: wanted lines of JSON; the connection is closed".into()
}

fn refuse(mut socket: LineSocket, refusals: &mut ControlRefusals, reason: &'static str, id: Option<Value>, why: &str) {
    *refusals.entry(reason).or_default() += 1;
    socket.send(&refused(id, why));
}
