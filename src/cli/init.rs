//! `starloop init`: a configuration file in which every key is explained and commented out.

use crate::cli::keys::kinds;
use anyhow::Result;
use clap::Args;
use config::{FileKind, key_template};

/// Command line of `init`.
#[derive(Debug, Args)]
#[command(after_help = "Such as: starloop init camera > my_camera.toml")]
pub struct InitArgs {
    /// Kind of file
    #[arg(value_parser = kinds(), default_value = "bench")]
    kind: FileKind,
}

/// Runs the command.
///
/// # Errors
/// Never.
pub fn run(arguments: &InitArgs) -> Result<()> {
    print!("{}", key_template(arguments.kind));
    Ok(())
}
