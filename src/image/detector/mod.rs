//! Electrons -> digital numbers: a file for each effect (full well and ADC share one), one ordered list (`effect_order`).
//!
//! In: mean electrons per pixel. Out: u16 DN. Random numbers are Philox words keyed by (seed, frame, pixel, stage),
//! with one seed for the sensor and one for the noise ([`Seeds`]): any frame, and any pixel of it, can be replayed
//! alone. A stage whose parameter is zero does nothing and costs nothing. Photon and dark shot noise are one Poisson
//! draw: the sum of two Poisson variables is a Poisson variable.

pub mod background;
pub mod binning;
pub mod block;
pub mod blooming;
pub mod charge_transfer;
pub mod conditions;
pub mod cost;
pub mod cpu;
pub mod dark_current;
pub mod defects;
mod detector_pattern;
pub mod disturbances;
pub mod effect_order;
pub mod elementary;
pub mod gpu;
pub mod image_lag;
pub mod line_pattern;
pub mod neighbours;
pub mod nonlinearity;
pub mod outliers;
pub mod output;
pub mod params;
pub mod pattern;
pub mod poisson;
pub mod protons;
pub mod read_noise;
pub mod readout;
pub mod seeds;
mod stages;
mod steps;
pub mod tdi;
pub mod window;

pub use background::Background;
pub use conditions::DetectorConditions;
pub use cpu::Detector;
pub use dark_current::DarkLaw;
pub use effect_order::{Effect, ORDER};
pub use line_pattern::LinePattern;
pub use nonlinearity::Nonlinearity;
pub use params::{DetectorParams, Rounding, SpatialParams};
pub use pattern::Patterns;
pub use poisson::PoissonMethod;
pub use read_noise::RowNoise;
pub use seeds::Seeds;
