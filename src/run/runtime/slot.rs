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
    /// When work on the frame starts: the end of the exposure minus the draw-ahead time.
    pub release: Tai,
    /// When the frame is due.
    pub due: Tai,
    /// Event that started the exposure.
    pub started: Started,
}

/// Event that started an exposure.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Started {
    /// The frame rate.
    #[default]
    Rate,
    /// A trigger.
    Trigger {
        /// Source of the trigger.
        source: TriggerSource,
        /// Time of the trigger.
        at: Tai,
    },
}

impl Started {
    /// Returns its name in files.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Rate => "rate",
            Self::Trigger { source, .. } => source.name(),
        }
    }
}

impl Slot {
    /// Returns the time from the trigger to the start of the exposure; zero for an exposure started by the frame rate.
    pub fn trigger_delay(&self) -> Span {
        match self.started {
            Started::Rate => Span::ZERO,
            Started::Trigger { at, .. } => self.exposure_start - at,
        }
    }
}
