//! Messages between flight firmware and the starloop star-sensor stimulator: no_std, no allocation, no dependency.
//!
//! ```text
//! CAN frames   -> can::Decoder    \
//!                                   -> Message -> can::encode / serial::Encoder -> frames, bytes
//! serial bytes -> serial::Decoder /
//! ```
//!
//! Conventions of the wire:
//! * little-endian; layouts are given byte by byte in the documentation of each message;
//! * attitude: Hamilton quaternion, scalar first (`w x y z`), passive `body_from_icrf`, that is
//!   `v_body = q v_icrf conj(q)`; [`ATTITUDE_CONVENTION`] names this convention in the handshake;
//! * rates and accelerations: body with respect to ICRF, body axes, rad/s and rad/s^2;
//! * time tags: the sender's spacecraft elapsed time (SCET) in microseconds, modulo 2^32 (wraps every 71.6 min);
//!   [`message::TimeFollowUp`] carries the whole SCET.
//!
//! Bad input never panics: each refusal is one [`Reject`], to be counted in [`RejectCounters`]. For other languages:
//! `INTERFACE.md` (byte tables), `dbc/`, `c/` (C99), `vectors.json` (bytes of every message).
//! `tests/frozen_*.rs` hold the exact bytes, `tests/properties` the round trips, damage and
//! arbitrary input.

#![no_std]
#![forbid(unsafe_code)]
#![cfg_attr(not(test), warn(clippy::indexing_slicing))]
#![cfg_attr(
    test,
    allow(clippy::unwrap_used, clippy::panic, reason = "a test may stop at the first surprise and says what it was")
)]

mod bytes;
/// CAN and CAN FD: identifiers, frames, the classic attitude group.
pub mod can;
/// CRC-16/IBM-3740.
pub mod crc;
/// The receiving side of HELLO, INFO, RUN, STOP, APPLY, TRIGGER, CAMERA and CAMERA_TRIGGER.
pub mod handshake;
/// Messages, on any carrier.
pub mod message;
mod reject;
mod sequence;
/// Serial framing: COBS, header, CRC.
pub mod serial;
pub mod tables;
pub mod ticks;
/// Protocol version and how it may change.
pub mod version;

pub use bytes::{PAYLOAD_MAX, Payload};
pub use message::{Message, MessageId};
pub use reject::{EncodeError, Reject, RejectCounters};
pub use sequence::REPLAY_WINDOW;

/// The only attitude convention of this major version: Hamilton, scalar first, passive `body_from_icrf`.
pub const ATTITUDE_CONVENTION: u8 = 1;

/// CRC-32/ISO-HDLC of `dbc/starloop.dbc`, which INFO reports: both ends can check that they use the same file.
pub const DBC_CRC32: u32 = crc::crc32(include_bytes!("../dbc/starloop.dbc"));
