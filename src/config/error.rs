//! What can be wrong with a configuration: what, where, wanted, got, and what to try.

/// A configuration that was refused.
#[derive(Debug, thiserror::Error)]
pub enum ConfigError {
    /// The file cannot be read.
    #[error("{file}: cannot be read ({why}){named_by}")]
    Read {
        /// The file.
        file: String,
        /// What the system said.
        why: String,
        /// Which key of which file named it, as a clause; empty for the command line.
        named_by: String,
    },
    /// The text is not TOML, or a value has the wrong type.
    #[error("{place}: {why}, in `{text}`")]
    Syntax {
        /// File and line.
        place: String,
        /// What the reader found, and what it wanted.
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
    /// A value that cannot be.
    #[error("{place}: {key} is {got}; wanted {wanted}: {advice}")]
    Invalid {
        /// File, and line when the key stands in it.
        place: String,
        /// The key with its tables, such as `optics.focal_length_mm`.
        key: String,
        /// The rule.
        wanted: String,
        /// The value.
        got: String,
        /// What to try.
        advice: String,
    },
}
