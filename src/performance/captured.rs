//! A capture of a bus -> rows of a tracker's log: JSON, NOS3, Sagitta, CANopen, CCSDS.
//!
//! Lines are those of `[[tracker_out]]` with `link = "file"`: UTC, TAI ns, CAN identifier or `-`, bytes in hexadecimal;
//! or those of `candump -l`: `(1772366400.250000) can0 1E4#0401150080F85A02`. An attitude was there when its last packet
//! was on the line. Remarks before the lines say what a capture does not:
//!
//! | remark | meaning |
//! |---|---|
//! | `# protocol: nos3` | json, nos3, sagitta, canopen, ccsds; without it the first packet decides |
//! | `# sense: icrf_from_sensor` | quaternions of canopen and ccsds are the conjugate of this program's |
//! | `# node: 96` | the CANopen node |
//! | `# latency_ms: 120` | from mid-exposure to the packet, for nos3, which has no time tag |
//!
//! Packets that are damaged, and lines without a packet, are rows without frame and time: a report counts them.

use crate::record::LogRow;
use anyhow::{Context, Result, bail};
use base::time::{Span, Tai};
use glam::DQuat;
use telemetry::reading::{Measured, Reader};
use telemetry::{Sense, Wire, canopen::CanOpenReader, ccsds::CcsdsReader, nos3::Nos3Reader, sagitta::SagittaReader};

/// The CANopen node that a bench has without another number.
const USUAL_NODE: u8 = 96;

/// A line of a capture.
#[derive(Debug, Clone, PartialEq)]
struct Packet {
    at: Tai,
    id: Option<u32>,
    bytes: Vec<u8>,
}

/// Protocols that are read here.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Protocol {
    Json,
    Nos3,
    Sagitta,
    CanOpen,
    Ccsds,
}

/// Contents of the remarks before the lines.
#[derive(Debug, Default)]
struct Remarks<'a> {
    protocol: Option<&'a str>,
    sense: Option<&'a str>,
    node: Option<&'a str>,
    latency_ms: Option<&'a str>,
}

/// Returns whether a text is a capture: its first line besides remarks has the form of one.
pub(crate) fn is_capture(text: &str) -> bool {
    lines(text).next().is_some_and(|(_, line)| packet(line).is_some())
}

/// Lines that are neither empty nor remarks, with their numbers.
fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let numbered = text.lines().enumerate().map(|(number, line)| (number + 1, line.trim()));
    numbered.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

fn packet(line: &str) -> Option<Packet> {
    let words: Vec<&str> = line.split_whitespace().collect();
    match words.as_slice() {
        [utc, tai_ns, id, bytes] => {
            Tai::from_rfc3339(utc).ok()?;
            let id = if *id == "-" { None } else { Some(identifier(id)?) };
            Some(Packet { at: Tai::from_ns(tai_ns.parse().ok()?), id, bytes: hexadecimal(bytes)? })
        }
        [stamp, _interface, frame] => {
            let (id, bytes) = frame.split_once('#')?;
            let at = unix(stamp.strip_prefix('(')?.strip_suffix(')')?)?;
            // CAN FD and remote frames, which these protocols do not use, have another mark there.
            let bytes = hexadecimal(bytes).unwrap_or_default();
            Some(Packet { at, id: Some(identifier(id)?), bytes })
        }
        _another => None,
    }
}

/// Reads an identifier; one of 8 digits has 29 bits, which bit 31 says: none of these protocols has such.
fn identifier(text: &str) -> Option<u32> {
    let number = u32::from_str_radix(text, 16).ok()?;
    Some(if text.len() == 8 { number | 1 << 31 } else { number })
}

fn hexadecimal(text: &str) -> Option<Vec<u8>> {
    if !text.is_ascii() || !text.len().is_multiple_of(2) {
        return None;
    }
    (0..text.len()).step_by(2).map(|place| u8::from_str_radix(text.get(place..place + 2)?, 16).ok()).collect()
}

