//! `[link]`: the bus to the flight computer; a table, or the path of a file that holds the same keys.

use crate::config::check::{Checker, Defaulted, Rule};
use crate::config::error::ConfigError;
use core::fmt;
use serde::Deserialize;
use serde::de::value::MapAccessDeserializer;
use serde::de::{Deserializer, MapAccess, Visitor};

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

/// A simulated link, checked.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Link {
    /// What the bytes travel on.
    pub wire: Wire,
    /// Constant delay on top of the time on the wire, us.
    pub latency_us: f64,
    /// Nominal (arbitration) bit rate of CAN, or baud rate, bit/s.
    pub bit_rate: f64,
    /// Bit rate of the data phase, bit/s; equal to `bit_rate` unless the wire is CAN FD.
    pub data_bit_rate: f64,
    /// Messages that may wait in each direction.
    pub queue: u32,
}

#[derive(Debug, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct LinkTable {
    kind: Option<String>,
    wire: Option<String>,
    latency_us: Option<f64>,
    bit_rate: Option<f64>,
    data_bit_rate: Option<f64>,
    queue: Option<i64>,
}

/// `link = "path"` or `[link]`.
#[derive(Debug)]
pub(super) enum LinkKeys {
    File(String),
    Table(LinkTable),
}

impl Default for LinkKeys {
    fn default() -> Self {
        Self::Table(LinkTable::default())
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
        LinkTable::deserialize(MapAccessDeserializer::new(map)).map(LinkKeys::Table)
    }
}

impl Link {
    pub(super) fn check(keys: &LinkKeys, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        match keys {
            LinkKeys::Table(table) => Self::check_table(table, "link.", check),
            LinkKeys::File(path) => {
                let document = check.document.named("link", path)?;
                let mut own_check = Checker::new(&document);
                let link = Self::check_table(&document.read_as()?, "", &mut own_check)?;
                let prefixed =
                    own_check.defaulted.into_iter().map(|d| Defaulted { key: format!("link.{}", d.key), ..d });
                check.defaulted.extend(prefixed);
                Ok(link)
            }
        }
    }

    fn check_table(keys: &LinkTable, prefix: &str, check: &mut Checker<'_>) -> Result<Self, ConfigError> {
        let key = |name: &str| format!("{prefix}{name}");
        check.choice(&key("kind"), keys.kind.as_deref(), &[("simulated", ())], "the bus inside this program")?;
        let wires = [("can_fd", Wire::CanFd), ("can_classic", Wire::CanClassic), ("serial", Wire::Serial)];
        let advice = "all three carry the same messages";
        let wire = check.choice(&key("wire"), keys.wire.as_deref(), &wires, advice)?;
        let latency = "microseconds on top of the time on the wire; 0 for none";
        let latency_us = check.number(&key("latency_us"), keys.latency_us, 0.0, Rule::Within(0.0, 1e7), latency)?;
        let usual = if wire == Wire::Serial { 921_600.0 } else { 500_000.0 };
        let rates = Rule::Within(1_000.0, 1e9);
        let rate = "bits per second: 500000 on CAN, 921600 on a serial line";
        let bit_rate = check.number(&key("bit_rate"), keys.bit_rate, usual, rates, rate)?;
        let data_bit_rate = if wire == Wire::CanFd {
            let rate = "bits per second of the data phase, not below bit_rate: 5000000 is usual";
            let usual = 5_000_000_f64.max(bit_rate);
            check.number(&key("data_bit_rate"), keys.data_bit_rate, usual, Rule::Within(bit_rate, 1e9), rate)?
        } else {
            check.unused(&key("data_bit_rate"), keys.data_bit_rate.is_some(), "wire = \"can_fd\"")?;
            bit_rate
        };
        let depth = "messages that may wait, such as 64";
        let queue = check.whole(&key("queue"), keys.queue, Some(256), 1..=1_000_000, depth)?;
        Ok(Self { wire, latency_us, bit_rate, data_bit_rate, queue })
    }
}
