//! Types and functions for every crate: axes and rotations, time, clocks, images, colours of pixels, counter-based
//! random numbers, the accuracy budget, how frames are drawn, sources on the sky, standard output and standard error,
//! files that are read as a whole, refusals, names of unfinished files, locks of files, queues to writing threads and
//! the limit of waiting for them, text for XML, enums of words, and what several crates compute: medians, zeros, sines,
//! least squares.

pub mod accuracy;
pub mod axes;
pub mod base64;
pub mod bayer;
pub mod bisection;
pub mod clock;
pub mod drawn;
pub mod file_lock;
pub mod fused;
pub mod image;
pub mod input_file;
pub mod least_squares;
pub mod memory;
pub mod patience;
pub mod random;
pub mod refused;
pub mod region;
pub mod sines;
pub mod source;
pub mod source_id;
pub mod streams;
pub mod time;
pub mod unfinished;
pub mod units;
pub mod vector_level;
mod words;
pub mod writer_queue;
pub mod xml;
