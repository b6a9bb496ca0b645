//! Direction from the observer's position -> direction that the moving observer sees.
//!
//! Equation: Lorentz transformation of a light direction, with b = v/c and 1/gamma = sqrt(1 - b^2): u' = (u / gamma +
//! (1 + u.b / (1 + 1/gamma)) b) / (1 + u.b) (Urban and Seidelmann, Explanatory Supplement, 3rd ed., eq. 7.40; the
//! formula of SOFA's `iauAb` without the term of the Sun's potential, which is below 0.5 microarcsec). v is
//! barycentric, so annual and orbital aberration come together. Exact in v. Tests: `annual_constant`,
//! `agrees_with_erfa_ab`.

use base::units::SPEED_OF_LIGHT_KM_S;
use glam::DVec3;

/// Effect of one observer's motion on directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Aberration {
    /// `v / c`.
    speed: DVec3,
    inverse_gamma: f64,
}

impl Aberration {
    /// Computes the aberration of an observer that moves at `velocity_km_s` (barycentric, slower than light).
    pub fn of(velocity_km_s: DVec3) -> Self {
        let speed = velocity_km_s / SPEED_OF_LIGHT_KM_S;
        Self { speed, inverse_gamma: (1.0 - speed.length_squared()).sqrt() }
    }

    /// Returns the observer's velocity over the speed of light, ICRF axes.
    pub fn beta(&self) -> DVec3 {
        self.speed
    }

    /// Returns the direction in which it sees light that one at rest sees in `direction_icrf`; unit vectors.
    #[inline]
    pub fn aberrated(&self, direction_icrf: DVec3) -> DVec3 {
        let Self { speed, inverse_gamma } = *self;
        let along = 1.0 + direction_icrf.dot(speed) / (1.0 + inverse_gamma);
        // The factor 1 / (1 + u.b) changes the length only.
        (direction_icrf * inverse_gamma + speed * along).normalize()
    }
}

impl Aberration {
    /// Returns the direction in which an observer at rest sees light that the moving one sees in `seen_icrf`: the same
    /// transformation with the velocity reversed, exactly.
    pub fn undone(&self, seen_icrf: DVec3) -> DVec3 {
        Self { speed: -self.speed, ..*self }.aberrated(seen_icrf)
    }
}

/// Returns the direction of light seen by an observer moving at `velocity_km_s` (barycentric, slower than light), where
/// one at rest sees `direction_icrf`; unit vectors.
pub fn aberrated(direction_icrf: DVec3, velocity_km_s: DVec3) -> DVec3 {
    Aberration::of(velocity_km_s).aberrated(direction_icrf)
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::units::{ARCSEC, MAS};

    /// Rounding of a unit vector: a few ulp, 1e-10 arcsec.
    const ROUNDING_RAD: f64 = 1e-15;

    #[test]
    fn annual_constant() {
        // Constant of aberration 20.49551 arcsec (IAU 1976 system; Urban and Seidelmann, table 16.1): mean orbital
        // speed
        // 29.7847 km/s over c, divided by sqrt(1 - e^2) -> kappa = 20.4955 for 29.7889 km/s.
        let seen = aberrated(DVec3::X, DVec3::Y * 29.788_9);
        assert!((seen.angle_between(DVec3::X) / ARCSEC - 20.495_51).abs() < 2e-4, "{}", seen.angle_between(DVec3::X));
        assert!(seen.y > 0.0, "towards the direction of motion");
    }

    #[test]
    fn agrees_with_erfa_ab() {
        // The vector of SOFA's test of iauAb (t_sofa_c), evaluated with erfa.ab of pyerfa 2.0.1.
        let natural = DVec3::new(-0.763_219_685_467_379_5, -0.608_694_539_830_603_8, -0.216_764_085_806_398_83);
        let beta = DVec3::new(2.104_401_889_365_378_6e-5, -8.910_892_330_442_932e-5, -3.863_371_479_771_657e-5);
        let wanted = DVec3::new(-0.763_163_109_421_955_6, -0.608_755_308_250_559_1, -0.216_792_626_936_847_12);
        let got = aberrated(natural, beta * SPEED_OF_LIGHT_KM_S);
        // The potential's term that is left out: 1.97e-8 au x |v| / s = 2e-12 rad.
        assert!(got.distance(wanted) < 4e-12, "{:.2e} rad", got.distance(wanted));
        assert!(natural.distance(wanted) > 1e-5, "control: without aberration the vectors differ");
    }

    #[test]
    fn motion_along_the_line_of_sight_or_none_changes_nothing() {
        assert_eq!(aberrated(DVec3::X, DVec3::ZERO), DVec3::X);
        assert!(aberrated(DVec3::X, DVec3::X * 30.0).distance(DVec3::X) < ROUNDING_RAD);
        let away = aberrated(DVec3::X, DVec3::NEG_Y * 7.6);
        assert!(away.angle_between(DVec3::X) > 5_000.0 * MAS, "control: 7.6 km/s is 5.2 arcsec");
    }

    #[test]
    fn the_opposite_velocity_undoes_it() {
        let star = DVec3::new(0.3, -0.8, 0.5).normalize();
        let v = DVec3::new(10.0, 25.0, -12.0);
        assert!(aberrated(aberrated(star, v), -v).distance(star) < 4.0 * ROUNDING_RAD);
    }
}
