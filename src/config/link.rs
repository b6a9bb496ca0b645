//! `[link]` and `[[extra_link]]`: buses to the flight computer; a table, or the path of a file that holds the same keys.

use crate::check::{Checker, Defaulted, Rule};
use crate::error::ConfigError;
use crate::link_keys::{Address, LinkKeys, LinkTable};
use core::net::SocketAddr;
use link::gateway::TcpAddress;
use std::path::PathBuf;

/// What the bytes travel on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Wire {
    /// CAN with flexible data rate.
    CanFd,
    /// Classic CAN, 8 bytes.
    CanClassic,
    /// Framed bytes on a serial line.
    Serial,
}

/// What carries the wire.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Carrier {
    /// A bus inside this program, and the doors that other programs may come in by.
    Simulated(Doors),
    /// A CAN interface of the system.
    SocketCan {
        /// Its name, such as `can0`.
        interface: String,
    },
    /// A serial port of the system.
    SerialPort(SerialPort),
}

/// Gateways of a simulated bus.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Doors {
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
    /// What carries it.
    pub carrier: Carrier,
    /// What the bytes travel on.
    pub wire: Wire,
    /// Constant delay on top of the time on the wire, us; of a real link: as calibrated.
    pub latency_us: f64,
    /// Nominal (arbitration) bit rate of CAN, or baud rate, bit/s. An interface of the system has its own: here it is for
    /// estimates.
    pub bit_rate: f64,
    /// Bit rate of the data phase, bit/s; equal to `bit_rate` unless the wire is CAN FD.
    pub data_bit_rate: f64,
    /// Messages that may wait in each direction.
    pub queue: u32,
    /// Node of flight computer and star sensor, 0 to 15.
    pub node: u8,
    /// Added to every CAN identifier, a multiple of 16 up to 0x0F0.
    pub id_base: u16,
    /// Folder of a pulse-per-second source in sysfs; its pulses mark the flight computer's whole seconds.
    pub pps: Option<PathBuf>,
}

/// What `kind` says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Simulated,
    SocketCan,
    Serial,
}

impl Link {
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
            LinkKeys::Table(table) => Self::check_table(table, &format!("{name}."), check),
            LinkKeys::File(path) => {
                let document = check.document.named(name, path)?;
                let mut own_check = Checker::new(&document);
                let link = Self::check_table(&document.read_as()?, "", &mut own_check)?;
                let prefixed =
                    own_check.defaulted.into_iter().map(|d| Defaulted { key: format!("{name}.{}", d.key), ..d });
                check.defaulted.extend(prefixed);
                Ok(link)
            }
        }
    }

    fn check_table(keys: &LinkTable, prefix: &str, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        let key = |name: &str| format!("{prefix}{name}");
        let kinds = [("simulated", Kind::Simulated), ("socketcan", Kind::SocketCan), ("serial", Kind::Serial)];
        let advice = "the bus inside this program, a CAN interface, a serial port";
        let kind = check.choice(&key("kind"), keys.kind.as_deref(), &kinds, advice)?;
        let wire = wire(keys, kind, prefix, check)?;
        let latency = "microseconds on top of the time on the wire; 0 for none";
        let latency_us = check.number(&key("latency_us"), keys.latency_us, 0.0, Rule::Within(0.0, 1e7), latency)?;
        let usual = if wire == Wire::Serial { 921_600.0 } else { 500_000.0 };
        let rates = Rule::Within(1_000.0, 1e9);
        let rate = "bits per second: 500000 on CAN, 921600 on a serial line";
        let bit_rate = check.number(&key("bit_rate"), keys.bit_rate, usual, rates, rate)?;
        if kind == Kind::Serial && bit_rate.fract() != 0.0 {
            return Err(check.invalid(&key("bit_rate"), bit_rate, "a whole number of baud", "such as 921600"));
        }
        let data_bit_rate = if wire == Wire::CanFd {
            let rate = "bits per second of the data phase, not below bit_rate: 5000000 is usual";
            let usual = 5_000_000_f64.max(bit_rate);
            check.number(&key("data_bit_rate"), keys.data_bit_rate, usual, Rule::Within(bit_rate, 1e9), rate)?
        } else {
            check.unused(&key("data_bit_rate"), keys.data_bit_rate.is_some(), "wire = \"can_fd\"")?;
            bit_rate
        };
        let depth = "messages that may wait, such as 64";
        check.unused(&key("queue"), keys.queue.is_some() && kind != Kind::Simulated, "kind = \"simulated\"")?;
        let queue = check.whole(&key("queue"), keys.queue, Some(256), 1..=1_000_000, depth)?;
        let carrier = carrier(keys, kind, prefix, check)?;
        let (node, id_base) = identifiers(keys, wire, prefix, check)?;
        let pps = keys.pps.as_ref().map(PathBuf::from);
        check.unused(&key("pps"), pps.is_some() && kind == Kind::Simulated, "kind = \"socketcan\" or \"serial\"")?;
        Ok(Self { carrier, wire, latency_us, bit_rate, data_bit_rate, queue, node, id_base, pps })
    }
}

fn wire(keys: &LinkTable, kind: Kind, prefix: &str, check: &mut Checker<'_>) -> Result<Wire, ConfigError> {
    let all = [("can_fd", Wire::CanFd), ("can_classic", Wire::CanClassic), ("serial", Wire::Serial)];
    let wires = match kind {
        Kind::Simulated => &all[..],
        Kind::SocketCan => &all[..2],
        Kind::Serial => &all[2..],
    };
    check.choice(&format!("{prefix}wire"), keys.wire.as_deref(), wires, "all three carry the same messages")
}

