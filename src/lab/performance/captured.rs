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
//! | `# pdo_map: oresat` | starloop, oresat: which transmit PDOs of the node have the attitude |
//! | `# latency_ms: 120` | from mid-exposure to the packet, for nos3, which has no time tag |
//!
//! Packets that are damaged, and lines without a packet, are rows without frame and time: a report counts them.

use crate::record::LogRow;
use anyhow::{Context, Result, bail};
use base::time::{Span, Tai};
use glam::DQuat;
use telemetry::canopen::dictionary::{MAPS, PdoMap, STARLOOP};
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
    pdo_map: Option<&'a str>,
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
             remarks before the lines say # protocol:, # node:, # pdo_map:"
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
                "pdo_map" => &mut found.pdo_map,
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

    fn pdo_map(&self) -> Result<&'static PdoMap> {
        let Some(name) = self.pdo_map else { return Ok(&STARLOOP) };
        let found = MAPS.into_iter().find(|map| map.name == name);
        found.with_context(|| format!("# pdo_map: got {name}, wanted {}", MAPS.map(|map| map.name).join(" or ")))
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
            Protocol::CanOpen => Some(Box::new(CanOpenReader::new(node, self.pdo_map()?, self.sense()?))),
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
mod tests {
    use super::*;
    use telemetry::canopen::{CanOpenDevice, NodeParams, dictionary::ORESAT};
    use telemetry::{Device, Limits, Mode, Report};
    use telemetry::{ccsds::CcsdsDevice, nos3::Nos3Device, sagitta::SagittaDevice};

    const Q: [f64; 4] = [0.8, 0.6, 0.0, 0.0];
    const LATER: Span = Span::from_ms(120);

    fn tag(second: i64) -> Tai {
        Tai::from_rfc3339("2026-03-01T12:00:00Z").unwrap() + Span::from_ms(1000 * second)
    }

    fn device(name: &str) -> Box<dyn Device> {
        let map = if name == "oresat" { &ORESAT } else { &STARLOOP };
        let node = NodeParams { node: 100, heartbeat_ms: 100, starts_operational: true, map };
        match name {
            "nos3" => Box::new(Nos3Device::new(Limits::default())),
            "sagitta" => Box::new(SagittaDevice::new(Limits::default(), 0.05)),
            "ccsds" => Box::new(CcsdsDevice::new(100, Sense::Conjugate, Limits::default())),
            _canopen => Box::new(CanOpenDevice::new(node, Sense::Conjugate, Limits::default(), 0.05)),
        }
    }

    /// Three seconds of telemetry, the last without an attitude, as a capture of the program or of candump.
    fn capture(name: &str, is_candump: bool) -> String {
        let (mut device, mut text) = (device(name), String::new());
        for second in 0..3 {
            let (mut out, now) = (Vec::new(), tag(second) + LATER);
            let report = Report {
                frame: second as u32,
                time_tag: tag(second),
                attitude_wxyz: (second < 2).then_some(Q),
                rate_rad_s: None,
                sigma_rad: [1e-5; 3],
                stars: 12,
                mode: Mode::Tracking,
                exposure_s: 0.05,
                background_dn: 1.0,
                temperature_c: 1.0,
            };
            if second == 0 {
                device.start(now, &mut out);
            }
            device.report(&report, now, &mut out);
            if device.is_polled() {
                device.take(&Wire::Bytes(vec![0xDE, 0xAD, 2, 0, 0, 0, 0, 0xBE, 0xEF]), now, &mut out, &mut Vec::new());
            }
            for wire in out {
                let bytes: String = wire.data().iter().map(|byte| format!("{byte:02X}")).collect();
                let id = match &wire {
                    Wire::Can(frame) => format!("{:03X}", frame.id()),
                    Wire::Bytes(_) => "-".into(),
                };
                let unix_us = now.to_unix_ns() / 1000;
                text += &if is_candump {
                    format!("({}.{:06}) can0 {id}#{bytes}\n", unix_us / 1_000_000, unix_us % 1_000_000)
                } else {
                    format!("{now} {} {id} {bytes}\n", now.ns())
                };
            }
        }
        text
    }

    fn rows(text: &str) -> Result<Vec<LogRow>> {
        assert!(is_capture(text), "{text}");
        match read("capture.txt", text)? {
            Captured::Rows(rows) => Ok(rows),
            Captured::Json(text) => bail!("JSON: {text}"),
        }
    }

    fn check(name: &str, text: &str) {
        let rows = rows(text).unwrap();
        assert_eq!(rows.len(), 3, "{name}");
        let wanted = DQuat::from_xyzw(Q[1], Q[2], Q[3], Q[0]);
        for (second, row) in (0..3).zip(&rows) {
            assert_eq!(row.at_ns, Some(tag(second).ns()), "{name}");
            assert_eq!(row.available_ns, Some((tag(second) + LATER).ns()), "{name}");
            assert_eq!(row.attitude.is_some(), second < 2, "{name}");
        }
        let got = rows[1].attitude.unwrap();
        assert!(got.dot(wanted).abs() > 1.0 - 1e-8, "{name}: {got}");
        // Control: swapped axes are another attitude.
        assert!(got.dot(DQuat::from_xyzw(Q[2], Q[1], Q[3], Q[0])).abs() < 0.9);
    }

