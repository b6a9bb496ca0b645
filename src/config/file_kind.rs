//! Kinds of configuration files, and the refusal of one in the place of another.

use crate::document::Document;
use crate::error::{ConfigError, Result};

/// The kinds of files below `configs/`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum FileKind {
    /// A run of the stimulator.
    Bench,
    /// A bench with a spacecraft, events and expectations.
    Scenario,
    /// Optics and detector.
    Camera,
    /// A bus.
    Link,
    /// Inertia, wheels, gyro, tracker.
    Spacecraft,
    /// Cases that a star tracker flies.
    TestPlan,
    /// Limits of a star tracker's metrics.
    Requirements,
    /// Images with labels.
    DataSet,
}

/// Each kind that is not a bench, with top-level keys by which it is recognised. The first match counts.
const KEYS: [(FileKind, &[&str]); 7] = [
    (FileKind::Requirements, &["requirement"]),
    (FileKind::TestPlan, &["case", "start_utc", "frame_rate_hz", "probability", "requirements"]),
    (FileKind::DataSet, &["draw", "output", "licence", "fault", "motion", "time"]),
    (FileKind::Scenario, &["spacecraft"]),
    (FileKind::Camera, &["detector", "optics"]),
    (FileKind::Spacecraft, &["body", "wheel", "gyro"]),
    (FileKind::Link, &["kind", "wire", "bit_rate", "interface", "port"]),
];

/// Keys by which a bench is recognised where another kind is wanted.
const BENCH_KEYS: [&str; 8] =
    ["camera", "timing", "flight_computer", "sink", "observer", "session", "mounting", "render"];

impl FileKind {
    /// Returns the kind of a file by its top-level keys; a file without any known key is a bench, all of whose keys
    /// have defaults.
    pub fn of(document: &Document) -> Self {
        let has_one = |keys: &[&str]| keys.iter().any(|key| document.has_key(key));
        match KEYS.iter().find(|(_, keys)| has_one(keys)) {
            // A bench may fly a spacecraft itself.
            Some((Self::Scenario, _)) if !document.has_key("bench") && has_one(&BENCH_KEYS) => Self::Bench,
            Some((kind, _)) => *kind,
            None => Self::Bench,
        }
    }

    /// Every kind.
    pub const ALL: [Self; 8] = [
        Self::Bench,
        Self::Scenario,
        Self::Camera,
        Self::Link,
        Self::Spacecraft,
        Self::TestPlan,
        Self::Requirements,
        Self::DataSet,
    ];

    /// Returns its word on the command line and in messages.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Bench => "bench",
            Self::Scenario => "scenario",
            Self::Camera => "camera",
            Self::Link => "link",
            Self::Spacecraft => "spacecraft",
            Self::TestPlan => "plan",
            Self::Requirements => "requirements",
            Self::DataSet => "dataset",
        }
    }

    /// Returns how a file of this kind is used.
    const fn use_of_it(self) -> &'static str {
        match self {
            Self::Bench => "`starloop run`, `check` and `budget` take a bench",
            Self::Scenario => "`starloop run`, `check` and `campaign` take a scenario",
            Self::Camera => {
                "`starloop snr`, `psf`, `verify` and `render --camera` take a camera; a bench names it: camera = \"FILE\""
            }
            Self::Link => {
                "a bench names a link file: link = \"FILE\"; `starloop link-check` tries an interface or a port"
            }
            Self::Spacecraft => "a scenario names a spacecraft file: spacecraft = \"FILE\"",
            Self::TestPlan => "`starloop fly` and `check` take a test plan",
            Self::Requirements => {
                "`starloop report --requirements` and `check` take requirements; a test plan names them: requirements = \"FILE\""
            }
            Self::DataSet => "`starloop dataset` and `check` take a description of a data set",
        }
    }
}

/// Refuses a document of another kind than `wanted`.
pub(super) fn must_be(wanted: FileKind, document: &Document) -> Result<()> {
    must_be_one_of(&[wanted], document)
}

/// Refuses a document of a kind that is not among those wanted; the message names the first of them.
pub(super) fn must_be_one_of(wanted: &[FileKind], document: &Document) -> Result<()> {
    let got = FileKind::of(document);
    let is_unclear = got == FileKind::Bench && !BENCH_KEYS.iter().any(|key| document.has_key(key));
    let Some(first) = wanted.first() else { return Ok(()) };
    if wanted.contains(&got) || is_unclear {
        return Ok(());
    }
    Err(ConfigError::WrongKind {
        place: document.name(),
        got: got.name(),
        wanted: first.name(),
        advice: got.use_of_it(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Bench, Camera};

    #[test]
    fn kind_of_every_built_in_file_is_that_of_its_folder() {
        for path in Document::built_in_paths() {
            let kind = FileKind::of(&Document::built_in(path).unwrap());
            let folder = path.split('/').next().unwrap();
            let wanted = match folder {
                "benches" => FileKind::Bench,
                "scenarios" => FileKind::Scenario,
                "cameras" => FileKind::Camera,
                "links" => FileKind::Link,
                "spacecraft" => FileKind::Spacecraft,
                other => panic!("folder {other}"),
            };
            assert_eq!(kind, wanted, "{path}");
        }
    }

    #[test]
    fn file_of_another_kind_is_refused_with_the_command_that_takes_it() {
        let refused = |path: &str| Bench::from_document(&Document::built_in(path).unwrap()).unwrap_err().to_string();
        let camera = refused("cameras/star_tracker_20deg.toml");
        assert!(camera.contains("is a camera file; wanted a bench file: `starloop snr`"), "{camera}");
        assert!(refused("links/socketcan.toml").contains("is a link file; wanted a bench"));
        assert!(refused("spacecraft/smallsat.toml").contains("is a spacecraft file"));
        let scenario = Document::built_in("scenarios/acquisition.toml").unwrap();
        let refused = Camera::from_document(&scenario).unwrap_err().to_string();
        assert!(refused.contains("is a scenario file"), "{refused}");
        let bench = Document::built_in("benches/loopback.toml").unwrap();
        let refused = Camera::from_document(&bench).unwrap_err().to_string();
        assert!(refused.contains("is a bench file; wanted a camera file"), "{refused}");
    }
}
