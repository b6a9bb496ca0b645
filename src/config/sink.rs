//! `[sink]` and `[[extra_sink]]`: where frames go. `kind` says which other keys there are.
//!
//! A new kind is an arm of [`Sink`], a line in [`KINDS`] and a reader in [`read_kind`]; `run::wiring::sinks` makes it.

use crate::declared::{Declared, Presence, Preset};
use crate::display::{DisplayKeys, DisplaySettings};
use crate::error::{ConfigError, Result};
use crate::key::{Inner, Section, section, taken};
use crate::key_type::{Any, Shape, Whole, Word};
use crate::{check::Checker, network_camera as network_camera_keys};
use frames::sink::{RecorderOptions, shared_memory::ring_bytes};
use outputs::network_camera::Params as NetworkCameraParams;
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// Names of iceoryx2 services have at most 255 bytes; a head's number is added.
const SERVICE_BYTES_MAX: usize = 240;

/// A sink with what all kinds have, checked.
#[derive(Debug, Clone, PartialEq)]
pub struct SinkSettings {
    /// Where frames go.
    pub sink: Sink,
    /// Frames it may be behind on the real clock before it loses some.
    pub queue_frames: u32,
}

/// Images of a display: luminances and greys that are exchanged.
const DISPLAY_PICTURES: u64 = 8;

/// Memory that a sink of one head takes beside its thread and its queue.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SinkMemory {
    /// Purpose of the memory.
    pub what: &'static str,
    /// The key that determines it, and its value.
    pub by: Option<(&'static str, u32)>,
    /// Bytes.
    pub bytes: u64,
    /// False for a file in memory, which is outside the process's address space.
    pub is_in_process: bool,
}

impl SinkMemory {
    fn frames(what: &'static str, by: (&'static str, u32), frame_bytes: u64) -> Self {
        Self { what, by: Some(by), bytes: u64::from(by.1) * frame_bytes, is_in_process: true }
    }

    fn fixed(what: &'static str, bytes: u64) -> Self {
        Self { what, by: None, bytes, is_in_process: true }
    }
}

/// Where frames go, checked.
#[derive(Debug, Clone, PartialEq)]
pub enum Sink {
    /// Files.
    Recorder {
        /// Output directory, relative to the working directory: each run has one of its own in it. `None`: below that
        /// of the run.
        directory: Option<PathBuf>,
        /// Kinds of files.
        options: RecorderOptions,
    },
    /// Memory that programs on this machine read.
    SharedMemory {
        /// The file that holds it; in `/dev/shm` it never meets a disk.
        path: PathBuf,
        /// Frames in the buffer before the oldest is overwritten.
        slots: u32,
    },
    /// An iceoryx2 service, for programs on this machine.
    Iceoryx {
        /// Its name.
        service: String,
        /// Frames that a reader may be behind.
        slots: u32,
    },
    /// A camera on the network.
    NetworkCamera(Box<NetworkCameraParams>),
    /// A monitor in front of a tracker.
    Display(Box<DisplaySettings>),
    /// Nowhere (timing only).
    Null,
}

