//! Bytes of a socketcand client -> commands. Pure: no socket, no clock, no allocation.
//!
//! Source: socketcand's protocol description (`< word arguments >`), raw mode. Limits: an element of [`ELEMENT_MAX`]
//! bytes between its brackets; a longer one is refused once and skipped to its end. The tests beside the code hold
//! every command, both sides of every length, and split input.

use super::super::digits;
use firmware_protocol::can::{CanFrame, CanId};

/// Longest element, without its brackets: twice the longest command.
pub const ELEMENT_MAX: usize = 128;
/// Longest name of a bus, as of a network interface.
pub const NAME_MAX: usize = 15;
/// Words of the protocol that belong to modes that are not served.
const OTHER_MODES: &[&[u8]] = &[
    b"bcmmode",
    b"controlmode",
    b"isotpmode",
    b"add",
    b"update",
    b"delete",
    b"subscribe",
    b"unsubscribe",
    b"filter",
    b"muxfilter",
    b"statistics",
    b"sendpdu",
    b"isotpconf",
];

/// Name of a bus.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct BusName {
    bytes: [u8; NAME_MAX],
    len: usize,
}

impl BusName {
    fn new(name: &[u8]) -> Option<Self> {
        let mut bytes = [0; NAME_MAX];
        bytes.get_mut(..name.len())?.copy_from_slice(name);
        Some(Self { bytes, len: name.len() })
    }

    /// Returns the name.
    pub fn as_bytes(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or(&[])
    }
}

/// A request of a client.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    /// `< open can0 >`
    Open(BusName),
    /// `< rawmode >`: every frame from now on.
    RawMode,
    /// `< echo >`: answer the same.
    Echo,
    /// `< send 123 2 11 22 >`, `< send 00000123 2 11 22 >`
    Send(CanFrame),
}

base::words! {
    /// Why an element is refused.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub enum SocketcandReject {
        /// Longer than any command.
        TooLong = "too_long",
        /// Bytes outside angle brackets.
        Garbage = "garbage",
        /// No command begins so.
        UnknownCommand = "unknown_command",
        /// A command of a mode that is not served: only raw mode is.
        OtherMode = "other_mode",
        /// Fewer or more words than the command asks for.
        BadLength = "bad_length",
        /// A digit that is none.
        BadDigit = "bad_digit",
        /// A value that does not exist: an identifier of too many bits, more than 8 bytes, a name too long.
        BadValue = "bad_value",
    }
}

/// Place of the parser in the stream.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Place {
    Between,
    /// Between elements, among bytes that were refused.
    InGarbage,
    Inside,
    /// Inside an element that is too long.
    Skipping,
}

/// Puts elements together.
#[derive(Debug, Clone)]
pub struct Parser {
    element: [u8; ELEMENT_MAX],
    len: usize,
    place: Place,
}

impl Default for Parser {
    fn default() -> Self {
        Self { element: [0; ELEMENT_MAX], len: 0, place: Place::Between }
    }
}

impl Parser {
    /// Takes bytes in runs of any length, and passes on the command of each element.
    pub fn push(&mut self, bytes: &[u8], each: &mut impl FnMut(Result<Command, SocketcandReject>)) {
        for byte in bytes {
            self.take(*byte, each);
        }
    }

    fn take(&mut self, byte: u8, each: &mut impl FnMut(Result<Command, SocketcandReject>)) {
        match (self.place, byte) {
            // An opening bracket starts a new command, whatever came before: the other end may have been cut off.
            (place, b'<') => {
                if place == Place::Inside {
                    each(Err(SocketcandReject::Garbage));
                }
                self.place = Place::Inside;
                self.len = 0;
            }
            (Place::Inside, b'>') => {
                self.place = Place::Between;
                each(command(self.element.get(..self.len).unwrap_or(&[])));
            }
            (Place::Inside, _) => self.append(byte, each),
            (Place::Skipping, b'>') => self.place = Place::Between,
            (Place::Skipping | Place::InGarbage, _) => {}
            (Place::Between, _) if byte.is_ascii_whitespace() || byte == 0 => {}
            (Place::Between, _) => {
                self.place = Place::InGarbage;
                each(Err(SocketcandReject::Garbage));
            }
        }
    }

    fn append(&mut self, byte: u8, each: &mut impl FnMut(Result<Command, SocketcandReject>)) {
        let Some(place) = self.element.get_mut(self.len) else {
            self.place = Place::Skipping;
            each(Err(SocketcandReject::TooLong));
            return;
        };
        *place = byte;
        self.len += 1;
    }
}

fn command(element: &[u8]) -> Result<Command, SocketcandReject> {
    let mut words = element.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
    let command = match words.next().unwrap_or(&[]) {
        b"open" => {
            let name = words.next().ok_or(SocketcandReject::BadLength)?;
            Command::Open(BusName::new(name).ok_or(SocketcandReject::BadValue)?)
        }
        b"rawmode" => Command::RawMode,
        b"echo" => Command::Echo,
        b"send" => Command::Send(frame(&mut words)?),
        other if OTHER_MODES.contains(&other) => return Err(SocketcandReject::OtherMode),
        _ => return Err(SocketcandReject::UnknownCommand),
    };
    if words.next().is_none() { Ok(command) } else { Err(SocketcandReject::BadLength) }
}

/// Reads identifier, length and one word per byte. An identifier of 8 digits has 29 bits, as the daemon judges it.
fn frame<'a>(words: &mut impl Iterator<Item = &'a [u8]>) -> Result<CanFrame, SocketcandReject> {
    let mut number = || {
        let word = words.next().ok_or(SocketcandReject::BadLength)?;
        digits(word).map(|value| (word.len(), value)).ok_or(SocketcandReject::BadDigit)
    };
    let (id_digits, id) = number()?;
    let id = if id_digits == 8 { CanId::extended(id) } else { u16::try_from(id).ok().and_then(CanId::standard) };
    let id = id.ok_or(SocketcandReject::BadValue)?;
    let (_, length) = number()?;
    let mut data = [0; 8];
    let data = usize::try_from(length).ok().and_then(|length| data.get_mut(..length));
    let data = data.ok_or(SocketcandReject::BadValue)?;
    for byte in data.iter_mut() {
        *byte = u8::try_from(number()?.1).map_err(|_| SocketcandReject::BadValue)?;
    }
    CanFrame::classic(id, data).ok_or(SocketcandReject::BadValue)
}

#[cfg(test)]
#[path = "parser_tests.rs"]
mod tests;
