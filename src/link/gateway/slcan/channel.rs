//! One slcan client's channel: commands -> answers and frames; frames -> lines.
//!
//! Answers as a Lawicel adapter: a carriage return for done, BELL for refused. Differs: `C` and `O` may be repeated;
//! `S` and `Y` do not set the rate of the bus, which is fixed: another rate is refused, and `O` works all the same;
//! acceptance filters are refused unless they let everything pass.

use super::super::client::{Client, Dialogue, Sending};
use super::super::{put_bytes, put_digits, put_id};
use super::parser::{Command, LENGTHS, Parser};
use crate::simulated::{BusTiming, ErrorState};
use crate::{Packet, Stamped};
use base::time::Tai;
use core::sync::atomic::Ordering;
use firmware_protocol::can::CanFrame;

const DONE: &[u8] = b"\r";
const REFUSED: &[u8] = b"\x07";
/// Bit rates of `S0` to `S8` (Lawicel CANUSB manual 1.0D), bit/s.
const BIT_RATES_BPS: [u32; 9] = [10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000];
/// Flags of `F`: error warning, data lost, error passive, bus error.
const WARNING: u32 = 1 << 2;
const LOST: u32 = 1 << 3;
const PASSIVE: u32 = 1 << 5;
const BUS_ERROR: u32 = 1 << 7;
/// Counter from which a controller warns (SJA1000: error warning limit).
const WARNING_LIMIT: u16 = 96;

/// Settings of the client.
pub(in super::super) struct Channel {
    parser: Parser,
    /// Bit rates of the bus: arbitration and data.
    rates_bps: (u32, u32),
    is_silent: bool,
    may_send: bool,
    /// Frames dropped and errors when the flags were last read.
    reported: (u64, u64),
}

impl Channel {
    pub(in super::super) fn new(timing: &BusTiming) -> Self {
        let rates_bps = match timing {
            BusTiming::CanClassic { bit_rate_bps } => (*bit_rate_bps, *bit_rate_bps),
            BusTiming::CanFd { arbitration_bps, data_bps } => (*arbitration_bps, *data_bps),
            BusTiming::Serial { baud: rate } | BusTiming::Datagram { bit_rate_bps: rate } => (*rate, *rate),
        };
        Self { parser: Parser::default(), rates_bps, is_silent: false, may_send: false, reported: (0, 0) }
    }

    /// Returns the answer to a command; `Err` with the reason when it is refused.
    fn obey(&mut self, command: &Command, client: &Client, answer: &mut Vec<u8>) -> Result<(), &'static str> {
        match *command {
            Command::Open => self.open(client, !self.is_silent),
            Command::ListenOnly => self.open(client, false),
            Command::Close => client.listening.close(),
            Command::BitRate(code) => {
                self.refuse_while_open(client)?;
                let rate = BIT_RATES_BPS.get(usize::from(code));
                want(rate == Some(&self.rates_bps.0), "other_bit_rate")?;
            }
            Command::DataBitRate(megabits) => {
                self.refuse_while_open(client)?;
                want(u32::from(megabits) * 1_000_000 == self.rates_bps.1, "other_bit_rate")?;
            }
            Command::Silent(silent) => {
                self.refuse_while_open(client)?;
                self.is_silent = silent;
            }
            Command::TimeStamps(on) => client.listening.stamps.store(on, Ordering::Relaxed),
            Command::Version => answer.extend_from_slice(b"V1013"),
            Command::FirmwareVersion => answer.extend_from_slice(b"v0100"),
            Command::SerialNumber => answer.extend_from_slice(b"NSTAR"),
            Command::Flags => {
                want(client.listening.is_open(), "not_open")?;
                answer.push(b'F');
                put_digits(answer, self.flags(client), 2);
            }
            Command::AcceptanceCode(_) => {}
            Command::AcceptanceMask(mask) => want(mask == u32::MAX, "filter")?,
            Command::Send(frame) => return self.send(&frame, client),
        }
        Ok(())
    }

    fn open(&mut self, client: &Client, may_send: bool) {
        client.open();
        self.may_send = may_send;
        client.listening.open(client.clock.now());
    }

    fn refuse_while_open(&self, client: &Client) -> Result<(), &'static str> {
        want(!client.listening.is_open(), "open")
    }

    fn send(&self, frame: &CanFrame, client: &Client) -> Result<(), &'static str> {
        want(client.listening.is_open(), "not_open")?;
        want(self.may_send, "listen_only")?;
        match client.send(frame) {
            Sending::Queued => Ok(()),
            Sending::Refused(reason) => Err(reason),
        }
    }

    /// Returns the faults since the flags were last read, and the state of the controller.
    fn flags(&mut self, client: &Client) -> u32 {
        let (dropped, errors) = client.losses();
        let counters = client.link.error_counters();
        let warns = counters.transmit.max(counters.receive) >= WARNING_LIMIT;
        let conditions = [
            (warns, WARNING),
            (dropped > self.reported.0, LOST),
            (counters.state() != ErrorState::Active, PASSIVE),
            (errors > self.reported.1, BUS_ERROR),
        ];
        self.reported = (dropped, errors);
        conditions.iter().filter(|(holds, _)| *holds).map(|(_, flag)| flag).sum()
    }
}

