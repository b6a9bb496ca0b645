//! CAN and CAN FD: identifiers, frames, and the classic attitude group.
//!
//! CAN FD carries every message in one frame. Classic CAN carries the attitude as a group, lowest identifier first,
//! so that the commit, which has the highest, leaves last (identifiers of 11 bits at base 0 and node n):
//!
//! | id | bytes |
//! |---|---|
//! | `0x21n` ATT_Q01 | w, x: 2 x f32 |
//! | `0x22n` ATT_Q23 | y, z: 2 x f32 |
//! | `0x23n` ATT_W, if flag bit 0 | rate, 3 x 21 bits of 1 urad/s from bit 0 |
//! | `0x24n` ATT_A, if flag bit 1 | angular acceleration, 3 x 21 bits of 1 urad/s^2 from bit 0 |
//! | `0x25n` ATT_T | time tag u32, sequence number, flags, CRC-16 |
//!
//! The CRC runs over the 8 bytes of each part sent, in the order above, and the first 6 bytes of ATT_T.

mod frame;
mod id;

pub use frame::{CLASSIC_MAX, CanFrame, Decoder, FD_MAX, FRAMES_MAX, Format, Frames, encode};
pub use id::{CanId, IdMap, ToCanId};
