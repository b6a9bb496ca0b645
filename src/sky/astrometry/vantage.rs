//! Where one observer is at one time, and what that does to a direction: deflection by the Sun, then aberration.
//!
//! Made once per frame, used for every star of it. Tests: below and `tests/physics/apparent_vectors.rs`.
//!
//! *Aberration.* Direction from the observer's position -> direction that the moving observer sees.
//!
//! Equation: Lorentz transformation of a light direction, with b = v/c and 1/gamma = sqrt(1 - b^2): u' = (u / gamma +
//! (1 + u.b / (1 + 1/gamma)) b) / (1 + u.b) (Urban and Seidelmann, Explanatory Supplement, 3rd ed., eq. 7.40; the
//! formula of SOFA's `iauAb` without the term of the Sun's potential, which is below 0.5 microarcsec). v is
//! barycentric, so annual and orbital aberration come together. Exact in v. Tests: `annual_constant`,
//! `agrees_with_erfa_ab`.
//!
//! *Deflection.* Direction -> direction after the bending of its light by the Sun.
//!
//! Equation: u' = u + (2 GM / c^2 r) / max(1 + u.e, limit) u x (e x u), for a star at infinity; e is the direction from
//! the Sun to the observer and r their distance (Urban and Seidelmann, Explanatory Supplement, 3rd ed., eq. 7.63; the
//! formula and the limit of SOFA's `iauLdsun`). Size at 1 au: 4.07 mas x cot(elongation / 2): 0.4 at 170 degrees, 4 at
//! 90, 10 at 45, 23 at 20, 47 at 10, 93 at 5, 1750 at the limb.
//!
//! Limit: within 0.08 deg of the Sun's centre (at 1 au, a third of its radius) it goes to zero: nothing is seen there.
//! Other bodies are left out: at its limb Jupiter bends by 16 mas (1 mas at 5 arcmin from it), Saturn by 6 (1 mas at 1
//! arcmin), the Earth by 0.6, the Moon by 0.03. Test: `agrees_with_erfa_ldsun`.

use crate::{observer::ObserverTrack, state::BarycentricState};
use base::units::{AU_KM, MAS, SPEED_OF_LIGHT_KM_S};
use base::{refused::Refused, time::Tai};
use glam::DVec3;

/// Parallax of the nearest star, Proxima Centauri, rad (768.07 mas, Gaia DR3), rounded up.
const LARGEST_PARALLAX_RAD: f64 = 769.0 * MAS;

/// Steps of the inverse of deflection: each is 500 times nearer at the Sun's limb, and more away from it.
const STRAIGHTENING_STEPS: u32 = 5;

/// Place and motion of an observer, and of what bends light.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vantage {
    /// Barycentric place and motion of the observer.
    pub observer: BarycentricState,
    /// Where the observer is from the Sun's centre, ICRF axes; `None`: light is not bent.
    pub heliocentric_km: Option<DVec3>,
}

/// Effect of a vantage on directions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    deflection: Option<Deflection>,
    aberration: Aberration,
}

impl Sight {
    /// Returns the observer's velocity about the barycentre over the speed of light, ICRF axes.
    pub fn observer_beta(&self) -> DVec3 {
        self.aberration.beta()
    }

    /// Returns an apparent direction, as [`Vantage::apparent`].
    #[inline]
    pub fn apparent(&self, natural_icrf: DVec3) -> DVec3 {
        let arriving = self.deflection.map_or(natural_icrf, |deflection| deflection.deflected(natural_icrf));
        self.aberration.aberrated(arriving)
    }

    /// Returns the direction from the observer's place of what it sees in the direction `apparent_icrf`: without
    /// aberration and deflection. The inverse of [`Self::apparent`], to rounding, but behind the Sun's disc.
    pub fn natural(&self, apparent_icrf: DVec3) -> DVec3 {
        let arriving = self.aberration.undone(apparent_icrf);
        let Some(deflection) = &self.deflection else { return arriving };
        let straighter = |natural: DVec3| (arriving - (deflection.deflected(natural) - natural)).normalize();
        (0..STRAIGHTENING_STEPS).fold(arriving, |natural, _| straighter(natural))
    }
}

impl From<BarycentricState> for Vantage {
    /// Makes a vantage without deflection of light.
    fn from(observer: BarycentricState) -> Self {
        Self { observer, heliocentric_km: None }
    }
}

impl Vantage {
    /// Returns that of a followed observer at `at`; at the barycentre no light is bent. Does not allocate.
    ///
    /// # Errors
    /// When the observer's orbit cannot be computed at that time.
    pub fn of(track: &ObserverTrack, at: Tai, light_deflection: bool) -> Result<Self, Refused> {
        let observer = track.barycentric_state(at)?;
        let bends = light_deflection && !track.is_barycentre();
        let heliocentric_km = bends.then(|| observer.position_km - track.sun_state(at).position_km);
        Ok(Self { observer, heliocentric_km })
    }

