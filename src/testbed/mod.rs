//! The other end of the cable. Shares no code with what it checks: imports `base`, `link`, `firmware_protocol`
//! and `sky::catalog` only.

/// A simulated flight computer: scripted attitude and jitter onto the bus.
pub mod flight_computer;
/// A reference star tracker: images to attitudes.
pub mod tracker;
