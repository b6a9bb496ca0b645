//! The other end of the cable. Shares no code with what it checks: imports `base`, `link` and `firmware_protocol` only.

/// A simulated flight computer: scripted attitude and jitter onto the bus.
pub mod flight_computer;
/// Attitude and gyro bias from a gyro and star trackers: a multiplicative extended Kalman filter.
pub mod estimator;

/// Attitude control: modes, laws, slews past the Sun, and the loop on paper.
pub mod acs;
