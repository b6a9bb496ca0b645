//! `starloop completions`: what a shell needs to complete the command line.

use anyhow::{Result, bail};
use base::streams::Output;
use clap::{Args, ValueEnum};
use clap_complete::Shell;
use std::io::Write;

/// Command line of `completions`.
#[derive(Debug, Args)]
pub struct CompletionsArgs {
    /// Shell that the text is for
    #[arg(value_enum)]
    shell: ShellName,
}

/// A shell, by name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ShellName {
    /// GNU bash
    Bash,
    /// zsh
    Zsh,
    /// fish
    Fish,
}

impl ShellName {
    /// Returns the library's word for it.
    fn shell(self) -> Shell {
        match self {
            Self::Bash => Shell::Bash,
            Self::Zsh => Shell::Zsh,
            Self::Fish => Shell::Fish,
        }
    }
}

/// Runs the command.
///
/// # Errors
/// When nothing could be generated.
pub fn run(arguments: &CompletionsArgs) -> Result<()> {
    let mut text = Vec::new();
    clap_complete::generate(arguments.shell.shell(), &mut crate::cli::command(), "starloop", &mut text);
    if text.is_empty() {
        bail!("no completions were made for {:?}", arguments.shell);
    }
    Ok(Output.write_all(&text)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_shell_gets_every_command() {
        for shell in ShellName::value_variants() {
            let mut text = Vec::new();
            clap_complete::generate(shell.shell(), &mut crate::cli::command(), "starloop", &mut text);
            let text = String::from_utf8(text).unwrap();
            for command in crate::cli::command().get_subcommands() {
                assert!(text.contains(command.get_name()), "{shell:?}: no {}", command.get_name());
            }
            assert!(!text.contains("no-such-command"), "control");
        }
    }
}
