//! Attitude estimator of the simulated spacecraft: gyro samples and star-tracker attitudes in, attitude, rate and
//! gyro bias with their covariance out.
//!
//! A multiplicative extended Kalman filter: Lefferts, Markley and Shuster, "Kalman filtering for spacecraft attitude
//! estimation", JGCD 5 (1982); Markley and Crassidis, "Fundamentals of Spacecraft Attitude Determination and Control"
//! (2014), chapter 6. Attitudes arrive late; they are worked in at the instant for which they hold (`Mekf::measure`).
//!
//! Assumptions: white rate noise and a bias that walks, per axis; the rate is constant over one gyro sample; error
//! angles are small enough for first order (innovations are exact rotation vectors, so large first corrections are
//! right too). Pure functions of inputs and time: no clock, no random numbers. After `Mekf::new` nothing allocates.
//!
//! Tests: `tests.rs` (consistency by Monte Carlo, Farrenkopf's closed form, late and unordered attitudes, gating,
//! recovery), `covariance6.rs` (blocks against plain 6 x 6 arithmetic).

mod covariance6;
mod farrenkopf;
mod history;
mod mekf;
mod params;
#[cfg(test)]
mod tests;

pub use covariance6::{Covariance6, Gain, Turn};
pub use farrenkopf::{Farrenkopf, GyroNoise};
pub use mekf::{Measured, Mekf, MekfCounts};
pub use params::MekfParams;
