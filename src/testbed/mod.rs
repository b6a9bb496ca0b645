//! The other end of the cable. Shares no code with what it checks: imports `base`, `link`, `firmware_protocol` and
//! `sky::catalog` only.

/// Attitude and gyro bias from a gyro and star trackers: a multiplicative extended Kalman filter.
pub mod estimator;
/// A simulated flight computer: scripted attitude and jitter onto the bus.
pub mod flight_computer;
/// A simulated spacecraft: rigid body, wheels, flexible modes, disturbances, gyros, micro-vibration.
pub mod spacecraft;

mod attitude_truth;
mod noise;
