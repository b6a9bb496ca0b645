//! `starloop::sky::orbit`: what is read from files.

#[path = "../../../src/sky/orbit/centre.rs"]
mod centre;
#[path = "../../../src/sky/orbit/nutation.rs"]
mod nutation;
#[path = "../../../src/sky/orbit/omm.rs"]
mod omm;
#[path = "../../../src/sky/orbit/precession.rs"]
mod precession;
#[path = "../../../src/sky/orbit/tle.rs"]
mod tle;
#[path = "sky_two_body.rs"]
mod two_body;

pub use centre::CentralBody;
pub use tle::TleOrbit;
pub use two_body::{EARTH_GM_KM3_S2, MOON_GM_KM3_S2, SUN_GM_KM3_S2};
