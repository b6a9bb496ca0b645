//! Why a run cannot be captured or replayed.

use crate::runtime::RunError;
use base::refused::Refused;
use config::ConfigError;
use core::fmt::Display;
use frames::sink::SinkError;
use std::{io, path::Path};

/// A value, or why a run cannot be captured or replayed.
pub(super) type Result<T, E = ReplayError> = core::result::Result<T, E>;

/// A capture that cannot be made or replayed.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// A file, a folder or a value of them is refused.
    #[error(transparent)]
    Refused(#[from] Refused),
    /// The run file of the capture is refused.
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// A part of the run cannot be made.
    #[error(transparent)]
    Run(#[from] RunError),
    /// A sink failed.
    #[error("sink: {0}")]
    Sink(#[from] SinkError),
}

impl ReplayError {
    /// Returns the refusal of something in a file or folder.
    pub(super) fn at(path: &Path, why: impl Display) -> Self {
        Refused::at(path, why).into()
    }

    /// Returns the error of the operating system about a file: what cannot be done with it.
    pub(super) fn file(path: &Path, doing: &str) -> impl Fn(io::Error) -> Self + Copy {
        move |source| Self::at(path, format!("cannot {doing}: {source}"))
    }
}
