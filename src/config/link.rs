//! `[link]` and `[[extra_link]]`: buses to the flight computer; a table, or the path of a file that holds the same
//! keys.
//!
//! The keys of a link as serde reads them.
//!
//! `[session]`: how the conversation with the flight computer is kept.

use crate::check::{Checker, Defaulted, Rule};
use crate::declared::{Declared, Presence};
use crate::file_kind::{FileKind, must_be};
use crate::key::{Given, Inner, Section, section, taken};
use crate::key_type::{Raw, Shape, Whole, Word};
use crate::plain_link::{Form, Plain, SENSES, TIMES};
use crate::{error::Result, flight_computer::FlightComputer, plain_link, several::check_partly};
use base::time::Span;
use core::{fmt, net::SocketAddr};
use firmware_protocol::can::{CanId, IdMap};
use link::WireFormat;
use link::gateway::{GatewayParams, TcpAddress};
use link::plain::{FIELD_NAMES, QuaternionSense, TimeMeaning};
use link::serial::{FlowControl, Parity, SerialParams, StopBits};
use serde::de::{Deserializer, MapAccess, Visitor};
use serde::{Deserialize, de::value::MapAccessDeserializer};
use std::path::PathBuf;

/// Interface, port or socket below the wire.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Carrier {
    /// A bus inside this program, and the gateways through which other programs reach it.
    Simulated(GatewayParams),
    /// A CAN interface of the system.
    SocketCan {
        /// Its name, such as `can0`.
        interface: String,
    },
    /// A serial port of the system.
    SerialPort {
        /// Its settings.
        port: SerialParams,
        /// Device of the other end of the cable, for a flight computer that is simulated inside the program.
        far_port: Option<PathBuf>,
    },
    /// Datagrams over UDP.
    Udp {
        /// Where they are received.
        listen: SocketAddr,
    },
    /// Records or lines over TCP.
    Tcp {
        /// Where it listens, or what it connects to.
        address: SocketAddr,
        /// Whether it connects.
        connects: bool,
    },
}

/// A link, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Interface, port or socket below the wire.
    pub carrier: Carrier,
    /// Encoding and line of the bytes.
    pub wire: WireFormat,
    /// Constant delay on top of the time on the wire, us; of a real link: as calibrated.
    pub latency_us: f64,
    /// Nominal (arbitration) bit rate of CAN, or baud rate, bit/s. An interface of the system has its own: here it is
    /// for estimates.
    pub bit_rate: f64,
    /// Bit rate of the data phase, bit/s; equal to `bit_rate` unless the wire is CAN FD.
    pub data_bit_rate: f64,
    /// Messages that may wait in each direction.
    pub queue: u32,
    /// CAN identifiers of the node of flight computer and star sensor.
    pub ids: IdMap,
    /// Folder of a pulse-per-second source in sysfs; its pulses mark the flight computer's whole seconds.
    pub pps: Option<PathBuf>,
    /// Content of plain messages; `None`: the wire carries the protocol.
    pub plain: Option<Plain>,
}

impl Link {
    /// Returns true for a bus inside this program that no other program can reach.
    pub fn has_no_gateway(&self) -> bool {
        matches!(&self.carrier, Carrier::Simulated(gateway_ports) if *gateway_ports == GatewayParams::default())
    }

    /// Returns true for a simulated CAN bus.
    pub fn is_simulated_can(&self) -> bool {
        matches!(self.carrier, Carrier::Simulated(_)) && matches!(self.wire, WireFormat::CanFd | WireFormat::CanClassic)
    }

    pub(super) fn check(keys: &LinkKeys, check: &mut Checker<'_>) -> Result<Self> {
        Self::check_named(keys, "link", check)
    }

    /// Links beside the first one.
    pub(super) fn check_extra(keys: &[LinkKeys], check: &mut Checker<'_>) -> Result<Vec<Self>> {
        let link = |(i, keys): (usize, &LinkKeys)| Self::check_named(keys, &format!("extra_link[{i}]"), check);
        keys.iter().enumerate().map(link).collect()
    }

