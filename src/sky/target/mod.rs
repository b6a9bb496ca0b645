//! Targets about the Earth: time and observer -> where a target is, how far, how it is lit, how bright it is.
//!
//! * [`Orbit`]: any of the orbits of [`crate::orbit`], followed from the geocentre;
//! * [`Sighting`]: the target as its light left it, seen from the observer; range, rates, phase;
//! * [`Sunlight`]: full light, penumbra or umbra of the Earth, and what the Earth itself covers;
//! * [`Brightness`]: magnitude from size and reflectance, from a magnitude at 1000 km, or as given.
//!
//! Directions here are those of light that arrives at the observer's place; the aberration by the observer's motion is
//! `astrometry`'s, as for stars.

mod brightness;
mod shadow;
mod sighting;

pub use brightness::{Brightness, MOST_PHASE_POINTS, PhaseCurve, SUN_BP_RP, SUN_MAG_G, sphere_phase};
pub use shadow::{Sunlight, limb_clearance_km, sunlight};
pub use sighting::{Orbit, Sighting};
