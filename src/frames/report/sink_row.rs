//! Outcome of the frames at one sink: a line of the summary.

use serde::Serialize;
use std::collections::BTreeMap;

/// Result of one sink for the frames that it was given.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SinkRow {
    /// Place in the bench that names it.
    pub place: String,
    /// Its kind.
    pub sink: String,
    /// Frames it took.
    pub frames: u64,
    /// Frames that went past it because it was too slow, or lost.
    pub dropped: u64,
    /// Frames it failed on.
    pub refused: u64,
    /// Bytes it brought out.
    pub bytes: u64,
    /// CRC-32 over the frames it took, eight hexadecimal digits; `None` when it could not finish.
    pub run_crc32: Option<String>,
    /// Folder, file or address of the frames.
    pub output: Option<String>,
    /// Its first failure.
    pub first_error: Option<String>,
    /// Whether it broke down.
    pub is_lost: bool,
    /// Handed to the sinks to taken by this one, wall time, mean; 0 when nothing waits between the two.
    pub mean_delay_ms: f64,
    /// The longest of these.
    pub longest_delay_ms: f64,
    /// Numbers of its own.
    pub counts: BTreeMap<String, u64>,
}
