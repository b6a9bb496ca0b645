//! Star catalogs: stars as they are stored, and the stars of a field.
//!
//! Nothing here knows about cameras or observers: directions are ICRS at the catalog's epoch.
//!
//! * [`catalog`]: the packed star catalog, a layer in memory, and its cone query;
//! * [`layer`]: star layers on disk, of any number of stars, and their cone query; several as one sky;
//! * [`StarIndex`]: facts and tiles of either;
//! * [`tiles`]: the tiles of a field, decoded, in bounded memory, read ahead; [`Sky`]: the stars of a run;
//! * [`galactic`]: galactic longitude and latitude; [`healpix`]: cells of the sphere, and those that a cone touches;
//! * [`credits`]: acknowledgements that the sources of stars ask for;
//! * [`numbering`]: stored numbers -> names in source catalogs, and Gaia's -> those of Hipparcos;
//! * [`radial_velocity`]: of the fastest stars.

pub mod catalog;
pub mod credits;
pub mod galactic;
pub mod healpix;
pub mod layer;
pub mod numbering;
pub mod radial_velocity;
mod stars;
mod store;
pub mod tiles;

pub use stars::{FieldMemory, Sky};
pub use store::StarIndex;
