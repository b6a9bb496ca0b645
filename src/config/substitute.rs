//! Substitutes for bad values while the rest of a document is checked: the word that was meant, or, for a key that must
//! be given, any value that its declaration allows.

use crate::error::{ConfigError, meant_word};
use crate::{
    declared::Preset, document::Document, file_kind::FileKind, key_type::Shape, reference::declared, setting::Setting,
    unknown_keys::declared_key,
};

/// Number of the trigger that replaces the first event without a word; no file has it by chance.
const FIRST_TRIGGER: usize = 60_000;

impl Document {
    /// Returns the same document with a substitute for the value that an error is about; `None` without one.
    pub(super) fn with_a_substitute(&self, error: &ConfigError) -> Option<Self> {
        Some(self.clone().with_setting(substitute(self, error)?))
    }
}

fn substitute(document: &Document, error: &ConfigError) -> Option<Setting> {
    let ConfigError::Invalid { place, key, got, wanted, .. } = error else { return None };
    if !place.starts_with(&document.name()) {
        return None;
    }
    let change = if let Some(word) = meant_word(got) {
        format!("{key}=\"{word}\"")
    } else if let Some(event) = key.strip_suffix(".do") {
        // Without its word the event's other keys have no meaning.
        let number: usize = event.split_once('[')?.1.strip_suffix(']')?.parse().ok()?;
        format!("{event}={{ do = \"trigger\", at_s = 0.0, number = {} }}", FIRST_TRIGGER + number)
    } else if error.is_missing() {
        let declared = declared(FileKind::of(document));
        let known = declared_key(&declared, key)?;
        // Which keys an event needs follows from its word.
        let is_needed = matches!(known.preset, Preset::Needed) || key.starts_with("event[");
        format!("{key}={}", allowed(&known.shape).filter(|_| is_needed)?)
    } else if key.ends_with("frame_rate_hz") {
        // Without the key its default may be too fast for the exposure as well, and hide what else is wrong.
        let most_hz: f64 = wanted.strip_prefix("at most ")?.split(' ').next()?.parse().ok()?;
        format!("{key}={:?}", 0.999 * most_hz)
    } else {
        return None;
    };
    Setting::parse(&change).ok()
}

/// Returns a value of a form, in TOML; `None` for texts and words.
fn allowed(shape: &Shape) -> Option<String> {
    match shape {
        Shape::Number(rule) => {
            let number = [1.0, 0.1, 0.0].into_iter().find(|number| rule.is_met_by(*number))?;
            Some(format!("{number:?}"))
        }
        Shape::Whole(range) => Some(1_i64.clamp(*range.start(), *range.end()).to_string()),
        Shape::Row(count, of) => {
            let zero = if matches!(**of, Shape::Whole(_)) { "0" } else { "0.0" };
            let rest = vec![zero; count.saturating_sub(1)];
            Some(format!("[{}]", [vec![if zero == "0" { "1" } else { "1.0" }], rest].concat().join(", ")))
        }
        Shape::Words(_) | Shape::Text(_) | Shape::Flag | Shape::List(_) | Shape::Either(_) | Shape::Table(_) => None,
    }
}
