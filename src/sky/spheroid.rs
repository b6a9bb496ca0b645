//! A direction as the observer sees it -> does it meet a body, and where: limb, point of the surface, its normal.
//!
//! A body is a spheroid about its axis. Stretched along the axis until it is a sphere, straight lines stay straight, so
//! limb and surface are those of a sphere: a line meets it when it passes nearer than the radius.
//!
//! Light is taken in the body's own axes of rest, where it needs no light time: a direction seen, `u`, comes from `u -
//! b` there, `b` the observer's velocity with respect to the body over that of light (aberration to first order; what
//! is left out, b^2 / 2, is 1 mas at 30 km/s). Limits: no atmosphere, so no refraction (at the Earth's limb up to 70
//! arcmin, a few seconds of an orbit) and no dimming; no mountains. Tests: below.

use crate::state::BarycentricState;
use base::units::SPEED_OF_LIGHT_KM_S;
use glam::DVec3;

/// A body from where the observer is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Spheroid {
    /// Its present centre, km.
    pub centre_km: DVec3,
    /// Its axis, unit.
    pub axis: DVec3,
    /// Equatorial radius, km.
    pub radius_km: f64,
    /// Equatorial over polar radius.
    pub stretch: f64,
    /// The observer's velocity with respect to it, over that of light.
    pub beta: DVec3,
}

/// A point of a body's surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Outward normal, unit.
    pub normal: DVec3,
    /// Cosine of the angle between the normal and the way to the observer.
    pub towards_observer: f64,
    /// Distance from the observer, km.
    pub range_km: f64,
}

impl Spheroid {
    /// Returns a body with this state for the observer: position from the body's centre and velocity with respect to
    /// it.
    pub fn seen_from(state: &BarycentricState, axis: DVec3, radius_km: f64, flattening: f64) -> Self {
        let beta = state.velocity_km_s / SPEED_OF_LIGHT_KM_S;
        Self { centre_km: -state.position_km, axis, radius_km, stretch: 1.0 / (1.0 - flattening), beta }
    }

    /// Returns a small sphere in an apparent direction (unit) and at a distance: aberration has been taken care of.
    pub fn sphere(apparent: DVec3, distance_km: f64, radius_km: f64) -> Self {
        Self { centre_km: apparent * distance_km, axis: DVec3::Z, radius_km, stretch: 1.0, beta: DVec3::ZERO }
    }

    /// Returns the angular radius of the largest circle, rad; a right angle for an observer inside.
    pub fn angular_radius_rad(&self) -> f64 {
        (self.radius_km / self.centre_km.length()).min(1.0).asin()
    }

    /// Returns where its centre is seen, unit.
    pub fn apparent_centre(&self) -> DVec3 {
        (self.centre_km.normalize() + self.beta).normalize()
    }

    /// Returns how far inside the limb a direction is, in radii by which its line passes the limb: 0 on it, 1 in the
    /// middle, negative outside. Linear in the angle near the limb.
    pub fn depth(&self, apparent: DVec3) -> f64 {
        let (u, centre_km) = (self.stretched(apparent - self.beta), self.stretched(self.centre_km));
        if u.dot(centre_km) <= 0.0 {
            return -1.0;
        }
        1.0 - (centre_km.cross(u).length_squared() / u.length_squared()).sqrt() / self.radius_km
    }

    /// Returns whether it covers everything farther away in this direction.
    pub fn hides(&self, apparent: DVec3) -> bool {
        self.depth(apparent) > 0.0
    }

    /// Returns the point of the surface seen in a direction; `None` outside the limb.
    pub fn surface(&self, apparent: DVec3) -> Option<SurfacePoint> {
        let natural = (apparent - self.beta).normalize();
        let (u, centre_km) = (self.stretched(natural), self.stretched(self.centre_km));
        let length = u.length();
        let along_km = u.dot(centre_km) / length;
        let half_chord_km2 = self.radius_km * self.radius_km - (centre_km.length_squared() - along_km * along_km);
        if along_km <= 0.0 || half_chord_km2 < 0.0 {
            return None;
        }
        let near_km = along_km - half_chord_km2.sqrt();
        if near_km < 0.0 {
            return None;
        }
        // The gradient of the spheroid's equation: stretched twice.
        let normal = self.stretched(u * (near_km / length) - centre_km).normalize();
        Some(SurfacePoint { normal, towards_observer: -normal.dot(natural), range_km: near_km / length })
    }

