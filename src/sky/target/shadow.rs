//! Target, Sun, Earth -> how much of the Sun the target sees, and whether the Earth is between it and the observer.
//!
//! The Sun's disc is covered by the Earth's as two circles cover each other (Montenbruck and Gill, Satellite Orbits,
//! 2000, sec. 3.4.2): umbra and penumbra of a conical shadow. The Earth is the ellipsoid of WGS 84 about the ICRF's
//! pole (0.15 deg from its own in 2026: 50 m of the flattening's 21 km), taken by scaling the polar axis, which keeps
//! lines of sight straight and makes a sphere of it: exact for the limb, within 0.2 % of the Sun's disc for the shadow.
//! No atmosphere: real shadows begin some 10 km higher and are red within; the light of the Earth itself on targets is
//! left out. Limits: a target above the surface. Tests: below, against the times of a flat triangle.

use glam::DVec3;

/// Equatorial radius of the Earth, km (WGS 84).
const EARTH_RADIUS_KM: f64 = 6_378.137;
/// Equatorial over polar radius (WGS 84, flattening 1 / 298.257 223 563).
const OBLATENESS: f64 = 1.003_364_090;
/// Nominal solar radius, km (IAU 2015 Resolution B3).
const SUN_RADIUS_KM: f64 = 695_700.0;

/// How the Sun shines on a target.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sunlight {
    /// All of the disc is seen.
    Full,
    /// A part of it.
    Penumbra,
    /// Nothing of it.
    Umbra,
}

impl Sunlight {
    /// Returns the kind of light for a share of the Sun's light.
    pub fn of_share(share: f64) -> Self {
        if share >= 1.0 {
            Self::Full
        } else if share > 0.0 {
            Self::Penumbra
        } else {
            Self::Umbra
        }
    }

    /// Returns its word in tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Full => "sunlit",
            Self::Penumbra => "penumbra",
            Self::Umbra => "umbra",
        }
    }
}

/// Returns axes in which the Earth is a sphere of its equatorial radius.
fn rounded(geocentric_km: DVec3) -> DVec3 {
    DVec3::new(geocentric_km.x, geocentric_km.y, geocentric_km.z * OBLATENESS)
}

/// Returns the share of the Sun's disc that a target at `target_km` sees past the Earth, 0 to 1; both from the
/// geocentre, km.
pub fn sunlight(target_km: DVec3, sun_km: DVec3) -> f64 {
    let (target, sun) = (rounded(target_km), rounded(sun_km));
    let (to_sun, to_earth) = (sun - target, -target);
    let sun_rad = (SUN_RADIUS_KM / to_sun.length()).asin();
    let earth_rad = (EARTH_RADIUS_KM / to_earth.length().max(EARTH_RADIUS_KM)).asin();
    1.0 - covered_share(sun_rad, earth_rad, to_sun.angle_between(to_earth))
}

/// Returns the share of a circle of radius `a` that one of radius `b`, `c` away, covers.
fn covered_share(a: f64, b: f64, c: f64) -> f64 {
    if c >= a + b {
        return 0.0;
    }
    if c <= b - a {
        return 1.0;
    }
    if c <= a - b {
        return (b / a).powi(2);
    }
    let x = (c * c + a * a - b * b) / (2.0 * c);
    let y = (a * a - x * x).max(0.0).sqrt();
    let segments = a * a * (x / a).clamp(-1.0, 1.0).acos() + b * b * ((c - x) / b).clamp(-1.0, 1.0).acos() - c * y;
    (segments / (core::f64::consts::PI * a * a)).clamp(0.0, 1.0)
}

