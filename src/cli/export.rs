//! `starloop export`: attitudes, the observer's orbit and places of stars of a run, in the files of other tools.
//!
//! Input: the folder of a recorded run, or a run file, which is not drawn. Output: files whose endings say what
//! they are; one that exists is refused without `--force`.

use crate::cli::export_source::ExportSource;
use anyhow::{Context, Result, bail};
use base::clock::{Clock, Monotonic};
use clap::Args;
use frames::sink::{write_file_atomically, write_new_file};
use histories::write::{self, AttitudeFormat, Header, OrbitFormat};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// Command line of `export`.
#[derive(Debug, Args)]
#[command(
    after_help = "Endings: attitude .aem (CCSDS AEM, KVN), .xml (AEM 2, XML), .a (STK), .csv; observer .oem, .xml, .e \
                        (STK), .csv; places .csv.\n\nAttitudes are those at mid-exposure, of the sensor's axes (of the body's \
                        with --body), with rates where the format has them; src/guide/files_in_and_out.md has conventions."
)]
pub struct ExportArgs {
    /// Folder of a recorded run, or a bench or scenario file, or the name of a built-in one
    source: PathBuf,
    /// Attitude at mid-exposure of every frame
    #[arg(long, value_name = "FILE")]
    attitude: Option<PathBuf>,
    /// Where the observer is at mid-exposure of every frame, from the centre of the body that it is about
    #[arg(long, value_name = "FILE")]
    observer: Option<PathBuf>,
    /// Apparent and catalog places of the stars of every frame, from the truth tables of a recorded run
    #[arg(long, value_name = "FILE.csv")]
    places: Option<PathBuf>,
    /// Run file of a recorded run: with --observer and --body
    #[arg(long, value_name = "FILE")]
    bench: Option<PathBuf>,
    /// Camera head, counted from 0, whose frames or mounting are meant; needed where a recorded run has several [without it: 0]
    #[arg(long, value_name = "N")]
    head: Option<usize>,
    /// Attitude of the spacecraft's body instead of the sensor's
    #[arg(long)]
    body: bool,
    /// Version of an AEM as KVN: 1 has no rates
    #[arg(long, value_name = "1|2", default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=2))]
    aem_version: u8,
    /// Name of the object in the files
    #[arg(long, value_name = "NAME", default_value = "STARLOOP")]
    object_name: String,
    /// International designator of the object in the files
    #[arg(long, value_name = "ID", default_value = "UNKNOWN")]
    object_id: String,
    /// Replace files that exist
    #[arg(long)]
    force: bool,
}

/// Runs the command.
///
/// # Errors
/// With what could not be done, and why.
pub fn run(arguments: &ExportArgs) -> Result<()> {
    let attitude = match arguments.attitude.as_deref() {
        Some(path) => Some((path, attitude_format(path, arguments)?)),
        None => None,
    };
    let observer = match arguments.observer.as_deref() {
        Some(path) => Some((path, orbit_format(path)?)),
        None => None,
    };
    if attitude.is_none() && observer.is_none() && arguments.places.is_none() {
        bail!("nothing to write: wanted --attitude FILE, --observer FILE or --places FILE");
    }
    check_words(arguments)?;
    let source = ExportSource::open(&arguments.source, arguments.bench.as_deref(), arguments.head)?;
    let body = if arguments.body { "SC_BODY_1".to_owned() } else { format!("STARTRACKER_{}", source.head() + 1) };
    let header = Header {
        object_name: arguments.object_name.clone(),
        object_id: arguments.object_id.clone(),
        body,
        created: Monotonic::start().now(),
    };
    if let Some((path, format)) = attitude {
        let history = source.attitudes(arguments.body)?;
        let rows = history.rows();
        save(path, arguments.force, |out| write::attitudes(out, format, &history, &header))?;
        println!("{}: {rows} attitudes of {}", path.display(), header.body);
    }
    if let Some((path, format)) = observer {
        let orbit = source.observer()?;
        let rows = orbit.rows();
        save(path, arguments.force, |out| write::orbit(out, format, &orbit, &header))?;
        println!("{}: {rows} states from {}", path.display(), orbit.centre.name());
    }
    if let Some(path) = &arguments.places {
        let mut text = String::new();
        let rows = source.write_places(&mut text)?;
        save(path, arguments.force, |out| out.write_all(text.as_bytes()))?;
        println!("{}: {rows} places", path.display());
    }
    Ok(())
}

/// Returns names go into lines of `KEY = VALUE`.
fn check_words(arguments: &ExportArgs) -> Result<()> {
    for (name, word) in [("--object-name", &arguments.object_name), ("--object-id", &arguments.object_id)] {
        if word.trim().is_empty() || word.chars().any(char::is_control) {
            bail!("{name}: got \"{}\", wanted text on one line", word.escape_debug());
        }
    }
    Ok(())
}

fn attitude_format(path: &Path, arguments: &ExportArgs) -> Result<AttitudeFormat> {
    let format = match ending(path).as_str() {
        "aem" | "kvn" if arguments.aem_version == 1 => AttitudeFormat::Aem1,
        "aem" | "kvn" => AttitudeFormat::Aem2,
        "xml" => AttitudeFormat::Aem2Xml,
        "a" => AttitudeFormat::Stk,
        "csv" => AttitudeFormat::Csv,
        _ => bail!("--attitude {}: wanted a name that ends in .aem, .xml, .a or .csv", path.display()),
    };
    if arguments.aem_version == 1 && format != AttitudeFormat::Aem1 {
        bail!("--aem-version 1: wanted a name that ends in .aem, got --attitude {}", path.display());
    }
    Ok(format)
}

fn orbit_format(path: &Path) -> Result<OrbitFormat> {
    match ending(path).as_str() {
        "oem" | "kvn" => Ok(OrbitFormat::Oem),
        "xml" => Ok(OrbitFormat::OemXml),
        "e" => Ok(OrbitFormat::Stk),
        "csv" => Ok(OrbitFormat::Csv),
        _ => bail!("--observer {}: wanted a name that ends in .oem, .xml, .e or .csv", path.display()),
    }
}

fn ending(path: &Path) -> String {
    path.extension().map_or_else(String::new, |ending| ending.to_string_lossy().to_ascii_lowercase())
}

fn save(path: &Path, replaces: bool, write: impl FnOnce(&mut dyn Write) -> io::Result<()>) -> Result<()> {
    let saved = if replaces { write_file_atomically(path, write) } else { write_new_file(path, write) };
    let advice = if replaces { "" } else { " (--force replaces a file that exists)" };
    saved.map(|_| ()).with_context(|| format!("{}{advice}", path.display()))
}
