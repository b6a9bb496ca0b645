//! `starloop man`: manual pages, written from the command line's own help.

use anyhow::{Context, Result};
use base::streams::Output;
use clap::{Args, Command};
use clap_mangen::Man;
use frames::sink::write_file_atomically;
use std::{io::Write, path::PathBuf};

/// Section of the manual: commands.
const SECTION: &str = "1";

/// Command line of `man`.
#[derive(Debug, Args)]
pub struct ManArgs {
    /// Folder that gets a page for every command (made where it is missing); without one the program's own page is
    /// printed
    folder: Option<PathBuf>,
}

/// Runs the command.
///
/// # Errors
/// When a page cannot be written.
pub fn run(arguments: &ManArgs) -> Result<()> {
    let pages = pages()?;
    let Some(folder) = &arguments.folder else {
        let (_, first) = pages.first().context("the manual has 0 pages")?;
        return Ok(Output.write_all(first)?);
    };
    std::fs::create_dir_all(folder).with_context(|| format!("cannot make {}", folder.display()))?;
    for (name, text) in &pages {
        write_file_atomically(&folder.join(name), |out| out.write_all(text))?;
    }
    println!("{} pages in {}", pages.len(), folder.display());
    Ok(())
}

/// Returns the names and texts of all pages, that of the program first.
fn pages() -> Result<Vec<(String, Vec<u8>)>> {
    let mut program = crate::cli::command().disable_help_subcommand(true);
    program.build();
    let mut pages = Vec::new();
    add_pages(&program, "starloop", &mut pages)?;
    Ok(pages)
}

/// Adds the page of a command and those of the commands below it.
fn add_pages(command: &Command, name: &str, pages: &mut Vec<(String, Vec<u8>)>) -> Result<()> {
    // Pages of the groups' listing would say everything twice.
    let plain = command.clone().before_help(None::<&str>).name(name.to_owned()).display_name(name.to_owned());
    let mut text = Vec::new();
    let source = format!("starloop {}", env!("CARGO_PKG_VERSION"));
    Man::new(plain).section(SECTION).source(source).manual("starloop").render(&mut text)?;
    pages.push((format!("{name}.{SECTION}"), text));
    for below in command.get_subcommands() {
        add_pages(below, &format!("{name}-{}", below.get_name()), pages)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn commands(command: &Command) -> usize {
        1 + command.get_subcommands().map(commands).sum::<usize>()
    }

    #[test]
    fn every_command_has_a_page_with_its_options() {
        let pages = pages().unwrap();
        assert_eq!(pages.len(), commands(&crate::cli::command()));
        let text = |name: &str| {
            let page = pages.iter().find(|(found, _)| found == name);
            String::from_utf8(page.unwrap_or_else(|| panic!("no {name}")).1.clone()).unwrap()
        };
        assert!(text("starloop.1").contains("Exit status"), "{}", text("starloop.1"));
        assert!(text("starloop-run.1").contains("clock"));
        assert!(text("starloop-catalog-query.1").contains("radius"));
        assert!(!text("starloop-run.1").contains("radius"), "control");
    }
}
