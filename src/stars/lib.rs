//! Star catalogs: stars as they are stored, and the stars of a field.
//!
//! Nothing here knows about cameras or observers: directions are ICRS at the catalog's epoch.
//!
//! * [`catalog`]: the packed star catalog, a layer in memory, and its cone query;
//! * [`layer`]: star layers on disk, of any number of stars, and their cone query; several as one sky;
//! * [`StarIndex`]: facts and tiles of either; [`cover`]: cones and the tiles that they touch;
//! * [`tiles`]: the tiles of a field, decoded, in bounded memory, read ahead; [`Sky`]: the stars of a run;
//! * [`galactic`]: galactic longitude and latitude; [`healpix`]: cells of the sphere;
//! * [`credits`]: acknowledgements that the sources of stars ask for;
//! * [`numbering`]: stored numbers -> names in source catalogs; [`hipparcos`]: of Gaia stars in Hipparcos;
//! * [`radial_velocity`]: of the fastest stars.

pub mod catalog;
pub mod cover;
pub mod credits;
pub mod galactic;
pub mod healpix;
pub mod hipparcos;
mod index;
pub mod layer;
pub mod numbering;
pub mod radial_velocity;
mod stars;
mod steps;
pub mod tiles;

pub use index::StarIndex;
pub use stars::{FieldMemory, Sky};