    fn check_named(keys: &LinkKeys, name: &str, check: &mut Checker<'_>) -> Result<Self> {
        match keys {
            LinkKeys::Table(table) => Self::check_table(&table.at(name), check),
            LinkKeys::File(path) => {
                let document = check.document.named(name, path)?;
                must_be(FileKind::Link, &document)?;
                let checked = check_partly(&document, |document| {
                    let mut own_check = Checker::new(document);
                    let link = Self::check_table(&document.read_as::<LinkTable>()?.at(""), &mut own_check)?;
                    Ok(((link, own_check.defaulted), own_check.named_errors))
                })?;
                let (link, defaulted) = check.take(checked);
                let prefixed = defaulted.into_iter().map(|d| Defaulted { key: format!("{name}.{}", d.key), ..d });
                check.defaulted.extend(prefixed);
                Ok(link)
            }
        }
    }

    fn check_table(keys: &LinkTable, check: &mut Checker<'_>) -> Result<Self> {
        let kind = keys.kind().check(check)?;
        let wires = match kind {
            Kind::Simulated => &WIRES[..],
            Kind::SocketCan => &WIRES[..2],
            Kind::Serial => &WIRES[2..3],
            Kind::Udp | Kind::Tcp => &WIRES[3..],
        };
        let wire = keys.wire().or(wires[0].0).within(wires).check(check)?;
        let latency_us = keys.latency_us().check(check)?;
        if matches!(kind, Kind::Udp | Kind::Tcp) {
            keys.refuse(&["bit_rate"], "a bus, which has one", check)?;
        }
        let bit_rate = match wire {
            WireFormat::Plain => keys.bit_rate().or_silently(100e6).check(check)?,
            WireFormat::Serial => keys.bit_rate().or(921_600.0).check(check)?,
            WireFormat::CanFd | WireFormat::CanClassic => keys.bit_rate().or(500_000.0).check(check)?,
        };
        if kind == Kind::Serial && bit_rate.fract() != 0.0 {
            let rate = keys.bit_rate().advised("such as 921600");
            return Err(rate.invalid(bit_rate, "a whole number of baud", check));
        }
        let data_bit_rate = if wire == WireFormat::CanFd {
            let rate = keys.data_bit_rate().or(5_000_000_f64.max(bit_rate));
            rate.within(Rule::Within(bit_rate, 1e9)).check(check)?
        } else {
            keys.refuse(&["data_bit_rate"], "wire = \"can_fd\"", check)?;
            bit_rate
        };
        if kind != Kind::Simulated {
            keys.refuse(&["queue"], "kind = \"simulated\"", check)?;
        }
        let queue = keys.queue().check(check)?;
        let carrier = carrier(keys, kind, bit_rate, check)?;
        let plain = plain_link::plain(keys, kind, wire, check)?;
        let ids = identifiers(keys, wire, check)?;
        if !matches!(kind, Kind::SocketCan | Kind::Serial) {
            keys.refuse(&["pps"], "kind = \"socketcan\" or \"serial\"", check)?;
        }
        let pps = keys.pps().raw().map(PathBuf::from);
        Ok(Self { carrier, wire, latency_us, bit_rate, data_bit_rate, queue, ids, pps, plain })
    }
}

fn carrier(keys: &LinkTable, kind: Kind, bit_rate: f64, check: &mut Checker<'_>) -> Result<Carrier> {
    for (owner, names, of) in [
        ("kind = \"socketcan\"", &["interface"][..], Kind::SocketCan),
        ("kind = \"serial\"", &["port", "far_port", "parity", "stop_bits", "flow_control"], Kind::Serial),
        ("kind = \"simulated\"", &["slcan_tcp", "slcan_pty", "socketcand"], Kind::Simulated),
    ] {
        if kind != of {
            keys.refuse(names, owner, check)?;
        }
    }
    if let Some(carrier) = plain_link::carrier(keys, kind, check)? {
        return Ok(carrier);
    }
    keys.refuse(&["listen", "connect"], "kind = \"udp\" or \"tcp\"", check)?;
    Ok(match kind {
        Kind::Simulated | Kind::Udp | Kind::Tcp => Carrier::Simulated(GatewayParams {
            slcan_tcp: address(&keys.slcan_tcp(), check)?,
            slcan_pty: keys.slcan_pty().raw().map(PathBuf::from),
            socketcand: address(&keys.socketcand(), check)?,
            ..GatewayParams::default()
        }),
        Kind::SocketCan => Carrier::SocketCan { interface: named(&keys.interface(), "such as \"can0\"", check)? },
        Kind::Serial => {
            let path = named(&keys.port(), "such as \"/dev/ttyUSB0\"", check)?.into();
            let parity = keys.parity().check(check)?;
            let stop_bits = if keys.stop_bits().check(check)? == 2 { StopBits::Two } else { StopBits::One };
            let flow = keys.flow_control().check(check)?;
            #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "bit rates are checked")]
            let port = SerialParams { path, baud: bit_rate as u32, parity, stop_bits, flow };
            Carrier::SerialPort { port, far_port: keys.far_port().raw().map(PathBuf::from) }
        }
    })
}

