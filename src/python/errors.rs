//! Errors of the crates as exceptions of Python.

use pyo3::PyErr;
use pyo3::exceptions::PyValueError;

/// Returns an error of this package as the `ValueError` of Python, with all its causes.
pub(crate) fn refused(error: impl core::fmt::Display) -> PyErr {
    PyValueError::new_err(format!("{error:#}"))
}
