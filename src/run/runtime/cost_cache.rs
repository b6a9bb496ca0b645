//! The cost cache: measured [`CostModel`]s kept between program runs, one TOML file per backend and machine.
//!
//! In: a file below `$XDG_CACHE_HOME/starloop` or `~/.cache/starloop`. Out: constants, or why they are not used: a file
//! that is damaged, or was made on another machine, adapter or version of starloop, is refused with an error that
//! states what, where, wanted and got. Tests below.

use base::input_file::{SETTINGS_BYTES, read_text};
use base::refused::Refused;
use frames::{report::Machine, sink::write_file_atomically};
use plan::exposure::cost::CostModel;
use serde::{Deserialize, Serialize};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Identity of the machine, backend and version that constants belong to.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CostOwner {
    /// Version of starloop.
    pub starloop_version: String,
    /// Processor.
    pub cpu: String,
    /// Hardware threads.
    pub cores: usize,
    /// Operating system and architecture.
    pub system: String,
    /// Backend.
    pub backend: String,
    /// Device the backend runs on.
    pub adapter: String,
}

/// One file of the cache.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CachedCost {
    /// Time of the measurement, UTC, RFC 3339.
    pub measured_utc: String,
    /// Machine, backend and version that were measured.
    pub owner: CostOwner,
    /// The constants.
    pub cost: CostModel,
}

impl CostOwner {
    /// Returns the identity of a backend on this machine with this version.
    pub fn here(backend: &str, adapter: &str) -> Self {
        let Machine { cpu, cores, system } = Machine::read();
        let starloop_version = env!("CARGO_PKG_VERSION").into();
        Self { starloop_version, cpu, cores, system, backend: backend.into(), adapter: adapter.into() }
    }

    /// Returns the path of its file in a folder.
    pub fn file_in(&self, folder: &Path) -> PathBuf {
        let plain = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '_' };
        let cpu: String = self.cpu.chars().map(plain).collect();
        folder.join(format!("costs_{}_{cpu}.toml", self.backend))
    }

    /// Returns the first field in which `other` differs: name, wanted, got.
    fn difference(&self, other: &Self) -> Option<(&'static str, String, String)> {
        let fields = |owner: &Self| {
            [
                ("starloop version", owner.starloop_version.clone()),
                ("processor", owner.cpu.clone()),
                ("number of hardware threads", owner.cores.to_string()),
                ("system", owner.system.clone()),
                ("backend", owner.backend.clone()),
                ("adapter", owner.adapter.clone()),
            ]
        };
        let mut pairs = fields(self).into_iter().zip(fields(other));
        pairs.find(|((_, wanted), (_, got))| wanted != got).map(|((name, wanted), (_, got))| (name, wanted, got))
    }
}

/// Returns the cache folder, if the system has a place for one.
pub fn folder() -> Option<PathBuf> {
    let absolute = |name: &str| std::env::var_os(name).map(PathBuf::from).filter(|path| path.is_absolute());
    let cache = absolute("XDG_CACHE_HOME").or_else(|| absolute("HOME").map(|home| home.join(".cache")))?;
    Some(cache.join("starloop"))
}

/// Writes constants to a file atomically.
///
/// # Errors
/// When the file cannot be written.
pub fn write(path: &Path, cached: &CachedCost) -> Result<(), Refused> {
    let text = toml::to_string(cached).map_err(|error| Refused::at(path, error))?;
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).map_err(|error| Refused::at(path, error))?;
    }
    write_file_atomically(path, |out| out.write_all(text.as_bytes()))
        .map(drop)
        .map_err(|error| Refused::at(path, error))
}

