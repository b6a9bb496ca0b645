//! Where results come from, as this machine and this command line have it.

use crate::cli::version;
use anyhow::Result;
use base::clock::{Clock, Monotonic};
use config::{Document, Scenario};
use frames::report::{Losses, Machine};
use frames::sink::replace_own_file;
use performance::provenance::{FileHash, Provenance, SCHEMA};
use stars::catalog::Catalog;
use std::path::Path;

/// Name of the file in the folder of a run.
pub(super) const FILE: &str = "provenance.json";

/// Returns what holds for everything that this command makes; files and seeds are the caller's to add.
pub(super) fn provenance() -> Provenance {
    let machine = Machine::read();
    let program = std::env::current_exe().ok().and_then(|path| FileHash::of_file(&path, "starloop").ok());
    Provenance {
        schema: SCHEMA.into(),
        program_version: version::SHORT.into(),
        program_sha256: program.map(|program| program.sha256).unwrap_or_default(),
        command_line: std::env::args_os().map(|word| word.to_string_lossy().into_owned()).collect(),
        made_utc: Monotonic::start().now().to_rfc3339(),
        host: host(),
        cpu: machine.cpu,
        system: machine.system,
        seeds: Vec::new(),
        catalogs: catalogs(),
        files: Vec::new(),
    }
}

fn host() -> String {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let name = name.trim();
    if name.is_empty() { "unknown".into() } else { name.into() }
}

fn catalogs() -> Vec<(String, String)> {
    let Ok(catalog) = Catalog::built_in() else { return Vec::new() };
    let index = catalog.index();
    let [bright, faint] = index.magnitudes;
    let words = format!(
        "{} stars, magnitudes {bright} to {faint}, epoch {}, CRC-32 {:08x}",
        index.stars(),
        index.epoch_yr,
        index.crc32
    );
    vec![("built-in".into(), words)]
}

/// Writes where a run comes from into its folder; what cannot be written is a loss of the run.
pub(super) fn keep(
    folder: &Path,
    (document, settings): (&Document, &[String]),
    scenario: &Scenario,
    losses: &mut Losses,
) {
    let written = of_run(document, settings, scenario).and_then(|from| {
        let json = serde_json::to_string_pretty(&from)?;
        Ok(replace_own_file(&folder.join(FILE), |out| out.write_all(json.as_bytes()))?)
    });
    if let Err(error) = written {
        losses.note_file(FILE, format!("{error:#}"));
    }
}

/// Returns where a run comes from: the configuration with every file that it names, as it was read, and the seeds.
///
/// # Errors
/// When a file that the configuration names cannot be read any more.
fn of_run(document: &Document, settings: &[String], scenario: &Scenario) -> Result<Provenance> {
    let mut from = provenance();
    let bench = &scenario.bench;
    from.seeds = vec![("seed".into(), bench.seed), ("noise_seed".into(), bench.noise_seed())];
    from.files = configuration_files(document)?;
    from.files.extend(settings.iter().map(|setting| FileHash::of_text("--set", setting)));
    for layer in &bench.layers {
        let path = layer.display().to_string();
        from.files.push(FileHash::of_file(layer, &path)?);
    }
    Ok(from)
}

/// Returns every text and file of data that a configuration is made of.
fn configuration_files(document: &Document) -> Result<Vec<FileHash>> {
    let pack = document.pack()?;
    let texts = serde_json::to_value(&pack)?;
    let mut files = Vec::new();
    for text in texts.as_object().into_iter().flat_map(serde_json::Map::values) {
        let word = |key: &str| text.get(key).and_then(serde_json::Value::as_str).unwrap_or_default();
        files.push(FileHash::of_text(word("name"), word("text")));
    }
    for (path, _) in pack.data() {
        files.push(FileHash::of_file(&path, &path.display().to_string())?);
    }
    Ok(files)
}

/// Returns the hash of a file under the name that it was given by; of one that cannot be read, why not in its place.
///
/// # Errors
/// When it cannot be read.
pub(super) fn file(path: &Path) -> Result<FileHash> {
    FileHash::of_file(path, &path.display().to_string())
}
