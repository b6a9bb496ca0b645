//! Time -> Earth, Sun and planets for every frame, from series that were evaluated before the first one.
//!
//! The series of [`crate::earth`] and [`crate::sun`], and those of the planets where [`crate::ephemeris`] has no table,
//! cost milliseconds a day: too much for the frame thread. An [`Almanac`] has them at the start of each day of a run
//! (TDB days since J2000.0, which start at noon), and interpolates within a day:
//!
//! | body | method | error against its series |
//! |---|---|---|
//! | Earth | cubic through both ends' positions and velocities | 0.2 km, 7e-6 km/s (5 microarcsec of aberration) |
//! | Sun | straight on from the middle of the day | 0.25 km, 1.1e-5 km/s (8 microarcsec) |
//! | planets outside the table | cubic as for the Earth | [`PLANET_KM`] |
//!
//! The Earth's bound: sqrt(3)/216 x 1 day^3 x the fourth derivative, 13 km/day^4 for the year's motion and 13 to 40 for
//! the Moon's pull. The Sun's: its acceleration, below 2.5e-10 km/s^2, over half a day. A value depends on the time
//! only, whether its day was prepared or not. Nothing allocates after construction. The Moon's own series costs
//! microseconds and is not here. Tests: below; `tests/physics/almanac.rs`.

use crate::planets::{self, Planet};
use crate::{earth, ephemeris, state::BarycentricState, sun};
use base::{time::Tai, units::DAY_S};
use ephemeris::Method;
use glam::DVec3;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Most days that are prepared. A configured run lasts 116 days at most.
pub const MOST_DAYS: usize = 400;
/// Bound of a planet's cubic against its series, km: Mercury near the Sun, 0.06 arcsec from the Earth.
pub const PLANET_KM: f64 = 30.0;
/// Days before a span that are prepared with it: the light time of planets, for an observer up to 140 au from the Sun.
const LIGHT_D: f64 = 1.0;
/// Days after a span, likewise: exposures that end after it.
const AFTER_D: f64 = 0.25;

/// The prepared days of a span. A clone shares them; reading takes no lock.
#[derive(Debug, Clone)]
pub struct Almanac(Arc<Days>);

#[derive(Debug)]
struct Days {
    /// Number of the first one, TDB since J2000.
    first: f64,
    prepared: Vec<Day>,
    /// Days evaluated where they were asked for.
    evaluated: AtomicU64,
}

/// Coefficients of the series for one day.
#[derive(Debug)]
struct Day {
    /// At its start.
    earth: BarycentricState,
    /// In its middle.
    sun: BarycentricState,
    /// At its start, from the Sun; at rest where the table of [`ephemeris`] serves this day and the one before.
    planets: [BarycentricState; Planet::ALL.len()],
}

impl Day {
    fn evaluate(number: f64) -> Self {
        let is_needed = [number - 1.0, number].map(Method::on_day).contains(&Method::Series);
        let planets = if is_needed { planets::states_by_series(number) } else { Default::default() };
        Self { earth: earth::state_on_day(number), sun: sun::state_on_day(number + 0.5), planets }
    }
}

impl Almanac {
    /// Prepares the days from `first` to `last`, and those that light time and exposures reach: [`MOST_DAYS`] at most.
    pub fn over(first: Tai, last: Tai) -> Self {
        let day = (first.days_tdb_since_j2000() - LIGHT_D).floor();
        let end = (last.days_tdb_since_j2000() + AFTER_D).floor() + 1.0;
        let numbers = (0..MOST_DAYS).map(|i| day + i as f64).take_while(|number| *number <= end);
        Self(Arc::new(Days { first: day, prepared: numbers.map(Day::evaluate).collect(), evaluated: 0.into() }))
    }

    /// Returns how often a day was evaluated where it was asked for, because it was not prepared.
    pub fn evaluated(&self) -> u64 {
        self.0.evaluated.load(Ordering::Relaxed)
    }

    /// Returns the barycentric state of the Earth's centre, ICRF axes.
    pub fn earth(&self, at: Tai) -> BarycentricState {
        self.between_days(at.days_tdb_since_j2000(), |day| day.earth)
    }

    /// Returns the barycentric state of the Sun's centre, ICRF axes.
    pub fn sun(&self, at: Tai) -> BarycentricState {
        let days = at.days_tdb_since_j2000();
        let noon = self.on(days.floor(), |day| day.sun);
        let since_noon_s = (days - days.floor() - 0.5) * DAY_S;
        BarycentricState { position_km: noon.position_km + noon.velocity_km_s * since_noon_s, ..noon }
    }

    /// Returns the position of a planet from the Sun, days of TDB since J2000: by the table in its span, else by the
    /// cubic.
    pub fn planet_km(&self, planet: Planet, days: f64) -> DVec3 {
        let by_table = ephemeris::state(planet.number(), days);
        by_table.unwrap_or_else(|| self.between_days(days, |day| day.planets[planet as usize])).position_km
    }

    fn on(&self, number: f64, of: impl Fn(&Day) -> BarycentricState) -> BarycentricState {
        let Days { first, prepared, evaluated } = &*self.0;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a whole number, not negative")]
        let day = if number < *first { None } else { prepared.get((number - first) as usize) };
        day.map_or_else(
            || {
                evaluated.fetch_add(1, Ordering::Relaxed);
                of(&Day::evaluate(number))
            },
            &of,
        )
    }

