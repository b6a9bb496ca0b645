//! Where something is and how fast it moves.

use core::ops::{Add, Sub};
use glam::DVec3;

/// Position and velocity in ICRF axes.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct BarycentricState {
    /// Position from the solar-system barycentre, km (from the geocentre where a function says so).
    pub position_km: DVec3,
    /// Velocity with respect to the same origin, km/s.
    pub velocity_km_s: DVec3,
}

impl Add for BarycentricState {
    type Output = Self;
    fn add(self, other: Self) -> Self {
        Self {
            position_km: self.position_km + other.position_km,
            velocity_km_s: self.velocity_km_s + other.velocity_km_s,
        }
    }
}

impl Sub for BarycentricState {
    type Output = Self;
    fn sub(self, other: Self) -> Self {
        Self {
            position_km: self.position_km - other.position_km,
            velocity_km_s: self.velocity_km_s - other.velocity_km_s,
        }
    }
}
