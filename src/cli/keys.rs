//! `starloop keys`, `schema` and `init`: every key of the configuration files, as Markdown, JSON Schema or a template.

use anyhow::Result;
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use config::{FileKind, key_reference, key_schema, key_template};

// `starloop keys`: every key of every configuration file, as Markdown.

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

// `starloop schema`: the JSON Schema of a kind of configuration files, for editors and validators.

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
pub fn run_schema(arguments: &SchemaArgs) -> Result<()> {
    println!("{}", serde_json::to_string_pretty(&key_schema(arguments.kind))?);
    Ok(())
}

// `starloop init`: a configuration file in which every key is explained and commented out.

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
pub fn run_init(arguments: &InitArgs) -> Result<()> {
    print!("{}", key_template(arguments.kind));
    Ok(())
}
