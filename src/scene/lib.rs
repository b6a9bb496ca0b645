//! Finds all light sources of one exposure, and the truth about them.
//!
//! In: a line of sight and the sky. Out: sources for the planner, the background, the truth table, the map to the sky.
//!
//! * [`camera`]: one camera, everything between the light and its numbers;
//! * [`Scene`]: stars ([`sky_view`]), Sun, Moon, Earth and planets ([`sky_bodies`], [`discs`]), targets
//!   ([`sky_targets`]) and the light beside the stars ([`field_light`]);
//! * [`truth`]: rows of the truth table; [`wcs`]: pixels to catalog places (FITS).

pub mod camera;
pub mod discs;
mod field;
pub mod field_light;
mod scene;
pub mod sky_bodies;
pub mod sky_targets;
pub mod sky_view;
pub mod truth;
pub mod wcs;

pub use scene::{Scene, SceneParams, SceneReport};
