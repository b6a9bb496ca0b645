//! The keys of a link as serde reads them.

use crate::declared::{Declared, Presence};
use crate::key::{Inner, section};
use crate::key_type::{Raw, Shape, Whole, Word};
use crate::link::{FlowControl, Parity, Wire};
use crate::plain_link::{Form, SENSES, TIMES};
use core::fmt;
use firmware_protocol::can::IdMap;
use link::plain::{FIELD_NAMES, QuaternionSense, TimeMeaning};
use serde::de::{Deserializer, MapAccess, Visitor};
use serde::{Deserialize, de::value::MapAccessDeserializer};

section! {
    /// A bus to the flight computer.
    LinkTable at "link" {
        /// The bus inside this program, a CAN interface, a serial port; udp and tcp take plain numbers of any
        /// simulator.
        kind: Word<Kind> = "simulated",
            [("simulated", Kind::Simulated), ("socketcan", Kind::SocketCan), ("serial", Kind::Serial),
             ("udp", Kind::Udp), ("tcp", Kind::Tcp)];
        /// Encoding of the bytes: CAN and serial lines carry the same messages, plain carries numbers only.
        wire: Word<Wire> = Computed("\"serial\" on a serial port, \"plain\" over udp and tcp, else \"can_fd\""), WIRES;
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
pub(super) const WIRES: [(&str, Wire); 4] =
    [("can_fd", Wire::CanFd), ("can_classic", Wire::CanClassic), ("serial", Wire::Serial), ("plain", Wire::Plain)];

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
