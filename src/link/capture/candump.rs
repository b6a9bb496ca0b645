//! One line of a candump log: `(sec.fraction) interface id#data`, FD `id##flags data`, with an optional ` R` or ` T`.
//!
//! Written: nine digits of fraction, interface `can0`, `can1`, ..., direction always. Read: one to nine digits of
//! fraction, any interface (its number is that at the end of its name, 0 without one). The identifier has 3 hexadecimal
//! digits for 11 bits, 8 for 29. Input: bytes without the line's end. Tests: `tests`.

use super::{CapturedPacket, Direction};
use crate::Packet;
use base::{time::Tai, units::NS_PER_S};
use firmware_protocol::can::{CanFrame, CanId};
use std::io::Write;

/// Longest FD payload.
const DATA_MAX: usize = 64;

/// Contents of a line.
#[derive(Debug, Clone, Copy, PartialEq)]
#[allow(clippy::large_enum_variant, reason = "one at a time, on the stack: a packet is its bytes")]
pub enum Line {
    /// A frame.
    Packet(CapturedPacket),
    /// A frame that has no form here: remote frame, error frame.
    Skipped,
    /// An empty line.
    Blank,
}

/// Writes a frame's line.
pub(super) fn write_line(
    out: &mut impl Write,
    captured: &CapturedPacket,
    frame: &CanFrame,
) -> Result<(), std::io::Error> {
    let (unix_ns, interface) = (captured.at.to_unix_ns().max(0), captured.interface);
    write!(out, "({}.{:09}) can{interface} {:X}#", unix_ns / NS_PER_S, unix_ns % NS_PER_S, frame.id())?;
    if frame.is_fd() {
        // Flags: bit rate switching, as the data phase of the simulated bus has it.
        out.write_all(b"#1")?;
    }
    for byte in frame.data() {
        write!(out, "{byte:02X}")?;
    }
    out.write_all(if captured.direction == Direction::Sent { b" T\n" } else { b" R\n" })
}

/// Reads a line.
///
/// # Errors
/// Fault of the line.
pub fn parse_line(line: &[u8]) -> Result<Line, &'static str> {
    let mut words = line.split(u8::is_ascii_whitespace).filter(|word| !word.is_empty());
    let Some(stamp) = words.next() else { return Ok(Line::Blank) };
    let unix_ns = stamp_ns(stamp)?;
    let interface = interface_number(words.next().ok_or("the interface is missing")?);
    let frame = frame(words.next().ok_or("the frame is missing")?)?;
    let direction = match words.next() {
        None | Some(b"R") => Direction::Received,
        Some(b"T") => Direction::Sent,
        Some(_) => return Err("only R or T may follow the frame"),
    };
    if words.next().is_some() {
        return Err("something follows the direction");
    }
    let at = Tai::from_unix_ns(unix_ns);
    let captured = |frame| CapturedPacket { at, direction, interface, packet: Packet::Can(frame) };
    Ok(frame.map_or(Line::Skipped, |frame| Line::Packet(captured(frame))))
}

/// Returns the number at the end of an interface's name; 0 without one, the last number for all beyond it.
fn interface_number(name: &[u8]) -> u8 {
    let digits = name.iter().rev().take_while(|byte| byte.is_ascii_digit()).count();
    let number = name[name.len() - digits..].iter();
    number.fold(0, |number: u8, digit| number.saturating_mul(10).saturating_add(digit - b'0'))
}

/// Reads `(sec.fraction)`, ns.
fn stamp_ns(word: &[u8]) -> Result<i64, &'static str> {
    const WRONG: &str = "no stamp (seconds.fraction) at its start";
    let inside = word.strip_prefix(b"(").and_then(|word| word.strip_suffix(b")")).ok_or(WRONG)?;
    let point = inside.iter().position(|byte| *byte == b'.').ok_or(WRONG)?;
    let (seconds, fraction) = (&inside[..point], &inside[point + 1..]);
    if fraction.is_empty() || fraction.len() > 9 {
        return Err("the stamp's fraction has not one to nine digits");
    }
    let digits = u32::try_from(fraction.len()).map_err(|_| WRONG)?;
    let fraction_ns = decimal(fraction).ok_or(WRONG)? * 10_i64.pow(9 - digits);
    let seconds = decimal(seconds).ok_or(WRONG)?;
    seconds.checked_mul(NS_PER_S).and_then(|ns| ns.checked_add(fraction_ns)).ok_or("the stamp is beyond the year 2262")
}

fn decimal(digits: &[u8]) -> Option<i64> {
    let is_number = !digits.is_empty() && digits.iter().all(u8::is_ascii_digit);
    is_number.then(|| core::str::from_utf8(digits).ok()?.parse().ok()).flatten()
}

/// Returns the frame; `None` for one that has no form here.
fn frame(word: &[u8]) -> Result<Option<CanFrame>, &'static str> {
    let hash = word.iter().position(|byte| *byte == b'#').ok_or("no # between identifier and data")?;
    let (id, rest) = (&word[..hash], &word[hash + 1..]);
    let is_extended = match id.len() {
        3 => false,
        8 => true,
        _ => return Err("the identifier has neither 3 nor 8 digits"),
    };
    let id = id.iter().try_fold(0_u32, |id, digit| Some((id << 4) | u32::from(hex(*digit)?)));
    let id = id.ok_or("the identifier is not hexadecimal")?;
    if rest.first() == Some(&b'R') {
        return Ok(None);
    }
    let (is_fd, data) = match rest {
        [b'#', flags, data @ ..] => {
            hex(*flags).ok_or("the FD flags are not hexadecimal")?;
            (true, data)
        }
        [b'#'] => return Err("the FD flags are missing"),
        data => (false, data),
    };
    // A length code above 8 is written behind the data of a classic frame; the data are 8 bytes all the same.
    let data = data.iter().position(|byte| *byte == b'_').map_or(data, |end| &data[..end]);
    let mut bytes = [0; DATA_MAX];
    let length = hex_bytes(data, &mut bytes)?;
    let id = if is_extended {
        // More than 29 bits are the flags of an error frame.
        let Some(id) = CanId::extended(id) else { return Ok(None) };
        id
    } else {
        CanId::from_flagged(id).ok_or("the identifier has more than 11 bits")?
    };
    let data = &bytes[..length];
    let frame = if is_fd { CanFrame::fd(id, data) } else { CanFrame::classic(id, data) };
    // A length that no CAN frame has, as gateways write of damaged ones, is left out and counted.
    Ok(frame)
}

fn hex_bytes(digits: &[u8], bytes: &mut [u8; DATA_MAX]) -> Result<usize, &'static str> {
    if !digits.len().is_multiple_of(2) || digits.len() > 2 * DATA_MAX {
        return Err("the data are not whole bytes, 64 at most");
    }
    for (byte, pair) in bytes.iter_mut().zip(digits.chunks_exact(2)) {
        let digit = |digit| hex(digit).ok_or("the data are not hexadecimal");
        *byte = (digit(pair[0])? << 4) | digit(pair[1])?;
    }
    Ok(digits.len() / 2)
}

fn hex(digit: u8) -> Option<u8> {
    char::from(digit).to_digit(16).and_then(|value| u8::try_from(value).ok())
}
