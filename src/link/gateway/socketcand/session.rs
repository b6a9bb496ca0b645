//! One socketcand client's session: commands -> answers and frames; frames -> elements.
//!
//! Raw mode only: `< open BUS >`, `< rawmode >`, then `< send .. >` and `< frame .. >`. Classic frames only, as the
//! protocol has no others.

use super::super::client::{Client, Dialogue, Sending};
use super::super::{put_bytes, put_id};
use super::parser::{Command, Parser};
use crate::{Packet, Stamped};
use base::time::{Span, Tai};
use base::units::NS_PER_S;
use std::io::Write;

/// After `< ok >` to raw mode, no frame for so long: clients read the answer and expect nothing behind it.
const QUIET_AFTER_OK: Span = Span::from_ms(20);

/// Progress of a client.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Step {
    Greeted,
    Opened,
    Raw,
}

/// One client's session.
pub(in super::super) struct Session {
    parser: Parser,
    bus_name: String,
    step: Step,
}

impl Session {
    pub(in super::super) fn new(bus_name: &str) -> Self {
        Self { parser: Parser::default(), bus_name: bus_name.into(), step: Step::Greeted }
    }

    /// Returns the answer, which may be empty; `Err` with the reason when the command is refused.
    fn obey(&mut self, command: &Command, client: &Client) -> Result<&'static [u8], &'static str> {
        match command {
            Command::Echo => Ok(b"< echo >"),
            Command::Open(name) if name.as_bytes() != self.bus_name.as_bytes() => Err("unknown_bus"),
            Command::Open(_) => {
                client.open();
                self.step = Step::Opened;
                client.listening.close();
                Ok(b"< ok >")
            }
            Command::RawMode | Command::Send(_) if self.step == Step::Greeted => Err("not_open"),
            Command::RawMode => {
                self.step = Step::Raw;
                client.listening.open(client.clock.now() + QUIET_AFTER_OK);
                Ok(b"< ok >")
            }
            Command::Send(_) if self.step != Step::Raw => Err("not_in_raw_mode"),
            Command::Send(frame) => match client.send(frame) {
                Sending::Queued => Ok(b""),
                Sending::Refused(reason) => Err(reason),
            },
        }
    }
}

impl Dialogue for Session {
    fn greeting(&self) -> &'static [u8] {
        b"< hi >"
    }

    fn read(&mut self, bytes: &[u8], client: &Client) {
        let mut parser = core::mem::take(&mut self.parser);
        parser.push(bytes, &mut |element| {
            if client.is_over() {
                return;
            }
            let outcome = match element {
                Ok(command) => {
                    client.count_valid();
                    self.obey(&command, client)
                }
                Err(reject) => {
                    client.count_malformed();
                    Err(reject.name())
                }
            };
            match outcome {
                Ok(answer) => client.answer(answer),
                Err(reason) => {
                    client.tally.reject(reason);
                    client.answer(format!("< error {reason} >").as_bytes());
                }
            }
        });
        self.parser = parser;
    }
}

/// Adds the element for a received frame; false when it has none. `tai_minus_utc_s` makes Unix time of the stamp.
pub(in super::super) fn element(packet: &Stamped<Packet>, tai_minus_utc_s: i64, out: &mut Vec<u8>) -> bool {
    let Packet::Can(frame) = &packet.value else { return false };
    if frame.is_fd() {
        return false;
    }
    let unix_us = (packet.at.ns() - tai_minus_utc_s * NS_PER_S).div_euclid(1000);
    let (seconds, micros) = (unix_us.div_euclid(1_000_000), unix_us.rem_euclid(1_000_000));
    out.extend_from_slice(b"< frame ");
    put_id(out, frame.id());
    let _ = write!(out, " {seconds}.{micros:06} "); // writing to memory cannot fail
    put_bytes(out, frame.data());
    out.extend_from_slice(b" >");
    true
}

/// Returns the whole seconds between TAI and Unix time around `at`.
pub(in super::super) fn tai_minus_utc_s(at: Tai) -> i64 {
    let seconds = at.ns() as f64 / NS_PER_S as f64 - at.unix_s();
    Span::from_s(seconds.round()).ns() / NS_PER_S
}

#[cfg(test)]
mod tests {
    use super::*;
    use firmware_protocol::can::{CanFrame, CanId};

    #[test]
    fn frames_are_shown_with_unix_time() {
        // 2020-01-01T00:00:00Z is 1577836800 in Unix time (`date -u -d 2020-01-01 +%s`), TAI 37 s ahead.
        let at = Tai::from_rfc3339("2020-01-01T00:00:00.000042Z").unwrap();
        assert_eq!(tai_minus_utc_s(at), 37);
        let shown = |frame: CanFrame| {
            let mut out = Vec::new();
            let any = element(&Stamped { at, value: Packet::Can(frame) }, 37, &mut out);
            any.then(|| String::from_utf8(out).unwrap())
        };
        let classic = CanFrame::classic(0x12, &[1, 0xAB]).unwrap();
        assert_eq!(shown(classic).as_deref(), Some("< frame 012 1577836800.000042 01AB >"));
        let extended = CanFrame::classic(CanId::extended(0x12).unwrap(), &[1]).unwrap();
        assert_eq!(shown(extended).as_deref(), Some("< frame 00000012 1577836800.000042 01 >"));
        let empty = CanFrame::classic(0x7FF, &[]).unwrap();
        assert_eq!(shown(empty).as_deref(), Some("< frame 7FF 1577836800.000042  >"));
        assert_eq!(shown(CanFrame::fd(1, &[0; 12]).unwrap()), None, "the protocol has no FD");
    }
}
