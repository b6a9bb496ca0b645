//! Errors of a layer.

use base::refused::Refused;
use std::{fmt::Display, path::Path};

/// The file has another length than its head promises.
pub(crate) fn length(path: &Path, wanted: u64, got: u64) -> Refused {
    Refused::at(
        path,
        format_args!(
            "{got} bytes, wanted {wanted} by its head: half written, cut short or something follows its end; \
         import it again"
        ),
    )
}

/// Memory is not there.
pub(crate) fn memory(path: &Path, bytes: usize) -> Refused {
    Refused::at(
        path,
        format_args!(
            "its stars want {bytes} bytes of memory more than there are: a smaller field or brighter stars take less, and an \
         import with less --memory-mb"
        ),
    )
}

/// The folder of an earlier import does not fit.
pub(crate) fn work(path: &Path, why: impl Display) -> Refused {
    Refused::at(path, format_args!("{why}; remove the folder to start over"))
}
