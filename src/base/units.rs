//! Unit conversions and the physical constants more than one crate needs.

/// Radians in one degree.
pub const DEG: f64 = core::f64::consts::PI / 180.0;
/// Radians in one arcsecond.
pub const ARCSEC: f64 = DEG / ARCSEC_PER_DEG;
/// Arcseconds in a degree.
pub const ARCSEC_PER_DEG: f64 = 3600.0;
/// Radians in one milliarcsecond.
pub const MAS: f64 = ARCSEC / 1000.0;
/// Kilometres in one metre.
pub const METRE_KM: f64 = 1e-3;
/// Radians per second in one revolution per minute.
pub const RPM: f64 = core::f64::consts::TAU / 60.0;
/// Speed of light in vacuum, km/s (exact; SI Brochure, 9th edition).
pub const SPEED_OF_LIGHT_KM_S: f64 = 299_792.458;
/// Astronomical unit, km (exact; IAU 2012 Resolution B2).
pub const AU_KM: f64 = 149_597_870.7;
/// Nanoseconds in one second.
pub const NS_PER_S: i64 = 1_000_000_000;
/// Days in one Julian year (IAU definition).
pub const JULIAN_YEAR_D: f64 = 365.25;
/// Seconds in one day.
pub const DAY_S: f64 = 86_400.0;