fn want(holds: bool, otherwise: &'static str) -> Result<(), &'static str> {
    if holds { Ok(()) } else { Err(otherwise) }
}

impl Dialogue for Channel {
    fn read(&mut self, bytes: &[u8], client: &Client) {
        let mut parser = core::mem::take(&mut self.parser);
        let mut answer = Vec::with_capacity(16);
        parser.push(bytes, &mut |line| {
            if client.is_over() {
                return;
            }
            answer.clear();
            let outcome = match line {
                Ok(command) => {
                    client.count_valid();
                    self.obey(&command, client, &mut answer)
                }
                Err(reject) => {
                    client.count_malformed();
                    Err(reject.name())
                }
            };
            match outcome {
                Ok(()) => {
                    answer.extend_from_slice(DONE);
                    client.answer(&answer);
                }
                Err(reason) => {
                    client.tally.reject(reason);
                    client.answer(REFUSED);
                }
            }
        });
        self.parser = parser;
    }
}

/// Adds the line for a received frame; false when it has none.
pub(in super::super) fn line(packet: &Stamped<Packet>, stamps: bool, out: &mut Vec<u8>) -> bool {
    let Packet::Can(frame) = &packet.value else { return false };
    let code = LENGTHS.iter().position(|length| *length == frame.data().len()).unwrap_or(0);
    // FD frames of this bus switch their bit rate.
    out.push(match (frame.is_fd(), frame.id().is_extended()) {
        (false, false) => b't',
        (false, true) => b'T',
        (true, false) => b'b',
        (true, true) => b'B',
    });
    put_id(out, frame.id());
    put_digits(out, u32::try_from(code).unwrap_or(0), 1);
    put_bytes(out, frame.data());
    if stamps {
        put_digits(out, milliseconds_of_minute(packet.at), 4);
    }
    out.push(b'\r');
    true
}

/// Returns the time stamps of `Z1`: milliseconds, from 0 again each minute.
fn milliseconds_of_minute(at: Tai) -> u32 {
    u32::try_from(at.ns().div_euclid(1_000_000).rem_euclid(60_000)).unwrap_or(0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use firmware_protocol::can::CanId;

    fn shown(frame: Option<CanFrame>, stamps: bool) -> String {
        let mut out = Vec::new();
        let packet = Stamped { at: Tai::from_ns(61_250_999_999), value: Packet::Can(frame.unwrap()) };
        assert!(line(&packet, stamps, &mut out));
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn frames_are_shown_as_the_manual_says() {
        assert_eq!(shown(CanFrame::classic(0x123, &[0x11, 0xAB]), false), "t123211AB\r");
        assert_eq!(shown(CanFrame::classic(0x001, &[]), true), "t001004E2\r", "61.25 s is 1250 ms into a minute");
        assert_eq!(shown(CanFrame::fd(0x7FF, &[0; 12]), false), format!("b7FF9{}\r", "00".repeat(12)));
        assert_eq!(shown(CanFrame::fd(0x301, &[1; 64]), false), format!("b301F{}\r", "01".repeat(64)));
        let [low, high] = [0x123, 0x1ABC_DEF0].map(|number| CanId::extended(number).unwrap());
        assert_eq!(shown(CanFrame::classic(low, &[0x11, 0xAB]), false), "T00000123211AB\r");
        assert_eq!(shown(CanFrame::fd(high, &[0; 12]), true), format!("B1ABCDEF09{}04E2\r", "00".repeat(12)));
    }
}
