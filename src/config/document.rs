//! One TOML text and where it came from: a file, or compiled in.
//!
//! The part of a TOML text that an error is about, and the text without it.

use crate::error::{ConfigError, Result};
use crate::packed::{PackedDocuments, joined};
use crate::setting::Setting;
use base::input_file::{DATA_BYTES, SETTINGS_BYTES, read_bytes, read_text};
use core::ops::Range;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;
use toml::de::{DeTable, DeValue};

/// Configurations that are part of the binary, by their path below `configs/`.
const BUILT_IN: &[(&str, &str)] = &[
    ("benches/lockstep.toml", include_str!("../../configs/benches/lockstep.toml")),
    ("benches/loopback.toml", include_str!("../../configs/benches/loopback.toml")),
    ("benches/galactic_slew.toml", include_str!("../../configs/benches/galactic_slew.toml")),
    ("cameras/crowded_field_10deg.toml", include_str!("../../configs/cameras/crowded_field_10deg.toml")),
    ("benches/cubesat.toml", include_str!("../../configs/benches/cubesat.toml")),
    ("benches/bench_20hz.toml", include_str!("../../configs/benches/bench_20hz.toml")),
    ("cameras/star_tracker_20deg_20hz.toml", include_str!("../../configs/cameras/star_tracker_20deg_20hz.toml")),
    ("benches/closed_loop.toml", include_str!("../../configs/benches/closed_loop.toml")),
    ("benches/closed_loop_small.toml", include_str!("../../configs/benches/closed_loop_small.toml")),
    ("benches/lunar_orbit.toml", include_str!("../../configs/benches/lunar_orbit.toml")),
    ("benches/three_heads.toml", include_str!("../../configs/benches/three_heads.toml")),
    ("benches/earth_limb.toml", include_str!("../../configs/benches/earth_limb.toml")),
    ("benches/moon.toml", include_str!("../../configs/benches/moon.toml")),
    ("benches/tracker_in.toml", include_str!("../../configs/benches/tracker_in.toml")),
    ("benches/tracker_out.toml", include_str!("../../configs/benches/tracker_out.toml")),
    ("benches/telescope.toml", include_str!("../../configs/benches/telescope.toml")),
    ("benches/target_crossing.toml", include_str!("../../configs/benches/target_crossing.toml")),
    ("benches/closed_loop_jitter.toml", include_str!("../../configs/benches/closed_loop_jitter.toml")),
    ("benches/closed_loop_small_jitter.toml", include_str!("../../configs/benches/closed_loop_small_jitter.toml")),
    ("cameras/star_tracker_20deg.toml", include_str!("../../configs/cameras/star_tracker_20deg.toml")),
    ("cameras/chain_tracker.toml", include_str!("../../configs/cameras/chain_tracker.toml")),
    ("cameras/cubesat_tracker.toml", include_str!("../../configs/cameras/cubesat_tracker.toml")),
    ("cameras/imx265_35mm.toml", include_str!("../../configs/cameras/imx265_35mm.toml")),
    ("cameras/small_tracker.toml", include_str!("../../configs/cameras/small_tracker.toml")),
    ("cameras/wide_field_telescope.toml", include_str!("../../configs/cameras/wide_field_telescope.toml")),
    ("cameras/detection_limit_15mag.toml", include_str!("../../configs/cameras/detection_limit_15mag.toml")),
    ("cameras/detection_limit_22mag.toml", include_str!("../../configs/cameras/detection_limit_22mag.toml")),
    ("benches/gateways_faults.toml", include_str!("../../configs/benches/gateways_faults.toml")),
    ("benches/gateways.toml", include_str!("../../configs/benches/gateways.toml")),
    ("benches/grabber.toml", include_str!("../../configs/benches/grabber.toml")),
    ("benches/serial.toml", include_str!("../../configs/benches/serial.toml")),
    ("benches/socketcan.toml", include_str!("../../configs/benches/socketcan.toml")),
    ("benches/forty_two.toml", include_str!("../../configs/benches/forty_two.toml")),
    ("benches/udp.toml", include_str!("../../configs/benches/udp.toml")),
    ("links/serial_port.toml", include_str!("../../configs/links/serial_port.toml")),
    ("links/socketcan.toml", include_str!("../../configs/links/socketcan.toml")),
    ("links/simulated_can_fd.toml", include_str!("../../configs/links/simulated_can_fd.toml")),
    ("links/simulated_can_classic.toml", include_str!("../../configs/links/simulated_can_classic.toml")),
    ("links/simulated_serial.toml", include_str!("../../configs/links/simulated_serial.toml")),
    ("scenarios/acquisition.toml", include_str!("../../configs/scenarios/acquisition.toml")),
    ("scenarios/campaign.toml", include_str!("../../configs/scenarios/campaign.toml")),
    ("scenarios/study.toml", include_str!("../../configs/scenarios/study.toml")),
    ("scenarios/bus_dropouts.toml", include_str!("../../configs/scenarios/bus_dropouts.toml")),
    ("scenarios/bus_faults.toml", include_str!("../../configs/scenarios/bus_faults.toml")),
    ("scenarios/fine_pointing.toml", include_str!("../../configs/scenarios/fine_pointing.toml")),
    ("scenarios/imaging_faults.toml", include_str!("../../configs/scenarios/imaging_faults.toml")),
    ("scenarios/no_tracker.toml", include_str!("../../configs/scenarios/no_tracker.toml")),
    ("scenarios/slew_and_settle.toml", include_str!("../../configs/scenarios/slew_and_settle.toml")),
    ("scenarios/stray_light.toml", include_str!("../../configs/scenarios/stray_light.toml")),
    ("scenarios/sun_avoidance.toml", include_str!("../../configs/scenarios/sun_avoidance.toml")),
    ("scenarios/three_heads.toml", include_str!("../../configs/scenarios/three_heads.toml")),
    ("scenarios/wheel_sweep.toml", include_str!("../../configs/scenarios/wheel_sweep.toml")),
    ("spacecraft/smallsat.toml", include_str!("../../configs/spacecraft/smallsat.toml")),
    ("spacecraft/smallsat_keep_out.toml", include_str!("../../configs/spacecraft/smallsat_keep_out.toml")),
    ("spacecraft/smallsat_stiff_array.toml", include_str!("../../configs/spacecraft/smallsat_stiff_array.toml")),
];

