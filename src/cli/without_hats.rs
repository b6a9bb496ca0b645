//! `with_hats` in a program built without the feature `hats`: it fails and says how to build one with it.

use crate::cli::catalog_hats::Input;
use anyhow::{Error, Result, anyhow};
use imports::published::gaia::Names;
use stars::layer::{Layer, Sorting};
use std::path::Path;

/// A Parquet file, which this program cannot read.
pub(super) enum Parquet {}

impl Parquet {
    /// Fails for every file.
    pub(super) fn alone(path: &Path) -> Result<Self> {
        Err(missing(path))
    }

    /// Imports it.
    pub(super) fn import(&self, _: &Input, _: &mut Sorting, _: &mut dyn FnMut(u64)) -> Result<u64> {
        match *self {}
    }
}

/// Fails for every catalog.
pub(super) fn partitions(folder: &Path, _: &Names, _: f64) -> Result<Vec<Input>> {
    Err(missing(folder))
}

/// Writes nothing and fails.
pub(super) fn export(_: &[Layer], folder: &Path, _: (&str, usize), _: &mut dyn FnMut(f64)) -> Result<String> {
    Err(missing(folder))
}

fn missing(path: &Path) -> Error {
    anyhow!(
        "{}: this program was built without HATS catalogs and Parquet files; install one with \
         `cargo install --locked --path . --features hats`",
        path.display()
    )
}
