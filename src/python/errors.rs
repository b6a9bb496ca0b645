//! Errors of the crates as exceptions of Python.

use pyo3::PyErr;
use pyo3::exceptions::{PyMemoryError, PyValueError};

/// Returns an error of this package as the `ValueError` of Python, with all its causes.
pub(crate) fn refused(error: impl core::fmt::Display) -> PyErr {
    PyValueError::new_err(format!("{error:#}"))
}

/// Why an image is not drawn.
pub(crate) enum NotDrawn {
    /// A keyword or a file is at fault: the `ValueError` of Python.
    Refused(String),
    /// The machine has too little memory: the `MemoryError` of Python, before any of it is asked for.
    TooLarge(String),
}

impl From<String> for NotDrawn {
    fn from(why: String) -> Self {
        Self::Refused(why)
    }
}

impl From<NotDrawn> for PyErr {
    fn from(error: NotDrawn) -> Self {
        match error {
            NotDrawn::Refused(why) => PyValueError::new_err(why),
            NotDrawn::TooLarge(why) => PyMemoryError::new_err(why),
        }
    }
}
