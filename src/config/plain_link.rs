//! Plain links of `[link]`: which numbers an outside simulator sends, in which form and units, and by whose clock.
//!
//! `kind = "udp"` and `"tcp"`, and `wire = "plain"` on a simulated bus. Tests: `plain_link_tests`.

use crate::error::{ConfigError, Result, nearest};
use crate::flight_computer::{FlightComputer, JitterSource};
use crate::link::{Carrier, Kind, Link, LinkTable, SessionParams, SessionStart, address, named_address};
use crate::{check::Checker, key::Section};
use base::time::Span;
use link::WireFormat;
use link::plain::{Encoding, FIELD_NAMES, LayoutError, PlainLayout, QuaternionSense, TimeMeaning};

/// Keys that only plain links have.
const KEYS: [&str; 8] =
    ["encoding", "layout", "quaternion", "rate_unit", "time_unit", "time", "spacecraft_number", "sender_timeout_s"];

/// A plain link, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Plain {
    /// Which numbers, in which order, form and units.
    pub layout: PlainLayout,
    /// Silence after which another sender may take the place of the first.
    pub sender_timeout: Span,
}

impl Link {
    /// Returns true for the lines of the simulator 42.
    pub fn is_of_42(&self) -> bool {
        self.plain.as_ref().is_some_and(|plain| matches!(plain.layout.encoding, Encoding::FortyTwo(_)))
    }
}

/// Values of `encoding`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    F64Le,
    F64Be,
    Json,
    Text,
    FortyTwo,
}

/// Reads the keys of a plain link; `None` for a link of the protocol, which has none of them.
pub(super) fn plain(keys: &LinkTable, kind: Kind, wire: WireFormat, check: &mut Checker<'_>) -> Result<Option<Plain>> {
    if wire != WireFormat::Plain {
        keys.refuse(&KEYS, "kind = \"udp\" or \"tcp\", or wire = \"plain\"", check)?;
        return Ok(None);
    }
    if kind != Kind::Udp {
        keys.refuse(&["sender_timeout_s"], "kind = \"udp\"", check)?;
    }
    let form = keys.encoding().check(check)?;
    if form == Form::FortyTwo && kind != Kind::Tcp {
        let encoding = keys.encoding().advised("42 writes its lines to a TCP socket");
        return Err(encoding.invalid("\"42\"", "another encoding beside this kind", check));
    }
    let sender_timeout =
        if kind == Kind::Udp { Span::from_s(keys.sender_timeout_s().check(check)?) } else { Span::ZERO };
    let layout = layout(keys, form, check)?;
    Ok(Some(Plain { layout, sender_timeout }))
}

fn layout(keys: &LinkTable, form: Form, check: &mut Checker<'_>) -> Result<PlainLayout> {
    let usual = PlainLayout::default();
    let time = keys.time().check(check)?;
    if form == Form::FortyTwo {
        let own = ["layout", "quaternion", "rate_unit", "time_unit"];
        keys.refuse(&own, "another encoding than \"42\", which has its own conventions", check)?;
        let encoding = Encoding::FortyTwo(keys.spacecraft_number().check(check)?);
        return Ok(PlainLayout { encoding, time, ..usual });
    }
    keys.refuse(&["spacecraft_number"], "encoding = \"42\"", check)?;
    let encoding = match form {
        Form::F64Le => Encoding::F64Le,
        Form::F64Be => Encoding::F64Be,
        Form::Json => Encoding::Json,
        Form::Text | Form::FortyTwo => Encoding::Text,
    };
    let fields = match keys.layout().raw() {
        None => usual.fields,
        Some(names) => {
            PlainLayout::fields_of(names).map_err(|(place, error)| refused(keys, Some(place), &error, check))?
        }
    };
    let sense = keys.quaternion().check(check)?;
    let angle_unit_rad = keys.rate_unit().check(check)?;
    let time_unit_ns = keys.time_unit().check(check)?;
    let layout = PlainLayout { fields, encoding, sense, angle_unit_rad, time_unit_ns, time };
    layout.check().map_err(|error| refused(keys, None, &error, check))?;
    Ok(layout)
}

