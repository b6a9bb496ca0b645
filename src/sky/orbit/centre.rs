//! The bodies that something may be in orbit about.

use crate::moon;
use core::fmt;

/// Geocentric gravitational constant, km^3/s^2 (IERS Conventions 2010, table 1.1).
pub const EARTH_GM_KM3_S2: f64 = 398_600.441_8;
/// Gravitational constant of the Moon, km^3/s^2 (DE440; Park et al. 2021, AJ 161, 105, table 2).
pub const MOON_GM_KM3_S2: f64 = 4_902.800_118;
/// Heliocentric gravitational constant, km^3/s^2 (DE440, ibid.).
pub const SUN_GM_KM3_S2: f64 = 132_712_440_041.279_42;

/// Central body of an orbit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum CentralBody {
    /// The Earth's centre.
    Earth,
    /// The Moon's centre.
    Moon,
    /// The Sun's centre.
    Sun,
}

impl CentralBody {
    /// Returns the gravitational parameter, km^3/s^2.
    pub fn gm_km3_s2(self) -> f64 {
        match self {
            Self::Earth => EARTH_GM_KM3_S2,
            Self::Moon => MOON_GM_KM3_S2,
            Self::Sun => SUN_GM_KM3_S2,
        }
    }

    /// Returns the distance from the centre below which nothing can orbit, km: the Earth's polar radius (WGS 84), the
    /// Moon's mean radius, the Sun's nominal radius (IAU 2015 Resolution B3).
    pub fn surface_km(self) -> f64 {
        match self {
            Self::Earth => 6_356.752,
            Self::Moon => moon::RADIUS_KM,
            Self::Sun => 695_700.0,
        }
    }
}

impl CentralBody {
    /// Returns a speed above that of all that passes the body, km/s: of the Earth and the Moon that of the fastest bodies
    /// of the solar system, 72 km/s, and more; of the Sun the escape from its surface, 618 km/s, and more.
    pub fn fastest_km_s(self) -> f64 {
        match self {
            Self::Earth | Self::Moon => 100.0,
            Self::Sun => 1_000.0,
        }
    }
}

impl fmt::Display for CentralBody {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Earth => "the Earth",
            Self::Moon => "the Moon",
            Self::Sun => "the Sun",
        })
    }
}