impl Sink {
    /// Returns the word for it in files and messages.
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Recorder { .. } => "recorder",
            Self::SharedMemory { .. } => "shared_memory",
            Self::Iceoryx { .. } => "iceoryx2",
            Self::NetworkCamera(_) => "network_camera",
            Self::Display(_) => "display",
            Self::Null => "null",
        }
    }

    /// Returns the memory it takes for images of `image_px`, whose frames have `frame_bytes`.
    pub fn memory(&self, image_px: [u32; 2], frame_bytes: u64) -> Vec<SinkMemory> {
        match self {
            // One frame as bytes (SER), or as a picture (PNG).
            Self::Recorder { .. } => vec![SinkMemory::fixed("a frame on its way to files", frame_bytes)],
            // A ring on a disk takes no memory.
            Self::SharedMemory { path, .. } if !path.starts_with("/dev/shm") => Vec::new(),
            Self::SharedMemory { slots, .. } => {
                let bytes = ring_bytes(image_px.map(|side| side as usize), *slots);
                let by = Some(("slots", *slots));
                vec![SinkMemory { what: "ring in shared memory", by, bytes, is_in_process: false }]
            }
            Self::Iceoryx { slots, .. } => {
                vec![SinkMemory::frames("frames for readers", ("slots", *slots), frame_bytes)]
            }
            Self::NetworkCamera(params) => vec![
                SinkMemory::frames("frames kept for clients", ("frames_kept", params.frames_kept), frame_bytes),
                SinkMemory::frames(
                    "frames that wait for the network",
                    ("frames_queued", params.frames_queued),
                    frame_bytes,
                ),
            ],
            Self::Display(_) => vec![SinkMemory::fixed("pictures of the display", DISPLAY_PICTURES * frame_bytes)],
            Self::Null => Vec::new(),
        }
    }

    /// Returns the key with the place that it writes to, and that place, when no other sink may write there.
    fn place(&self) -> Option<(&'static str, String)> {
        match self {
            Self::Recorder { directory, .. } => Some(("directory", plain(directory.as_deref()?))),
            Self::SharedMemory { path, .. } => Some(("path", plain(path))),
            Self::Iceoryx { service, .. } => Some(("service", service.clone())),
            Self::NetworkCamera(params) if params.port != 0 => {
                Some(("address", format!("{}:{}", params.address, params.port)))
            }
            Self::NetworkCamera(_) | Self::Display(_) | Self::Null => None,
        }
    }
}

/// Returns a path without detours, for comparing.
fn plain(path: &Path) -> String {
    let path = std::path::absolute(path).unwrap_or_else(|_| path.to_path_buf());
    path.components().collect::<PathBuf>().display().to_string()
}

/// A kind before its keys are read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Recorder,
    SharedMemory,
    Iceoryx,
    NetworkCamera,
    Display,
    Null,
}

/// Every kind by its word.
const KINDS: [(&str, Kind); 6] = [
    ("recorder", Kind::Recorder),
    ("null", Kind::Null),
    ("shared_memory", Kind::SharedMemory),
    ("iceoryx2", Kind::Iceoryx),
    ("network_camera", Kind::NetworkCamera),
    ("display", Kind::Display),
];

/// The keys of one sink, unchecked: the kind decides which are allowed.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(transparent)]
pub(super) struct SinkKeys(toml::Table);

section! {
    /// Keys that every kind of sink has.
    CommonKeys at "sink" {
        /// Recorder writes files, network_camera and display show frames to devices, shared_memory to programs here.
        kind: Word<Kind> = "recorder", KINDS;
        /// Frames it may be behind before it loses some: more of them take more memory.
        queue: Whole = 8, 1..=1024;
    }

    /// Files.
    RecorderKeys at "sink" {
        /// Output directory, relative to the working directory, such as "out/run"; each run has one of its own in it.
        directory: String = Computed("out/ and the bench's name; of an extra sink below that of the run"), "path";
        /// One FITS file per frame.
        fits: bool = true, Any;
        /// All frames in one SER file.
        ser: bool = false, Any;
        /// A PNG of every n-th frame; 0 for none.
        png_every: Whole = 0, 0..=1_000_000, "a PNG of every n-th frame; 0 for none";
    }

    /// Memory that programs on this machine read.
    SharedMemoryKeys at "sink" {
        /// The file that holds it, best in memory, such as "/dev/shm/starloop".
        path: String = Computed("/dev/shm/starloop_ and the bench's name"), "path";
        /// Frames that a slow reader may be behind; each takes the memory of a frame.
        slots: Whole = 4, 2..=64;
    }

    /// An iceoryx2 service, for programs on this machine.
    IceoryxKeys at "sink" {
        /// The name under which readers open it, such as "starloop/frames".
        service: String = Computed("starloop/ and the bench's name"), "text of 1 to 240 bytes";
        /// Frames that a slow reader may be behind; each takes the memory of a frame.
        slots: Whole = 4, 2..=64;
    }

    /// Nowhere (timing only).
    NullKeys at "sink" {}
}