    #[test]
    fn captures_of_every_protocol_are_logs() {
        check("nos3", &format!("# latency_ms: 120\n{}", capture("nos3", false)));
        check("sagitta", &capture("sagitta", false));
        check("ccsds", &format!("# sense: icrf_from_sensor\n{}", capture("ccsds", false)));
        for is_candump in [false, true] {
            let text = format!("# node: 100\n# sense: icrf_from_sensor\n{}", capture("canopen", is_candump));
            check("canopen", &text);
        }
    }

    #[test]
    fn a_capture_of_oresats_map_is_a_log_when_its_remark_says_so() {
        let text = format!("# node: 100\n# sense: icrf_from_sensor\n{}", capture("oresat", true));
        check("oresat", &format!("# pdo_map: oresat\n{text}"));
        assert!(format!("{:#}", rows(&text).unwrap_err()).contains("# pdo_map"), "control");
        let other = format!("{:#}", rows(&format!("# pdo_map: own\n{text}")).unwrap_err());
        assert!(other.contains("got own, wanted starloop or oresat"), "{other}");
    }

    #[test]
    fn frames_with_29_bits_are_passed_over() {
        let text = format!("# node: 100\n# sense: icrf_from_sensor\n{}", capture("canopen", true));
        // Each frame twice: the second has the same number with 29 bits, and no data.
        let longer = |line: &str| line.split_once('#').map(|(head, _)| head.replace(" can0 ", " can0 00000") + "#\n");
        let lines = text
            .lines()
            .map(|line| format!("{line}\n{}", longer(line).filter(|_| line.starts_with('(')).unwrap_or_default()));
        let both: String = lines.collect();
        assert!(both.contains(" can0 000001E4#\n"), "{both}");
        check("canopen", &both);
        // Control: with 11 bits the frames without data are damage.
        assert_ne!(rows(&both.replace(" can0 00000", " can0 ")).unwrap().len(), 3);
    }

    #[test]
    fn the_other_sense_is_another_attitude() {
        let rows = rows(&capture("ccsds", false)).unwrap();
        let got = rows[1].attitude.unwrap();
        assert!(got.dot(DQuat::from_xyzw(-Q[1], 0.0, 0.0, Q[0])).abs() > 1.0 - 1e-9, "{got}");
    }

    #[test]
    fn damaged_packets_are_rows_of_their_own() {
        let text = capture("sagitta", false);
        let last = text.trim_end().rfind(' ').unwrap() + 40;
        let other = if &text[last..=last] == "0" { "1" } else { "0" };
        let damaged = format!("{}{other}{}", &text[..last], &text[last + 1..]);
        let rows = rows(&damaged).unwrap();
        assert_eq!(rows.len(), 3);
        assert_eq!(rows[2], LogRow::default());
    }

    #[test]
    fn a_line_that_is_no_packet_is_a_row_of_its_own() {
        let text = capture("sagitta", false);
        let lines: Vec<&str> = text.lines().collect();
        let damaged = format!("{}\n{}0\n{}\n", lines[0], lines[1], lines[2..].join("\n"));
        let (whole, got) = (rows(&text).unwrap(), rows(&damaged).unwrap());
        assert!(got.contains(&LogRow::default()) && !whole[..2].contains(&LogRow::default()), "half a byte more");
        let all_damaged = text.replace(" - ", " ? ");
        assert!(format!("{:#}", rows(&format!("{}\n{all_damaged}", lines[0])).unwrap_err()).contains("line 2"));
    }

    #[test]
    fn anything_else_is_refused_in_words() {
        let refused = |text: &str| format!("{:#}", rows(text).unwrap_err());
        assert!(refused(&capture("nos3", false)).contains("# latency_ms: 120"));
        assert!(refused(&format!("# latency_ms: x\n{}", capture("nos3", false))).contains("wanted 0 to 60000"));
        assert!(refused(&format!("# latency_ms: 5\n{}", capture("ccsds", false))).contains("have time tags"));
        assert!(refused(&format!("# sense: both\n{}", capture("ccsds", false))).contains("got both"));
        assert!(refused(&format!("# sense: icrf_from_body\n{}", capture("sagitta", false))).contains("# sense"));
        assert!(refused(&format!("# protocol: x\n{}", capture("ccsds", false))).contains("got x"));
        assert!(refused(&format!("# node: 200\n{}", capture("canopen", true))).contains("1 to 127"));
        let other_node = refused(&capture("canopen", true));
        assert!(other_node.contains("no report of a tracker") && other_node.contains("# node"), "{other_node}");
        let unknown = "2026-03-01T12:00:00Z 1772366437000000000 - 5500";
        assert!(refused(unknown).contains("begin with 55"));
        assert!(refused(&format!("{unknown}\nnonsense")).contains("line 2"));
        assert!(!is_capture("frame,q_w\n1,2\n") && !is_capture("# only\n") && !is_capture("(x) can0 1#00"));
    }

    #[test]
    fn stamps_of_candump_are_exact() {
        assert_eq!(unix("1772366400.25").unwrap(), Tai::from_unix_ns(1_772_366_400_250_000_000));
        assert_eq!(unix("1772366400.000000001").unwrap(), Tai::from_unix_ns(1_772_366_400_000_000_001));
        assert_eq!((unix("1.x"), unix("9999999999999999"), unix("1.0123456789")), (None, None, None));
    }
}
