//! Electrons -> digital numbers: one file per effect, one ordered list of stages.
//!
//! In: mean electrons per pixel. Out: u16 DN. Random numbers are Philox words keyed by (seed, frame, pixel, stage): any
//! frame, and any pixel of it, can be replayed alone. A stage whose parameter is zero does nothing and costs nothing.
//! Photon and dark shot noise are one Poisson draw: the sum of two Poisson variables is a Poisson variable.

pub mod adc;
pub mod block;
pub mod cpu;
pub mod effect;
pub mod elementary;
mod ends;
pub mod full_well;
pub mod gpu;
pub mod neighbours;
pub mod params;
pub mod pattern;
pub mod poisson;
pub mod read_noise;
mod stages;

pub use cpu::Detector;
pub use effect::{Effect, ORDER};
pub use params::DetectorParams;
pub use poisson::PoissonMethod;
