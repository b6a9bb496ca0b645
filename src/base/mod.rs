//! What every room may use: axes and rotations, time, images, counter-based random numbers, the accuracy budget,
//! standard output and standard error, names of files that are being written.
//!
//! Imports no other room of the crate.

pub mod accuracy;
pub mod axes;
pub mod clock;
pub mod fused;
pub mod image;
mod leap;
pub mod least_squares;
pub mod memory;
pub mod patience;
pub mod random;
pub mod source_id;
pub mod streams;
pub mod time;
pub mod unfinished;
pub mod units;