/// Reads Unix seconds with up to nine decimals, without rounding.
fn unix(text: &str) -> Option<Tai> {
    let (seconds, fraction) = text.split_once('.').unwrap_or((text, ""));
    if fraction.len() > 9 || !fraction.bytes().all(|digit| digit.is_ascii_digit()) {
        return None;
    }
    let nanoseconds: i64 = format!("{fraction:0<9}").parse().ok()?;
    Some(Tai::from_unix_ns(seconds.parse::<i64>().ok()?.checked_mul(1_000_000_000)?.checked_add(nanoseconds)?))
}

/// Contents of a capture.
pub(crate) enum Captured {
    /// Rows of a log.
    Rows(Vec<LogRow>),
    /// Lines of JSON, which are a log themselves.
    Json(String),
}

/// Reads a capture.
///
/// # Errors
/// With the line, what was got and what was wanted.
pub(crate) fn read(name: &str, text: &str) -> Result<Captured> {
    let remarks = Remarks::of(text).with_context(|| name.to_owned())?;
    let mut packets = Vec::new();
    let mut damaged_lines = Vec::new();
    for (number, line) in lines(text) {
        match packet(line) {
            Some(packet) => packets.push(packet),
            None => damaged_lines.push(number),
        }
    }
    if let Some(first) = damaged_lines.first().filter(|_| damaged_lines.len() >= packets.len()) {
        bail!(
            "{name}, line {first}: wanted UTC, TAI ns, identifier or -, and bytes in hexadecimal, or a line of candump -l; \
             {} lines of {} are damaged",
            damaged_lines.len(),
            damaged_lines.len() + packets.len()
        );
    }
    let protocol = remarks.protocol(&packets).with_context(|| name.to_owned())?;
    let Some(mut reader) = remarks.reader(protocol).with_context(|| name.to_owned())? else {
        return json(&packets).map(Captured::Json).with_context(|| name.to_owned());
    };
    let mut measured = Vec::new();
    for packet in &packets {
        let wire = match packet.id {
            Some(id) => u16::try_from(id).ok().and_then(|id| Wire::can(id, &packet.bytes)),
            None => Some(Wire::Bytes(packet.bytes.clone())),
        };
        wire.iter().for_each(|wire| reader.take(wire, packet.at, &mut measured));
    }
    if measured.is_empty() {
        let (count, damaged) = (packets.len(), reader.damaged());
        bail!(
            "{name}: got {count} lines and no report of a tracker in them, {damaged} damaged; wanted telemetry of {protocol:?}; \
             remarks before the lines say # protocol:, # node:"
        );
    }
    let latency = remarks.latency(protocol).with_context(|| name.to_owned())?;
    let rows = measured.iter().map(|measured| row(measured, latency));
    let damaged = (0..reader.damaged() + damaged_lines.len() as u64).map(|_| LogRow::default());
    Ok(Captured::Rows(rows.chain(damaged).collect()))
}

fn row(measured: &Measured, latency: Span) -> LogRow {
    LogRow {
        frame: measured.frame,
        at_ns: Some(measured.time_tag.unwrap_or(measured.at - latency).ns()),
        attitude: measured.attitude_wxyz.map(|[w, x, y, z]| DQuat::from_xyzw(x, y, z, w).normalize()),
        available_ns: Some(measured.at.ns()),
        stars: measured.stars.map(u32::from),
    }
}

/// Puts lines of JSON together.
fn json(packets: &[Packet]) -> Result<String> {
    let mut bytes = Vec::new();
    for packet in packets {
        bytes.extend(&packet.bytes);
        if bytes.last() != Some(&b'\n') {
            bytes.push(b'\n');
        }
    }
    String::from_utf8(bytes).context("packets that are not text")
}

