//! Time -> geocentric position and velocity of the spacecraft, ICRF axes, km and km/s.
//!
//! The orbit matters to a star sensor through aberration: 7.6 km/s is 5.2 arcsec. A velocity error of 1 m/s is
//! 0.7 mas, so elements some days old (errors of km and m/s) are good enough. Stellar parallax from the orbit itself
//! is below 0.1 mas.

mod centre;
mod omm;
mod omm_forms;
mod precession;
mod tle;
#[cfg(test)]
mod tle_tests;
mod two_body;

pub use centre::{CentralBody, CircularOrbit, EARTH_GM_KM3_S2, MOON_GM_KM3_S2, SUN_GM_KM3_S2};
pub use omm::is_elements;
pub(crate) use precession::icrf_from_mean_of_date;
pub use tle::{TleOrbit, USUAL_DAYS, USUAL_MOST_DAYS};
pub use two_body::{KeplerElements, TwoBodyOrbit};
