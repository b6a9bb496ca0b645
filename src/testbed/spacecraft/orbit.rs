//! A circular two-body orbit: seconds since its epoch -> place and velocity, ICRF.
//!
//! No precession of the node, no drag: a day's run moves the true node by a few degrees, which changes no answer that
//! this simulator is asked. The Earth's pole is taken as ICRF's (0.14 degrees off in 2026).

use super::params::CircularOrbitParams;
use base::time::Tai;
use glam::DVec3;

/// `GM` of the Earth, m^3/s^2 (IERS Conventions 2010, table 1.1, TT-compatible value).
pub(super) const EARTH_GM_M3_S2: f64 = 3.986_004_415e14;
/// Equatorial radius of the Earth, m (IERS Conventions 2010, table 1.1).
pub(super) const EARTH_RADIUS_M: f64 = 6_378_136.6;

/// A circular orbit.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CircularOrbit {
    epoch: Tai,
    radius_m: f64,
    rate_rad_s: f64,
    argument_rad: f64,
    /// Towards the ascending node.
    node: DVec3,
    /// A quarter of an orbit later.
    quarter: DVec3,
}

impl CircularOrbit {
    /// Returns the orbit of `params`.
    pub fn new(params: &CircularOrbitParams) -> Self {
        let radius_m = EARTH_RADIUS_M + params.altitude_m;
        let (sin_node, cos_node) = params.raan_rad.sin_cos();
        let (sin_i, cos_i) = params.inclination_rad.sin_cos();
        Self {
            epoch: params.epoch,
            radius_m,
            rate_rad_s: (EARTH_GM_M3_S2 / radius_m.powi(3)).sqrt(),
            argument_rad: params.argument_of_latitude_rad,
            node: DVec3::new(cos_node, sin_node, 0.0),
            quarter: DVec3::new(-sin_node * cos_i, cos_node * cos_i, sin_i),
        }
    }

    /// Returns the place with respect to the Earth's centre, ICRF, m.
    pub fn position_m(&self, at: Tai) -> DVec3 {
        self.radial((at - self.epoch).s()) * self.radius_m
    }

    /// Returns the velocity with respect to the Earth's centre, ICRF, m/s: the small part of aberration.
    pub fn velocity_m_s(&self, at: Tai) -> DVec3 {
        let (sin, cos) = self.argument((at - self.epoch).s()).sin_cos();
        (self.quarter * cos - self.node * sin) * (self.radius_m * self.rate_rad_s)
    }

    /// Returns the angular rate of the orbit, rad/s.
    pub fn rate_rad_s(&self) -> f64 {
        self.rate_rad_s
    }

    /// Returns false inside the Earth's shadow, taken as a cylinder away from the Sun (unit vector, ICRF). The penumbra
    /// of a low orbit lasts some ten seconds.
    pub fn is_sunlit(&self, at: Tai, sun_icrf: DVec3) -> bool {
        let position_m = self.position_m(at);
        let along_m = position_m.dot(sun_icrf);
        along_m > 0.0 || (position_m - sun_icrf * along_m).length() > EARTH_RADIUS_M
    }

    /// Returns the unit vector away from the Earth's centre, `t_s` after the epoch.
    pub(super) fn radial(&self, t_s: f64) -> DVec3 {
        let (sin, cos) = self.argument(t_s).sin_cos();
        self.node * cos + self.quarter * sin
    }

    /// Returns `mu / r^3`, 1/s^2.
    pub(super) fn rate_squared(&self) -> f64 {
        self.rate_rad_s * self.rate_rad_s
    }

    fn argument(&self, t_s: f64) -> f64 {
        self.argument_rad + self.rate_rad_s * t_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::time::Span;
    use core::f64::consts::{FRAC_PI_2, PI};

    const EPOCH: Tai = Tai::from_ns(1_700_000_000_000_000_000);

    fn orbit(inclination_rad: f64, raan_rad: f64) -> CircularOrbit {
        CircularOrbit::new(&CircularOrbitParams {
            epoch: EPOCH,
            altitude_m: 600e3,
            inclination_rad,
            raan_rad,
            argument_of_latitude_rad: 0.0,
        })
    }

    #[test]
    fn speed_and_period_are_those_of_600_km() {
        let orbit = orbit(1.7, 0.4);
        // sqrt(398600.44 / 6978.14) km/s and 2 pi 6978.14 / 7.55787 s.
        assert!((orbit.velocity_m_s(EPOCH).length() - 7557.87).abs() < 0.1, "{}", orbit.velocity_m_s(EPOCH));
        assert!((2.0 * PI / orbit.rate_rad_s() - 5801.2).abs() < 0.5, "{} s", 2.0 * PI / orbit.rate_rad_s());
    }

    #[test]
    fn velocity_is_the_derivative_of_the_place_and_the_node_is_where_it_rises() {
        let orbit = orbit(1.0, 0.4);
        let (step, later) = (Span::from_ms(10), EPOCH + Span::from_s(1234.5));
        let slope = (orbit.position_m(later + step) - orbit.position_m(later - step)) / (2.0 * step.s());
        // Rounding of 7e6 m over 20 ms: 1e-7 m/s; curvature 8 m/s^2 rate^2 step^2 / 6: less.
        assert!((slope - orbit.velocity_m_s(later)).length() < 1e-6, "{slope}");
        assert!((orbit.position_m(EPOCH).normalize() - DVec3::new(0.4f64.cos(), 0.4f64.sin(), 0.0)).length() < 1e-15);
        assert!(orbit.velocity_m_s(EPOCH).z > 0.0, "ascending");
        let normal = orbit.position_m(later).cross(orbit.velocity_m_s(later)).normalize();
        assert!((normal.z - 1.0f64.cos()).abs() < 1e-12, "inclination");
    }

    #[test]
    fn shadow_is_behind_the_earth_only() {
        let orbit = orbit(0.0, 0.0);
        assert!(orbit.is_sunlit(EPOCH, DVec3::X), "noon");
        assert!(!orbit.is_sunlit(EPOCH, DVec3::NEG_X), "midnight");
        assert!(orbit.is_sunlit(EPOCH, DVec3::Z), "terminator");
        let quarter = EPOCH + Span::from_s(FRAC_PI_2 / orbit.rate_rad_s() + 60.0);
        assert!(orbit.is_sunlit(quarter, DVec3::X), "behind the terminator but beside the shadow");
    }
}
