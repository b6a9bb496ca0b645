//! What is asked of a display.

use crate::base::time::Span;
use crate::display::marker::Marker;
use crate::display::monitor::MonitorChoice;

/// Bits of a grey on the way to the monitor.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Bits {
    /// 256 greys: every monitor.
    #[default]
    Eight,
    /// 1024 greys: where driver, server and monitor agree on it.
    Ten,
}

impl Bits {
    /// The number.
    #[must_use]
    pub const fn count(self) -> u32 {
        match self {
            Self::Eight => 8,
            Self::Ten => 10,
        }
    }

    /// The brightest grey, `2^bits - 1`.
    #[must_use]
    pub const fn most(self) -> u16 {
        match self {
            Self::Eight => 255,
            Self::Ten => 1023,
        }
    }
}

/// A display, as a bench describes it.
#[derive(Debug, Clone, PartialEq)]
pub struct Params {
    /// Which monitor is filled.
    pub monitor: MonitorChoice,
    /// A window of this size (columns, rows) in place of a full screen.
    pub window_px: Option<[u32; 2]>,
    /// Columns and rows of the frames that will come.
    pub image_px: [u32; 2],
    /// Bits of a grey.
    pub bits: Bits,
    /// A square for a photodiode.
    pub marker: Option<Marker>,
    /// Submit to light, as measured or given: added to a submit time it predicts when light left the screen. `None`:
    /// not known.
    pub latency: Option<Span>,
    /// Asks for direct scan-out, with no X server. Refused: see [`crate::display::DisplayError::DirectScanOut`].
    pub direct_scanout: bool,
}

impl Params {
    /// Frames of this size over the whole primary monitor, 8 bits, no marker.
    #[must_use]
    pub const fn full_screen(image_px: [u32; 2]) -> Self {
        Self {
            monitor: MonitorChoice::Primary,
            window_px: None,
            image_px,
            bits: Bits::Eight,
            marker: None,
            latency: None,
            direct_scanout: false,
        }
    }
}