impl<'a> Remarks<'a> {
    fn of(text: &'a str) -> Result<Self> {
        let mut found = Self::default();
        for line in text.lines().map(str::trim).take_while(|line| line.is_empty() || line.starts_with('#')) {
            let Some((key, value)) = line.trim_start_matches(['#', ' ']).split_once(':') else { continue };
            let place = match key.trim() {
                "protocol" => &mut found.protocol,
                "sense" => &mut found.sense,
                "node" => &mut found.node,
                "latency_ms" => &mut found.latency_ms,
                _a_remark => continue,
            };
            *place = Some(value.trim());
        }
        Ok(found)
    }

    fn protocol(&self, packets: &[Packet]) -> Result<Protocol> {
        let first = packets.iter().find(|packet| !packet.bytes.is_empty());
        Ok(match (self.protocol, first.map(|packet| (packet.id, packet.bytes[0]))) {
            (Some("json"), _) | (None, Some((None, b'{'))) => Protocol::Json,
            (Some("nos3"), _) | (None, Some((None, 0xDE))) => Protocol::Nos3,
            (Some("sagitta"), _) | (None, Some((None, 0xC0))) => Protocol::Sagitta,
            (Some("canopen"), _) | (None, Some((Some(_), _))) => Protocol::CanOpen,
            (Some("ccsds"), _) | (None, Some((None, 0x08..=0x0F))) => Protocol::Ccsds,
            (Some(other), _) => bail!("# protocol: got {other}, wanted json, nos3, sagitta, canopen or ccsds"),
            (None, Some((None, byte))) => bail!(
                "got packets that begin with {byte:02X}; wanted a remark before them, such as # protocol: ccsds (json, \
                 nos3, sagitta, canopen)"
            ),
            (None, None) => bail!("got no bytes; wanted packets"),
        })
    }

    fn sense(&self) -> Result<Sense> {
        match self.sense {
            None | Some("sensor_from_icrf" | "body_from_icrf") => Ok(Sense::Starloop),
            Some("icrf_from_sensor" | "icrf_from_body") => Ok(Sense::Conjugate),
            Some(other) => bail!("# sense: got {other}, wanted sensor_from_icrf or icrf_from_sensor"),
        }
    }

    /// The reader of a protocol; JSON has none.
    fn reader(&self, protocol: Protocol) -> Result<Option<Box<dyn Reader>>> {
        if self.sense.is_some() && matches!(protocol, Protocol::Nos3 | Protocol::Sagitta | Protocol::Json) {
            bail!("# sense: got one of {protocol:?}, whose packets say it; wanted one of canopen or ccsds");
        }
        let node = match self.node.map(str::parse) {
            None => USUAL_NODE,
            Some(Ok(node @ 1..=127)) => node,
            Some(_) => bail!("# node: got {}, wanted 1 to 127", self.node.unwrap_or_default()),
        };
        Ok(match protocol {
            Protocol::Json => None,
            Protocol::Nos3 => Some(Box::<Nos3Reader>::default()),
            Protocol::Sagitta => Some(Box::<SagittaReader>::default()),
            Protocol::CanOpen => Some(Box::new(CanOpenReader::new(node, self.sense()?))),
            Protocol::Ccsds => Some(Box::new(CcsdsReader::new(self.sense()?))),
        })
    }

    /// From mid-exposure to a packet without a time tag.
    fn latency(&self, protocol: Protocol) -> Result<Span> {
        match (self.latency_ms.map(str::parse::<f64>), protocol) {
            (Some(Ok(ms)), Protocol::Nos3) if (0.0..=60_000.0).contains(&ms) => Ok(Span::from_s(ms * 1e-3)),
            (Some(_), Protocol::Nos3) => {
                bail!("# latency_ms: got {}, wanted 0 to 60000", self.latency_ms.unwrap_or_default())
            }
            (None, Protocol::Nos3) => bail!(
                "its packets have no time tag; wanted a remark before them, such as # latency_ms: 120, from mid-exposure to the packet"
            ),
            (Some(_), _) => bail!("# latency_ms: got one of {protocol:?}, whose packets have time tags; leave it out"),
            (None, _) => Ok(Span::ZERO),
        }
    }
}

#[cfg(test)]
#[path = "captured_tests.rs"]
mod tests;
