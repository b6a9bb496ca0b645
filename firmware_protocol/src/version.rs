//! Protocol version, and the rule by which it changes.
//!
//! Within one major version:
//! * lengths, offsets, units and the meaning of existing fields never change;
//! * a minor version may add messages, STATUS pages, opcodes and flag bits; a receiver counts what it does not know
//!   ([`crate::Reject::UnknownId`], [`crate::Reject::UnknownValue`]) and goes on; unknown flag bits are ignored;
//! * reserved bytes and bits are sent as zero and not looked at;
//! * a refusal code is sent only to a peer whose HELLO named a minor version that has it; an older peer gets the code that
//!   [`crate::message::Refusal::for_minor`] puts in its place.
//!
//! 1.1 added TABLE, APPLY with its refusals, and the capability bits. 1.2 added TRIGGER with its refusals and its bit. 1.3
//! added the refusal of a trigger that nothing waits for. 1.4 added CAMERA, CAMERA_TRIGGER, their refusals and their
//! bit, and CAMERA_STATUS.
//!
//! Anything else needs a new major version. Peers of different majors refuse to RUN (see [`crate::handshake`]), serial
//! packets of another major are rejected. `tests/` keeps the frozen bytes: a file per major version, and one per minor
//! version that adds bytes to it.

/// Changes when a layout or a meaning changes.
pub const MAJOR: u8 = 1;
/// Changes when something is added.
pub const MINOR: u8 = 4;

/// A version as peers exchange it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Version {
    /// Layouts and meanings.
    pub major: u8,
    /// Additions.
    pub minor: u8,
}

/// The version of this crate.
pub const CURRENT: Version = Version { major: MAJOR, minor: MINOR };
