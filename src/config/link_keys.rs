//! The keys of a link as serde reads them.

use core::fmt;
use serde::Deserialize;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserializer, MapAccess, Visitor};

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LinkTable {
    pub(super) kind: Option<String>,
    pub(super) wire: Option<String>,
    pub(super) latency_us: Option<f64>,
    pub(super) bit_rate: Option<f64>,
    pub(super) data_bit_rate: Option<f64>,
    pub(super) queue: Option<i64>,
    pub(super) node: Option<i64>,
    pub(super) id_base: Option<i64>,
    pub(super) pps: Option<String>,
    pub(super) interface: Option<String>,
    pub(super) port: Option<String>,
    pub(super) far_port: Option<String>,
    pub(super) parity: Option<String>,
    pub(super) stop_bits: Option<i64>,
    pub(super) flow_control: Option<String>,
    pub(super) slcan_tcp: Option<Address>,
    pub(super) slcan_pty: Option<String>,
    pub(super) socketcand: Option<Address>,
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
#[derive(Debug)]
pub(super) enum LinkKeys {
    File(String),
    Table(Box<LinkTable>),
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
