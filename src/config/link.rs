//! `[link]` and `[[extra_link]]`: buses to the flight computer; a table, or the path of a file that holds the same
//! keys.

use crate::check::{Checker, Defaulted, Rule};
use crate::file_kind::{FileKind, must_be};
use crate::key::{Given, Section, taken};
use crate::link_keys::{Address, Kind, LinkKeys, LinkTable, WIRES};
use crate::plain_link::{self, Plain};
use crate::{error::ConfigError, key_type::Raw, several::check_partly};
use core::net::SocketAddr;
use firmware_protocol::can::{CanId, IdMap};
use link::gateway::TcpAddress;
use std::path::PathBuf;

/// Encoding and line of the bytes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wire {
    /// CAN with flexible data rate.
    CanFd,
    /// Classic CAN, 8 bytes.
    CanClassic,
    /// Framed bytes on a serial line.
    Serial,
    /// Plain numbers of an outside simulator.
    Plain,
}

/// Interface, port or socket below the wire.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Carrier {
    /// A bus inside this program, and the gateways through which other programs reach it.
    Simulated(GatewayPorts),
    /// A CAN interface of the system.
    SocketCan {
        /// Its name, such as `can0`.
        interface: String,
    },
    /// A serial port of the system.
    SerialPort(SerialPort),
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

/// Gateways of a simulated bus.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct GatewayPorts {
    /// slcan over TCP.
    pub slcan_tcp: Option<SocketAddr>,
    /// slcan over a pseudo terminal: the path of a link to it.
    pub slcan_pty: Option<PathBuf>,
    /// socketcand over TCP.
    pub socketcand: Option<SocketAddr>,
}

/// Settings of a serial port; its baud rate is the link's bit rate.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SerialPort {
    /// Device, such as `/dev/ttyUSB0`.
    pub port: PathBuf,
    /// Device of the other end of the cable, for a flight computer that is simulated inside the program.
    pub far_port: Option<PathBuf>,
    /// Parity bit.
    pub parity: Parity,
    /// Stop bits, 1 or 2.
    pub stop_bits: u8,
    /// Flow control.
    pub flow_control: FlowControl,
}

/// Parity of a serial line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Parity {
    /// None.
    None,
    /// Even.
    Even,
    /// Odd.
    Odd,
}

/// Flow control of a serial line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FlowControl {
    /// None.
    None,
    /// RTS and CTS.
    Hardware,
}

/// A link, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Link {
    /// Interface, port or socket below the wire.
    pub carrier: Carrier,
    /// Encoding and line of the bytes.
    pub wire: Wire,
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
        matches!(&self.carrier, Carrier::Simulated(gateway_ports) if *gateway_ports == GatewayPorts::default())
    }

    /// Returns true for a simulated CAN bus.
    pub fn is_simulated_can(&self) -> bool {
        matches!(self.carrier, Carrier::Simulated(_)) && matches!(self.wire, Wire::CanFd | Wire::CanClassic)
    }

    pub(super) fn check(keys: &LinkKeys, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        Self::check_named(keys, "link", check)
    }

    /// Links beside the first one.
    pub(super) fn check_extra(keys: &[LinkKeys], check: &mut Checker<'_>) -> Result<Vec<Self>, ConfigError> {
        let link = |(i, keys): (usize, &LinkKeys)| Self::check_named(keys, &format!("extra_link[{i}]"), check);
        keys.iter().enumerate().map(link).collect()
    }

    fn check_named(keys: &LinkKeys, name: &str, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
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

    fn check_table(keys: &LinkTable, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
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
            Wire::Plain => keys.bit_rate().or_silently(100e6).check(check)?,
            Wire::Serial => keys.bit_rate().or(921_600.0).check(check)?,
            Wire::CanFd | Wire::CanClassic => keys.bit_rate().or(500_000.0).check(check)?,
        };
        if kind == Kind::Serial && bit_rate.fract() != 0.0 {
            let rate = keys.bit_rate().advised("such as 921600");
            return Err(rate.invalid(bit_rate, "a whole number of baud", check));
        }
        let data_bit_rate = if wire == Wire::CanFd {
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
        let carrier = carrier(keys, kind, check)?;
        let plain = plain_link::plain(keys, kind, wire, check)?;
        let ids = identifiers(keys, wire, check)?;
        if !matches!(kind, Kind::SocketCan | Kind::Serial) {
            keys.refuse(&["pps"], "kind = \"socketcan\" or \"serial\"", check)?;
        }
        let pps = keys.pps().raw().map(PathBuf::from);
        Ok(Self { carrier, wire, latency_us, bit_rate, data_bit_rate, queue, ids, pps, plain })
    }
}

fn carrier(keys: &LinkTable, kind: Kind, check: &mut Checker<'_>) -> Result<Carrier, ConfigError> {
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
        Kind::Simulated | Kind::Udp | Kind::Tcp => Carrier::Simulated(GatewayPorts {
            slcan_tcp: address(&keys.slcan_tcp(), check)?,
            slcan_pty: keys.slcan_pty().raw().map(PathBuf::from),
            socketcand: address(&keys.socketcand(), check)?,
        }),
        Kind::SocketCan => Carrier::SocketCan { interface: named(&keys.interface(), "such as \"can0\"", check)? },
        Kind::Serial => Carrier::SerialPort(SerialPort {
            port: named(&keys.port(), "such as \"/dev/ttyUSB0\"", check)?.into(),
            parity: keys.parity().check(check)?,
            stop_bits: keys.stop_bits().check(check)?,
            flow_control: keys.flow_control().check(check)?,
            far_port: keys.far_port().raw().map(PathBuf::from),
        }),
    })
}

/// Returns a text that must be given.
fn named(given: &Given<'_, String>, wanted: &str, check: &Checker<'_>) -> Result<String, ConfigError> {
    match given.raw().map(|text| text.trim()) {
        None => Err(given.missing(wanted, check)),
        Some("") => Err(given.invalid("empty", wanted, check)),
        Some(text) => Ok(text.into()),
    }
}

/// Returns an address that must be given.
pub(super) fn named_address(given: &Given<'_, Raw<Address>>, check: &Checker<'_>) -> Result<SocketAddr, ConfigError> {
    address(given, check)?.ok_or_else(|| given.missing("a port (on loopback) or \"address:port\"", check))
}

/// Reads `PORT`, on loopback, or `ADDRESS:PORT`.
pub(super) fn address(given: &Given<'_, Raw<Address>>, check: &Checker<'_>) -> Result<Option<SocketAddr>, ConfigError> {
    let Some(text) = given.raw().map(ToString::to_string) else { return Ok(None) };
    let wanted = "a port (on loopback) or \"address:port\"";
    let address = text.parse::<TcpAddress>();
    address.map(|address| Some(address.socket())).map_err(|_| given.invalid(format!("\"{text}\""), wanted, check))
}

fn identifiers(keys: &LinkTable, wire: Wire, check: &mut Checker<'_>) -> Result<IdMap, ConfigError> {
    if matches!(wire, Wire::Serial | Wire::Plain) {
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

#[cfg(test)]
#[path = "link_tests.rs"]
mod tests;