    fn stretched(&self, v: DVec3) -> DVec3 {
        v + self.axis * ((self.stretch - 1.0) * self.axis.dot(v))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// WGS 84.
    const RADIUS_KM: f64 = 6_378.137;
    const FLATTENING: f64 = 1.0 / 298.257_223_563;

    fn at(position_km: DVec3) -> Spheroid {
        let state = BarycentricState { position_km, velocity_km_s: DVec3::ZERO };
        Spheroid::seen_from(&state, DVec3::Z, RADIUS_KM, FLATTENING)
    }

    #[test]
    fn a_sphere_has_its_textbook_limb() {
        let sphere = Spheroid { stretch: 1.0, ..at(DVec3::X * 6_878.137) };
        let limb = (RADIUS_KM / 6_878.137_f64).asin();
        let off = |angle: f64| DVec3::new(-angle.cos(), angle.sin(), 0.0);
        assert!(sphere.hides(off(limb - 1e-9)) && !sphere.hides(off(limb + 1e-9)), "both sides of the limb");
        assert!((sphere.depth(off(0.0)) - 1.0).abs() < 1e-12 && sphere.depth(DVec3::X) == -1.0, "middle and behind");
        let below = sphere.surface(DVec3::NEG_X).expect("nadir");
        assert!((below.range_km - 500.0).abs() < 1e-9 && below.normal.distance(DVec3::X) < 1e-12);
        assert!((below.towards_observer - 1.0).abs() < 1e-12);
        assert_eq!(sphere.surface(off(limb + 1e-9)), None);
        assert!((sphere.angular_radius_rad() - limb).abs() < 1e-15);
    }

    #[test]
    fn points_are_on_the_spheroid_and_normals_are_geodetic() {
        // By the geodetic formulae: a point of latitude phi has N cos(phi), N (1 - e^2) sin(phi), normal phi.
        let e2 = FLATTENING * (2.0 - FLATTENING);
        for latitude_deg in [0.0_f64, 20.0, 45.0, 70.0, 89.0] {
            let (s, c) = latitude_deg.to_radians().sin_cos();
            let n_km = RADIUS_KM / (1.0 - e2 * s * s).sqrt();
            let point_km = DVec3::new(n_km * c, 0.0, n_km * (1.0 - e2) * s);
            let normal = DVec3::new(c, 0.0, s);
            let side = DVec3::new(-s, 0.0, c);
            let observer_km = point_km + normal * 700.0 + side * 300.0 + DVec3::Y * 200.0;
            let seen = at(observer_km).surface((point_km - observer_km).normalize()).expect("in sight");
            assert!(seen.normal.distance(normal) < 1e-11, "{latitude_deg}: {}", seen.normal);
            assert!((seen.range_km - (700_f64.powi(2) + 300_f64.powi(2) + 200_f64.powi(2)).sqrt()).abs() < 1e-8);
            let sphere = Spheroid { stretch: 1.0, ..at(observer_km) };
            let control = sphere.surface((point_km - observer_km).normalize());
            let off = control.map_or(1.0, |point| point.normal.distance(normal));
            assert!(latitude_deg == 0.0 || off > 1e-5, "control: a sphere's is another");
        }
    }

    #[test]
    fn the_pole_is_21_km_lower() {
        // Seen from far over the equator, the limb is at b / a of the distance above the pole.
        let far_km = 400_000.0;
        let spheroid = at(DVec3::X * far_km);
        let polar_km = RADIUS_KM * (1.0 - FLATTENING);
        let over_pole = |km: f64| (DVec3::new(-far_km, 0.0, km)).normalize();
        // The line touches a little before the pole: (b / d)^2 / 2 of the radius higher.
        let touch_km = polar_km / (1.0 - (RADIUS_KM / far_km).powi(2)).sqrt();
        assert!(spheroid.hides(over_pole(touch_km - 0.01)) && !spheroid.hides(over_pole(touch_km + 0.01)));
        assert!(Spheroid { stretch: 1.0, ..spheroid }.hides(over_pole(touch_km + 21.0)), "control: a sphere is higher");
    }

    #[test]
    fn a_moving_observer_sees_it_ahead() {
        let state = BarycentricState { position_km: DVec3::X * 7_000.0, velocity_km_s: DVec3::Y * 7.5 };
        let moving = Spheroid::seen_from(&state, DVec3::Z, RADIUS_KM, FLATTENING);
        let shift = moving.apparent_centre().angle_between(DVec3::NEG_X);
        assert!((shift - 7.5 / SPEED_OF_LIGHT_KM_S).abs() < 1e-9, "{shift}");
        assert!(moving.apparent_centre().y > 0.0, "towards the motion");
        let limb = (RADIUS_KM / 7_000.0_f64).asin();
        let ahead = |angle: f64| DVec3::new(-angle.cos(), angle.sin(), 0.0);
        // At the limb the shift is that of the light that comes from there: b cos(limb).
        let beta = 7.5 / SPEED_OF_LIGHT_KM_S;
        assert!(moving.hides(ahead(limb + beta * limb.cos() - 1e-8)), "aberration lifts the limb ahead");
        assert!(!moving.hides(ahead(limb + beta * limb.cos() + 1e-8)));
    }
}
