//! Attitude samples -> history -> interpolation or prediction -> [`LosPath`] of one exposure.

pub mod los;
pub mod sample;

pub use los::{JitterLine, JitterPoint, JitterTrack, LosPath, PathOrigin};
pub use sample::AttitudeSample;
