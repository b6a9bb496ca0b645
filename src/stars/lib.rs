//! Star catalogs: stars as they are stored, and the stars of a field.
//!
//! Nothing here knows about cameras or observers: directions are ICRS at the catalog's epoch.
//!
//! * [`catalog`]: the packed star catalog and its cone query;
//! * [`layer`]: star layers on disk, of any number of stars, and their cone query;
//! * [`tiles`]: the tiles of a field from layers, in bounded memory, read ahead; [`Sky`]: a catalog or layers;
//! * [`galactic`]: galactic longitude and latitude;
//! * [`credits`]: whom stars' origins ask to name;
//! * [`numbering`]: stored numbers -> names in source catalogs; [`radial_velocity`]: of the fastest stars.

pub mod catalog;
pub mod credits;
pub mod galactic;
pub mod layer;
pub mod numbering;
pub mod radial_velocity;
mod stars;
pub mod tiles;

pub use stars::Sky;
