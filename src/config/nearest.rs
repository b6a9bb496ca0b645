//! The known name that was meant by an unknown one.

/// Names nearer than this (Jaro-Winkler, 0 to 1) are offered as what was meant.
const NEAR_ENOUGH: f64 = 0.75;

/// Returns the name of `known` most like `name`, when any is like it.
pub fn nearest<'a>(name: &str, known: impl Iterator<Item = &'a str>) -> Option<&'a str> {
    let name = name.to_lowercase();
    let scored = known.map(|candidate| (strsim::jaro_winkler(&name, &candidate.to_lowercase()), candidate));
    scored.filter(|(score, _)| *score >= NEAR_ENOUGH).max_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, name)| name)
}

/// Returns a word that is not known in quotes, and the known one that was meant, if one is like it.
pub(super) fn with_what_was_meant<'a>(word: &str, known: impl Iterator<Item = &'a str>) -> String {
    let meant = nearest(word, known).map(|known| format!("{MEANT}{known}\"?)")).unwrap_or_default();
    format!("\"{word}\"{meant}")
}

/// Returns the known word that was meant, out of that.
pub(super) fn meant_word(got: &str) -> Option<&str> {
    got.split_once(MEANT)?.1.strip_suffix("\"?)")
}

/// Before a word that was meant.
const MEANT: &str = " (did you mean \"";
