//! `starloop schema`: the JSON Schema of a kind of configuration files, for editors and validators.

use crate::cli::keys::kinds;
use anyhow::Result;
use clap::Args;
use config::{FileKind, key_schema};

/// Command line of `schema`.
#[derive(Debug, Args)]
pub struct SchemaArgs {
    /// Kind of file
    #[arg(value_parser = kinds(), default_value = "bench")]
    kind: FileKind,
}

/// Runs the command.
///
/// # Errors
/// When the schema cannot be written as text.
pub fn run(arguments: &SchemaArgs) -> Result<()> {
    println!("{}", serde_json::to_string_pretty(&key_schema(arguments.kind))?);
    Ok(())
}
