//! Why a run cannot be captured or replayed.

use crate::runtime::RunError;
use config::ConfigError;
use frames::sink::SinkError;
use link::capture::CaptureError;
use std::path::PathBuf;

/// A value, or why a run cannot be captured or replayed.
pub(super) type Result<T, E = ReplayError> = core::result::Result<T, E>;

/// A capture that cannot be made or replayed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The operating system refused a file.
    #[error("{}: cannot {doing}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Attempted action.
        doing: &'static str,
        /// Error of the operating system.
        source: std::io::Error,
    },
    /// A file has the name of the directory.
    #[error("{}: is a file; wanted a new or empty folder", path.display())]
    NotAFolder {
        /// The file.
        path: PathBuf,
    },
    /// The directory is in use.
    #[error("{}: holds a captured run already; wanted a new or empty folder", path.display())]
    Occupied {
        /// The directory.
        path: PathBuf,
    },
    /// The session's file is damaged or of another form.
    #[error("{}: {why}", path.display())]
    Session {
        /// The file.
        path: PathBuf,
        /// Description of the error, with the wanted and found values.
        why: String,
    },
    /// A row of the frames' file is damaged.
    #[error("{}:{line}: {why}; got \"{text}\"", path.display())]
    Row {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: u64,
        /// Description of the error, with the wanted form.
        why: &'static str,
        /// Its first characters.
        text: String,
    },
    /// The capture cannot be read or written at all.
    #[error("{}: {source}", path.display())]
    Capture {
        /// The file.
        path: PathBuf,
        /// Cause.
        source: CaptureError,
    },
    /// The content of the capture differs from its end record.
    #[error(
        "{}: holds {got} {what}, wanted {wanted} as its end record (session.json) states: the capture was cut short or \
         changed; wanted the whole directory as the run left it: copy it again",
        path.display()
    )]
    Incomplete {
        /// The file.
        path: PathBuf,
        /// Name of the count.
        what: &'static str,
        /// Number in the end record.
        wanted: u64,
        /// Number in the file.
        got: u64,
    },
    /// A head that the run does not have.
    #[error("--head {head}: the run has {heads}; wanted a number from 0 to {}", heads - 1)]
    NoSuchHead {
        /// The head.
        head: usize,
        /// Number of heads, at least 1.
        heads: usize,
    },
    /// The run file does not check.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// The run's parts cannot be made.
    #[error("{0}")]
    Parts(String),
    /// Drawing failed.
    #[error(transparent)]
    Run(#[from] RunError),
    /// A frame could not be stored.
    #[error("sink: {0}")]
    Sink(#[from] SinkError),
}
