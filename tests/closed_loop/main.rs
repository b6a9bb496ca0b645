//! Tests of the whole loop over a simulated bus: on the virtual clock through the library, on the bench clock and as a
//! program through the binary.
#![allow(clippy::wildcard_enum_match_arm, reason = "a test looks for one kind among all")]
#![allow(clippy::panic, clippy::unwrap_used, reason = "a test that cannot go on has failed")]

mod attitude;
mod bad_input;
mod bench;
mod budget;
mod calibrated;
mod camera_bus;
mod campaign;
mod commanding_tracker;
mod control;
mod deadline;
mod degraded;
#[cfg(feature = "display")]
mod display;
mod full_load;
mod heads;
mod imaging_faults;
mod late_jitter;
mod link_check;
mod lockstep;
mod matrix;
mod pixels;
mod program;
mod reaction;
mod replay;
mod session;
mod sinks;
mod study;
mod triggers;
mod verdicts;
