//! The one number of `starloop::sky::moon` that orbits need.

/// The Moon's mean radius, km.
pub(in crate::sky) const RADIUS_KM: f64 = 1_737.4;
