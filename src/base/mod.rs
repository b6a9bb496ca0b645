//! What every room may use: axes and rotations, time, images, counter-based random numbers, the accuracy budget.
//!
//! Imports no other room of the crate.

pub mod accuracy;
pub mod axes;
pub mod clock;
pub mod fused;
pub mod image;
mod leap;
pub mod least_squares;
pub mod random;
pub mod time;
pub mod units;
