//! Frames -> a display in front of a tracker: where a star's light belongs on it, what grey makes it, when it shows.
//!
//! `geometry` and `response` say where and how bright, `drive` and `dither` make greys of luminance, `beat` and
//! `latency` tell what shutters and clocks do to it; `calibration` measures all of them.

pub mod beat;
pub mod calibration;
pub mod dither;
pub mod drive;
pub mod flat_field;
pub mod geometry;
pub mod latency;
pub mod least_squares;
pub mod response;
