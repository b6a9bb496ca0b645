//! Checked configurations -> the parts of a run.
//!
//! In: a [`config::Bench`] or [`config::Scenario`]. Out: parameters of every crate, and the closed loop with
//! both ends of its cable. Nothing here computes physics or prints.

pub mod assessment;
pub mod bench_parts;
pub mod camera_parts;
pub mod closed_loop;
pub mod control;
pub mod display_parts;
mod far_side;
pub mod fault_schedule;
pub mod faults;
pub mod loop_outcome;
mod loop_parts;
pub mod light_parts;
pub mod memory;
pub mod real_loop;
pub mod replay;
pub mod seeded;
pub mod sensitivity;
pub mod ports;
pub mod sinks;
pub mod vehicle_parts;
pub mod witness;
