//! Identifiers of a node -> the kernel's receive filters.

use firmware_protocol::MessageId;
use firmware_protocol::can::{CanId, IdMap};
use socketcan::CanFilter;
use socketcan::id::{CAN_EFF_FLAG, CAN_EFF_MASK, CAN_RTR_FLAG, CAN_SFF_MASK};

/// Side of a node whose messages an end receives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Receives {
    /// Messages of the node's flight computer: the stimulator's side.
    FlightComputer,
    /// Messages of the node's stimulator: the flight computer's side.
    Stimulator,
    /// Frames for a CANopen node of this number: NMT, SYNC and requests of SDO clients.
    CanOpenNode(u8),
    /// Every data frame: monitors and tests.
    Everything,
}

const FROM_FLIGHT_COMPUTER: [MessageId; 14] = [
    MessageId::Sync,
    MessageId::TimeFollowUp,
    MessageId::AttitudeQ01,
    MessageId::AttitudeQ23,
    MessageId::AttitudeRate,
    MessageId::AttitudeAcceleration,
    MessageId::AttitudeCommit,
    MessageId::Wheels,
    MessageId::JitterPair,
    MessageId::Attitude,
    MessageId::Jitter,
    MessageId::Table,
    MessageId::Command,
    MessageId::Heartbeat,
];

const FROM_STIMULATOR: [MessageId; 5] =
    [MessageId::Exposure, MessageId::Status, MessageId::CameraStatus, MessageId::Response, MessageId::Heartbeat];

/// Returns one filter per identifier: the kernel finds single identifiers in tables, whatever their number. Frames of
/// the other length of identifiers, and remote frames, never match.
pub(super) fn filters(ids: &IdMap, receives: Receives) -> Vec<CanFilter> {
    let one = |message: &MessageId| only(ids.id(*message));
    match receives {
        Receives::FlightComputer => FROM_FLIGHT_COMPUTER.iter().map(one).collect(),
        Receives::Stimulator => FROM_STIMULATOR.iter().map(one).collect(),
        Receives::CanOpenNode(node) => {
            [0x000, 0x080, 0x600 + u16::from(node)].into_iter().filter_map(CanId::standard).map(only).collect()
        }
        Receives::Everything => vec![CanFilter::new(0, CAN_RTR_FLAG)],
    }
}

/// Returns the filter of data frames with this identifier.
fn only(id: CanId) -> CanFilter {
    let number = if id.is_extended() { CAN_EFF_MASK } else { CAN_SFF_MASK };
    CanFilter::new(id.flagged(), number | CAN_EFF_FLAG | CAN_RTR_FLAG)
}