    /// Returns the direction in which the observer sees what is in the direction `natural_icrf` from its place; unit
    /// vectors. For many of them: [`Self::sight`].
    pub fn apparent(&self, natural_icrf: DVec3) -> DVec3 {
        self.sight().apparent(natural_icrf)
    }

    /// Returns its effect on directions, computed once.
    pub fn sight(&self) -> Sight {
        let deflection = self.heliocentric_km.map(Deflection::at);
        Sight { deflection, aberration: Aberration::of(self.observer.velocity_km_s) }
    }

    /// Returns how far a star beside the Sun's disc may be seen from its barycentric direction, rad: parallax of the
    /// nearest, and deflection, and aberration, which turns no direction by more than asin(v / c).
    pub fn margin_rad(&self) -> f64 {
        let BarycentricState { position_km, velocity_km_s } = self.observer;
        let parallax_rad = LARGEST_PARALLAX_RAD * position_km.length() / AU_KM;
        let aberration_rad = (velocity_km_s.length() / SPEED_OF_LIGHT_KM_S).min(1.0).asin();
        let deflection_rad = if self.heliocentric_km.is_some() { MOST_RAD } else { 0.0 };
        parallax_rad + deflection_rad + aberration_rad
    }
}

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

/// Twice the Sun's gravitational radius GM / c^2, in au (SOFA `SRS`).
const SCHWARZSCHILD_AU: f64 = 1.974_125_743_36e-8;
/// Least 1 + u.e at 1 au or nearer; farther away it shrinks with the square of the distance, as the Sun's disc does.
const LEAST_OPENING: f64 = 1e-6;
/// Most that light from beside the Sun's disc can be bent, rad: 1.75 arcsec at the limb, from any distance.
pub(super) const MOST_RAD: f64 = 1.8 * base::units::ARCSEC;

/// Effect of the Sun's gravity on light on its way to one place.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Deflection {
    away_from_sun: DVec3,
    /// `2 GM / c^2 r`.
    strength: f64,
    least_opening: f64,
}

impl Deflection {
    /// Computes the deflection for an observer at `heliocentric_km` from the Sun's centre.
    pub fn at(heliocentric_km: DVec3) -> Self {
        let distance_au = heliocentric_km.length() / AU_KM;
        Self {
            away_from_sun: heliocentric_km / (distance_au * AU_KM),
            strength: SCHWARZSCHILD_AU / distance_au,
            least_opening: LEAST_OPENING / (distance_au * distance_au).max(1.0),
        }
    }

    /// Returns the direction of light that came from `direction_icrf` (unit vector). Its length is 1 to 1e-10.
    #[inline]
    pub fn deflected(&self, direction_icrf: DVec3) -> DVec3 {
        let away = direction_icrf.dot(self.away_from_sun);
        // u x (e x u) = e - u (u.e) for a unit vector.
        let across = self.away_from_sun - direction_icrf * away;
        direction_icrf + across * (self.strength / (1.0 + away).max(self.least_opening))
    }
}

/// Returns the direction of light that came from `direction_icrf` (unit vector) at `heliocentric_km` from the Sun's
/// centre.
pub fn deflected(direction_icrf: DVec3, heliocentric_km: DVec3) -> DVec3 {
    Deflection::at(heliocentric_km).deflected(direction_icrf)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::astrometry::{aberrated, parallax_shifted};
    use base::units::{ARCSEC, DEG};

    #[test]
    fn the_margin_covers_every_direction_and_hardly_more() {
        for (speed_km_s, distance_au) in [(30.0, 1.0), (60.0, 5.0), (0.0, 30.0), (2_998.0, 0.02), (0.0, 0.0)] {
            let position_km = DVec3::Y * (distance_au * AU_KM);
            let observer = BarycentricState { position_km, velocity_km_s: DVec3::X * speed_km_s };
            let vantage = Vantage { observer, heliocentric_km: (distance_au > 0.01).then_some(position_km) };
            let mut farthest_rad = 0.0_f64;
            for tenth_deg in 0..3600 {
                let (sin, cos) = (f64::from(tenth_deg) * 0.1 * DEG).sin_cos();
                // Both in the plane of motion and place, and across it.
                for star in [DVec3::new(cos, sin, 0.0), DVec3::new(cos, 0.0, sin), DVec3::new(0.0, cos, sin)] {
                    let beside_disc = star.angle_between(-position_km) > (696e3 / position_km.length()).min(1.0).asin();
                    let seen = vantage.apparent(parallax_shifted(star, 768.07, position_km));
                    farthest_rad = farthest_rad.max(if beside_disc { seen.angle_between(star) } else { 0.0 });
                }
            }
            let margin_rad = vantage.margin_rad();
            assert!(farthest_rad <= margin_rad + 1e-12, "{speed_km_s} km/s: {} arcsec", farthest_rad / ARCSEC);
            assert!(
                farthest_rad > 0.7 * margin_rad - 2.0 * MOST_RAD,
                "{speed_km_s}: {} {}",
                farthest_rad / ARCSEC,
                margin_rad / ARCSEC
            );
        }
    }

    #[test]
    fn natural_directions_come_back_from_apparent_ones() {
        let velocity_km_s = DVec3::new(4.0, 28.0, -11.0);
        let observer = BarycentricState { position_km: DVec3::X * AU_KM, velocity_km_s };
        for heliocentric_km in [None, Some(observer.position_km)] {
            let sight = Vantage { observer, heliocentric_km }.sight();
            for elongation_deg in [0.3, 1.0, 30.0, 90.0, 179.0] {
                let (sin, cos) = (elongation_deg * DEG).sin_cos();
                let star = DVec3::new(-cos, 0.6 * sin, 0.8 * sin);
                let seen = sight.apparent(star);
                assert!(sight.natural(seen).distance(star) < 1e-14, "{elongation_deg} deg from the Sun");
                assert!(seen.distance(star) > 1.0 * ARCSEC, "control: aberration has moved it");
            }
        }
    }

    #[test]
    fn deflection_comes_before_aberration() {
        let observer = BarycentricState { position_km: DVec3::X * AU_KM, velocity_km_s: DVec3::Y * 30.0 };
        let star = DVec3::new(-(10.0 * DEG).cos(), (10.0 * DEG).sin(), 0.0);
        let [plain, bent] =
            [None, Some(observer.position_km)].map(|from_sun| Vantage { observer, heliocentric_km: from_sun });
        assert_eq!(plain.apparent(star), aberrated(star, observer.velocity_km_s));
        let added_mas = bent.apparent(star).angle_between(plain.apparent(star)) / MAS;
        assert!((added_mas - 46.6).abs() < 0.2, "4.07 mas cot 5 deg: {added_mas}");
        assert_eq!(Vantage::from(observer), plain);
    }
}

