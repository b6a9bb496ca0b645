//! Declarations of keys and tables: reference, schema and templates read them.

use crate::key_type::{KeyType, Numbers, Shape, TextDefault};

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
    /// As a list of one at least.
    NeededList,
}

/// The meaning of a key that the file does not give.
#[derive(Debug, Clone)]
pub(super) enum Preset<T> {
    /// It must be given.
    Needed,
    /// This, and the list of defaults says so.
    Noted(T),
    /// This: nothing that anybody would ask about, mostly "off".
    Silent(T),
    /// The reference prints this text; where the key is checked, `or` has the value.
    Computed(&'static str),
    /// Nothing.
    Optional,
}

macro_rules! noted {
    ($($type:ty),*) => {
        $(impl From<$type> for Preset<$type> {
            fn from(default: $type) -> Self {
                Self::Noted(default)
            }
        })*
    };
}

noted!(f64, i64, bool, &'static str);

impl<const N: usize> From<Numbers<N>> for Preset<Numbers<N>> {
    fn from(default: Numbers<N>) -> Self {
        Self::Noted(default)
    }
}

impl From<&'static str> for Preset<TextDefault> {
    fn from(default: &'static str) -> Self {
        Self::Noted(default.into())
    }
}

/// Declaration of a table.
#[derive(Debug, Clone)]
pub(super) struct Declared {
    pub(super) keys: Vec<Key>,
    pub(super) tables: Vec<Table>,
}

/// Declaration of a table within a table.
#[derive(Debug, Clone)]
pub(super) struct Table {
    pub(super) name: &'static str,
    pub(super) sentence: &'static str,
    pub(super) presence: Presence,
    pub(super) forms: Vec<Declared>,
}

/// Declaration of a key.
#[derive(Debug, Clone)]
pub(super) struct Key {
    pub(super) name: &'static str,
    pub(super) sentence: &'static str,
    pub(super) shape: Shape,
    pub(super) preset: Preset<toml::Value>,
    /// Advice of an error beside the sentence; empty when the sentence is the advice.
    pub(super) advice: String,
}

impl Declared {
    /// Returns whether a file must have something here.
    pub(super) fn is_needed(&self) -> bool {
        self.keys.iter().any(|key| matches!(key.preset, Preset::Needed)) || self.tables.iter().any(Table::is_needed)
    }
}

impl Table {
    /// Returns whether a file must have it.
    pub(super) fn is_needed(&self) -> bool {
        let is_one = self.presence == Presence::Once && self.forms.iter().all(Declared::is_needed);
        is_one || self.presence == Presence::NeededList
    }

    /// Returns keys that all forms have.
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
const UNITS: &str = "\
    deg_sqrt_h deg/sqrt(h); deg_h_sqrt_h deg/h/sqrt(h); n_m_sqrt_s N m/sqrt(s); sqrt_kg_m sqrt(kg) m; \
    photons_per_s_m2 photons/(s m^2); per_cm2_s 1/(cm^2 s); na_per_cm2 nA/cm^2; per_arcsec2 mag/arcsec^2; \
    cycles_per_row cycles per row; e_per_dn e-/DN; e_per_s e-/s; per_px per pixel; per_s 1/s; mbit_s Mbit/s; \
    kg_m2 kg m^2; n_m_s N m s; n_m N m; deg_s2 deg/s^2; px_s2 px/s^2; deg_h deg/h; deg_s deg/s; px_s px/s; \
    km_s km/s; e_rms e- rms; e_pp e- peak to peak; mag_1000km mag; arcsec arcsec; waves waves; within_s s; \
    bytes bytes; frames frames; mev MeV; ppm ppm; rpm rpm; mag mag; deg deg; hz Hz; mb MiB; ms ms; us us; \
    nm nm; um um; mm mm; km km; px px; dn DN; s s; e e-; c degrees Celsius; k K; m m";

impl Key {
    /// Returns the unit of its numbers, as the name says it.
    pub(super) fn unit(&self) -> Option<&'static str> {
        let is_number = match &self.shape {
            Shape::Number(_) | Shape::Whole(_) => true,
            Shape::Row(_, of) => matches!(**of, Shape::Number(_) | Shape::Whole(_)),
            Shape::Words(_) | Shape::Text(_) | Shape::Flag | Shape::List(_) | Shape::Either(_) | Shape::Table(_) => {
                false
            }
        };
        let name = format!("_{}", self.name);
        let mut units = UNITS.split("; ").filter_map(|pair| pair.split_once(' '));
        units.find(|(end, _)| is_number && name.ends_with(&format!("_{end}"))).map(|(_, unit)| unit)
    }

    /// Returns the meaning of the key: its sentence and the advice of its errors.
    pub(super) fn meaning(&self) -> String {
        let sentence = self.sentence.trim_end_matches('.');
        let advice = self.advice.trim_end_matches('.');
        if advice.is_empty() || sentence.to_lowercase().contains(&advice.to_lowercase()) {
            return format!("{sentence}.");
        }
        format!("{sentence}: {advice}.")
    }
}

/// Returns a name without the mark that lets Rust take it where it is a word of its own: `do`.
pub(super) fn plain(name: &'static str) -> &'static str {
    name.trim_start_matches("r#")
}
