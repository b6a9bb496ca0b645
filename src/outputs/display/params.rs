//! The parameters of a display.

use crate::display::{monitor::MonitorChoice, picture::Marker};
use base::time::Span;

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
    /// Returns the number of bits.
    pub const fn count(self) -> u32 {
        match self {
            Self::Eight => 8,
            Self::Ten => 10,
        }
    }

    /// Returns the brightest grey, `2^bits - 1`.
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
    /// Monitor that is filled.
    pub monitor: MonitorChoice,
    /// A window of this size (columns, rows) in place of a full screen.
    pub window_px: Option<[u32; 2]>,
    /// Bits of a grey.
    pub bits: Bits,
    /// A square for a photodiode.
    pub marker: Option<Marker>,
    /// Submit to light in the middle of the display, as measured or given: added to a submit time it predicts when
    /// light left the screen. `None`: not known.
    pub latency: Option<Span>,
    /// Time of the refresh that each frame was drawn for: frames are held back until theirs. `None`: each is shown as
    /// soon as it is there.
    pub refresh: Option<Span>,
}

impl Params {
    /// Returns the whole primary monitor, 8 bits, no marker.
    pub const fn full_screen() -> Self {
        Self {
            monitor: MonitorChoice::Primary,
            window_px: None,
            bits: Bits::Eight,
            marker: None,
            latency: None,
            refresh: None,
        }
    }

    /// Returns how long before its light is to leave a frame may be submitted at the earliest: the latency and half a
    /// refresh, so that of all refreshes it gets the one whose light comes nearest. `None`: at any time.
    pub fn lead(&self) -> Option<Span> {
        let refresh = self.refresh?;
        Some(self.latency.unwrap_or(Span::ZERO) + Span::from_ns(refresh.ns() / 2))
    }
}