/// Returns a text that must be given.
fn named(given: &Given<'_, String>, wanted: &str, check: &Checker<'_>) -> Result<String> {
    match given.raw().map(|text| text.trim()) {
        None => Err(given.missing(wanted, check)),
        Some("") => Err(given.invalid("empty", wanted, check)),
        Some(text) => Ok(text.into()),
    }
}

/// Returns an address that must be given.
pub(super) fn named_address(given: &Given<'_, Raw<Address>>, check: &Checker<'_>) -> Result<SocketAddr> {
    address(given, check)?.ok_or_else(|| given.missing("a port (on loopback) or \"address:port\"", check))
}

/// Reads `PORT`, on loopback, or `ADDRESS:PORT`.
pub(super) fn address(given: &Given<'_, Raw<Address>>, check: &Checker<'_>) -> Result<Option<SocketAddr>> {
    let Some(text) = given.raw().map(ToString::to_string) else { return Ok(None) };
    let wanted = "a port (on loopback) or \"address:port\"";
    let address = text.parse::<TcpAddress>();
    address.map(|address| Some(address.socket())).map_err(|_| given.invalid(format!("\"{text}\""), wanted, check))
}

fn identifiers(keys: &LinkTable, wire: WireFormat, check: &mut Checker<'_>) -> Result<IdMap> {
    if matches!(wire, WireFormat::Serial | WireFormat::Plain) {
        keys.refuse(&["node", "id_bits", "id_base"], "a CAN wire", check)?;
        return Ok(IdMap::default());
    }
    taken!(check, keys => node, id_bits);
    let (most, advice) = match id_bits {
        11 => (IdMap::BASE_MAX, "identifiers have 11 bits; id_bits = 29 takes up to 0x1FFFF8F0"),
        29 => (IdMap::EXTENDED_BASE_MAX, "such as 0x18FF0000"),
        _ => return Err(keys.id_bits().invalid(id_bits, "11 or 29", check)),
    };
    let id_base = keys.id_base().within(0..=i64::from(most)).advised(advice).check(check)?;
    let base = if id_bits == 29 { CanId::extended(id_base) } else { CanId::from_flagged(id_base) };
    base.and_then(|base| IdMap::of(base, node)).ok_or_else(|| {
        let given = keys.id_base().advised("such as 0 or 128 (0x80)");
        given.invalid(id_base, "a multiple of 16", check)
    })
}

