//! One frame's place in time.

use base::time::{Span, Tai};
use frames::camera_control::TriggerSource;

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
    /// What started the exposure.
    pub started: Started,
}

/// What started an exposure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Started {
    /// The frame rate.
    #[default]
    Rate,
    /// A trigger.
    Trigger {
        /// Where it came from.
        source: TriggerSource,
        /// When it came.
        at: Tai,
    },
}

impl Started {
    /// Returns its name in files.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Rate => "rate",
            Self::Trigger { source, .. } => source.name(),
        }
    }
}

impl Slot {
    /// Returns the time from the trigger to the start of the exposure; zero for an exposure that the frame rate started.
    #[must_use]
    pub fn trigger_delay(&self) -> Span {
        match self.started {
            Started::Rate => Span::ZERO,
            Started::Trigger { at, .. } => self.exposure_start - at,
        }
    }
}
