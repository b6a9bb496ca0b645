//! When a frame was handed to the graphics driver.

use base::time::{Span, Tai};

/// One new frame on its way to the screen. Repeats leave none.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Submitted {
    /// Number of the frame.
    pub frame: u32,
    /// Refreshes since the display was opened.
    pub refresh: u64,
    /// Time at which the driver took it: the **submit time**. Light leaves the screen one or two refreshes later, plus
    /// what the monitor itself takes.
    pub submit: Tai,
    /// When its light was to begin: the start of its exposure, where it has one.
    pub wanted_light: Option<Tai>,
    /// The refresh came more than one and a half refresh times after the one before.
    pub is_late: bool,
    /// Colour of the marker patch, when there is one: true is white.
    pub marker_is_white: bool,
}

impl Submitted {
    /// Returns when light should leave the screen, by a latency that was measured or given. A prediction.
    pub fn predicted_light(&self, latency: Span) -> Tai {
        self.submit + latency
    }
}
