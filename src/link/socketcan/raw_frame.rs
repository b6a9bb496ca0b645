//! The kernel's frames as bytes <-> frames. Layout: `struct can_frame` and `struct canfd_frame` of Linux
//! `include/uapi/linux/can.h`: identifier and flags u32 (native order), length u8, FD flags u8, two bytes reserved,
//! data.

use super::errors::ErrorReport;
use firmware_protocol::can::{CLASSIC_MAX, CanFrame, CanId, FD_MAX};
use socketcan::id::{CAN_ERR_FLAG, CAN_ERR_MASK, CAN_RTR_FLAG};

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
pub(super) fn read(bytes: &[u8]) -> RawFrame {
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
pub(super) fn write<'a>(frame: &CanFrame, bit_rate_switch: bool, to: &'a mut [u8; FD_BYTES]) -> &'a [u8] {
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
