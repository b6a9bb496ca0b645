//! Targets about the Earth: time and observer -> where a target is, how far, how it is lit, how bright it is.
//!
//! * [`Orbit`]: any of the orbits of [`crate::orbit`], followed from the geocentre;
//! * [`Sighting`]: the target as its light left it, seen from the observer; range, rates, phase;
//! * [`Sunlight`]: full light, penumbra or umbra of the Earth, and what the Earth itself covers;
//! * [`Brightness`]: magnitude from size and reflectance, from a magnitude at 1000 km, or as given.
//!
//! Directions here are those of light that arrives at the observer's place; the aberration by the observer's motion is
//! `astrometry`'s, as for stars.
//!
//! The light that arrives at `at` left the target one light time earlier, and in that time target and Earth moved on:
//! with geocentric g(t) of the target, o(t) of the observer and the Earth's barycentric velocity V, the light comes
//! from `g(t - tau) - V tau - o(t)`, whose length is `c tau` (Urban and Seidelmann, Explanatory Supplement, 3rd ed.,
//! sec. 7.2.3, for an object whose motion is known from the geocentre). Solved by two steps from the geometric
//! distance, the second along the velocity: what is left, tau (v/c)^2, is 1e-8 of the light time. The Earth's own
//! acceleration within it (1 s to the Moon) is 3 m. Between two low orbits 1000 km apart light time moves a target by 5
//! arcsec, and V tau, which the aberration by the Earth's motion undoes nearly whole, by 20. Deflection of light by the
//! Earth: below 1 mas, left out. Tests: below against a fixed point of its own; `hil_scripts/tests/test_targets.py` against
//! another program.

mod light;

pub use light::{
    Brightness, MOST_PHASE_POINTS, PhaseCurve, SUN_BP_RP, SUN_MAG_G, Sunlight, limb_clearance_km, sphere_phase,
    sunlight,
};

use crate::orbit::{CentralBody, CircularOrbit, TleOrbit, TwoBodyOrbit};
use crate::{followed::check_state, state::BarycentricState};
use base::time::{Span, Tai};
use base::{refused::Refused, units::SPEED_OF_LIGHT_KM_S};
use glam::DVec3;

/// How a target flies about the Earth.
#[derive(Debug, Clone)]
pub enum Orbit {
    /// By mean elements and SGP4.
    Sgp4(Box<TleOrbit>),
    /// In a circle.
    Circular(CircularOrbit),
    /// On a conic about the Earth's centre.
    TwoBody(TwoBodyOrbit),
}

impl Orbit {
    /// Returns the state from the geocentre, ICRF axes.
    ///
    /// # Errors
    /// When SGP4 cannot follow the elements to `at`.
    pub fn geocentric_state(&self, at: Tai) -> Result<BarycentricState, Refused> {
        match self {
            Self::Sgp4(orbit) => orbit.geocentric_state(at),
            Self::Circular(orbit) => Ok(orbit.geocentric_state(at)),
            Self::TwoBody(orbit) => Ok(orbit.state(at)),
        }
    }

    /// Checks that the target can be where the orbit has it at an instant.
    ///
    /// # Errors
    /// As for [`Self::geocentric_state`], and when it is below the ground or faster than anything about the Earth.
    pub fn check_at(&self, at: Tai) -> Result<(), Refused> {
        check_state(CentralBody::Earth, at, self.geocentric_state(at)?)
    }
}

/// A target as its light left it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// From where the observer is to where the light left, km, ICRF axes.
    pub from_observer_km: DVec3,
    /// The target from the geocentre when the light left.
    pub target: BarycentricState,
    /// The observer from the geocentre when the light arrives.
    pub observer: BarycentricState,
    /// How long the light was under way, s.
    pub light_time_s: f64,
}

impl Sighting {
    /// Returns the target of `orbit` as `observer` (from the geocentre) sees it at `at`; two evaluations of the orbit.
    ///
    /// # Errors
    /// When SGP4 cannot follow the elements.
    pub fn of(
        orbit: &Orbit,
        observer: &BarycentricState,
        earth_velocity_km_s: DVec3,
        at: Tai,
    ) -> Result<Self, Refused> {
        let seconds = |km: DVec3| km.length() / SPEED_OF_LIGHT_KM_S;
        let first_s = seconds(orbit.geocentric_state(at)?.position_km - observer.position_km);
        let then = orbit.geocentric_state(at - Span::from_s(first_s))?;
        let from_observer_km = |light_time_s: f64| {
            let target_km = then.position_km - then.velocity_km_s * (light_time_s - first_s);
            target_km - earth_velocity_km_s * light_time_s - observer.position_km
        };
        let light_time_s = seconds(from_observer_km(first_s));
        let from_observer_km = from_observer_km(light_time_s);
        Ok(Self { from_observer_km, target: then, observer: *observer, light_time_s })
    }

    /// Returns the distance, km.
    pub fn range_km(&self) -> f64 {
        self.from_observer_km.length()
    }

    /// Returns how fast the distance grows, km/s.
    pub fn range_rate_km_s(&self) -> f64 {
        self.velocity_km_s().dot(self.from_observer_km.normalize())
    }

    /// Returns how fast the direction turns with respect to the stars, rad/s.
    pub fn rate_rad_s(&self) -> f64 {
        let from = self.from_observer_km;
        from.cross(self.velocity_km_s()).length() / from.length_squared()
    }

    /// Returns the velocity from the observer, km/s.
    pub fn velocity_km_s(&self) -> DVec3 {
        self.target.velocity_km_s - self.observer.velocity_km_s
    }

