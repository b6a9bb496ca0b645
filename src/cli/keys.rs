//! `starloop keys`: every key of every configuration file, as Markdown.

use anyhow::Result;
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use config::{FileKind, key_reference};

/// Command line of `keys`.
#[derive(Debug, Args)]
pub struct KeysArgs {
    /// Kind of file; without one: all
    #[arg(value_parser = kinds())]
    kind: Option<FileKind>,
}

/// Reads the word of a kind of file.
pub(crate) fn kinds() -> impl TypedValueParser<Value = FileKind> {
    let named = |word: String| FileKind::ALL.into_iter().find(|kind| kind.name() == word).ok_or("no kind of file");
    PossibleValuesParser::new(FileKind::ALL.map(FileKind::name)).try_map(named)
}

/// Runs the command.
///
/// # Errors
/// Never.
pub fn run(arguments: &KeysArgs) -> Result<()> {
    let kinds = arguments.kind.map_or(FileKind::ALL.to_vec(), |kind| vec![kind]);
    print!("{}", key_reference(&kinds));
    Ok(())
}
