//! Time and a cone on the sky -> catalog sources; time -> where the observer is and how fast it moves.
//!
//! Nothing here knows about cameras: directions and states are in ICRF axes, positions from the solar-system
//! barycentre, km and km/s.
//!
//! * [`catalog`]: the packed star catalog and its cone query;
//! * [`import`], [`layer`]: published catalogs -> layers on disk, of any number of stars, and their cone query;
//! * [`tiles`]: the tiles of a field from layers, in bounded memory, read ahead; [`Sky`]: a catalog or layers;
//! * [`synthetic`]: made-up deep populations by the densities that were measured, as layers;
//! * [`density_map`]: stars per square degree over the whole sky;
//! * [`galactic`]: galactic longitude and latitude;
//! * [`hats`]: catalogs partitioned by HEALPix -> layers, and back;
//! * [`credits`]: whom stars' origins ask to name;
//! * [`numbering`]: stored numbers -> names in source catalogs; [`radial_velocity`]: of the fastest stars;
//! * [`earth`]: the Earth's barycentric state from VSOP87E;
//! * [`ephemeris`]: Moon and planets by polynomials fitted to DE421, 1990 to 2051;
//! * [`moon`], [`planets`], [`magnitude`]: where they are and how bright;
//! * [`spheroid`]: limb and surface of a body, seen from near or far;
//! * [`bodies`]: Sun, Moon and Earth as the observer sees them;
//! * [`sun`]: the Sun's barycentric state, likewise;
//! * [`orbit`]: the spacecraft about the Earth (two-line elements, circular), or on a conic about Earth, Moon or Sun;
//! * [`observer`]: both together;
//! * [`target`]: targets about the Earth: sightings, sunlight, brightness.

pub mod bodies;
pub mod catalog;
pub mod credits;
pub mod density_map;
pub mod earth;
pub mod ephemeris;
mod error;
pub mod galactic;
pub mod hats;
pub mod import;
pub mod layer;
pub mod magnitude;
pub mod moon;
pub mod numbering;
pub mod observer;
pub mod orbit;
pub mod planets;
pub mod radial_velocity;
pub mod spheroid;
pub mod sun;
mod stars;
mod state;
pub mod target;
pub mod tiles;
pub mod synthetic;

pub use error::ObserverError;
pub use stars::Sky;