/// Reads the constants of `owner`; `None` when they were never measured.
///
/// # Errors
/// When the file is damaged or belongs to something else.
pub fn read(path: &Path, owner: &CostOwner) -> Result<Option<CachedCost>, Refused> {
    let text = match read_text(path, SETTINGS_BYTES) {
        Ok(text) => text,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(None),
        Err(error) => return Err(damaged(path, &error.to_string())),
    };
    let damaged = |reason: &str| {
        let lines = reason.lines().map(str::trim).filter(|line| !line.is_empty());
        damaged(path, &lines.collect::<Vec<_>>().join("; "))
    };
    let cached: CachedCost = toml::from_str(&text).map_err(|error| damaged(error.message()))?;
    if let Some((what, wanted, got)) = owner.difference(&cached.owner) {
        let why = format!("{what}: wanted \"{wanted}\", got \"{got}\"; `starloop calibrate` measures again");
        return Err(Refused::at(path, why));
    }
    if !cached.cost.is_sound() {
        return Err(damaged("a constant is negative or not finite"));
    }
    Ok(Some(cached))
}

fn damaged(path: &Path, reason: &str) -> Refused {
    Refused::at(path, format!("damaged ({reason}); `starloop calibrate` makes a new one"))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sample() -> CachedCost {
        let owner = CostOwner::here("cpu", "AVX-512, 2 threads");
        let cost = CostModel { splat_ns: 0.1 + 0.2, ..CostModel::CPU };
        CachedCost { measured_utc: "2026-03-01T00:00:00Z".into(), owner, cost }
    }

    #[test]
    fn constants_read_back_exactly_and_absence_is_accepted() {
        let folder = tempfile::tempdir().unwrap();
        let cached = sample();
        let path = cached.owner.file_in(&folder.path().join("deep/down"));
        assert_eq!(read(&path, &cached.owner).unwrap(), None, "nothing measured yet");
        write(&path, &cached).unwrap();
        let back = read(&path, &cached.owner).unwrap().unwrap();
        assert_eq!(back, cached);
        assert_ne!(back.cost, CostModel::CPU, "the comparison can fail");
    }

    #[test]
    fn a_foreign_cache_is_refused_with_wanted_and_got() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("costs.toml");
        let here = sample();
        let owner = || here.owner.clone();
        let owners = [
            ("0.0.0-old", CostOwner { starloop_version: "0.0.0-old".into(), ..owner() }),
            ("Another CPU", CostOwner { cpu: "Another CPU".into(), ..owner() }),
            ("4097", CostOwner { cores: 4097, ..owner() }),
            ("gpu", CostOwner { backend: "gpu".into(), ..owner() }),
            ("Another adapter", CostOwner { adapter: "Another adapter".into(), ..owner() }),
        ];
        for (got, owner) in owners {
            let foreign = CachedCost { owner, ..here.clone() };
            write(&path, &foreign).unwrap();
            let reported = read(&path, &here.owner).unwrap_err().to_string();
            for part in ["costs.toml", "wanted", got] {
                assert!(reported.contains(part), "no \"{part}\" in: {reported}");
            }
            assert_eq!(reported.lines().count(), 1, "one line: {reported}");
        }
    }

    #[test]
    fn a_damaged_cache_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("costs.toml");
        let here = sample();
        write(&path, &here).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let half = text[..text.len() / 2].to_owned();
        let negative = text.replace("frame_ms = ", "frame_ms = -1");
        assert_ne!(text, negative, "the comparison can fail");
        let numbers =
            text.lines().skip_while(|line| *line != "[cost]").skip(1).filter_map(|line| line.split_once(" = "));
        let not_a_number =
            numbers.map(|(key, value)| text.replace(&format!("{key} = {value}"), &format!("{key} = nan")));
        let mut wrong: Vec<String> = not_a_number.collect();
        assert_eq!(wrong.len(), 15, "every constant");
        wrong.extend([half, negative, "\u{0}".into(), String::new()]);
        for wrong in wrong {
            std::fs::write(&path, wrong).unwrap();
            let reported = read(&path, &here.owner).unwrap_err().to_string();
            assert!(reported.contains("costs.toml") && reported.lines().count() == 1, "{reported}");
        }
    }
}
