//! `starloop dataset` in a program built without the feature `data_sets`: it fails and says how to build one with it.

use anyhow::{Result, bail};
use clap::Args;

/// Command line of `dataset`: anything.
#[derive(Debug, Args)]
pub struct DataSetArgs {
    /// Whatever a program with data sets takes
    #[arg(trailing_var_arg = true, allow_hyphen_values = true, hide = true)]
    words: Vec<String>,
}

/// Fails.
///
/// # Errors
/// Always.
pub fn run(_: &DataSetArgs) -> Result<u8> {
    bail!(
        "dataset: this program was built without data sets; install one with \
         `cargo install --locked --path . --features data_sets`"
    )
}
