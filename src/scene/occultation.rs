//! Directions -> which are hidden by the Earth or the Moon at mid-exposure.
//!
//! In: the observer's position among the bodies, and the field. Out: yes or no for an apparent direction and a
//! distance; the Earth is the WGS 84 ellipsoid, the Moon a sphere. A spherical Earth would be wrong by up to 21 km at
//! the limb, 0.45 deg from 550 km up: 23 px of 71 arcsec. Limits: no refraction, air or mountains ([`sky::spheroid`]);
//! a star that sets during the exposure is visible for all of it or not at all, so its setting is right to half an
//! exposure. Tests: `tests/physics/bodies.rs`.

use glam::DVec3;
use sky::{bodies::Standpoint, spheroid::Spheroid};

/// The bodies that may hide sources in one field.
#[derive(Debug, Clone, Copy, Default)]
pub struct Occultation {
    /// The Earth and the Moon, if they reach into the field.
    bodies: [Option<Spheroid>; 2],
}

impl Occultation {
    /// Returns the bodies whose limb comes within `radius_rad` of the boresight.
    pub fn in_field(standpoint: &Standpoint, boresight_icrf: DVec3, radius_rad: f64) -> Self {
        let is_near = |body: &Spheroid| {
            body.apparent_centre().angle_between(boresight_icrf) < body.angular_radius_rad() + radius_rad
        };
        Self { bodies: [standpoint.earth(), standpoint.moon()].map(|body| body.filter(is_near)) }
    }

    /// Returns true when nothing in the field is hidden.
    pub fn is_none(&self) -> bool {
        self.bodies.iter().all(Option::is_none)
    }

    /// Returns true when a body nearer than `range_km` hides this apparent direction (unit).
    pub fn hides(&self, apparent_icrf: DVec3, range_km: f64) -> bool {
        self.bodies.iter().flatten().any(|body| lies_before(body, apparent_icrf, range_km))
    }

    /// Returns the same for the Moon alone.
    pub fn moon_hides(&self, apparent_icrf: DVec3, range_km: f64) -> bool {
        self.bodies[1].is_some_and(|moon| lies_before(&moon, apparent_icrf, range_km))
    }
}

fn lies_before(body: &Spheroid, apparent_icrf: DVec3, range_km: f64) -> bool {
    body.centre_km.length() < range_km && body.hides(apparent_icrf)
}
