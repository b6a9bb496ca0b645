//! One frame's place in time.

use base::time::Tai;

/// One frame's place in time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Slot {
    /// Frame number, from 0.
    pub number: u32,
    /// First instant of the exposure.
    pub exposure_start: Tai,
    /// Last instant of the exposure.
    pub exposure_end: Tai,
    /// Work on the frame begins: at the exposure's end, or so much earlier as frames are drawn ahead.
    pub release: Tai,
    /// The frame is due.
    pub due: Tai,
}
