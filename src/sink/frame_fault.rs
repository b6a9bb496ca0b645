//! The ways in which a frame can be spoilt on purpose; `runtime` does it, files name it.

use crate::base::time::Span;
use crate::sink::faults::FaultFlags;

/// How a frame is spoilt.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FrameFault {
    /// Not sent.
    Drop,
    /// The previous image in place of this one.
    Duplicate,
    /// Sent late by this.
    Late(Span),
    /// The upper half is the previous frame's.
    Torn,
    /// Every pixel reads the black level: no light.
    Blank,
    /// Uniform stray light, electrons per second and pixel.
    StrayLight {
        /// e-/s in every pixel.
        e_per_s: f64,
    },
}

impl FrameFault {
    /// The flag it sets in the frames it hits.
    #[must_use]
    pub fn flag(self) -> FaultFlags {
        match self {
            Self::Drop => FaultFlags::FRAME_DROP,
            Self::Duplicate => FaultFlags::FRAME_DUPLICATE,
            Self::Late(_) => FaultFlags::FRAME_LATE,
            Self::Torn => FaultFlags::FRAME_TORN,
            Self::Blank => FaultFlags::BLANK,
            Self::StrayLight { .. } => FaultFlags::STRAY_LIGHT,
        }
    }
}
