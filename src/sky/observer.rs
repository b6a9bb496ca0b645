//! Time -> barycentric position and velocity of the star sensor: a body's centre plus the spacecraft's orbit about it.
//!
//! About the Moon the Earth's state has the Moon's added, about the Sun it is the Sun's. Errors of those bodies, as
//! aberration: the Earth 0.005 mas, the Sun 0.01 mas, the Moon 0.01 mas from 1990 to 2052 and 1 mas outside (its table
//! and its series, [`crate::moon`]).
//!
//! Proven by the tests of [`crate::earth`] and [`crate::orbit`] and by `tests/physics/apparent_places`.

use crate::followed::{FollowedStates, above_surface};
use crate::orbit::{CentralBody, CircularOrbit, TleOrbit, TwoBodyOrbit};
pub use crate::state::BarycentricState;
use crate::{almanac::Almanac, moon};
use base::{refused::Refused, time::Tai};
use histories::{Centre, OrbitHistory};
use std::sync::Arc;

/// Where the star sensor flies.
#[derive(Debug, Clone)]
pub enum Observer {
    /// At rest at the solar-system barycentre: no parallax and no aberration.
    Barycentre,
    /// At the Earth's centre: annual parallax and aberration only.
    Geocentre,
    /// In an Earth orbit given by two-line elements.
    Tle(Box<TleOrbit>),
    /// In a circular Earth orbit.
    Circular(CircularOrbit),
    /// On a conic about the Earth, the Moon or the Sun.
    TwoBody {
        /// The central body.
        about: CentralBody,
        /// The conic, ICRF axes.
        orbit: TwoBodyOrbit,
    },
    /// On the states of a file, with the interpolation and the bound of [`histories::orbit`].
    Table(Arc<OrbitHistory>),
}

impl Observer {
    /// Returns the body it is about; `None` at the barycentre.
    pub fn about(&self) -> Option<CentralBody> {
        match self {
            Self::Barycentre => None,
            Self::Geocentre | Self::Tle(_) | Self::Circular(_) => Some(CentralBody::Earth),
            Self::TwoBody { about, .. } => Some(*about),
            Self::Table(history) => body_of(history.centre),
        }
    }

    /// Returns the state from the centre of that body; at rest at the barycentre. Does not allocate.
    ///
    /// # Errors
    /// When SGP4 cannot follow the elements to `at`, a file has no state there, or the orbit is below the surface.
    pub fn relative_state(&self, at: Tai) -> Result<BarycentricState, Refused> {
        match self {
            Self::Barycentre | Self::Geocentre => Ok(BarycentricState::default()),
            Self::Tle(orbit) => orbit.geocentric_state(at),
            Self::Circular(orbit) => Ok(orbit.geocentric_state(at)),
            Self::TwoBody { about, orbit } => above_surface(*about, at, orbit.state(at)),
            Self::Table(history) => tabulated(history, at),
        }
    }
}

/// Returns the body that a file's positions are from; `None` for the barycentre.
fn body_of(centre: Centre) -> Option<CentralBody> {
    match centre {
        Centre::Earth => Some(CentralBody::Earth),
        Centre::Moon => Some(CentralBody::Moon),
        Centre::Sun => Some(CentralBody::Sun),
        Centre::Barycentre => None,
    }
}

fn tabulated(history: &OrbitHistory, at: Tai) -> Result<BarycentricState, Refused> {
    let missing = || {
        let [first, last] = history.span_ns().map(Tai::from_ns);
        Refused(format!(
            "the observer's file has no state at {at}: it goes from {first} to {last}; wanted one that covers the run without gaps"
        ))
    };
    let found = history.at_ns(at.ns()).ok_or_else(missing)?;
    let state = BarycentricState { position_km: found.position_km, velocity_km_s: found.velocity_km_s };
    body_of(history.centre).map_or(Ok(state), |about| above_surface(about, at, state))
}

/// Checks that an orbit has every state of a file, as is asked of every state that comes over a link.
///
/// # Errors
/// With the instant of the first state that is not finite, faster than anything that passes the body, or below its
/// surface.
pub fn check_states(history: &OrbitHistory) -> Result<(), (Tai, Refused)> {
    let mut states = FollowedStates::new(body_of(history.centre));
    for state in history.segments().iter().flat_map(|segment| segment.states()) {
        let (at, position_km, velocity_km_s) = (Tai::from_ns(state.t_ns), state.position_km, state.velocity_km_s);
        states.take(at, BarycentricState { position_km, velocity_km_s }).map_err(|error| (at, error))?;
    }
    Ok(())
}

/// An observer followed from frame to frame: the orbit at each time, Earth and Sun from an [`Almanac`].
#[derive(Debug, Clone)]
pub struct ObserverTrack {
    observer: Observer,
    /// States from outside, which go before the orbit from the first one on.
    followed: Option<Box<FollowedStates>>,
    pub(super) almanac: Almanac,
}

