//! Checked configurations -> the parts of a run.
//!
//! In: a [`config::Bench`] or [`config::Scenario`]. Out: parameters of every crate, and the closed loop with both ends
//! of its cable. Nothing here computes physics or prints.

pub mod assemble;
pub mod assessment;
pub mod bench_parts;
pub mod cable;
pub mod camera_parts;
pub mod capture_tap;
pub mod control;
pub mod display_parts;
pub mod error;
mod far_side;
mod fault_desk;
pub mod fault_schedule;
pub mod faults;
mod fly;
pub mod heads;
mod landing;
pub mod light_parts;
pub mod live_tap;
pub mod memory;
pub mod motion;
mod outside_trackers;
mod plain_ends;
pub mod ports;
mod real;
pub mod replay;
pub mod run_clock;
pub mod run_end;
pub mod run_times;
pub mod seeded;
pub mod seen_mag;
pub mod sensitivity;
pub mod sink_setting;
pub mod sinks;
mod start;
pub mod steering;
pub mod stepped;
mod taps;
pub mod tracker_outs;
mod trigger_lines;
pub mod vehicle_parts;
pub mod verdict;
pub mod witness;
