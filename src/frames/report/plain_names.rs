//! Names of counts in plain words, for tables that people read; files have the names as programs know them.

use std::collections::BTreeMap;

/// Returns counts with their names in words: "BadFraming" and "bad_framing" are "bad framing".
pub(super) fn plain_names(counts: &BTreeMap<String, u64>) -> BTreeMap<String, u64> {
    counts.iter().map(|(name, count)| (words_of(name), *count)).collect()
}

fn words_of(name: &str) -> String {
    let mut words = String::new();
    for c in name.chars() {
        if c.is_uppercase() && !words.is_empty() {
            words.push(' ');
        }
        words.extend(if c == '_' { ' ' } else { c }.to_lowercase());
    }
    words
}