section! {
    /// A bus to the flight computer.
    LinkTable at "link" {
        /// The bus inside this program, a CAN interface, a serial port; udp and tcp take plain numbers of any
        /// simulator.
        kind: Word<Kind> = "simulated",
            [("simulated", Kind::Simulated), ("socketcan", Kind::SocketCan), ("serial", Kind::Serial),
             ("udp", Kind::Udp), ("tcp", Kind::Tcp)];
        /// Encoding of the bytes: CAN and serial lines carry the same messages, plain carries numbers only.
        wire: Word<WireFormat> =
            Computed("\"serial\" on a serial port, \"plain\" over udp and tcp, else \"can_fd\""), WIRES;
        /// Microseconds on top of the time on the wire; 0 for none.
        latency_us: f64 = 0.0, Within(0.0, 1e7);
        /// Bits per second: 500000 on CAN, 921600 on a serial line.
        bit_rate: f64 = Computed("500000 on CAN, 921600 on a serial line, 1e8 on a plain wire"), Within(1_000.0, 1e9);
        /// Bits per second of the data phase of CAN FD, not below bit_rate: 5000000 is usual.
        data_bit_rate: f64 = Computed("5000000, or bit_rate when that is higher"), Within(1_000.0, 1e9);
        /// Messages that may wait in each direction of a simulated bus, such as 64.
        queue: Whole = 256, 1..=1_000_000;
        /// Node of flight computer and star sensor, the same number at both ends.
        node: Whole<u8> = 0, 0..=15;
        /// Bits of CAN identifiers: 11, or 29 of extended frames, the same at both ends.
        id_bits: Whole<u8> = 11, 11..=29;
        /// Added to every CAN identifier, a multiple of 16; at most 240 (0xF0) with 11 bits.
        id_base: Whole<u32> = 0, 0..=i64::from(IdMap::EXTENDED_BASE_MAX);
        /// Folder of a pulse-per-second source in sysfs, whose pulses mark the flight computer's whole seconds.
        pps: String = Optional, "path";
        /// The name of a CAN interface: `ip -br link` lists them.
        interface: String = Optional, "name such as \"can0\"";
        /// A device file of a serial port, best one of /dev/serial/by-id, which keeps its name.
        port: String = Optional, "path such as \"/dev/ttyUSB0\"";
        /// Device of the other end of the cable, for a flight computer that is simulated inside the program.
        far_port: String = Optional, "path";
        /// Parity bit of a serial line: the other end's setting.
        parity: Word<Parity> = "none", [("none", Parity::None), ("even", Parity::Even), ("odd", Parity::Odd)];
        /// Stop bits of a serial line: the other end's setting.
        stop_bits: Whole<u8> = 1, 1..=2;
        /// Flow control of a serial line: none, unless RTS and CTS are wired.
        flow_control: Word<FlowControl> = "none", [("none", FlowControl::None), ("hardware", FlowControl::Hardware)];
        /// Gateway for slcan over TCP: a port on loopback such as 29536, or "address:port"; 0 takes a free one.
        slcan_tcp: Raw<Address> = Optional, port_or_address();
        /// Gateway for slcan over a pseudo terminal: the path of a link to it.
        slcan_pty: String = Optional, "path";
        /// Gateway for socketcand over TCP: a port on loopback such as 29536, or "address:port"; 0 takes a free one.
        socketcand: Raw<Address> = Optional, port_or_address();
        /// Where a plain link receives: a port on loopback such as 29700, or "address:port"; 0 takes a free one.
        listen: Raw<Address> = Optional, port_or_address();
        /// The server that a plain TCP link connects to: a port on loopback such as 10001, or "address:port".
        connect: Raw<Address> = Optional, port_or_address();
        /// Form of plain numbers: packed doubles, JSON, text, or the lines that the simulator 42 writes.
        encoding: Word<Form> = "f64_le", [
            ("f64_le", Form::F64Le), ("f64_be", Form::F64Be), ("json", Form::Json), ("text", Form::Text),
            ("42", Form::FortyTwo),
        ];
        /// The numbers of a plain message in their order: t time, q quaternion, w rate, a acceleration, j jitter
        /// (arcsec), r and v position and velocity of the observer (km, km/s), seq, skip. Without the key: t q_w q_x
        /// q_y q_z w_x w_y w_z.
        layout: Raw<Vec<String>> = Optional,
            Shape::list(Shape::Words(FIELD_NAMES.iter().map(|(name, _)| *name).collect()));
        /// Sense of a plain quaternion; of a body turned by +a about x, x is -sin(a/2) in starloop's, +sin(a/2) in its
        /// conjugate.
        quaternion: Word<QuaternionSense> = "starloop", SENSES;
        /// Unit of plain rates; accelerations have it per second.
        rate_unit: Word<f64> = "rad_s", [("rad_s", 1.0), ("deg_s", core::f64::consts::PI / 180.0)];
        /// Unit of plain times.
        time_unit: Word<f64> = "s", [("s", 1e9), ("ms", 1e6), ("us", 1e3), ("ns", 1.0)];
        /// Time of a plain message: tag is a clock of any epoch, whose offset and drift are estimated (0: the arrival),
        /// arrival is when it came.
        time: Word<TimeMeaning> = "tag", TIMES;
        /// Number of the spacecraft in the lines of 42.
        spacecraft_number: Whole<u16> = 0, 0..=9999;
        /// Seconds of silence after which another sender of datagrams may take the place of the first.
        sender_timeout_s: f64 = 2.0, Within(0.0, 3600.0);
    }
}

