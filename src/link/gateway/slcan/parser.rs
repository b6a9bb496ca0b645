//! Bytes of an slcan client -> commands. Pure: no socket, no clock, no allocation.
//!
//! Source: Lawicel CANUSB manual 1.0D (commands ended by a carriage return), with the CAN FD letters `d D b B` and the
//! codes `Y M` of the CANable 2.0 firmware. Limits: a line of [`LINE_MAX`] bytes; a longer one is refused once and
//! skipped to its end. The tests beside the code hold every letter, both sides of every length, and split input.

use super::super::{digit, digits};
use firmware_protocol::can::{CanFrame, CanId};

/// Longest line: an extended FD frame of 64 bytes.
pub const LINE_MAX: usize = 1 + 8 + 1 + 128;
/// Payload lengths by length code.
pub(super) const LENGTHS: [usize; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];

/// A request of a client.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Command {
    /// `O`: take part in the bus.
    Open,
    /// `L`: listen, and send nothing.
    ListenOnly,
    /// `C`: leave the bus.
    Close,
    /// `S0` to `S8`: bit rate by code.
    BitRate(u8),
    /// `Y0` to `Y8`: bit rate of the data phase, Mbit/s.
    DataBitRate(u8),
    /// `V`: version of the adapter.
    Version,
    /// `v`: version of its firmware.
    FirmwareVersion,
    /// `N`: serial number.
    SerialNumber,
    /// `F`: status flags.
    Flags,
    /// `Mxxxxxxxx`: acceptance code.
    AcceptanceCode(u32),
    /// `mxxxxxxxx`: acceptance mask; a set bit is not compared.
    AcceptanceMask(u32),
    /// `M0`, `M1`: normal or silent, from the next `O`.
    Silent(bool),
    /// `Z0`, `Z1`: time stamps on received frames.
    TimeStamps(bool),
    /// `t`, `d`, `b`: a frame to send; `T`, `D`, `B`: the same with an identifier of 29 bits.
    Send(CanFrame),
}

base::words! {
    /// Why a line is refused.
    #[derive(Debug, Clone, Copy, PartialEq, Eq)]
    pub enum SlcanReject {
        /// Longer than any command.
        TooLong = "too_long",
        /// No command begins so, or it is not served.
        UnknownCommand = "unknown_command",
        /// Shorter or longer than the command asks for.
        BadLength = "bad_length",
        /// A digit that is none.
        BadDigit = "bad_digit",
        /// A value that does not exist: an identifier of too many bits, a length code above 8 of a classic frame.
        BadValue = "bad_value",
        /// A remote request; this bus has none.
        RemoteRequest = "remote_request",
    }
}

/// Puts lines together.
#[derive(Debug, Clone)]
pub struct Parser {
    line: [u8; LINE_MAX],
    len: usize,
    skips: bool,
}

impl Default for Parser {
    fn default() -> Self {
        Self { line: [0; LINE_MAX], len: 0, skips: false }
    }
}

impl Parser {
    /// Takes bytes in runs of any length, and passes on the command of each line.
    pub fn push(&mut self, bytes: &[u8], each: &mut impl FnMut(Result<Command, SlcanReject>)) {
        for byte in bytes {
            match byte {
                b'\r' => self.end_line(each),
                // Terminals send it after a carriage return.
                b'\n' if self.len == 0 => {}
                _ if self.skips => {}
                _ => self.append(*byte, each),
            }
        }
    }

    fn append(&mut self, byte: u8, each: &mut impl FnMut(Result<Command, SlcanReject>)) {
        let Some(place) = self.line.get_mut(self.len) else {
            self.skips = true;
            each(Err(SlcanReject::TooLong));
            return;
        };
        *place = byte;
        self.len += 1;
    }

    /// Ends a line; an empty one is ignored: clients send some to find the end of a broken one.
    fn end_line(&mut self, each: &mut impl FnMut(Result<Command, SlcanReject>)) {
        let line = self.line.get(..self.len).unwrap_or(&[]);
        if !self.skips
            && let Some((letter, rest)) = line.split_first()
        {
            each(command(*letter, rest));
        }
        self.len = 0;
        self.skips = false;
    }
}

