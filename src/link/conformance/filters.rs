//! Check of the filters: each end of a bus receives only the messages of the other side of its node.

use super::{Check, suite::PATIENCE};
use crate::socketcan::Receives;
use crate::{Link, LinkError, Packet};
use base::clock::Clock;
use firmware_protocol::can::{CanFrame, CanId, IdMap};
use std::sync::Arc;

/// The node of the check.
const NODE: u8 = 5;
/// Numbers of identifiers that the stimulator of node 5 receives at base 0, ascending: SYNC for all nodes, then those of
/// its flight computer.
const RECEIVED_BY_STIMULATOR: [u16; 14] =
    [0x080, 0x205, 0x215, 0x225, 0x235, 0x245, 0x255, 0x285, 0x2A5, 0x305, 0x315, 0x485, 0x605, 0x705];
/// The same for the flight computer.
const RECEIVED_BY_FLIGHT_COMPUTER: [u16; 5] = [0x185, 0x195, 0x1A5, 0x585, 0x705];

/// Opens an end of these identifiers on one bus that receives the messages of the given side.
type Open<'a> = &'a mut dyn FnMut(IdMap, Receives) -> Result<Box<dyn Link>, LinkError>;

/// Sends frames of 2048 numbers as identifiers of 11 and of 29 bits, and checks that each end receives exactly its own, of
/// either length.
///
/// # Errors
/// The identifiers that were received instead, or the reason why an end could not be opened.
pub fn check_filters(
    clock: &Arc<dyn Clock>,
    mut open: impl FnMut(IdMap, Receives) -> Result<Box<dyn Link>, LinkError>,
) -> Result<Check, String> {
    check_node(IdMap::new(0, NODE), standard, clock, &mut open)?;
    check_node(IdMap::extended(0, NODE), extended, clock, &mut open)?;
    let (stimulator, computer) = (RECEIVED_BY_STIMULATOR.len(), RECEIVED_BY_FLIGHT_COMPUTER.len());
    let seen = format!("of 4096 identifiers {stimulator} reach the stimulator and {computer} the flight computer");
    Ok(Check { promise: "each side of a node receives the other's messages and no others", seen })
}

fn standard(number: u16) -> Option<CanId> {
    CanId::standard(number)
}

fn extended(number: u16) -> Option<CanId> {
    CanId::extended(number.into())
}

fn check_node(
    ids: Option<IdMap>,
    length: fn(u16) -> Option<CanId>,
    clock: &Arc<dyn Clock>,
    open: Open<'_>,
) -> Result<(), String> {
    let ids = ids.ok_or("the suite made an impossible node")?;
    let mut opened = |receives| open(ids, receives).map_err(|error| error.to_string());
    let mut from = opened(Receives::Everything)?;
    let mut ends = [
        (opened(Receives::FlightComputer)?, &RECEIVED_BY_STIMULATOR[..]),
        (opened(Receives::Stimulator)?, &RECEIVED_BY_FLIGHT_COMPUTER[..]),
    ];
    let either = |number| [standard(number), extended(number)];
    for frame in (0..=0x7FF).flat_map(either).flatten().filter_map(|id| CanFrame::classic(id, &[])) {
        from.send(&Packet::Can(frame)).map_err(|error| error.to_string())?;
    }
    for (end, wanted) in &mut ends {
        let got = received_by(&mut **end, wanted.len(), clock)?;
        let wanted: Vec<CanId> = wanted.iter().filter_map(|number| length(*number)).collect();
        if got != wanted {
            return Err(format!("wanted identifiers {wanted:x?}, got {got:x?}"));
        }
    }
    Ok(())
}

/// Returns the identifiers of the next `count` frames, and of any others that arrived.
fn received_by(link: &mut dyn Link, count: usize, clock: &Arc<dyn Clock>) -> Result<Vec<CanId>, String> {
    let mut ids = Vec::new();
    loop {
        let until = if ids.len() < count { clock.now() + PATIENCE } else { clock.now() };
        match link.receive(until).map_err(|error| error.to_string())?.map(|packet| packet.value) {
            Some(Packet::Can(frame)) => ids.push(frame.id()),
            Some(other) => return Err(format!("a {} packet", other.kind())),
            None => return Ok(ids),
        }
    }
}