/// Values of `kind`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Simulated,
    SocketCan,
    Serial,
    Udp,
    Tcp,
}

/// Every wire by its word, those of CAN first.
pub(super) const WIRES: [(&str, WireFormat); 4] = [
    ("can_fd", WireFormat::CanFd),
    ("can_classic", WireFormat::CanClassic),
    ("serial", WireFormat::Serial),
    ("plain", WireFormat::Plain),
];

pub(super) fn port_or_address() -> Shape {
    Shape::either(Shape::Whole(0..=65_535), Shape::Text("address:port"))
}

/// A port, or address and port.
#[derive(Debug, Clone, Deserialize)]
#[serde(untagged)]
pub(super) enum Address {
    Port(i64),
    Text(String),
}

impl fmt::Display for Address {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Port(port) => port.fmt(f),
            Self::Text(text) => write!(f, "{}", text.trim()),
        }
    }
}

/// `link = "path"` or `[link]`.
#[derive(Debug, Clone)]
pub(super) enum LinkKeys {
    File(String),
    Table(Box<LinkTable>),
}

impl Inner for LinkKeys {
    const PRESENCE: Presence = Presence::OrFile;
    fn forms() -> Vec<Declared> {
        LinkTable::forms()
    }
}

impl Default for LinkKeys {
    fn default() -> Self {
        Self::Table(Box::default())
    }
}

impl<'de> Deserialize<'de> for LinkKeys {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_any(PathOrTable)
    }
}

/// By hand, because an untagged enum would lose the line of what is wrong inside the table.
struct PathOrTable;

impl<'de> Visitor<'de> for PathOrTable {
    type Value = LinkKeys;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a [link] table or the path of a link file")
    }

    fn visit_str<E: serde::de::Error>(self, path: &str) -> Result<LinkKeys, E> {
        Ok(LinkKeys::File(path.into()))
    }

    fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<LinkKeys, A::Error> {
        LinkTable::deserialize(MapAccessDeserializer::new(map)).map(|table| LinkKeys::Table(Box::new(table)))
    }
}

/// When frames begin to show stars.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SessionStart {
    /// With the first attitude. A STOP, or a HELLO of another major version, ends it until the next RUN.
    AtOnce,
    /// With an accepted RUN of the flight computer.
    OnRun,
}

/// The session, checked.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SessionParams {
    /// When frames begin to show stars.
    pub start: SessionStart,
    /// Timeout after which a flight computer that has sent heartbeats counts as silent.
    pub heartbeat_timeout: Span,
}

section! {
    /// How the conversation with the flight computer is kept.
    SessionKeys at "session" {
        /// At_once shows stars with the first attitude, on_run waits for HELLO and RUN.
        start: Word<SessionStart> = "at_once",
            [("at_once", SessionStart::AtOnce), ("on_run", SessionStart::OnRun)];
        /// Heartbeats that stop for so many seconds are an event; they come once a second.
        heartbeat_timeout_s: f64 = 3.5, Within(0.1, 3600.0);
    }
}

impl Default for SessionParams {
    /// Returns the default: start at once, and time out after three missed heartbeats.
    fn default() -> Self {
        Self { start: SessionStart::AtOnce, heartbeat_timeout: Span::from_ms(3500) }
    }
}

impl SessionParams {
    pub(super) fn check(keys: &SessionKeys, check: &mut Checker<'_>) -> Result<Self> {
        taken!(check, keys => start, heartbeat_timeout_s);
        Ok(Self { start, heartbeat_timeout: Span::from_s(heartbeat_timeout_s) })
    }

    /// Refuses to wait for RUN in lockstep: all frames would stay dark.
    pub(super) fn check_has_run(&self, link: &Link, computer: &FlightComputer, check: &Checker<'_>) -> Result<()> {
        if self.start == SessionStart::OnRun && computer.is_external && link.has_no_gateway() {
            let advice = "no bus leads out of the program, so no flight computer can send RUN: frames show stars with the first attitude";
            return Err(check.invalid("session.start", "\"on_run\"", "\"at_once\" with a plant in lockstep", advice));
        }
        Ok(())
    }
}

#[cfg(test)]
#[path = "link_tests.rs"]
mod tests;
