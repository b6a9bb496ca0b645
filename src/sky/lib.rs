//! Where the observer is, what the solar system and the targets do, and where sources appear in a camera.
//!
//! Directions and states are in ICRF axes, positions from the solar-system barycentre, km and km/s.
//!
//! * [`earth`], [`sun`]: barycentric states from VSOP87E;
//! * [`almanac`]: the same for every frame, and planets, evaluated before the first one;
//! * [`ephemeris`]: Moon and planets by polynomials fitted to DE421, 1990 to 2051;
//! * [`moon`], [`planets`], [`magnitude`]: places and brightness;
//! * [`bodies`]: Sun, Moon and Earth as the observer sees them, and the limb of a body, seen from near or far;
//! * [`orbit`]: the spacecraft about the Earth (two-line elements, circular), or on a conic about Earth, Moon or Sun;
//! * [`followed`]: states of the observer that come from outside;
//! * [`observer`]: Earth and orbit together;
//! * [`target`]: targets about the Earth: sightings, sunlight, brightness;
//! * [`astrometry`]: catalog places -> apparent directions -> pixels.

pub mod almanac;
pub mod astrometry;
pub mod bodies;
pub mod earth;
pub mod ephemeris;
pub mod followed;
pub mod magnitude;
pub mod moon;
pub mod observer;
pub mod orbit;
pub mod planets;
mod state;
pub mod sun;
pub mod target;