fn carrier(keys: &LinkTable, kind: Kind, prefix: &str, check: &mut Checker<'_>) -> Result<Carrier, ConfigError> {
    let key = |name: &str| format!("{prefix}{name}");
    let is_serial = kind == Kind::Serial;
    for (name, is_given, belongs_to, is_here) in [
        ("interface", keys.interface.is_some(), "kind = \"socketcan\"", kind == Kind::SocketCan),
        ("port", keys.port.is_some(), "kind = \"serial\"", is_serial),
        ("far_port", keys.far_port.is_some(), "kind = \"serial\"", is_serial),
        ("parity", keys.parity.is_some(), "kind = \"serial\"", is_serial),
        ("stop_bits", keys.stop_bits.is_some(), "kind = \"serial\"", is_serial),
        ("flow_control", keys.flow_control.is_some(), "kind = \"serial\"", is_serial),
        ("slcan_tcp", keys.slcan_tcp.is_some(), "kind = \"simulated\"", kind == Kind::Simulated),
        ("slcan_pty", keys.slcan_pty.is_some(), "kind = \"simulated\"", kind == Kind::Simulated),
        ("socketcand", keys.socketcand.is_some(), "kind = \"simulated\"", kind == Kind::Simulated),
    ] {
        check.unused(&key(name), is_given && !is_here, belongs_to)?;
    }
    Ok(match kind {
        Kind::Simulated => Carrier::Simulated(Doors {
            slcan_tcp: address(&key("slcan_tcp"), keys.slcan_tcp.as_ref(), check)?,
            slcan_pty: keys.slcan_pty.as_ref().map(PathBuf::from),
            socketcand: address(&key("socketcand"), keys.socketcand.as_ref(), check)?,
        }),
        Kind::SocketCan => {
            let advice = "the name of a CAN interface: `ip -br link` lists them";
            let interface = named(&key("interface"), keys.interface.as_deref(), "such as \"can0\"", advice, check)?;
            Carrier::SocketCan { interface }
        }
        Kind::Serial => Carrier::SerialPort(serial_port(keys, prefix, check)?),
    })
}

fn serial_port(keys: &LinkTable, prefix: &str, check: &mut Checker<'_>) -> Result<SerialPort, ConfigError> {
    let key = |name: &str| format!("{prefix}{name}");
    let advice = "a device file, best one of /dev/serial/by-id, which keeps its name";
    let port = named(&key("port"), keys.port.as_deref(), "such as \"/dev/ttyUSB0\"", advice, check)?.into();
    let parities = [("none", Parity::None), ("even", Parity::Even), ("odd", Parity::Odd)];
    let parity = check.choice(&key("parity"), keys.parity.as_deref(), &parities, "the other end's setting")?;
    let stop_bits = check.whole(&key("stop_bits"), keys.stop_bits, Some(1), 1..=2, "the other end's setting")?;
    let controls = [("none", FlowControl::None), ("hardware", FlowControl::Hardware)];
    let advice = "none, unless RTS and CTS are wired";
    let flow_control = check.choice(&key("flow_control"), keys.flow_control.as_deref(), &controls, advice)?;
    let far_port = keys.far_port.as_ref().map(PathBuf::from);
    Ok(SerialPort { port, far_port, parity, stop_bits: if stop_bits == 2 { 2 } else { 1 }, flow_control })
}

/// A text that must be given.
fn named(
    key: &str,
    given: Option<&str>,
    wanted: &str,
    advice: &str,
    check: &Checker<'_>,
) -> Result<String, ConfigError> {
    let text = given.unwrap_or_default().trim();
    if text.is_empty() {
        let got = if given.is_some() { "empty" } else { "missing" };
        return Err(check.invalid(key, got, wanted, advice));
    }
    Ok(text.into())
}

/// `PORT`, on loopback, or `ADDRESS:PORT`.
fn address(key: &str, given: Option<&Address>, check: &Checker<'_>) -> Result<Option<SocketAddr>, ConfigError> {
    let Some(text) = given.map(ToString::to_string) else { return Ok(None) };
    let wanted = "a port (on loopback) or \"address:port\"";
    let advice = "such as 29536; 0 takes a free one";
    let address = text.parse::<TcpAddress>();
    address.map(|address| Some(address.socket())).map_err(|_| check.invalid(key, format!("\"{text}\""), wanted, advice))
}

fn identifiers(keys: &LinkTable, wire: Wire, prefix: &str, check: &mut Checker<'_>) -> Result<(u8, u16), ConfigError> {
    let key = |name: &str| format!("{prefix}{name}");
    if wire == Wire::Serial {
        check.unused(&key("node"), keys.node.is_some(), "a CAN wire")?;
        check.unused(&key("id_base"), keys.id_base.is_some(), "a CAN wire")?;
        return Ok((0, 0));
    }
    let advice = "the same number at both ends";
    let node = check.whole(&key("node"), keys.node, Some(0), 0..=15, advice)?;
    let id_base = check.whole(&key("id_base"), keys.id_base, Some(0), 0..=0xF0, "a multiple of 16")?;
    if id_base % 16 != 0 {
        return Err(check.invalid(&key("id_base"), id_base, "a multiple of 16", "such as 0 or 128 (0x80)"));
    }
    let whole = |value: u32| u16::try_from(value).unwrap_or_default();
    Ok((u8::try_from(node).unwrap_or_default(), whole(id_base)))
}

#[cfg(test)]
#[path = "link_tests.rs"]
mod tests;