impl ObserverTrack {
    /// Follows `observer`, ready for instants near `at`.
    pub fn new(observer: Observer, at: Tai) -> Self {
        Self::with_almanac(observer, Almanac::over(at, at))
    }

    /// Follows `observer` over the days of `almanac`.
    pub fn with_almanac(observer: Observer, almanac: Almanac) -> Self {
        Self { observer, followed: None, almanac }
    }

    /// Takes in the observer's state at an instant, from outside, relative to the body it is about: km and km/s, ICRF
    /// axes. From the first one on the orbit is not used any more. The first call allocates.
    ///
    /// # Errors
    /// When a number is not finite, too large, or below the surface of the body.
    pub fn follow(&mut self, at: Tai, state: BarycentricState) -> Result<(), Refused> {
        let about = self.observer.about();
        self.followed.get_or_insert_with(|| Box::new(FollowedStates::new(about))).take(at, state)
    }

    /// Returns true when states come from outside, and the nearest is so far from an instant that its state is
    /// predicted.
    pub fn is_far(&self, at: Tai) -> bool {
        self.followed.as_ref().is_some_and(|states| states.is_far(at))
    }

    /// Returns the body the observer is about; `None` at the barycentre.
    pub fn about(&self) -> Option<CentralBody> {
        self.observer.about()
    }

    /// Returns true for an observer at rest at the barycentre, for whom no light is bent and no body is near.
    pub fn is_barycentre(&self) -> bool {
        self.followed.is_none() && matches!(self.observer, Observer::Barycentre)
    }

    /// Returns true for an observer at the Earth's centre, who does not see the Earth.
    pub fn is_geocentre(&self) -> bool {
        self.followed.is_none() && matches!(self.observer, Observer::Geocentre)
    }

    /// Returns the state from the centre of the body the observer is about. Does not allocate.
    ///
    /// # Errors
    /// As for [`Observer::relative_state`].
    pub fn relative_state(&self, at: Tai) -> Result<BarycentricState, Refused> {
        let followed = self.followed.as_ref().map(|states| states.at(at)).transpose()?.flatten();
        followed.map_or_else(|| self.observer.relative_state(at), Ok)
    }

    /// Returns the state at `at`; depends on the time only. Does not allocate.
    ///
    /// # Errors
    /// As for [`Observer::relative_state`].
    pub fn barycentric_state(&self, at: Tai) -> Result<BarycentricState, Refused> {
        let relative = self.relative_state(at)?;
        Ok(relative
            + match self.observer.about() {
                None => BarycentricState::default(),
                Some(CentralBody::Earth) => self.almanac.earth(at),
                Some(CentralBody::Moon) => self.almanac.earth(at) + moon::geocentric_state(at),
                Some(CentralBody::Sun) => self.almanac.sun(at),
            })
    }

    /// Returns the state from the Earth's centre, likewise; `None` at the barycentre.
    ///
    /// # Errors
    /// As for [`Observer::relative_state`].
    pub fn geocentric_state(&self, at: Tai) -> Result<Option<BarycentricState>, Refused> {
        let relative = self.relative_state(at)?;
        Ok(self.observer.about().map(|about| match about {
            CentralBody::Earth => relative,
            CentralBody::Moon => relative + moon::geocentric_state(at),
            CentralBody::Sun => relative + (self.almanac.sun(at) - self.almanac.earth(at)),
        }))
    }

