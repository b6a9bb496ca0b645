//! `starloop::sky`, as far as it reads files; without Parquet and without the series of Sun, Moon and Earth.

#![allow(dead_code, unused_imports, reason = "not all of it is here")]

#[path = "../../../src/sky/catalog/mod.rs"]
pub mod catalog;
#[path = "../../../src/sky/credits.rs"]
pub mod credits;
#[path = "../../../src/sky/ephemeris/mod.rs"]
pub mod ephemeris;
#[path = "../../../src/sky/error.rs"]
mod error;
#[path = "sky_import.rs"]
pub mod import;
#[path = "../../../src/sky/layer/mod.rs"]
pub mod layer;
#[path = "sky_moon.rs"]
pub mod moon;
#[path = "../../../src/sky/numbering.rs"]
pub mod numbering;
#[path = "sky_observer.rs"]
pub mod observer;
#[path = "sky_orbit.rs"]
pub mod orbit;
#[path = "../../../src/sky/radial_velocity.rs"]
pub mod radial_velocity;
#[path = "../../../src/sky/state.rs"]
mod state;

pub use error::ObserverError;