    /// Returns the angle at the target between the Sun (`sun_km` from the geocentre) and the observer, rad: 0 when it
    /// is lit as a full moon is.
    pub fn phase_rad(&self, sun_km: DVec3) -> f64 {
        (sun_km - self.target.position_km).angle_between(-self.from_observer_km)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use base::units::{ARCSEC, DEG};

    /// Returns two circles whose bodies pass each other within a thousand kilometres.
    fn pair() -> (Orbit, CircularOrbit, Tai) {
        let at = Tai::from_rfc3339("2026-03-01T00:00:00Z").expect("a valid instant");
        let target = CircularOrbit::new(900.0, 60.0, 33.0, 14.0, at).expect("a valid orbit");
        let observer = CircularOrbit::new(550.0, 97.4, 30.0, 10.0, at).expect("a valid orbit");
        (Orbit::Circular(target), observer, at)
    }

    #[test]
    fn light_leaves_when_it_must_to_arrive() {
        let (orbit, observer, at) = pair();
        let (here, earth_km_s) = (observer.geocentric_state(at), DVec3::new(-10.4, -25.9, -11.2));
        let sighting = Sighting::of(&orbit, &here, earth_km_s, at).expect("a circle");
        // The same by bisection in the light time: c tau is the distance from where the light left.
        let from = |tau_s: f64| {
            let then = orbit.geocentric_state(at - Span::from_s(tau_s)).expect("a circle").position_km;
            then - earth_km_s * tau_s - here.position_km
        };
        let (mut low_s, mut high_s) = (0.0, 0.1);
        for _ in 0..60 {
            let tau_s = 0.5 * (low_s + high_s);
            let is_early = from(tau_s).length() > SPEED_OF_LIGHT_KM_S * tau_s;
            (low_s, high_s) = if is_early { (tau_s, high_s) } else { (low_s, tau_s) };
        }
        // Spans are whole nanoseconds: 8 micrometres of an orbit.
        assert!(sighting.from_observer_km.distance(from(low_s)) < 1e-7, "{}", sighting.from_observer_km);
        let geometric = orbit.geocentric_state(at).expect("a circle").position_km - here.position_km;
        let own = sighting.from_observer_km + earth_km_s * sighting.light_time_s;
        let moved_arcsec = own.angle_between(geometric) / ARCSEC;
        assert!((1.0..8.0).contains(&moved_arcsec), "control: light time alone moves it by {moved_arcsec} arcsec");
    }

    #[test]
    fn rates_are_those_of_differences() {
        let (orbit, observer, at) = pair();
        let sight = |at: Tai| Sighting::of(&orbit, &observer.geocentric_state(at), DVec3::ZERO, at).expect("a circle");
        let (before, now, after) = (sight(at - Span::from_ms(50)), sight(at), sight(at + Span::from_ms(50)));
        let range_rate = (after.range_km() - before.range_km()) / 0.1;
        let rate = after.from_observer_km.angle_between(before.from_observer_km) / 0.1;
        // Left out of the rates: that the light time changes, v/c of them.
        assert!((now.range_rate_km_s() - range_rate).abs() < 1e-3, "{} {range_rate}", now.range_rate_km_s());
        assert!((now.rate_rad_s() / rate - 1.0).abs() < 1e-4, "{} {rate}", now.rate_rad_s());
        assert!(rate > 0.05 * DEG, "control: a pass, {rate} rad/s");
    }

    /// Two bodies on circles in one plane, `psi` apart as seen from the geocentre: the angular rate seen from one by
    /// the law of cosines and the law of sines, as in the plane triangle of geocentre, platform and target: distance
    /// `d^2 = R^2 + r^2 - 2 R r cos(psi)`, and the rate of the line between them `(n_t r (r - R cos psi) + n_o R (R - r
    /// cos psi)) / d^2`.
    #[test]
    fn coplanar_circles_turn_as_the_triangle_says() {
        const GM: f64 = 398_600.441_8;
        let at = Tai::from_rfc3339("2026-03-01T00:00:00Z").expect("a valid instant");
        for (high_km, low_km, psi_deg) in [(35_786.0, 550.0, 40.0), (900.0, 550.0, 5.0), (550.0, 900.0, 5.0)] {
            let platform = CircularOrbit::new(high_km, 97.4, 30.0, 10.0, at).expect("a valid orbit");
            let target = CircularOrbit::new(low_km, 97.4, 30.0, 10.0 + psi_deg, at).expect("a valid orbit");
            let here = platform.geocentric_state(at);
            let seen = Sighting::of(&Orbit::Circular(target), &here, DVec3::ZERO, at).expect("a circle");
            let [big, small] = [high_km, low_km].map(|km| km + 6_378.137);
            let [n_o, n_t] = [big, small].map(|r: f64| (GM / r.powi(3)).sqrt());
            // As seen when the light left: the target was that much earlier on its orbit.
            let psi = psi_deg * DEG - n_t * seen.light_time_s;
            let distance = (big * big + small * small - 2.0 * big * small * psi.cos()).sqrt();
            assert!((seen.range_km() / distance - 1.0).abs() < 1e-9, "{} {distance}", seen.range_km());
            let along = n_t * small * (small - big * psi.cos()) + n_o * big * (big - small * psi.cos());
            let rate = along.abs() / (distance * distance);
            // The velocity is that of the first step of the light time, v/c of it off.
            assert!((seen.rate_rad_s() / rate - 1.0).abs() < 1e-7, "{} {rate}", seen.rate_rad_s());
            let still = n_t * small * (small - big * psi.cos()).abs() / (distance * distance);
            assert!((still / rate - 1.0).abs() > 0.01, "control: a platform at rest sees {still}");
        }
    }
}
