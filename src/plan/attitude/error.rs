//! Errors of this module.

use base::time::Tai;

/// Reason why a sample was not taken into a history; each has its own counter in
/// [`HistoryCounts`](super::HistoryCounts).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, thiserror::Error)]
pub enum HistoryReject {
    /// A sample of the same epoch is already stored.
    #[error("a sample of the same epoch is already held")]
    DuplicateEpoch,
    /// The epoch is older than the limit allows at its receive time.
    #[error("the epoch is older than the limit at receive time")]
    Stale,
    /// The epoch is further ahead of its receive time than the limit allows.
    #[error("the epoch is ahead of the receive time by more than the limit")]
    Future,
    /// A rate, an acceleration or a jitter rotation is NaN or infinite.
    #[error("a component is not finite")]
    NotFinite,
    /// The rate, the acceleration, the turn from a neighbouring sample, or a jitter rotation is above the limit.
    #[error("a rate or a turn above 1000 deg/s, an acceleration above 10,000 deg/s^2, or jitter above 1 degree")]
    TooFast,
    /// The history is full of newer samples.
    #[error("the history is full of newer samples")]
    OlderThanHistory,
}

/// Reason why a table of jitter was not put into effect.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
pub enum JitterReject {
    /// More rows than the capacity.
    #[error("{got} rows of jitter parameters: wanted {most} at most; join what is close together")]
    TooMany {
        /// Number of rows received.
        got: usize,
        /// Largest number of rows.
        most: usize,
    },
    /// A row has a number that is not finite or outside its range.
    #[error(
        "row {row} of jitter parameters has an illegal number: wanted finite ones, frequencies and harmonics above zero"
    )]
    Illegal {
        /// The row, from 0.
        row: usize,
    },
    /// The frequencies of a density do not rise.
    #[error("row {row} of the jitter's density: wanted a frequency above that of the row before")]
    NotRising {
        /// The row, from 0.
        row: usize,
    },
}

/// Reason why no line of sight could be made.
#[derive(Debug, Clone, Copy, PartialEq, thiserror::Error)]
pub enum AttitudeError {
    /// Nothing has been received yet.
    #[error("no attitude at {at}: the history is empty; wait for the first ATT message or check the link")]
    NoSamples {
        /// The requested instant.
        at: Tai,
    },
    /// The instant is older than everything the history still contains.
    #[error(
        "no attitude at {at}: the history begins at {oldest}; wanted a later exposure, or a history with more capacity"
    )]
    BeforeHistory {
        /// The requested instant.
        at: Tai,
        /// Epoch of the oldest stored sample.
        oldest: Tai,
    },
    /// The instant is later than the newest sample, and the method needs one after it.
    #[error(
        "no attitude at {at} by interpolation: the newest sample is of {newest}; predict, or wait for the next one"
    )]
    AfterHistory {
        /// The requested instant.
        at: Tai,
        /// Epoch of the newest stored sample.
        newest: Tai,
    },
    /// The exposure time is not finite and positive.
    #[error("exposure of {exposure_s} s: wanted a finite time of zero or more")]
    ExposureTime {
        /// The requested exposure time, s.
        exposure_s: f64,
    },
}
