//! Published and made-up star catalogs -> star layers on disk, and back. Batch work: no run needs this crate.
//!
//! * [`published`]: catalogs as their archives give them (CSV, text): Gaia, Hipparcos, Tycho-2;
//! * `hats` (a feature): catalogs partitioned by HEALPix (Parquet), read and written; [`hats_folder`]: which folder is one;
//! * [`synthetic`]: made-up deep populations by the densities that were measured;
//! * [`density_map`]: stars per square degree over the whole sky.

pub mod density_map;
#[cfg(feature = "hats")]
pub mod hats;
pub mod hats_folder;
pub mod published;
pub mod synthetic;
