//! The module `starloop._native` of the Python package: thin classes over the crates; the package beside it
//! (`package/`) gives them their Python form.
//!
//! Requests and facts go as JSON text, pixels as numpy arrays. The interpreter lock is released while frames are drawn.
//! Tests: `hil_scripts/tests/test_python.py`.

mod camera;
mod data_set;
mod errors;
mod frame;
mod request;
mod session;

use pyo3::prelude::*;

/// Cameras and runs of starloop in process.
#[pymodule]
mod _native {
    #[pymodule_export]
    use super::camera::Camera;
    #[pymodule_export]
    use super::data_set::DataSet;
    #[pymodule_export]
    use super::frame::Frame;
    #[pymodule_export]
    use super::session::Session;

    use pyo3::prelude::*;
    use std::path::PathBuf;

    /// Returns the version of the package.
    #[pyfunction]
    fn version() -> &'static str {
        env!("CARGO_PKG_VERSION")
    }

    /// Returns the files of a data set whose bytes are not those that were written.
    #[pyfunction]
    fn damaged_files(py: Python<'_>, folder: PathBuf) -> PyResult<Vec<String>> {
        py.detach(|| data_sets::folder::damaged(&folder)).map_err(super::errors::refused)
    }
}
