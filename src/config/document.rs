//! One TOML text and where it came from: a file, or compiled in.

use crate::blame::without_the_blamed;
use crate::error::ConfigError;
use crate::packed::{PackedDocuments, joined};
use crate::setting::Setting;
use crate::wrong_type::{wrong_type, wrong_type_of};
use serde::de::DeserializeOwned;
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

/// Names nearer than this (Jaro-Winkler, 0 to 1) are offered as what was meant.
const NEAR_ENOUGH: f64 = 0.75;

/// Keys that other programs have, the one here, and how its value follows.
const SYNONYMS: [(&str, &str, &str); 1] =
    [("f_number", "aperture_mm", "the aperture is focal length / f-number, in millimetres")];

/// A configuration text.
#[derive(Debug, Clone, PartialEq)]
pub struct Document {
    origin: Origin,
    text: String,
    /// Values that are changed before they are read.
    settings: Vec<Setting>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Origin {
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
    pub fn open(path: &Path) -> Result<Self, ConfigError> {
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

    fn read(path: &Path, named_by: String) -> Result<Self, ConfigError> {
        let refuse = |error: std::io::Error| ConfigError::Read {
            file: path.display().to_string(),
            why: reason(&error),
            named_by,
        };
        let text = std::fs::read_to_string(path).map_err(refuse)?;
        Ok(Self { origin: Origin::File(path.into()), text, settings: Vec::new() })
    }

    /// Returns the document of keys that come from outside a file, with the name that messages give it.
    ///
    /// # Errors
    /// When a value has no form in TOML, such as null.
    pub(super) fn of_json(keys: &serde_json::Map<String, serde_json::Value>, name: &Path) -> Result<Self, ConfigError> {
        let text = toml::to_string(keys).map_err(|error| ConfigError::Syntax {
            place: name.display().to_string(),
            why: format!("{error}; leave out what has no value"),
            text: serde_json::to_string(keys).unwrap_or_default(),
        })?;
        Ok(Self::from_text(&text, name))
    }

    /// Returns the document of a text as if it were in the file `path` (which need not exist).
    #[must_use]
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
    pub fn built_in(path: &str) -> Result<Self, ConfigError> {
        Self::find_built_in(Path::new(path), String::new())
    }

    /// Paths below `configs/` of all configurations of the binary.
    pub fn built_in_paths() -> impl Iterator<Item = &'static str> {
        BUILT_IN.iter().map(|(path, _)| *path)
    }

    fn find_built_in(path: &Path, named_by: String) -> Result<Self, ConfigError> {
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
    pub(super) fn named(&self, key: &str, path: &str) -> Result<Self, ConfigError> {
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
    pub(super) fn bytes_of(&self, key: &str, path: &str) -> Result<Vec<u8>, ConfigError> {
        let path = self.data_beside(path);
        let named_by = format!("; named by {key} in {}: paths are relative to the file that names them", self.name());
        let why = |error: std::io::Error| ConfigError::Read {
            file: path.display().to_string(),
            why: error.to_string(),
            named_by,
        };
        std::fs::read(&path).map_err(why)
    }

    /// Returns how messages call it.
    #[must_use]
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
    pub fn packed(set: PackedDocuments) -> Result<Self, ConfigError> {
        Self::unpack(&Arc::new(set), "", String::new())
    }

    fn unpack(set: &Arc<PackedDocuments>, keys: &str, named_by: String) -> Result<Self, ConfigError> {
        let missing =
            || ConfigError::Read { file: format!("packed \"{keys}\""), why: "it was not packed".into(), named_by };
        let text = set.text_of(keys).ok_or_else(missing)?.to_owned();
        Ok(Self { origin: Origin::Packed { set: Arc::clone(set), keys: keys.into() }, text, settings: Vec::new() })
    }

    /// Returns the text as it is written, without settings.
    #[must_use]
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

    /// Reads the text as `S`, whose tables refuse unknown keys.
    pub(super) fn read_as<S: DeserializeOwned>(&self) -> Result<S, ConfigError> {
        let as_written = toml::from_str(&self.text).map_err(|error| self.refuse(&error))?;
        if self.settings.is_empty() {
            return Ok(as_written);
        }
        let mut table: toml::Table = toml::from_str(&self.text).map_err(|error| self.refuse(&error))?;
        let mut read = as_written;
        for setting in &self.settings {
            // Read after each change: the first that cannot be read is the one to blame.
            if setting.apply(&mut table)? {
                let reported = setting.reported();
                let place = format!("{reported} ({})", self.name());
                let refuse = |error: toml::de::Error| {
                    wrong_type_of(self, &error, place.clone(), &setting.key(), setting.value_text())
                        .unwrap_or_else(|| refusal(&error, place, setting.value_text()))
                };
                read = from_table(&table).map_err(refuse)?;
            }
        }
        Ok(read)
    }

    /// Reads the table `name` of this document, where one key decides which others are allowed; `which` is a clause for
    /// messages.
    pub(super) fn read_table<S: DeserializeOwned>(
        &self,
        table: &toml::Table,
        name: &str,
        which: &str,
    ) -> Result<S, ConfigError> {
        let whole = match from_table(table) {
            Ok(read) => return Ok(read),
            Err(error) => error,
        };
        // Every key is optional: the first that cannot be read by itself is the one to blame.
        let bad = table.iter().find_map(|(key, value)| {
            let alone = toml::Table::from_iter([(key.clone(), value.clone())]);
            Some((format!("{name}.{key}"), format!("{key} = {value}"), from_table::<S>(&alone).err()?))
        });
        let (key, text, error) = bad.unwrap_or_else(|| (name.to_owned(), name.to_owned(), whole));
        let value = text.split_once(" = ").map_or("", |(_, value)| value);
        if let Some(refused) = wrong_type_of(self, &error, self.place(&key), &key, value) {
            return Err(refused);
        }
        Err(match refusal(&error, self.place(&key), &text) {
            ConfigError::UnknownKey { place, nearest, known, .. } => {
                ConfigError::UnknownKey { place, key, nearest, known: format!("{known}{which}") }
            }
            refused @ (ConfigError::Read { .. }
            | ConfigError::Syntax { .. }
            | ConfigError::WrongKind { .. }
            | ConfigError::Several { .. }
            | ConfigError::Invalid { .. }) => refused,
        })
    }

    fn refuse(&self, error: &toml::de::Error) -> ConfigError {
        if let Some(refused) = wrong_type(self, error) {
            return refused;
        }
        let offset = error.span().map_or(0, |span| span.start);
        let text = self.text.lines().nth(self.line_of_offset(offset) - 1).unwrap_or_default();
        let mut refused = refusal(error, self.place_of_offset(offset), text.trim());
        if let ConfigError::Syntax { why, .. } = &mut refused {
            if error.message().contains("duplicate key") {
                why.push_str(&self.first_line_of(text));
            } else if let Some(hint) = syntax_hint(text) {
                why.push_str(hint);
            }
            if let Origin::File(path) = &self.origin
                && path.extension().is_none_or(|end| end != "toml")
                && self.text.parse::<toml::Table>().is_err()
            {
                why.push_str(" (wanted a TOML file: a bench, a scenario or a camera)");
            }
        }
        refused
    }

    /// Returns where the key of a line is given for the first time, as a clause.
    fn first_line_of(&self, line: &str) -> String {
        let key_of = |line: &str| match line.split_once('=') {
            Some((key, _)) => Some(key.trim().to_owned()),
            None => line.trim().starts_with('[').then(|| line.trim().to_owned()),
        };
        let (Some(key), lines) = (key_of(line), self.text.lines()) else { return String::new() };
        let first = lines.zip(1..).find(|(other, _)| key_of(other).as_ref() == Some(&key));
        first.map(|(_, number)| format!(": `{key}` is already in line {number}")).unwrap_or_default()
    }

    /// Returns whether a setting changes a value.
    pub(super) fn has_settings(&self) -> bool {
        !self.settings.is_empty()
    }

    /// Returns whether the text has no key at all, and no setting gives one.
    #[must_use]
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

    fn line_of_offset(&self, offset: usize) -> usize {
        1 + self.text.bytes().take(offset).filter(|byte| *byte == b'\n').count()
    }
}

/// Reads a table as `S`, through its text: a second reader, of tables, would be compiled for every type of the configuration.
fn from_table<S: DeserializeOwned>(table: &toml::Table) -> Result<S, toml::de::Error> {
    toml::from_str(&table.to_string())
}

/// Returns the error of a reader of `text`, which is at `place`.
fn refusal(error: &toml::de::Error, place: String, text: &str) -> ConfigError {
    match unknown_key(error.message()) {
        Some((key, known)) => ConfigError::UnknownKey {
            place,
            key: key.into(),
            nearest: match SYNONYMS.iter().find(|(other, name, _)| *other == key && known.contains(name)) {
                Some((_, name, meaning)) => format!(", did you mean `{name}`? ({meaning})"),
                None => nearest(key, known.iter().copied())
                    .map(|name| format!(", did you mean `{name}`?"))
                    .unwrap_or_default(),
            },
            known: if known.is_empty() { "nothing".into() } else { known.join(", ") },
        },
        None => ConfigError::Syntax { place, why: error.message().trim().replace('\n', ", "), text: text.into() },
    }
}

/// Returns the name of `known` most like `name`, when any is like it.
pub(super) fn nearest<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let name = name.to_lowercase();
    let scored = known.map(|candidate| (strsim::jaro_winkler(&name, &candidate.to_lowercase()), candidate));
    scored.filter(|(score, _)| *score >= NEAR_ENOUGH).max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, name)| name)
}

