//! One raw socket: frames with the kernel's stamps and its count of drops.

use super::{SocketCanParams, open};
use crate::readiness::{Readiness, wait_for};
use crate::{LinkError, kernel_stamp::nonzero_ns};
use base::time::Span;
use firmware_protocol::MessageId;
use firmware_protocol::can::{CLASSIC_MAX, CanFrame, CanId, FD_MAX, IdMap};
use nix::sys::socket::{ControlMessageOwned, MsgFlags, Timestamps, recvmsg};
use socketcan::errors::{CAN_ERR_BUSOFF, CAN_ERR_CNT, CAN_ERR_CRTL, CAN_ERR_RESTARTED};
use socketcan::id::{CAN_EFF_FLAG, CAN_EFF_MASK, CAN_ERR_FLAG, CAN_ERR_MASK, CAN_RTR_FLAG, CAN_SFF_MASK};
use socketcan::{CanFdSocket, CanFilter};
use std::io::{self, IoSliceMut};
use std::os::fd::{AsFd, AsRawFd};

/// Bytes for the requested control messages: three stamps and the count of drops.
const CONTROL_BYTES: usize = 256;

/// An open socket, bound to one interface that is up.
pub(super) struct Socket {
    inner: CanFdSocket,
    control: Box<[u8; CONTROL_BYTES]>,
    drops: u32,
    bit_rate_switch: bool,
}

/// Result of one read of the socket.
#[derive(Debug, Clone, Copy)]
pub(super) struct Received {
    pub(super) frame: RawFrame,
    /// CLOCK_REALTIME at which the kernel got it, ns.
    pub(super) kernel_ns: Option<i64>,
    /// The adapter's own clock, ns.
    pub(super) hardware_ns: Option<i64>,
    /// Frames the kernel dropped since the last read, because the receive buffer was full.
    pub(super) drops: u64,
}

impl Socket {
    pub(super) fn open(params: &SocketCanParams) -> Result<Self, LinkError> {
        let (inner, bit_rate_switch) = (open(params)?, params.bit_rate_switch);
        Ok(Self { inner, control: Box::new([0; CONTROL_BYTES]), drops: 0, bit_rate_switch })
    }

    /// Returns the next frame in the kernel's queue; `None` when it is empty.
    pub(super) fn read(&mut self) -> io::Result<Option<Received>> {
        let mut bytes = [0; FD_BYTES];
        let mut slices = [IoSliceMut::new(&mut bytes)];
        let control = Some(&mut self.control[..]);
        let message = match recvmsg::<()>(self.inner.as_raw_fd(), &mut slices, control, MsgFlags::MSG_DONTWAIT) {
            Ok(message) => message,
            Err(nix::Error::EAGAIN | nix::Error::EINTR) => return Ok(None),
            Err(error) => return Err(error.into()),
        };
        let mut got = Received { frame: RawFrame::Foreign, kernel_ns: None, hardware_ns: None, drops: 0 };
        for control in message.cmsgs()? {
            if let ControlMessageOwned::ScmTimestampsns(stamps) = control {
                got.stamp(&stamps);
            } else if let ControlMessageOwned::RxqOvfl(total) = control {
                got.drops = u64::from(total.wrapping_sub(self.drops));
                self.drops = total;
            }
        }
        let len = message.bytes;
        got.frame = frame_of(bytes.get(..len).unwrap_or(&[]));
        Ok(Some(got))
    }

    /// Hands a frame to the interface's queue.
    pub(super) fn write(&self, frame: &CanFrame) -> io::Result<()> {
        let mut bytes = [0; FD_BYTES];
        let bytes = bytes_of(frame, self.bit_rate_switch, &mut bytes);
        rustix::io::write(&self.inner, bytes).map(|_| ()).map_err(Into::into)
    }

    /// Waits for data or an error, for `span` at most.
    pub(super) fn wait(&self, span: Span) -> io::Result<()> {
        wait_for(self.inner.as_fd(), Readiness::Read, span).map(drop)
    }
}

impl Received {
    /// Takes the stamps; all zero means that no such stamp was taken.
    fn stamp(&mut self, stamps: &Timestamps) {
        self.kernel_ns = nonzero_ns(stamps.system);
        self.hardware_ns = nonzero_ns(stamps.hw_raw);
    }
}

// The kernel's error frames -> counters. Classes: Linux `include/uapi/linux/can/error.h`.

/// Byte 1 of a controller problem: the controller's receive buffer overflowed and a frame was lost.
const CONTROLLER_RX_OVERFLOW: u8 = 0x01;
/// Byte 1 of a controller problem: back to error-active, which is good news.
const CONTROLLER_ACTIVE: u8 = 0x40;

