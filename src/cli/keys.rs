//! `starloop keys`, `schema` and `init`: every key of the configuration files, as Markdown, JSON Schema or a template.

use anyhow::{Result, bail};
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use config::{FileKind, key_reference, key_schema, key_search, key_template};

// `starloop keys`: every key of every configuration file, or those with some words, as Markdown.

/// Command line of `keys`.
#[derive(Debug, Args)]
#[command(after_help = "Such as: starloop keys camera, starloop keys exposure, starloop keys bench limiting magnitude")]
pub struct KeysArgs {
    #[arg(value_name = "WORD", help = words_help())]
    words: Vec<String>,
}

fn words_help() -> String {
    let kinds = FileKind::ALL.map(FileKind::name).join(", ");
    format!("Kind of file ({kinds}), and words that a key, its table or its meaning has; without any: all keys")
}

/// Reads the word of a kind of file.
pub(crate) fn kinds() -> impl TypedValueParser<Value = FileKind> {
    let named = |word: String| kind_named(&word).ok_or("no kind of file");
    PossibleValuesParser::new(FileKind::ALL.map(FileKind::name)).try_map(named)
}

fn kind_named(word: &str) -> Option<FileKind> {
    FileKind::ALL.into_iter().find(|kind| kind.name() == word)
}

/// Runs the command.
///
/// # Errors
/// When no key has the words.
pub fn run(arguments: &KeysArgs) -> Result<()> {
    let kind = arguments.words.first().and_then(|word| kind_named(word));
    let kinds = kind.map_or(FileKind::ALL.to_vec(), |kind| vec![kind]);
    let words = &arguments.words[usize::from(kind.is_some())..];
    if words.is_empty() {
        print!("{}", key_reference(&kinds));
        return Ok(());
    }
    let found = key_search(&kinds, words);
    if found.is_empty() {
        bail!("no key has \"{}\" in its name, its table or its meaning; fewer words find more", words.join(" "));
    }
    print!("{found}");
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
