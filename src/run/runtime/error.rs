//! Why a run could not start or go on.

use base::{refused::Refused, time::Span};
use frames::sink::SinkError;
use image::detector::pattern::PatternSizeError;
use link::LinkError;

/// Any error at the other end of the cable.
pub type FarEndError = Box<dyn core::error::Error + Send + Sync>;

/// A value, or why the run cannot start or go on.
pub(crate) type Result<T, E = RunError> = core::result::Result<T, E>;

/// Errors of a run.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// the link failed
    #[error("link: {0}")]
    Link(#[from] LinkError),
    /// the other end of the cable failed
    #[error("the other end of the cable: {0}")]
    FarEnd(FarEndError),
    /// the backend failed
    #[error("backend: {0}")]
    Render(#[from] Refused),
    /// a map of the detector has another size
    #[error("detector: {0}")]
    Patterns(#[from] PatternSizeError),
    /// the sink failed
    #[error("sink: {0}")]
    Sink(#[from] SinkError),
    /// the stars could not be read
    #[error("catalog: {0}")]
    Stars(Refused),
    /// the scene of an exposure could not be found
    #[error(transparent)]
    Scene(Refused),
    /// the jitter lines do not fit
    #[error("jitter lines: {0}")]
    Jitter(#[from] plan::attitude::HistoryReject),
    /// the attitude stream stopped and the policy is to stop
    #[error("the attitude stream stopped: newest attitude {} ms old, and stale_policy is \"stop\"", age.ms())]
    AttitudeStopped {
        /// Age of the newest attitude.
        age: Span,
    },
    /// a thread could not be started
    #[error("thread \"{name}\": {source}")]
    Thread {
        /// Name of the thread.
        name: &'static str,
        /// Cause.
        source: std::io::Error,
    },
    /// calibration needs at least one scene to measure
    #[error("calibration: no scene to measure")]
    NothingMeasured,
    /// a thread ended before the run did
    #[error("thread \"{name}\" ended before the run did")]
    ThreadLost {
        /// Name of the thread.
        name: &'static str,
    },
}