/// A configuration text.
#[derive(Debug, Clone, PartialEq)]
pub struct Document {
    pub(super) origin: Origin,
    text: String,
    /// Values that are changed before they are read.
    pub(super) settings: Vec<Setting>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Origin {
    File(PathBuf),
    BuiltIn(PathBuf),
    /// One of a packed set, by the keys that led to it.
    Packed {
        set: Arc<PackedDocuments>,
        keys: String,
    },
}

impl Document {
    /// Reads a file; where there is none, the configuration of the binary with this path below `configs/`.
    ///
    /// # Errors
    /// When it cannot be read.
    pub fn open(path: &Path) -> Result<Self> {
        let below_configs = path.strip_prefix("configs").unwrap_or(path);
        let is_built_in = BUILT_IN.iter().any(|(known, _)| Path::new(known) == below_configs);
        if is_built_in && !path.exists() {
            return Self::find_built_in(below_configs, String::new());
        }
        let known: Vec<_> =
            Self::built_in_paths().filter(|known| Path::new(known).parent() == below_configs.parent()).collect();
        let others = if known.is_empty() { String::new() } else { format!("; built in are {}", known.join(", ")) };
        Self::read(path, others)
    }

    /// Returns the same document without the key that an error is about; `None` when that cannot be found.
    pub(super) fn without_the_blamed(&self, error: &ConfigError) -> Option<Self> {
        let text = without_the_blamed(&self.text, &self.name(), error)?;
        Some(Self { text, ..self.clone() })
    }

    /// Returns the same document without the settings that an error is about; `None` when it is about none.
    pub(super) fn without_the_blamed_setting(&self, error: &ConfigError) -> Option<Self> {
        let ConfigError::Invalid { place, .. } = error else { return None };
        let is_blamed = |setting: &Setting| place.starts_with(setting.reported());
        let settings: Vec<Setting> = self.settings.iter().filter(|setting| !is_blamed(setting)).cloned().collect();
        (settings.len() < self.settings.len()).then(|| self.clone().with_settings(settings))
    }

    fn read(path: &Path, named_by: String) -> Result<Self> {
        let refuse = |error: std::io::Error| ConfigError::Read {
            file: path.display().to_string(),
            why: reason(&error),
            named_by,
        };
        let text = read_text(path, SETTINGS_BYTES).map_err(refuse)?;
        Ok(Self { origin: Origin::File(path.into()), text, settings: Vec::new() })
    }