fn refused(keys: &LinkTable, place: Option<usize>, error: &LayoutError, check: &Checker<'_>) -> ConfigError {
    let name = place.and_then(|place| keys.layout().raw()?.get(place).cloned());
    let name_meant = name.clone();
    let got = name.map_or_else(
        || format!("{:?}", keys.layout().raw().map_or(&[][..], Vec::as_slice)),
        |name| format!("\"{name}\""),
    );
    let names = FIELD_NAMES.map(|(name, _)| name).join(", ");
    let meant = name_meant.and_then(|name| nearest(&name, FIELD_NAMES.iter().map(|(known, _)| *known)));
    let meant = meant.filter(|_| *error == LayoutError::Unknown).map(|name| format!("; did you mean \"{name}\"?"));
    let meant = meant.unwrap_or_default();
    let wanted = format!("some of {names}; vectors whole, and \"t\" unless time = \"arrival\"");
    keys.layout()
        .advised(format!("{error}{meant}; name the numbers in their order in the message; skip leaves one unread"))
        .invalid(got, wanted, check)
}

/// Returns the carrier of a plain link over the network.
pub(super) fn carrier(keys: &LinkTable, kind: Kind, check: &Checker<'_>) -> Result<Option<Carrier>> {
    match kind {
        Kind::Simulated | Kind::SocketCan | Kind::Serial => Ok(None),
        Kind::Udp => {
            keys.refuse(&["connect"], "kind = \"tcp\"", check)?;
            named_address(&keys.listen(), check).map(|listen| Some(Carrier::Udp { listen }))
        }
        Kind::Tcp => {
            let (listen, connect) = (address(&keys.listen(), check)?, address(&keys.connect(), check)?);
            match (listen, connect) {
                (Some(listen), None) => Ok(Some(Carrier::Tcp { address: listen, connects: false })),
                (None, Some(connect)) => Ok(Some(Carrier::Tcp { address: connect, connects: true })),
                (None, None) => Err(keys.listen().missing("a port to listen at, or connect = \"address:port\"", check)),
                (Some(_), Some(_)) => {
                    let connect = keys.connect().advised("one end listens, the other one connects: give one of them");
                    Err(connect.invalid("given", "not given beside listen", check))
                }
            }
        }
    }
}

/// Checks that a bench whose plant sends plain messages has what they need and nothing that they cannot serve.
pub(super) fn check_bench(
    (link, extra_links): (&Link, &[Link]),
    computer: &FlightComputer,
    session: &SessionParams,
    check: &Checker<'_>,
) -> Result<()> {
    if let Some(i) = extra_links.iter().position(|extra| extra.plain.is_some() || link.plain.is_some()) {
        let advice = "attitudes come from one sender, with one clock: a plain link is the only one of its bench";
        return Err(check.invalid(&format!("extra_link[{i}]"), "given", "none beside a plain link", advice));
    }
    let Some(plain) = &link.plain else { return Ok(()) };
    if session.start == SessionStart::OnRun {
        let advice = "a plain link has no RUN: frames show stars with the first attitude";
        return Err(check.invalid("session.start", "\"on_run\"", "\"at_once\" with a plain link", advice));
    }
    if computer.is_external {
        return Ok(());
    }
    if matches!(plain.layout.encoding, Encoding::FortyTwo(_)) {
        let advice = "42's lines are read, not written: with the simulated flight computer take another encoding";
        return Err(check.invalid("link.encoding", "\"42\"", "a bench whose flight computer is external", advice));
    }
    if computer.jitter_source == JitterSource::Samples {
        let advice = "samples of jitter have no plain form that it sends: take \"lines\"";
        return Err(check.invalid("flight_computer.jitter_source", "\"samples\"", "\"lines\" on a plain link", advice));
    }
    Ok(())
}

/// Senses of the quaternion by their words.
pub(super) const SENSES: [(&str, QuaternionSense); 2] =
    [("starloop", QuaternionSense::Starloop), ("conjugate", QuaternionSense::Conjugate)];

/// Meanings of the time by their words.
pub(super) const TIMES: [(&str, TimeMeaning); 2] = [("tag", TimeMeaning::Tag), ("arrival", TimeMeaning::Arrival)];

#[cfg(test)]
#[path = "plain_link_tests.rs"]
mod tests;
