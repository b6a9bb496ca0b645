//! Published and made-up star catalogs -> star layers on disk, and back. Batch work: no run needs this crate.
//!
//! * [`published`]: catalogs as their archives give them (CSV, text): Gaia, Hipparcos, Tycho-2;
//! * `hats` (a feature): catalogs partitioned by HEALPix (Parquet), read and written; [`is_hats`] knows one in every build;
//! * [`synthetic`]: made-up deep populations by the densities that were measured;
//! * [`density_map`]: stars per square degree over the whole sky.

pub mod density_map;
#[cfg(feature = "hats")]
pub mod hats;
pub mod published;
pub mod synthetic;

use std::path::Path;

/// Names of the file that makes a folder a HATS catalog, the newer first.
pub(crate) const FILES: [&str; 2] = ["hats.properties", "properties"];
/// File that a collection of catalogs (a main one and its margins and indexes) has instead.
pub(crate) const COLLECTION: &str = "collection.properties";

/// Returns true for the folder of a HATS catalog, or of a collection of them.
pub fn is_hats(folder: &Path) -> bool {
    folder.is_dir() && FILES.iter().chain([&COLLECTION]).any(|name| folder.join(name).is_file())
}
