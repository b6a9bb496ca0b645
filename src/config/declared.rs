//! What is declared of keys and tables: reference, schema and templates walk it.

use crate::bench::BenchKeys;
use crate::camera::CameraKeys;
use crate::file_kind::FileKind;
use crate::key::{Preset, Section, plain};
use crate::key_type::{KeyType, Shape};
use crate::link_keys::LinkTable;
use crate::scenario::ScenarioKeys;
use crate::spacecraft::SpacecraftKeys;

/// All keys of a kind of files.
pub(super) fn declared(kind: FileKind) -> Declared {
    match kind {
        FileKind::Bench => BenchKeys::declared(),
        FileKind::Scenario => ScenarioKeys::declared(),
        FileKind::Camera => CameraKeys::declared(),
        FileKind::Link => LinkTable::declared(),
        FileKind::Spacecraft => SpacecraftKeys::declared(),
    }
}

/// How often a table may be there.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Presence {
    /// Once; without it every key has its default.
    Once,
    /// Once; without it what it describes is not there.
    Optional,
    /// As a list.
    List,
    /// As a list of tables, or of paths of files that hold the same keys.
    ListOrFiles,
    /// Once, or the path of a file that holds the same keys.
    OrFile,
}

/// A table within a table.
pub(super) trait Inner {
    /// How often.
    const PRESENCE: Presence;
    /// Its forms: one, or one for each kind of it.
    fn forms() -> Vec<Declared>;
}

impl<S: Section> Inner for S {
    const PRESENCE: Presence = Presence::Once;
    fn forms() -> Vec<Declared> {
        vec![S::declared()]
    }
}

impl<S: Section> Inner for Option<S> {
    const PRESENCE: Presence = Presence::Optional;
    fn forms() -> Vec<Declared> {
        vec![S::declared()]
    }
}

impl<I: Inner> Inner for Vec<I> {
    const PRESENCE: Presence = match I::PRESENCE {
        Presence::OrFile => Presence::ListOrFiles,
        Presence::Once | Presence::Optional | Presence::List | Presence::ListOrFiles => Presence::List,
    };
    fn forms() -> Vec<Declared> {
        I::forms()
    }
}

/// What is declared of a table.
#[derive(Debug, Clone)]
pub(super) struct Declared {
    pub(super) keys: Vec<Key>,
    pub(super) tables: Vec<Table>,
}

/// What is declared of a table within a table.
#[derive(Debug, Clone)]
pub(super) struct Table {
    pub(super) name: &'static str,
    pub(super) sentence: &'static str,
    pub(super) presence: Presence,
    pub(super) forms: Vec<Declared>,
}

/// What is declared of a key.
#[derive(Debug, Clone)]
pub(super) struct Key {
    pub(super) name: &'static str,
    pub(super) sentence: &'static str,
    pub(super) shape: Shape,
    pub(super) preset: Preset<toml::Value>,
    /// What an error advises beside the sentence; empty when that is the advice.
    pub(super) advice: String,
}

impl Declared {
    /// Whether a file must have something here.
    pub(super) fn is_needed(&self) -> bool {
        self.keys.iter().any(|key| matches!(key.preset, Preset::Needed)) || self.tables.iter().any(Table::is_needed)
    }
}

impl Table {
    /// Whether a file must have it.
    pub(super) fn is_needed(&self) -> bool {
        self.presence == Presence::Once && self.forms.iter().all(Declared::is_needed)
    }

    /// Keys that all forms have.
    pub(super) fn is_common(&self, key: &Key) -> bool {
        self.forms.iter().all(|form| form.keys.iter().any(|other| other.name == key.name))
    }
}

impl Key {
    pub(super) fn of<T: KeyType>(
        [name, sentence]: [&'static str; 2],
        advice: &[&'static str],
        preset: Preset<T::Default>,
        limit: &T::Limit,
    ) -> Self {
        let preset = match preset {
            Preset::Needed => Preset::Needed,
            Preset::Noted(default) => Preset::Noted(default.into()),
            Preset::Silent(default) => Preset::Silent(default.into()),
            Preset::Computed(text) => Preset::Computed(text),
            Preset::Optional => Preset::Optional,
        };
        Self { name: plain(name), sentence: sentence.trim(), shape: T::shape(limit), preset, advice: advice.concat() }
    }
}

/// Ends of names with the units they mean; the first that fits counts.
const UNITS: [(&str, &str); 51] = [
    ("_deg_sqrt_h", "deg/sqrt(h)"),
    ("_deg_h_sqrt_h", "deg/h/sqrt(h)"),
    ("_n_m_sqrt_s", "N m/sqrt(s)"),
    ("_sqrt_kg_m", "sqrt(kg) m"),
    ("_photons_per_s_m2", "photons/(s m^2)"),
    ("_per_cm2_s", "1/(cm^2 s)"),
    ("_na_per_cm2", "nA/cm^2"),
    ("_per_arcsec2", "mag/arcsec^2"),
    ("_cycles_per_row", "cycles per row"),
    ("_e_per_dn", "e-/DN"),
    ("_e_per_s", "e-/s"),
    ("_per_px", "per pixel"),
    ("_per_s", "1/s"),
    ("_mbit_s", "Mbit/s"),
    ("_kg_m2", "kg m^2"),
    ("_n_m_s", "N m s"),
    ("_n_m", "N m"),
    ("_deg_s2", "deg/s^2"),
    ("_px_s2", "px/s^2"),
    ("_deg_h", "deg/h"),
    ("_deg_s", "deg/s"),
    ("_px_s", "px/s"),
    ("_km_s", "km/s"),
    ("_e_rms", "e- rms"),
    ("_e_pp", "e- peak to peak"),
    ("_mag_1000km", "mag"),
    ("_arcsec", "arcsec"),
    ("_waves", "waves"),
    ("_within_s", "s"),
    ("_bytes", "bytes"),
    ("_frames", "frames"),
    ("_mev", "MeV"),
    ("_ppm", "ppm"),
    ("_rpm", "rpm"),
    ("_mag", "mag"),
    ("_deg", "deg"),
    ("_hz", "Hz"),
    ("_mb", "MiB"),
    ("_ms", "ms"),
    ("_us", "us"),
    ("_nm", "nm"),
    ("_um", "um"),
    ("_mm", "mm"),
    ("_km", "km"),
    ("_px", "px"),
    ("_dn", "DN"),
    ("_s", "s"),
    ("_e", "e-"),
    ("_c", "degrees Celsius"),
    ("_k", "K"),
    ("_m", "m"),
];

impl Key {
    /// The unit of its numbers, as the name says it.
    pub(super) fn unit(&self) -> Option<&'static str> {
        let is_number = match &self.shape {
            Shape::Number(_) | Shape::Whole(_) => true,
            Shape::Row(_, of) => matches!(**of, Shape::Number(_) | Shape::Whole(_)),
            Shape::Words(_) | Shape::Text(_) | Shape::Flag | Shape::List(_) | Shape::Either(_) => false,
        };
        let name = format!("_{}", self.name);
        UNITS.iter().find(|(end, _)| is_number && name.ends_with(end)).map(|(_, unit)| *unit)
    }

    /// What it means, and what else an error about it would say.
    pub(super) fn meaning(&self) -> String {
        let sentence = self.sentence.trim_end_matches('.');
        let advice = self.advice.trim_end_matches('.');
        if advice.is_empty() || sentence.to_lowercase().contains(&advice.to_lowercase()) {
            return format!("{sentence}.");
        }
        format!("{sentence}: {advice}.")
    }
}
