//! The keys of a link as serde reads them.

use crate::declared::{Declared, Inner, Presence};
use crate::key::section;
use crate::key_type::{Raw, Shape, Whole, Word};
use crate::link::{FlowControl, Parity, Wire};
use core::fmt;
use serde::Deserialize;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserializer, MapAccess, Visitor};

section! {
    /// A bus to the flight computer.
    LinkTable at "link" {
        /// The bus inside this program, a CAN interface, a serial port.
        kind: Word<Kind> = "simulated",
            [("simulated", Kind::Simulated), ("socketcan", Kind::SocketCan), ("serial", Kind::Serial)];
        /// What the bytes travel on; all three carry the same messages.
        wire: Word<Wire> = Computed("\"serial\" on a serial port, else \"can_fd\""), WIRES;
        /// Microseconds on top of the time on the wire; 0 for none.
        latency_us: f64 = 0.0, Within(0.0, 1e7);
        /// Bits per second: 500000 on CAN, 921600 on a serial line.
        bit_rate: f64 = Computed("500000 on CAN, 921600 on a serial line"), Within(1_000.0, 1e9);
        /// Bits per second of the data phase of CAN FD, not below bit_rate: 5000000 is usual.
        data_bit_rate: f64 = Computed("5000000, or bit_rate when that is higher"), Within(1_000.0, 1e9);
        /// Messages that may wait in each direction of a simulated bus, such as 64.
        queue: Whole = 256, 1..=1_000_000;
        /// Node of flight computer and star sensor, the same number at both ends.
        node: Whole<u8> = 0, 0..=15;
        /// Added to every CAN identifier, a multiple of 16.
        id_base: Whole<u16> = 0, 0..=0xF0;
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
        /// Door for slcan over TCP: a port on loopback such as 29536, or "address:port"; 0 takes a free one.
        slcan_tcp: Raw<Address> = Optional, port_or_address();
        /// Door for slcan over a pseudo terminal: the path of a link to it.
        slcan_pty: String = Optional, "path";
        /// Door for socketcand over TCP: a port on loopback such as 29536, or "address:port"; 0 takes a free one.
        socketcand: Raw<Address> = Optional, port_or_address();
    }
}

/// What `kind` says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Simulated,
    SocketCan,
    Serial,
}

/// Every wire by its word, those of CAN first.
pub(super) const WIRES: [(&str, Wire); 3] =
    [("can_fd", Wire::CanFd), ("can_classic", Wire::CanClassic), ("serial", Wire::Serial)];

fn port_or_address() -> Shape {
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
