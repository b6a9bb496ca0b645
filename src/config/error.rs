//! Errors of a configuration: what is wrong, where, what was wanted, what was given, and what to try.
//!
//! The known name that was meant by an unknown one.

/// A checked value, or what is wrong with the configuration.
pub(crate) type Result<T, E = ConfigError> = core::result::Result<T, E>;
/// A value, and what is wrong with the files that it was made from, left out of it.
pub(super) type Partly<T> = (T, Vec<ConfigError>);

/// Value of a key that is not given, in messages.
pub(super) const MISSING: &str = "missing";

/// A configuration that was refused.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("{file}: cannot be read ({why}){named_by}")]
    Read {
        /// The file.
        file: String,
        /// The reason given by the system.
        why: String,
        /// The key and file that name it, as a clause; empty for the command line.
        named_by: String,
    },
    /// The text is not TOML, or a value has the wrong type.
    #[error("{place}: {why}, in `{text}`")]
    Syntax {
        /// File and line.
        place: String,
        /// The reader's message: what it found and what it expected.
        why: String,
        /// The line.
        text: String,
    },
    /// A key that nothing would read.
    #[error("{place}: unknown key `{key}`{nearest}; known here: {known}")]
    UnknownKey {
        /// File and line.
        place: String,
        /// The key as written.
        key: String,
        /// The nearest known key, as a clause; empty when none is near.
        nearest: String,
        /// All keys known in that table.
        known: String,
    },
    /// A file of another kind.
    #[error("{place}: is a {got} file; wanted a {wanted} file: {advice}")]
    WrongKind {
        /// The file.
        place: String,
        /// Its kind.
        got: &'static str,
        /// The kind that is needed here.
        wanted: &'static str,
        /// Where a file of its kind is accepted.
        advice: &'static str,
    },
    /// Several errors of one document.
    #[error("{first}{}", lines_of(others))]
    Several {
        /// The first.
        first: Box<ConfigError>,
        /// Found with the keys of those before left out.
        others: Vec<ConfigError>,
    },
    /// A value that cannot be.
    #[error("{place}: {key} is {got}; wanted {wanted}: {advice}")]
    Invalid {
        /// File, with the line when the file has the key.
        place: String,
        /// The key with its tables, such as `optics.focal_length_mm`.
        key: String,
        /// The rule.
        wanted: String,
        /// The value.
        got: String,
        /// Advice.
        advice: String,
    },
}

impl ConfigError {
    /// Returns several errors as one; a single one stays itself.
    pub(super) fn of(errors: Vec<Self>) -> Self {
        let mut errors: Vec<Self> = errors.into_iter().flat_map(Self::single).collect();
        if errors.len() == 1 {
            return errors.remove(0);
        }
        let first = Box::new(errors.remove(0));
        Self::Several { first, others: errors }
    }

    /// Returns it as a list: several errors apart.
    pub(super) fn single(self) -> Vec<Self> {
        let Self::Several { first, others } = self else { return vec![self] };
        core::iter::once(*first).chain(others).collect()
    }

    /// Returns whether it is about a key that is not given.
    pub(super) fn is_missing(&self) -> bool {
        matches!(self, Self::Invalid { got, .. } if got == MISSING)
    }

    /// Returns the key to blame, when there is one.
    pub(super) fn key(&self) -> Option<&str> {
        match self {
            Self::UnknownKey { key, .. } | Self::Invalid { key, .. } => Some(key),
            Self::Read { .. } | Self::Syntax { .. } | Self::WrongKind { .. } | Self::Several { .. } => None,
        }
    }
}

fn lines_of(others: &[ConfigError]) -> String {
    others.iter().map(|error| format!("\n  {error}")).collect()
}

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
