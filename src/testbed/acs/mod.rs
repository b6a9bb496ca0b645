//! Attitude control of the simulated spacecraft: estimated attitude and rate in, torque on the body out.
//!
//! Modes with one table of transitions (`mode_logic`), control laws (`laws`), smooth turns (`slew`) that keep a
//! boresight from the Sun (`avoidance`), a filter for flexible modes (`filter`); and what all of it should amount
//! to, on paper (`linear`, `pointing_error`).
//!
//! Assumptions: rigid body in the laws; wheels give the torque asked for, up to the limit; attitude and rate come from
//! an estimator. Pure functions of inputs and time: no clock, no random numbers; nothing allocates at a step.
//!
//! Tests: `tests.rs` (loop against theory, limits, walk through the modes), `mode_tests.rs`, `slew_tests.rs`,
//! `avoidance_tests.rs`, `linear_tests.rs`, `closed_tests.rs` (with the estimator, gyro and late tracker, against the
//! paper), with a body of their own in `test_body.rs`.

pub mod avoidance;
#[cfg(test)]
mod avoidance_tests;
#[cfg(test)]
mod closed_tests;
pub mod control;
pub mod filter;
pub mod laws;
pub mod linear;
#[cfg(test)]
mod linear_tests;
pub mod mode_logic;
#[cfg(test)]
mod mode_tests;
pub mod params;
pub mod pointing_error;
pub mod slew;
#[cfg(test)]
mod slew_tests;
#[cfg(test)]
mod test_body;
#[cfg(test)]
mod tests;

pub use avoidance::KeepOut;
pub use control::Acs;
pub use filter::StructuralFilter;
pub use laws::Gains;
pub use linear::PointingLoop;
pub use mode_logic::{Cause, Mode, ModeEvent, Thresholds};
pub use params::{AcsInput, AcsOutput, AcsParams, Command, SafeParams, UnloadParams};
pub use pointing_error::{PointingNoise, PointingPrediction};
pub use slew::{SlewLimits, SlewPath};
