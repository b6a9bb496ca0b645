//! How a HATS catalog is recognised on disk: in every build, also in one that cannot read it.

use std::path::Path;

/// Names of the file, the newer first.
pub(crate) const FILES: [&str; 2] = ["hats.properties", "properties"];
/// File that a collection of catalogs (a main one and its margins and indexes) has instead.
pub(crate) const COLLECTION: &str = "collection.properties";

/// Returns true for the folder of a HATS catalog, or of a collection of them.
pub fn is_hats(folder: &Path) -> bool {
    folder.is_dir() && FILES.iter().chain([&COLLECTION]).any(|name| folder.join(name).is_file())
}
