//! Errors of finding the scene of an exposure.

use sky::ObserverError;
use stars::layer::LayerError;

/// Errors of a scene.
#[derive(Debug, thiserror::Error)]
pub enum SceneError {
    /// A layer of stars could not be read.
    #[error("stars: {0}")]
    Stars(#[from] LayerError),
    /// The observer's orbit could not be computed.
    #[error("observer: {0}")]
    Observer(#[from] ObserverError),
    /// A thread could not be started.
    #[error("thread \"{name}\": {source}")]
    Thread {
        /// Name of the thread.
        name: &'static str,
        /// Cause.
        source: std::io::Error,
    },
}