/// Returns how far above the limb the line of sight from `observer_km` to `target_km` passes, km (from the geocentre,
/// both); negative when the Earth is between. An observer inside the Earth, as at its centre, sees through it.
pub fn limb_clearance_km(observer_km: DVec3, target_km: DVec3) -> f64 {
    let (observer, target) = (rounded(observer_km), rounded(target_km));
    if observer.length() < EARTH_RADIUS_KM {
        return f64::INFINITY;
    }
    let way = target - observer;
    let nearest = (-observer.dot(way) / way.length_squared()).clamp(0.0, 1.0);
    (observer + nearest * way).length() - EARTH_RADIUS_KM
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::units::AU_KM;
    use core::f64::consts::PI;

    #[test]
    fn entry_and_exit_are_those_of_the_cone() {
        // A target on a circle of radius r whose plane holds the Sun. The tangents that Sun and Earth have in common
        // make cones: inside the umbra's at distance x behind the Earth, less than (R - x (S - R) / D) / cos(half
        // angle) from the axis; written with angles at the geocentre: the edge is where the target is asin(R / r) -
        // (asin((S -+ R) / D)) from the axis. Equatorial plane: the sphere is exact there.
        let (earth, sun_radius, distance) = (EARTH_RADIUS_KM, SUN_RADIUS_KM, AU_KM);
        let sun = DVec3::X * distance;
        for altitude_km in [500.0, 35_786.0] {
            let r = earth + altitude_km;
            let on_circle = |angle: f64| DVec3::new(-r * angle.cos(), r * angle.sin(), 0.0);
            let tangent = |sum: f64| (earth / r).asin() + sum;
            let umbra = tangent(-((sun_radius - earth) / distance).asin());
            let penumbra = tangent(((sun_radius + earth) / distance).asin());
            let edge = |wanted: f64, angle: f64| {
                let [inside, outside] = [angle - 2e-7, angle + 2e-7].map(|angle| sunlight(on_circle(angle), sun));
                assert!(
                    if wanted > 0.5 { inside < 1.0 && outside >= 1.0 } else { inside <= 0.0 && outside > 0.0 },
                    "{altitude_km} km, edge of {wanted}: {inside} {outside}"
                );
            };
            edge(0.0, umbra);
            edge(1.0, penumbra);
            // Half of the light where the limb cuts the disc in the middle, nearly: its curve is the larger one's.
            let middle = sunlight(on_circle(0.5 * (umbra + penumbra)), sun);
            assert!((middle - 0.5).abs() < 0.02, "{middle}");
        }
    }

    #[test]
    fn a_low_orbit_crosses_the_penumbra_in_eight_seconds() {
        // 0.53 deg of the Sun at 360 deg in 94.6 min, where the orbit's plane holds the Sun: 8.4 s.
        let (sun, r) = (DVec3::X * AU_KM, EARTH_RADIUS_KM + 500.0);
        let share = |t_s: f64| {
            let angle = 2.0 * PI * t_s / (94.6 * 60.0);
            sunlight(DVec3::new(-r * angle.cos(), r * angle.sin(), 0.0), sun)
        };
        let partial = (0..200_000).filter(|i| Sunlight::of_share(share(f64::from(*i) * 0.01)) == Sunlight::Penumbra);
        let penumbra_s = partial.count() as f64 * 0.01;
        assert!((penumbra_s - 8.4).abs() < 0.1, "{penumbra_s} s");
        assert_eq!(Sunlight::of_share(share(0.0)), Sunlight::Umbra);
        assert_eq!(Sunlight::of_share(share(2_000.0)), Sunlight::Full);
    }

    #[test]
    fn circles_cover_each_other() {
        assert!((covered_share(1.0, 1.0, 0.0) - 1.0).abs() < 1e-15);
        assert!((covered_share(2.0, 1.0, 0.5) - 0.25).abs() < 1e-15, "an annular eclipse");
        // Unit circles a radius apart: 2 pi / 3 - sqrt(3) / 2 of pi.
        assert!((covered_share(1.0, 1.0, 1.0) - (2.0 / 3.0 - 3.0_f64.sqrt() / (2.0 * PI))).abs() < 1e-14);
        assert!(covered_share(1.0, 1.0, 2.0) <= 0.0 && covered_share(1.0, 1.0, 1.999) > 0.0);
    }

    #[test]
    fn the_limb_is_the_ellipsoids() {
        let b = EARTH_RADIUS_KM / OBLATENESS;
        assert!((b - 6_356.752_314).abs() < 1e-5, "polar radius of WGS 84: {b}");
        let [left, right] = [DVec3::new(-9_000.0, 0.0, b + 1.0), DVec3::new(9_000.0, 0.0, b + 1.0)];
        assert!((limb_clearance_km(left, right) - OBLATENESS).abs() < 1e-6, "over the pole");
        let [left, right] = [left, right].map(|v| v - DVec3::Z * 2.0);
        assert!(limb_clearance_km(left, right) < 0.0, "below the pole's height");
        assert!(limb_clearance_km(left, left * 2.0) > 1_000.0, "away from the Earth");
        assert!(limb_clearance_km(DVec3::ZERO, right).is_infinite(), "the geocentre sees through");
        let behind = limb_clearance_km(DVec3::X * 7_000.0, DVec3::X * -42_000.0);
        assert!((behind + EARTH_RADIUS_KM).abs() < 1e-9, "through the centre: {behind}");
    }
}