    /// Returns the barycentric state of the Sun's centre.
    pub fn sun_state(&self, at: Tai) -> BarycentricState {
        self.almanac.sun(at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{earth, sun};
    use base::time::Span;
    use glam::DVec3;

    fn conic(about: CentralBody, position_km: DVec3, velocity_km_s: DVec3, at: Tai) -> Observer {
        let orbit = TwoBodyOrbit::from_state(at, position_km, velocity_km_s, about.gm_km3_s2()).expect("a valid orbit");
        Observer::TwoBody { about, orbit }
    }

    /// Returns three times the errors of an almanac.
    fn near(a: BarycentricState, b: BarycentricState) -> bool {
        let off = a - b;
        off.position_km.length() < 0.5 && off.velocity_km_s.length() < 4e-5
    }

    #[test]
    fn moon_and_sun_may_be_the_centre() {
        let at = Tai::from_rfc3339("2026-03-01T12:34:56Z").expect("a valid instant");
        let track = |observer: &Observer| ObserverTrack::new(observer.clone(), at);
        let of = |observer: &Observer| track(observer).barycentric_state(at).expect("above the surface");
        let earth = of(&Observer::Geocentre);
        assert!(near(earth, earth::barycentric_state(at)));
        let (r, v) = (DVec3::new(0.0, 3_000.0, 1_000.0), DVec3::new(1.2, 0.0, 0.0));
        let moon = conic(CentralBody::Moon, r, v, at);
        assert!((of(&moon).position_km - earth.position_km).distance(moon::geocentric_km(at) + r) < 1e-6);
        let along_km_s = (of(&moon).velocity_km_s - earth.velocity_km_s - v).length();
        assert!((0.95..1.10).contains(&along_km_s), "the Moon goes at 0.97 to 1.08 km/s: {along_km_s}");
        let (r, v) = (DVec3::new(2e8, 0.0, 0.0), DVec3::new(0.0, 20.0, 5.0));
        let sun = conic(CentralBody::Sun, r, v, at);
        assert!(near(of(&sun), sun::barycentric_state(at) + BarycentricState { position_km: r, velocity_km_s: v }));
        for observer in [&moon, &sun, &Observer::Geocentre] {
            let geocentric = track(observer).geocentric_state(at).expect("no error").expect("not at the barycentre");
            assert!(near(geocentric + earth, of(observer)), "{observer:?}");
        }
        assert!(track(&Observer::Barycentre).geocentric_state(at).expect("no error").is_none());
    }

    /// A file of a circle about each centre, a state a minute.
    #[test]
    fn a_file_gives_states_about_its_centre_and_none_outside() {
        let zero = Tai::from_rfc3339("2026-03-01T00:00:00Z").expect("a valid instant");
        let orbit = CircularOrbit::new(500.0, 97.4, 30.0, 10.0, zero).expect("a valid orbit");
        let rows = |centre: &str| {
            let mut text = format!("# centre: {centre}\ntai_ns,x_km,y_km,z_km,vx_km_s,vy_km_s,vz_km_s\n");
            for minute in 0..10_i64 {
                let at = zero + Span::from_ms(60_000 * minute);
                let BarycentricState { position_km: p, velocity_km_s: v } = orbit.geocentric_state(at);
                text += &format!("{},{},{},{},{},{},{}\n", at.ns(), p.x, p.y, p.z, v.x, v.y, v.z);
            }
            Observer::Table(Arc::new(histories::read::orbit("rows.csv", &text).expect("an orbit")))
        };
        let at = zero + Span::from_s(330.0);
        let earth = rows("EARTH");
        let off = earth.relative_state(at).expect("inside") - orbit.geocentric_state(at);
        assert!(off.position_km.length() < 1e-3 && off.velocity_km_s.length() < 1e-5, "{off:?}");
        assert_eq!(earth.about(), Some(CentralBody::Earth));
        assert_eq!(rows("SUN").about(), Some(CentralBody::Sun));
        assert!(rows("SUN").relative_state(at).is_err(), "7000 km from its centre is inside the Sun");
        let barycentre = rows("SOLAR SYSTEM BARYCENTER");
        let state = ObserverTrack::new(barycentre, at).barycentric_state(at).expect("inside");
        assert!((state.position_km - orbit.geocentric_state(at).position_km).length() < 1e-3);
        let late = earth.relative_state(zero + Span::from_s(541.0)).expect_err("after its end").to_string();
        assert!(late.contains("no state at 2026-03-01T00:09:01") && late.contains("to 2026-03-01T00:09:00"), "{late}");
    }

    #[test]
    fn an_orbit_that_comes_down_is_reported() {
        let at = Tai::from_rfc3339("2026-03-01T00:00:00Z").expect("a valid instant");
        let dropped = conic(CentralBody::Moon, DVec3::X * 1_800.0, DVec3::Y * 0.5, at);
        assert!(dropped.relative_state(at).is_ok(), "63 km above the ground");
        let later = dropped.relative_state(at + Span::from_s(600.0)).expect_err("it has fallen").to_string();
        assert!(
            later.contains("the Moon") && later.contains("1737.4") && later.contains("2026-03-01T00:10"),
            "{later}"
        );
    }

    #[test]
    fn orbit_and_earth_add_up_and_the_barycentre_rests() {
        let at = Tai::from_rfc3339("2026-03-01T12:34:56Z").expect("a valid instant");
        let orbit = CircularOrbit::new(500.0, 97.4, 30.0, 10.0, at).expect("a valid orbit");
        let state =
            |observer: Observer| ObserverTrack::new(observer, at).barycentric_state(at).expect("no elements, no error");
        let [flying, earth] = [Observer::Circular(orbit), Observer::Geocentre].map(state);
        let speed_km_s = (flying.velocity_km_s - earth.velocity_km_s).length();
        assert!((speed_km_s - 7.6127).abs() < 1e-4, "{speed_km_s}");
        assert!(near(earth, earth::barycentric_state(at)));
        assert_eq!(state(Observer::Barycentre), BarycentricState::default());
    }
}
