//! Where the wall time of a frame went on the host's side.
//!
//! Device timestamps are not used: software adapters report nonsense for them, and the deadline is on the wall anyway.

use base::time::Span;

/// Wall time of one frame's trip through the detector pass.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FrameTimes {
    /// Writing parameters, recording and submitting.
    pub submit: Span,
    /// Waiting for the GPU until all submitted work is done, drawing included.
    pub wait: Span,
    /// Copying out.
    pub copy: Span,
}

impl Default for FrameTimes {
    fn default() -> Self {
        Self { submit: Span::ZERO, wait: Span::ZERO, copy: Span::ZERO }
    }
}