    /// Returns the document of keys that come from outside a file, with the name that messages give it.
    ///
    /// # Errors
    /// When a value has no form in TOML, such as null.
    pub(super) fn of_json(keys: &serde_json::Map<String, serde_json::Value>, name: &Path) -> Result<Self> {
        let text = toml::to_string(keys).map_err(|error| ConfigError::Syntax {
            place: name.display().to_string(),
            why: format!("{error}; leave out what has no value"),
            text: serde_json::to_string(keys).unwrap_or_default(),
        })?;
        Ok(Self::from_text(&text, name))
    }

    /// Returns the document of a text as if it were in the file `path` (which need not exist).
    pub fn from_text(text: &str, path: &Path) -> Self {
        Self { origin: Origin::File(path.into()), text: text.into(), settings: Vec::new() }
    }

    /// Returns the same with values changed, in this order; those of a file that it names are changed there.
    #[must_use]
    pub fn with_settings(self, settings: Vec<Setting>) -> Self {
        Self { settings, ..self }
    }

    /// Returns the same with one more changed value.
    #[must_use]
    pub fn with_setting(mut self, setting: Setting) -> Self {
        self.settings.push(setting);
        self
    }

    /// Returns a configuration of the binary, by its path below `configs/`, such as `benches/loopback.toml`.
    ///
    /// # Errors
    /// When the binary has none of that name; the message lists those it has.
    pub fn built_in(path: &str) -> Result<Self> {
        Self::find_built_in(Path::new(path), String::new())
    }

    /// Paths below `configs/` of all configurations of the binary.
    pub fn built_in_paths() -> impl Iterator<Item = &'static str> {
        BUILT_IN.iter().map(|(path, _)| *path)
    }

    fn find_built_in(path: &Path, named_by: String) -> Result<Self> {
        let found = BUILT_IN.iter().find(|(known, _)| Path::new(known) == path);
        let names = || Self::built_in_paths().collect::<Vec<_>>().join(", ");
        let (known, text) = found.ok_or_else(|| ConfigError::Read {
            file: format!("built-in {}", path.display()),
            why: format!("no such configuration in the binary, which has: {}", names()),
            named_by,
        })?;
        Ok(Self { origin: Origin::BuiltIn(known.into()), text: (*text).into(), settings: Vec::new() })
    }

    /// Returns the document that the value of `key` names, relative to this one.
    pub(super) fn named(&self, key: &str, path: &str) -> Result<Self> {
        let named_by = format!("; named by {key} in {}: paths are relative to the file that names them", self.name());
        let directory = |own: &PathBuf| own.parent().map(Path::to_path_buf).unwrap_or_default();
        let document = match &self.origin {
            Origin::File(own) => Self::read(&directory(own).join(path), named_by),
            Origin::BuiltIn(own) => Self::find_built_in(&without_dots(&directory(own).join(path)), named_by),
            Origin::Packed { set, keys } => Self::unpack(set, &joined(keys, key), named_by),
        };
        let settings = self.settings.iter().filter_map(|setting| setting.below(key)).collect();
        document.map(|document| document.with_settings(settings))
    }

    /// Returns where a file lies that is named by its place and not kept, such as a layer of stars: beside this
    /// document. What is packed names the place it was packed from.
    pub(super) fn file_beside(&self, path: &str) -> PathBuf {
        let own = match &self.origin {
            Origin::File(own) | Origin::BuiltIn(own) => own.clone(),
            Origin::Packed { .. } => PathBuf::from(self.name()),
        };
        beside(&own, path)
    }

    /// Returns where a file of data lies: beside this document; of a built-in one, in the working directory; of a
    /// packed one, where it is kept, or, in packs of versions that kept none, beside the place it was packed from.
    pub(super) fn data_beside(&self, path: &str) -> PathBuf {
        match &self.origin {
            Origin::File(own) => beside(own, path),
            Origin::BuiltIn(_) => PathBuf::from(path),
            Origin::Packed { set, keys } => set.data_file(keys, path),
        }
    }

    /// Returns the bytes of the file that the value of `key` names, relative to this one.
    pub(super) fn bytes_of(&self, key: &str, path: &str) -> Result<Vec<u8>> {
        let path = self.data_beside(path);
        let named_by = format!("; named by {key} in {}: paths are relative to the file that names them", self.name());
        let why = |error: std::io::Error| ConfigError::Read {
            file: path.display().to_string(),
            why: error.to_string(),
            named_by,
        };
        read_bytes(&path, DATA_BYTES).map_err(why)
    }