    /// Returns the cubic through positions and velocities at the start of a day and of the next.
    fn between_days(&self, days: f64, of: impl Fn(&Day) -> BarycentricState) -> BarycentricState {
        let (a, b) = (self.on(days.floor(), &of), self.on(days.floor() + 1.0, &of));
        let u = days - days.floor();
        let chord_km = b.position_km - a.position_km;
        let (rate_a_km, rate_b_km) = (a.velocity_km_s * DAY_S, b.velocity_km_s * DAY_S);
        let square_km = 3.0 * chord_km - 2.0 * rate_a_km - rate_b_km;
        let cube_km = rate_a_km + rate_b_km - 2.0 * chord_km;
        BarycentricState {
            position_km: a.position_km + u * (rate_a_km + u * (square_km + u * cube_km)),
            velocity_km_s: (rate_a_km + u * (2.0 * square_km + u * 3.0 * cube_km)) / DAY_S,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ephemeris::{FIRST_DAY, LAST_DAY};
    use base::{time::Span, units::AU_KM};

    fn at(text: &str) -> Tai {
        Tai::from_rfc3339(text).expect("a valid instant")
    }

    #[test]
    fn earth_and_sun_follow_their_series() {
        let start = at("2026-01-01T00:00:00Z");
        let almanac = Almanac::over(start, start + Span::from_s(9_000.0 * 3_600.0));
        let mut worst = [0.0_f64; 4];
        for hour in (0..9_000).step_by(67) {
            let at = start + Span::from_s(3_600.0 * f64::from(hour));
            let earth = almanac.earth(at) - earth::barycentric_state(at);
            let sun = almanac.sun(at) - sun::barycentric_state(at);
            let off = [earth.position_km, earth.velocity_km_s, sun.position_km, sun.velocity_km_s].map(DVec3::length);
            worst = core::array::from_fn(|i| worst[i].max(off[i]));
            // Prepared for another span, the same bits.
            let other = Almanac::over(at, at);
            assert_eq!([almanac.earth(at), almanac.sun(at)], [other.earth(at), other.sun(at)], "{hour} h");
        }
        println!("cubic and line against series: {worst:?}");
        assert!(worst[0] < 0.2 && worst[1] < 2e-5 && worst[2] < 0.25 && worst[3] < 1.1e-5, "{worst:?}");
        assert!(worst[1] > 1e-9, "control: the cubic is not the series");
        assert_eq!(almanac.evaluated(), 0);
    }

    #[test]
    fn days_that_were_not_prepared_are_counted_and_have_the_same_bits() {
        for start in [at("2026-03-01T00:00:00Z"), at("2060-03-01T00:00:00Z")] {
            let late = start + Span::from_s(30.0 * DAY_S);
            let [short, long] = [start, late].map(|last| Almanac::over(start, last));
            let all = |almanac: &Almanac| {
                let planets = Planet::ALL.map(|planet| planet.light_left_km(late, DVec3::X * AU_KM, almanac));
                (almanac.earth(late), almanac.sun(late), planets)
            };
            assert_eq!(all(&short), all(&long));
            // Both ends of the Earth's day, one of the Sun's; planets in steps to the light time.
            let of_planets = if start < at("2050-01-01T00:00:00Z") { 0 } else { 2 * 4 * Planet::ALL.len() as u64 };
            assert_eq!([short.evaluated(), long.evaluated()], [3 + of_planets, 0]);
            let before = start - Span::from_s(3.0 * DAY_S);
            assert_eq!((long.earth(before), long.evaluated()), (Almanac::over(before, before).earth(before), 2));
        }
    }

    #[test]
    fn no_more_days_are_prepared_than_stated() {
        let start = at("2026-03-01T00:00:00Z");
        let almanac = Almanac::over(start, start + Span::from_s(1e4 * DAY_S));
        assert_eq!(almanac.0.prepared.len(), MOST_DAYS);
        let configured = Almanac::over(start, start + Span::from_s(1e7));
        assert_eq!(configured.0.prepared.len(), 119, "the longest run of a configuration");
    }

    #[test]
    fn planets_outside_the_table_follow_their_series_to_its_edges() {
        let mut worst_km = 0.0_f64;
        for (edge, sign) in [(FIRST_DAY, -1.0), (LAST_DAY, 1.0)] {
            let noon = at("2000-01-01T11:58:55.816Z") + Span::from_s(DAY_S * edge);
            let far = noon + Span::from_s(sign * 90.0 * DAY_S);
            let almanac = Almanac::over(noon.min(far), noon.max(far));
            for planet in Planet::ALL {
                // A revolution of Mercury; 1e-3 is 86 s from the edge.
                for days in (0..39).map(|i| edge + sign * (1e-3 + 2.25 * f64::from(i))) {
                    let off_km = almanac.planet_km(planet, days).distance(planet.by_series_km(days));
                    worst_km = worst_km.max(off_km);
                    assert!(off_km < PLANET_KM, "{} at {days}: {off_km} km", planet.name());
                }
                let inside = edge - sign * 1e-3;
                let by_table = ephemeris::state(planet.number(), inside).expect("a day of the table").position_km;
                assert_eq!(almanac.planet_km(planet, inside), by_table, "{}", planet.name());
            }
            assert_eq!(almanac.evaluated(), 0);
        }
        println!("cubic against series: {worst_km:.2} km");
        assert!(worst_km > 0.1, "control: the cubic is not the series");
    }
}
