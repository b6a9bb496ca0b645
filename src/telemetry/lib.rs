//! Wire formats of star trackers: what a tracker reports -> packets; bytes of a client -> orders and answers; and packets
//! -> what was measured ([`reading`]).
//!
//! Pure: no socket, no clock, no file. Each protocol is a [`Device`] in a module of its own, and keeps the state that
//! its real counterpart keeps: counters, subscriptions, an object dictionary. Whoever has a clock and a line calls it.
//!
//! ```text
//! Report -> Device -> Wire (bytes, or CAN frames) -> line      line -> Wire -> Device -> Order, and answers
//! ```
//!
//! Quaternions come in as everywhere in starloop (Hamilton, passive, `v_sensor = q v_icrf q*`, scalar first); each
//! module says what it makes of them. Tests: beside the code, with packets from the protocols' own documents and
//! programs; `hil_scripts/tests/test_tracker_out.py` with other people's clients; `tracker_commands` and `tracker_telemetry` in
//! `tests/fuzz/targets`.

pub mod canopen;
pub mod ccsds;
mod device;
pub mod json;
pub mod nos3;
pub mod reading;
pub mod sagitta;

pub use device::{Answered, Device, Limits, Mode, Order, Report, Sense, Wire};

#[cfg(test)]
mod sample;
