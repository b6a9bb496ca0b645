//! Counts of the rows of `frames.csv`, kept in the end record of a capture.

use super::FrameRow;
use serde::{Deserialize, Serialize};

/// Sums over the rows of `frames.csv`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RowCounts {
    /// Rows.
    pub rows: u64,
    /// Frames that went out: rows with a checksum.
    pub frames: u64,
    /// Number of the last row's frame; absent without rows.
    pub last_frame: Option<u32>,
}

impl RowCounts {
    /// Counts one more row.
    pub(super) fn add(&mut self, row: &FrameRow) {
        self.rows += 1;
        self.frames += u64::from(row.crc32.is_some());
        self.last_frame = Some(row.frame);
    }
}