    /// Returns how messages call it.
    pub fn name(&self) -> String {
        match &self.origin {
            Origin::File(path) => path.display().to_string(),
            Origin::BuiltIn(path) => format!("built-in {}", path.display()),
            Origin::Packed { set, keys } => set.name_of(keys),
        }
    }

    /// Returns the document that was packed.
    ///
    /// # Errors
    /// When it is not there.
    pub fn packed(set: PackedDocuments) -> Result<Self> {
        Self::unpack(&Arc::new(set), "", String::new())
    }

    fn unpack(set: &Arc<PackedDocuments>, keys: &str, named_by: String) -> Result<Self> {
        let missing =
            || ConfigError::Read { file: format!("packed \"{keys}\""), why: "it was not packed".into(), named_by };
        let text = set.text_of(keys).ok_or_else(missing)?.to_owned();
        Ok(Self { origin: Origin::Packed { set: Arc::clone(set), keys: keys.into() }, text, settings: Vec::new() })
    }

    /// Returns the text as it is written, without settings.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Returns the file name without its extension: the default name of what the document describes.
    pub(super) fn stem(&self) -> String {
        let name = match &self.origin {
            Origin::Packed { .. } => PathBuf::from(self.name().trim_start_matches("built-in ")),
            Origin::File(path) | Origin::BuiltIn(path) => path.clone(),
        };
        name.file_stem().map_or_else(|| "unnamed".into(), |stem| stem.to_string_lossy().into_owned())
    }

    /// Returns whether a setting changes a value.
    pub(super) fn has_settings(&self) -> bool {
        !self.settings.is_empty()
    }

    /// Returns whether the text has no key at all, and no setting gives one.
    pub fn is_blank(&self) -> bool {
        self.settings.is_empty() && DeTable::parse(&self.text).is_ok_and(|table| table.get_ref().is_empty())
    }

    /// Returns whether the text has this top-level key; false when it cannot be parsed.
    pub(super) fn has_key(&self, key: &str) -> bool {
        let is_set = self.settings.iter().any(|setting| setting.is_for(key));
        is_set || DeTable::parse(&self.text).is_ok_and(|table| table.get_ref().contains_key(key))
    }

    /// Returns the setting that gives a key, else file and line of a key such as `optics.focal_length_mm` or
    /// `flight_computer.jitter_line[1].phase_deg`; of the innermost table that exists when the key does not.
    pub(super) fn place(&self, key: &str) -> String {
        if let Some(setting) = self.settings.iter().rev().find(|setting| setting.gives(key)) {
            return format!("{} ({})", setting.reported(), self.name());
        }
        let offset = DeTable::parse(&self.text).ok().and_then(|table| offset_of_key(table.get_ref(), key));
        offset.map_or_else(|| self.name(), |offset| self.place_of_offset(offset))
    }

    pub(super) fn place_of_offset(&self, offset: usize) -> String {
        format!("{}:{}", self.name(), self.line_of_offset(offset))
    }

    pub(super) fn line_of_offset(&self, offset: usize) -> usize {
        1 + self.text.bytes().take(offset).filter(|byte| *byte == b'\n').count()
    }
}

/// Returns the reason why a file cannot be read, in words for a person.
fn reason(error: &std::io::Error) -> String {
    if error.kind() == std::io::ErrorKind::InvalidData {
        "it is not UTF-8 text; wanted a TOML file".into()
    } else {
        error.to_string()
    }
}

fn offset_of_key(root: &DeTable<'_>, key: &str) -> Option<usize> {
    let mut offset = None;
    let mut table = root;
    for segment in key.split('.') {
        let (name, place) = match segment.split_once('[') {
            Some((name, rest)) => (name, rest.trim_end_matches(']').parse::<usize>().ok()),
            None => (segment, None),
        };
        let Some((spanned_key, value)) = table.get_key_value(name) else { break };
        offset = Some(spanned_key.span().start);
        let value = match (value.get_ref(), place) {
            (DeValue::Array(items), Some(place)) => match items.get(place) {
                Some(item) => {
                    offset = Some(item.span().start);
                    item.get_ref()
                }
                None => break,
            },
            (value, _) => value,
        };
        let DeValue::Table(inner) = value else { break };
        table = inner;
    }
    offset
}

/// Returns a path relative to the file that names it.
pub(super) fn beside(own: &Path, path: &str) -> PathBuf {
    own.parent().map(Path::to_path_buf).unwrap_or_default().join(path)
}

