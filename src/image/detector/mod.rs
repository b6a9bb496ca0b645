//! Electrons -> digital numbers: one file per effect, one ordered list of stages.
//!
//! In: mean electrons per pixel. Out: u16 DN. Random numbers are Philox words keyed by (seed, frame, pixel, stage),
//! with one seed for the sensor and one for the noise ([`Seeds`]): any frame, and any pixel of it, can be replayed
//! alone. A stage whose parameter is zero does nothing and costs nothing. Photon and dark shot noise are one Poisson
//! draw: the sum of two Poisson variables is a Poisson variable.

pub mod adc;
pub mod background;
pub mod binning;
pub mod block;
pub mod blooming;
pub mod charge_transfer;
pub mod colour_filter;
pub mod conditions;
pub mod constants;
pub mod cost;
pub mod cpu;
pub mod dark_current;
pub mod defects;
mod detector_pattern;
pub mod disturbances;
pub mod effect;
pub mod elementary;
mod ends;
pub mod full_well;
pub mod gpu;
pub mod image_lag;
pub mod levels;
pub mod line_pattern;
pub mod neighbour_stage;
pub mod neighbours;
pub mod nonlinearity;
pub mod outliers;
pub mod output;
pub mod params;
pub mod pattern;
pub mod poisson;
pub mod protons;
pub mod read_noise;
pub mod rounding;
pub mod row_noise;
pub mod seeds;
pub mod spatial;
mod stages;
mod steps;
pub mod tdi;
pub mod window;

pub use background::Background;
pub use conditions::DetectorConditions;
pub use cpu::Detector;
pub use dark_current::DarkLaw;
pub use effect::{Effect, ORDER};
pub use line_pattern::LinePattern;
pub use nonlinearity::Nonlinearity;
pub use params::DetectorParams;
pub use pattern::Patterns;
pub use poisson::PoissonMethod;
pub use rounding::Rounding;
pub use row_noise::RowNoise;
pub use seeds::Seeds;
pub use spatial::SpatialParams;