impl Inner for SinkKeys {
    const PRESENCE: Presence = Presence::Once;
    /// Returns a form for each kind, in which `kind` is its word.
    fn forms() -> Vec<Declared> {
        let own = |kind| match kind {
            Kind::Recorder => RecorderKeys::declared(),
            Kind::SharedMemory => SharedMemoryKeys::declared(),
            Kind::Iceoryx => IceoryxKeys::declared(),
            Kind::NetworkCamera => network_camera_keys::NetworkCameraKeys::declared(),
            Kind::Display => DisplayKeys::declared(),
            Kind::Null => NullKeys::declared(),
        };
        let form = |(word, kind)| {
            let mut declared = CommonKeys::declared();
            declared.keys[0].shape = Shape::Words(vec![word]);
            if kind != Kind::Recorder {
                declared.keys[0].preset = Preset::Needed;
            }
            declared.keys.extend(own(kind).keys);
            declared
        };
        KINDS.map(form).into()
    }
}

/// One sink while its keys are read.
pub(super) struct SinkTable<'a> {
    /// Its table: `sink`, `extra_sink[0]`, ...
    name: &'a str,
    /// Its keys but those that every kind has.
    keys: toml::Table,
    /// Name of the bench, for defaults.
    bench: &'a str,
    /// Columns and rows of the camera's images.
    image_px: [u32; 2],
}

impl SinkTable<'_> {
    /// Returns its keys as those of a kind.
    fn read<S: Section>(&self, kind: &str, check: &Checker<'_>) -> Result<S> {
        let keys: S = check.document.read_table(&self.keys, self.name, &format!(" (kind = \"{kind}\")"))?;
        Ok(keys.at(self.name))
    }
}

impl SinkSettings {
    /// Reads `[sink]` and then the extra sinks.
    pub(super) fn check_all(
        first: SinkKeys,
        extra: Vec<SinkKeys>,
        bench: &str,
        image_px: [u32; 2],
        check: &mut Checker<'_>,
    ) -> Result<Vec<Self>> {
        let mut sinks = vec![Self::check("sink", first, bench, image_px, check)?];
        for (i, keys) in extra.into_iter().enumerate() {
            let name = format!("extra_sink[{i}]");
            if !keys.0.contains_key("kind") {
                let words = KINDS.map(|(word, _)| word).join("\", \"");
                let advice = "it is written in addition to [sink], with the same frames";
                return Err(check.invalid(&format!("{name}.kind"), "missing", format!("one of \"{words}\""), advice));
            }
            let settings = Self::check(&name, keys, bench, image_px, check)?;
            let place = settings.sink.place();
            if let Some(other) = place.as_ref().and_then(|_| sinks.iter().position(|other| other.sink.place() == place))
            {
                let other = other.checked_sub(1).map_or_else(|| "sink".into(), |extra| format!("extra_sink[{extra}]"));
                let (key, got) = place.unwrap_or_default();
                let got = format!("{got}, which {other} has");
                let advice = "two sinks would write over each other: give each a place of its own";
                return Err(check.invalid(&format!("{name}.{key}"), got, "a place that no other sink has", advice));
            }
            sinks.push(settings);
        }
        Ok(sinks)
    }

    fn check(name: &str, keys: SinkKeys, bench: &str, image_px: [u32; 2], check: &mut Checker<'_>) -> Result<Self> {
        let document = check.document;
        let mut keys = keys.0;
        let common = keys.iter().filter(|(key, _)| matches!(key.as_str(), "kind" | "queue"));
        let common: toml::Table = common.map(|(key, value)| (key.clone(), value.clone())).collect();
        common.keys().for_each(|key| drop(keys.remove(key)));
        let common = document.read_table::<CommonKeys>(&common, name, "")?.at(name);
        let table = SinkTable { name, keys, bench, image_px };
        taken!(check, &common => kind, queue);
        Ok(Self { sink: read_kind(kind, &table, check)?, queue_frames: queue })
    }
}

