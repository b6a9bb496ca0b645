//! Errors of a HATS catalog.

use base::refused::Refused;
use std::fmt::Display;
use std::path::Path;

/// The files are not those that the list of partitions has.
pub(crate) fn partition(path: &Path, what: impl Display) -> Refused {
    Refused::at(path, format_args!("{what}; fetch or make the catalog again"))
}
