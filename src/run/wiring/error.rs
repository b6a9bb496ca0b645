//! Why a run cannot be assembled or go on.

use crate::runtime::RunError;
use base::refused::Refused;
use config::ConfigError;

/// A value, or why a run cannot be assembled or go on.
pub(crate) type Result<T, E = LoopError> = core::result::Result<T, E>;

/// Why a run cannot be assembled or go on.
#[derive(Debug, thiserror::Error)]
pub enum LoopError {
    /// the configuration
    #[error(transparent)]
    Config(#[from] ConfigError),
    /// a part cannot be made
    #[error(transparent)]
    Parts(#[from] anyhow::Error),
    /// the vehicle cannot be made
    #[error("vehicle: {0}")]
    Vehicle(#[from] Refused),
    /// a spacecraft is needed
    #[error("got a run without a spacecraft; wanted one that names a spacecraft file: spacecraft = \"FILE\"")]
    NothingFlown,
    /// the run failed
    #[error(transparent)]
    Run(#[from] RunError),
    /// a fault or command that names what does not exist
    #[error("event \"{what}\": {why}")]
    Event {
        /// Word that names it.
        what: &'static str,
        /// Description of the error.
        why: String,
    },
}