fn read_kind(kind: Kind, table: &SinkTable<'_>, check: &mut Checker<'_>) -> Result<Sink> {
    match kind {
        Kind::Recorder => recorder(table, check),
        Kind::SharedMemory => shared_memory(table, check),
        Kind::Iceoryx => iceoryx(table, check),
        Kind::NetworkCamera => {
            let keys = table.read("network_camera", check)?;
            network_camera_keys::check(&keys, check).map(|params| Sink::NetworkCamera(Box::new(params)))
        }
        Kind::Display => {
            let keys: DisplayKeys = table.read("display", check)?;
            if !cfg!(feature = "display") {
                let advice = "install one with `cargo install --locked --path . --features display`";
                return Err(not_built(table, "display", advice, check));
            }
            DisplaySettings::check(&keys, table.image_px, check).map(|settings| Sink::Display(Box::new(settings)))
        }
        Kind::Null => table.read("null", check).map(|_: NullKeys| Sink::Null),
    }
}

fn recorder(table: &SinkTable<'_>, check: &mut Checker<'_>) -> Result<Sink> {
    let keys: RecorderKeys = table.read("recorder", check)?;
    let is_below_run = table.name != "sink" && !keys.directory().is_given();
    let directory = keys.directory().or(format!("out/{}", table.bench));
    let directory = if is_below_run { None } else { Some(directory.check(check)?) };
    if directory.as_deref().is_some_and(|directory| directory.trim().is_empty()) {
        return Err(keys.directory().invalid("empty", "a directory", check));
    }
    taken!(check, keys => fits, ser, png_every);
    let options = RecorderOptions { fits, truth: true, png_every, ser };
    Ok(Sink::Recorder { directory: directory.map(PathBuf::from), options })
}

fn shared_memory(table: &SinkTable<'_>, check: &mut Checker<'_>) -> Result<Sink> {
    let keys: SharedMemoryKeys = table.read("shared_memory", check)?;
    let name: String = table.bench.chars().map(|c| if c.is_alphanumeric() { c } else { '_' }).collect();
    let path = keys.path().or(format!("/dev/shm/starloop_{name}")).check(check)?;
    if path.trim().is_empty() {
        return Err(keys.path().invalid("empty", "a file", check));
    }
    Ok(Sink::SharedMemory { path: path.into(), slots: keys.slots().check(check)? })
}

fn iceoryx(table: &SinkTable<'_>, check: &mut Checker<'_>) -> Result<Sink> {
    let keys: IceoryxKeys = table.read("iceoryx2", check)?;
    if !cfg!(feature = "iceoryx2") {
        let advice = "install one with `cargo install --locked --path . --features iceoryx2`, or use kind = \
                      \"shared_memory\"";
        return Err(not_built(table, "iceoryx2", advice, check));
    }
    let service = keys.service().or(format!("starloop/{}", table.bench)).check(check)?;
    if service.trim().is_empty() || service.len() > SERVICE_BYTES_MAX {
        let got = format!("{} bytes", service.len());
        return Err(keys.service().invalid(got, format!("1 to {SERVICE_BYTES_MAX} bytes"), check));
    }
    Ok(Sink::Iceoryx { service, slots: keys.slots().check(check)? })
}

/// Returns the error for a kind that needs a feature of the build.
fn not_built(table: &SinkTable<'_>, kind: &str, advice: &'static str, check: &Checker<'_>) -> ConfigError {
    let key = format!("{}.kind", table.name);
    check.invalid(&key, format!("\"{kind}\""), "a kind that this starloop was built with", advice)
}
