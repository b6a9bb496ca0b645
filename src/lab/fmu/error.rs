//! Errors of a co-simulation unit.

use base::refused::Refused;
use std::{fmt::Display, path::Path};

/// Why a unit cannot be made or cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum FmuError {
    /// The archive cannot be written.
    #[error(transparent)]
    Archive(#[from] frames::sink::SinkError),
    /// The run file is refused.
    #[error(transparent)]
    Config(Box<config::ConfigError>),
    /// The run cannot be put together or has failed.
    #[error(transparent)]
    Run(Box<run::wiring::error::LoopError>),
    /// A refusal in words.
    #[error(transparent)]
    Refused(#[from] Refused),
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

/// A file cannot be read or written.
pub(crate) fn file(path: &Path, doing: &'static str, source: impl Display) -> FmuError {
    Refused::at(path, format_args!("cannot {doing}: {source}")).into()
}

/// A step does not begin where the one before ended, or has no length.
pub(crate) fn step(from_s: f64, step_s: f64, at_s: f64) -> FmuError {
    Refused(format!("step from {from_s} s by {step_s} s: wanted one from {at_s} s with a length above 0")).into()
}
