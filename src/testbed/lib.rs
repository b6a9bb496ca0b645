//! The other end of the cable. Shares no code with what it checks: depends on `base`, `histories`, `link`,
//! `stars` and `firmware_protocol` only, and of `stars` uses the catalog only.

/// Attitude control: modes, laws, slews past the Sun, and the loop on paper.
pub mod acs;
/// Attitude and gyro bias from a gyro and star trackers: a multiplicative extended Kalman filter.
pub mod estimator;
/// A display behind a collimator, and the camera that sees it.
pub mod display_bench;
/// A simulated flight computer: attitude and jitter onto the bus, scripted or flown.
pub mod flight_computer;
/// A simulated spacecraft: rigid body, wheels, flexible modes, disturbances, gyros, micro-vibration.
pub mod spacecraft;
/// A star tracker that sees only pixels.
pub mod tracker;
/// A star tracker of given errors, without pixels.
pub mod tracker_model;
/// Spacecraft, sensors, estimator and control, closed over frames.
pub mod vehicle;

mod noise;