/// Returns the path with `.` and `..` resolved by name: compiled-in files have no directories.
fn without_dots(path: &Path) -> PathBuf {
    path.components().fold(PathBuf::new(), |mut clean, component| {
        match component {
            Component::ParentDir => {
                clean.pop();
            }
            Component::CurDir => {}
            Component::Prefix(_) | Component::RootDir | Component::Normal(_) => clean.push(component),
        }
        clean
    })
}

/// Returns the text with what `error` is about blanked out, line numbers kept; `None` when that cannot be found, or
/// when the rest is not TOML. `name` is how messages call the document.
pub(super) fn without_the_blamed(text: &str, name: &str, error: &ConfigError) -> Option<String> {
    let parsed = DeTable::parse(text).ok()?;
    let root = parsed.get_ref();
    let range = if let ConfigError::UnknownKey { place, .. } | ConfigError::Syntax { place, .. } = error {
        let line: usize = place.strip_prefix(name)?.strip_prefix(':')?.parse().ok()?;
        range_on_line(root, text, line)?
    } else if let ConfigError::Invalid { place, key, .. } = error
        && place.starts_with(name)
    {
        range_of_blamed(root, key)?
    } else {
        return None;
    };
    let blanked = blanked(text, with_its_table(text, range))?;
    DeTable::parse(&blanked).is_ok().then_some(blanked)
}

/// Returns the bytes of a key, with its whole table where the table has no meaning without it.
fn range_of_blamed(root: &DeTable<'_>, key: &str) -> Option<Range<usize>> {
    let chooses = key.ends_with(".kind") || key.ends_with(".model");
    let own = range_of_key(root, key);
    let table = key.rsplit_once('.').map(|(table, _)| table).filter(|table| !table.ends_with(']'));
    own.clone().filter(|_| !chooses).or_else(|| range_of_key(root, table?)).or(own)
}

/// Returns the bytes of a key such as `link.bit_rate` or `event[1].for_s`, with its value.
fn range_of_key(root: &DeTable<'_>, key: &str) -> Option<Range<usize>> {
    let mut table = root;
    let mut steps = key.split('.').peekable();
    while let Some(step) = steps.next() {
        let (name, place) = match step.split_once('[') {
            Some((name, rest)) => (name, rest.trim_end_matches(']').parse::<usize>().ok()),
            None => (step, None),
        };
        let (spanned, value) = table.get_key_value(name)?;
        if steps.peek().is_none() {
            return Some(spanned.span().start..value.span().end);
        }
        let value = match (value.get_ref(), place) {
            (DeValue::Array(items), Some(place)) => items.get(place)?.get_ref(),
            (value, _) => value,
        };
        let DeValue::Table(inner) = value else { return None };
        table = inner;
    }
    None
}

/// Returns the innermost key that begins on a line, with its value.
fn range_on_line(table: &DeTable<'_>, text: &str, line: usize) -> Option<Range<usize>> {
    let line_of = |offset: usize| 1 + text.bytes().take(offset).filter(|byte| *byte == b'\n').count();
    table.iter().find_map(|(key, value)| {
        let in_table = |value: &DeValue<'_>| {
            if let DeValue::Table(inner) = value { range_on_line(inner, text, line) } else { None }
        };
        let inner = if let DeValue::Array(items) = value.get_ref() {
            items.iter().find_map(|item| in_table(item.get_ref()))
        } else {
            in_table(value.get_ref())
        };
        let is_here = line_of(key.span().start) == line || line_of(value.span().start) == line;
        inner.or_else(|| is_here.then(|| key.span().start..value.span().end))
    })
}

/// Extends a table's header to all lines below it, up to the next header.
fn with_its_table(text: &str, range: Range<usize>) -> Range<usize> {
    let line_start = text[..range.start].rfind('\n').map_or(0, |end| end + 1);
    if !text[line_start..].trim_start().starts_with('[') {
        return range;
    }
    let mut end = line_start;
    for (number, line) in text[line_start..].split_inclusive('\n').enumerate() {
        if number > 0 && line.trim_start().starts_with('[') {
            break;
        }
        end += line.len();
    }
    line_start..end
}

/// Returns the text with blanks in place of a range; `None` when the range does not end at whole characters.
fn blanked(text: &str, range: Range<usize>) -> Option<String> {
    let inside = text.get(range.clone())?;
    let blanks: String = inside.chars().map(|c| if c == '\n' { '\n' } else { ' ' }).collect();
    Some(format!("{}{blanks}{}", &text[..range.start], &text[range.end..]))
}
