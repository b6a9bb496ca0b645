//! The numbers of `starloop::sky::orbit`'s conics that central bodies have; conics are not read.

/// Geocentric gravitational constant, km^3/s^2 (IERS Conventions 2010, table 1.1).
pub const EARTH_GM_KM3_S2: f64 = 398_600.441_8;
/// Gravitational constant of the Moon, km^3/s^2 (DE440; Park et al. 2021, AJ 161, 105, table 2).
pub const MOON_GM_KM3_S2: f64 = 4_902.800_118;
/// Heliocentric gravitational constant, km^3/s^2 (DE440, ibid.).
pub const SUN_GM_KM3_S2: f64 = 132_712_440_041.279_42;
