//! Errors of a co-simulation unit.

use std::path::PathBuf;

/// Why a unit cannot be made or cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum FmuError {
    /// A file cannot be read or written.
    #[error("{}: cannot {doing}: {source}", .path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The action that failed.
        doing: &'static str,
        /// The error of the system.
        source: std::io::Error,
    },
    /// The packed run file is damaged, or of another version.
    #[error("{}: {why}; write the unit again with `starloop fmu`", .path.display())]
    Resource {
        /// The file.
        path: PathBuf,
        /// The reason.
        why: String,
    },
    /// The archive cannot be written.
    #[error(transparent)]
    Archive(#[from] frames::sink::SinkError),
    /// The run file is refused.
    #[error(transparent)]
    Config(Box<config::ConfigError>),
    /// The run cannot be put together or has failed.
    #[error(transparent)]
    Run(Box<run::wiring::error::LoopError>),
    /// A variable has a value that it cannot take.
    #[error("variable {name}: wanted {wanted}, got {got}")]
    Value {
        /// Its name.
        name: String,
        /// The accepted values.
        wanted: &'static str,
        /// The value that was set.
        got: String,
    },
    /// A function was called in a state in which the standard does not allow it.
    #[error("{function} was called {state}; wanted {wanted}")]
    Order {
        /// The function.
        function: &'static str,
        /// The state.
        state: &'static str,
        /// When it may be called.
        wanted: &'static str,
    },
    /// A step does not begin where the one before ended, or has no length.
    #[error("step from {from_s} s by {step_s} s: wanted one from {at_s} s with a length above 0")]
    Step {
        /// Where it should begin.
        from_s: f64,
        /// Its length.
        step_s: f64,
        /// Where the unit is.
        at_s: f64,
    },
    /// The attitude of the run file comes from inside.
    #[error(
        "{file}: the attitude comes from a file or a spacecraft inside this run, so a simulator outside cannot be the plant; \
         wanted plant.kind = \"outside\" or \"flight_computer\""
    )]
    FliesInside {
        /// The run file.
        file: String,
    },
}

impl From<run::wiring::error::LoopError> for FmuError {
    fn from(error: run::wiring::error::LoopError) -> Self {
        Self::Run(Box::new(error))
    }
}

impl From<config::ConfigError> for FmuError {
    fn from(error: config::ConfigError) -> Self {
        Self::Config(Box::new(error))
    }
}
