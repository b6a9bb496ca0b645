//! Checked configurations -> the parts of a run.
//!
//! In: a [`config::Bench`] or [`config::Scenario`]. Out: parameters of every crate, and the closed loop with both ends
//! of its cable. Nothing here computes physics or prints.

pub mod assemble;
pub mod assessment;
pub mod bench_parts;
pub mod cable;
pub mod camera_parts;
pub mod control;
pub mod display_parts;
pub mod error;
mod far_side;
pub mod fault_schedule;
pub mod faults;
pub mod forty_two;
pub mod heads;
pub mod invariants;
mod landing;
pub mod memory;
pub mod ports;
mod real;
pub mod replay;
pub mod run_clock;
pub mod run_end;
pub mod sensitivity;
pub mod sink_setting;
pub mod sinks;
pub mod steering;
pub mod stepped;
pub mod taps;
pub mod tracker_ins;
pub mod tracker_outs;
pub mod vehicle_parts;
pub mod verdict;
pub mod witness;
