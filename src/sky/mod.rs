//! Time and a cone on the sky -> catalog sources; time -> where the observer is and how fast it moves.
//!
//! Nothing here knows about cameras: directions and states are in ICRF axes, positions from the solar-system
//! barycentre, km and km/s.
//!
//! * [`catalog`]: the packed star catalog and its cone query;
//! * [`import`], [`layer`]: published catalogs -> layers on disk, of any number of stars, and their cone query;
//! * [`hats`]: catalogs partitioned by HEALPix -> layers, and back;
//! * [`earth`]: the Earth's barycentric state from VSOP87E;
//! * [`moon`]: the geocentric Moon by a short series;
//! * [`bodies`]: Sun, Moon and Earth as the observer sees them;
//! * [`orbit`]: the spacecraft about the Earth (two-line elements, circular);
//! * [`observer`]: both together.

pub mod bodies;
pub mod catalog;
pub mod earth;
mod error;
pub mod hats;
pub mod import;
pub mod layer;
pub mod moon;
pub mod observer;
pub mod orbit;

pub use error::ObserverError;