#[cfg(test)]
mod aberration_tests {
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

#[cfg(test)]
mod deflection_tests {
    use super::*;
    use base::units::{ARCSEC, DEG, MAS};

    /// Returns the direction at `elongation_deg` from the Sun for an observer at +X of it.
    fn at(elongation_deg: f64) -> DVec3 {
        let (sin, cos) = (elongation_deg * DEG).sin_cos();
        DVec3::new(-cos, sin, 0.0)
    }

    fn bent_mas(elongation_deg: f64, distance_au: f64) -> f64 {
        deflected(at(elongation_deg), DVec3::X * (distance_au * AU_KM)).distance(at(elongation_deg)) / MAS
    }

    /// Elongation deg, distance au, deflection mas by erfa.ldsun (pyerfa 2.0.1.5).
    const LDSUN: [[f64; 3]; 10] = [
        [170.0, 1.0, 0.356247],
        [90.0, 1.0, 4.071927],
        [45.0, 1.0, 9.830501],
        [20.0, 1.0, 23.093044],
        [10.0, 1.0, 46.542334],
        [5.0, 1.0, 93.262453],
        [2.0, 1.0, 233.280521],
        [0.27, 1.0, 1728.176142],
        [30.0, 0.3, 50.655457],
        [10.0, 10.0, 4.654233],
    ];

    #[test]
    fn agrees_with_erfa_ldsun() {
        for [elongation_deg, distance_au, wanted_mas] in LDSUN {
            let got_mas = bent_mas(elongation_deg, distance_au);
            assert!(
                (got_mas - wanted_mas).abs() < 1e-5 * wanted_mas + 1e-6,
                "{elongation_deg}: {got_mas} {wanted_mas}"
            );
        }
        assert!((bent_mas(90.0, 1.0) - bent_mas(80.0, 1.0)).abs() > 0.5, "control: it depends on the elongation");
    }

    #[test]
    fn stars_are_pushed_away_from_the_sun() {
        let seen = deflected(at(10.0), DVec3::X * AU_KM);
        assert!(seen.angle_between(DVec3::NEG_X) > at(10.0).angle_between(DVec3::NEG_X));
        assert!((seen.length() - 1.0).abs() < 1e-10, "{}", seen.length());
    }

    #[test]
    fn the_limb_bends_most_and_the_limit_is_behind_the_disc() {
        for distance_au in [0.1, 1.0, 30.0] {
            let limb_deg = (695_700.0 / (distance_au * AU_KM)).asin() / DEG;
            let limb_arcsec = bent_mas(limb_deg, distance_au) * MAS / ARCSEC;
            assert!((limb_arcsec - 1.75).abs() < 0.01, "{limb_arcsec} at {distance_au} au");
            assert!(limb_arcsec * ARCSEC < MOST_RAD);
            // Beyond the limb the limit changes nothing; at the centre nothing is bent.
            let unlimited = 2.0 * SCHWARZSCHILD_AU / distance_au / (limb_deg * DEG) / MAS;
            assert!((bent_mas(limb_deg, distance_au) / unlimited - 1.0).abs() < 3e-3, "{distance_au} au");
            assert!(bent_mas(1e-4 * limb_deg, distance_au) < bent_mas(limb_deg, distance_au));
        }
        assert_eq!(deflected(DVec3::NEG_X, DVec3::X * AU_KM), DVec3::NEG_X, "through the centre");
    }
}