/// Meaning of one error frame. Several may apply at once.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(super) struct ErrorReport {
    /// Something went wrong on the bus or in the controller.
    pub(super) error: bool,
    /// The controller has left the bus.
    pub(super) bus_off: bool,
    /// The controller is back on the bus.
    pub(super) restarted: bool,
    /// The controller lost at least one frame.
    pub(super) overflow: bool,
}

impl ErrorReport {
    /// Reads the class bits of the identifier and the data. Bits that this version does not know are errors.
    pub(super) fn of(class: u32, data: &[u8]) -> Self {
        let problem = data.get(1).copied().unwrap_or(0);
        let recovered = class & CAN_ERR_CRTL != 0 && problem == CONTROLLER_ACTIVE;
        let good_news = CAN_ERR_RESTARTED | CAN_ERR_CNT | if recovered { CAN_ERR_CRTL } else { 0 };
        Self {
            error: class & !good_news != 0,
            bus_off: class & CAN_ERR_BUSOFF != 0,
            restarted: class & CAN_ERR_RESTARTED != 0,
            overflow: class & CAN_ERR_CRTL != 0 && problem & CONTROLLER_RX_OVERFLOW != 0,
        }
    }
}

// Identifiers of a node -> the kernel's receive filters.

/// Side of a node whose messages an end receives.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Receives {
    /// Messages of the node's flight computer: the stimulator's side.
    FlightComputer,
    /// Messages of the node's stimulator: the flight computer's side.
    Stimulator,
    /// Frames for a CANopen node of this number: NMT, SYNC and requests of SDO clients.
    CanOpenNode(u8),
    /// Reports and heartbeat of a CANopen node of this number: its master's side.
    CanOpenMaster(u8),
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
        Receives::CanOpenMaster(node) => {
            let ids = [0x180, 0x280, 0x380, 0x700].map(|id| id + u16::from(node));
            ids.into_iter().filter_map(CanId::standard).map(only).collect()
        }
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

// The kernel's frames as bytes <-> frames. Layout: `struct can_frame` and `struct canfd_frame` of Linux
// `include/uapi/linux/can.h`: identifier and flags u32 (native order), length u8, FD flags u8, two bytes reserved,
// data.

const HEADER: usize = 8;
/// `CAN_MTU`: a classic frame.
pub(super) const CLASSIC_BYTES: usize = HEADER + CLASSIC_MAX;
/// `CANFD_MTU`: an FD frame.
pub(super) const FD_BYTES: usize = HEADER + FD_MAX;
/// `CANFD_BRS`: the data are sent at the data bit rate.
const BIT_RATE_SWITCH: u8 = 0x01;

/// A frame from the kernel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum RawFrame {
    /// A data frame.
    Data(CanFrame),
    /// An error frame.
    Report(ErrorReport),
    /// A frame that no filter of ours lets through: remote, or of an impossible identifier or length.
    Foreign,
}

/// Reads a frame of the kernel: 16 bytes are a classic or error frame, 72 an FD frame.
pub(super) fn frame_of(bytes: &[u8]) -> RawFrame {
    let Some((head, data)) = bytes.split_first_chunk::<HEADER>() else { return RawFrame::Foreign };
    let [id @ .., len, _flags, _, _] = head;
    let id = u32::from_ne_bytes(*id);
    let Some(data) = data.get(..usize::from(*len)) else { return RawFrame::Foreign };
    if id & CAN_ERR_FLAG != 0 {
        return RawFrame::Report(ErrorReport::of(id & CAN_ERR_MASK, data));
    }
    if id & CAN_RTR_FLAG != 0 {
        return RawFrame::Foreign;
    }
    // CAN_EFF_FLAG is bit 31.
    let frame = CanId::from_flagged(id).and_then(|id| match bytes.len() {
        CLASSIC_BYTES => CanFrame::classic(id, data),
        FD_BYTES => CanFrame::fd(id, data),
        _ => None,
    });
    frame.map_or(RawFrame::Foreign, RawFrame::Data)
}

/// Writes a frame as the kernel takes it; the bytes to be sent.
pub(super) fn bytes_of<'a>(frame: &CanFrame, bit_rate_switch: bool, to: &'a mut [u8; FD_BYTES]) -> &'a [u8] {
    to.fill(0);
    let data = frame.data();
    to[..4].copy_from_slice(&frame.id().flagged().to_ne_bytes());
    #[allow(clippy::cast_possible_truncation, reason = "a frame has at most 64 bytes")]
    {
        to[4] = data.len() as u8;
    }
    to[5] = if frame.is_fd() && bit_rate_switch { BIT_RATE_SWITCH } else { 0 };
    to[HEADER..HEADER + data.len()].copy_from_slice(data);
    if frame.is_fd() { &to[..] } else { &to[..CLASSIC_BYTES] }
}