/// Returns what is usually meant by a line that is not TOML, as a clause.
fn syntax_hint(line: &str) -> Option<&'static str> {
    let line = line.trim();
    if line.starts_with('{') || (line.ends_with(':') && !line.contains('=')) {
        return Some(" (wanted a TOML file: [table] on a line of its own, then key = value)");
    }
    let (_, value) = line.split_once('=')?;
    let value = value.split('#').next().unwrap_or_default().trim();
    if value == "True" || value == "False" {
        return Some(" (wanted true or false, in small letters)");
    }
    if value.starts_with('"') && value.contains('\\') {
        return Some(" (a backslash begins an escape in double quotes: put paths in single quotes)");
    }
    let is_decimal_comma = value.split_once(',').is_some_and(|(whole, part)| {
        let is_digits = |text: &str| !text.is_empty() && text.bytes().all(|byte| byte.is_ascii_digit());
        is_digits(whole.trim_start_matches('-')) && is_digits(part)
    });
    if is_decimal_comma {
        return Some(" (decimals have a point)");
    }
    let is_word = value.starts_with(char::is_alphabetic) && !value.contains(['"', '\'']);
    is_word.then_some(" (a word or a path needs quotes)")
}

/// Returns the reason why a file cannot be read, in words for a person.
fn reason(error: &std::io::Error) -> String {
    if error.kind() == std::io::ErrorKind::InvalidData {
        "it is not UTF-8 text; wanted a TOML file".into()
    } else {
        error.to_string()
    }
}

/// Returns the key and its known neighbours out of serde's "unknown field `x`, expected one of `a`, `b`".
fn unknown_key(message: &str) -> Option<(&str, Vec<&str>)> {
    let quoted = message.strip_prefix("unknown field ")?;
    let mut names = quoted.split('`').skip(1).step_by(2);
    Some((names.next()?, names.collect()))
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
