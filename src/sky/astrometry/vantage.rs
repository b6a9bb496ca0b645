//! Where one observer is at one time, and what that does to a direction: deflection by the Sun, then aberration.
//!
//! Made once per frame, used for every star of it. Tests: below and `tests/physics/apparent_vectors.rs`.

use super::aberration::Aberration;
use super::deflection::{Deflection, MOST_RAD};
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