fn command(letter: u8, rest: &[u8]) -> Result<Command, SlcanReject> {
    match letter {
        b'O' => alone(rest, Command::Open),
        b'L' => alone(rest, Command::ListenOnly),
        b'C' => alone(rest, Command::Close),
        b'V' => alone(rest, Command::Version),
        b'v' => alone(rest, Command::FirmwareVersion),
        b'N' => alone(rest, Command::SerialNumber),
        b'F' => alone(rest, Command::Flags),
        b'S' => code(rest).map(Command::BitRate),
        b'Y' => code(rest).map(Command::DataBitRate),
        b'Z' => switch(rest).map(Command::TimeStamps),
        b'M' if rest.len() == 1 => switch(rest).map(Command::Silent),
        b'M' => word(rest).map(Command::AcceptanceCode),
        b'm' => word(rest).map(Command::AcceptanceMask),
        b't' => frame(rest, standard_id, 3, false).map(Command::Send),
        b'T' => frame(rest, CanId::extended, 8, false).map(Command::Send),
        b'd' | b'b' => frame(rest, standard_id, 3, true).map(Command::Send),
        b'D' | b'B' => frame(rest, CanId::extended, 8, true).map(Command::Send),
        b'r' | b'R' => Err(SlcanReject::RemoteRequest),
        _ => Err(SlcanReject::UnknownCommand),
    }
}

fn alone(rest: &[u8], command: Command) -> Result<Command, SlcanReject> {
    if rest.is_empty() { Ok(command) } else { Err(SlcanReject::BadLength) }
}

/// Returns one digit, 0 to 8.
fn code(rest: &[u8]) -> Result<u8, SlcanReject> {
    let [code] = rest else { return Err(SlcanReject::BadLength) };
    let value = digit(*code).ok_or(SlcanReject::BadDigit)?;
    if value <= 8 { Ok(value) } else { Err(SlcanReject::BadValue) }
}

fn switch(rest: &[u8]) -> Result<bool, SlcanReject> {
    match code(rest)? {
        0 => Ok(false),
        1 => Ok(true),
        _ => Err(SlcanReject::BadValue),
    }
}

fn word(rest: &[u8]) -> Result<u32, SlcanReject> {
    if rest.len() != 8 {
        return Err(SlcanReject::BadLength);
    }
    digits(rest).ok_or(SlcanReject::BadDigit)
}

fn standard_id(number: u32) -> Option<CanId> {
    u16::try_from(number).ok().and_then(CanId::standard)
}

/// Reads the digits of an identifier, one of length, two per byte.
fn frame(
    rest: &[u8],
    id_of: impl Fn(u32) -> Option<CanId>,
    id_digits: usize,
    is_fd: bool,
) -> Result<CanFrame, SlcanReject> {
    let (head, data) = rest.split_at_checked(id_digits + 1).ok_or(SlcanReject::BadLength)?;
    let (id, length) = head.split_at(id_digits);
    let id = digits(id).ok_or(SlcanReject::BadDigit)?;
    let length = digits(length).ok_or(SlcanReject::BadDigit)?;
    let length = LENGTHS.get(length as usize).copied().unwrap_or(0);
    if !is_fd && length > 8 {
        return Err(SlcanReject::BadValue);
    }
    if data.len() != 2 * length {
        return Err(SlcanReject::BadLength);
    }
    let mut bytes = [0; 64];
    for (byte, pair) in bytes.iter_mut().zip(data.chunks_exact(2)) {
        *byte = digits(pair).and_then(|value| u8::try_from(value).ok()).ok_or(SlcanReject::BadDigit)?;
    }
    let id = id_of(id).ok_or(SlcanReject::BadValue)?;
    let data = bytes.get(..length).unwrap_or(&[]);
    let frame = if is_fd { CanFrame::fd(id, data) } else { CanFrame::classic(id, data) };
    frame.ok_or(SlcanReject::BadValue)
}

#[cfg(test)]
#[path = "parser_tests.rs"]
mod tests;
