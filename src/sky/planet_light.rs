//! Where a planet was when the light left it.

use crate::{almanac::Almanac, planets::Planet};
use base::time::Tai;
use base::units::{DAY_S, SPEED_OF_LIGHT_KM_S};
use glam::DVec3;

/// Steps to the light time: each leaves v/c of the one before, 3e-4 of 4 hours at first.
const LIGHT_STEPS: usize = 3;

impl Planet {
    /// Returns where it was when the light left that an observer at `observer_km` from the Sun gets at `at`: from the
    /// Sun, km.
    pub fn light_left_km(self, at: Tai, observer_km: DVec3, almanac: &Almanac) -> DVec3 {
        let days = at.days_tdb_since_j2000();
        let mut from_sun_km = almanac.planet_km(self, days);
        for _ in 0..LIGHT_STEPS {
            let light_s = from_sun_km.distance(observer_km) / SPEED_OF_LIGHT_KM_S;
            from_sun_km = almanac.planet_km(self, days - light_s / DAY_S);
        }
        from_sun_km
    }
}
